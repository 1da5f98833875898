// SPDX-License-Identifier: Apache-2.0
// The page: connects the scene, its controls and the report. Scripts have the same functions through
// `window.jade`.

import { CameraPath } from './path.js';
import { Controls } from './controls.js';
import { EventFilm } from './events.js';
import { Layers, SCENE } from './layers.js';
import { Viewer } from './viewer.js';
import { formatLink, parseLink } from './link.js';
import { add, axis, poseInExposure, unit } from './pose.js';
import { gunzipBase64, parseSpz } from './spz.js';
import { shortcut, takesSpace } from './elements.js';
import { drawFrusta, outsideness, shadeOf } from './frusta.js';
import { writeReport } from './report.js';
import { LivePage } from './live.js';

const DEPTH = 'depth';
const PLAY_MOMENTS = 32;
const element = (id) => document.getElementById(id);

class Page {
  constructor(data) {
    this.data = data;
    this.cameras = new Map();
    for (const kind of ['train', 'test']) {
      data.scene.cameras[kind].forEach((camera, k) => this.cameras.set(`${kind}.${k}`, camera));
    }
    this.first = data.views[0]?.camera ?? data.tests[0]?.camera ?? this.cameras.keys().next().value;
    this.state = { camera: this.first, pose: null, moment: 0.5, events: false };
    this.films = new Map();
    this.path = new CameraPath();
    this.layers = new Layers({
      left: element('left'), right: element('right'), bar: element('bar'), leftTag: element('left-tag'), rightTag: element('right-tag'),
      leftSelect: element('left-layer'), rightSelect: element('right-layer'),
    }, () => this.writeLink());
    this.layers.live = (name) => (name === DEPTH ? this.picture({ depthMode: true }) : null);
  }

  async start() {
    this.listCameras();
    this.listen();
    this.setBrightness(this.data.scene.brightness ?? 1);
    if (!this.live) await this.showStill();
    try {
      this.viewer = this.live ? this.live.openViewer(element('scene')) : await this.openViewer();
      this.viewer.onFrame = () => this.writeFrame();
      element('scene').addEventListener('webglcontextlost', () => this.lose());
      this.down = unit([...this.cameras.values()].map((camera) => axis(camera.poses[0], 1)).reduce((a, b) => add(a, b)));
      this.controls = new Controls(element('stage'), this);
    } catch (problem) {
      element('notice').textContent = `A still picture: ${problem.message}.`;
      element('notice').hidden = false;
      element('stage').classList.add('still');
      element('more').hidden = element('reset').hidden = true;
    }
    await this.restore(parseLink(location.hash));
    document.documentElement.dataset.ready = this.viewer ? 'scene' : 'still';
  }

  /** The browser lost the WebGL context: show pictures instead. */
  lose() {
    if (!this.viewer) return null;
    this.viewer.onFrame = () => {};
    this.viewer = null;
    element('notice').textContent = 'A still picture: the browser has taken the graphics card away. Load the page again to go on.';
    element('notice').hidden = false;
    element('stage').classList.add('still');
    element('more').hidden = element('reset').hidden = true;
    return this.jump(this.state.camera);
  }

  /** Shows the report's pictures until the scene is unpacked. */
  async showStill() {
    const wanted = parseLink(location.hash).camera;
    this.state.camera = this.cameras.has(wanted) ? wanted : this.first;
    this.shapeStage();
    Object.assign(this.layers, { left: this.pictures()[0]?.name, right: 'render' });
    if (this.pictures().length > 0) await this.layers.setPictures(this.pictures(), []);
  }

  shapeStage() {
    const { width, height } = this.camera();
    element('stage').style.setProperty('--aspect', `${width} / ${height}`);
    element('stage').style.setProperty('--ratio', width / height);
  }

  async openViewer() {
    const packed = element('spz').textContent;
    if (!packed) throw new Error('this page holds no scene');
    const scene = parseSpz(await gunzipBase64(packed));
    return new Viewer(element('scene'), scene, this.data.scene);
  }

  // --- host interface of the controls

  pose() {
    return this.state.pose ?? poseInExposure(this.camera().poses, this.camera().poses.length > 1 ? this.state.moment : 0);
  }

  reach() {
    return this.distance;
  }

  /** Width of the picture at distance 1. */
  pixel() {
    return this.camera().width / this.camera().fx;
  }

