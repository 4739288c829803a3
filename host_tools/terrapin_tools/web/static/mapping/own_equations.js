// Differential equations of one's own, as rows: states with their derivatives, what is measured of them, and the parameters
// that their formulas name. They become [model.states], [model.derivative] and [model.measured] of case.toml (docs/ode.md).
import { focus, h } from '../app.js';

export const NAME = /^[A-Za-z_]\w*$/;
const FUNCTIONS = ['abs', 'sign', 'sqrt', 'exp', 'log', 'sin', 'cos', 'tan', 'tanh', 'min', 'max'];
const MOST_STATES = 8;
/** What a formula names besides functions; the e of 2e3 is none. @param {string} formula */
export const namesIn = (formula) => [...new Set(formula.match(/(?<![\w.])[A-Za-z_]\w*/g) ?? [])].filter((name) => !FUNCTIONS.includes(name));

const NEEDS_TIME = 'time: no column is mapped to it, expected the one that tells when a row was taken: name it time among the columns';
const PLACES = /^(x|y|z|s|q|pos\w*|way\w*|disp\w*|travel\w*|theta|phi|angle\w*)$/i; // of which the rate is a state, too
/** @param {string} text @returns {text is string} */
const isNumber = (text) => text !== '' && Number.isFinite(Number(text));

/** What a table of these columns may be: one channel that is a place, its rate, and the first of the others that drives it. @param {Mapped[]} mapped */
function guessed(mapped) {
  const others = mapped.filter((one) => one.name !== 'time' && !one.clock);
  const channel = others.find((one) => PLACES.test(one.name)) ?? others.at(-1);
  const taken = others.filter((one) => one !== channel).map((one) => one.name), force = taken.find((name) => name !== 'x' && name !== 'v');
  const unit = channel?.unit && channel.unit !== '1' ? channel.unit : '';
  /** @type {Record<string, string>} */
  const typed = {
    state_1_name: 'x', state_1_unit: unit, state_1_initial: 'fit', state_1_derivative: 'v',
    state_2_name: 'v', state_2_unit: unit && (unit.includes('/') ? `(${unit})/s` : `${unit}/s`), state_2_initial: 'fit', state_2_derivative: force ? `(${force} - d*v)/m` : '-k*x - d*v',
    measured_1_channel: channel?.name ?? '', measured_1_formula: 'x',
  };
  taken.filter((name) => name === 'x' || name === 'v').forEach((name, i) => { // a state is no input: what is called so measures it
    typed[`measured_${i + 2}_channel`] = typed[`measured_${i + 2}_formula`] = name;
  });
  return typed;
}

export class OwnEquations {
  /** @param {Mapped[]} mapped columns, by the names that formulas use @param {Record<string, string>} typed before, by key */
  constructor(mapped, typed) {
    this.mapped = mapped;
    this.guess = JSON.stringify(guessed(mapped));
    this.touched = Object.keys(typed).some((key) => key.startsWith('state_'));
    /** What was ever typed of a parameter: its name may leave the formulas for a few keys. @type {Record<string, string>} */
    this.kept = { ...(this.touched ? typed : guessed(mapped)) };
    this.starts = h('datalist', { id: 'starts' });
    this.states = h('tbody');
    this.measured = h('tbody');
    this.parameters = h('tbody');
    this.named = '';
    this.timeless = h('p', { class: 'warn small', role: 'status' });
    this.told = h('p', { class: 'soft small', 'aria-live': 'polite' });
    this.more = h('button', { type: 'button', text: 'Add a state', onclick: () => this.add(this.states, this.state()) });
    this.moreMeasured = h('button', { type: 'button', text: 'Add a measured channel', onclick: () => this.add(this.measured, this.channel()) });
    /** @param {string} label @param {string[]} heads @param {HTMLElement} body */
    const table = (label, heads, body) => h('div', { class: 'scroll wide', tabindex: '0', role: 'region', 'aria-label': label },
      h('table', { class: 'inputs' }, h('thead', {}, h('tr', {}, heads.map((text) => (text ? h('th', { scope: 'col', text }) : h('td'))))), body));
    this.fitted = table('Parameters of the equations', ['name', 'is', 'start value', 'min', 'max', 'unit'], this.parameters);
    this.element = h('div', { class: 'form' }, this.timeless, this.starts,
      h('h3', { text: 'States and their derivatives' }),
      h('p', { class: 'soft small', text: 'Formulas use states, mapped columns and parameters, in SI units. A state starts at what fits each run, at a number in its unit, or at a column’s first row.' }),
      table('States', ['state', 'unit', 'starts at', '', 'its derivative', ''], this.states), h('div', { class: 'row' }, this.more),
      h('h3', { text: 'What is measured of them' }),
      table('Measured', ['column', '', 'is, by the formula', ''], this.measured), h('div', { class: 'row' }, this.moreMeasured),
      this.told, this.fitted);
    this.element.addEventListener('input', (event) => {
      const { key } = /** @type {HTMLElement} */ (event.target).dataset;
      this.touched = true;
      if (key && this.parameters.contains(/** @type {Node} */ (event.target))) this.kept[key] = /** @type {HTMLInputElement} */ (event.target).value;
      else this.tell();
    });
    this.fill();
    this.map(mapped);
  }

