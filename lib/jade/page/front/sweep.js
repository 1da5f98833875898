// SPDX-License-Identifier: Apache-2.0
// The page of a sweep: the state of its runs, its tables, and the pictures of all rows side by side. Pictures
// and reports are files beside the page.

import { DIFFERENCE, Layers, SCENE } from './layers.js';
import { make, shortcut, tableIn } from './elements.js';

const TRUTH = 'truth';
const MARKS = { finished: '✓', failed: '✗', running: '▸', unfinished: '…', new: '·' };
const part = (id) => document.getElementById(id);
const SEED_NOISE = 0.3; // dB between two runs that differ only in their seed
const byNumber = (a, b) => a.seed - b.seed;

/** The URL of a file beside the page; its name may contain any byte. */
export function addressOf(path) {
  return path.split('/').map(encodeURIComponent).join('/');
}

/** Label of a row among the pictures: its title, with its name if the title is not unique. */
function labelOf({ name, title }, rows) {
  const alone = ![TRUTH, SCENE, DIFFERENCE].includes(title) && rows.filter((row) => row.title === title).length === 1;
  return alone ? title : `${title} (${name})`;
}

/**
 * Entry of each row in the pictures of a view: {title, src, psnr, best, run, reason}, every title
 * once. `best` leads all others by more than the seeds' noise. The run is that of the lowest seed with a picture; without a picture, the reason says why.
 */
export function picturesOf(data, scene, view) {
  const entries = data.rows.flatMap((row) => {
    const { name } = row;
    const title = labelOf(row, data.rows);
    const runs = data.runs.filter((run) => run.row === name && run.scene === scene).sort(byNumber);
    if (runs.length === 0) return [];
    const run = runs.find((each) => each.views[view]?.src);
    if (run) return [{ title, run, src: run.views[view].src, psnr: run.views[view].psnr }];
    const failed = runs.find((each) => each.state === 'failed');
    const first = failed ?? runs[0];
    const reason = first.state === 'finished' ? 'no picture of this view' : `${first.state}${first.reason ? `: ${first.reason}` : ''}`;
    return [{ title, run: first, src: null, reason }];
  });
  const [most, second] = [...entries.map(({ psnr }) => psnr ?? -Infinity), -Infinity, -Infinity].sort((a, b) => b - a);
  return entries.map((entry) => ({ ...entry, best: entry.psnr === most && most - second > SEED_NOISE }));
}

/**
 * Title of a row that `row`, one of the best in column k, leads by no more than the seeds' noise, or '' if the lead is significant.
 * @param noise  of the column, the least margin if either row has a single seed
 */
export function levelWith({ rows }, k, row, noise) {
  const { mean, deviation } = row.cells[k];
  const measured = (value) => typeof value === 'number';
  const margin = (other) => Math.max((deviation ?? 0) + (other ?? 0), measured(deviation) && measured(other) ? 0 : noise);
  const level = ({ cells: { [k]: cell } }) => cell.best || Math.abs(mean - cell.mean) <= margin(cell.deviation);
  return rows.find((each) => each !== row && typeof each.cells[k].mean === 'number' && !each.cells[k].gap && level(each))?.title ?? '';
}

/** {heading, views}: those seen in training, those not seen, and those of unknown kind. */
export function groupsOf(views) {
  return [['Seen in training', true], ['Not seen in training', false], ['Test views', null]]
    .map(([heading, seen]) => ({ heading, views: views.filter((view) => view.seen === seen) }))
    .filter((group) => group.views.length > 0);
}

export class SweepPage {
  constructor(data) {
    this.data = data;
    this.layers = new Layers({
      left: part('left'), right: part('right'), bar: part('bar'), leftTag: part('left-tag'), rightTag: part('right-tag'),
      leftSelect: part('left-layer'), rightSelect: part('right-layer'),
    }, () => {});
    part('left').addEventListener('load', () => this.fit(part('left')));
    part('right').addEventListener('load', () => this.fit(part('right')));
    part('swap').addEventListener('click', () => this.layers.swap());
    part('previous').addEventListener('click', () => this.step(-1));
    part('next').addEventListener('click', () => this.step(1));
    part('compare').addEventListener('keydown', (event) => this.key(event));
  }

