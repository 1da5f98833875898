// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace jade::run {

/// The report's page: its script draws what the JSON in place of @DATA@ holds, and needs nothing
/// from outside the file.
inline constexpr char kReportPage[] = R"PAGE(<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>JADE-GS report</title>
<style>
:root { color-scheme: light dark; --line: #8884; --soft: #8882; --accent: #0a7d57; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1180px; margin: 2rem auto; padding: 0 1rem; }
h1 { margin-bottom: 0; } h2 { margin-top: 2.5rem; border-bottom: 1px solid var(--line); }
table { border-collapse: collapse; } th, td { padding: .25rem .9rem; text-align: right; border-bottom: 1px solid var(--line); }
th:first-child, td:first-child { text-align: left; } tr:last-child td { font-weight: 600; }
.facts { color: gray; } .strip { display: flex; flex-wrap: wrap; gap: .5rem; }
figure { margin: 0; } figcaption { font-size: 12px; color: gray; text-align: center; }
.strip img { width: 158px; image-rendering: pixelated; cursor: pointer; border: 2px solid transparent; }
.strip img.on { border-color: var(--accent); }
.compare { position: relative; width: min(100%, 720px); margin: .6rem 0; touch-action: none; user-select: none; }
.compare img { width: 100%; display: block; image-rendering: pixelated; pointer-events: none; }
.compare .over { position: absolute; inset: 0; overflow: hidden; }
.compare .bar { position: absolute; top: 0; bottom: 0; width: 2px; background: #fff; box-shadow: 0 0 4px #000; }
.compare .tag { position: absolute; bottom: 6px; padding: 0 .5em; background: #000a; color: #fff; font-size: 13px; }
.charts { display: grid; grid-template-columns: repeat(auto-fill, minmax(340px, 1fr)); gap: 1rem; }
.charts svg { width: 100%; background: var(--soft); border-radius: 4px; }
.charts text { fill: currentColor; font-size: 11px; } details pre { overflow: auto; background: var(--soft); padding: 1rem; }
</style></head><body>
<h1>JADE-GS</h1><p class="facts" id="facts"></p>
<h2>Sharp views from blurry frames</h2><div id="views"></div>
<h2>Test views</h2><div id="tests"></div><div id="scores"></div>
<h2>Allocation</h2><div id="allocation"></div>
<h2>Training</h2><div class="charts" id="charts"></div>
<h2>Settings</h2><details><summary>config.yaml</summary><pre id="config"></pre></details>
<script>
const data = @DATA@;
const at = id => document.getElementById(id);
const make = (tag, parent, props = {}) => parent.appendChild(Object.assign(document.createElement(tag), props));
at('facts').textContent = data.facts.join(' · ');
at('config').textContent = data.config;

// A wipe between two pictures of one view: click a picture to put it on the right.
function viewer(parent, view) {
  make('h3', parent, {textContent: view.name});
  const names = view.pictures.map(p => p.name);
  const box = make('div', parent, {className: 'compare'});
  const right = make('img', box), over = make('div', box, {className: 'over'});
  const left = make('img', over, {src: view.pictures[0].src});
  const bar = make('div', box, {className: 'bar'});
  make('span', box, {className: 'tag', textContent: names[0]}).style.left = '6px';
  const tag = make('span', box, {className: 'tag'}); tag.style.right = '6px';
  const place = f => { f = Math.min(1, Math.max(0, f)); over.style.clipPath = `inset(0 ${100 - 100 * f}% 0 0)`; bar.style.left = 100 * f + '%'; };
  const follow = e => { const r = box.getBoundingClientRect(); place((e.clientX - r.left) / r.width); };
  box.onpointerdown = e => { box.setPointerCapture(e.pointerId); follow(e); };
  box.onpointermove = e => { if (e.buttons) follow(e); };
  place(.5);
  const strip = make('div', parent, {className: 'strip'});
  view.pictures.forEach((p, i) => {
    const figure = make('figure', strip), img = make('img', figure, {src: p.src});
    make('figcaption', figure, {textContent: p.name + (p.note ? ' ' + p.note : '')});
    img.onclick = () => { right.src = p.src; tag.textContent = p.name; strip.querySelectorAll('img').forEach(o => o.className = ''); img.className = 'on'; };
    if (i === view.show) img.onclick();
  });
}
data.views.forEach(v => viewer(at('views'), v));
data.tests.forEach(v => viewer(at('tests'), v));

function table(parent, head, rows) {
  const t = make('table', parent), h = make('tr', t);
  head.forEach(c => make('th', h, {textContent: c}));
  rows.forEach(r => { const line = make('tr', t); r.forEach(c => make('td', line, {textContent: typeof c === 'number' ? c.toFixed(Math.abs(c) > 2 ? 2 : 4) : c ?? '-'})); });
}
if (data.evaluation) {
  const keys = ['psnr', 'psnr_channel_mean', 'ssim', 'lpips_alex01', 'lpips_vgg', 'psnr_reblur'];
  const e = data.evaluation, mark = v => typeof v.seen === 'boolean' ? (v.seen ? 'seen' : 'unseen') : '-';
  const means = [['mean of seen', e.mean_seen], ['mean of unseen', e.mean_unseen], ['mean', e.mean]].filter(m => m[1]);
  table(at('scores'), ['view', 'in training', ...keys], [...e.views.map(v => [v.name, mark(v), ...keys.map(k => v[k])]), ...means.map(([name, m]) => [name, '', ...keys.map(k => m[k])])]);
  const list = make('ul', at('scores'), {className: 'facts'});
  keys.forEach(k => make('li', list, {textContent: k + ': ' + data.evaluation.definitions[k]}));
}
if (data.allocation.mean) {
  const keys = ['alpha_mean', 'alpha_std', 'alpha_min', 'alpha_max', 'alpha_correlation', 'choice_right', 'choice_gain_db'], all = data.allocation.mean;
  table(at('allocation'), ['view', 'α mean', 'α std', 'least', 'largest', 'correlation with event density', 'right choice', 'gain, dB'],
        [...data.allocation.views.map(v => [v.name, ...keys.map(k => v[k])]), ['all', ...keys.map(k => all[k])]]);
  make('p', at('allocation'), {className: 'facts', textContent: 'Pearson\'s r over the pixels of a view; over the views ' + all.alpha_correlation.toFixed(4) + (all.alpha_correlation_std === null ? '' : ' ± ' + all.alpha_correlation_std.toFixed(4) + ' (sample deviation).')});
  if (typeof all.choice_gain_db === 'number') make('p', at('allocation'), {className: 'facts', textContent: 'Right choice: share of the pixels where α > ½ and EDI is nearer to the sharp test view at mid-exposure, or α ≤ ½ and EFNet is. Gain: PSNR of the mix less that of the better of the two.'});
} else at('allocation').textContent = 'This run has no allocation map.';

function chart(name, points) {
  const W = 340, H = 170, m = {l: 46, r: 8, t: 22, b: 20}, ns = 'http://www.w3.org/2000/svg';
  const xs = points.map(p => p[0]), ys = points.map(p => p[1]);
  const x0 = Math.min(...xs), x1 = Math.max(...xs), y0 = Math.min(...ys), y1 = Math.max(...ys);
  const X = x => m.l + (W - m.l - m.r) * (x - x0) / (x1 - x0 || 1), Y = y => H - m.b - (H - m.t - m.b) * (y - y0) / (y1 - y0 || 1);
  const svg = at('charts').appendChild(document.createElementNS(ns, 'svg')); svg.setAttribute('viewBox', `0 0 ${W} ${H}`);
  const el = (t, a, s) => { const e = svg.appendChild(document.createElementNS(ns, t)); for (const k in a) e.setAttribute(k, a[k]); if (s !== undefined) e.textContent = s; };
  el('text', {x: m.l, y: 14}, name);
  const short = v => Math.abs(v) >= 1e6 ? (v / 1e6).toPrecision(3) + 'M' : Math.abs(v) >= 1e4 ? (v / 1e3).toPrecision(3) + 'k' : +v.toPrecision(3);
  el('text', {x: m.l - 4, y: m.t + 8, 'text-anchor': 'end'}, short(y1)); el('text', {x: m.l - 4, y: H - m.b, 'text-anchor': 'end'}, short(y0));
  el('text', {x: m.l, y: H - 6}, short(x0)); el('text', {x: W - m.r, y: H - 6, 'text-anchor': 'end'}, 'step ' + short(x1));
  el('polyline', {points: points.map(p => X(p[0]).toFixed(1) + ',' + Y(p[1]).toFixed(1)).join(' '), fill: 'none', stroke: '#0a7d57', 'stroke-width': 1.4});
}
const keys = new Set(); data.metrics.forEach(line => Object.keys(line).forEach(k => k !== 'step' && keys.add(k)));
keys.forEach(k => { const points = data.metrics.filter(l => typeof l[k] === 'number').map(l => [l.step, l[k]]); if (points.length > 1) chart(k, points); });
</script></body></html>
)PAGE";

}  // namespace jade::run
