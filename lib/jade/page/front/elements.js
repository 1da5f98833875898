// SPDX-License-Identifier: Apache-2.0
// Elements that both pages are made of.

/** A new element at the end of `parent`, with properties. */
export const make = (tag, parent, props = {}) => parent.appendChild(Object.assign(document.createElement(tag), props));

/** Whether keys typed there are text, or choose among words, and so none of ours. */
export function takesText({ tagName, type }) {
  return tagName === 'SELECT' || tagName === 'TEXTAREA' || (tagName === 'INPUT' && type !== 'range' && type !== 'checkbox');
}

/**
 * The key of a shortcut in lower case, or '' where text is typed or a modifier makes it the browser's. Alt, and
 * AltGr, which comes as both Ctrl and Alt, write the brackets on many keyboards.
 */
export function shortcut({ key, ctrlKey, metaKey, altKey, target }) {
  const writes = altKey && '[]'.includes(key);
  return takesText(target) || ((ctrlKey || metaKey || altKey) && !writes) ? '' : key.toLowerCase();
}

/** Whether the space bar presses it. */
export function takesSpace({ tagName, type }) {
  return tagName === 'BUTTON' || tagName === 'SUMMARY' || type === 'checkbox';
}

/** An empty table that scrolls sideways where it must, with a name for screen readers; its body. */
export function tableIn(parent, label, head) {
  const box = make('div', parent, { className: 'scroll', tabIndex: 0 });
  box.setAttribute('role', 'region');
  box.setAttribute('aria-label', label);
  const whole = make('table', box);
  const top = make('tr', make('thead', whole));
  for (const text of head) make('th', top, { textContent: text, scope: 'col' });
  return make('tbody', whole);
}