  write() {
    const { data } = this;
    document.title = `${data.title} · JADE-GS`;
    part('title').textContent = data.title;
    part('note').textContent = data.note;
    part('facts').textContent = data.facts.join(' · ');
    this.writeGlance();
    this.writeRuns();
    data.tables.forEach((table, k) => this.writeTable(part(k === 0 ? 'first-table' : 'tables'), table));
    part('more-tables').hidden = data.tables.length < 2;
    for (const scene of data.scenes) this.writeScene(scene);
    const any = data.runs.some((run) => Object.keys(run.views).length > 0);
    part('pictures-note').textContent = any ? 'Test views of every row in the table’s order, with PSNR; one that leads by more than 0.3 dB is framed. '
      + 'Choose one to wipe it against the truth or another row.'
      : 'No run has finished yet, or none has test views.';
    for (const { heading, meaning } of data.columns) {
      make('dt', part('columns'), { textContent: heading });
      make('dd', part('columns'), { textContent: meaning });
    }
    part('missing').hidden = data.remarks.length === 0;
    for (const remark of data.remarks) make('li', part('remarks'), { textContent: remark });
  }

  writeGlance() {
    const { finished, runs_total: total, runs, tables, columns } = this.data;
    const failed = runs.filter((run) => run.state === 'failed').length;
    const card = (label, value, note, kind = '') => {
      const box = make('div', part('glance'), { className: `card ${kind}` });
      make('dt', box, { textContent: label });
      make('dd', box, { textContent: value });
      make('dd', box, { textContent: note, className: 'note' });
    };
    card('finished', `${finished} of ${total} runs`, total - finished - failed > 0 ? `${total - finished - failed} to go` : 'none to go');
    if (failed > 0) card('failed', String(failed), 'below with their reasons', 'bad');
    columns.slice(0, 3).forEach((column, k) => {
      const row = tables[0]?.rows.find((each) => each.cells[k].best);
      if (!row) return;
      const level = levelWith(tables[0], k, row, column.noise);
      card(column.heading, row.cells[k].text.split(' ')[0], level ? `${row.title}, level with ${level}` : row.title, k === 0 && !level ? 'best' : '');
    });
  }

  /** Table of rows by scenes, with a mark per seed that links to its report. */
  writeRuns() {
    const { rows, scenes, runs } = this.data;
    const body = tableIn(part('runs'), 'Runs by row and scene', ['row', ...scenes.map(({ name }) => name)]);
    for (const { name, title } of rows) {
      const line = make('tr', body);
      make('th', line, { textContent: title, scope: 'row' });
      for (const scene of scenes) {
        const cell = make('td', line);
        for (const run of runs.filter((each) => each.row === name && each.scene === scene.name).sort(byNumber)) addChip(cell, run);
      }
    }
  }

  writeTable(parent, table) {
    const { title, paper, rows } = table;
    make('h3', parent, { textContent: title });
    const head = this.data.columns.flatMap(({ heading }, k) => (paper[k] ? [heading, 'paper'] : [heading]));
    const body = tableIn(parent, title, ['', ...head]);
    let block = '';
    for (const row of rows) {
      if (row.block && row.block !== block) {
        make('th', make('tr', body, { className: 'block' }), { textContent: row.block, colSpan: head.length + 1, scope: 'rowgroup' });
      }
      block = row.block;
      const line = make('tr', body);
      make('th', line, { textContent: row.title, scope: 'row' });
      row.cells.forEach((cell, k) => {
        const level = cell.best ? levelWith(table, k, row, this.data.columns[k].noise) : '';
        const kind = cell.best && !level ? 'best' : cell.gap ? 'gap' : '';
        make('td', line, { textContent: cell.text, className: kind, title: level ? `level with ${level}` : '' });
        if (paper[k]) make('td', line, { textContent: cell.paper ?? '', className: 'paper' });
      });
    }
  }

