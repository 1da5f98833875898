// SPDX-License-Identifier: Apache-2.0
// Draws frusta of the recorded cameras over the scene, and measures how far a view is from all of them.

import { add, axis, centreOf, dot } from './pose.js';

const FAR_SHARE = 0.35; // distance from a recorded camera, relative to the distance to the scene
const FAR_ANGLE = 25 * Math.PI / 180; // between viewing directions
const DEPTH_SHARE = 0.08; // depth of a drawn frustum, relative to the distance to the scene

/**
 * Distance of a view from the nearest recorded pose: 0 at one, 1 at the limit of the well-reconstructed
 * region.
 * @param reach  distance of the scene from the view
 */
export function outsideness(pose, recorded, reach) {
  const [centre, forward] = [centreOf(pose), axis(pose, 2)];
  const away = recorded.map((other) => {
    const distance = Math.hypot(...centreOf(other).map((value, k) => value - centre[k]));
    const angle = Math.acos(Math.min(1, Math.max(-1, dot(forward, axis(other, 2)))));
    return Math.max(distance / (FAR_SHARE * reach), angle / FAR_ANGLE);
  });
  return Math.min(...away);
}

/** Opacity of the shade over a view: none near the cameras, almost black where the scene falls apart. */
export function shadeOf(outside) {
  return Math.min(0.85, Math.max(0, 2 * (outside - 0.4)));
}

/** Edges of a recorded camera's frustum as pairs of world points. */
export function frustumEdges(pose, { width, height, fx, fy, cx, cy }, depth) {
  const centre = centreOf(pose);
  const corner = (x, y) => add(add(add(centre, axis(pose, 0), depth * (x - cx) / fx), axis(pose, 1), depth * (y - cy) / fy), axis(pose, 2), depth);
  const corners = [corner(0, 0), corner(width, 0), corner(width, height), corner(0, height)];
  return corners.flatMap((point, k) => [[centre, point], [point, corners[(k + 1) % 4]]]);
}

/** Draws the frusta of `cameras` as seen from `pose`; edges behind the view are omitted. */
export function drawFrusta(canvas, camera, pose, cameras, reach) {
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  Object.assign(canvas, { width, height });
  const context = canvas.getContext('2d');
  const centre = centreOf(pose);
  const project = (point) => {
    const from = point.map((value, k) => value - centre[k]);
    const [x, y, z] = [0, 1, 2].map((k) => dot(axis(pose, k), from));
    return z > 0.01 * reach ? [(camera.fx * x / z + camera.cx) * width / camera.width, (camera.fy * y / z + camera.cy) * height / camera.height] : null;
  };
  context.strokeStyle = '#ffb000';
  context.beginPath();
  for (const each of cameras) {
    for (const edge of frustumEdges(each.poses[each.poses.length >> 1], each, DEPTH_SHARE * reach)) {
      const [from, to] = edge.map(project);
      if (!from || !to) continue;
      context.moveTo(...from);
      context.lineTo(...to);
    }
  }
  context.stroke();
}
