// SPDX-License-Identifier: Apache-2.0
// DOM helpers shared by both pages.

/** Appends a new element with properties to `parent`. */
export const make = (tag, parent, props = {}) => parent.appendChild(Object.assign(document.createElement(tag), props));

/** Whether typed keys belong to the element: text input or a choice of words. */
export function takesText({ tagName, type }) {
  return tagName === 'SELECT' || tagName === 'TEXTAREA' || (tagName === 'INPUT' && type !== 'range' && type !== 'checkbox');
}

/**
 * The key of a shortcut in lower case, or '' if text is typed or a modifier makes it the browser's. Alt is
 * allowed, and AltGr, which is reported as both Ctrl and Alt: many keyboards need them for brackets.
 */
export function shortcut({ key, ctrlKey, metaKey, altKey, target }) {
  const writes = altKey && '[]'.includes(key);
  return takesText(target) || ((ctrlKey || metaKey || altKey) && !writes) ? '' : key.toLowerCase();
}

/** Whether the space bar activates it. */
export function takesSpace({ tagName, type }) {
  return tagName === 'BUTTON' || tagName === 'SUMMARY' || type === 'checkbox';
}

/**
 * Appends an empty table that scrolls sideways if needed, with a label for screen readers; returns its body.
 */
export function tableIn(parent, label, head) {
  const box = make('div', parent, { className: 'scroll', tabIndex: 0 });
  box.setAttribute('role', 'region');
  box.setAttribute('aria-label', label);
  const whole = make('table', box);
  const top = make('tr', make('thead', whole));
  for (const text of head) make('th', top, { textContent: text, scope: 'col' });
  return make('tbody', whole);
}
