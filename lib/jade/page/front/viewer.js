// SPDX-License-Identifier: Apache-2.0
// One scene on one canvas: keeps the order up to date and draws when something has changed.

import { Renderer } from './renderer.js';
import { Sorter } from './sort.js';

const REST_MS = 250; // without a frame the picture stands still
const SLOW_MS = 22; // per frame: not 60 per second; a moving picture is drawn at half the size then

/** How fast frames come while the picture moves, and whether they come in time at the whole size. */
export class Pace {
  constructor() {
    Object.assign(this, { mean: 0, whole: 1000 / 60, coarse: false });
  }

  /** A drawn frame held the screen for `ms`; longer than a rest, nobody was looking. */
  took(ms) {
    if (ms >= REST_MS) return;
    this.mean = this.mean ? 0.9 * this.mean + 0.1 * ms : ms;
    // Frames of half the size say nothing of whole ones: the size would flicker.
    if (!this.coarse) this.whole = 0.8 * this.whole + 0.2 * ms;
    this.coarse = this.whole > SLOW_MS;
  }

  /** The movement has ended: sooner or later the whole size is tried again. */
  rest() {
    this.whole *= 0.8;
    this.coarse = this.whole > SLOW_MS;
  }
}

export class Viewer {
  /**
   * @param settings  {near_plane, background}
   * @throws Error that says what the browser lacks
   */
  constructor(canvas, scene, settings) {
    this.renderer = new Renderer(canvas, scene, settings.background);
    this.sorter = new Sorter(scene, settings.near_plane);
    this.scene = scene;
    this.native = false;
    this.pace = new Pace();
    this.onFrame = () => {};
  }

  /** Pixels drawn per pixel of the camera: those of the screen, or exactly one. */
  scale(camera, moving) {
    if (this.native) return 1;
    const shown = this.renderer.canvas.clientWidth || camera.width;
    const full = Math.min(devicePixelRatio || 1, 2) * shown / camera.width;
    return moving && this.pace.coarse ? full / 2 : full;
  }

  /** Draws soon, with the order at hand until the new one has come. */
  request(camera, pose) {
    clearTimeout(this.rest);
    this.wanted = { camera, pose };
    if (!this.frame) this.frame = requestAnimationFrame((now) => this.drawWanted(now));
    this.sorter.request(pose).then((sorted) => {
      if (!sorted) return;
      this.renderer.setOrder(sorted);
      if (!this.frame) this.frame = requestAnimationFrame((now) => this.drawWanted(now));
    });
  }

  drawWanted(now) {
    this.frame = 0;
    if (!this.renderer.range || !this.wanted) return;
    const since = now - (this.drawnAt ?? -Infinity);
    this.drawnAt = now;
    const moving = since < REST_MS;
    const { camera, pose } = this.wanted;
    this.renderer.draw(camera, pose, this.scale(camera, moving));
    this.renderer.show();
    this.onFrame();
    // Until the browser is ready for the next one: how soon somebody asks for it says nothing of the graphics card.
    requestAnimationFrame((next) => this.pace.took(next - now));
    clearTimeout(this.rest);
    if (!moving || !this.pace.coarse) return;
    this.rest = setTimeout(() => {
      this.pace.rest();
      this.request(camera, pose);
    }, 300);
  }

  /** Draws now, in the order of this very pose; `depthMode` shows depth. False where another request came first. */
  async draw(camera, pose, options) {
    clearTimeout(this.rest);
    this.wanted = null;
    const sorted = await this.sorter.request(pose);
    if (!sorted || this.wanted) return false;
    this.paint(sorted, camera, pose, options);
    return true;
  }

  paint(sorted, camera, pose, { depthMode = false, part = 0 } = {}) {
    this.renderer.setOrder(sorted);
    this.renderer.draw(camera, pose, this.scale(camera, false), depthMode);
    if (part > 0) this.renderer.accumulate(part);
    this.renderer.show(part > 0, depthMode);
    this.onFrame();
  }

  /** A picture as a PNG's data URL; sorted without the worker if another request came first. */
  async picture(camera, pose, options) {
    if (!(await this.draw(camera, pose, options))) this.paint(this.sorter.now(pose), camera, pose, options);
    return this.renderer.picture();
  }

  depthAhead(camera, pose) {
    return depthAhead(this.scene, camera, pose);
  }
}

/** Median depth of the Gaussians in the middle of the picture: what one turns about. */
export function depthAhead({ positions, opacities, count }, camera, pose) {
  const depths = [];
  for (let i = 0; i < count; i += Math.ceil(count / 20000)) {
    const [x, y, z] = [0, 4, 8].map((row) => pose[row] * positions[3 * i] + pose[row + 1] * positions[3 * i + 1]
      + pose[row + 2] * positions[3 * i + 2] + pose[row + 3]);
    const centred = Math.abs(x / z) * camera.fx < camera.width / 6 && Math.abs(y / z) * camera.fy < camera.height / 6;
    if (z > 0 && centred && opacities[i] > 0.2) depths.push(z);
  }
  depths.sort((a, b) => a - b);
  return depths.length > 0 ? depths[depths.length >> 1] : 1;
}
