// SPDX-License-Identifier: Apache-2.0
// View state stored in a link: the camera (or the pose, if the user has left it), the moment of the exposure,
// the two layers, the wipe, and whether events are shown.

/** @param view  {camera: 'train.3', pose: null or 12 numbers, moment, left, right, wipe, events} */
export function formatLink(view) {
  const parts = new URLSearchParams({ camera: view.camera, u: round(view.moment), left: view.left, right: view.right, wipe: round(view.wipe) });
  if (view.events) parts.set('events', '1');
  if (view.pose) parts.set('pose', view.pose.map((value) => Number(value.toPrecision(8))).join(','));
  return `#${parts}`;
}

/** Parses a link of formatLink(); missing or damaged parts are omitted. */
export function parseLink(hash) {
  const parts = new URLSearchParams(hash.replace(/^#/, ''));
  const view = {};
  const share = (text) => (text !== null && text !== '' && Number(text) >= 0 && Number(text) <= 1 ? Number(text) : undefined);
  if (/^(train|test)\.\d+$/.test(parts.get('camera') ?? '')) view.camera = parts.get('camera');
  for (const [key, name] of [['moment', 'u'], ['wipe', 'wipe']]) {
    if (share(parts.get(name)) !== undefined) view[key] = share(parts.get(name));
  }
  for (const key of ['left', 'right']) if (parts.get(key)) view[key] = parts.get(key);
  if (parts.get('events') === '1') view.events = true;
  const pose = (parts.get('pose') ?? '').split(',').map(Number);
  if (pose.length === 12 && pose.every(Number.isFinite)) view.pose = pose;
  return view;
}

function round(share) {
  return String(Math.round(share * 1e4) / 1e4);
}
