// SPDX-License-Identifier: Apache-2.0
// Computes the depth order and the colour of every Gaussian once per frame. The first two functions also run
// in a worker, so they must be self-contained.

import { centreOf } from './pose.js';

/**
 * Sorts far to near by depth, quantised to 65,536 steps between the nearest and the farthest rendered
 * Gaussian; of equal steps the later index comes first, so that near to far is ordered by (depth, index).
 * @param positions  [3N]
 * @param view       row of camera_from_world that gives the depth, 4 numbers
 * @param near       nearer ones are omitted
 * @returns {order: Uint32Array, nearest, farthest}
 */
export function sortByDepth(positions, view, near) {
  const count = positions.length / 3;
  const depths = new Float32Array(count);
  let nearest = Infinity;
  let farthest = -Infinity;
  let kept = 0;
  for (let i = 0; i < count; ++i) {
    const depth = view[0] * positions[3 * i] + view[1] * positions[3 * i + 1] + view[2] * positions[3 * i + 2] + view[3];
    depths[i] = depth;
    if (!(depth >= near)) continue;
    ++kept;
    if (depth < nearest) nearest = depth;
    if (depth > farthest) farthest = depth;
  }
  const steps = 65536;
  const scale = (steps - 1) / (farthest - nearest || 1);
  const starts = new Uint32Array(steps + 1);
  const keys = new Uint16Array(count);
  for (let i = 0; i < count; ++i) {
    if (!(depths[i] >= near)) continue;
    keys[i] = Math.min(steps - 1, Math.max(0, Math.floor((farthest - depths[i]) * scale)));
    ++starts[keys[i] + 1];
  }
  for (let k = 0; k < steps; ++k) starts[k + 1] += starts[k];
  const order = new Uint32Array(kept);
  for (let i = count - 1; i >= 0; --i) {
    if (depths[i] >= near) order[starts[keys[i]]++] = i;
  }
  return { order, nearest, farthest };
}

/**
 * Colours of the Gaussians seen from a camera: max(0, SH of degree up to 3 + ½), in the given order. In a
 * vertex shader, four times per Gaussian, this cost more than all other work.
 * @param scene   {positions, colors, degree} of parseSpz()
 * @param centre  of the camera
 * @returns Float32Array [3 per entry of the order]
 */
export function shadesOf({ positions, colors, degree }, order, centre) {
  const count = (degree + 1) ** 2;
  const basis = new Float64Array(16);
  const shades = new Float32Array(3 * order.length);
  for (let k = 0; k < order.length; ++k) {
    const i = order[k];
    // In the file's axes: y up, z back.
    let x = positions[3 * i] - centre[0];
    let y = centre[1] - positions[3 * i + 1];
    let z = centre[2] - positions[3 * i + 2];
    const scale = 1 / Math.sqrt(x * x + y * y + z * z);
    x *= scale;
    y *= scale;
    z *= scale;
    const xx = x * x;
    const yy = y * y;
    const zz = z * z;
    const ring = 4 * zz - xx - yy;
    basis[1] = -0.4886025119029199 * y;
    basis[2] = 0.4886025119029199 * z;
    basis[3] = -0.4886025119029199 * x;
    basis[4] = 1.0925484305920792 * x * y;
    basis[5] = -1.0925484305920792 * y * z;
    basis[6] = 0.31539156525252005 * (2 * zz - xx - yy);
    basis[7] = -1.0925484305920792 * x * z;
    basis[8] = 0.5462742152960396 * (xx - yy);
    basis[9] = -0.5900435899266435 * y * (3 * xx - yy);
    basis[10] = 2.890611442640554 * x * y * z;
    basis[11] = -0.4570457994644658 * y * ring;
    basis[12] = 0.3731763325901154 * z * (2 * zz - 3 * (xx + yy));
    basis[13] = -0.4570457994644658 * x * ring;
    basis[14] = 1.445305721320277 * z * (xx - yy);
    basis[15] = -0.5900435899266435 * x * (xx - 3 * yy);
    for (let c = 0, at = 48 * i; c < 3; ++c, ++at) {
      let sum = 0;
      for (let n = 1; n < count; ++n) sum += basis[n] * (colors[at + 3 * n] - 128);
      shades[3 * k + c] = Math.max(0, 0.5 + 0.28209479177387814 * (colors[at] / 255 - 0.5) / 0.15 + sum / 128);
    }
  }
  return shades;
}

/** Parts of a pose that order and colours depend on. */
function seenFrom(pose) {
  return { view: pose.slice(8), centre: centreOf(pose) };
}

/** Computes order and colours in a worker, the newest request first; without workers, synchronously. */
export class Sorter {
  constructor({ positions, colors, degree }, near) {
    const scene = { positions, colors, degree };
    this.arrange = ({ view, centre }) => {
      const sorted = sortByDepth(positions, view, near);
      return { ...sorted, shades: shadesOf(scene, sorted.order, centre) };
    };
    this.waiting = null;
    this.busy = null;
    try {
      const source = `const sortByDepth = ${sortByDepth}, shadesOf = ${shadesOf};
        let scene, near;
        onmessage = ({data}) => {
          if (data.scene) { ({scene, near} = data); return; }
          const sorted = sortByDepth(scene.positions, data.view, near);
          const shades = shadesOf(scene, sorted.order, data.centre);
          postMessage({...sorted, shades}, [sorted.order.buffer, shades.buffer]);
        };`;
      this.worker = new Worker(URL.createObjectURL(new Blob([source], { type: 'text/javascript' })));
      this.worker.onmessage = ({ data }) => this.done(data);
      this.worker.onerror = () => this.lose();
      this.worker.postMessage({ scene, near });
    } catch {
      this.worker = null;
    }
  }

  /** Resolves to {order, shades, nearest, farthest}, or to null if a newer request replaced this one. */
  request(pose) {
    const from = seenFrom(pose);
    if (!this.worker) return Promise.resolve(this.arrange(from));
    return new Promise((resolve) => {
      if (this.waiting) this.waiting.resolve(null);
      this.waiting = { from, resolve };
      if (!this.busy) this.next();
    });
  }

  /** Sorts on the page's own thread, which blocks it. */
  now(pose) {
    return this.arrange(seenFrom(pose));
  }

  next() {
    this.busy = this.waiting;
    this.waiting = null;
    if (this.busy) this.worker.postMessage(this.busy.from);
  }

  /**
   * Handles a worker that fails, for example for lack of memory or because a policy forbids it: sorts here.
   */
  lose() {
    this.worker = null;
    const left = [this.busy, this.waiting].filter(Boolean);
    this.busy = this.waiting = null;
    for (const { from, resolve } of left) resolve(this.arrange(from));
  }

  done(sorted) {
    this.busy.resolve(sorted);
    this.next();
  }
}
