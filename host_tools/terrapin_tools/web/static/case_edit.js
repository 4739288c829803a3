// What can be changed of a case and taken back: undo and redo, which runs are held out, known constants.
import { h } from './app.js';

const UNDO = 'Undo: case.toml as it was before the last change (Control+Z)';

/** Undo and redo: buttons, and Ctrl-Z, Ctrl-Y where nobody types. */
export class Steps {
  /** @param {CasePage} page */
  constructor(page) {
    this.page = page;
    this.map = false;
    /** @param {string} text @param {string} sign @param {string} what @param {string} keys */
    const button = (text, sign, what, keys) => h('button', { type: 'button', text: sign, 'aria-label': text, disabled: true, title: `${what} (${keys})`, 'aria-keyshortcuts': keys, onclick: () => this.go(text.toLowerCase()) });
    this.undo = button('Undo', '↶', 'Undo: case.toml as it was before the last change', 'Control+Z');
    this.redo = button('Redo', '↷', 'Redo: the change that was undone, again', 'Control+Y');
    this.element = h('span', { class: 'steps' }, this.undo, this.redo);
    this.key = this.key.bind(this);
    addEventListener('keydown', this.key);
  }

  close() { removeEventListener('keydown', this.key); }

  async ask() {
    try {
      const { undo, redo, map } = await this.page.app.api(`${this.page.path}/steps`);
      this.map = !undo && Boolean(map); // the making of the case itself
      this.undo.title = this.map ? 'Undo: back to the mapping of the columns (Control+Z)' : UNDO;
      this.undo.disabled = !undo && !map;
      this.redo.disabled = !redo;
    } catch { /* the view says what is wrong */ }
  }

  /** @param {string} way */
  async go(way) {
    if (way === 'undo' && this.map) { await this.unmap(); return; }
    if (await this.page.run({ do: way })) this.page.app.announce(`${way === 'undo' ? 'Undone' : 'Done again'}`);
  }

  /** The case goes, and its columns are being mapped again as they were. */
  async unmap() {
    const { app, path, folder, view } = this.page;
    if (view?.discovered && !confirm('Take the making of the case back, and map its columns again? What discover found goes with it.')) return;
    try { await app.api(`${path}/unmap`, { method: 'POST' }); } catch (error) { this.page.complain(error); return; }
    app.showCommand(`rm -r ${folder}`);
    app.announce('Undone: the columns are being mapped again');
    app.go('workbench');
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const field = event.target instanceof HTMLInputElement || event.target instanceof HTMLTextAreaElement;
    if (field || !(event.ctrlKey || event.metaKey) || event.altKey || !this.element.getClientRects().length) return;
    const key = event.key.toLowerCase(), way = key === 'y' || (key === 'z' && event.shiftKey) ? this.redo : key === 'z' ? this.undo : null;
    if (!way) return;
    event.preventDefault();
    if (!way.disabled) way.click();
  }
}

/** Runs, each with a box that holds it out. @param {CasePage} page @param {View} view */
export function heldOut(page, view) {
  const { runs } = view.plot, all = runs.length;
  if (all < 2) return null;
  const boxes = runs.map((run) => h('input', { type: 'checkbox', value: run, checked: view.held_out.includes(run), onchange: () => { changed(); } }));
  const apply = h('button', { type: 'button', text: 'Hold these out', disabled: true, onclick: () => page.run({ do: 'hold', runs: boxes.filter((box) => box.checked).map((box) => box.value) }) });
  const said = h('span', { class: 'soft small' });
  const changed = () => {
    const held = boxes.filter((box) => box.checked).length, same = boxes.every((box) => box.checked === view.held_out.includes(box.value));
    apply.disabled = same || held === all;
    said.textContent = held === all ? 'At least one run has to train the model.' : same ? '' : `${held} of ${all}`;
  };
  return h('section', { class: 'panel', 'aria-label': 'Held-out runs' }, h('h2', { text: 'Held-out runs' }),
    h('p', { class: 'soft small', text: 'The model is fitted on the others; its error on these says whether it holds.' }),
    h('div', { class: 'run-boxes scroll', tabindex: '0', role: 'region', 'aria-label': 'Runs' }, runs.map((run, i) => h('label', {}, boxes[i], run))), h('div', { class: 'row' }, apply, said));
}

/** Known constants: as written, in SI, and whether somebody has confirmed them. @param {CasePage} page @param {View} view */
export function constants(page, view) {
  if (!view.constants.length) return null;
  return h('section', { class: 'panel', 'aria-label': 'Known constants' }, h('h2', { text: 'Known constants' }),
    h('table', { class: 'inputs constants' }, h('thead', {}, h('tr', {}, ['constant', 'as stated', 'in SI'].map((text) => h('th', { scope: 'col', text })))),
      h('tbody', {}, view.constants.map((one) => {
        const input = h('input', { type: 'text', value: one.text, maxlength: '60', 'aria-label': `${one.name}, with its unit`, onchange: () => { void set(); } });
        const set = () => {
          const value = input.value.trim();
          if (value) return page.run({ do: 'constant', name: one.name, value });
          page.complain(new Error(`${one.name}: found nothing, expected a number and its unit, such as ${one.text}`));
          return null;
        };
        return h('tr', {}, h('th', { scope: 'row', text: one.name }), h('td', {}, input), h('td', { class: 'soft' }, one.si, one.guessed ? h('button', { type: 'button', class: 'act', text: 'Check', title: 'A guess that nobody has confirmed: press when it is right', 'aria-label': `Confirm ${one.name}`, onclick: () => { void set(); } }) : null));
      }))));
}
