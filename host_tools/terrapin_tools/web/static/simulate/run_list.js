// The list of runs, of which some are ticked, and the case that is made of them.
import { h } from '../app.js';

/** What the list asks of its tab. @typedef {{ app: App, refusals: import('./refusals.js').Refusals, open(run: string): void, watch(job: string): Promise<Job | null> }} Desk */

export class RunList {
  /** @param {Desk} desk */
  constructor(desk) {
    this.desk = desk;
    /** @type {Run | null} */
    this.run = null; // that is open
    /** @type {string[]} */
    this.names = []; // of all runs
    this.name = h('input', { type: 'text', id: 'sim-keep', 'aria-label': 'Name of the case', maxlength: '64' });
    this.keep = h('button', { type: 'button', text: 'Keep as a case', disabled: true, onclick: () => this.keepCase() });
    this.note = h('p', { class: 'small soft', text: 'A case needs two runs, as one is held out: tick others above, or the scenario is run once more with the next seed.' });
    this.runs = h('div', { class: 'runs', tabindex: '0', role: 'region', 'aria-label': 'Runs' });
    this.element = h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Runs' })), this.runs,
      h('div', { class: 'record-row' }, this.name, this.keep), this.note);
  }

  /** Mark the run that is open; it is always in the case. @param {Run} run */
  open(run) {
    this.run = run;
    this.keep.disabled = !run.run.complete;
    this.name.value = run.name;
    this.mark();
  }

  /** Rows of the table with their boxes. */
  rows() {
    return [.../** @type {NodeListOf<HTMLTableRowElement>} */ (this.runs.querySelectorAll('tr[data-run]'))].map((line) => ({
      line, name: line.dataset.run || '', box: /** @type {HTMLInputElement} */ (line.querySelector('input')),
    }));
  }

  async list() {
    const { app, refusals } = this.desk;
    /** @type {RunLine[] | null} */
    const found = await refusals.look(() => app.api('simulate'));
    if (!found) return;
    this.names = found.map((one) => one.name);
    const ticked = new Set(this.rows().filter((one) => one.box.checked).map((one) => one.name));
    if (this.run) ticked.delete(this.run.name); // marked below
    this.runs.replaceChildren(found.length ? h('table', {}, h('thead', {}, h('tr', {}, ...['In the case', 'Run', 'Seed', 'Checks', 'Remove'].map((t) => h('th', { scope: 'col', text: t })))),
      h('tbody', {}, ...found.map((one) => this.row(one, ticked.has(one.name))))) : h('p', { class: 'soft', text: 'No runs yet: choose a scenario, change what you like, and press Run.' }));
    this.mark();
  }

  /** @param {RunLine} one @param {boolean} checked */
  row(one, checked) {
    const { app, refusals, open } = this.desk;
    const remove = () => refusals.attempt(() => app.api(`simulate/${encodeURIComponent(one.name)}`, { method: 'DELETE' })).then(() => this.list());
    return h('tr', { 'data-run': one.name },
      h('td', {}, h('input', { type: 'checkbox', 'aria-label': `${one.name} in the case`, checked, 'data-cut': one.complete ? null : '' })),
      h('td', {}, h('button', { type: 'button', class: 'quiet', text: one.name, onclick: () => open(one.name) })),
      h('td', { text: String(one.seed) }),
      h('td', { class: one.passed ? 'good' : 'warn', text: one.complete ? (one.passed ? 'hold' : 'some fail') : 'cut short' }),
      h('td', {}, h('button', { type: 'button', class: 'quiet', text: 'Remove', 'aria-label': `Remove ${one.name}`, onclick: remove })));
  }

  mark() {
    for (const { line, name, box } of this.rows()) {
      const here = name === this.run?.name;
      line.toggleAttribute('aria-current', here);
      box.checked = here || (box.checked && !box.dataset.own);
      box.dataset.own = here ? '1' : '';
      box.disabled = here || 'cut' in box.dataset;
    }
  }

  async keepCase() {
    const { app, refusals, watch } = this.desk, { run } = this;
    if (!run) return;
    const others = this.rows().filter((one) => one.box.checked && one.name !== run.name).map((one) => one.name);
    const wanted = this.name.value.trim();
    this.keep.disabled = true;
    /** @type {Started | null} */
    const started = await refusals.attempt(() => app.api(`simulate/${encodeURIComponent(run.name)}/case`, { body: { name: wanted, title: run.run.title || '', others } }));
    if (started) {
      app.showCommand(started.command);
      const ended = await watch(started.id);
      if (ended?.state === 'done') this.note.replaceChildren('Kept: ', h('a', { href: `#workbench/${encodeURIComponent(wanted)}`, text: wanted }), ' is in the workbench.');
    }
    this.keep.disabled = false;
  }
}
