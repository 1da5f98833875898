// SPDX-License-Identifier: Apache-2.0
// Shows the events around a moment of an exposure as an overlay.

import { gunzipBase64 } from './spz.js';

const REACH = 0.04; // least share of the exposure before and after the moment in which an event is shown
const BRIGHTER = [255, 56, 48];
const DARKER = [64, 132, 255];

export class EventFilm {
  /** @param entry  packed by run/event_film.h: {bins, columns, rows, cell, events, packed} */
  static async unpack(entry) {
    return new EventFilm(entry, await gunzipBase64(entry.packed));
  }

  constructor({ bins, columns, rows, cell, events }, bytes) {
    Object.assign(this, { bins, columns, rows, cell, events, steps: readSteps(bytes, bins, columns * rows) });
  }

  /** RGBA bytes, one pixel per cell: red brighter, blue darker, fading with the distance from the moment. */
  picture(moment) {
    const rgba = new Uint8ClampedArray(4 * this.columns * this.rows);
    const reach = Math.max(REACH, 1 / this.bins);
    this.steps.forEach((step, k) => {
      const weight = 1 - Math.abs((k + 0.5) / this.bins - moment) / reach;
      if (weight <= 0) return;
      const alpha = Math.round(255 * Math.sqrt(weight));
      for (const [cells, color] of [[step.darker, DARKER], [step.brighter, BRIGHTER]]) {
        for (const cell of cells) {
          if (rgba[4 * cell + 3] < alpha) rgba.set([...color, alpha], 4 * cell);
        }
      }
    });
    return rgba;
  }

  /**
   * Draws the picture on a canvas of the size of its cells: the last ones may extend beyond the camera's
   * picture.
   */
  paint(canvas, moment, camera) {
    Object.assign(canvas, { width: this.columns, height: this.rows });
    canvas.style.width = `${100 * this.columns * this.cell / camera.width}%`;
    canvas.style.height = `${100 * this.rows * this.cell / camera.height}%`;
    canvas.getContext('2d').putImageData(new ImageData(this.picture(moment), this.columns), 0, 0);
  }
}

/** Decodes the signed cells, step by step. */
function readSteps(bytes, bins, cells) {
  let at = 0;
  const number = () => {
    let value = 0;
    for (let unit = 1; ; unit *= 128) {
      if (at >= bytes.length) throw new Error('the events end too soon');
      const byte = bytes[at++];
      value += (byte & 127) * unit;
      if (byte < 128) return value;
    }
  };
  const list = () => {
    const found = new Uint32Array(Math.min(number(), cells));
    for (let k = 0, next = 0; k < found.length; ++k, ++next) found[k] = next += number();
    return found;
  };
  return Array.from({ length: bins }, () => ({ darker: list(), brighter: list() }));
}
