// SPDX-License-Identifier: Apache-2.0
// Parts of the report below the scene: headline figures, views, tables, curves.

import { MAPS } from './layers.js';
import { make, tableIn } from './elements.js';

const at = (id) => document.getElementById(id);
const METRICS = {
  psnr: 'PSNR', psnr_channel_mean: 'PSNR, mean of channels', ssim: 'SSIM', lpips_alex01: 'LPIPS', lpips_vgg: 'LPIPS (VGG)', psnr_reblur: 're-blur PSNR',
};

/** @param onPick  called with a view and the name of one of its pictures */
export function writeReport(data, onPick) {
  at('title').textContent = document.title = data.title;
  const seconds = trainingSeconds(data.metrics);
  at('facts').textContent = [...data.facts, ...(seconds > 0 ? [`trained for ${duration(seconds)}`] : [])].join(' · ');
  at('verdict').textContent = verdict(data.headline) ?? '';
  at('verdict').hidden = !at('verdict').textContent;
  at('config').textContent = data.config;
  writeGlance(at('glance'), data);
  for (const view of data.views) strip(at('views'), 'h3', view, onPick);
  const groups = [['Seen in training', true], ['Not seen in training', false], ['Test views', null]];
  for (const [title, seen] of groups) {
    const views = data.tests.filter((view) => view.seen === seen);
    if (views.length === 0) continue;
    make('h3', at('tests'), { textContent: `${title}${meanNote(data.evaluation, seen)}` });
    for (const view of views) strip(at('tests'), 'h4', view, onPick);
  }
  writeScores(at('scores'), data.evaluation);
  at('tests').closest('.part').hidden = data.tests.length === 0 && !data.evaluation;
  at('allocation-part').hidden = !data.allocation.mean;
  if (data.allocation.mean) writeAllocation(at('allocation'), data.allocation);
  writeCurves(at('charts'), at('other-charts'), withFinalScores(data.metrics, data.evaluation));
  at('charts').closest('.part').hidden = at('charts').childElementCount + at('other-charts').childElementCount === 0;
  foldOnPhones();
}

/** On a phone, sections are collapsed to their headings; a tap opens one. */
export function foldOnPhones() {
  if (matchMedia('(max-width: 600px)').matches) for (const part of document.querySelectorAll('details.part')) part.open = false;
}

/** Total seconds of the logged steps. */
export function trainingSeconds(metrics) {
  let [seconds, before] = [0, 0];
  for (const { step, iterations_per_second: rate } of metrics) {
    if (!(rate > 0)) continue;
    seconds += (step - before) / rate;
    before = step;
  }
  return seconds;
}

/** "45 s", "7 min 33 s" or "2 h 5 min". */
export function duration(seconds) {
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  return `${Math.floor(whole / 3600)} h ${Math.floor(whole / 60) % 60} min`;
}

/** One sentence that compares the scene with its frames, or null without true images. */
export function verdict(headline) {
  if (!headline) return null;
  const gain = headline.render - headline.blurry;
  if (gain < 0) return `${(-gain).toFixed(1)} dB below the blurry frames: see docs/troubleshooting.md`;
  const behind = Math.max(headline.edi, headline.efnet ?? -Infinity) - headline.render;
  return `${gain.toFixed(1)} dB sharper than the frames${behind >= 0.05 ? `, ${behind.toFixed(1)} dB behind the best 2D restoration` : ''}`;
}

/** The headline figures: {label, value, note, best, worse}; `worse` marks a scene below the blurry frames. */
export function glanceFigures({ headline, evaluation, metrics }) {
  const decibels = (value) => `${value.toFixed(2)} dB`;
  const similarity = (mean) => (typeof mean?.ssim === 'number' ? `SSIM ${mean.ssim.toFixed(3)}` : '');
  const figures = [];
  if (headline) {
    const over = (value) => `${value >= headline.blurry ? '+' : '−'}${Math.abs(value - headline.blurry).toFixed(2)} dB`;
    figures.push({ label: 'blurry frame', value: decibels(headline.blurry), note: `mid-exposure, ${headline.views} with truth` });
    const learned = typeof headline.efnet === 'number' && headline.efnet > headline.edi;
    const restored = learned ? headline.efnet : headline.edi;
    figures.push({ label: `best 2D restoration (${learned ? 'EFNet' : 'EDI'})`, value: decibels(restored), note: over(restored), best: restored > headline.render });
    const unseen = evaluation?.mean_unseen;
    const note = [over(headline.render), similarity(evaluation?.mean_seen), unseen ? `unseen views ${decibels(unseen.psnr)}` : '', similarity(unseen)];
    figures.push({ label: 'this scene', value: decibels(headline.render), note: note.filter(Boolean).join(', '), best: headline.render >= restored, worse: headline.render < headline.blurry });
  }
  for (const [label, mean] of [['seen test views', evaluation?.mean_seen], ['unseen test views', evaluation?.mean_unseen],
    ['test views', evaluation?.mean_seen || evaluation?.mean_unseen ? null : evaluation?.mean]]) {
    // The headline already compares the seen test views, or others taken at the same time.
    if (headline || typeof mean?.psnr !== 'number') continue;
    figures.push({ label, value: decibels(mean.psnr), note: similarity(mean) });
  }
  const explained = evaluation?.mean?.psnr_reblur;
  if (!headline && typeof explained === 'number') {
    figures.push({ label: 'held-out re-blur PSNR', value: decibels(explained), note: 're-blurred render against frames that training has not seen' });
  }
  if (figures.length === 0) {
    const last = metrics.filter((line) => typeof line.psnr_train === 'number').pop();
    if (last) figures.push({ label: 're-blur PSNR', value: decibels(last.psnr_train), note: 're-blurred render against its frame' });
  }
  return figures;
}

