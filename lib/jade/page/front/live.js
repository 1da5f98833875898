// SPDX-License-Identifier: Apache-2.0
// The page with the scene drawn by the program that serves it: frames, state and pause. It asks, one
// question at a time, and takes what comes; so a page that sleeps costs the program nothing.

import { depthAhead } from './viewer.js';
import { writeCards, writeCurves } from './report.js';

const ASK_MS = 1000; // between two questions for the state
const AGAIN_MS = 150; // after a frame that did not come
const ATTEMPTS = 3; // for a frame that somebody waits for

/** What the server is asked: addresses with the viewer's name and the token, and their answers. */
export class LiveLink {
  /** @param search  the page's, with the token where one is needed */
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

  /** {blob, step, gaussians}, or null where it was not drawn. */
  async frame(camera, pose, scale, layer) {
    const { width, height, fx, fy, cx, cy } = scaledCamera(camera, scale);
    const answer = await this.ask(this.address('frame', { layer, pose: pose.join(','), camera: [fx, fy, cx, cy, width, height].join(',') }));
    if (answer.status !== 200) return null;
    const number = (name) => Number(answer.headers.get(name));
    return { blob: await answer.blob(), step: number('X-Step'), gaussians: number('X-Gaussians') };
  }

  async state(generation, from) {
    const answer = await this.ask(this.address('state', { generation, from }));
    return answer.status === 200 ? answer.json() : null;
  }

  pause(on) {
    return this.ask(this.address('pause', { on: on ? '1' : '0' }), { method: 'POST' });
  }
}

/** The same view at `scale` times as many pixels, whole ones. */
export function scaledCamera(camera, scale) {
  const width = Math.max(1, Math.round(camera.width * scale));
  const height = Math.max(1, Math.round(camera.height * scale));
  const [across, down] = [width / camera.width, height / camera.height];
  return { width, height, fx: camera.fx * across, fy: camera.fy * down, cx: camera.cx * across, cy: camera.cy * down };
}

/** The lines of metrics.jsonl that have come so far; the server may thin them out. */
export class MetricsTail {
  constructor() {
    Object.assign(this, { generation: 0, lines: [] });
  }

  /** True where something is new. */
  take({ generation, count, lines }) {
    if (generation !== this.generation) this.lines = [];
    const before = this.lines.length;
    this.generation = generation;
    this.lines.push(...lines);
    // Two answers that crossed would count lines twice: then all are asked for again.
    if (this.lines.length !== count) this.generation = -1;
    return lines.length > 0 || before !== this.lines.length;
  }
}

/** The figures that come first while a run goes on: {label, value, note}. */
export function liveFigures({ step, steps, gaussians, phase }, lines) {
  const last = (key) => lines.findLast((line) => typeof line[key] === 'number');
  const figures = [];
  if (steps > 0) figures.push({ label: phase, value: `${Math.floor(100 * step / steps)} %`, note: `step ${step.toLocaleString('en')} of ${steps.toLocaleString('en')}` });
  figures.push({ label: 'Gaussians', value: gaussians.toLocaleString('en'), note: '' });
  for (const [key, label, note] of [['psnr_train', 'blur explained', 're-blurred render against its frame'], ['test_psnr', 'test views', 'mean PSNR']]) {
    const line = last(key);
    if (line) figures.push({ label, value: `${line[key].toFixed(2)} dB`, note: `${note}, step ${line.step.toLocaleString('en')}` });
  }
  const speed = last('iterations_per_second');
  if (speed) figures.push({ label: 'speed', value: `${speed.iterations_per_second.toPrecision(3)} / s`, note: 'steps' });
  return figures;
}

/** What Viewer does, with frames from the server. */
export class LiveViewer {
  /**
   * @param settings  {scale, sample}
   * @param changing  whether the scene changes by itself now
   */
  constructor(canvas, settings, link, changing) {
    Object.assign(this, { canvas, link, changing, native: false, pace: 0, onFrame: () => {} });
    this.renderer = { canvas };
    this.limit = settings.scale;
    const count = settings.sample.length / 3;
    this.sample = { positions: settings.sample, opacities: new Array(count).fill(1), count };
    this.wake = () => {};
    this.follow();
  }

  depthAhead(camera, pose) {
    return depthAhead(this.sample, camera, pose);
  }

  scale(camera) {
    const shown = (this.canvas.clientWidth || camera.width) / camera.width;
    return this.native ? 1 : Math.min(this.limit, Math.max(1, Math.min(devicePixelRatio || 1, 2) * shown));
  }

  /** Draws soon, and again while the scene changes. */
  request(camera, pose) {
    this.wanted = { camera, pose };
    this.wake();
  }

