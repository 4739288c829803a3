// Batches: the scenario of the form with many seeds and values; how far each is, where it fails, and each run that failed.
import { h, number } from '../app.js';
import { Refusals } from './refusals.js';

/** @typedef {{ app: App, body(): Record<string, any>, watch(job: string, run: string): Promise<Job | null> }} Desk */

const EVERY = 1000; // ms between looks at a batch that fills
const FAILURES = 20; // that are listed
const SIZE = { width: 420, height: 220, left: 52, bottom: 30, top: 8, right: 8 };
const LETTER = 7; // of a label, at most [px]
const SVG = 'http://www.w3.org/2000/svg';

/** @param {string} name @param {Record<string, string>} values @param {string} [text] */
function svg(name, values, text) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(values)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

export class Batches {
  /** @param {Desk} desk */
  constructor(desk) {
    this.desk = desk;
    /** @type {string | null} */
    this.job = null;
    /** @type {string | null} */
    this.chosen = null;
    this.axes = { across: '', up: '' }; // what was chosen for each
    /** @type {ReturnType<typeof setInterval> | null} */
    this.timer = null;
    this.seeds = h('input', { type: 'text', id: 'batch-seeds', value: '1:200', maxlength: '200' });
    this.vary = h('textarea', { id: 'batch-vary', rows: '2', maxlength: '1600' });
    this.field = h('select', { 'aria-label': 'Add a field that is varied', onchange: () => this.add() });
    this.judged = h('p', { class: 'soft small' });
    this.offered = ''; // scenario whose fields are listed
    this.start = h('button', { type: 'button', text: 'Run as a batch', onclick: () => this.go() });
    this.end = h('button', { type: 'button', text: 'Cancel', hidden: true, onclick: () => { const { job } = this; if (job) void this.refusals.attempt(() => desk.app.cancel(job)); } });
    this.refusals = new Refusals();
    this.rows = h('div', { class: 'runs', tabindex: '0', role: 'region', 'aria-label': 'Batches' });
    this.picture = h('div', { class: 'batch-picture' });
    this.element = h('section', { class: 'panel sim-batches' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Batches' })),
      h('label', { for: 'batch-seeds', text: 'Seeds' }), this.seeds,
      h('div', { class: 'row' }, h('label', { for: 'batch-vary', text: 'Varied, one field a line' }), this.field), this.vary, this.judged,
      h('div', { class: 'row' }, this.start, this.end), this.refusals.element, this.rows, this.picture);
  }

  /** What can be varied of the scenario in the form, and what makes its runs fail. @param {Scenario | undefined} scenario */
  offer(scenario) {
    if (!scenario || scenario.name === this.offered) return;
    this.offered = scenario.name;
    this.field.replaceChildren(h('option', { value: '', text: 'Add a field …' }), ...scenario.fields.map((one) => h('option', { value: one.example, text: `${one.name}: now ${one.value}` })));
    this.vary.placeholder = scenario.fields[0].example;
    this.judged.textContent = scenario.judged;
  }

  /** The field that was chosen, with a range around its value, as a line to change. */
  add() {
    this.vary.value = [...this.vary.value.split('\n').filter((line) => line.trim()), this.field.value].join('\n');
    this.field.value = '';
    this.vary.focus();
  }

  async go() {
    const { app, body } = this.desk;
    const changes = body();
    delete changes.link;
    delete changes.seed;
    const vary = this.vary.value.split('\n').map((line) => line.trim()).filter((line) => line);
    this.start.disabled = true;
    /** @type {(Started & { batch: string }) | null} */
    const started = await this.refusals.attempt(() => app.api('batches', { body: { ...changes, seeds: this.seeds.value.trim(), vary } }));
    this.start.disabled = false;
    if (!started) return;
    app.showCommand(started.command);
    this.chosen = started.batch;
    await this.watch(started.id);
  }

  /** Follow a job to its end. @param {string} id */
  async watch(id) {
    const { app } = this.desk;
    this.job = id;
    this.start.disabled = true;
    this.end.hidden = false;
    this.fill(true);
    await this.refusals.attempt(async () => {
      const ended = await app.follow(id);
      if (ended.state === 'failed') throw new app.Refused(0, ended.error || 'failed');
    });
    this.job = null;
    this.start.disabled = false;
    this.end.hidden = true;
    this.fill(false);
    await this.list();
  }

  /** Look again and again, or no more. @param {boolean} on */
  fill(on) {
    if (this.timer !== null) clearInterval(this.timer);
    this.timer = on ? setInterval(() => this.list(), EVERY) : null;
  }

  /** What another browser runs, or this one before a reload. @param {Job[]} jobs */
  running(jobs) {
    const mine = jobs.find((one) => one.do === 'batch' && (one.state === 'running' || one.state === 'queued'));
    if (!mine || this.job) return;
    this.chosen = /batches\/([^/ ]+)/.exec(mine.command.split('--out ')[1] || '')?.[1] || null;
    this.watch(mine.id);
  }

  async list() {
    const { app } = this.desk;
    /** @type {BatchLine[] | null} */
    const found = await this.refusals.look(() => app.api('batches'));
    if (!found) return;
    this.rows.replaceChildren(found.length ? h('table', {}, h('thead', {}, h('tr', {}, ...['Batch', 'Runs', 'Failed', 'Report', 'Remove'].map((text) => h('th', { scope: 'col', text })))),
      h('tbody', {}, ...found.map((one) => this.row(one)))) : h('p', { class: 'soft', text: 'No batches yet.' }));
    if (!found.some((one) => one.name === this.chosen)) this.chosen = found[0]?.name ?? null; // the newest
    if (this.chosen && found.some((one) => one.name === this.chosen)) await this.draw(this.chosen);
    else this.picture.replaceChildren();
  }

  /** @param {BatchLine} one */
  row(one) {
    const { app } = this.desk;
    const open = () => { this.chosen = one.name; this.list(); };
    const remove = () => this.refusals.attempt(() => app.api(`batches/${encodeURIComponent(one.name)}`, { method: 'DELETE' })).then(() => this.list());
    return h('tr', {},
      h('td', {}, h('button', { type: 'button', class: 'quiet', text: one.name, onclick: open })),
      h('td', {}, h('progress', { max: String(one.runs), value: one.done, 'aria-label': `${one.name}: runs done` }), ` ${one.done} of ${one.runs}`),
      h('td', { class: one.failed ? 'warn' : 'good', text: String(one.failed) }),
      h('td', {}, one.report ? h('a', { href: `/api/batches/${encodeURIComponent(one.name)}/report`, target: '_blank', rel: 'noopener', text: 'Report' }) : ''),
      h('td', {}, h('button', { type: 'button', class: 'quiet', text: 'Remove', 'aria-label': `Remove ${one.name}`, onclick: remove })));
  }

  /** Inputs or results of the runs against each other: those that failed stand out, and open. @param {string} wanted */
  async draw(wanted) {
    const { app } = this.desk;
    /** @type {BatchState | null} */
    const state = await this.refusals.look(() => app.api(`batches/${encodeURIComponent(wanted)}`));
    if (!state || !state.points.length) return;
    const names = [...state.inputs.slice(1), ...state.results];
    const rows = state.points.map((point, i) => [...point.slice(1), ...state.outcomes[i].slice(2)]);
    const first = state.inputs.length > 2 ? 1 : 0, second = state.inputs.length > 3 ? 2 : state.results.length ? state.inputs.length - 1 : 0;
    /** @param {'across' | 'up'} way @param {number} usual */
    const axis = (way, usual) => Math.max(0, names.indexOf(this.axes[way]) >= 0 ? names.indexOf(this.axes[way]) : usual);
    const across = axis('across', first), up = axis('up', second);
    const [x, y] = [across, up].map((column) => scale(rows.map((row) => row[column])));
    const { width, height, bottom, top, right } = SIZE, left = Math.max(SIZE.left, 8 + LETTER * Math.max(y.low.length, y.high.length));
    const picture = svg('svg', { viewBox: `0 0 ${width} ${height}`, role: 'img', 'aria-label': `${state.failed} of ${state.done} runs failed; ${names[across]} across, ${names[up]} up` });
    const order = rows.map((_, i) => i).sort((a, b) => Number(state.points[b][0]) - Number(state.points[a][0])); // failed ones above
    for (const i of order) {
      if (x.share[i] === null || y.share[i] === null) continue; // no number came of it
      const failed = !state.points[i][0];
      const one = svg('circle', {
        cx: String(left + x.share[i] * (width - left - right)), cy: String(top + (1 - y.share[i]) * (height - top - bottom)), r: failed ? '4' : '2.5',
        class: failed ? 'batch-failed' : 'batch-passed',
      });
      if (failed) {
        one.append(svg('title', {}, this.words(state, i)));
        one.addEventListener('click', () => { void this.again(wanted, state.outcomes[i][0]); });
      }
      picture.append(one);
    }
    const label = (/** @type {number} */ at, /** @type {number} */ down, /** @type {string} */ text, anchor = 'middle') =>
      picture.append(svg('text', { x: String(at), y: String(down), 'text-anchor': anchor, class: 'batch-label' }, text));
    label(left, height - 16, x.low, 'start');
    label(width - right, height - 16, x.high, 'end');
    label(left - 4, height - bottom, y.low, 'end');
    label(left - 4, top + 10, y.high, 'end');
    /** @param {'across' | 'up'} way @param {number} at */
    const choice = (way, at) => h('label', {}, `${way} `, h('select', { 'aria-label': `Batch: ${way}`, onchange: (event) => { this.axes[way] = event.target.value; void this.draw(wanted); } },
      names.map((name, i) => h('option', { value: name, text: name, selected: i === at }))));
    app.keepFocus(this.picture, () => this.picture.replaceChildren(h('div', { class: 'row' }, choice('across', across), choice('up', up), h('span', { class: 'soft small', text: `${state.failed} of ${state.done} failed` })), picture, this.failures(wanted, state)));
  }

  /** Which run it is and why it failed. @param {BatchState} state @param {number} i */
  words(state, i) {
    const [, ...values] = state.points[i];
    const inputs = state.inputs.slice(1).map((name, k) => `${name} ${short(values[k])}`);
    return `${inputs.join(', ')}: ${state.outcomes[i][1] || 'failed'}`;
  }

  /** A button for each of the first runs that failed. @param {string} batch @param {BatchState} state */
  failures(batch, state) {
    const failed = state.points.flatMap((point, i) => (point[0] || state.outcomes[i][0] < 0 ? [] : [i])).slice(0, FAILURES);
    if (!failed.length) return h('div');
    return h('div', {}, h('h3', { text: 'Runs that failed' }), h('p', { class: 'soft small', text: 'Press one, or its red point in the plot: the run is done again, and opens above with its settings and checks.' }),
      h('ul', { class: 'failures', tabindex: '0', 'aria-label': 'Runs that failed' }, failed.map((i) => h('li', {}, h('button', { type: 'button', class: 'quiet', text: this.words(state, i), onclick: () => this.again(batch, state.outcomes[i][0]) })))));
  }

  /** Do a run of the batch again, and open it. @param {string} batch @param {number} run */
  async again(batch, run) {
    const { app } = this.desk;
    /** @type {(Started & { run: string }) | null} */
    const started = await this.refusals.attempt(() => app.api(`batches/${encodeURIComponent(batch)}/runs/${run}`, { method: 'POST' }));
    if (!started) return;
    app.showCommand(started.command);
    await this.desk.watch(started.id, started.run);
  }
}

/** A value of an input in few digits, with its unit: 7.658 deg. @param {unknown} value */
function short(value) {
  const [text, unit] = typeof value === 'string' ? value.split(' ') : [value];
  const shown = typeof text !== 'boolean' && Number.isFinite(Number(text)) ? number(Number(text)) : String(text);
  return unit ? `${shown} ${unit}` : shown;
}

/**
 * Where each value lies from the least to the greatest, null where there is none, and the words for both ends.
 * @param {unknown[]} values @returns {{ share: (number | null)[], low: string, high: string }}
 */
function scale(values) {
  const numbers = values.map((value) => (value === null || value === undefined ? NaN : Number.parseFloat(String(Number(value === true) || value))));
  if (values.some((value, i) => value !== null && value !== undefined && !Number.isFinite(numbers[i]))) {
    const words = [...new Set(values.map(String))];
    return { share: values.map((value) => (words.indexOf(String(value)) + 0.5) / words.length), low: words[0], high: words[words.length - 1] };
  }
  const there = numbers.filter((value) => Number.isFinite(value)), low = Math.min(...there), high = Math.max(...there);
  const digits = Math.max(3, Math.min(9, Math.ceil(Math.log10(Math.max(Math.abs(low), Math.abs(high)) / (high - low) || 1)) + 2)); // that tell both apart
  return { share: numbers.map((value) => (Number.isFinite(value) ? (high > low ? (value - low) / (high - low) : 0.5) : null)), low: number(low, digits), high: number(high, digits) };
}