  /** The rows, by what is kept. Those that are there stay, so that who is about to type in one does not lose it. */
  fill() {
    for (const [body, kind] of /** @type {[HTMLElement, 'state' | 'measured'][]} */ ([[this.states, 'state'], [this.measured, 'measured']])) {
      let i = 1;
      for (; this.kept[`${kind}_${i}_${kind === 'state' ? 'name' : 'formula'}`] !== undefined; i += 1) {
        const row = body.children[i - 1], was = `${kind}_${i}`;
        if (row) this.refill(row, was);
        else body.append(kind === 'state' ? this.state(was) : this.channel(was));
      }
      while (body.children.length >= i) body.lastElementChild?.remove();
    }
    this.number();
  }

  /** @param {Element} row @param {string} was key of what is kept */
  refill(row, was) {
    for (const input of /** @type {NodeListOf<HTMLInputElement | HTMLSelectElement>} */ (row.querySelectorAll('[data-part]'))) {
      const value = this.kept[`${was}_${input.dataset.part}`] ?? '';
      if (input instanceof HTMLSelectElement) { input.replaceChildren(); input.dataset.wanted = value; } else input.value = value;
    }
  }

  /** @param {string} part of a row @param {string} was key of what was typed @param {string} otherwise @param {Properties} properties */
  input(part, was, otherwise, properties = {}) {
    return h('input', { type: 'text', 'data-part': part, value: (was ? this.kept[`${was}_${part}`] : undefined) ?? otherwise, autocomplete: 'off', spellcheck: 'false', ...properties });
  }

  /** A row of a state. @param {string} was key of what was typed */
  state(was = '') {
    const row = h('tr', {}, h('td', {}, this.input('name', was, '', { class: 'short', required: true, maxlength: '64', pattern: '[A-Za-z_][A-Za-z0-9_]*', title: 'Letters a to z, digits and _, no digit first' })),
      h('td', {}, this.input('unit', was, '', { class: 'short', maxlength: '100' })), h('td', {}, this.input('initial', was, 'fit', { class: 'short', list: 'starts', required: true, maxlength: '64' })),
      h('td', { class: 'soft', 'data-rate': 'true' }), h('td', { class: 'formula' }, this.input('derivative', was, '', { required: true, maxlength: '2000' })), h('td'));
    row.lastElementChild?.append(this.remove(row));
    return row;
  }

  /** A row of a channel. @param {string} was key of what was typed */
  channel(was = '') {
    const select = h('select', { 'data-part': 'channel', 'data-wanted': (was && this.kept[`${was}_channel`]) || '', onchange: () => this.tell() });
    const row = h('tr', {}, h('td', {}, select), h('td', { class: 'soft', text: '=' }), h('td', { class: 'formula' }, this.input('formula', was, '', { required: true, maxlength: '2000' })), h('td'));
    row.lastElementChild?.append(this.remove(row));
    return row;
  }

  /** @param {HTMLElement} row */
  remove(row) {
    return h('button', { type: 'button', class: 'quiet', text: 'Remove', onclick: () => {
      const more = this.states.contains(row) ? this.more : this.moreMeasured;
      row.remove();
      this.changed();
      focus(more);
    } });
  }

