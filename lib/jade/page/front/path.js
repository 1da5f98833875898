// SPDX-License-Identifier: Apache-2.0
// A camera path through key cameras, in the format of jade_render --cameras.

import { between, centreOf, poseOfQuaternion, quaternionOf } from './pose.js';

export class CameraPath {
  constructor() {
    this.keys = [];
  }

  /** @param camera  its intrinsics; the path uses those of the first key */
  add(camera, pose) {
    if (this.keys.length === 0) this.camera = camera;
    this.keys.push(pose);
  }

  clear() {
    this.keys = [];
  }

  /** Pose at `place` from 0 to 1, on a smooth curve through the centres. */
  at(place) {
    const last = this.keys.length - 1;
    if (last < 1) return this.keys[0];
    const whole = Math.min(1, Math.max(0, place)) * last;
    const k = Math.min(Math.floor(whole), last - 1);
    const t = whole - k;
    const [a, b, c, d] = [k - 1, k, k + 1, k + 2].map((i) => centreOf(this.keys[Math.min(last, Math.max(0, i))]));
    const centre = b.map((_, i) => b[i] + 0.5 * t * (c[i] - a[i]
      + t * (2 * a[i] - 5 * b[i] + 4 * c[i] - d[i] + t * (3 * (b[i] - c[i]) + d[i] - a[i]))));
    return poseOfQuaternion(quaternionOf(between(this.keys[k], this.keys[k + 1], t)), centre);
  }

  /** One camera per frame, `seconds` from key to key. */
  frames(seconds, framesPerSecond) {
    const steps = Math.max(1, Math.round((this.keys.length - 1) * seconds * framesPerSecond));
    if (this.keys.length < 2) return [...this.keys];
    return Array.from({ length: steps + 1 }, (_, k) => this.at(k / steps));
  }

  json(seconds = 2, framesPerSecond = 30) {
    const { width, height, fx, fy, cx, cy } = this.camera;
    const cameras = this.frames(seconds, framesPerSecond).map((pose, k) => ({
      name: String(k).padStart(5, '0'),
      camera_from_world: [0, 4, 8].map((row) => pose.slice(row, row + 4)),
    }));
    return JSON.stringify({ width, height, fx, fy, cx, cy, cameras }, null, 1);
  }
}
