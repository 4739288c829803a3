// Panels of a case beside the ranking: the next step, an effect of one's own, the controller; and the tables below.
import { focus, h, lineOf, number, quote } from './app.js';
import { constants, heldOut } from './case_edit.js';
import { heat } from './plots/heat.js';

const WAIT_MS = 250; // after the last key, before an expression is checked

// ---------------------------------------------------------------- the next step

/**
 * What to measure or do next; nothing where the ranking or the button above says it already.
 * @param {CasePage} page @param {View} view
 */
export function nextStep(page, view) {
  const { next, discovered } = view;
  if (next.do === 'experiment') return [h('section', { class: 'panel next', 'aria-label': 'Next experiment' }, h('h2', { text: 'Next experiment' }), experiment(page, view, /** @type {Experiment} */ (next)))];
  if (next.do === 'nothing' && discovered) return [h('section', { class: 'panel next', 'aria-label': 'Next' }, h('h2', { text: 'Next' }), h('p', { text: next.text }))];
  return [];
}

/** @param {CasePage} page @param {View} view @param {Experiment} next */
function experiment(page, view, next) {
  const head = h('tr', {}, h('td'), next.vary.map((text) => h('th', { class: 'n', scope: 'col', text })));
  const rows = next.settings.map((row) => h('tr', {}, row.map((text) => h('td', { class: 'n', text }))));
  const truth = h('select', { 'aria-label': 'What the simulated robot has' }, view.rivals.map((set, i) => h('option', { value: String(i), text: set.join(' + ') })));
  const run = h('button', { type: 'button', class: 'main', text: 'Run it in the simulator', onclick: () => simulate(page, view.rivals[Number(truth.value)]) });
  return [
    h('p', { text: next.text }),
    h('div', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': 'Settings of the proposed runs' }, h('table', {}, h('thead', {}, head), h('tbody', {}, rows))),
    h('p', { class: 'soft small', text: next.after }),
    ...(next.simulator ? [h('div', { class: 'row' }, run, h('label', {}, 'as if true: ', truth)),
      h('p', { class: 'soft small', text: 'Simulated runs are no measurements: they come into a new case, beside the measured ones.' })]
      : [h('p', { class: 'soft small', text: 'The simulator has no such rig: measure these runs.' })]),
  ];
}

/** The proposed runs in a new case, and discover there. @param {CasePage} page @param {string[]} truth */
async function simulate(page, truth) {
  let to = `${page.name}-simulated`.slice(0, 60);
  /** @type {string[]} */
  const taken = (await page.app.api('cases')).map((/** @type {CaseSummary} */ one) => one.name);
  for (let n = 2; taken.includes(to); n++) to = `${`${page.name}-simulated`.slice(0, 56)}-${n}`;
  if (await page.run({ do: 'experiment', to, truth })) page.app.go('workbench', to);
}

// ---------------------------------------------------------------- an effect of one's own

export class OwnEffect {
  /** @param {CasePage} page */
  constructor(page) {
    this.page = page;
    this.timer = this.turn = 0;
    this.mends = ''; // the effect of the model that it takes the place of
    this.kept = `terrapin-own-${page.name}`; // what is typed, over a reload
    /** @type {Map<string, Record<'value' | 'min' | 'max' | 'unit', HTMLInputElement>>} */
    this.parameters = new Map(); // name -> its inputs
    /** @param {string} name @param {Properties} properties */
    const field = (name, properties) => h('input', { type: 'text', name, autocomplete: 'off', spellcheck: 'false', ...properties });
    this.name = field('effect-name', { value: 'my_effect', maxlength: '64' });
    this.expression = field('expression', { placeholder: 'k * omega**3', maxlength: '2000' });
    this.target = h('select', { name: 'target' });
    this.table = h('div');
    this.formula = h('div', { class: 'eq' });
    this.answer = h('p', { class: 'small', role: 'status' });
    this.names = h('p', { class: 'soft small' });
    this.offers = h('span', { class: 'row small', role: 'group', 'aria-label': 'Names that go on so' });
    /** @type {string[]} */
    this.known = [];
    this.button = h('button', { type: 'submit', text: 'Add it', disabled: true });
    this.drawn = h('button', { type: 'button', text: 'Draw it', 'aria-label': 'Draw the own effect', title: 'Fitted and drawn over the model; nothing is changed', disabled: true, onclick: () => page.showPreview([this.name.value], false, this.body()) });
    const form = h('form', { class: 'form', onsubmit: (event) => { event.preventDefault(); this.add(); } },
      h('div', { class: 'two' }, h('label', {}, 'name', this.name), h('label', {}, 'acts on', this.target)),
      h('label', {}, 'expression', this.expression), this.offers, this.formula, this.table, this.answer, this.names, h('div', { class: 'row' }, this.button, this.drawn));
    this.element = h('details', { class: 'panel fold own' }, h('summary', {}, h('h2', { text: 'Own effect' }), h('span', { class: 'soft small', text: 'units checked as you type' })), form);
    form.addEventListener('input', () => { this.keep(); this.later(); });
    for (const kind of ['input', 'keyup', 'click']) this.expression.addEventListener(kind, () => this.offer());
    this.target.addEventListener('change', () => this.later());
  }

  close() { clearTimeout(this.timer); }

  keep() { sessionStorage.setItem(this.kept, JSON.stringify({ name: this.name.value, mends: this.mends, ...this.body() })); }

  /** What was typed before a reload. */
  restore() {
    const text = sessionStorage.getItem(this.kept);
    if (!text) return;
    const { name, mends, ...own } = JSON.parse(text);
    this.fill(name, own, mends);
  }

  /** @param {string} name @param {OwnFormula} own @param {string} mends */
  fill(name, own, mends) {
    this.element.open = true;
    this.mends = mends;
    this.name.value = name;
    this.name.readOnly = Boolean(mends);
    this.button.textContent = mends ? 'Replace it' : 'Add it';
    this.expression.value = own.expression;
    if (own.target) this.target.value = own.target;
    this.parameters = new Map();
    this.rows({ names: [], unknown: Object.keys(own.parameters) });
    for (const [key, entry] of Object.entries(own.parameters)) {
      const inputs = this.parameters.get(key);
      if (inputs) for (const part of /** @type {const} */ (['value', 'min', 'max', 'unit'])) inputs[part].value = String(entry[part] ?? '');
    }
    this.later();
  }

  /** Mend one that is in the model. @param {string} name @param {OwnFormula} own */
  edit(name, own) { this.fill(name, own, name); focus(this.expression); this.keep(); }

  /** @param {View} view */
  take(view) {
    const first = !this.target.value;
    const chosen = this.target.value || view.targets.default;
    this.target.replaceChildren(...view.targets.all.map((name) => h('option', { value: name, text: name, selected: name === chosen })));
    if (first) this.restore();
    this.known = view.names;
    this.names.textContent = `Known names: ${view.names.join(', ')}; any other becomes a parameter to fit.`;
    this.expression.placeholder = `${view.names.includes('k') ? 'c' : 'k'} * ${view.names.includes('omega') ? 'omega' : view.plot.variable}**3`;
  }

  /** The names that go on from the word at the caret; one that is pressed takes its place. */
  offer() {
    const { expression } = this, { value } = expression, at = expression.selectionStart ?? value.length;
    const word = /[A-Za-z_]\w*$/.exec(value.slice(0, at))?.[0] ?? '';
    const found = word ? this.known.filter((name) => name.startsWith(word) && name !== word).slice(0, 8) : [];
    if (found.join() === [...this.offers.children].map((one) => one.textContent).join()) return;
    this.offers.replaceChildren(...found.map((name) => h('button', {
      type: 'button', class: 'quiet', text: name, onclick: () => {
        const begin = at - word.length;
        expression.value = value.slice(0, begin) + name + value.slice(at);
        expression.focus();
        expression.setSelectionRange(begin + name.length, begin + name.length);
        this.offer();
        this.keep();
        this.later();
      },
    })));
  }

  later() {
    clearTimeout(this.timer);
    this.button.disabled = this.drawn.disabled = true;
    this.timer = setTimeout(() => this.check(), WAIT_MS);
  }

  body() {
    /** @type {Record<string, { value: number | string, min: number | string | null, max: number | string | null, unit: string }>} */
    const parameters = {};
    for (const [name, inputs] of this.parameters) {
      /** @param {'value' | 'min' | 'max'} key */
      const of = (key) => { // what is no number goes as it is, and the server says so
        const text = inputs[key].value.trim();
        return text === '' ? null : Number.isFinite(Number(text)) ? Number(text) : text;
      };
      parameters[name] = { value: of('value') ?? 0, min: of('min'), max: of('max'), unit: inputs.unit.value.trim() };
    }
    return { expression: this.expression.value.trim(), target: this.target.value, parameters };
  }

  /** @param {ReturnType<OwnEffect['body']>} body */
  command(body) {
    const options = Object.entries(body.parameters).map(([name, p]) => {
      const limits = p.min === null && p.max === null && !p.unit ? '' : `:${p.min ?? ''}:${p.max ?? ''}${p.unit ? `:${p.unit}` : ''}`;
      return quote(`--parameter=${name}=${p.value}${limits}`);
    });
    return ['terrapin add', this.page.folder, quote(this.name.value || 'my_effect'), quote(`--expression=${body.expression}`), quote(`--target=${body.target}`), ...options, ...(this.mends ? ['--replace'] : [])].join(' ');
  }

  async check() {
    const { app, name } = this.page;
    const body = this.body();
    const turn = ++this.turn;
    if (!body.expression) { this.told(null, ''); return; }
    /** @type {ExpressionAnswer} */
    let found;
    try { found = await app.api('expression', { body: { case: name, ...body } }); } catch (error) { this.told(false, lineOf(error)); return; }
    if (turn !== this.turn) return;
    this.formula.innerHTML = found.mathml || ''; // typeset by the server from a parsed formula
    const changed = this.rows(found);
    if (changed) { this.check(); return; } // with the parameters that it needs
    const named = /^[A-Za-z_]\w*$/.test(this.name.value);
    this.told(found.ok && named, named ? found.message : 'name: letters, digits and _ expected');
    app.showCommand(this.command(this.body()));
  }

  /** What the check says; null: nothing yet. @param {boolean | null} good @param {string} text */
  told(good, text) {
    this.answer.textContent = text;
    this.answer.className = `small ${good === null ? '' : good ? 'good' : 'bad'}`;
    this.button.disabled = !good;
    this.drawn.disabled = !good || Boolean(this.mends); // one that is in the model is drawn already
  }

  /** A row of inputs for every name that has no meaning; true when that changed. @param {{ names: string[], unknown: string[] }} found */
  rows(found) {
    const wanted = [...new Set([...found.unknown, ...[...this.parameters.keys()].filter((name) => !found.names.length || found.names.includes(name))])];
    if (wanted.join() === [...this.parameters.keys()].join()) return false;
    const kept = new Map(wanted.map((name) => [name, this.parameters.get(name) || {
      value: h('input', { type: 'text', inputmode: 'decimal', value: '0', 'aria-label': `start value of ${name}` }),
      min: h('input', { type: 'text', inputmode: 'decimal', 'aria-label': `lowest value of ${name}` }),
      max: h('input', { type: 'text', inputmode: 'decimal', 'aria-label': `highest value of ${name}` }),
      unit: h('input', { type: 'text', placeholder: 'as needed', 'aria-label': `unit of ${name}` }),
    }]));
    this.parameters = kept;
    this.table.replaceChildren(...(kept.size ? [h('table', { class: 'inputs' },
      h('thead', {}, h('tr', {}, ['parameter', 'start', 'min', 'max', 'unit'].map((text) => h('th', { scope: 'col', text })))),
      h('tbody', {}, [...kept].map(([name, inputs]) => h('tr', {}, h('th', { scope: 'row', text: name }), Object.values(inputs).map((input) => h('td', {}, input))))))] : []));
    return true;
  }

  async add() {
    const body = this.body();
    const { mends } = this;
    if (await this.page.run({ do: 'add', effects: [this.name.value], ...body, ...(mends ? { replace: true } : {}) })) {
      sessionStorage.removeItem(this.kept);
      this.mends = '';
      this.name.readOnly = false;
      this.button.textContent = 'Add it';
      this.expression.value = '';
      this.parameters = new Map();
      this.table.replaceChildren();
      this.formula.replaceChildren();
      this.told(null, '');
      if (document.activeElement === document.body || document.activeElement === this.button) focus(this.expression);
    }
  }
}

// ---------------------------------------------------------------- the controller

export class Controller {
  /** @param {CasePage} page */
  constructor(page) {
    this.page = page;
    /** @type {View | null} */
    this.view = null;
    this.picked = '';
    this.told = false;
    this.result = h('div', { role: 'status' });
    this.scenario = h('select', { 'aria-label': 'Scenario to try the parameters in', onchange: () => { this.picked = this.scenario.value; this.choose(); } });
    /** @type {Pick<Scenario, 'name' | 'effects'>[]} */
    this.scenarios = [{ name: 'heated_winding', effects: { motor_heating: {} } }, { name: 'steady_sand', effects: {} }]; // until the server has told
    this.warning = h('p', { class: 'warn small', hidden: true });
    this.button = h('button', { type: 'button', text: 'Export parameters', onclick: () => this.export() });
    this.hint = h('p', { class: 'soft small' });
    this.element = h('section', { class: 'panel', 'aria-label': 'Send to controller' }, h('h2', { text: 'Send to controller' }), this.hint,
      h('div', { class: 'row' }, this.button, h('label', {}, 'try in ', this.scenario)), this.warning, this.result);
  }

  /** @param {View} view */
  async take(view) {
    this.button.disabled = view.exports.length === 0;
    this.hint.textContent = view.exports.length
      ? `The controller compensates ${view.exports.join(', ')}. The run shows its C_t error without and with these parameters.`
      : 'Nothing in the model that the controller compensates.';
    this.view = view;
    this.choose();
    if (this.told) return;
    this.told = true;
    try { this.scenarios = (await this.page.app.api('scenarios')).scenarios; } catch { return; } // the two that always ship
    this.choose();
  }

  /** The scenario that was picked, else the one whose robot has most of what the controller is to compensate. */
  choose() {
    const { view } = this;
    if (!view) return;
    const wanted = view.exports.length ? view.exports : view.missing;
    /** @param {Pick<Scenario, 'effects'>} one */
    const common = (one) => wanted.filter((name) => name in one.effects).length;
    const best = [...this.scenarios].sort((a, b) => common(b) - common(a) || Number(b.name === 'steady_sand') - Number(a.name === 'steady_sand'))[0];
    const chosen = this.scenarios.find((one) => one.name === this.picked) || best;
    this.scenario.replaceChildren(...this.scenarios.map((one) => h('option', { value: one.name, text: one.name.replaceAll('_', ' '), selected: one === chosen })));
    const lacks = view.exports.filter((name) => !(name in chosen.effects));
    this.warning.hidden = !lacks.length;
    this.warning.textContent = `The robot of this scenario has no ${lacks.join(', ')}: there the parameters have nothing to compensate.`;
  }

  async export() {
    const result = await this.page.run({ do: 'export', scenario: this.scenario.value || 'steady_sand' });
    if (result) this.show(result);
  }

  /** What a job has exported. @param {string} id */
  async restore(id) {
    try { this.show((await this.page.app.api(`jobs/${id}`)).result); } catch { /* it is gone: nothing to show */ }
  }

  /** @param {any} result of an export, alone or with that of the run that tried it */
  show(result) {
    const { page } = this;
    const [found, run] = Array.isArray(result) ? result : [result];
    if (!found?.parameters) return;
    /** @type {[string, Quantity][]} */
    const exported = Object.entries(found.parameters);
    const rows = exported.map(([name, p]) => h('tr', {}, h('td', { text: name }), h('td', { class: 'n', text: number(p.value, 6) }), h('td', { text: p.unit })));
    const error = run?.contact_error;
    const change = error?.before && error?.after
      ? h('p', {}, 'C', h('sub', { text: 't' }), ' error ', h('b', { text: `${number(1e3 * error.before.rms, 3)} → ${number(1e3 * error.after.rms, 3)} mN m` }), ` rms in ${run.scenario.replaceAll('_', ' ')} (rounding costs at most ${number(1e6 * found.rounding_torque, 3)} µN m)`)
      : h('p', { class: 'soft', text: 'In this scenario the robot never ran for a whole window: no C_t error to compare.' });
    const refused = Object.entries(found.reasons || {}).map(([name, reason]) => h('p', { class: 'soft small', text: `${name}: not compensated: ${reason}.` }));
    this.result.replaceChildren(change, h('table', {}, h('tbody', {}, rows)), ...refused,
      h('p', {}, h('a', { href: `/api/${page.path}/export`, download: `${page.name}.toml`, text: 'Save the parameters' }), h('span', { class: 'soft small', text: ' for terrapin run --parameters' })));
  }
}

// ---------------------------------------------------------------- tables below

/** @param {CasePage} page @param {View} view */
export function below(page, view) {
  const parameters = h('section', { class: 'panel' }, h('h2', { text: 'Parameters of the model' }),
    view.formulas.map(([left, formula]) => h('div', { class: 'row' }, h('span', { class: 'soft', text: `${left} =` }), h('span', { html: formula }))),
    h('table', {}, h('tbody', {}, view.parameters.map(([key, text, stuck]) => h('tr', {}, h('td', {}, key, stuck ? h('span', { class: 'warn small', text: ` ${stuck}` }) : null),
      h('td', { class: 'wrap', text }))))));
  const errors = h('section', { class: 'panel' }, h('h2', { text: 'Errors and noise' }),
    h('table', {}, h('thead', {}, h('tr', {}, ['channel', 'noise sd', 'training', 'held out', 'unit'].map((text, i) => h('th', { class: i ? 'n' : '', text })))),
      h('tbody', {}, Object.entries(view.errors).map(([name, texts]) => h('tr', {}, h('td', { text: name }), texts.map((text, i) => h('td', { class: i < 3 ? 'n' : '', text })))))),
    h('p', { class: 'soft small', text: `${view.noise}.` }));
  const found = [parameters, errors, .../** @type {HTMLElement[]} */ ([heldOut(page, view), constants(page, view)].filter(Boolean))];
  if (view.front.length) found.unshift(h('section', { class: 'panel' }, h('h2', { text: 'Short answers first' }),
    h('table', {}, h('thead', {}, h('tr', {}, ['what is added', 'training', 'held out', 'probability'].map((text, i) => h('th', { class: i ? 'n' : '', text })))),
      h('tbody', {}, view.front.map((one) => h('tr', {}, h('td', { text: one.name }),
        h('td', { class: 'n', text: one.training }), h('td', { class: 'n', text: one.held_out }),
        h('td', { class: 'n', text: one.probability }))))),
    h('p', { class: 'soft small', text: 'Errors in noise sd; probability to be all that is missing.' })));
  if (view.chances.length) found.push(h('section', { class: 'panel' }, h('h2', { text: 'What these runs can show' }),
    h('table', {}, h('tbody', {}, view.chances.map(([what, often]) => h('tr', {}, h('td', { text: what }), h('td', { text: often })))))));
  if (view.history.length) found.push(h('section', { class: 'panel' }, h('h2', { text: 'History' }),
    h('ol', { class: 'small' }, view.history.slice(-12).map((one) => h('li', {}, `${one.action} `, h('b', { text: one.effects.join(' + ') || 'nothing' }), `: held out ${number(one.before.heldout_error, 3)} → ${number(one.after.heldout_error, 3)}`)))));
  if (view.curve) found.unshift(h('section', { class: 'panel' }, h('h2', { text: 'A curve that has no formula here' }), h('div', { html: view.curve })));
  const map = heat(view.plot, view.by_run, page.plots.variable, page.plots.channel, (run) => page.plots.pickRun(run));
  if (map) found.unshift(map);
  if (view.notes) found.push(h('section', { class: 'panel notes', html: view.notes }));
  return found;
}