  /** @param {HTMLElement} body @param {HTMLElement} row */
  add(body, row) {
    body.append(row);
    this.changed();
    focus(row.querySelector('input, select'));
  }

  changed() {
    this.touched = true;
    this.number();
    this.map(this.mapped);
    this.element.dispatchEvent(new Event('change', { bubbles: true })); // so that it is kept as what is typed is
  }

  /** Keys for the draft and names for whoever does not see the heads, by a row's place. */
  number() {
    const words = { name: 'name', unit: 'unit', initial: 'starts at', derivative: 'derivative', channel: 'column', formula: 'formula' };
    for (const [body, kind] of /** @type {[HTMLElement, 'state' | 'measured'][]} */ ([[this.states, 'state'], [this.measured, 'measured']])) {
      [...body.children].forEach((row, i) => {
        for (const input of /** @type {NodeListOf<HTMLElement>} */ (row.querySelectorAll('[data-part]'))) {
          const part = /** @type {keyof typeof words} */ (input.dataset.part);
          input.dataset.key = `${kind}_${i + 1}_${part}`;
          input.setAttribute('aria-label', `${kind} ${i + 1}: ${words[part]}`);
        }
        const button = /** @type {HTMLButtonElement} */ (row.querySelector('button'));
        button.setAttribute('aria-label', `Remove ${kind} ${i + 1}`);
        button.disabled = body.children.length === 1;
      });
    }
    this.more.disabled = this.states.children.length >= MOST_STATES;
  }

  /** The columns as they are mapped now. @param {Mapped[]} mapped */
  map(mapped) {
    this.mapped = mapped;
    const guess = guessed(mapped), said = JSON.stringify(guess);
    if (!this.touched && said !== this.guess) { // nobody has changed a row: other columns, other rows
      this.guess = said;
      this.kept = guess;
      this.fill();
    }
    const names = mapped.map((one) => one.name), channels = names.filter((name) => name !== 'time');
    const selects = [...this.measured.querySelectorAll('select')], wanted = selects.map((one) => one.value || one.dataset.wanted || '');
    selects.forEach((select, i) => {
      const free = channels.find((name) => !wanted.includes(name));
      const value = wanted[i] || free || '';
      wanted[i] = value;
      select.replaceChildren(...[...new Set([...channels, ...(value ? [value] : [])])].map((name) => h('option', { value: name, text: channels.includes(name) ? name : `${name} (not mapped)`, selected: name === value })));
    });
    this.moreMeasured.disabled = selects.length >= channels.length;
    this.starts.replaceChildren(...['fit', '0', ...channels].map((value) => h('option', { value })));
    this.timeless.hidden = names.includes('time');
    this.timeless.textContent = this.timeless.hidden ? '' : `${NEEDS_TIME}.`;
    this.tell();
  }

  /** What stands in the rows. @param {HTMLElement} body @returns {Record<string, string>[]} */
  rows(body) {
    return [...body.children].map((row) => Object.fromEntries([.../** @type {NodeListOf<HTMLInputElement | HTMLSelectElement>} */ (row.querySelectorAll('[data-part]'))].map((input) => [input.dataset.part, input.value.trim()])));
  }

  /** Names in the formulas that are neither columns nor states. */
  free() {
    const states = this.rows(this.states), known = [...this.mapped, ...states].map((one) => one.name);
    const formulas = [...states.map((one) => one.derivative), ...this.rows(this.measured).map((one) => one.formula)];
    return [...new Set(formulas.flatMap(namesIn))].filter((name) => !known.includes(name));
  }

  /** Say which names become parameters, so that a slip in one is seen, and have a row for each. */
  tell() {
    for (const row of this.states.children) /** @type {HTMLElement} */ (row.querySelector('[data-rate]')).textContent = `d${row.querySelector('input')?.value || '?'}/dt =`;
    const free = this.free(), named = free.join(', ');
    this.fitted.hidden = !free.length;
    if (named === this.named && this.told.textContent) return;
    this.named = named;
    this.told.textContent = `Names that are no columns and no states become parameters to fit: ${named || 'none here'}.${named ? ' Start where the equations stay bounded; a value without a unit is in SI units.' : ''}`;
    const rows = /** @type {HTMLElement[]} */ ([...this.parameters.children]);
    for (const row of rows) if (!free.includes(row.dataset.name ?? '')) row.remove();
    this.parameters.append(...free.filter((name) => !rows.some((row) => row.dataset.name === name)).map((name) => this.parameter(name)));
  }