  writeScene(scene) {
    const groups = groupsOf(scene.views);
    if (groups.length === 0) return;
    const box = make('section', part('pictures'));
    box.setAttribute('aria-label', `Pictures of ${scene.name}`);
    make('h3', box, { textContent: scene.name });
    for (const { heading, views } of groups) {
      const bar = make('div', box, { className: 'pick' });
      make('h4', bar, { textContent: heading });
      const select = make('select', make('label', bar, { textContent: 'view ' }));
      select.append(...views.map(({ name }) => new Option(name)));
      const grid = make('div', box, { className: 'figures' });
      select.onchange = () => this.fill(grid, scene, views[select.selectedIndex]);
      this.fill(grid, scene, views[0]);
    }
  }

  fill(grid, scene, view) {
    grid.replaceChildren();
    if (view.truth) this.figure(grid, scene, view, { title: TRUTH, src: view.truth });
    for (const entry of picturesOf(this.data, scene.name, view.name)) this.figure(grid, scene, view, entry);
  }

  figure(grid, scene, view, { title, src, psnr, best, run, reason }) {
    const seed = run && this.data.runs.some((each) => each.seed !== run.seed) ? `seed ${run.seed}` : '';
    const note = [typeof psnr === 'number' ? `${psnr.toFixed(2)} dB` : '', seed, reason ?? ''].filter((text) => text).join(' · ');
    if (!src) {
      const box = make('div', grid, { className: run.state === 'failed' ? 'none failed' : 'none' });
      make('span', box, { className: 'name', textContent: title });
      make('span', box, { className: 'note', textContent: note });
      return;
    }
    const button = make('button', grid, { type: 'button', className: best ? 'thumb leading' : 'thumb', title: 'compare' });
    make('img', button, { src: addressOf(src), alt: '', loading: 'lazy' });
    make('span', button, { className: 'name', textContent: title });
    make('span', button, { className: 'note', textContent: note });
    button.onclick = () => this.compare(scene, view, title);
  }

  // --- two pictures with a wipe between them

  compare(scene, view, title) {
    Object.assign(this, { scene, view });
    Object.assign(this.layers, { left: TRUTH, right: title, wipe: 0.5 });
    part('compare').showModal();
    return this.show();
  }

  show() {
    const { scene, view } = this;
    const seen = { true: ', seen in training', false: ', not seen in training' }[view.seen] ?? '';
    part('compare-title').textContent = `${scene.name}, view ${view.name}${seen}`;
    const rows = picturesOf(this.data, scene.name, view.name).filter(({ src }) => src)
      .map(({ title, src, psnr }) => ({ name: title, src: addressOf(src), note: typeof psnr === 'number' ? `${psnr.toFixed(2)} dB` : '' }));
    const truth = view.truth ? [{ name: TRUTH, src: addressOf(view.truth) }] : [];
    part('previous').disabled = part('next').disabled = scene.views.length < 2;
    if (this.layers.left === this.layers.right && rows.length > 0) this.layers.right = rows[0].name;
    return this.layers.setPictures([...truth, ...rows], []);
  }

  step(by) {
    const { views } = this.scene;
    this.view = views[(views.indexOf(this.view) + by + views.length) % views.length];
    return this.show();
  }

  key(event) {
    const call = { '[': () => this.step(-1), ']': () => this.step(1), x: () => this.layers.swap() }[shortcut(event)];
    if (!call) return;
    event.preventDefault();
    call();
  }

  fit(image) {
    part('stage').style.setProperty('--aspect', `${image.naturalWidth} / ${image.naturalHeight}`);
    part('stage').style.setProperty('--ratio', image.naturalWidth / image.naturalHeight);
  }
}

function addChip(parent, { seed, state, reason, report }) {
  const chip = make(report ? 'a' : 'span', parent, { textContent: `${seed} ${MARKS[state]}` });
  chip.className = `chip ${['finished', 'failed'].includes(state) ? state : 'waiting'}`;
  const words = `seed ${seed}: ${state}${reason ? `: ${reason}` : ''}${report ? '; its report' : ''}`;
  chip.title = words;
  chip.setAttribute('aria-label', words);
  if (report) chip.href = addressOf(report);
  else chip.setAttribute('role', 'img');
}
