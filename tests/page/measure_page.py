#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What docs/viewer.md shows of a finished run: the table of fidelity, the size of its report, and screenshots.

    measure_page.py RUN [FOLDER]      FOLDER: where the screenshots go
"""
import argparse
import base64
import json
import sys
import time
from pathlib import Path

import chromium
from browser_test import PROBE


def fidelity(page, run):
    print("| test view | canvas against jade_render | truth, jade_render | truth, canvas |\n|---|---|---|---|")
    page.evaluate("document.getElementById('native').click()")
    for k, view in enumerate(json.loads((run / "eval.json").read_text())["views"]):
        page.evaluate(f"jade.jump('test.{k}')")
        rendered = base64.b64encode((run / "images" / f"test_{view['name']}.png").read_bytes()).decode()
        same = page.evaluate(f"probe.against(['data:image/png;base64,{rendered}'])")
        truth = page.evaluate("probe.against([jade.pictures().find(p => p.name === 'truth').src])")
        print(f"| {view['name']} | {same:.2f} dB | {view['psnr']:.2f} dB | {truth:.2f} dB |")
    page.evaluate("document.getElementById('native').click()")


def screenshots(page, report, folder):
    def shoot(name):
        time.sleep(0.5)
        (folder / f"{name}.jpg").write_bytes(page.screenshot("jpeg", 80))
    page.resize(1180, 1010)
    page.open(f"{report}")
    shoot("report")
    page.resize(1180, 800)
    page.open(f"{report}#camera=test.0&left=%7Cdifference%7C&right=scene&wipe=0.4")
    page.evaluate("document.getElementById('see').scrollIntoView()")
    shoot("viewer")
    page.resize(390, 844, mobile=True)
    page.open(f"{report}")
    shoot("viewer_phone")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("folder", nargs="?", type=Path)
    arguments = parser.parse_args()
    if not chromium.find():
        print("measure_page: needs Chromium: scripts/setup.sh --browser", file=sys.stderr)
        return 2
    report = (arguments.run / "report.html").resolve()
    with chromium.Chromium(1180, 1010) as page:
        page.open(report.as_uri())
        page.evaluate(PROBE)
        packed = page.evaluate("document.getElementById('spz').textContent.length")
        print(f"{page.evaluate('jade.viewer.scene.count')} Gaussians: {packed / 1e6:.2f} MB of {report.stat().st_size / 1e6:.2f} MB\n")
        fidelity(page, arguments.run)
        if arguments.folder:
            screenshots(page, report.as_uri(), arguments.folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
