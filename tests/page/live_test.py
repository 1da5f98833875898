#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The live page in headless Chromium while a run trains.

    live_test.py BIN_FOLDER [SCREENSHOT.jpg]      exits with 77 if there is no Chromium or no web server
"""
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import chromium
from browser_test import box, choose, expect

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "apps"))
from serve_test import Runs, Served, ask, wait_for  # noqa: E402

STEPS = "--set train.iterations=100000 --set objective.target=edi --set densify.until=100000 --set train.evaluate_every=0".split()
LEARNED = "--set poses.optimize=linear --set poses.lr=1e-2".split()
STEP = "Number(jade.live.viewer.step)"


def check_frames(page, served):
    expect(page.wait("document.documentElement.dataset.ready") == "scene", "expected the scene")
    page.wait(f"{STEP} > 0")
    first = page.evaluate(STEP)
    page.wait(f"{STEP} > {first} + 2")
    colours = """new Set(new Uint32Array(document.getElementById('scene').getContext('2d')
        .getImageData(0, 0, 48, 36).data.buffer)).size"""
    expect(page.evaluate(colours) > 100, "the canvas shows a picture")
    hud = page.evaluate("document.getElementById('hud').textContent")
    expect("step" in hud and "Gaussians" in hud and "48×36" in hud, f"what is shown: {hud}")
    page.wait("document.querySelectorAll('.charts svg').length > 3")
    expect(page.evaluate("document.querySelectorAll('#glance .card').length") >= 3, "figures")
    expect(page.evaluate("document.getElementById('title').textContent") == "data", "the name of the data set")
    expect(page.evaluate("['views', 'allocation'].every(id => document.getElementById(id).closest('.part').hidden)"), "no empty sections")


def check_cameras(page):
    """Learned poses move the page's cameras while the user looks through one."""
    page.evaluate("window.first = jade.cameras.get('train.0').poses[4].join(); 0")
    page.wait("jade.cameras.get('train.0').poses[4].join() !== window.first")
    page.wait("!jade.state.pose && jade.viewer.wanted?.pose.join() === jade.pose().join()")


def check_notes(page):
    """Scores against a true image: of the frame, and of pictures; the render's changes during training."""
    choose(page, "camera", "test.0")
    page.wait("jade.state.camera === 'test.0' && /PSNR \\d+\\.\\d\\d dB/.test(document.getElementById('hud').textContent)")
    choose(page, "left-layer", "render")
    note = "document.getElementById('left-tag').textContent"
    page.wait(f"/^render \\d+\\.\\d\\d dB$/.test({note})")
    page.evaluate(f"window.noted = {note}; 0")
    page.wait(f"{note} !== window.noted && /^render/.test({note})")
    choose(page, "left-layer", "truth")
    page.wait(f"{note} === 'truth'")
    choose(page, "left-layer", "|difference|")
    page.wait("document.getElementById('left').naturalWidth === 48 && document.getElementById('left').alt === '|difference|'")
    choose(page, "camera", "train.0")
    page.wait("jade.state.camera === 'train.0' && jade.layers.names.includes('EDI')")
    hud = page.evaluate("document.getElementById('hud').textContent")
    expect("dB" in hud, f"a figure where no truth is: {hud}")


def check_keys(page):
    """Flying works without focus, and keys work on sliders too."""
    page.evaluate("document.activeElement.blur()")
    before = page.evaluate("jade.pose()")
    page.call("Input.dispatchKeyEvent", type="keyDown", key="w", code="KeyW")
    page.wait(f"Math.abs(jade.pose()[11] - {before[11]}) > 1e-3")
    page.call("Input.dispatchKeyEvent", type="keyUp", key="w", code="KeyW")
    page.evaluate("document.getElementById('moment').focus()")
    page.key("r", "KeyR", "r")
    page.wait("!jade.state.pose")
    page.evaluate("document.querySelector('#more summary').focus()")
    page.key(" ", "Space", " ")
    page.wait("document.getElementById('more').open && !jade.playing")
    page.key(" ", "Space", " ")
    page.wait("!document.getElementById('more').open")


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
    """Training is still paused, so that the view does not change."""
    choose(page, "camera", "train.1")
    page.wait("document.getElementById('camera').value === 'train.1' && jade.layers.names.includes('EDI')")
    for layer in ("EDI", "render", "depth"):
        choose(page, "left-layer", layer)
        page.wait(f"document.getElementById('left').alt === '{layer}' && document.getElementById('left').naturalWidth === 48")
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
    page.wait("!document.getElementById('notice').hidden && /has ended or cannot be reached/.test(document.getElementById('notice').textContent)")
    page.wait("document.getElementById('hud').textContent.startsWith('not live') && document.getElementById('pause').disabled")


