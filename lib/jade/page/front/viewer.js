// SPDX-License-Identifier: Apache-2.0
// Shows one scene on one canvas: updates the order and renders after changes.

import { Renderer } from './renderer.js';
import { Sorter } from './sort.js';

const REST_MS = 250; // the picture counts as static after this time without a frame
const SLOW_MS = 22; // per frame: below 60 per second; a moving picture is then rendered at half the size

/** Measures the frame rate while the picture moves, and whether full-size frames are fast enough. */
export class Pace {
  constructor() {
    Object.assign(this, { mean: 0, whole: 1000 / 60, coarse: false });
  }

  /** A frame took `ms`; longer than a rest means that the page was hidden. */
  took(ms) {
    if (ms >= REST_MS) return;
    this.mean = this.mean ? 0.9 * this.mean + 0.1 * ms : ms;
    // Half-size frames do not predict full-size ones: the size would flicker.
    if (!this.coarse) this.whole = 0.8 * this.whole + 0.2 * ms;
    this.coarse = this.whole > SLOW_MS;
  }

  /** The movement has ended: eventually full size is tried again. */
  rest() {
    this.whole *= 0.8;
    this.coarse = this.whole > SLOW_MS;
  }
}

export class Viewer {
  /**
   * @param settings  {near_plane, background}
   * @throws Error that names the missing browser feature
   */
  constructor(canvas, scene, settings) {
    this.renderer = new Renderer(canvas, scene, settings.background);
    this.sorter = new Sorter(scene, settings.near_plane);
    this.scene = scene;
    this.native = false;
    this.pace = new Pace();
    this.onFrame = () => {};
  }

  /** Rendered pixels per pixel of the camera: those of the screen, or exactly one. */
  scale(camera, moving) {
    if (this.native) return 1;
    const shown = this.renderer.canvas.clientWidth || camera.width;
    const full = Math.min(devicePixelRatio || 1, 2) * shown / camera.width;
    return moving && this.pace.coarse ? full / 2 : full;
  }

  /** Schedules a frame, with the current order until the new one arrives. */
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
    // Measure until the browser is ready for the next frame: the time of the next request does not depend on
    // the GPU.
    requestAnimationFrame((next) => this.pace.took(next - now));
    clearTimeout(this.rest);
    if (!moving || !this.pace.coarse) return;
    this.rest = setTimeout(() => {
      this.pace.rest();
      this.request(camera, pose);
    }, 300);
  }

  /**
   * Renders immediately, in the order of this pose; `depthMode` shows depth. False if another request
   * overtook it.
   */
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

  /** A picture as a PNG's data URL; sorted without the worker if another request overtook it. */
  async picture(camera, pose, options) {
    if (!(await this.draw(camera, pose, options))) this.paint(this.sorter.now(pose), camera, pose, options);
    return this.renderer.picture();
  }

  depthAhead(camera, pose) {
    return depthAhead(this.scene, camera, pose);
  }
}

/** Median depth of the Gaussians in the middle of the picture: the pivot of rotations. */
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