  move(pose, distance = this.distance) {
    if (!this.viewer) return; // pictures have no camera to move
    this.stop();
    this.distance = distance;
    this.state.pose = pose;
    this.refresh();
  }

  // --- cameras

  camera() {
    return this.cameras.get(this.state.camera);
  }

  view() {
    return [...this.data.views, ...this.data.tests].find((view) => view.camera === this.state.camera);
  }

  /** The data set's camera at the current pose, with its true images, or ''. */
  standsAt() {
    const { camera, pose, moment } = this.state;
    return !pose && (moment === 0.5 || this.camera().poses.length === 1) ? camera : '';
  }

  pictures() {
    return this.view()?.pictures ?? [];
  }

  /** Moves the viewer to a camera of the data set; resolves when it is drawn. */
  async jump(id, layers = {}) {
    this.stop();
    Object.assign(this.state, { camera: id, pose: null });
    element('camera').value = id;
    const camera = this.camera();
    this.shapeStage();
    const exposure = camera.poses.length > 1;
    element('play').disabled = !exposure || !this.viewer;
    element('events').disabled = !this.view()?.events;
    element('moment').disabled = !exposure || (!this.viewer && element('events').disabled);
    await Promise.all([this.loadFilm(), this.live?.moveCamera(id)]);
    if (this.state.camera !== id) return;
    if (this.viewer) this.distance = this.viewer.depthAhead(camera, this.pose());
    await this.draw();
    if (this.state.camera !== id) return;
    Object.assign(this.layers, layers);
    await this.layers.setPictures(this.pictures(), this.viewer ? [SCENE, DEPTH] : []);
    await this.draw();
  }

  step(by) {
    const ids = [...this.cameras.keys()];
    const next = (ids.indexOf(this.state.camera) + by + ids.length) % ids.length;
    return this.jump(ids[next]);
  }

  reset() {
    return this.jump(this.state.camera);
  }

  async setMoment(wanted) {
    const moment = Math.min(1, Math.max(0, wanted));
    this.stop();
    Object.assign(this.state, { moment, pose: null });
    element('moment').value = moment;
    await this.draw();
    if (this.state.moment === moment) await this.layers.again([DEPTH]);
  }

  /** Moves a sixteenth of the exposure earlier or later. */
  nudge(by) {
    if (!element('moment').disabled) this.setMoment(this.state.moment + by / 16);
  }

  // --- events around the slider's moment

  async loadFilm() {
    const { camera, events } = this.state;
    const entry = this.view()?.events;
    if (!events || !entry || this.films.has(camera)) return;
    try {
      this.films.set(camera, await EventFilm.unpack(entry));
    } catch (problem) {
      this.say(`No events here: ${problem.message}`);
    }
  }

  /** Shows or hides events; resolves when done. */
  async showEvents(on) {
    this.state.events = on;
    element('events').checked = on;
    await this.loadFilm();
    this.writeMoment();
    this.writeLink();
  }

  paintEvents() {
    const film = this.state.events && this.view()?.events ? this.films.get(this.state.camera) : null;
    element('event-layer').hidden = !film;
    if (film) film.paint(element('event-layer'), this.state.moment, this.camera());
  }

  // --- drawing

  /** Schedules a frame while the camera moves. */
  refresh() {
    this.writeMoment();
    if (this.viewer) this.viewer.request(this.camera(), this.pose());
    this.writePlace();
    this.writeLink();
  }

  /**
   * Marks a view away from the cameras: shows their frusta, and a shade where the scene is not reconstructed.
   */
  writePlace() {
    const away = this.state.pose !== null;
    element('stage').classList.toggle('away', away);
    element('back').hidden = !away;
    element('frusta').hidden = element('shade').hidden = !away;
    if (!away) return;
    element('hint').classList.add('gone');
    const cameras = [...this.cameras].filter(([id]) => id.startsWith('train.')).map(([, camera]) => camera);
    const recorded = [...this.cameras.values()].flatMap((camera) => camera.poses);
    drawFrusta(element('frusta'), this.camera(), this.pose(), cameras, this.distance);
    const dark = shadeOf(outsideness(this.pose(), recorded, this.distance));
    element('shade').hidden = dark === 0;
    element('shade').style.background = `rgb(0 0 0 / ${dark})`;
  }