function writeGlance(parent, data) {
  writeCards(parent, glanceFigures(data));
}

export function writeCards(parent, figures) {
  for (const { label, value, note, best, worse } of figures) {
    const card = make('div', parent, { className: `card${best && !worse ? ' best' : ''}${worse ? ' worse' : ''}` });
    make('dt', card, { textContent: label });
    make('dd', card, { textContent: value });
    make('dd', card, { textContent: note, className: 'note' });
  }
}

function meanNote(evaluation, seen) {
  const mean = { true: evaluation?.mean_seen, false: evaluation?.mean_unseen, null: null }[seen];
  return mean ? `: ${mean.psnr.toFixed(2)} dB` : '';
}

function strip(parent, heading, view, onPick) {
  const box = make('section', parent, { className: 'view' });
  make(heading, box, { textContent: view.name });
  const row = make('div', box, { className: 'strip' });
  for (const picture of view.pictures) {
    const button = make('button', row, { type: 'button', className: 'thumb', title: 'show above' });
    make('img', button, { src: picture.src, alt: '', loading: 'lazy', className: MAPS.includes(picture.name) ? 'map' : '' });
    make('span', button, { textContent: picture.note ? `${picture.name} ${picture.note}` : picture.name });
    button.setAttribute('aria-label', `${picture.name} ${picture.note ?? ''} of ${view.name}: show above`);
    button.onclick = () => onPick(view, picture.name);
  }
}

function table(parent, label, head, rows) {
  const body = tableIn(parent, label, head);
  for (const row of rows) {
    const line = make('tr', body);
    row.forEach((cell, k) => make(k === 0 ? 'th' : 'td', line, { textContent: shown(cell), ...(k === 0 ? { scope: 'row' } : {}) }));
  }
}

function shown(cell) {
  return typeof cell === 'number' ? cell.toFixed(Math.abs(cell) > 2 ? 2 : 4) : cell ?? '-';
}

export function writeScores(parent, evaluation) {
  if (!evaluation) return;
  const mark = ({ seen }) => (typeof seen === 'boolean' ? (seen ? 'seen' : 'unseen') : '-');
  const means = [['mean of seen', evaluation.mean_seen], ['mean of unseen', evaluation.mean_unseen], ['mean', evaluation.mean]];
  const metrics = Object.keys(METRICS).filter((key) => [...evaluation.views, evaluation.mean].some((scores) => typeof scores?.[key] === 'number'));
  table(parent, 'Scores of the test views', ['view', 'in training', ...metrics.map((key) => METRICS[key])], [
    ...evaluation.views.map((view) => [view.name, mark(view), ...metrics.map((key) => view[key])]),
    ...means.filter(([, mean]) => mean).map(([name, mean]) => [name, '', ...metrics.map((key) => mean[key])]),
  ]);
  const list = make('ul', parent, { className: 'facts' });
  for (const key of metrics) make('li', list, { textContent: `${METRICS[key]}: ${evaluation.definitions[key]}` });
}

