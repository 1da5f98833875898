// SPDX-License-Identifier: Apache-2.0
// The live page, whose scene the training program renders: frames, state and pause. The page polls, one
// request at a time, so that a sleeping page costs the program nothing.

import { depthAhead } from './viewer.js';
import { DIFFERENCE } from './layers.js';
import { shortcut } from './elements.js';
import { foldOnPhones, glanceFigures, writeCards, writeCurves, writeScores } from './report.js';

const ASK_MS = 1000; // between requests for the state
const AGAIN_MS = 150; // after a failed frame
const ATTEMPTS = 3; // for a frame that is needed
const MAKING_MS = 500; // between requests for a picture that is still being computed
const RENEW_MS = 4000; // between updates of a layer that changes during training
const CHANGING = ['α', 'fused', 'render', 'depth', DIFFERENCE];

/** Requests to the server: URLs with the viewer's name and the token, and their answers. */
export class LiveLink {
  /** @param search  the page's query, with the token if one is needed */
  constructor(search, ask = (address, options) => fetch(address, options)) {
    this.ask = ask;
    this.token = new URLSearchParams(search).get('token');
    this.viewer = Array.from({ length: 12 }, () => Math.floor(36 * Math.random()).toString(36)).join('');
  }

  address(path, parts) {
    const all = new URLSearchParams({ ...parts, viewer: this.viewer });
    if (this.token) all.set('token', this.token);
    return `${path}?${all}`;
  }

  /**
   * {blob, step, gaussians, psnr}; {reason} if it cannot be rendered; null if another request overtook this
   * one.
   * @param view  the data set's camera of this view, which may have a true image to compare with
   */
  async frame(camera, pose, scale, layer, view = '') {
    const { width, height, fx, fy, cx, cy } = scaledCamera(camera, scale);
    const where = { layer, pose: pose.join(','), camera: [fx, fy, cx, cy, width, height].join(',') };
    const answer = await this.ask(this.address('frame', view ? { ...where, view } : where));
    if (answer.status === 204) return null;
    if (answer.status !== 200) return { reason: (await answer.text()).trim() };
    const number = (name) => Number(answer.headers.get(name));
    return { blob: await answer.blob(), step: number('X-Step'), gaussians: number('X-Gaussians'), psnr: psnrOf(answer) };
  }

  /** {blob, psnr}; {reason} if it is not available; null while it is being computed. */
  async picture(view, name) {
    const answer = await this.ask(this.address('picture', { view, name }));
    if (answer.status === 200) return { blob: await answer.blob(), psnr: psnrOf(answer) };
    return answer.status === 204 ? null : { reason: (await answer.text()).trim() };
  }

  /** Current poses of a camera of the data set, 12 numbers each, or null. */
  async poses(view) {
    const answer = await this.ask(this.address('camera', { view }));
    return answer.status === 200 ? (await answer.json()).poses : null;
  }

  async state(generation, from) {
    const answer = await this.ask(this.address('state', { generation, from }));
    return answer.status === 200 ? answer.json() : null;
  }

  pause(on) {
    return this.ask(this.address('pause', { on: on ? '1' : '0' }), { method: 'POST' });
  }
}

/** PSNR of an answer's picture against a true image, dB, or null. */
function psnrOf(answer) {
  return answer.headers.has('X-Psnr') ? Number(answer.headers.get('X-Psnr')) : null;
}

const decibels = (value) => `${value.toFixed(2)} dB`;

/**
 * Quality of the picture: PSNR against the true image of its camera, current or of the last evaluation, else
 * the re-blur PSNR of the last step.
 */
export function judgement(psnr, camera, state, lines) {
  if (typeof psnr === 'number') return `PSNR ${decibels(psnr)}`;
  const scored = camera ? state?.scored?.psnr[camera] : undefined;
  if (typeof scored === 'number') return `PSNR ${decibels(scored)} at step ${state.scored.step.toLocaleString('en')}`;
  const line = lines.findLast((each) => typeof each.psnr_train === 'number');
  return line ? `re-blur PSNR ${decibels(line.psnr_train)}` : '';
}

/** Message for a page that has lost the connection to its program. */
export function farewell(state, { report, pausable }) {
  const where = report ? ` The finished scene: ${report}.` : '';
  if (!pausable) return 'jade_view has ended or cannot be reached. The page continues once it answers.';
  if (state && state.step === state.steps) return `Training has ended.${where}`;
  return 'The program that trains has ended or cannot be reached: --resume continues a stopped run, and this page continues once there is an answer.';
}