  /** Brightness of the display: 1 shows unchanged values. */
  setBrightness(value) {
    element('brightness').value = value;
    element('brightness-value').textContent = `${value}×`;
    document.documentElement.style.setProperty('--brightness', value);
  }

  /** Draws the current view; resolves when it is shown. */
  async draw() {
    this.writeMoment();
    this.writePlace();
    if (this.viewer) await this.viewer.draw(this.camera(), this.pose());
    this.writeLink();
  }

  /** A PNG of the current view, or null if unavailable; the canvas then shows the current view again. */
  async picture(options) {
    const picture = await this.viewer.picture(this.camera(), this.pose(), options);
    await this.viewer.draw(this.camera(), this.pose());
    return picture;
  }

  /** Accumulates the blur: the mean of the renders so far over the exposure. Resolves at its end. */
  async play() {
    if (this.playing) return this.stop();
    const run = {};
    this.playing = run;
    Object.assign(this.state, { pose: null });
    element('play').setAttribute('aria-pressed', 'true');
    await this.layers.choose(this.layers.left === 'blurry' ? 'blurry' : SCENE, SCENE);
    for (let n = 1; n <= PLAY_MOMENTS && this.playing === run; ++n) {
      this.state.moment = (n - 0.5) / PLAY_MOMENTS;
      element('moment').value = this.state.moment;
      this.writeMoment(`mean of ${n}`);
      await this.viewer.draw(this.camera(), this.pose(), { part: n });
      await new Promise((resolve) => { setTimeout(resolve, 50); });
    }
    // Another animation may have started.
    if (this.playing === run) this.stop();
  }

  stop() {
    this.playing = null;
    element('play').setAttribute('aria-pressed', 'false');
  }

  // --- the camera path

  addKey() {
    this.path.add(this.camera(), this.pose());
    this.writePath();
  }

  clearPath() {
    this.path.clear();
    this.writePath();
  }

  seconds() {
    return Math.max(0.1, Number(element('seconds').value) || 2);
  }

  pathJson() {
    return this.path.json(this.seconds(), 30);
  }

  async playPath() {
    const run = {};
    this.stop();
    this.playing = run;
    const length = 1000 * this.seconds() * (this.path.keys.length - 1);
    const start = performance.now();
    for (let now = start; this.playing === run && now <= start + length; now = await new Promise(requestAnimationFrame)) {
      this.state.pose = this.path.at((now - start) / length);
      this.refresh();
    }
    if (this.playing === run) this.stop();
  }

  writePath() {
    const keys = this.path.keys.length;
    element('path-keys').textContent = keys === 1 ? '1 key' : `${keys} keys`;
    for (const id of ['path-play', 'path-save', 'path-clear']) element(id).disabled = keys === 0;
    element('path-play').disabled = keys < 2;
  }

  // --- words

  writeMoment(text) {
    const exposure = this.camera().poses.length > 1;
    const percent = `${Math.round(100 * this.state.moment)} %`;
    element('moment-value').textContent = exposure ? text ?? percent : '-';
    element('moment').setAttribute('aria-valuetext', exposure ? `${percent} of the exposure` : 'no exposure');
    this.paintEvents();
  }

  writeFrame() {
    if (this.live) {
      element('hud').textContent = this.live.label();
      return;
    }
    const { pace, renderer } = this.viewer;
    const rate = pace.mean ? `${Math.round(1000 / pace.mean)} FPS · ` : '';
    element('hud').textContent = `${rate}${this.viewer.scene.count.toLocaleString('en')} Gaussians · ${renderer.canvas.width}×${renderer.canvas.height}`;
  }

  say(text) {
    element('status').textContent = text;
  }

  // --- links

  link() {
    const { left, right, wipe } = this.layers;
    return formatLink({ ...this.state, left, right, wipe });
  }

  writeLink() {
    if (!this.restored) return;
    clearTimeout(this.linkTimer);
    this.linkTimer = setTimeout(() => history.replaceState(null, '', this.link()), 200);
  }

  async restore(wanted) {
    this.restored = false;
    const layers = {
      left: wanted.left ?? (this.pictures()[0] ? this.pictures()[0].name : SCENE),
      right: wanted.right ?? (this.viewer ? SCENE : 'render'),
      wipe: wanted.wipe ?? 0.5,
    };
    this.state.moment = wanted.moment ?? 0.5;
    element('events').checked = this.state.events = wanted.events ?? false;
    element('moment').value = this.state.moment;
    await this.jump(this.cameras.has(wanted.camera) ? wanted.camera : this.first, layers);
    this.restored = true;
    if (wanted.pose && this.viewer) {
      this.state.pose = wanted.pose;
      await this.draw();
    }
  }

