// SPDX-License-Identifier: Apache-2.0
// Pictures over the scene, with a wipe between a left and a right one.

export const SCENE = 'scene';
export const DIFFERENCE = '|difference|';
export const MAPS = ['depth', 'α', 'event density', DIFFERENCE]; // not photographs: display brightness does not apply
const GAIN = 4; // brightness factor of the difference, which is dark otherwise

export class Layers {
  /** @param parts  the stage's elements: left, right, bar, leftTag, rightTag, leftSelect, rightSelect */
  constructor(parts, onChange) {
    Object.assign(this, { parts, onChange, pictures: [], left: SCENE, right: SCENE, wipe: 0.5, turn: 0 });
    parts.leftSelect.onchange = () => this.choose(parts.leftSelect.value, this.right);
    parts.rightSelect.onchange = () => this.choose(this.left, parts.rightSelect.value);
    parts.bar.addEventListener('pointerdown', (event) => {
      event.stopPropagation();
      parts.bar.setPointerCapture(event.pointerId);
    });
    parts.bar.addEventListener('pointermove', (event) => {
      if (parts.bar.hasPointerCapture(event.pointerId)) this.wipeToX(event.clientX);
    });
    parts.bar.addEventListener('keydown', (event) => {
      const step = { ArrowLeft: -0.02, ArrowRight: 0.02, Home: -1, End: 1 }[event.code];
      if (step === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      this.setWipe(this.wipe + step);
    });
  }

  /** Sets the pictures of a view, and the names of live renders beside SCENE, if there is one. */
  setPictures(pictures, live) {
    this.pictures = pictures;
    const find = (name) => pictures.find((picture) => picture.name === name);
    this.names = [...live, ...pictures.map((picture) => picture.name)];
    if (find('render') && find('truth')) this.names.push(DIFFERENCE);
    for (const select of [this.parts.leftSelect, this.parts.rightSelect]) {
      select.replaceChildren(...this.names.map((name) => new Option(name)));
      select.disabled = this.names.length < 2;
    }
    const first = this.names[0];
    const known = (name) => (this.names.includes(name) ? name : first);
    return this.choose(known(this.left), known(this.right));
  }

  /** Shows two layers; resolves when both are loaded. */
  async choose(left, right) {
    Object.assign(this, { left, right });
    this.parts.leftSelect.value = left;
    this.parts.rightSelect.value = right;
    this.turn += 1;
    await this.fill(['left', 'right']);
  }

  /** Reloads shown layers with one of these names. */
  again(names) {
    return this.fill(['left', 'right'].filter((side) => names.includes(this[side])));
  }

  async fill(sides) {
    const { turn } = this;
    await Promise.all(sides.map((side) => this.fillOne(this.parts[side], this[side], turn)));
    if (turn !== this.turn) return;
    this.place();
    this.onChange();
  }

  async fillOne(image, name, turn) {
    const source = name === SCENE ? null : await (name === DIFFERENCE ? this.difference() : this.sourceOf(name));
    // A later choice has overtaken this one.
    if (turn !== this.turn) return;
    image.hidden = !source;
    if (!source) return;
    image.src = source;
    image.alt = name;
    image.classList.toggle('map', MAPS.includes(name));
    await image.decode().catch(() => {});
  }

  /** A URL, a promise of one, or null if the picture is not available. */
  sourceOf(name) {
    const picture = this.pictures.find((each) => each.name === name);
    return picture?.load ? picture.load() : picture?.src ?? this.live?.(name);
  }

  async difference() {
    const sources = await Promise.all(['render', 'truth'].map((name) => this.sourceOf(name)));
    if (!sources.every(Boolean)) return null;
    const [a, b] = await Promise.all(sources.map(pixelsOf));
    const board = Object.assign(document.createElement('canvas'), { width: a.width, height: a.height });
    board.getContext('2d').putImageData(new ImageData(absoluteDifference(a.data, b.data, GAIN), a.width), 0, 0);
    return board.toDataURL();
  }

  swap() {
    return this.choose(this.right, this.left);
  }

  wipeToX(clientX) {
    const box = this.parts.bar.parentElement.getBoundingClientRect();
    this.setWipe((clientX - box.left) / box.width);
  }

  setWipe(share) {
    this.wipe = Math.min(1, Math.max(0, share));
    this.place();
    this.onChange();
  }

  place() {
    const { left, right, bar, leftTag, rightTag } = this.parts;
    const percent = 100 * this.wipe;
    const both = this.left !== this.right;
    left.style.clipPath = both ? `inset(0 ${100 - percent}% 0 0)` : '';
    right.style.clipPath = both ? `inset(0 0 0 ${percent}%)` : '';
    bar.style.left = `${percent}%`;
    bar.hidden = !both;
    bar.setAttribute('aria-valuenow', String(Math.round(percent)));
    leftTag.textContent = this.label(this.left);
    rightTag.textContent = this.label(this.right);
    rightTag.hidden = !both;
  }

  label(name) {
    const note = this.pictures.find((picture) => picture.name === name)?.note;
    return note ? `${name} ${note}` : name;
  }
}

/** Absolute difference of two pictures as opaque RGBA bytes, multiplied by `gain`. */
export function absoluteDifference(a, b, gain) {
  const out = new Uint8ClampedArray(a.length);
  for (let k = 0; k < a.length; ++k) out[k] = k % 4 === 3 ? 255 : gain * Math.abs(a[k] - b[k]);
  return out;
}

/** A picture's bytes. */
export async function pixelsOf(source) {
  const image = Object.assign(new Image(), { src: source });
  await image.decode();
  const board = Object.assign(document.createElement('canvas'), { width: image.naturalWidth, height: image.naturalHeight });
  const context = board.getContext('2d', { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, board.width, board.height);
}
