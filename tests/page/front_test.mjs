// SPDX-License-Identifier: Apache-2.0
// Tests of the front end's modules without a browser: node --test tests/page/front_test.mjs
import assert from 'node:assert/strict';
import test from 'node:test';
import { gzipSync } from 'node:zlib';
import { mkdtempSync, readFileSync, readdirSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { dirname, join } from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';

// The modules are .js without a package.json that declares them as modules; node needs one.
const front = join(dirname(fileURLToPath(import.meta.url)), '../../lib/jade/page/front');
const copy = mkdtempSync(join(tmpdir(), 'front-'));
for (const file of readdirSync(front)) writeFileSync(join(copy, file), readFileSync(join(front, file)));
writeFileSync(join(copy, 'package.json'), '{"type": "module"}');
const load = (name) => import(pathToFileURL(join(copy, name)).href);
const { parseSpz, gunzipBase64 } = await load('spz.js');
const pose = await load('pose.js');
const { Sorter, shadesOf, sortByDepth } = await load('sort.js');
const { CameraPath } = await load('path.js');
const { formatLink, parseLink } = await load('link.js');
const { ratioLimits } = await load('renderer.js');
const { absoluteDifference } = await load('layers.js');
const { EventFilm } = await load('events.js');
const { Pace, Viewer } = await load('viewer.js');
const { duration, glanceFigures, short, trainingSeconds, verdict, withFinalScores } = await load('report.js');
const { frustumEdges, outsideness, shadeOf } = await load('frusta.js');
const { addressOf, groupsOf, levelWith, picturesOf } = await load('sweep.js');
const { shortcut, takesSpace, takesText } = await load('elements.js');
const live = await load('live.js');

const near = (a, b, tolerance = 1e-9) => a.forEach((value, k) => assert.ok(Math.abs(value - b[k]) < tolerance, `${a} against ${b}`));
const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];

/** One Gaussian: position (1, 2, 3) in this library's axes, rotated 90° about x, scales e^-2, e^-1, 1. */
function spzBytes() {
  const bytes = new Uint8Array(16 + 19 + 9);
  const view = new DataView(bytes.buffer);
  view.setUint32(0, 0x5053474e, true);
  view.setUint32(4, 2, true);
  view.setUint32(8, 1, true);
  bytes.set([1, 12, 1, 0], 12);
  [1, -2, -3].forEach((value, k) => {
    const fixed = value * 4096;
    bytes.set([fixed & 255, (fixed >> 8) & 255, (fixed >> 16) & 255], 16 + 3 * k);
  });
  bytes[25] = 51; // opacity 0.2
  bytes.set([255, 128, 0], 26);
  bytes.set([128, 144, 160], 29);
  bytes.set([Math.round((Math.SQRT1_2 + 1) * 127.5), 128, 127], 32);
  bytes.set([1, 2, 3, 4, 5, 6, 7, 8, 9], 35);
  return bytes;
}

test('spz: a Gaussian comes out in our axes', () => {
  const scene = parseSpz(spzBytes());
  assert.equal(scene.count, 1);
  assert.equal(scene.degree, 1);
  assert.equal(scene.antialiased, true);
  near([...scene.positions], [1, 2, 3]);
  near([...scene.opacities], [0.2], 1e-6);
  // About x by 90°: y and z change places.
  const [xx, xy, xz, yy, yz, zz] = scene.covariances;
  near([xx, yy, zz], [Math.exp(-4), 1, Math.exp(-2)], 0.02);
  near([xy, xz, yz], [0, 0, 0], 0.02);
  assert.deepEqual([...scene.colors.subarray(0, 13)], [255, 128, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 128]);
});

test('spz: gzip in base64 unpacks, and what is no .spz is named', async () => {
  const packed = gzipSync(spzBytes()).toString('base64');
  assert.deepEqual(await gunzipBase64(packed), spzBytes());
  assert.throws(() => parseSpz(new Uint8Array(40)), /expected \.spz/);
  assert.throws(() => parseSpz(spzBytes().subarray(0, 43)), /expected 1 Gaussians in 44 bytes, found 43/);
});

test('sort: far to near, without what is nearer than the near plane', () => {
  const positions = new Float32Array([0, 0, 2, 0, 0, 5, 0, 0, 0.1, 0, 0, 3, 0, 0, 5]);
  const { order, nearest, farthest } = sortByDepth(positions, [0, 0, 1, 0], 0.2);
  assert.deepEqual([...order], [4, 1, 3, 0]);
  near([nearest, farthest], [2, 5]);
  assert.equal(sortByDepth(positions, [0, 0, 1, -10], 0.2).order.length, 0);
});