  /** @param {string} name */
  parameter(name) {
    /** @param {string} key @param {string} label @param {string} otherwise @param {Properties} properties */
    const input = (key, label, otherwise, properties = {}) => h('input', { type: 'text', class: 'short', 'data-key': `${key}_${name}`, 'aria-label': `${label} of ${name}`, value: this.kept[`${key}_${name}`] ?? otherwise, autocomplete: 'off', spellcheck: 'false', ...properties });
    const low = input('min', 'min', '', { inputmode: 'decimal', placeholder: 'none' }), high = input('max', 'max', '', { inputmode: 'decimal', placeholder: 'none' });
    const is = h('select', { 'data-key': `is_${name}`, 'aria-label': `${name} is`, onchange: () => bound() }, ['fitted', 'known'].map((value) => h('option', { value, text: value, selected: value === this.kept[`is_${name}`] })));
    const bound = () => { low.disabled = high.disabled = is.value === 'known'; };
    bound();
    return h('tr', { 'data-name': name }, h('th', { scope: 'row', text: name }), h('td', {}, is), h('td', {}, input('start', 'start value', '1', { inputmode: 'decimal', required: true })), h('td', {}, low), h('td', {}, high), h('td', {}, input('unit', 'unit', '', { placeholder: 'SI' })));
  }

  /** What the case is to say of them; an Error says what is missing, or wrong. */
  order() {
    const mapped = this.mapped.map((one) => one.name);
    if (!mapped.includes('time')) throw new Error(NEEDS_TIME);
    /** @type {Pick<MapMotion, 'states' | 'derivative' | 'measured'>} */
    const { states, derivative, measured } = { states: {}, derivative: {}, measured: {} };
    this.rows(this.states).forEach(({ name, unit, initial, derivative: formula }, i) => {
      if (!NAME.test(name)) throw new Error(`state ${i + 1}: found ${name || 'no name'}, expected a name of letters a to z, digits and _, no digit first`);
      if (states[name]) throw new Error(`state ${i + 1}: found ${name} once more, expected another name`);
      if (!isNumber(initial) && initial !== 'fit' && !mapped.includes(initial)) throw new Error(`${name} starts at: found ${initial || 'nothing'}, expected fit, a number or one of ${mapped.join(', ')}`);
      if (!formula) throw new Error(`derivative of ${name}: found nothing, expected a formula`);
      states[name] = { initial: isNumber(initial) ? Number(initial) : initial, unit };
      derivative[name] = formula;
    });
    this.rows(this.measured).forEach(({ channel, formula }, i) => {
      if (!mapped.includes(channel)) throw new Error(`measured ${i + 1}: found ${channel || 'no column'}, expected one of ${mapped.filter((name) => name !== 'time').join(', ')}`);
      if (measured[channel]) throw new Error(`measured ${i + 1}: found ${channel} once more, expected another column`);
      if (!formula) throw new Error(`measured ${i + 1}: ${channel}: found no formula, expected one of the states`);
      measured[channel] = formula;
    });
    return { states, derivative, measured, ...this.values() };
  }

  /** The parameters: fitted, or known. */
  values() {
    /** @type {Pick<MapMotion, 'fit' | 'parameters'>} */
    const { fit, parameters } = { fit: {}, parameters: {} };
    for (const name of this.free()) {
      /** @param {string} key */
      const typed = (key) => /** @type {HTMLInputElement | null} */ (this.parameters.querySelector(`[data-key="${key}_${name}"]`))?.value.trim() ?? '';
      /** @param {string} key @param {string} what */
      const number = (key, what) => {
        if (!isNumber(typed(key))) throw new Error(`${what} of ${name}: found ${typed(key) || 'nothing'}, expected a number`);
        return Number(typed(key));
      };
      const value = number('start', 'start value'), unit = typed('unit');
      if (typed('is') === 'known') parameters[name] = unit ? `${value} ${unit}` : value;
      else fit[name] = { value, unit, ...Object.fromEntries(['min', 'max'].flatMap((key) => (typed(key) ? [[key, number(key, key)]] : []))) };
    }
    return { fit, parameters };
  }
}
