#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures the figures of docs/viewer.md for a finished run: the size of its report, the table of fidelity, and
screenshots.

    measure_page.py RUN [FOLDER]      FOLDER: for the screenshots
    measure_page.py RUN --speed       measures the cost of a frame instead: in JavaScript, and in pixels blended
"""
import argparse
import base64
import json
import sys
import time
from pathlib import Path

import chromium
from browser_test import PROBE


SIZES = """({whole: new Blob([document.documentElement.outerHTML]).size, scene: document.getElementById('spz').textContent.length,
  events: jade.data.views.reduce((sum, view) => sum + (view.events?.packed.length ?? 0), 0),
  pictures: [...jade.data.views, ...jade.data.tests].flatMap(view => view.pictures).reduce((sum, picture) => sum + picture.src.length, 0)})"""
# Milliseconds of moving the camera, median of 15 (5 for whole pictures), and the number of pixels covered by Gaussians.
# The canvas has `scale` pixels per pixel of the camera. The first measurement of each is dropped.
SPEED = """(async (scale) => {
  const {viewer} = jade, {renderer, sorter, scene} = viewer, camera = jade.camera(), gl = renderer.gl;
  const median = (list) => list.sort((a, b) => a - b)[list.length >> 1];
  const times = {inside: [], turn: [], upload: [], calls: [], picture: []};
  const timed = async (name, call) => { const start = performance.now(); const done = await call(); times[name].push(performance.now() - start); return done; };
  for (let k = 0; k < 16; ++k) {
    const pose = [...jade.pose()];
    pose[3] += 0.002 * k;
    await timed('inside', () => sorter.arrange({view: pose.slice(8), centre: [0, 1, 2].map(i => -(pose[i] * pose[3] + pose[4 + i] * pose[7] + pose[8 + i] * pose[11]))}));
    const sorted = await timed('turn', () => sorter.request(pose));
    await timed('upload', () => renderer.setOrder(sorted));
    if (k > 5) continue;
    gl.finish();
    const start = performance.now();
    await timed('calls', () => { renderer.draw(camera, pose, scale); renderer.show(); });
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    times.picture.push(performance.now() - start);
  }
  const [w, h, fx, fy, cx, cy] = ['width', 'height', 'fx', 'fy', 'cx', 'cy'].map(key => camera[key] * scale), p = jade.pose();
  const rows = [p.slice(0, 3), p.slice(4, 7), p.slice(8, 11)];
  let covered = 0, drawn = 0;
  for (let i = 0; i < scene.count; ++i) {
    const [x, y, z] = rows.map((row, r) => row.reduce((sum, v, c) => sum + v * scene.positions[3 * i + c], p[4 * r + 3]));
    const opacity = scene.opacities[i];
    if (z < jade.data.scene.near_plane || opacity < 1 / 255) continue;
    const limit = (value, size, f, c) => Math.min((size - c) / f + 0.15 * size / f, Math.max(-c / f - 0.15 * size / f, value));
    const [u, v] = [limit(x / z, w, fx, cx), limit(y / z, h, fy, cy)];
    const t = [0, 1].map(r => rows[r].map((value, c) => (r ? fy : fx) / z * (value - (r ? v : u) * rows[2][c])));
    const s = scene.covariances.subarray(6 * i, 6 * i + 6);
    const times3 = (a) => [s[0] * a[0] + s[1] * a[1] + s[2] * a[2], s[1] * a[0] + s[3] * a[1] + s[4] * a[2], s[2] * a[0] + s[4] * a[1] + s[5] * a[2]];
    const of = (a, b) => times3(a).reduce((sum, value, k) => sum + value * b[k], 0);
    const low = 0.3 * scale * scale, xx = of(t[0], t[0]) + low, xy = of(t[0], t[1]), yy = of(t[1], t[1]) + low, det = xx * yy - xy * xy;
    const reach = 2 * Math.log(255 * opacity), px = fx * x / z + cx, py = fy * y / z + cy;
    const before = covered;
    // Row by row: where (dx, dy) with the inverse covariance is below the reach.
    for (let row = Math.max(0, Math.ceil(py - Math.sqrt(reach * yy) - 0.5)); row < Math.min(h, py + Math.sqrt(reach * yy) - 0.5); ++row) {
      const dy = row + 0.5 - py, rest = (reach - dy * dy / yy) * det / yy;
      if (rest <= 0) continue;
      const middle = px + dy * xy / yy, half = Math.sqrt(rest);
      covered += Math.max(0, Math.min(w, Math.floor(middle + half + 0.5)) - Math.max(0, Math.ceil(middle - half - 0.5)));
    }
    drawn += covered > before;
  }
  return {...Object.fromEntries(Object.entries(times).map(([name, list]) => [name, median(list.slice(1))])), covered, drawn, width: renderer.canvas.width, height: renderer.canvas.height};
})"""


def sizes(page, run):
    found = page.evaluate(SIZES)
    parts = ", ".join(f"{name} {found[name] / 1e6:.2f} MB" for name in ("scene", "pictures", "events"))
    print(f"{page.evaluate('jade.viewer.scene.count')} Gaussians: {(run / 'report.html').stat().st_size / 1e6:.2f} MB: {parts}\n")


def speed(page):
    print("| canvas | Gaussians in the picture | sort and SH, ms | there and back | upload | draw calls | whole picture | Mpx blended | layers per pixel |\n"
          "|---|---|---|---|---|---|---|---|---|")
    for scale in (1, 4):
        f = page.evaluate(f"{SPEED}({scale})")
        print(f"| {f['width']}×{f['height']} | {f['drawn']} | {f['inside']:.1f} | {f['turn']:.1f} | {f['upload']:.2f} | {f['calls']:.2f} | {f['picture']:.0f} "
              f"| {f['covered'] / 1e6:.2f} | {f['covered'] / f['width'] / f['height']:.1f} |")


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
    page.resize(1180, 1010)
    page.open("about:blank", "true")
    page.open(f"{report}#camera=train.0&left=blurry&right=scene&events=1", "document.documentElement?.dataset.ready && !document.getElementById('event-layer').hidden")
    shoot("events")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--speed", action="store_true")
    arguments = parser.parse_args()
    if not chromium.find():
        print("measure_page: needs Chromium: scripts/setup.sh --browser", file=sys.stderr)
        return 2
    report = (arguments.run / "report.html").resolve()
    with chromium.Chromium(1180, 1010) as page:
        page.open(report.as_uri())
        page.evaluate(PROBE)
        sizes(page, arguments.run)
        if arguments.speed:
            speed(page)
            return 0
        fidelity(page, arguments.run)
        if arguments.folder:
            screenshots(page, report.as_uri(), arguments.folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