test('sort: any order of many agrees with sorting their depths', () => {
  let seed = 1;
  const random = () => { seed = (seed * 16807) % 2147483647; return seed / 2147483647; };
  const positions = Float32Array.from({ length: 3000 }, () => random() * 4);
  const depth = (i) => 0.6 * positions[3 * i] + 0.8 * positions[3 * i + 2] + 1;
  const { order } = sortByDepth(positions, [0.6, 0, 0.8, 1], 0.01);
  assert.equal(new Set(order).size, 1000);
  for (let k = 1; k < order.length; ++k) assert.ok(depth(order[k - 1]) > depth(order[k]) - 6 / 65535);
});

test('sort: colours follow the direction, in the order given, and are not negative', () => {
  const scene = { positions: new Float32Array([0, 0, 0, 5, 5, 5]), degree: 1, colors: new Uint8Array(96).fill(128) };
  // Constant terms: byte 127.5 is ½; the second Gaussian is as bright as it gets.
  scene.colors.set([127, 127, 0], 0);
  scene.colors.set([255, 255, 255], 48);
  // y, z and x of degree 1, for red and green.
  scene.colors.set([192, 128, 128], 3);
  scene.colors.set([128, 192, 128], 6);
  const [r2, , , r, g, b] = shadesOf(scene, [1, 0], [0, -1, 0]);
  near([r2], [0.5 + 0.28209479177387814 / 0.3], 1e-6);
  // Down in this library's axes is −y in the file's: basis −0.4886 · (−1), coefficient ½.
  near([r, g, b], [0.5 + 0.5 * 0.4886025 - 0.0037, 0.5 - 0.0037, 0], 1e-3);
  const [ahead] = [shadesOf(scene, [0], [0, 0, -1])];
  near([ahead[0], ahead[1]], [0.5 - 0.0037, 0.5 - 0.5 * 0.4886025 - 0.0037], 1e-3);
  scene.degree = 0;
  near([...shadesOf(scene, [0], [0, -1, 0])].slice(0, 2), [0.4963, 0.4963], 1e-3);
});

test('sort: the newest request wins, and without a worker the answer is the same', async () => {
  const scene = { positions: new Float32Array([0, 0, 2, 0, 0, 5]), degree: 0, colors: new Uint8Array(96) };
  const sorter = new Sorter(scene, 0.2);
  assert.equal(sorter.worker, null); // node has no Worker of this kind
  const sorted = await sorter.request(IDENTITY);
  assert.deepEqual([...sorted.order], [1, 0]);
  assert.equal(sorted.shades.length, 6);
  const sent = [];
  sorter.worker = { postMessage: (from) => sent.push(from.view[3]) };
  const answers = [1, 2, 3].map((shift) => sorter.request([...IDENTITY.slice(0, 11), shift]));
  assert.deepEqual(sent, [1]);
  sorter.done('first');
  sorter.done('third');
  assert.deepEqual(await Promise.all(answers), ['first', null, 'third']);
  assert.deepEqual(sent, [1, 3]);
  // A worker that fails leaves no request pending.
  const left = [sorter.request(IDENTITY), sorter.request(IDENTITY)];
  sorter.lose();
  for (const answer of await Promise.all(left)) assert.deepEqual([...answer.order], [1, 0]);
  assert.equal((await sorter.request(IDENTITY)).shades.length, 6);
});

test('viewer: a picture is of its own view, whatever draws come first', async () => {
  const sorter = new Sorter({ positions: new Float32Array(3), degree: 0, colors: new Uint8Array(48) }, 0.2);
  sorter.worker = { postMessage() {} };
  const drawn = [];
  const renderer = { setOrder() {}, show() {}, draw: (_, at) => drawn.push(at), picture: () => drawn.at(-1) };
  const viewer = Object.assign(Object.create(Viewer.prototype), { renderer, sorter, native: true, onFrame() {} });
  const other = [...IDENTITY.slice(0, 11), 1];
  viewer.draw(null, other);
  const picture = viewer.picture(null, IDENTITY);
  viewer.draw(null, other);
  while (sorter.busy) sorter.done({});
  assert.equal(await picture, IDENTITY);
});

