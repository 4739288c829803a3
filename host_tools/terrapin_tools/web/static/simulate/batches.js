// Batches: the scenario of the form with many seeds and values; how far each is, and where in the inputs it fails.
import { h, number } from '../app.js';

/** @typedef {{ app: App, attempt<T>(action: () => Promise<T>): Promise<T | null>, body(): Record<string, any> }} Desk */

const EVERY = 1000; // ms between looks at a batch that fills
const SIZE = { width: 420, height: 220, left: 52, bottom: 30, top: 8, right: 8 };
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
    /** @type {ReturnType<typeof setInterval> | null} */
    this.timer = null;
    this.seeds = h('input', { type: 'text', id: 'batch-seeds', value: '1:200', maxlength: '200' });
    this.vary = h('textarea', { id: 'batch-vary', rows: '2', maxlength: '1600', placeholder: 'path.1.slope=0deg:14deg' });
    this.start = h('button', { type: 'button', text: 'Run as a batch', onclick: () => this.go() });
    this.stop = h('button', { type: 'button', text: 'Stop', hidden: true, onclick: () => { const { job } = this; if (job) desk.attempt(() => desk.app.cancel(job)); } });
    this.rows = h('div', { class: 'runs', tabindex: '0', role: 'region', 'aria-label': 'Batches' });
    this.picture = h('div', {});
    this.element = h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Batches' })),
      h('label', { for: 'batch-seeds', text: 'Seeds' }), this.seeds,
      h('label', { for: 'batch-vary', text: 'Varied, one field a line' }), this.vary,
      h('div', { class: 'row' }, this.start, this.stop), this.rows, this.picture);
  }

  async go() {
    const { app, attempt, body } = this.desk;
    const changes = body();
    delete changes.link;
    delete changes.seed;
    const vary = this.vary.value.split('\n').map((line) => line.trim()).filter((line) => line);
    this.start.disabled = true;
    /** @type {(Started & { batch: string }) | null} */
    const started = await attempt(() => app.api('batches', { body: { ...changes, seeds: this.seeds.value.trim(), vary } }));
    this.start.disabled = false;
    if (!started) return;
    app.showCommand(started.command);
    this.chosen = started.batch;
    await this.watch(started.id);
  }

  /** Follow a job to its end. @param {string} id */
  async watch(id) {
    const { app, attempt } = this.desk;
    this.job = id;
    this.start.disabled = true;
    this.stop.hidden = false;
    this.fill(true);
    await attempt(async () => {
      const ended = await app.follow(id);
      if (ended.state === 'failed') throw new app.Refused(0, ended.error || 'failed');
    });
    this.job = null;
    this.start.disabled = false;
    this.stop.hidden = true;
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
    const { app, attempt } = this.desk;
    /** @type {BatchLine[] | null} */
    const found = await attempt(() => app.api('batches'));
    if (!found) return;
    this.rows.replaceChildren(found.length ? h('table', {}, h('thead', {}, h('tr', {}, ...['Batch', 'Runs', 'Failed', '', ''].map((text) => h('th', { scope: 'col', text })))),
      h('tbody', {}, ...found.map((one) => this.row(one)))) : h('p', { class: 'soft', text: 'No batches yet.' }));
    if (this.chosen && found.some((one) => one.name === this.chosen)) await this.draw(this.chosen);
    else this.picture.replaceChildren();
  }

  /** @param {BatchLine} one */
  row(one) {
    const { app, attempt } = this.desk;
    const open = () => { this.chosen = one.name; this.list(); };
    const remove = () => attempt(() => app.api(`batches/${encodeURIComponent(one.name)}`, { method: 'DELETE' })).then(() => this.list());
    return h('tr', {},
      h('td', {}, h('button', { type: 'button', class: 'quiet', text: one.name, onclick: open })),
      h('td', {}, h('progress', { max: String(one.runs), value: one.done, 'aria-label': `${one.name}: runs done` }), ` ${one.done} of ${one.runs}`),
      h('td', { class: one.failed ? 'warn' : 'good', text: String(one.failed) }),
      h('td', {}, one.report ? h('a', { href: `/api/batches/${encodeURIComponent(one.name)}/report`, target: '_blank', rel: 'noopener', text: 'Report' }) : ''),
      h('td', {}, h('button', { type: 'button', class: 'quiet', text: 'Remove', 'aria-label': `Remove ${one.name}`, onclick: remove })));
  }

  /** Runs over the first two inputs, or over the seed: those that failed stand out. @param {string} wanted */
  async draw(wanted) {
    const { app, attempt } = this.desk;
    /** @type {BatchState | null} */
    const state = await attempt(() => app.api(`batches/${encodeURIComponent(wanted)}`));
    if (!state || !state.points.length) return;
    const columns = state.inputs.length > 3 ? [2, 3] : state.inputs.length > 2 ? [2, 1] : [1, 0];
    const [x, y] = columns.map((column) => scale(state.points.map((point) => point[column])));
    const { width, height, left, bottom, top, right } = SIZE;
    const picture = svg('svg', { viewBox: `0 0 ${width} ${height}`, role: 'img', 'aria-label': `${state.failed} of ${state.done} runs failed` });
    state.points.forEach((point, i) => picture.append(svg('circle', {
      cx: String(left + x.share[i] * (width - left - right)), cy: String(top + (1 - y.share[i]) * (height - top - bottom)), r: '2.5',
      class: point[0] ? 'batch-passed' : 'batch-failed',
    })));
    const label = (/** @type {number} */ at, /** @type {number} */ down, /** @type {string} */ text, anchor = 'middle') =>
      picture.append(svg('text', { x: String(at), y: String(down), 'text-anchor': anchor, class: 'batch-label' }, text));
    label(left, height - 16, x.low, 'start');
    label(width - right, height - 16, x.high, 'end');
    label(left - 4, height - bottom, y.low, 'end');
    label(left - 4, top + 10, y.high, 'end');
    label((left + width) / 2, height - 3, `${state.inputs[columns[0]]}, up: ${state.inputs[columns[1]]}; ${state.failed} of ${state.done} failed`);
    this.picture.replaceChildren(picture);
  }
}

/** Where each value lies from the least to the greatest, and the words for both. @param {unknown[]} values */
function scale(values) {
  const numbers = values.map((value) => Number.parseFloat(String(Number(value === true) || value)));
  if (numbers.some((value) => !Number.isFinite(value))) {
    const words = [...new Set(values.map(String))];
    return { share: values.map((value) => (words.indexOf(String(value)) + 0.5) / words.length), low: words[0], high: words[words.length - 1] };
  }
  const low = Math.min(...numbers), high = Math.max(...numbers);
  return { share: numbers.map((value) => (high > low ? (value - low) / (high - low) : 0.5)), low: number(low, 3), high: number(high, 3) };
}