  /** Draws this view; false where another request came first or nothing came. */
  async draw(camera, pose, { depthMode = false, part = 0 } = {}) {
    const wanted = { camera, pose };
    // What is held is not drawn over: a mean that builds up, depth.
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

  /** The same as a PNG's data URL. */
  async picture(camera, pose, options) {
    return (await this.draw(camera, pose, options)) ? this.canvas.toDataURL('image/png') : null;
  }

  /** Asks for what is wanted for as long as the page lives. */
  async follow() {
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

  fetch({ camera, pose }, layer) {
    return this.link.frame(camera, pose, this.scale(camera), layer).catch(() => null);
  }

  async paint({ blob, step, gaussians }, part) {
    const bitmap = await createImageBitmap(blob);
    const { canvas } = this;
    const { width, height } = bitmap;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const board = canvas.getContext('2d', { willReadFrequently: true });
    board.drawImage(bitmap, 0, 0);
    if (part > 0) board.putImageData(this.meanWith(board.getImageData(0, 0, width, height), part), 0, 0);
    const now = performance.now();
    this.pace = this.drawnAt ? 0.8 * (this.pace || now - this.drawnAt) + 0.2 * (now - this.drawnAt) : 0;
    Object.assign(this, { step, gaussians, drawnAt: now });
    this.onFrame();
  }

  /** The n-th picture becomes part of the running mean, which is returned. */
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

function sleep(milliseconds) {
  return new Promise((resolve) => { setTimeout(resolve, milliseconds); });
}

/** Makes the report's page a live one. */
export class LivePage {
  constructor(page) {
    const { data } = page;
    Object.assign(this, { page, data, link: new LiveLink(location.search), tail: new MetricsTail(), state: null });
    page.live = this;
    document.title = 'JADE-GS live';
    for (const view of [...data.views, ...data.tests]) view.pictures.forEach((picture) => this.givePicture(view, picture));
    for (const id of ['views', 'tests', 'scores', 'allocation']) {
      const part = document.getElementById(id);
      part.hidden = true;
      if (part.previousElementSibling?.tagName === 'H2') part.previousElementSibling.hidden = true;
    }
    document.getElementById('facts').textContent = data.facts.join(' · ');
    const config = document.getElementById('config');
    config.textContent = data.config;
    config.parentElement.hidden = config.parentElement.previousElementSibling.hidden = data.config === '';
    const charts = document.getElementById('charts');
    charts.previousElementSibling.hidden = !data.live.pausable;
    const pause = document.getElementById('pause');
    pause.hidden = !data.live.pausable;
    pause.addEventListener('click', () => this.togglePause());
    document.addEventListener('keydown', (event) => this.key(event));
    this.poll();
  }

  openViewer(canvas) {
    this.viewer = new LiveViewer(canvas, this.data.live, this.link, () => this.state?.phase === 'training');
    return this.viewer;
  }

  /** Its address changes with the step, or a browser would show an older one. */
  givePicture(view, picture) {
    const address = () => this.link.address('picture', { view: view.camera, name: picture.name, step: this.state?.step ?? 0 });
    Object.defineProperty(picture, 'src', { get: address });
  }

  label() {
    const { canvas, pace, step, gaussians } = this.viewer;
    const rate = pace && this.state?.phase === 'training' ? `${(1000 / pace).toFixed(1)} FPS · ` : '';
    const steps = this.state?.steps ? `step ${step.toLocaleString('en')} · ` : '';
    const psnr = this.tail.lines.findLast((line) => typeof line.psnr_train === 'number');
    return `${rate}${steps}${gaussians.toLocaleString('en')} Gaussians · ${psnr ? `${psnr.psnr_train.toFixed(2)} dB · ` : ''}${canvas.width}×${canvas.height}`;
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
    if (event.key.toLowerCase() !== 't' || !this.data.live.pausable || document.getElementById('keys').open) return;
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
    // Another program may have taken the same port.
    if (state.id !== this.data.live.id) location.reload();
    const fresh = this.tail.take(state);
    const turned = state.phase !== this.state?.phase;
    this.state = state;
    if (turned || fresh || state.phase === 'training') this.write(fresh);
    if (turned) this.viewer?.wake();
  }

  write(fresh) {
    const { state, tail } = this;
    const glance = document.getElementById('glance');
    glance.replaceChildren();
    writeCards(glance, liveFigures(state, tail.lines));
    const paused = state.phase === 'paused';
    const pause = document.getElementById('pause');
    pause.textContent = paused ? 'go on' : 'pause training';
    pause.setAttribute('aria-pressed', String(paused));
    pause.disabled = state.phase === 'finishing';
    document.getElementById('notice').hidden = true;
    if (!fresh) return;
    const charts = document.getElementById('charts');
    charts.replaceChildren();
    writeCurves(charts, tail.lines);
  }

  lose() {
    this.state = null;
    const notice = document.getElementById('notice');
    notice.textContent = 'The program that serves this page has ended or cannot be reached; report.html in the run directory holds the finished scene.';
    notice.hidden = false;
    document.getElementById('pause').disabled = true;
  }
}