test('pose: quaternions, between and the way through an exposure', () => {
  const turned = pose.poseOfQuaternion([0.5, -0.5, 0.5, 0.5], [1, 2, 3]);
  near(pose.centreOf(turned), [1, 2, 3]);
  near(pose.quaternionOf(turned).map((v) => v * Math.sign(pose.quaternionOf(turned)[0])), [0.5, -0.5, 0.5, 0.5]);
  for (const q of [[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) {
    near(pose.quaternionOf(pose.poseOfQuaternion(q, [0, 0, 0])).map(Math.abs), q);
  }
  near(pose.between(IDENTITY, turned, 0), IDENTITY);
  near(pose.between(IDENTITY, turned, 1), turned);
  const shifted = [...IDENTITY];
  shifted[3] = -2;
  near(pose.centreOf(pose.poseInExposure([IDENTITY, shifted, turned], 0.25)), [1, 0, 0]);
  near(pose.poseInExposure([IDENTITY, shifted, turned], 1), turned);
  near(pose.poseInExposure([turned], 0.3), turned);
});

test('pose: orbit keeps the distance and looks at the target; look keeps the place', () => {
  const target = [0, 0, 4];
  const there = pose.orbit(IDENTITY, target, [0, 1, 0], 0.3, -0.2);
  const centre = pose.centreOf(there);
  assert.ok(Math.abs(pose.norm(pose.add(target, centre, -1)) - 4) < 1e-9);
  near(pose.axis(there, 2), pose.unit(pose.add(target, centre, -1)));
  assert.ok(pose.norm(pose.add(centre, [0, 0, 0], -1)) > 1);
  near(pose.centreOf(pose.look(there, [0, 1, 0], 0.4, 0.1)), centre);
  near(pose.centreOf(pose.moved(there, [0, 0, 1])), pose.add(centre, pose.axis(there, 2)));
});

test('pose: who looks along the vertical may turn and leave it, but not cross it', () => {
  const down = [0, 1, 0];
  const along = pose.poseAt([1, 0, 0], [0, 0, -1], down, [0, 0, 0]);
  near(pose.axis(pose.look(along, down, 0.3, 0), 0), pose.turned([1, 0, 0], down, 0.3));
  for (const pitch of [-0.01, 0.01]) assert.ok(pose.axis(pose.look(along, down, 0, pitch), 2)[1] < 0.99996);
  const steep = pose.look(along, down, 0, 0.15); // more than the reserved 5.7 degrees
  for (const pitch of [-0.1, -0.2]) assert.equal(pose.look(steep, down, 0, pitch), steep);
});

test('path: goes through its keys and is what jade_render reads', () => {
  const path = new CameraPath();
  const camera = { width: 40, height: 30, fx: 50, fy: 51, cx: 20, cy: 15, poses: [] };
  const keys = [[0, 0, 0], [1, 0, 0], [1, 2, 0]].map((centre) => pose.poseOfQuaternion([1, 0.1, 0, 0], centre));
  keys.forEach((key) => path.add(camera, key));
  near(path.at(0.5), keys[1]);
  const { cameras, ...defaults } = JSON.parse(path.json(1, 10));
  assert.deepEqual(defaults, { width: 40, height: 30, fx: 50, fy: 51, cx: 20, cy: 15 });
  assert.equal(cameras.length, 21);
  assert.equal(cameras[20].name, '00020');
  near(cameras[20].camera_from_world.flat(), keys[2]);
  assert.equal(cameras[0].camera_from_world.length, 3);
  path.clear();
  path.add(camera, keys[0]);
  assert.equal(JSON.parse(path.json()).cameras.length, 1);
});

test('link: what is written is read, and damage is left out', () => {
  const view = { camera: 'train.3', pose: [...IDENTITY], moment: 0.25, left: '|difference|', right: 'α', wipe: 0.7 };
  assert.deepEqual(parseLink(formatLink(view)), view);
  assert.deepEqual(parseLink(formatLink({ ...view, events: true })), { ...view, events: true });
  assert.deepEqual(parseLink(formatLink({ ...view, events: false })), view);
  assert.equal(parseLink(formatLink({ ...view, pose: null })).pose, undefined);
  assert.deepEqual(parseLink('#camera=elsewhere.1&u=7&wipe=x&pose=1,2'), {});
  assert.deepEqual(parseLink(''), {});
});

test('renderer: the Jacobian is taken within 0.3 half fields beside the picture', () => {
  near(ratioLimits({ fx: 100, fy: 50, cx: 40, cy: 25, width: 100, height: 50 }), [-0.55, 0.75, -0.65, 0.65]);
});

test('events: signs come out by step, and fade with the distance from the moment', async () => {
  // 16 steps of 20 by 10 cells: in step 8 darker in cells 0 and 199, brighter in cell 130; cell 130 darker in step 9.
  const steps = Array.from({ length: 16 }, () => [0, 0]);
  steps[8] = [2, 0, 0xc6, 0x01, 1, 0x82, 0x01];
  steps[9] = [1, 0x82, 0x01, 0];
  const entry = { bins: 16, columns: 20, rows: 10, cell: 1, events: 4, packed: gzipSync(Uint8Array.from(steps.flat())).toString('base64') };
  const film = await EventFilm.unpack(entry);
  const pixel = (picture, cell) => [...picture.subarray(4 * cell, 4 * cell + 4)];
  const there = film.picture(8.5 / 16);
  assert.deepEqual([pixel(there, 0), pixel(there, 199), pixel(there, 130)], [[64, 132, 255, 255], [64, 132, 255, 255], [255, 56, 48, 255]]);
  assert.equal(there.filter((value, k) => k % 4 === 3 && value > 0).length, 3);
  assert.deepEqual(pixel(film.picture(8.6 / 16), 130).slice(0, 3), [255, 56, 48]); // the nearer step wins
  const later = film.picture(9.4 / 16);
  assert.deepEqual(pixel(later, 130).slice(0, 3), [64, 132, 255]);
  assert.ok(pixel(later, 0)[3] > 0 && pixel(later, 0)[3] < pixel(later, 130)[3]);
  assert.ok(film.picture(0.2).every((value) => value === 0));
  assert.throws(() => new EventFilm(entry, Uint8Array.of(0, 3, 1)), /end too soon/);
  // Cells of 8 pixels of which the last reach beyond a camera of 155 by 77.
  globalThis.ImageData = class { constructor(data, width) { Object.assign(this, { data, width }); } };
  const canvas = { style: {}, getContext: () => ({ putImageData: () => {} }) };
  film.cell = 8;
  film.paint(canvas, 0.5, { width: 155, height: 77 });
  assert.deepEqual([canvas.width, canvas.height], [20, 10]);
  near([parseFloat(canvas.style.width), parseFloat(canvas.style.height)], [100 * 160 / 155, 100 * 80 / 77]);
});

test('viewer: slow frames halve the size until the picture rests, and the whole size is tried again', () => {
  const pace = new Pace();
  for (let k = 0; k < 50; ++k) pace.took(16.7);
  assert.equal(pace.coarse, false);
  for (let k = 0; k < 20; ++k) pace.took(40);
  assert.equal(pace.coarse, true);
  for (let k = 0; k < 100; ++k) pace.took(16.7); // fast because they are small
  assert.equal(pace.coarse, true);
  assert.ok(pace.mean < 17);
  pace.took(300); // the page was hidden
  assert.ok(pace.mean < 17);
  for (let k = 0; k < 3; ++k) pace.rest();
  assert.equal(pace.coarse, false);
  pace.took(40);
  assert.equal(pace.coarse, false); // one late frame is not slow
});

test('layers: a difference is absolute, amplified and opaque', () => {
  assert.deepEqual([...absoluteDifference([10, 20, 200, 255], [12, 10, 0, 255], 4)], [8, 40, 255, 255]);
});

test('report: the glance compares with blurry and EDI, and says something in every case', () => {
  const headline = { views: 2, blurry: 20, edi: 19.5, efnet: null, render: 25.25 };
  const evaluation = { mean: { psnr: 24, ssim: 0.8 }, mean_seen: null, mean_unseen: null };
  const figures = glanceFigures({ headline, evaluation, metrics: [] });
  assert.deepEqual(figures.map(({ label, value, note }) => [label, value, note]), [
    ['blurry frame', '20.00 dB', 'mid-exposure, 2 with truth'], ['best 2D restoration (EDI)', '19.50 dB', '−0.50 dB'],
    ['this scene', '25.25 dB', '+5.25 dB']]);
  assert.deepEqual(figures.map(({ best, worse }) => [Boolean(best), Boolean(worse)]), [[false, false], [false, false], [true, false]]);
  // A restoration that beats the scene is green, and a scene below its frames is marked.
  const beaten = glanceFigures({ headline: { ...headline, efnet: 26, render: 19 }, evaluation, metrics: [] });
  assert.equal(beaten[1].label, 'best 2D restoration (EFNet)');
  assert.deepEqual(beaten.map(({ best, worse }) => [Boolean(best), Boolean(worse)]), [[false, false], [true, false], [false, true]]);
  assert.equal(verdict(headline), '5.3 dB sharper than the frames');
  assert.equal(verdict({ ...headline, efnet: 26 }), '5.3 dB sharper than the frames, 0.8 dB behind the best 2D restoration');
  assert.match(verdict({ ...headline, render: 19 }), /^1.0 dB below/);
  assert.equal(verdict(null), null);
  const split = glanceFigures({ headline: null, metrics: [],
    evaluation: { mean: { psnr: 1, ssim: 0 }, mean_seen: { psnr: 2, ssim: 0 }, mean_unseen: { psnr: 3, ssim: 0 } } });
  assert.deepEqual(split.map(({ label }) => label), ['seen test views', 'unseen test views']);
  const alone = glanceFigures({ headline: null, evaluation: null, metrics: [{ step: 1, psnr_train: 30 }, { step: 2, test_psnr: 1 }] });
  assert.equal(alone[0].value, '30.00 dB');
  const unseen = glanceFigures({ headline: null, metrics: [], evaluation: { mean: { psnr: null, ssim: null, psnr_reblur: 31.5 }, mean_seen: null, mean_unseen: null } });
  assert.deepEqual(unseen.map(({ label, value }) => [label, value]), [['held-out re-blur PSNR', '31.50 dB']]);
  assert.deepEqual([short(1234567), short(12345), short(0.00012345)], ['1.23M', '12.3k', '0.000123']);
  assert.deepEqual([0, 9999.6, 999999, 123456789012, 1e-7, -1.6e-5].map(short), ['0', '10k', '1M', '1.23·10¹¹', '1·10⁻⁷', '-1.6·10⁻⁵']);
});

test('report: no figure twice, and how long the steps took', () => {
  const headline = { views: 2, blurry: 20, edi: 19, render: 25 };
  const evaluation = { mean: { psnr: 24, ssim: 0.8 }, mean_seen: { psnr: 25, ssim: 0.85 }, mean_unseen: { psnr: 23, ssim: 0.75 } };
  const figures = glanceFigures({ headline, evaluation, metrics: [] });
  assert.deepEqual(figures.map(({ label }) => label), ['blurry frame', 'best 2D restoration (EDI)', 'this scene']);
  assert.equal(figures[2].note, '+5.00 dB, SSIM 0.850, unseen views 23.00 dB, SSIM 0.750');
  assert.equal(trainingSeconds([{ step: 100, iterations_per_second: 10 }, { step: 150, test_psnr: 1 }, { step: 200, iterations_per_second: 50 }]), 12);
  assert.equal(trainingSeconds([]), 0);
  assert.deepEqual([45.4, 453, 7500].map(duration), ['45 s', '7 min 33 s', '2 h 5 min']);
});

test('report: the final scores are the last point of their curves', () => {
  const lines = [{ step: 1, loss: 2 }, { step: 5, loss: 1, test_psnr: 20 }, { step: 9, loss: 0.5 }];
  assert.deepEqual(withFinalScores(lines, { mean: { psnr: 30, ssim: 0.9 } }).at(-1), { step: 9, test_psnr: 30, test_ssim: 0.9 });
  assert.equal(withFinalScores(lines, null), lines);
});

test('frusta: a recorded pose is inside, one turned away or far away is outside', () => {
  const turnedBy = (angle) => [Math.cos(angle), 0, -Math.sin(angle), 0, 0, 1, 0, 0, Math.sin(angle), 0, Math.cos(angle), 0];
  assert.equal(outsideness(IDENTITY, [IDENTITY], 2), 0);
  assert.ok(outsideness(turnedBy(0.2), [IDENTITY], 2) < 1);
  assert.ok(outsideness(turnedBy(0.6), [IDENTITY], 2) > 1);
  const shifted = [...IDENTITY];
  shifted[3] = 1;
  assert.ok(outsideness(shifted, [IDENTITY], 2) > 1);
  assert.ok(outsideness(shifted, [IDENTITY], 20) < 1);
  assert.deepEqual([0, 0.4, 0.65, 5].map(shadeOf), [0, 0, 0.5, 0.85]);
  const edges = frustumEdges(IDENTITY, { width: 4, height: 2, fx: 2, fy: 2, cx: 2, cy: 1 }, 1);
  assert.equal(edges.length, 8);
  assert.deepEqual(edges[0], [[0, 0, 0].map((zero) => -zero), [-1, -0.5, 1]]);
});

test('sweep: a lead within the noise of seeds is called level', () => {
  const row = (title, mean, deviation = null, gap = false) => ({ title, cells: [{ mean, deviation, gap }] });
  const level = (noise, first, ...others) => levelWith({ rows: [...others, first] }, 0, first, noise);
  assert.equal(level(0.3, row('a', 30.05), row('b', 30)), 'b');
  assert.equal(level(0.3, row('a', 31), row('b', 30.05), row('c', 30)), '');
  assert.equal(level(0.003, row('a', 0.85), row('b', 0.848)), 'b');
  assert.equal(level(0, row('a', 12), row('b', 12.1)), ''); // minutes
  // Rows with several seeds have their own noise, so the level row need not be the nearest one.
  assert.equal(level(0.3, row('a', 30.05, 0.01), row('b', 30, 0.01)), '');
  assert.equal(level(0.3, row('a', 30.05, 0.01), row('b', 30, 0.01), row('c', 29.9, 0.2)), 'c');
  // A single seed on either side has no noise of its own.
  assert.equal(level(0.3, row('a', 30.05, 0.01), row('b', 30)), 'b');
  assert.equal(level(0.3, row('a', 30.05), row('b', 30, 0.01)), 'b');
  assert.equal(level(0.3, row('a', 30.4, 0.01), row('b', 30)), '');
  assert.equal(level(0.3, row('a', 30.4, 0.5), row('b', 30)), 'b');
  // Two that are printed alike are both the best.
  const tie = { title: 'b', cells: [{ mean: 0.441, deviation: 0, best: true }] };
  assert.equal(level(0, row('a', 0.442, 0), tie), 'b');
  // Rows with missing seeds or without a value are no rivals.
  assert.equal(level(0.3, row('a', 30), row('b', 29.9, null, true), row('c', null)), '');
});

test('sweep: a picture per row, of the lowest seed that has one, and the reason where none has', () => {
  const run = (row, seed, state, views = {}, reason = '') => ({ row, scene: 'a', seed, state, views, reason });
  const data = {
    rows: [{ name: 'r', title: 'R' }, { name: 's', title: 'S' }, { name: 't', title: 'T' }, { name: 'u', title: 'U' }, { name: 'other', title: 'O' }],
    runs: [run('r', 10, 'finished', { v: { src: 'r10', psnr: 40 } }), run('r', 2, 'finished', { v: { src: 'r2', psnr: 31 } }), run('r', 0, 'failed', {}, 'NaN'),
      run('s', 0, 'new'), run('s', 1, 'failed', {}, 'NaN at 7'), run('t', 0, 'finished', { v: { src: null, psnr: 50 } }), run('u', 0, 'finished', { v: { src: 'u0', psnr: 32 } }),
      { ...run('other', 0, 'finished', { v: { src: 'o', psnr: 60 } }), scene: 'b' }],
  };
  assert.deepEqual(picturesOf(data, 'a', 'v').map(({ title, src, best, reason }) => [title, src, best, reason]), [
    ['R', 'r2', false, undefined], ['S', null, false, 'failed: NaN at 7'], ['T', null, false, 'no picture of this view'], ['U', 'u0', true, undefined]]);
  const close = { rows: data.rows, runs: [run('r', 0, 'finished', { v: { src: 'r', psnr: 30.05 } }), run('u', 0, 'finished', { v: { src: 'u', psnr: 30 } })] };
  assert.deepEqual(picturesOf(close, 'a', 'v').map(({ best }) => best), [false, false]);
  assert.deepEqual(picturesOf(data, 'a', 'elsewhere').map(({ best }) => best), [false, false, false, false]);
});

test('sweep: seen and unseen views apart, and addresses that any name survives', () => {
  const views = [{ name: 'p', seen: false }, { name: 'q', seen: true }, { name: 'r', seen: null }, { name: 's', seen: true }];
  assert.deepEqual(groupsOf(views).map(({ heading, views: of }) => [heading, of.map(({ name }) => name)]),
    [['Seen in training', ['q', 's']], ['Not seen in training', ['p']], ['Test views', ['r']]]);
  assert.equal(addressOf('runs/a b/50%#?.png'), 'runs/a%20b/50%25%23%3F.png');
});

test('sweep: rows of one title keep names of their own, also beside what the stage shows', () => {
  const rows = [{ name: 'a', title: 'Alone' }, { name: 'b', title: 'Alone' }, { name: 'c', title: 'truth' }, { name: 'd', title: 'D' }];
  const runs = rows.map(({ name }) => ({ row: name, scene: 's', seed: 0, state: 'finished', views: { v: { src: name, psnr: 1 } } }));
  assert.deepEqual(picturesOf({ rows, runs }, 's', 'v').map(({ title, src }) => [title, src]),
    [['Alone (a)', 'a'], ['Alone (b)', 'b'], ['truth (c)', 'c'], ['D', 'd']]);
});

test('live: never more pixels are asked for than the program draws', () => {
  const screen = { shown: 2000, ratio: 2, limit: 3, pixels: 1 << 22, native: false };
  assert.equal(live.askedScale({ width: 346, height: 260 }, screen), 3);
  assert.equal(live.askedScale({ width: 346, height: 260 }, { ...screen, native: true }), 1);
  for (const native of [false, true]) {
    for (const camera of [{ width: 2448, height: 2048 }, { width: 1280, height: 1024 }, { width: 1, height: 100000000 }]) {
      const scale = live.askedScale(camera, { ...screen, native });
      assert.ok(Math.round(camera.width * scale) * Math.round(camera.height * scale) <= 1 << 22, `${camera.width}`);
    }
  }
});

test('live: asks for the camera at whole pixels, with viewer and token', async () => {
  const asked = [];
  const answer = { status: 200, headers: new Map([['X-Step', '12'], ['X-Gaussians', '345']]), blob: async () => 'blob' };
  const link = new live.LiveLink('?token=abc', async (address, options) => { asked.push([address, options]); return answer; });
  const camera = { width: 81, height: 60, fx: 100, fy: 101, cx: 40.5, cy: 30 };
  assert.deepEqual(await link.frame(camera, IDENTITY, 1.5, 'color'), { blob: 'blob', step: 12, gaussians: 345, psnr: null });
  const parts = new URLSearchParams(asked[0][0].replace(/^frame\?/, ''));
  assert.equal(parts.get('token'), 'abc');
  assert.match(parts.get('viewer'), /^[a-z0-9]{12}$/);
  assert.equal(parts.get('pose'), IDENTITY.join(','));
  const [fx, fy, cx, cy, width, height] = parts.get('camera').split(',').map(Number);
  assert.deepEqual([width, height], [122, 90]);
  near([fx / 100, fy / 101, cx / 40.5, cy / 30], [122 / 81, 1.5, 122 / 81, 1.5]);
  assert.equal(parts.has('view'), false);
  answer.headers.set('X-Psnr', '27.25');
  assert.equal((await link.frame(camera, IDENTITY, 1, 'color', 'test.0')).psnr, 27.25);
  assert.equal(new URLSearchParams(asked.pop()[0].replace(/^frame\?/, '')).get('view'), 'test.0');
  assert.deepEqual(await link.picture('train.1', 'EDI'), { blob: 'blob', psnr: 27.25 });
  answer.status = 204;
  assert.equal(await link.frame(camera, IDENTITY, 1, 'color'), null);
  assert.equal(await link.picture('train.1', 'EDI'), null);
  Object.assign(answer, { status: 503, text: async () => 'no restorer\n' });
  assert.deepEqual(await link.picture('train.1', 'EFNet'), { reason: 'no restorer' });
  assert.deepEqual(await link.frame(camera, IDENTITY, 1, 'color'), { reason: 'no restorer' });
  assert.equal(await link.poses('train.1'), null);
  Object.assign(answer, { status: 200, json: async () => ({ poses: [IDENTITY] }) });
  assert.deepEqual(await link.poses('train.1'), [IDENTITY]);
  asked.splice(2);
  await link.pause(true);
  assert.deepEqual([asked[2][0].includes('on=1'), asked[2][1]], [true, { method: 'POST' }]);
  assert.equal(new live.LiveLink('').address('state', {}).includes('token'), false);
});

test('live: why nothing is drawn is reported once, and taken back when a frame comes', async () => {
  const told = [];
  const answers = [{ reason: 'no memory' }, { reason: 'no memory' }, null, { blob: 'blob' }, { blob: 'blob' }];
  const link = { frame: async () => answers.shift() };
  // Without its constructor, which starts polling.
  const viewer = Object.assign(Object.create(live.LiveViewer.prototype), {
    canvas: { clientWidth: 10 }, link, at: () => '', limit: 1, pixels: 1 << 22, trouble: '', onTrouble: (reason) => told.push(reason),
  });
  const frames = [];
  globalThis.devicePixelRatio = 1;
  while (answers.length > 0) frames.push(await viewer.fetch({ camera: { width: 10, height: 10 }, pose: IDENTITY }, 'color'));
  assert.deepEqual(frames, [null, null, null, { blob: 'blob' }, { blob: 'blob' }]);
  assert.deepEqual(told, ['no memory', '']);
});

test('live: metrics are gathered, thinned out ones and overlapping answers requested again', () => {
  const tail = new live.MetricsTail();
  const lines = [1, 2, 3].map((step) => ({ step }));
  assert.equal(tail.take({ generation: 0, count: 2, lines: lines.slice(0, 2) }), true);
  assert.equal(tail.take({ generation: 0, count: 2, lines: [] }), false);
  assert.equal(tail.take({ generation: 0, count: 3, lines: lines.slice(2) }), true);
  assert.deepEqual(tail.lines, lines);
  tail.take({ generation: 0, count: 3, lines: lines.slice(2) });
  assert.equal(tail.generation, -1);
  tail.take({ generation: 1, count: 1, lines: lines.slice(2) });
  assert.deepEqual([tail.generation, tail.lines], [1, lines.slice(2)]);
});

test('live: the figures are the newest, and a still scene has no steps', () => {
  const lines = [{ step: 5, psnr_train: 20, iterations_per_second: 3 }, { step: 10, psnr_train: 25.5 }, { step: 10, test_psnr: 24 }];
  const figures = live.liveFigures({ step: 10, steps: 20, gaussians: 1234, phase: 'training' }, lines);
  assert.deepEqual(figures.map(({ label, value }) => [label, value]),
    [['training', '50 %'], ['Gaussians', '1,234'], ['re-blur PSNR', '25.50 dB'], ['test views', '24.00 dB'], ['speed', '3.00 / s']]);
  assert.deepEqual(live.liveFigures({ step: 0, steps: 0, gaussians: 5, phase: 'still' }, []).map(({ label }) => label), ['Gaussians']);
});

test('live: a picture is judged by its truth, else by the last evaluation, else by the blur that it explains', () => {
  const state = { scored: { step: 1500, psnr: { 'test.1': 26.125 } } };
  const lines = [{ psnr_train: 30 }, { psnr_train: 31.5 }, { test_psnr: 25 }];
  assert.equal(live.judgement(28.456, 'test.1', state, lines), 'PSNR 28.46 dB');
  assert.equal(live.judgement(null, 'test.1', state, lines), 'PSNR 26.13 dB at step 1,500');
  assert.equal(live.judgement(null, 'test.0', state, lines), 're-blur PSNR 31.50 dB');
  assert.equal(live.judgement(null, '', state, lines), 're-blur PSNR 31.50 dB');
  assert.equal(live.judgement(null, '', null, []), '');
});

test('live: who loses the program learns whether the training had ended', () => {
  const settings = { report: 'runs/a/report.html', pausable: true };
  assert.match(live.farewell({ phase: 'finishing', step: 9, steps: 9 }, settings), /^Training has ended.*runs\/a\/report\.html/);
  assert.match(live.farewell({ phase: 'training', step: 9, steps: 9 }, settings), /^Training has ended/);
  assert.match(live.farewell({ phase: 'training', step: 4, steps: 9 }, settings), /has ended or cannot be reached.*--resume/);
  assert.match(live.farewell(null, { report: '', pausable: false }), /^jade_view has ended/);
});

test('keys: sliders and boxes take no text; what the space bar presses keeps it', () => {
  assert.deepEqual([['INPUT', 'range'], ['INPUT', 'checkbox'], ['BUTTON'], ['INPUT', 'number'], ['SELECT'], ['TEXTAREA']]
    .map(([tagName, type]) => takesText({ tagName, type })), [false, false, false, true, true, true]);
  const typed = (key, held = {}, tagName = 'BODY') => shortcut({ key, target: { tagName }, ...held });
  assert.deepEqual([typed('R'), typed('['), typed('[', { altKey: true }), typed(']', { altKey: true, ctrlKey: true })], ['r', '[', '[', ']']);
  assert.deepEqual([typed('r', { altKey: true }), typed('r', { ctrlKey: true }), typed('[', { metaKey: true }), typed('[', {}, 'SELECT')], ['', '', '', '']);
  assert.deepEqual([['SUMMARY'], ['BUTTON'], ['INPUT', 'checkbox'], ['INPUT', 'range'], ['DIV']].map(([tagName, type]) => takesSpace({ tagName, type })),
    [true, true, true, false, false]);
});

test('live: the blur is the mean of what came', () => {
  const mean = new Float32Array(2);
  [[0, 10], [4, 20], [8, 60]].forEach((values, k) => live.addToMean(mean, values, k + 1));
  near([...mean], [4, 30], 1e-5);
});
