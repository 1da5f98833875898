// SPDX-License-Identifier: Apache-2.0
// Poses as 12 numbers, the rows of camera_from_world [R t] (x right, y down, z forward).

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const add = (a, b, scale = 1) => a.map((value, k) => value + scale * b[k]);
export const norm = (a) => Math.sqrt(dot(a, a));
export const unit = (a) => a.map((value) => value / (norm(a) || 1));

/** Row `k` of the rotation: the camera's axis in the world. */
export const axis = (pose, k) => pose.slice(4 * k, 4 * k + 3);

/** The camera's centre in the world. */
export function centreOf(pose) {
  return [0, 1, 2].map((k) => -(pose[k] * pose[3] + pose[4 + k] * pose[7] + pose[8 + k] * pose[11]));
}

/** The camera at `centre` with these axes in the world. */
export function poseAt(right, down, forward, centre) {
  return [right, down, forward].flatMap((row) => [...row, -dot(row, centre)]);
}

/**
 * The camera at `centre` that looks along `forward` with its image's down direction as close to `down` as
 * possible.
 */
export function lookAlong(centre, forward, down) {
  const z = unit(forward);
  const x = unit(cross(down, z));
  return poseAt(x, cross(z, x), z, centre);
}

/** Rotates `vector` by `angle` about the unit vector `about`. */
export function turned(vector, about, angle) {
  const c = Math.cos(angle);
  const s = Math.sin(angle);
  const side = cross(about, vector);
  const along = dot(about, vector) * (1 - c);
  return vector.map((value, k) => value * c + side[k] * s + about[k] * along);
}

/** Unit quaternion wxyz of a pose's rotation. */
export function quaternionOf(p) {
  const trace = p[0] + p[5] + p[10];
  const q = [
    1 + trace, 1 + p[0] - p[5] - p[10], 1 - p[0] + p[5] - p[10], 1 - p[0] - p[5] + p[10],
  ].map((value) => Math.sqrt(Math.max(0, value)) / 2);
  const largest = q.indexOf(Math.max(...q));
  const skew = [p[9] - p[6], p[2] - p[8], p[4] - p[1]];
  const even = { 12: p[1] + p[4], 13: p[2] + p[8], 23: p[6] + p[9] };
  const rows = [
    [4 * q[0] * q[0], ...skew],
    [skew[0], 4 * q[1] * q[1], even[12], even[13]],
    [skew[1], even[12], 4 * q[2] * q[2], even[23]],
    [skew[2], even[13], even[23], 4 * q[3] * q[3]],
  ];
  return rows[largest].map((value) => value / (4 * q[largest]));
}

/** Interpolates two cameras: centres linearly, rotations along the shorter arc. */
export function between(a, b, share) {
  const qa = quaternionOf(a);
  let qb = quaternionOf(b);
  let cosine = qa.reduce((sum, value, k) => sum + value * qb[k], 0);
  if (cosine < 0) {
    qb = qb.map((value) => -value);
    cosine = -cosine;
  }
  const angle = Math.acos(Math.min(1, cosine));
  const [wa, wb] = angle < 1e-6 ? [1 - share, share]
    : [Math.sin((1 - share) * angle) / Math.sin(angle), Math.sin(share * angle) / Math.sin(angle)];
  const q = qa.map((value, k) => wa * value + wb * qb[k]);
  const centre = centreOf(a).map((value, k) => (1 - share) * value + share * centreOf(b)[k]);
  return poseOfQuaternion(q, centre);
}

/** The camera at `centre` with the rotation of a quaternion wxyz of any norm. */
export function poseOfQuaternion(quaternion, centre) {
  const length = Math.hypot(...quaternion);
  const [w, x, y, z] = quaternion.map((value) => value / length);
  return poseAt([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], centre);
}

/** Pose at `u`, 0 the start and 1 the end of the exposure that `poses` sample. */
export function poseInExposure(poses, u) {
  const place = Math.min(1, Math.max(0, u)) * (poses.length - 1);
  const left = Math.min(Math.floor(place), Math.max(0, poses.length - 2));
  return poses.length === 1 ? poses[0] : between(poses[left], poses[left + 1], place - left);
}

/** Rotates the camera about `target`: `yaw` about the world's down, `pitch` about its own right. */
export function orbit(pose, target, down, yaw, pitch) {
  const right = turned(axis(pose, 0), down, yaw);
  const turn = (vector) => turned(turned(vector, down, yaw), right, pitch);
  const forward = turn(axis(pose, 2));
  const centre = add(target, turn(add(centreOf(pose), target, -1)));
  // Beyond the pole the picture would turn upside down; near it, only motion away from it is allowed.
  const steep = Math.abs(dot(forward, down));
  if (steep > 0.995 && steep > Math.abs(dot(axis(pose, 2), down)) + 1e-9) return pose;
  return lookAlong(centre, forward, turn(axis(pose, 1)));
}

/** Rotates the camera about its own centre. */
export function look(pose, down, yaw, pitch) {
  return orbit(pose, centreOf(pose), down, yaw, pitch);
}

/** Moves the camera along its own axes. */
export function moved(pose, [x, y, z]) {
  return [...pose.slice(0, 3), pose[3] - x, ...pose.slice(4, 7), pose[7] - y, ...pose.slice(8, 11), pose[11] - z];
}