/** Camera of the same view at `scale` times as many pixels, rounded. */
export function scaledCamera(camera, scale) {
  const width = Math.max(1, Math.round(camera.width * scale));
  const height = Math.max(1, Math.round(camera.height * scale));
  const [across, down] = [width / camera.width, height / camera.height];
  return { width, height, fx: camera.fx * across, fy: camera.fy * down, cx: camera.cx * across, cy: camera.cy * down };
}

/**
 * Requested pixels per pixel of the camera: those of the screen, at least the camera's, at most `limit` times
 * as many, and exactly one if `native`; but never more than `pixels` in total.
 */
export function askedScale({ width, height }, { shown, ratio, limit, pixels, native }) {
  const most = Math.sqrt(0.998 * pixels / (width * height)); // both sides are rounded
  return Math.min(most, native ? 1 : Math.min(limit, Math.max(1, Math.min(ratio, 2) * shown / width)));
}

/** The lines of metrics.jsonl received so far; the server may thin them out. */
export class MetricsTail {
  constructor() {
    Object.assign(this, { generation: 0, lines: [] });
  }

  /** True if there are new lines. */
  take({ generation, count, lines }) {
    if (generation !== this.generation) this.lines = [];
    const before = this.lines.length;
    this.generation = generation;
    this.lines.push(...lines);
    // Overlapping answers would count lines twice: request all again.
    if (this.lines.length !== count) this.generation = -1;
    return lines.length > 0 || before !== this.lines.length;
  }
}

/** The headline figures during a run: {label, value, note}. */
export function liveFigures({ step, steps, gaussians, phase }, lines) {
  const last = (key) => lines.findLast((line) => typeof line[key] === 'number');
  const figures = [];
  if (steps > 0) figures.push({ label: phase, value: `${Math.floor(100 * step / steps)} %`, note: `step ${step.toLocaleString('en')} of ${steps.toLocaleString('en')}` });
  figures.push({ label: 'Gaussians', value: gaussians.toLocaleString('en'), note: '' });
  for (const [key, label, note] of [['psnr_train', 're-blur PSNR', 're-blurred render against its frame'], ['test_psnr', 'test views', 'mean PSNR']]) {
    const line = last(key);
    if (line) figures.push({ label, value: `${line[key].toFixed(2)} dB`, note: `${note}, step ${line.step.toLocaleString('en')}` });
  }
  const speed = last('iterations_per_second');
  if (speed) figures.push({ label: 'speed', value: `${speed.iterations_per_second.toPrecision(3)} / s`, note: 'steps' });
  return figures;
}

/** Viewer whose frames the server renders. */
export class LiveViewer {
  /**
   * @param settings  {scale, sample}
   * @param changing  whether the scene currently changes by itself
   * @param at        the data set's camera of the current view, or ''
   */
  constructor(canvas, settings, link, changing, at) {
    Object.assign(this, { canvas, link, changing, at, psnr: null, native: false, pace: 0, trouble: '', onFrame: () => {}, onTrouble: () => {} });
    this.renderer = { canvas };
    Object.assign(this, { limit: settings.scale, pixels: settings.pixels });
    const count = settings.sample.length / 3;
    this.sample = { positions: settings.sample, opacities: new Array(count).fill(1), count };
    this.wake = () => {};
    this.keepDrawing();
  }

  depthAhead(camera, pose) {
    return depthAhead(this.sample, camera, pose);
  }

  scale(camera) {
    const { native, limit, pixels } = this;
    return askedScale(camera, { shown: this.canvas.clientWidth || camera.width, ratio: devicePixelRatio || 1, limit, pixels, native });
  }

  /** Schedules a frame, and further ones while the scene changes. */
  request(camera, pose) {
    this.wanted = { camera, pose };
    this.wake();
  }

  /** Draws this view; false if another request overtook it or no frame arrived. */
  async draw(camera, pose, { depthMode = false, part = 0 } = {}) {
    const wanted = { camera, pose };
    // Static pictures (an accumulated mean, depth) are not replaced.
    this.wanted = null;
    this.held = wanted;
    for (let attempt = 0; attempt < ATTEMPTS; ++attempt) {
      const frame = await this.fetch(wanted, depthMode ? 'depth' : 'color');
      if (this.wanted || this.held !== wanted) return false;
      if (frame) {
        await this.paint(frame, part);
        if (!depthMode && part === 0) this.shown = this.wanted = wanted;
        return true;
      }
      await sleep(AGAIN_MS);
    }
    return false;
  }

  /** A picture as a PNG's data URL. */
  async picture(camera, pose, options) {
    return (await this.draw(camera, pose, options)) ? this.canvas.toDataURL('image/png') : null;
  }

