// The form that maps the columns of a table or a log: what was guessed, and what is typed; `order` is the case asked for.
import { h, number } from '../app.js';
import { Reading } from './map_read.js';
import { NAME, OwnEquations, namesIn } from './own_equations.js';

const MOST_ROWS = 2e6; // of a case
/** A name for a case, from that of a file. @param {string} name */
const plain = (name) => {
  const word = name.replace(/\s*[[(].*$/, '').replace(/\W+/g, '_').replace(/^_+|_+$/g, '').toLowerCase();
  return /^[a-z_]/.test(word) ? word : `c_${word}`;
};

export class MapForm {
  /**
   * A form for a base model; `draft`: what was typed in it before.
   * @param {MapSource} source @param {string} base @param {Partial<MapTyped> | null} draft @param {MapHeard} heard
   */
  constructor(source, base, draft, heard) {
    const { data, dbc, first } = source, fields = draft?.fields || {};
    this.data = data;
    this.dbc = dbc;
    this.suiting = source.suiting;
    this.base = source.bases.find((one) => one.name === base) || source.bases[0];
    /** @type {OwnEquations | null} */
    this.motion = null; // differential equations of one's own
    const name = plain(first.name.replace(/\.\w+$/, '')).slice(0, 60) || 'case';
    /** @param {Properties} properties */
    const text = (properties) => h('input', { type: 'text', autocomplete: 'off', spellcheck: 'false', ...properties });
    this.title = text({ value: fields.title ?? first.name.replace(/\.\w+$/, '').replaceAll('_', ' '), maxlength: '200' });
    this.caseName = text({ value: fields.name ?? name, maxlength: '64', pattern: '[A-Za-z0-9][A-Za-z0-9_.\\-]{0,63}', title: 'Letters a to z, digits, _ . and -, of which the first is a letter or a digit', required: true });
    this.model = h('select', { onchange: () => heard.remodel() }, source.bases.map((one) => h('option', { value: one.name, text: one.own_dynamics ? `${one.name}: your own differential equations` : one.name, selected: one === this.base })));
    const run = fields.run ?? first.run_guess;
    this.run = h('select', {}, h('option', { value: '', text: 'each file is one run' }), first.columns.map((c) => h('option', { value: c.name, text: c.name, selected: c.name === run })));
    this.period = first.kind === 'log' ? text({ value: fields.period ?? '10 ms' }) : null;
    const rows = data.reduce((sum, one) => sum + one.rows, 0);
    this.every = first.kind === 'log' ? null : text({ inputmode: 'numeric', value: fields.every ?? String(Math.max(1, Math.ceil(rows / MOST_ROWS))) });
    this.rows = first.columns.filter((c) => c.numeric && c.name !== first.run_guess).map((c) => this.row(c, draft?.columns?.find((one) => one.column === c.name)));
    this.extra = h('div', { class: 'form' });
    this.reading = first.kind === 'log' ? null : new Reading(fields, (reading) => heard.reread(reading));
    this.problem = h('div', { role: 'alert' });
    this.making = h('div', { class: 'job', role: 'status', hidden: true });
    this.submit = h('button', { type: 'submit', class: 'main', text: 'Make the case' });
    this.said = h('pre', { class: 'scroll small', tabindex: '0', 'aria-live': 'polite', text: 'reading' });
    this.holds = h('details', { class: 'wide', ontoggle: () => { if (this.holds.open) heard.look((text) => { this.said.textContent = text; }); } },
      h('summary', { text: 'What the file holds' }), this.said);
    this.element = this.layout(first, heard);
  }

  /** What each base model leaves that these columns suit, in the command line's words; the one that it takes in bold. */
  suits() {
    const [head, ...lines] = this.suiting?.lines ?? [];
    if (!head) return null;
    return h('div', { class: 'soft small' }, h('p', { text: head.replace(' (--base takes another)', ' (“model” takes another)') }),
      lines.length ? h('ul', {}, lines.map((line) => h('li', {}, h(line.startsWith('* ') ? 'b' : 'span', { text: line.slice(2) })))) : null);
  }

  /** @param {Upload} first @param {MapHeard} heard */
  layout(first, heard) {
    const rows = this.data.slice(1).reduce((sum, one) => sum + one.rows, first.rows);
    /** @param {string} words @param {HTMLElement | null} input */
    const label = (words, input) => h('label', {}, words, input);
    const form = h('form', { class: 'panel form', 'aria-label': 'Map the columns', onsubmit: (event) => { event.preventDefault(); heard.make(); } },
      h('h2', { text: 'Map the columns' }),
      h('p', { class: 'soft small', text: `${this.data.map((one) => one.name).join(', ')}: ${rows} ${first.kind === 'log' ? 'frames' : 'rows'}. Guessed from the names of the columns; correct what is wrong. What is not mapped is looked at all the same.` }),
      this.suits(),
      first.warnings.map((line) => h('p', { class: 'warn small', text: line })),
      this.holds, this.reading?.element,
      h('div', { class: 'four' }, label('name', this.caseName), label('title', this.title), label('model', this.model), label('run', this.run), this.period ? label('one row every', this.period) : label('every n-th row', this.every)),
      h('div', { class: 'scroll wide', tabindex: '0', role: 'region', 'aria-label': 'Columns' }, h('table', { class: 'inputs' },
        h('thead', {}, h('tr', {}, ['column', 'first values', 'is', 'unit', 'noise sd'].map((words) => h('th', { scope: 'col', text: words })))),
        h('tbody', {}, this.rows.map((one) => one.element)))),
      this.extra, this.problem, this.making,
      h('div', { class: 'row' }, this.submit, h('button', { type: 'button', text: 'Discard', onclick: () => heard.discard() })));
    for (const type of ['input', 'change']) form.addEventListener(type, () => heard.later());
    return form;
  }

  /** Inputs of constants and of the formula. */
  typed() { return [.../** @type {NodeListOf<HTMLInputElement | HTMLSelectElement>} */ (this.extra.querySelectorAll('[data-key]'))]; }

  /** What is typed. @returns {MapTyped} */
  draft() {
    const fields = { name: this.caseName, title: this.title, run: this.run, period: this.period, every: this.every };
    return {
      fields: { ...Object.fromEntries(Object.entries(fields).flatMap(([key, input]) => (input ? [[key, input.value]] : []))), ...this.reading?.fields() },
      columns: this.rows.map((one) => ({ column: one.column.name, name: one.is.value, unit: one.unit.value, sigma: one.sigma.value })),
      constants: Object.fromEntries(this.typed().map((input) => [input.dataset.key, input.value])),
    };
  }

  /** @param {UploadColumn} column @param {MapTyped['columns'][number] | undefined} typed @returns {MapRow} */
  row(column, typed) {
    const { base } = this;
    const free = base.own_names;
    const names = free ? [] : [...base.channels.map((c) => c.name), ...base.roles.map((r) => r.name)];
    const guess = typed?.name !== undefined ? typed.name : free ? column.name_guess : column.role_guess && names.includes(column.role_guess) && !base.left_out.includes(column.role_guess) ? column.role_guess : '';
    const is = free ? h('input', { type: 'text', value: guess, 'aria-label': `name of ${column.name}; empty: not mapped` })
      : h('select', { 'aria-label': `what ${column.name} is` }, h('option', { value: '', text: 'not mapped' }),
        h('optgroup', { label: 'measured (predicted by the model)' }, base.channels.map((c) => h('option', { value: c.name, text: c.name, selected: c.name === guess }))),
        h('optgroup', { label: 'inputs' }, base.roles.filter((r) => !base.channels.some((c) => c.name === r.name)).map((r) => h('option', { value: r.name, text: `${r.name}${r.needed ? ' (needed)' : ''}`, selected: r.name === guess }))));
    const canonical = free && guess !== 'time' ? undefined : [...base.channels, ...base.roles].find((one) => one.name === guess)?.unit;
    const unit = h('input', { type: 'text', class: 'short', value: typed?.unit ?? (column.unit_guess || canonical || ''), placeholder: '1', 'aria-label': `unit of ${column.name}` });
    const sigma = h('input', { type: 'text', class: 'short', value: typed?.sigma ?? '', inputmode: 'decimal', placeholder: 'estimated', 'aria-label': `noise sd of ${column.name}` });
    const values = column.preview.slice(0, 4).map((v) => (Number.isFinite(Number(v)) ? number(Number(v)) : v)).join('  ');
    const note = column.unit_guess || !canonical ? null : h('span', { class: 'warn small', text: 'unit assumed' });
    return { column, is, unit, sigma, element: h('tr', {}, h('th', { scope: 'row', text: column.name }), h('td', { class: 'soft small', text: values, title: `${number(column.min)} to ${number(column.max)}` }), h('td', {}, is), h('td', {}, unit, note), h('td', {}, sigma)) };
  }

  /** Constants that no table can tell, what is fitted, and the formula of an equation. @param {Record<string, string>} typed */
  constants(typed = {}) {
    const { base } = this;
    const mapped = this.rows.map((one) => one.is.value).filter(Boolean);
    /** @param {string} key @param {string | null} [value] @returns {string} */
    const kept = (key, value) => typed[key] ?? this.typed().find((one) => one.dataset.key === key)?.value ?? value ?? '';
    /** @param {string} key @param {string | null} value @param {Properties} properties */
    const input = (key, value, properties = {}) => h('input', { type: 'text', 'data-key': key, value: kept(key, value), autocomplete: 'off', spellcheck: 'false', ...properties });
    const parts = [];
    if (base.own_dynamics) {
      const columns = this.rows.map((one) => ({ name: one.is.value.trim(), unit: one.unit.value.trim(), clock: one.column.role_guess === 'time' })).filter((one) => one.name);
      if (this.motion) { this.motion.map(columns); return; } // the caret stays where it is
      this.motion = new OwnEquations(columns, typed);
      parts.push(this.motion.element);
    } else if (base.own_names) {
      const channel = h('select', { 'data-key': 'channel' }, mapped.map((name, i) => h('option', { value: name, text: name, selected: kept('channel') ? name === kept('channel') : i === mapped.length - 1 })));
      const others = mapped.filter((name) => name !== channel.value);
      const formula = input('formula', others.length ? `offset + gradient*${others[0]}` : 'offset', { required: true, oninput: () => tell() });
      const told = h('p', { class: 'soft small', 'aria-live': 'polite' });
      const tell = () => { // so that a slip in a column's name is seen
        const fit = namesIn(formula.value).filter((name) => !mapped.includes(name));
        told.textContent = `Names that are no columns become parameters to fit: ${fit.join(', ') || 'none here'}.`;
      };
      tell();
      parts.push(h('div', { class: 'four' }, h('label', {}, 'predicted', channel), h('label', { class: 'span' }, 'by the formula', formula)), told);
    } else {
      const fit = fitted(base.fit);
      const roles = base.roles.filter((r) => r.needed && !mapped.includes(r.name) && r.name !== 'omega' && r.name !== 'slip' && r.name !== 'time');
      const names = [...base.parameters.filter((p) => p.name !== fit?.name && p.default === null), ...roles.filter((r) => !base.parameters.some((p) => p.name === r.name)).map((r) => ({ ...r, placeholder: r.name === 'load' ? '20 N' : '' }))];
      if (names.length) {
        parts.push(h('h3', { text: 'Constants that no table can tell' }), h('div', { class: 'four' }, names.map((p) => h('label', {}, `${p.name}${p.unit && p.unit !== '1' ? `, ${p.unit}` : ''}`, input(p.name, p.placeholder, { required: true, 'data-constant': p.name })))));
      }
      if (fit) parts.push(h('p', { class: 'soft small', text: `Fitted: ${fit.name}, from ${fit.value} within ${fit.min} to ${fit.max}.` }));
    }
    this.extra.replaceChildren(...parts);
  }

  /** The case that is asked for; an Error says what is missing. */
  order() {
    const { base, data, dbc } = this;
    /** @type {Record<string, { column: string, unit: string, sigma?: number | string }>} */
    const columns = {};
    for (const one of this.rows) {
      if (!one.is.value) continue;
      if (base.own_names && !NAME.test(one.is.value)) throw new Error(`name of ${one.column.name}: found ${one.is.value}, expected letters a to z, digits and _, no digit first, or nothing where it is not mapped`);
      const sigma = one.sigma.value.trim();
      if (columns[one.is.value]) throw new Error(`${one.is.value}: two columns are mapped to it, expected one`);
      if (sigma && !(parseFloat(sigma) > 0 && parseFloat(sigma) < Infinity)) throw new Error(`noise sd of ${one.column.name}: found ${sigma}, expected a number above 0, with a unit or in the column's, or nothing`);
      columns[one.is.value] = { column: one.column.name, unit: one.unit.value.trim(), ...(sigma ? { sigma: Number.isNaN(Number(sigma)) ? sigma : Number(sigma) } : {}) };
    }
    if (!Object.keys(columns).length) throw new Error('no column is mapped, expected at least one');
    /** @type {Record<string, number | string>} */
    const parameters = {};
    /** @type {Record<string, { value: number, min?: number, max?: number }>} */
    const fit = {};
    /** @type {Record<string, string>} */
    const equation = {};
    for (const input of this.typed().filter((one) => one.dataset.constant)) {
      const text = input.value.trim();
      parameters[input.dataset.constant || ''] = text !== '' && Number.isFinite(Number(text)) ? Number(text) : text;
    }
    const motion = this.motion?.order();
    if (base.own_names && !motion) {
      /** @param {string} key */
      const value = (key) => this.typed().find((one) => one.dataset.key === key)?.value ?? '';
      const formula = value('formula');
      equation[value('channel')] = formula;
      for (const name of namesIn(formula)) if (!columns[name]) fit[name] = { value: name === 'gradient' ? 1 : 0 };
    } else if (!motion) {
      const found = fitted(base.fit);
      if (found) fit[found.name] = { value: found.value, min: found.min, max: found.max };
    }
    const every = this.every ? this.every.value.trim() : '1';
    if (!/^[1-9]\d{0,6}$/.test(every)) throw new Error(`every n-th row: found ${every}, expected a whole number from 1`);
    return {
      name: this.caseName.value.trim(), title: this.title.value.trim(), base: base.name, uploads: data.map((one) => one.id), run: this.run.value, every: Number(every),
      columns, parameters, fit, equation, ...motion, ...(dbc ? { dbc: dbc.id } : {}), ...(this.period ? { period: this.period.value.trim() } : {}), read: this.reading?.said() ?? {},
    };
  }

  /** @param {string} text */
  refuse(text) { this.problem.replaceChildren(h('p', { class: 'notice bad', text })); }
}

/** "f_o = { value = 0.05, min = 0.0, max = 0.5 }" as an object; null for none. @param {string | null} line */
function fitted(line) {
  const found = /^\s*(\w+)\s*=\s*\{(.*)\}\s*$/.exec(line || '');
  if (!found) return null;
  const entries = Object.fromEntries(found[2].split(',').map((part) => part.split('=').map((word) => word.trim())));
  return { name: found[1], value: Number(entries.value), min: Number(entries.min), max: Number(entries.max) };
}
