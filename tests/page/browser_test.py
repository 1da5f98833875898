#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A report and a sweep's page in headless Chromium: compares the scene with jade_render, and tests all controls.

    browser_test.py BIN_FOLDER      exits with 77 if there is no Chromium
"""
import array
import base64
import json
import random
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import chromium

SIMULATION = """
seed: 3
simulate:
  world: desk
  width: 80
  height: 60
  focal_px: 100
  exposures: 3
  test_views: 2
  seen_test_views: 1
  motion: {blur_px: 5}
"""
ROOT = Path(__file__).resolve().parents[2]
RESTORER = ROOT / "assets" / "efnet_anytime.pt"
TRAINING = f"""
extends: {ROOT / "configs" / "paper.yaml"}
device: cpu
efnet: {{path: {RESTORER}}}
events: {{threshold_positive: 0.25}}
init: {{points: 2000}}
densify: {{max_gaussians: 2000}}
train: {{iterations: 1, evaluate_every: 0, picture_every: 0}}
"""
# PSNR between the canvas, or a picture, and another picture.
PROBE = """window.probe = {
  async pixels(source) {
    // Not decode(), which Chromium under load was seen to refuse for a whole picture.
    const image = new Image();
    await new Promise((done, fail) => {
      image.onload = done;
      image.onerror = () => fail(new Error(`expected a picture, found ${String(source).slice(0, 60)}, ${source?.length} characters`));
      image.src = source;
    });
    const board = Object.assign(document.createElement('canvas'), {width: image.naturalWidth, height: image.naturalHeight});
    const context = board.getContext('2d');
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, board.width, board.height).data;
  },
  psnr(a, b) {
    if (a.length !== b.length) throw new Error(`sizes differ: ${a.length} and ${b.length}`);
    let sum = 0;
    for (let k = 0; k < a.length; ++k) if (k % 4 < 3) sum += ((a[k] - b[k]) / 255) ** 2;
    return -10 * Math.log10(sum / (0.75 * a.length) + 1e-12);
  },
  async canvas() {
    // The mean that was played lies behind the canvas; anything else is drawn again.
    const viewer = jade.viewer;
    if (probe.mean) { viewer.renderer.show(true); return probe.pixels(viewer.renderer.picture()); }
    return probe.pixels(await viewer.picture(jade.camera(), jade.pose()));
  },
  async against(sources) {
    const all = [];
    for (const source of sources) all.push(await probe.pixels(source));
    const mean = all[0].map((_, k) => all.reduce((sum, one) => sum + one[k], 0) / all.length);
    return probe.psnr(await probe.canvas(), mean);
  },
}; 0"""
CONTROLS = "[...document.querySelectorAll('button, select, input, [role=slider], [role=application], [tabindex]')]"


def harden(ply: Path, seed=5):
    """Makes a scene hard to render: small, thin, rotated Gaussians of every opacity, with direction-dependent
    colours.
    """
    header, body = ply.read_bytes().split(b"end_header\n", 1)
    names = re.findall(rb"property float (\w+)", header)
    values = array.array("f", body)
    draw = random.Random(seed)
    spread = {b"f_dc": (0, 1), b"f_rest": (0, 0.2), b"opacity": (0, 2.5), b"scale": (-4.3, 0.9), b"rot": (0, 1)}
    for k in range(len(values)):
        kind = re.sub(rb"_\d+$", b"", names[k % len(names)])
        if kind in spread:
            values[k] = draw.gauss(*spread[kind])
        if kind == b"f_rest":
            values[k] = round(8 * values[k]) / 8  # values that .spz stores without loss
    ply.write_bytes(header + b"end_header\n" + values.tobytes())


class Run:
    """A small scene, hard to render and trained for one step, and its pictures by jade_render."""

    def __init__(self, programs: Path, folder: Path):
        self.programs, self.folder = programs, folder
        (folder / "simulation.yaml").write_text(SIMULATION)
        (folder / "training.yaml").write_text(TRAINING)
        self.program("jade_simulate", "--config", folder / "simulation.yaml", "--output", folder / "data")
        self.train(folder / "start")
        harden(folder / "start" / "point_cloud.ply")
        self.train(folder / "run", "--set", "init.kind=ply", "--set", f"init.ply={folder / 'start' / 'point_cloud.ply'}")
        for cameras in ("test", "exposure"):
            self.render(cameras, "--run", folder / "run")
        self.report = (folder / "run" / "report.html").as_uri()

    def program(self, name, *arguments):
        done = subprocess.run([self.programs / name, *arguments], capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{name}: {done.stderr}")

    def train(self, output, *more):
        self.program("jade_train", "--config", self.folder / "training.yaml", "--set", f"dataset.path={self.folder / 'data'}",
                     "--output", output, *more)

    def render(self, cameras, *source):
        self.program("jade_render", *source, "--device", "cpu", "--cameras", cameras, "--output",
                     self.folder / Path(cameras).stem)

    def picture(self, path):
        return "data:image/png;base64," + base64.b64encode((self.folder / path).read_bytes()).decode()


def expect(condition, what):
    if not condition:
        raise AssertionError(what)


def expect_like(page, pictures, least, what):
    found = page.evaluate(f"probe.against({json.dumps(pictures)})")
    print(f"{what}: {found:.2f} dB")
    expect(found >= least, f"{what}: expected {least} dB at least, found {found:.2f}")


def choose(page, element, value):
    """Sets a control like a user, and fires its event."""
    page.evaluate(f"""(() => {{ const control = document.getElementById({json.dumps(element)});
        control.value = {json.dumps(value)};
        control.dispatchEvent(new Event('input', {{bubbles: true}}));
        control.dispatchEvent(new Event('change', {{bubbles: true}})); }})()""")


def box(page, element):
    """Left, top, width and height of an element in the window."""
    return page.evaluate(f"""(() => {{ const box = document.getElementById({json.dumps(element)}).getBoundingClientRect();
        return [box.left, box.top, box.width, box.height]; }})()""")


def check_start(page, run):
    expect(page.open(run.report) == "scene", "expected the scene in 3D")
    page.evaluate(PROBE)
    expect(page.evaluate("document.getElementById('left-tag').textContent").startswith("blurry"), "before on the left")
    expect(page.evaluate("document.getElementById('right-tag').textContent") == "scene", "after on the right")
    expect(page.evaluate("document.querySelectorAll('#glance .card').length") == 3, "three headline figures")
    expect(page.evaluate("[...document.querySelectorAll('#tests h3')].map(h => h.textContent.split(':')[0])")
           == ["Seen in training", "Not seen in training"], "seen and unseen views apart")
    page.evaluate("document.getElementById('native').click()")


def check_picture(page):
    """Overlapping draws, as on a slow machine: a picture must show the requested view."""
    choose(page, "camera", "train.1")
    page.wait("document.getElementById('camera').value === 'train.1' && !jade.state.pose")
    found = page.evaluate("""(async () => {
        const {viewer} = jade, camera = jade.camera(), pose = jade.pose(), other = [...pose.slice(0, 11), pose[11] + 0.5];
        const alone = await viewer.picture(camera, pose);
        viewer.draw(camera, other);
        const crowded = viewer.picture(camera, pose);
        viewer.draw(camera, other);
        return await crowded === alone; })()""")
    expect(found, "a picture among other draws is the one of its own view")


def check_fidelity(page, run):
    evaluation = json.loads((run.folder / "run/eval.json").read_text())
    for k, view in enumerate(evaluation["views"]):
        choose(page, "camera", f"test.{k}")
        expect_like(page, [run.picture(f"test/{view['name']}.png")], 35, f"test view {view['name']} against jade_render")
        truth = page.evaluate(f"probe.against([jade.pictures().find(p => p.name === 'truth').src])")
        expect(abs(truth - view["psnr"]) < 1, f"{view['name']}: {truth:.2f} dB to the truth, {view['psnr']:.2f} by jade_render")


def check_exposure(page, run):
    names = sorted(path.stem for path in (run.folder / "exposure").glob("*_0.png"))
    first = names[0].removesuffix("_0")
    choose(page, "camera", "train.0")
    for k in (0, 2, 8):
        choose(page, "moment", k / 8)
        expect_like(page, [run.picture(f"exposure/{first}_{k}.png")], 35, f"moment {k} of 8 against jade_render")
    page.evaluate("document.getElementById('play').click()")
    page.wait("document.getElementById('play').getAttribute('aria-pressed') === 'true'")
    page.wait("document.getElementById('play').getAttribute('aria-pressed') === 'false'")
    page.evaluate("probe.mean = true")
    expect_like(page, [run.picture(f"exposure/{first}_{k}.png") for k in range(9)], 35, "blur that was played against the mean of nine")
    page.evaluate("probe.mean = false")
    expect(page.evaluate("document.getElementById('moment-value').textContent") == "mean of 32", "the mean is named")
    choose(page, "moment", 0.5)
    expect(page.evaluate("document.getElementById('moment').getAttribute('aria-valuetext')") == "50 % of the exposure", "moment in words")
    choose(page, "camera", "test.0")
    page.wait("document.getElementById('moment').disabled")


def check_layers(page, run):
    choose(page, "camera", "test.0")
    page.wait("[...document.getElementById('left-layer').options].some(o => o.value === '|difference|')")
    choose(page, "left-layer", "truth")
    choose(page, "right-layer", "|difference|")
    page.wait("document.getElementById('right').alt === '|difference|' && !document.getElementById('right').hidden")
    expect(page.evaluate("document.getElementById('left').src === jade.pictures().find(p => p.name === 'truth').src"), "truth on the left")
    error = page.evaluate("""(async () => { const [shown, a, b] = await Promise.all(
        [document.getElementById('right').src, ...['render', 'truth'].map(n => jade.layers.sourceOf(n))].map(probe.pixels));
        let worst = 0;
        for (let k = 0; k < a.length; ++k) if (k % 4 < 3) worst = Math.max(worst, Math.abs(shown[k] - Math.min(255, 4 * Math.abs(a[k] - b[k]))));
        return worst; })()""")
    expect(error == 0, f"the difference is four times that of render and truth, {error} off")
    left, top, width, height = box(page, "stage")
    page.drag((left + page.evaluate("jade.layers.wipe") * width, top + height / 2), (left + 0.25 * width, top + height / 2))
    expect(page.evaluate("document.getElementById('bar').getAttribute('aria-valuenow')") == "25", "the wipe follows the pointer")
    expect("75%" in page.evaluate("document.getElementById('left').style.clipPath"), "the left layer ends at the wipe")
    page.evaluate("document.getElementById('bar').focus()")
    page.key("ArrowRight")
    expect(page.evaluate("document.getElementById('bar').getAttribute('aria-valuenow')") == "27", "the wipe follows the arrows")
    page.evaluate("document.getElementById('stage').focus()")
    page.key("x", "KeyX", "x")
    page.wait("jade.layers.left === '|difference|' && jade.layers.right === 'truth'")
    choose(page, "left-layer", "depth")
    page.wait("document.getElementById('left').alt === 'depth' && document.getElementById('left').naturalWidth === 80")
    choose(page, "camera", "train.0")
    page.wait("jade.state.camera === 'train.0' && !document.getElementById('moment').disabled")
    choose(page, "left-layer", "depth")
    page.wait("document.getElementById('left').alt === 'depth'")
    page.evaluate("window.depth = document.getElementById('left').src; 0")
    choose(page, "moment", 0.05)
    page.wait("document.getElementById('left').src !== window.depth")
    choose(page, "moment", 0.5)


def check_events(page):
    choose(page, "camera", "test.0")
    page.wait("document.getElementById('events').disabled && document.getElementById('event-layer').hidden")
    choose(page, "camera", "train.0")
    page.wait("!document.getElementById('events').disabled")
    page.evaluate("document.getElementById('events').click()")
    page.wait("!document.getElementById('event-layer').hidden")
    counts = """(() => { const layer = document.getElementById('event-layer');
        const {data} = layer.getContext('2d').getImageData(0, 0, layer.width, layer.height);
        const of = (test) => data.filter((_, k) => k % 4 === 0 && data[k + 3] > 0 && test(data[k], data[k + 2])).length;
        return {width: layer.width, red: of((r, b) => r > b), blue: of((r, b) => b > r), all: [...data].join()}; })()"""
    shown = []
    for moment in (0.1, 0.5, 0.9):
        choose(page, "moment", moment)
        shown.append(page.evaluate(counts))
    for found in shown:
        expect(found["width"] == 80 and found["red"] > 20 and found["blue"] > 20, f"events of both signs, found {found['red']} and {found['blue']}")
        expect(found["red"] + found["blue"] < 0.9 * 80 * 60, "events of a moment, not of the whole exposure")
    expect(len({found["all"] for found in shown}) == 3, "events follow the slider")
    expect("events=1" in page.evaluate("jade.link()"), "the link remembers the events")
    page.evaluate("document.getElementById('stage').focus()")
    page.key("v", "KeyV", "v")
    page.wait("document.getElementById('event-layer').hidden && !document.getElementById('events').checked")
    choose(page, "moment", 0.5)


def check_moving(page):
    choose(page, "camera", "train.1")
    page.wait("document.getElementById('camera').value === 'train.1' && !jade.state.pose")
    left, top, width, height = box(page, "stage")
    before = page.evaluate("jade.pose()")
    page.drag((left + 0.8 * width, top + 0.5 * height), (left + 0.6 * width, top + 0.6 * height))
    orbited = page.evaluate("jade.pose()")
    expect(max(abs(a - b) for a, b in zip(before, orbited)) > 0.05, "a drag orbits")
    expect(page.evaluate("!document.getElementById('back').hidden && document.getElementById('stage').matches('.away')"), "away from the camera")
    page.call("Input.dispatchMouseEvent", type="mouseWheel", x=left + 50, y=top + 50, deltaX=0, deltaY=-200)
    page.wait(f"Math.abs(jade.pose()[11] - {orbited[11]}) > 1e-3")
    flown = page.evaluate("jade.pose()")
    page.evaluate("document.getElementById('stage').focus()")
    page.call("Input.dispatchKeyEvent", type="keyDown", key="w", code="KeyW")
    page.wait(f"jade.pose()[11] < {flown[11]} - 1e-3")
    page.call("Input.dispatchKeyEvent", type="keyUp", key="w", code="KeyW")
    page.key("r", "KeyR", "r")
    page.wait("!jade.state.pose")
    expect(page.evaluate("jade.pose()") == before, "reset goes back to the camera")
    page.drag((left + 0.8 * width, top + 0.5 * height), (left + 0.6 * width, top + 0.6 * height))
    page.wait("!document.getElementById('back').hidden")
    x, y, wide, high = box(page, "back")
    page.drag((x + wide / 2, y + high / 2), (x + wide / 2, y + high / 2))
    page.wait("!jade.state.pose && document.getElementById('back').hidden")


def check_touch(page):
    """One finger orbits, two pinch to zoom."""
    choose(page, "camera", "train.1")
    page.wait("document.getElementById('camera').value === 'train.1' && !jade.state.pose")
    page.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    left, top, width, height = box(page, "stage")
    middle = top + 0.5 * height

    def touch(kind, *fingers):
        points = [{"x": left + part * width, "y": middle, "id": k} for k, part in enumerate(fingers)]
        page.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
    before = page.evaluate("jade.pose()")
    touch("touchStart", 0.6)
    for part in (0.57, 0.54, 0.5):
        touch("touchMove", part)
    touch("touchEnd")
    page.wait("document.getElementById('stage').matches('.away')")
    orbited = page.evaluate("jade.pose()")
    expect(max(abs(a - b) for a, b in zip(before[:3], orbited[:3])) > 0.02, "a finger turns the camera")
    touch("touchStart", 0.4, 0.6)
    for spread in (0.12, 0.15, 0.2):
        touch("touchMove", 0.5 - spread, 0.5 + spread)
    touch("touchEnd")
    page.wait(f"jade.pose()[11] < {orbited[11]} - 1e-2")
    nearer = page.evaluate("jade.pose()")
    expect(max(abs(a - b) for a, b in zip(nearer[8:11], orbited[8:11])) < 1e-6, "two fingers come nearer and do not turn")
    page.call("Emulation.setTouchEmulationEnabled", enabled=False)
    page.evaluate("document.getElementById('reset').click()")
    page.wait("!jade.state.pose")


def check_saving(page):
    """Tests the content that the buttons copy and save."""
    page.evaluate("""window.saved = {}; const address = URL.createObjectURL;
        URL.createObjectURL = (blob) => { saved.last = blob; return address.call(URL, blob); };
        HTMLAnchorElement.prototype.click = function () { saved[this.download] = saved.last; }; 0""")
    page.evaluate("document.getElementById('path-add').click(); document.getElementById('path-save').click()")
    page.wait("!!saved['path.json']")
    expect(page.evaluate("saved['path.json'].text()") == page.evaluate("jade.pathJson()"), "the path that is saved")
    page.evaluate("document.getElementById('path-clear').click(); document.getElementById('picture').click()")
    page.wait("!!saved['view.png']")
    size = """createImageBitmap(saved['view.png']).then(({width, height}) => {
        const canvas = document.getElementById('scene'); return `${width}x${height} ${canvas.width}x${canvas.height}`; })"""
    found = page.evaluate(size).split()
    expect(found[0] == found[1], f"the picture that is saved has the pixels of the view, found {found}")
    page.evaluate("document.getElementById('link').click()")
    page.wait("/^(Link copied|The address bar holds the link)$/.test(document.getElementById('status').textContent)")
    expect(page.evaluate("location.hash === jade.link()"), "the address is the link")


def check_path(page, run):
    choose(page, "camera", "test.0")
    page.wait("document.getElementById('camera').value === 'test.0'")
    page.evaluate("document.getElementById('stage').focus()")
    page.key("k", "KeyK", "k")
    left, top, width, height = box(page, "stage")
    page.drag((left + 0.8 * width, top + 0.5 * height), (left + 0.7 * width, top + 0.5 * height))
    page.key("k", "KeyK", "k")
    expect(page.evaluate("document.getElementById('path-keys').textContent") == "2 keys", "two keys")
    choose(page, "seconds", "0.2")
    (run.folder / "path.json").write_text(page.evaluate("jade.pathJson()"))
    run.render(str(run.folder / "path.json"), "--ply", run.folder / "run/point_cloud.ply", "--config", run.folder / "run/config.yaml")
    frames = sorted((run.folder / "path").glob("*.png"))
    expect(len(frames) == 7, f"expected a frame per 1/30 s, found {len(frames)}")
    expect_like(page, [run.picture(frames[-1])], 35, "end of a recorded path against jade_render")


def check_link(page, run):
    choose(page, "camera", "train.1")
    page.wait("document.getElementById('camera').value === 'train.1' && !jade.state.pose")
    choose(page, "left-layer", "EDI")
    left, top, width, height = box(page, "stage")
    page.drag((left + 0.8 * width, top + 0.5 * height), (left + 0.7 * width, top + 0.4 * height))
    state = "({...jade.state, left: jade.layers.left, right: jade.layers.right, wipe: jade.layers.wipe})"
    link, before = page.evaluate("jade.link()"), page.evaluate(state)
    page.call("Page.navigate", url="about:blank")
    page.open(run.report + link)
    after = page.evaluate(state)
    error = max(abs(a - b) for a, b in zip(before.pop("pose"), after.pop("pose")))
    expect(error < 1e-6, f"a link restores the pose, {error} off")
    expect(before == after, f"a link restores the view: expected {before}, found {after}")


def expect_named(page):
    unnamed = page.evaluate(f"""{CONTROLS}.filter(c => !(c.getAttribute('aria-label') || c.labels?.length
        || (!c.hasAttribute('tabindex') && /\\p{{L}}/u.test(c.textContent))))
        .map(c => c.outerHTML.slice(0, 80))""")
    expect(unnamed == [], f"controls without a name: {unnamed}")
    expect(page.evaluate("[...document.images].every(image => image.hasAttribute('alt'))"), "every picture has an alt")
    levels = page.evaluate("[...document.querySelectorAll('main h2, main h3, main h4')].map(h => Number(h.tagName[1]))")
    expect(all(after <= before + 1 for before, after in zip([1, *levels], levels)), f"headings skip a level: {levels}")


def check_access(page):
    expect_named(page)
    page.evaluate("document.getElementById('stage').focus()")
    choose(page, "camera", "train.0")
    choose(page, "moment", 0.5)
    page.key(".", "Period", ".")
    page.wait("document.getElementById('moment').value === '0.56'")
    page.key(",", "Comma", ",")
    page.wait("document.getElementById('moment').value === '0.5'")
    page.key("?", "Slash", "?")
    expect(page.evaluate("document.getElementById('keys').open"), "? shows the keys")
    page.key("Escape")
    page.resize(360, 740, mobile=True)
    page.wait("document.documentElement.scrollWidth <= 360", 5)
    cut = page.evaluate("""[...document.querySelectorAll('.controls *')].filter(c => c.getBoundingClientRect().right > innerWidth)
        .map(c => c.outerHTML.slice(0, 60))""")
    expect(cut == [], f"controls beyond the edge of a phone: {cut}")
    page.evaluate("document.querySelectorAll('details.part').forEach(part => { part.open = true; })")
    lines = page.evaluate("""[...document.querySelectorAll('#scores thead th')].filter(th => !th.textContent.includes(' ')).map(th => {
        const range = document.createRange(); range.selectNodeContents(th); return [th.textContent, range.getClientRects().length]; })""")
    expect(lines and all(count <= 1 for _, count in lines), f"words of a table's head stay whole on a phone, found {lines}")
    page.evaluate("document.querySelectorAll('details.part').forEach(part => { part.open = false; })")
    marks = page.evaluate("""[...document.querySelectorAll('.part > summary')].filter(summary => !summary.parentElement.hidden)
        .map(summary => summary.getBoundingClientRect().height / parseFloat(getComputedStyle(summary.firstElementChild).fontSize))""")
    expect(all(height < 3.4 for height in marks), f"a heading on the line of its mark, found {marks}")


CURVES = ["loss", "psnr_train", "test_psnr", "gaussians", "position_lr", "memory_bytes"]


def edited(run, name, **changes):
    """Writes a report of the same run with changed data."""
    page = (run.folder / "run/report.html").read_text()
    before, rest = page.split('id="data">', 1)
    text, after = rest.split("</script>", 1)
    data = json.dumps({**json.loads(text), **changes}).replace("<", "\\u003c")
    path = run.folder / "run" / f"{name}.html"
    path.write_text(f'{before}id="data">{data}</script>{after}')
    return path.as_uri()


def reopen(page, report):
    page.open("about:blank", "true")
    page.open(report)


def check_layout(page, run):
    """Tests the layout, in a window and on a phone, light and dark."""
    report = edited(run, "curves", metrics=[{"step": step, **{key: 1e6 * step for key in CURVES}} for step in (1, 2, 3)])
    for dark in (False, True):
        page.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])
        for width, height, mobile in ((1280, 900, False), (390, 844, True)):
            page.resize(width, height, mobile=mobile)
            reopen(page, report)
            check_rows(page, width, mobile)
            check_charts(page, mobile)
            expect_contrast(page, f"{width} px, {'dark' if dark else 'light'}")
    page.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
    page.resize(1280, 900)
    reopen(page, run.report)
    check_motion(page)
    for width in (1180, 1280, 1440, 1600, 1920):
        page.resize(width, 900)
        slider, controls = box(page, "moment")[2], page.evaluate("document.querySelector('.controls').offsetWidth")
        expect(slider > 0.55 * controls, f"a wide slider at {width} px, found {slider} of {controls} px")
    page.resize(1280, 900)
    check_place(page)
    check_brightness(page)
    check_cases(page, run)


def check_motion(page):
    """The hint to drag fades by itself, and at once where motion is not wanted."""
    hint = "document.getElementById('hint')"
    expect(page.evaluate(f"getComputedStyle({hint}).animationDuration") == "0.001s", "the hint does not move where motion is not wanted")
    expect(page.evaluate("getComputedStyle(document.documentElement).scrollBehavior") == "auto", "nor does the page")
    page.call("Emulation.setEmulatedMedia", features=[])
    expect(page.evaluate(f"getComputedStyle({hint}).animationDuration") == "1s", "the hint fades")
    page.evaluate(f"{hint}.getAnimations()[0].finish()")
    expect(page.evaluate(f"getComputedStyle({hint}).opacity") == "0", "the hint has faded")


def check_cases(page, run):
    """A scene that is worse than its frames; a run without test views or an allocation."""
    reopen(page, edited(run, "worse", headline={"views": 1, "blurry": 30, "edi": 31, "efnet": 32.5, "render": 29}))
    cards = page.evaluate("[...document.querySelectorAll('#glance .card')].map(card => [card.className, card.firstChild.textContent])")
    expect(cards == [["card", "blurry frame"], ["card best", "best 2D restoration (EFNet)"], ["card worse", "this scene"]], f"three cards, found {cards}")
    colours = page.evaluate("['best', 'worse'].map(kind => getComputedStyle(document.querySelector(`.card.${kind}`)).outlineColor)")
    expect(colours == ["rgb(8, 112, 78)", "rgb(178, 106, 0)"], f"green for the best and amber for the scene, found {colours}")
    expect(page.evaluate("document.getElementById('verdict').textContent").startswith("1.0 dB below"), "a verdict that says so")
    facts = page.evaluate("[document.getElementById('title').textContent, document.title, document.getElementById('facts').textContent]")
    expect(facts[:2] == ["data", "data"] and re.match(r"\d{4}-\d\d-\d\d · 3 exposures", facts[2]), f"name and date, found {facts}")
    parts = "[...document.querySelectorAll('details.part')].filter(part => !part.hidden).map(part => part.querySelector('h2').textContent)"
    expect("Allocation" in page.evaluate(parts), "the allocation of a run that has one")
    reopen(page, edited(run, "bare", headline=None, evaluation=None, tests=[], allocation={"views": []}, metrics=[]))
    found = page.evaluate(parts)
    expect(found == ["Sharp views from blurry frames", "Settings"], f"no empty parts, found {found}")
    expect(page.evaluate("document.getElementById('verdict').hidden"), "no verdict without a truth")
    reopen(page, edited(run, "short", metrics=[{"step": 1, "loss": 1}, {"step": 2, "loss": 2}]))
    wide = page.evaluate("document.querySelector('#charts svg').getBoundingClientRect().width")
    expect(250 < wide < 450, f"one curve is no larger than one of four, found {wide} px")


def check_rows(page, width, mobile):
    slider = box(page, "moment")[2]
    expect(slider > (0.6 if mobile else 0.4) * width, f"the exposure's slider has a row of its own, found {slider} of {width} px")
    expect(page.evaluate("document.querySelector('label.grow').getClientRects().length === 1 && document.querySelector('label.grow').offsetHeight < 40"), "its label stays whole")
    events = page.evaluate("(box => [box.offsetHeight, box.scrollWidth - box.clientWidth])(document.getElementById('events').parentElement)")
    expect(events[0] < 40 and events[1] <= 0, f"the word beside its box, found {events}")
    words = page.evaluate("['play', 'more'].map(id => document.getElementById(id).textContent)")
    expect("Play exposure" in words[0] and words[1].startswith("Export"), f"words on the controls, found {words}")
    handle = page.evaluate("(style => [style.width, style.content])(getComputedStyle(document.getElementById('bar'), '::before'))")
    expect(handle[0] == "32px", f"the wipe has a handle, found {handle}")
    parts = page.evaluate("[...document.querySelectorAll('details.part')].filter(part => !part.hidden).map(part => part.open)")
    expect(parts.count(True) == (0 if mobile else len(parts) - 1), f"a phone folds all parts, a window all but the settings, found {parts}")
    page.evaluate("document.querySelectorAll('details.part').forEach(part => { part.open = true; })")
    columns = page.evaluate("getComputedStyle(document.getElementById('tests')).gridTemplateColumns.split(' ').length")
    expect(columns == (1 if mobile else 3), f"test views in a grid, found {columns} columns")
    strip = page.evaluate("""(strip => [new Set([...strip.children].map(each => each.offsetTop)).size, strip.lastChild.getBoundingClientRect().right,
        strip.getBoundingClientRect().right])(document.querySelector('#views .strip'))""")
    expect(mobile or (strip[0] == 1 and strip[2] - strip[1] < 2), f"the pictures of a view side by side, over the whole width, found {strip}")
    expect(page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "nothing beyond the edge")
    best = page.evaluate("[...document.querySelectorAll('#glance .best')].length")
    expect(best <= 1, f"one figure in green at most, found {best}")
    values = page.evaluate("[...document.querySelectorAll('#glance dd:not(.note)')].map(each => each.textContent)")
    expect(len(set(values)) == len(values), f"no figure twice, found {values}")


def check_charts(page, mobile):
    """Four curves in one row with letters of a readable size; the others folded."""
    names = "[...document.querySelectorAll('#%s text:first-of-type')].map(text => text.textContent)"
    expect(page.evaluate(names % "charts") == ["loss", "re-blur PSNR, dB", "test PSNR, dB", "Gaussians"], "four curves come first")
    expect(page.evaluate(names % "other-charts") == ["position_lr", "memory_bytes"] and page.evaluate("!document.getElementById('more-charts').open"),
           "the other curves are folded")
    tops = page.evaluate("new Set([...document.querySelectorAll('#charts svg')].map(svg => svg.getBoundingClientRect().top)).size")
    expect(tops == (4 if mobile else 1), f"four curves in a row, or below each other on a phone, found {tops} rows")
    letters = page.evaluate("[...document.querySelectorAll('#charts svg')].map(svg => 12 * svg.getBoundingClientRect().width / svg.viewBox.baseVal.width)")
    expect(all(11 < size < 18 for size in letters), f"letters of a readable size, found {letters} px")
    cut = page.evaluate("""[...document.querySelectorAll('#charts text')].filter(text => { const [box, frame] = [text, text.ownerSVGElement].map(each => each.getBoundingClientRect());
        return box.left < frame.left || box.right > frame.right; }).map(text => text.textContent)""")
    expect(cut == [], f"labels inside their chart, found {cut}")


def expect_contrast(page, where):
    worst = page.evaluate("""(() => {
        const parse = (text) => text.match(/[\\d.]+/g).map(Number);
        const light = (rgb) => { const [r, g, b] = rgb.map((v) => { const x = v / 255; return x <= 0.03928 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4; });
            return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
        const under = (each) => { // backgrounds from the page up, laid over each other
            const above = each.parentElement ? under(each.parentElement) : matchMedia('(prefers-color-scheme: dark)').matches ? [18, 18, 18] : [255, 255, 255];
            const [r, g, b, a = 1] = parse(getComputedStyle(each).backgroundColor);
            return [r, g, b].map((value, k) => a * value + (1 - a) * above[k]); };
        const shown = [...document.querySelectorAll('h1, h2, h3, h4, p, li, dt, dd, td, th, a, .chip, .thumb span, .none span, .controls button, .charts text')]
            .filter(each => each.textContent.trim() && each.getClientRects().length > 0 && !each.disabled);
        return shown.map((each) => {
            const style = getComputedStyle(each);
            const [a, b] = [parse(each.tagName === 'text' ? style.fill : style.color), under(each)].map(light).sort((x, y) => y - x);
            return [(a + 0.05) / (b + 0.05), each.outerHTML.slice(0, 80)];
        }).sort((x, y) => x[0] - y[0])[0]; })()""")
    expect(worst[0] >= 4.5, f"text that can be read at {where}, found a contrast of {worst[0]:.2f}: {worst[1]}")


def check_place(page):
    """Away from the cameras: their frusta, then a shade where the scene is not reconstructed, and a way back."""
    away = "['frusta', 'shade', 'back'].map(id => !document.getElementById(id).hidden)"
    choose(page, "camera", "train.0")
    page.wait("jade.state.camera === 'train.0' && !jade.state.pose")
    expect(page.evaluate(away) == [False, False, False], "nothing over the scene at a camera")
    left, top, width, height = box(page, "stage")
    page.drag((left + 0.7 * width, top + 0.5 * height), (left + 0.68 * width, top + 0.5 * height))
    page.wait("jade.state.pose !== null")
    lines = """(canvas => canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some(value => value > 0))(document.getElementById('frusta'))"""
    expect(page.evaluate(lines), "lines of the recorded cameras")
    expect(page.evaluate(away) == [True, False, True], f"frusta near the cameras, found {page.evaluate(away)}")
    page.evaluate("document.getElementById('stage').focus()")
    page.key("r", "KeyR", "r")
    page.wait("!jade.state.pose")
    page.drag((left + 0.7 * width, top + 0.5 * height), (left + 0.7 * width - 120, top + 0.5 * height))
    page.wait("!document.getElementById('shade').hidden")
    dark = float(page.evaluate("getComputedStyle(document.getElementById('shade')).backgroundColor").strip("rgba()").split(",")[3])
    expect(dark > 0.5, f"120 px from a camera the scene is dimmed, found {dark}")
    page.evaluate("document.getElementById('back').click()")
    page.wait("!jade.state.pose")
    expect(page.evaluate(away) == [False, False, False], "back at the camera")


def check_brightness(page):
    """Brightness affects only the display of photographs: pictures keep their bytes, maps their look."""
    source = page.evaluate("document.getElementById('left').src")
    choose(page, "brightness", 2)
    for what in ("#scene", "#stage img.layer", ".thumb img"):
        found = page.evaluate(f"getComputedStyle(document.querySelector({json.dumps(what)})).filter")
        expect(found == "brightness(2)", f"{what} is shown twice as bright, found {found}")
    maps = page.evaluate("[...document.querySelectorAll('.thumb')].filter(each => /^(α|event density)$/.test(each.textContent)).map(each => getComputedStyle(each.firstChild).filter)")
    expect(len(maps) == 6 and set(maps) == {"none"}, f"maps as they are, found {maps}")
    expect(page.evaluate("document.getElementById('brightness-value').textContent") == "2×", "the factor beside its slider")
    expect(page.evaluate("document.getElementById('left').src") == source, "the picture itself is the same")
    choose(page, "right-layer", "α")
    page.wait("document.getElementById('right').alt === 'α'")
    expect(page.evaluate("getComputedStyle(document.getElementById('right')).filter") == "none", "a map over the scene as it is")
    choose(page, "brightness", 1)


def check_page(run):
    with chromium.Chromium() as page:
        check_start(page, run)
        check_picture(page)
        check_fidelity(page, run)
        check_exposure(page, run)
        check_layers(page, run)
        check_events(page)
        check_moving(page)
        check_touch(page)
        check_saving(page)
        check_path(page, run)
        check_link(page, run)
        check_access(page)
        check_layout(page, run)
        expect(page.errors == [], f"the page complains: {page.errors}")
        foreign = [url[:80] for url in page.requests if not url.startswith(((run.folder / "run").as_uri(), "data:", "blob:", "about:"))]
        expect(foreign == [], f"the page asks elsewhere: {foreign}")


def check_without_webgl(run):
    with chromium.Chromium(flags=["--disable-3d-apis"]) as page:
        expect(page.open(run.report) == "still", "expected a still picture without WebGL2")
        expect(page.evaluate("document.getElementById('notice').textContent").startswith("A still picture"), "it says so")
        expect(page.evaluate("document.getElementById('right').alt") == "render", "the render in its place")
        expect(page.evaluate("document.getElementById('more').hidden && document.getElementById('play').disabled"), "no idle controls")
        expect(page.errors == [], f"the page complains: {page.errors}")


def sweep_of(run):
    """A sweep of two trained rows, one without a picture, and one that has not started."""
    folder = run.folder / "sweep"
    rows = ["{name: edi, title: \"EDI & more\", set: [objective.target=edi]}", "{name: none, title: None, set: [objective.target=none]}"]
    for number, more in enumerate(([], ["{name: later, title: Later}"])):
        (run.folder / "sweep.yaml").write_text("title: Two rows\ncolumns: [psnr, psnr_seen, psnr_unseen]\nscenes: [{name: desk, config: training.yaml, "
                                               f"set: [dataset.path={run.folder / 'data'}]}}]\nrows: [" + ", ".join(rows + more) + "]\n")
        run.program("jade_sweep", "--sweep", run.folder / "sweep.yaml", "--output", folder, "--device", "cpu", "--quiet", *["--table"][:number])
        if not more:
            gone = sorted((folder / "runs/none/desk/0/images").glob("test_*.png"))[0]
            gone.unlink()
    return folder


def check_sweep(run):
    folder = sweep_of(run)
    views = json.loads((folder / "runs/edi/desk/0/eval.json").read_text())["views"]
    with chromium.Chromium() as page:
        expect(page.open((folder / "index.html").as_uri()) == "sweep", "expected the sweep's page")
        expect(page.evaluate("document.querySelector('#glance dd').textContent") == "2 of 3 runs", "how it stands")
        expect(page.evaluate("[...document.querySelectorAll('#runs .chip')].map(c => c.textContent)") == ["0 ✓", "0 ✓", "0 ·"], "a mark per run")
        report = page.evaluate("document.querySelector('#runs a').href")
        expect(report == (folder / "runs/edi/desk/0/report.html").as_uri(), f"a link to the report, found {report}")
        heads = page.evaluate("[...document.querySelectorAll('#pictures h4')].map(h => h.textContent)")
        expect(heads == ["Seen in training", "Not seen in training"], f"seen and unseen apart, found {heads}")
        names = page.evaluate("[...document.querySelectorAll('.figures')].map(f => [...f.querySelectorAll('.name')].map(n => n.textContent))")
        expect(names == [["truth", "EDI & more", "None", "Later"]] * 2, f"every row in the table's order, found {names}")
        words = page.evaluate("[...document.querySelectorAll('.figures .none')].map(f => f.textContent)")
        expect(len(words) == 3 and sum("no picture" in word for word in words) == 1 and words[-1] == "Laternew", f"gaps are told, found {words}")
        page.evaluate("document.querySelectorAll('.figures img').forEach(image => { image.loading = 'eager'; })")
        page.wait("[...document.querySelectorAll('.figures img')].every(image => image.naturalWidth === 80)")
        shown = page.evaluate("document.querySelector('.figures .thumb:nth-child(2) .note').textContent")
        expect(shown == f"{next(view for view in views if view['seen'])['psnr']:.2f} dB", f"PSNR of the view, found {shown}")
        page.evaluate("document.querySelector('.figures .thumb:nth-child(2)').click()")
        page.wait("document.getElementById('compare').open && document.getElementById('right').naturalWidth === 80")
        page.wait("document.getElementById('left-tag').textContent === 'truth'")
        expect(page.evaluate("document.getElementById('right-tag').textContent") == f"EDI & more {shown}", "the row on the right")
        left, top, width, height = box(page, "stage")
        page.drag((left + width / 2, top + height / 2), (left + 0.25 * width, top + height / 2))
        expect(page.evaluate("document.getElementById('bar').getAttribute('aria-valuenow')") == "25", "the wipe follows the pointer")
        title = page.evaluate("document.getElementById('compare-title').textContent")
        page.key("]", "BracketRight", "]")
        page.wait(f"document.getElementById('compare-title').textContent !== {json.dumps(title)}")
        page.key("x", "KeyX", "x")
        page.wait("document.getElementById('right-tag').textContent === 'truth'")
        page.evaluate("document.querySelector('#compare .head button').click()")
        page.wait("!document.getElementById('compare').open")
        expect_named(page)
        page.resize(360, 740, mobile=True)
        page.wait("document.documentElement.scrollWidth <= 360", 5)
        expect_leads(page)
        expect(page.errors == [], f"the page complains: {page.errors}")


def expect_leads(page):
    """With one seed, a result is marked as the best only if it leads by more than 0.3 dB, in the table and among the
    cards.
    """
    for column in (2, 3, 4):
        cells = page.evaluate(f"[...document.querySelectorAll('#first-table tbody td:nth-child({column})')].map(c => [c.textContent, c.className])")
        values = sorted((float(text), name) for text, name in cells if name != "gap" and text[:1].isdigit())
        expect(len(values) == 2, f"two rows with scores, found {cells}")
        leads = values[1][0] - values[0][0] > 0.3
        expect((values[1][1] == "best") == leads and values[0][1] != "best", f"best only with a lead, found {values}")
        card = page.evaluate(f"document.querySelectorAll('#glance .card')[{column - 1}].textContent")
        expect(("level with" in card) != leads, f"a card that says so, found {card}")


def main():
    if not chromium.find():
        print("SKIPPED: needs Chromium: scripts/setup.sh --browser")
        return 77
    with tempfile.TemporaryDirectory() as folder:
        run = Run(Path(sys.argv[1]), Path(folder))
        check_page(run)
        check_without_webgl(run)
        check_sweep(run)
    print("the page does what it says")
    return 0


if __name__ == "__main__":
    sys.exit(main())