function writeAllocation(parent, { views, mean }) {
  const keys = ['alpha_mean', 'alpha_std', 'alpha_min', 'alpha_max', 'alpha_correlation', 'choice_right', 'choice_gain_db'];
  table(parent, 'Allocation by view', ['view', 'α mean', 'α std', 'least', 'largest', 'correlation with event density', 'right choice', 'gain, dB'],
    [...views.map((view) => [view.name, ...keys.map((key) => view[key])]), ['all', ...keys.map((key) => mean[key])]]);
  const spread = mean.alpha_correlation_std === null ? '' : ` ± ${mean.alpha_correlation_std.toFixed(4)} (sample deviation)`;
  make('p', parent, { className: 'facts', textContent: `Pearson's r over the pixels of a view; over the views ${mean.alpha_correlation.toFixed(4)}${spread}.` });
  if (typeof mean.choice_gain_db === 'number') {
    const text = 'Right choice: share of the pixels where α > ½ and EDI is nearer to the sharp test view at mid-exposure, or α ≤ ½ and EFNet is. '
      + 'Gain: PSNR of the mix less that of the better of the two.';
    make('p', parent, { className: 'facts', textContent: text });
  }
}

/** The lines of metrics.jsonl, with the final test scores in that of the last step. */
export function withFinalScores(metrics, evaluation) {
  const step = metrics.reduce((most, line) => Math.max(most, line.step ?? 0), 0);
  const mean = evaluation?.mean;
  if (typeof mean?.psnr !== 'number' || metrics.some((line) => line.step === step && 'test_psnr' in line)) return metrics;
  return [...metrics, { step, test_psnr: mean.psnr, test_ssim: mean.ssim }];
}

const FIRST_CURVES = { loss: 'loss', psnr_train: 're-blur PSNR, dB', test_psnr: 'test PSNR, dB', gaussians: 'Gaussians' };

/**
 * Draws the curves of FIRST_CURVES into `parent` and all others into `more`.
 * @param metrics  objects with `step` and numbers
 */
export function writeCurves(parent, more, metrics) {
  const keys = new Set([...Object.keys(FIRST_CURVES), ...metrics.flatMap((line) => Object.keys(line))]);
  keys.delete('step');
  for (const key of keys) {
    const points = metrics.filter((line) => typeof line[key] === 'number').map((line) => [line.step, line[key]]);
    if (points.length > 1) chart(key in FIRST_CURVES ? parent : more, FIRST_CURVES[key] ?? key, points);
  }
  more.parentElement.hidden = more.childElementCount === 0;
}

/** Three digits: thousands as k, millions as M, and powers of ten beyond these and below 0.0001. */
export function short(value) {
  const rounded = Number(value.toPrecision(3));
  const size = Math.abs(rounded);
  if (size >= 1e9 || (size > 0 && size < 1e-4)) {
    const [factor, exponent] = rounded.toExponential().split('e');
    return `${factor}·10${[...String(Number(exponent))].map((sign) => (sign === '-' ? '⁻' : '⁰¹²³⁴⁵⁶⁷⁸⁹'[sign])).join('')}`;
  }
  if (size >= 1e6) return `${rounded / 1e6}M`;
  return size >= 1e4 ? `${rounded / 1e3}k` : String(rounded);
}

function chart(parent, name, points) {
  const [width, height] = [275, 160];
  const margin = { left: 52, right: 8, top: 22, bottom: 20 };
  const space = 'http://www.w3.org/2000/svg';
  const range = (k) => points.reduce(([low, high], point) => [Math.min(low, point[k]), Math.max(high, point[k])], [Infinity, -Infinity]);
  const [[x0, x1], [y0, y1]] = [range(0), range(1)];
  const svg = parent.appendChild(document.createElementNS(space, 'svg'));
  svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
  svg.setAttribute('role', 'img');
  svg.setAttribute('aria-label', `${name} from ${short(points[0][1])} to ${short(points[points.length - 1][1])}`);
  const draw = (tag, attributes, text = '') => {
    const element = svg.appendChild(document.createElementNS(space, tag));
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    element.textContent = text;
  };
  const across = (x) => margin.left + (width - margin.left - margin.right) * (x - x0) / (x1 - x0 || 1);
  const up = (y) => height - margin.bottom - (height - margin.top - margin.bottom) * (y - y0) / (y1 - y0 || 1);
  draw('text', { x: margin.left, y: 14 }, name);
  draw('text', { x: margin.left - 4, y: margin.top + 8, 'text-anchor': 'end' }, short(y1));
  draw('text', { x: margin.left - 4, y: height - margin.bottom, 'text-anchor': 'end' }, short(y0));
  draw('text', { x: margin.left, y: height - 6 }, short(x0));
  draw('text', { x: width - margin.right, y: height - 6, 'text-anchor': 'end' }, `step ${short(x1)}`);
  draw('text', { x: width - margin.right, y: 14, 'text-anchor': 'end', class: 'last' }, short(points[points.length - 1][1]));
  draw('polyline', { points: points.map(([x, y]) => `${across(x).toFixed(1)},${up(y).toFixed(1)}`).join(' '), class: 'curve' });
}