def check_next(page, served, runs):
    """Another run uses the same port; the page shows that one, and reports the end of its training."""
    port = re.search(r":(\d+)/", served.url)[1]
    following = Served(*runs.training("next", f"--serve={port}", *LEARNED, "--set", "train.evaluate_every=0", "--set", "train.iterations=300"))
    try:
        # Paused until the page has found it: a fast machine would finish first. Meanwhile the page may show the note
        # that the views are being prepared.
        expect(ask(f"{following.url}pause?viewer=test&on=1", "POST")[0] == 204, "pause")
        page.wait("window.jade?.live?.known?.steps === 300")
        page.wait("jade.live.known.phase === 'paused'")
        expect(ask(f"{following.url}pause?viewer=test&on=0", "POST")[0] == 204, "go on")
        page.wait("/^Training has ended/.test(document.getElementById('notice').textContent)", 120)
        expect(following.end() == 0, following.said())
        page.wait("document.getElementById('notice').textContent.includes('next/report.html')")
    finally:
        following.process.kill()
        following.process.wait()


def check_scores(page, run):
    """jade_view shows the scores of the run, first among the figures and as a table."""
    scores = json.loads((run / "eval.json").read_text())
    parts = [scores[key] for key in ("mean_seen", "mean_unseen") if scores.get(key)] or [scores["mean"]]
    page.wait("document.querySelectorAll('#glance .card').length > 1")
    cards = page.evaluate("[...document.querySelectorAll('#glance .card')].map(card => card.textContent)")
    expect(all(any(f"{mean['psnr']:.2f} dB" in card for card in cards) for mean in parts), f"a card for each score, found {cards}")
    rows = page.evaluate("[...document.querySelectorAll('#scores tbody tr')].map(row => row.textContent)")
    expect(any(f"{scores['mean']['psnr']:.2f}" in row and row.startswith("mean") for row in rows), f"a row of means, found {rows}")


def check_view(page, runs):
    """jade_view of a finished run shows the layers of its training."""
    view = Served(*runs.program("jade_view", runs.folder / "next", "--device", "cpu", "--serve=0"))
    try:
        wait_for(lambda: page.open(view.url, "document.readyState === 'complete'") and page.evaluate("!!document.getElementById('stage')"), "the page")
        page.wait("document.documentElement.dataset.ready")
        expect(page.evaluate("jade.layers.names") == ["scene", "depth", "blurry", "EDI", "event density", "render"]
               + page.evaluate("jade.layers.names.filter(name => name === 'truth' || name === '|difference|')"), "the layers of a run")
        choose(page, "left-layer", "EDI")
        page.wait("document.getElementById('left').alt === 'EDI' && document.getElementById('left').naturalWidth === 48")
        expect(page.evaluate("document.getElementById('pause-key').hidden"), "nothing to pause")
        check_scores(page, runs.folder / "next")
        view.interrupt()
        page.wait("/^jade_view has ended/.test(document.getElementById('notice').textContent)")
    finally:
        view.process.kill()
        view.process.wait()


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
        served = Served(*runs.training("run", "--serve=0", *STEPS, *LEARNED))
        try:
            with chromium.Chromium(1180, 900) as page:
                # Reopen the page: before there are views, and with a view in the address.
                page.open(f"{served.url}#camera=train.0", "document.readyState === 'complete'")
                page.wait("!!document.getElementById('stage')")
                check_frames(page, served)
                check_cameras(page)
                check_notes(page)
                check_keys(page)
                check_pause(page)
                check_views(page)
                expect(page.errors == [], f"the page complains: {page.errors}")
                foreign = [url[:80] for url in page.requests if not url.startswith((served.url, "data:", "blob:", "about:"))]
                expect(foreign == [], f"the page asks elsewhere: {foreign}")
                if len(sys.argv) > 2:
                    Path(sys.argv[2]).write_bytes(page.screenshot("jpeg", 80))
                check_end(page, served)
                check_next(page, served, runs)
                check_view(page, runs)
        finally:
            served.process.kill()
            served.process.wait()
    print("the live page does what it says")
    return 0


if __name__ == "__main__":
    sys.exit(main())