  /** Requests the wanted frames for the lifetime of the page. */
  async keepDrawing() {
    for (;;) {
      const { wanted } = this;
      const due = wanted && (wanted !== this.shown || (this.changing() && document.visibilityState === 'visible'));
      if (!due) {
        await new Promise((resolve) => { this.wake = resolve; setTimeout(resolve, 500); });
        continue;
      }
      const frame = await this.fetch(wanted, 'color');
      if (!frame) await sleep(AGAIN_MS);
      else if (this.wanted) await this.paint(frame, 0);
      if (frame) this.shown = wanted;
    }
  }

  /** A frame, or null; reports the reason once. */
  async fetch({ camera, pose }, layer) {
    const frame = await this.link.frame(camera, pose, this.scale(camera), layer, this.at()).catch(() => null);
    const trouble = frame ? frame.reason || '' : this.trouble;
    if (trouble !== this.trouble) this.onTrouble(trouble);
    this.trouble = trouble;
    return frame?.blob ? frame : null;
  }

  async paint({ blob, step, gaussians, psnr }, part) {
    const bitmap = await createImageBitmap(blob);
    const { canvas } = this;
    const { width, height } = bitmap;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const board = canvas.getContext('2d', { willReadFrequently: true });
    board.drawImage(bitmap, 0, 0);
    if (part > 0) board.putImageData(this.meanWith(board.getImageData(0, 0, width, height), part), 0, 0);
    const now = performance.now();
    this.pace = this.drawnAt ? 0.8 * (this.pace || now - this.drawnAt) + 0.2 * (now - this.drawnAt) : 0;
    Object.assign(this, { step, gaussians, psnr, drawnAt: now });
    this.onFrame();
  }

  /** Adds the n-th picture to the running mean and returns it. */
  meanWith(picture, n) {
    if (n === 1 || this.mean?.length !== picture.data.length) this.mean = new Float32Array(picture.data.length);
    addToMean(this.mean, picture.data, n);
    picture.data.set(this.mean.map(Math.round));
    return picture;
  }
}

export function addToMean(mean, values, n) {
  for (let k = 0; k < mean.length; ++k) mean[k] += (values[k] - mean[k]) / n;
}

function dataUrl(blob) {
  return new Promise((resolve) => {
    const reader = new FileReader();
    reader.onload = () => resolve(reader.result);
    reader.readAsDataURL(blob);
  });
}

function sleep(milliseconds) {
  return new Promise((resolve) => { setTimeout(resolve, milliseconds); });
}

/** Turns the report's page into a live one. */
export class LivePage {
  constructor(page) {
    const { data } = page;
    Object.assign(this, { page, data, link: new LiveLink(location.search), tail: new MetricsTail(), state: null, renewedAt: 0 });
    page.live = this;
    document.title = 'JADE-GS live';
    document.getElementById('title').textContent = data.title;
    for (const view of [...data.views, ...data.tests]) view.pictures.forEach((picture) => this.givePicture(view, picture));
    for (const id of ['views', 'tests', 'allocation']) document.getElementById(id).closest('.part').hidden = true;
    if (data.evaluation) {
      document.getElementById('tests').hidden = true;
      document.getElementById('tests').closest('.part').hidden = false;
      writeScores(document.getElementById('scores'), data.evaluation);
    }
    document.getElementById('facts').textContent = data.facts.join(' · ');
    const config = document.getElementById('config');
    config.textContent = data.config;
    config.closest('.part').hidden = data.config === '';
    document.getElementById('charts').closest('.part').hidden = !data.live.pausable;
    const pause = document.getElementById('pause');
    pause.hidden = document.getElementById('pause-key').hidden = !data.live.pausable;
    pause.addEventListener('click', () => this.togglePause());
    document.addEventListener('keydown', (event) => this.key(event));
    foldOnPhones();
    this.poll();
  }

  openViewer(canvas) {
    this.viewer = new LiveViewer(canvas, this.data.live, this.link, () => this.state?.phase === 'training', () => this.page.standsAt());
    this.viewer.onTrouble = (reason) => this.page.say(reason && `not drawn: ${reason}`);
    return this.viewer;
  }

  /** Shows the requested picture and its score against the true image. */
  givePicture(view, picture) {
    picture.load = async () => {
      if (picture.kept) return picture.kept;
      const found = await this.wait(view, picture);
      picture.note = found?.reason ? 'is not to be had' : '';
      if (!found) return null;
      if (found.reason) this.page.say(`${picture.name}: ${found.reason}`);
      if (!found.blob) return null;
      if (found.psnr !== null) picture.note = decibels(found.psnr);
      const source = await dataUrl(found.blob);
      if (!CHANGING.includes(picture.name)) picture.kept = source;
      return source;
    };
  }

