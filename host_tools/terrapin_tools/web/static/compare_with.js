// A case held against another model of it, or against another case: over it or beside it, with the errors of both.
import { h, lineOf, number } from './app.js';

export class CompareWith {
  /** @param {CasePage} page */
  constructor(page) {
    this.page = page;
    this.turn = 0;
    /** @type {Other | null} */
    this.other = null;
    this.chosen = ''; // "model:" and effects, or "case:" and a name
    /** @type {string[]} */
    this.cases = []; // others of the workspace
    this.choice = h('select', { 'aria-label': 'Compare with', onchange: () => { this.chosen = this.choice.value; void this.fetch(); } });
    this.way = h('select', { 'aria-label': 'How to show both', hidden: true, onchange: () => { this.page.plots.apart = this.way.value === 'apart'; this.page.draw(); } },
      h('option', { value: 'over', text: 'overlaid' }), h('option', { value: 'apart', text: 'side by side' }));
    this.said = h('div', { 'aria-live': 'polite' });
    this.element = h('section', { class: 'compare-with', 'aria-label': 'Compare with another' }, h('div', { class: 'row' }, h('label', {}, 'Compare with ', this.choice), this.way), this.said);
  }

  /** @param {View} view */
  async take(view) {
    if (!this.cases.length) {
      try { this.cases = (await this.page.app.api('cases')).filter((/** @type {CaseSummary} */ one) => !one.error && one.name !== this.page.name).map((/** @type {CaseSummary} */ one) => one.name); } catch { /* the view says what is wrong */ }
      if (this.page.closed) return;
    }
    const { effects } = view, now = effects.join('+');
    /** @type {string[][]} */
    const sets = [...effects.map((_, i) => effects.slice(0, i)), ...[view.missing, ...view.rivals, ...view.cards.map((one) => [one.effect])].filter((set) => set.length).map((set) => [...effects, ...set])];
    const models = [...new Set(sets.map((set) => set.join('+')))].filter((set) => set !== now).slice(0, MODELS);
    /** @param {string} set */
    const title = (set) => [view.base, ...set.split('+').filter(Boolean)].join(' + ');
    const more = view.catalogue.map((name) => [...effects, name].join('+')).filter((set) => !models.includes(set));
    const known = ['', ...[...models, ...more].map((set) => `model:${set}`), ...this.cases.map((name) => `case:${name}`)];
    if (!known.includes(this.chosen)) this.chosen = '';
    /** @param {string} value @param {string} text */
    const option = (value, text) => h('option', { value, text, selected: value === this.chosen });
    /** @param {string} label @param {string[]} sets */
    const group = (label, sets) => (sets.length ? [h('optgroup', { label }, sets.map((set) => option(`model:${set}`, title(set))))] : []);
    this.choice.replaceChildren(option('', 'nothing'), ...group('another model of these data', models), ...group('with one effect of the catalogue', more),
      ...(this.cases.length ? [h('optgroup', { label: 'another case' }, this.cases.map((name) => option(`case:${name}`, name)))] : []));
    void this.fetch();
  }

  async fetch() {
    const { page } = this, turn = ++this.turn, before = this.other;
    /** @type {Other | null} */
    let other = null;
    let wrong = '';
    try { other = await this.found(); } catch (error) { wrong = lineOf(error); }
    if (turn !== this.turn || page.closed) return;
    this.other = page.plots.other = other;
    page.plots.apart = this.way.value === 'apart';
    this.way.hidden = !other;
    this.check();
    if (before || other) page.draw(); // drawn anew, a zoom asks for its rows again
    if (wrong) this.said.replaceChildren(h('p', { class: 'notice bad', text: wrong }));
  }

  /** Whether both can lie on the axes that are shown now, and the errors of both. */
  check() {
    const { other, page } = this;
    if (other?.plot && page.view) other.error = apart(page.view.plot, other.plot, page.plots.variable, page.plots.channel);
    this.said.replaceChildren(...(other ? [this.table(other)] : []));
  }

  /** @returns {Promise<Other | null>} */
  async found() {
    const { page, chosen } = this, { view } = page, { api } = page.app;
    if (!chosen || !view) return null;
    const [kind, what] = [chosen.slice(0, chosen.indexOf(':')), chosen.slice(chosen.indexOf(':') + 1)];
    if (kind === 'model') {
      const effects = what.split('+').filter(Boolean);
      const query = effects.map((name) => `&effect=${encodeURIComponent(name)}`).join('');
      const answer = await api(`${page.path}/view?whole=true${query}`);
      const model = [view.base, ...effects].join(' + ');
      return { title: model, model, channels: answer.channels, train: answer.train_error, held: answer.heldout_error };
    }
    /** @type {View} */
    const seen = await api(`cases/${encodeURIComponent(what)}/view`);
    const last = seen.plot.ladder[seen.effects.length];
    return { title: what, model: [seen.base, ...seen.effects].join(' + '), channels: {}, plot: seen.plot, train: last.train_error, held: last.heldout_error };
  }

  /** @param {Other} other */
  table(other) {
    const { page } = this, { view } = page;
    if (!view) return h('p');
    const mine = view.plot.ladder[view.effects.length];
    /** @param {string} name @param {string} kind @param {string} model @param {number | null} train @param {number | null} held */
    const row = (name, kind, model, train, held) => h('tr', {}, h('th', { scope: 'row', class: `key ${kind}` }, h('i'), name), h('td', { text: model }), h('td', { class: 'n', text: number(train, 3) }), h('td', { class: 'n', text: number(held, 3) }));
    return h('div', {}, h('table', {}, h('thead', {}, h('tr', {}, ['', 'model', 'training', 'held out'].map((text, i) => (text ? h('th', { scope: 'col', class: i > 1 ? 'n' : '', text }) : h('td'))))),
      h('tbody', {}, row('this', 'model', [view.base, ...view.effects].join(' + '), mine.train_error, mine.heldout_error), row(other.plot ? other.title : 'other', 'other', other.model, other.train, other.held))),
    h('p', { class: 'soft small', text: `Errors in ${other.plot ? 'the noise sd of each' : 'noise sd'}.` }),
    other.error ? h('p', { class: 'warn small', text: other.error }) : null);
  }
}

const MODELS = 12; // that are offered

/** Why another case cannot be drawn on the same axes; empty: it can. @param {PlotData} one @param {PlotData} two @param {string} variable @param {string} channel */
function apart(one, two, variable, channel) {
  const mine = one.channels.find((c) => c.name === channel), its = two.channels.find((c) => c.name === channel);
  if (!its) return `It measures no ${channel}: choose another channel.`;
  if (!two.columns[variable]) return `It has no column ${variable}: choose another to draw against.`;
  if (its.unit !== mine?.unit) return `Its ${channel} is in ${its.unit || '1'}, here ${mine?.unit || '1'}: side by side each has its own axes.`;
  if (two.columns[variable].unit !== one.columns[variable].unit) return `Its ${variable} is in ${two.columns[variable].unit || '1'}, here ${one.columns[variable].unit || '1'}: side by side each has its own axes.`;
  return '';
}
