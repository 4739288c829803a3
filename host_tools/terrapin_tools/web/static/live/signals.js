// The table of all signals: their values, a filter, and which are drawn.
import { h, number, told } from '../app.js';

/** @typedef {import('./telemetry.js').Telemetry} Telemetry */

const ROWS_EVERY = 250; // ms between looks at the numbers

export class Signals {
  /** `pick(name, box)` is called when somebody ticks a signal. @param {Telemetry} telemetry @param {(name: string, box: HTMLInputElement) => void} pick */
  constructor(telemetry, pick) {
    this.telemetry = telemetry;
    this.pick = pick;
    /** @type {string[]} */
    this.chosen = []; // that are drawn
    this.pattern = /(?:)/;
    /** @type {[HTMLElement, Signal][]} */
    this.cells = [];
    this.seen = false; // on the screen
    this.drawn = 0;
    this.filter = h('input', { type: 'text', placeholder: 'regular expression, such as slip|torque', 'aria-label': 'Filter signals', oninput: () => { this.setFilter(); } });
    this.body = h('tbody');
    const table = h('div', { class: 'signal-table', tabindex: '0', role: 'region', 'aria-label': 'All signals' }, h('table', {}, h('thead', {}, h('tr', {}, ...['Plot', 'Signal', 'Value', 'Unit'].map((t, i) => h('th', { scope: 'col', class: i === 2 ? 'n' : null, text: t })))), this.body));
    this.element = h('section', { class: 'panel signals' },
      h('div', { class: 'panel-head' }, h('h2', { text: 'All signals' }), h('div', { class: 'choices' }, this.filter)), table);
    new IntersectionObserver((entries) => { this.seen = entries[entries.length - 1].isIntersecting; }).observe(table);
  }

  /** Draw a signal by its name, as if it were ticked. @param {string} name */
  tick(name) {
    const box = /** @type {HTMLInputElement | undefined} */ ([...this.body.querySelectorAll('input')].find((one) => one.getAttribute('aria-label') === `Plot ${name}`));
    if (box && !box.checked) { box.checked = true; this.pick(name, box); }
  }

  /** All rows anew. */
  list() {
    this.cells = [];
    this.body.replaceChildren(...this.telemetry.signals.filter((s) => this.pattern.test(s.name)).map((signal) => {
      const box = h('input', { type: 'checkbox', checked: this.chosen.includes(signal.name), 'aria-label': `Plot ${signal.name}`, onchange: () => { this.pick(signal.name, box); } });
      const cell = h('td', { class: 'n' });
      this.cells.push([cell, signal]);
      return h('tr', { draggable: 'true', title: 'Drag it into the charts, or tick it', ondragstart: (/** @type {DragEvent} */ event) => { event.dataTransfer?.setData('text/plain', signal.name); } }, h('td', {}, box), h('td', { text: signal.name }), cell, h('td', { class: 'soft', text: signal.unit }));
    }));
    this.rows();
  }

  /** The numbers, where somebody sees them and not too often. */
  draw() { if (this.seen && performance.now() - this.drawn > ROWS_EVERY) this.rows(); }

  rows() {
    this.drawn = performance.now();
    for (const [cell, { name }] of this.cells) {
      const text = this.telemetry.word(name) ?? number(this.telemetry.value(name), 6);
      told(cell, text);
    }
  }

  setFilter() {
    try { this.pattern = new RegExp(this.filter.value, 'i'); this.filter.removeAttribute('aria-invalid'); } catch { this.filter.setAttribute('aria-invalid', 'true'); return; }
    this.list();
  }
}