  async copyLink() {
    history.replaceState(null, '', this.link());
    try {
      await navigator.clipboard.writeText(location.href);
      this.say('Link copied');
    } catch {
      this.say('The address bar holds the link');
    }
  }

  // --- the page's elements

  listCameras() {
    const select = element('camera');
    for (const [kind, label] of [['train', 'exposures'], ['test', 'test views']]) {
      const group = select.appendChild(Object.assign(document.createElement('optgroup'), { label }));
      this.data.scene.cameras[kind].forEach(({ name, seen }, k) => {
        const mark = { true: ', seen', false: ', unseen' }[seen] ?? '';
        const pictured = [...this.data.views, ...this.data.tests].some((view) => view.camera === `${kind}.${k}`);
        group.append(new Option(`${name}${mark}${pictured && kind === 'train' ? ' ▣' : ''}`, `${kind}.${k}`));
      });
    }
  }

  listen() {
    const on = (id, event, call) => element(id).addEventListener(event, call);
    on('camera', 'change', () => this.jump(element('camera').value));
    on('previous', 'click', () => this.step(-1));
    on('next', 'click', () => this.step(1));
    on('back', 'click', () => this.reset());
    on('reset', 'click', () => this.reset());
    on('moment', 'input', () => this.setMoment(Number(element('moment').value)));
    on('play', 'click', () => this.play());
    on('events', 'change', () => this.showEvents(element('events').checked));
    on('brightness', 'input', () => this.setBrightness(Number(element('brightness').value)));
    on('swap', 'click', () => this.layers.swap());
    on('link', 'click', () => this.copyLink());
    on('picture', 'click', () => this.savePicture());
    on('help', 'click', () => element('keys').showModal());
    on('native', 'change', () => {
      this.viewer.native = element('native').checked;
      element('stage').classList.toggle('native', this.viewer.native);
      this.draw();
    });
    on('path-add', 'click', () => this.addKey());
    on('path-clear', 'click', () => this.clearPath());
    on('path-play', 'click', () => this.playPath());
    on('path-save', 'click', () => save('path.json', new Blob([this.pathJson()], { type: 'application/json' })));
    document.addEventListener('keydown', (event) => this.key(event));
    window.addEventListener('hashchange', () => this.restore(parseLink(location.hash)));
    window.addEventListener('resize', () => this.viewer && !this.playing && this.refresh());
    this.writePath();
  }

  key(event) {
    const scene = {
      r: () => this.reset(), ' ': () => !element('play').disabled && this.play(), k: () => this.addKey(), p: () => this.savePicture(),
    };
    const keys = {
      '?': () => element('keys').showModal(), '[': () => this.step(-1), ']': () => this.step(1), x: () => this.layers.swap(),
      ',': () => this.nudge(-1), '.': () => this.nudge(1),
      l: () => this.copyLink(), v: () => !element('events').disabled && this.showEvents(!this.state.events), ...(this.viewer ? scene : {}),
    };
    if (event.key === ' ' && takesSpace(event.target)) return;
    const call = keys[shortcut(event)];
    if (!call || element('keys').open) return;
    event.preventDefault();
    call();
  }

  async savePicture() {
    const picture = await this.picture();
    if (picture) save('view.png', pictureBlob(picture));
    else this.say('No picture was saved: none of this view came; once more, please');
  }

  async pick(view, name) {
    await this.jump(view.camera);
    const other = this.viewer ? SCENE : 'render';
    await this.layers.choose(name, other);
    element('see').scrollIntoView();
  }
}

/** A data URL's bytes, without a request. */
function pictureBlob(source) {
  const bytes = Uint8Array.from(atob(source.slice(source.indexOf(',') + 1)), (letter) => letter.charCodeAt(0));
  return new Blob([bytes], { type: 'image/png' });
}

function save(name, blob) {
  const address = URL.createObjectURL(blob);
  Object.assign(document.createElement('a'), { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}

const data = JSON.parse(element('data').textContent);
const page = new Page(data);
window.jade = page;
if (data.live) new LivePage(page);
else writeReport(data, (view, name) => page.pick(view, name));
page.start();
