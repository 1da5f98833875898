// SPDX-License-Identifier: Apache-2.0
// Camera control by pointer, wheel and keyboard.

import { takesText } from './elements.js';
import { add, axis, centreOf, look, moved, orbit } from './pose.js';

const FLY = { KeyW: [0, 0, 1], KeyS: [0, 0, -1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyQ: [0, 1, 0], KeyE: [0, -1, 0] };
const TURN = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class Controls {
  /**
   * @param host  {pose(), reach(), down, move(pose)}: the current camera, the distance to the point that it
   *   looks at, the down direction of the world, and a callback for the moved camera
   */
  constructor(stage, host) {
    Object.assign(this, { stage, host, pointers: new Map(), held: new Set() });
    stage.addEventListener('pointerdown', (event) => this.down(event));
    stage.addEventListener('pointermove', (event) => this.drag(event));
    for (const end of ['pointerup', 'pointercancel']) {
      stage.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    }
    stage.addEventListener('contextmenu', (event) => event.preventDefault());
    stage.addEventListener('wheel', (event) => {
      // The wheel scrolls the page until the picture has the focus.
      if (document.activeElement !== stage) return;
      event.preventDefault();
      this.dolly(Math.exp(-0.001 * event.deltaY));
    }, { passive: false });
    stage.addEventListener('keydown', (event) => this.press(event));
    // Flying works without focus too; arrow keys then scroll the page or move a slider.
    document.addEventListener('keydown', (event) => {
      const elsewhere = !stage.contains(event.target) && !takesText(event.target) && !document.querySelector('dialog[open]');
      if (elsewhere && FLY[event.code]) this.press(event);
    });
    document.addEventListener('keyup', (event) => this.held.delete(event.code));
    stage.addEventListener('blur', () => this.held.clear());
    window.addEventListener('blur', () => this.held.clear());
  }

  down(event) {
    if (event.target.closest('button')) return; // a captured pointer would suppress the button's click
    this.stage.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  }

  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = { x: event.clientX, y: event.clientY };
    const [dx, dy] = [now.x - before.x, now.y - before.y];
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    this.pointers.set(event.pointerId, now);
    if (other) {
      const distance = (point) => Math.hypot(point.x - other.x, point.y - other.y);
      this.pan(dx / 2, dy / 2);
      if (distance(before) > 0) this.dolly(distance(now) / distance(before));
    } else if (event.shiftKey || (event.buttons & 6) !== 0) {
      this.pan(dx, dy);
    } else {
      const pose = this.host.pose();
      const target = add(centreOf(pose), axis(pose, 2), this.host.reach());
      const turn = 2.5 / this.stage.clientWidth;
      this.host.move(orbit(pose, target, this.host.down, dx * turn, -dy * turn));
    }
  }

  pan(dx, dy) {
    const step = this.host.reach() * this.host.pixel() / this.stage.clientWidth;
    this.host.move(moved(this.host.pose(), [-dx * step, -dy * step, 0]));
  }

  /** Multiplies the distance to the point of interest by a factor. */
  dolly(factor) {
    const reach = this.host.reach();
    this.host.move(moved(this.host.pose(), [0, 0, reach - reach / factor]), reach / factor);
  }

  press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || !(FLY[event.code] || TURN[event.code])) return;
    event.preventDefault();
    this.held.add(event.code);
    if (this.flying) return;
    this.flying = true;
    requestAnimationFrame((now) => this.fly(now, now - 16));
  }

  fly(now, before) {
    this.flying = this.held.size > 0;
    if (!this.flying) return;
    const seconds = Math.min(0.1, (now - before) / 1000);
    let pose = this.host.pose();
    for (const code of this.held) {
      const step = (FLY[code] ?? [0, 0, 0]).map((part) => part * seconds * 0.6 * this.host.reach());
      pose = moved(pose, step);
      if (TURN[code]) pose = look(pose, this.host.down, ...TURN[code].map((part) => part * seconds * 0.8));
    }
    this.host.move(pose);
    requestAnimationFrame((next) => this.fly(next, now));
  }
}
