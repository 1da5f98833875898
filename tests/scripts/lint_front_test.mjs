// SPDX-License-Identifier: Apache-2.0
// Tests that scripts/lint_front.mjs finds faults, in copies of the front end with one fault each.
import assert from 'node:assert/strict';
import { cpSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { spawnSync } from 'node:child_process';
import { tmpdir } from 'node:os';
import { dirname, join } from 'node:path';
import test from 'node:test';
import { fileURLToPath } from 'node:url';

const root = join(dirname(fileURLToPath(import.meta.url)), '../..');

function lint(change) {
  const folder = mkdtempSync(join(tmpdir(), 'front-'));
  try {
    cpSync(join(root, 'lib/jade/page/front'), folder, { recursive: true });
    change(folder);
    return spawnSync(process.execPath, [join(root, 'scripts/lint_front.mjs'), folder], { encoding: 'utf8' });
  } finally {
    rmSync(folder, { recursive: true });
  }
}

const append = (file, text) => (folder) => writeFileSync(join(folder, file), readFileSync(join(folder, file), 'utf8') + text);

test('lint_front: the front end as it is passes', () => {
  assert.equal(lint(() => {}).status, 0);
});

for (const [what, change, message] of [
  ['a syntax error', append('link.js', 'const = 1;\n'), /link\.js: .*SyntaxError/],
  ['a name of two modules', append('link.js', 'function chart() {}\n'), /all modules of modules\.txt joined: .*SyntaxError/],
  ['a loose comparison', append('link.js', 'if (1 == 2) short();\n'), /link\.js:\d+: ==; use ===/],
  ['a request', append('link.js', "fetch('x');\n"), /link\.js:\d+: a request/],
  ['an import from below', append('spz.js', "import { Page } from './main.js';\nPage();\n"), /main\.js does not stand above/],
  ['a missing export', append('main.js', "import { nothing } from './spz.js';\nnothing();\n"), /spz\.js exports no nothing/],
  ['an unused import', append('main.js', "import { short } from './report.js';\n"), /short is not used/],
  ['a missing id', append('main.js', "element('nowhere');\n"), /page\.html has no id nowhere/],
  ['an unlisted module', (folder) => writeFileSync(join(folder, 'more.js'), ''), /more\.js: not in modules\.txt or sweep_modules\.txt/],
  ['a missing id of the other page', append('sweep.js', "part('nowhere');\n"), /sweep\.html has no id nowhere/],
  ['a name of two modules of the other page', append('sweep.js', 'const SCENE = 1;\n'), /all modules of sweep_modules\.txt joined: .*SyntaxError/],
]) {
  test(`lint_front: finds ${what}`, () => {
    const { status, stdout } = lint(change);
    assert.equal(status, 1);
    assert.match(stdout, message);
  });
}
