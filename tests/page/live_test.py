#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The live page in headless Chromium while a run trains.

    live_test.py BIN_FOLDER [SCREENSHOT.jpg]      exits with 77 where there is no Chromium or no web server
"""
import subprocess
import sys
import tempfile
from pathlib import Path

import chromium
from browser_test import box, choose, expect

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "apps"))
from serve_test import Runs, Served, wait_for  # noqa: E402

STEPS = "--set train.iterations=100000 --set objective.target=edi --set densify.until=100000".split()
STEP = "Number(jade.live.viewer.step)"


def check_frames(page, served):
    expect(page.open(served.url) == "scene", "expected the scene")
    page.wait(f"{STEP} > 0")
    first = page.evaluate(STEP)
    page.wait(f"{STEP} > {first} + 2")
    colours = """new Set(new Uint32Array(document.getElementById('scene').getContext('2d')
        .getImageData(0, 0, 48, 36).data.buffer)).size"""
    expect(page.evaluate(colours) > 100, "the canvas shows a picture")
    hud = page.evaluate("document.getElementById('hud').textContent")
    expect("step" in hud and "Gaussians" in hud and "48×36" in hud, f"what is shown: {hud}")
    page.wait("document.querySelectorAll('#charts svg').length > 3")
    expect(page.evaluate("document.querySelectorAll('#glance .card').length") >= 3, "figures")
    expect(page.evaluate("document.getElementById('views').hidden && document.getElementById('allocation').hidden"), "no empty sections")


def check_pause(page):
    page.evaluate("document.getElementById('stage').focus()")
    page.key("t", "KeyT", "t")
    page.wait("document.getElementById('pause').getAttribute('aria-pressed') === 'true'")
    page.wait("jade.live.state.phase === 'paused'")
    step = page.evaluate("jade.live.state.step")
    left, top, width, height = box(page, "stage")
    page.evaluate("window.before = document.getElementById('scene').toDataURL(); 0")
    page.drag((left + 0.7 * width, top + 0.5 * height), (left + 0.5 * width, top + 0.6 * height))
    page.wait("document.getElementById('scene').toDataURL() !== window.before")
    expect(page.evaluate("document.getElementById('stage').matches('.away')"), "a drag orbits")
    expect(page.evaluate("jade.live.state.step") == step, "no step while paused")
    page.key("r", "KeyR", "r")
    page.wait("!jade.state.pose")


def check_views(page):
    """Still paused, so that what is seen stays."""
    choose(page, "camera", "train.1")
    page.wait("document.getElementById('camera').value === 'train.1' && jade.layers.names.includes('EDI')")
    for layer in ("EDI", "render", "depth"):
        choose(page, "left-layer", layer)
        page.wait(f"jade.layers.left === '{layer}' && document.getElementById('left').naturalWidth === 48")
    choose(page, "moment", 0)
    page.evaluate("window.early = document.getElementById('scene').toDataURL(); 0")
    choose(page, "moment", 1)
    page.wait("document.getElementById('scene').toDataURL() !== window.early")
    page.evaluate("document.getElementById('events').click()")
    page.wait("!document.getElementById('event-layer').hidden")
    choose(page, "moment", 0.5)
    marks = """(() => { const layer = document.getElementById('event-layer');
        const {data} = layer.getContext('2d').getImageData(0, 0, layer.width, layer.height);
        return {width: layer.width, marked: data.filter((value, k) => k % 4 === 3 && value > 0).length}; })()"""
    found = page.evaluate(marks)
    expect(found["width"] == 48 and found["marked"] > 10, f"events over the scene, found {found}")
    page.evaluate("document.getElementById('events').click()")
    page.wait("document.getElementById('event-layer').hidden")
    page.evaluate("document.getElementById('play').click()")
    page.wait("document.getElementById('moment-value').textContent === 'mean of 32' && !jade.playing")
    page.evaluate("document.getElementById('pause').click()")
    page.wait("jade.live.state.phase === 'training'")


def check_end(page, served):
    code, _ = served.interrupt()
    expect(code == 130, f"expected 130 after Ctrl-C with a page open, found {code}")
    page.wait("!document.getElementById('notice').hidden && /has ended/.test(document.getElementById('notice').textContent)")


def main():
    programs = Path(sys.argv[1])
    if not chromium.find():
        print("SKIPPED: needs Chromium: scripts/setup.sh --browser")
        return 77
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(programs, Path(folder))
        probe = subprocess.run(runs.training("probe", "--serve=127.0.0.1:0", "--set", "dataset.path=/nowhere"), capture_output=True, text=True)
        if "has no web server" in probe.stderr:
            print("SKIPPED: needs libcpp-httplib-dev: scripts/setup.sh; then configure and build again")
            return 77
        served = Served(*runs.training("run", "--serve=0", *STEPS))
        try:
            with chromium.Chromium(1180, 900) as page:
                wait_for(lambda: page.open(served.url, "document.readyState === 'complete'") and page.evaluate("!!document.getElementById('stage')"), "the page")
                check_frames(page, served)
                check_pause(page)
                check_views(page)
                expect(page.errors == [], f"the page complains: {page.errors}")
                foreign = [url[:80] for url in page.requests if not url.startswith((served.url, "data:", "blob:", "about:"))]
                expect(foreign == [], f"the page asks elsewhere: {foreign}")
                if len(sys.argv) > 2:
                    Path(sys.argv[2]).write_bytes(page.screenshot("jpeg", 80))
                check_end(page, served)
        finally:
            served.process.kill()
            served.process.wait()
    print("the live page does what it says")
    return 0


if __name__ == "__main__":
    sys.exit(main())
