// SPDX-License-Identifier: Apache-2.0
// Starts the sweep's page. Scripts have the same functions through `window.jade`.

import { SweepPage } from './sweep.js';

const sweepPage = new SweepPage(JSON.parse(document.getElementById('data').textContent));
sweepPage.write();
window.jade = sweepPage;
document.documentElement.dataset.ready = 'sweep';