  /** Polls until the picture is available or no longer wanted. */
  async wait(view, { name }) {
    const { layers, state } = this.page;
    const wanted = () => state.camera === view.camera && [layers.left, layers.right].some((shown) => shown === name || shown === DIFFERENCE);
    let told = false;
    while (wanted()) {
      const found = await this.link.picture(view.camera, name).catch(() => ({ reason: 'no answer' }));
      if (found) {
        if (told) this.page.say('');
        return found;
      }
      this.page.say(`${name} is on its way`);
      told = true;
      await sleep(MAKING_MS);
    }
    return null;
  }

  /** Moves a camera of the data set to its current learned pose. True if it moved. */
  async moveCamera(id) {
    if (!this.data.live.moving) return false;
    const poses = await this.link.poses(id).catch(() => null);
    if (!poses) return false;
    this.page.cameras.get(id).poses = poses;
    return true;
  }

  label() {
    const { canvas, pace, psnr, step, gaussians } = this.viewer;
    const training = this.state?.phase === 'training';
    return [this.state ? '' : 'not live', pace && training ? `${(1000 / pace).toFixed(1)} FPS` : '',
      this.steps ? `step ${step.toLocaleString('en')}` : '', `${gaussians.toLocaleString('en')} Gaussians`,
      judgement(psnr, this.page.standsAt(), this.state, this.tail.lines), `${canvas.width}×${canvas.height}`].filter(Boolean).join(' · ');
  }

  key(event) {
    if (shortcut(event) !== 't' || !this.data.live.pausable || document.getElementById('keys').open) return;
    event.preventDefault();
    this.togglePause();
  }

  async togglePause() {
    try {
      await this.link.pause(this.state?.phase !== 'paused');
      await this.read();
    } catch {
      this.lose();
    }
  }

  async poll() {
    for (;;) {
      try {
        await this.read();
      } catch {
        this.lose();
      }
      await sleep(ASK_MS);
    }
  }

  async read() {
    const state = await this.link.state(this.tail.generation, this.tail.lines.length);
    if (!state) throw new Error('no answer');
    // Another program may use the same port.
    if (state.id !== this.data.live.id) location.reload();
    const fresh = this.tail.take(state);
    const turned = state.phase !== this.state?.phase;
    this.state = this.known = state;
    this.steps = state.steps;
    if (turned || fresh || state.phase === 'training') this.write(fresh);
    if (turned) this.viewer?.wake();
    if (state.phase === 'training' && document.visibilityState === 'visible') this.renew();
  }

  /** Updates the pose and the layers of the current camera to the state of the training. */
  async renew() {
    const { page } = this;
    if (!this.viewer || !page.restored || page.playing || page.state.pose) return;
    const { camera } = page.state;
    const moved = await this.moveCamera(camera) && page.state.camera === camera && !page.playing && !page.state.pose;
    // An accumulated mean is not replaced.
    if (moved && this.viewer.wanted) page.refresh();
    if (performance.now() - this.renewedAt < RENEW_MS) return;
    this.renewedAt = performance.now();
    page.layers.again(CHANGING);
  }

  write(fresh) {
    const { state, tail } = this;
    const glance = document.getElementById('glance');
    glance.replaceChildren();
    const scores = this.data.evaluation ? glanceFigures({ evaluation: this.data.evaluation, metrics: [] }) : [];
    writeCards(glance, [...scores, ...liveFigures(state, tail.lines)]);
    const paused = state.phase === 'paused';
    const pause = document.getElementById('pause');
    pause.textContent = paused ? 'go on' : 'pause training';
    pause.setAttribute('aria-pressed', String(paused));
    pause.disabled = state.phase === 'finishing';
    const notice = document.getElementById('notice');
    notice.hidden = state.phase !== 'finishing';
    if (!notice.hidden) notice.textContent = 'Training has ended; scores and report.html are being written.';
    document.title = state.steps ? `${Math.floor(100 * state.step / state.steps)} % · JADE-GS live` : 'JADE-GS live';
    if (!fresh) return;
    const charts = document.getElementById('charts');
    const others = document.getElementById('other-charts');
    charts.replaceChildren();
    others.replaceChildren();
    writeCurves(charts, others, tail.lines);
  }

  lose() {
    this.state = null;
    const notice = document.getElementById('notice');
    notice.textContent = farewell(this.known, this.data.live);
    notice.hidden = false;
    document.getElementById('pause').disabled = true;
    document.title = 'JADE-GS, not live';
    if (this.viewer?.drawnAt) this.page.writeFrame();
  }
}
