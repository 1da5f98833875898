// SPDX-License-Identifier: Apache-2.0
// One scene on one canvas: keeps the order up to date and draws when something has changed.

import { Renderer } from './renderer.js';
import { Sorter } from './sort.js';

const SLOW_MS = 40; // per frame; above it a moving picture is drawn at half the size

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
    this.pace = 0; // ms per frame while it moves
    this.onFrame = () => {};
  }

  /** Pixels drawn per pixel of the camera: those of the screen, or exactly one. */
  scale(camera, moving) {
    if (this.native) return 1;
    const shown = this.renderer.canvas.clientWidth || camera.width;
    const full = Math.min(devicePixelRatio || 1, 2) * shown / camera.width;
    return moving && this.pace > SLOW_MS ? full / 2 : full;
  }

  /** Draws soon, with the order at hand until the new one has come. */
  request(camera, pose) {
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
    const moving = since < 250;
    if (moving) this.pace = this.pace ? 0.9 * this.pace + 0.1 * since : since;
    const { camera, pose } = this.wanted;
    this.renderer.draw(camera, pose, this.scale(camera, moving));
    this.renderer.show();
    this.onFrame();
    clearTimeout(this.rest);
    if (moving && this.pace > SLOW_MS) this.rest = setTimeout(() => this.request(camera, pose), 300);
  }

  /** Draws now, in the order of this very pose; `depthMode` shows depth. False where another request came first. */
  async draw(camera, pose, { depthMode = false, part = 0 } = {}) {
    this.wanted = null;
    const sorted = await this.sorter.request(pose);
    if (!sorted || this.wanted) return false;
    this.renderer.setOrder(sorted);
    this.renderer.draw(camera, pose, this.scale(camera, false), depthMode);
    if (part > 0) this.renderer.accumulate(part);
    this.renderer.show(part > 0, depthMode);
    this.onFrame();
    return true;
  }

  /** The same as a PNG's data URL. */
  async picture(camera, pose, options) {
    return (await this.draw(camera, pose, options)) ? this.renderer.picture() : null;
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
