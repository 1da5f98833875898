#!/usr/bin/env node
// SPDX-License-Identifier: Apache-2.0
// Checks the front end of the report's and the sweep's page (lib/jade/page/front) without anything to
// install.
//
//     node scripts/lint_front.mjs [FOLDER]
//
// Every module must parse, alone and joined with the others of its page as in lib/jade/page/embed.cmake: a
// name that two modules declare does not. Imports are one line each, of modules above in the page's list that
// export the name, and must be used. No var, ==, console, eval or innerHTML; no requests, except in live.js
// to the page's own server; lines up to 200 columns; every id in the code must be in the page, once.
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';

const here = dirname(fileURLToPath(import.meta.url));
const folder = process.argv[2] ?? join(here, '../lib/jade/page/front');
const FORBIDDEN = [
  [/\bvar\s/, 'var; use const or let'], [/[^=!]==[^=]/, '==; use ==='], [/!=[^=]/, '!=; use !=='],
  [/\bconsole\b/, 'console'], [/\beval\b/, 'eval'], [/\binnerHTML\b/, 'innerHTML; use textContent'],
  [/\bfetch\(|XMLHttpRequest|https?:\/\/(?!www\.w3\.org\/2000\/svg)/, 'a request; the page stands alone'],
];
const problems = [];
const pages = [['page.html', 'modules.txt'], ['sweep.html', 'sweep_modules.txt']];
const listed = pages.flatMap(([html, list]) => checkPage(html, list));
for (const file of readdirSync(folder)) {
  if (file.endsWith('.js') && !listed.includes(file)) problems.push(`${file}: not in ${pages.map(([, list]) => list).join(' or ')}`);
}
for (const problem of problems) process.stdout.write(`${problem}\n`);
process.stdout.write(problems.length > 0 ? `${problems.length} problems with the front end\n` : 'the front end is clean\n');
process.exit(problems.length > 0 ? 1 : 0);

/** The modules of a page. */
function checkPage(html, list) {
  const modules = readFileSync(join(folder, list), 'utf8').trim().split('\n');
  const exported = new Map();
  for (const file of modules) check(file, readFileSync(join(folder, file), 'utf8'), exported);
  checkIds(html, modules);
  parse(modules.map((file) => readFileSync(join(folder, file), 'utf8').replace(/^import .*$/gm, '').replace(/^export /gm, '')).join('\n'), `all modules of ${list} joined`);
  return modules;
}

function check(file, text, exported) {
  if (!text.startsWith('// SPDX-License-Identifier: Apache-2.0\n')) problems.push(`${file}:1: expected the SPDX line`);
  const shader = file === 'shaders.js';
  text.split('\n').forEach((line, index) => {
    const place = `${file}:${index + 1}`;
    if (/\s$|\t/.test(line)) problems.push(`${place}: blanks at the end, or a tab`);
    if (line.length > 200) problems.push(`${place}: ${line.length} columns, at most 200`);
    const code = shader ? line : line.replace(/\/\/ .*$|^\s*\/?\*.*$/, '');
    for (const [pattern, what] of FORBIDDEN) {
      if (pattern.test(code) && !(file === 'live.js' && /\bfetch\(/.test(code) && !/https?:/.test(code))) problems.push(`${place}: ${what}`);
    }
    if (/^\s*import\b/.test(line)) checkImport(place, line, text, exported);
    if (/^export\b/.test(line) && !/^export (async )?(function|class|const) /.test(line)) {
      problems.push(`${place}: expected export function, class or const`);
    }
  });
  exported.set(file, [...text.matchAll(/^export (?:async )?(?:function|class|const) (\w+)/gm)].map((match) => match[1]));
  parse(text, file);
}

function checkImport(place, line, text, exported) {
  const match = line.match(/^import \{ ([\w, ]+) \} from '\.\/(\w+\.js)';$/);
  if (!match) {
    problems.push(`${place}: expected import { names } from './module.js'; in one line`);
    return;
  }
  if (!exported.has(match[2])) problems.push(`${place}: ${match[2]} does not stand above in its list`);
  for (const name of match[1].split(', ')) {
    if (exported.has(match[2]) && !exported.get(match[2]).includes(name)) problems.push(`${place}: ${match[2]} exports no ${name}`);
    if (text.split(new RegExp(`\\b${name}\\b`)).length < 3) problems.push(`${place}: ${name} is not used`);
  }
}

function checkIds(html, modules) {
  const ids = [...readFileSync(join(folder, html), 'utf8').matchAll(/\bid="([\w-]+)"/g)].map((match) => match[1]);
  for (const id of new Set(ids)) if (ids.filter((other) => other === id).length > 1) problems.push(`${html}: the id ${id} twice`);
  for (const file of modules) {
    for (const match of readFileSync(join(folder, file), 'utf8').matchAll(/\b(?:element|at|on|part)\('([a-z-]+)'/g)) {
      if (!ids.includes(match[1])) problems.push(`${file}: ${html} has no id ${match[1]}`);
    }
  }
}

function parse(text, name) {
  const place = mkdtempSync(join(tmpdir(), 'lint-'));
  try {
    writeFileSync(join(place, 'module.mjs'), text);
    execFileSync(process.execPath, ['--check', join(place, 'module.mjs')], { stdio: 'pipe' });
  } catch (error) {
    problems.push(`${name}: ${String(error.stderr).split('\n').filter((line) => /Error|^\s*\S/.test(line)).slice(1, 5).join(' | ')}`);
  } finally {
    rmSync(place, { recursive: true });
  }
}
