// Panels of a case beside the ranking: the next step, an effect of one's own, the controller; and the tables below.
import { focus, h, number, quote, unit } from './app.js';

const WAIT_MS = 250; // after the last key, before an expression is checked

// ---------------------------------------------------------------- the next step

/** What to measure or do next; nothing where the ranking or the button above says it already. */
export function nextStep(page) {
  const { next, discovered } = page.view;
  if (next.do === 'experiment') return [h('section', { class: 'panel next', 'aria-label': 'Next experiment' }, h('h2', { text: 'Next experiment' }), experiment(page, next))];
  if (next.do === 'nothing' && discovered) return [h('section', { class: 'panel next', 'aria-label': 'Next' }, h('h2', { text: 'Next' }), h('p', { text: next.text }))];
  return [];
}

function experiment(page, next) {
  const { view } = page;
  const head = h('tr', {}, next.vary.map((v) => h('th', { class: 'n', scope: 'col', text: `${v.role}${v.unit && v.unit !== '1' ? `, ${v.unit}` : ''}` })));
  const rows = next.settings.map((row) => h('tr', {}, row.map((value) => h('td', { class: 'n', text: number(value) }))));
  const wrong = 100 * next.error_rate, hold = next.hold.map((one) => `${one.role} ${number(one.value)}${unit(one.unit)}`).join(', ');
  const truth = h('select', { 'aria-label': 'What the simulated robot has' }, view.rivals.map((set, i) => h('option', { value: String(i), text: set.join(' + ') })));
  const run = h('button', { type: 'button', class: 'main', text: 'Run it in the simulator', onclick: () => simulate(page, view.rivals[Number(truth.value)]) });
  return [
    h('p', {}, h('b', { text: `${next.runs} runs` }), ` over these settings of ${next.vary.map((v) => v.role).join(' and ')} tell ${next.separates.join(' and ')} apart. ${next.text}`),
    h('div', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': 'Settings of the proposed runs' }, h('table', {}, h('thead', {}, head), h('tbody', {}, rows))),
    h('p', { class: 'soft small', text: `${hold ? `Hold ${hold}. ` : ''}Afterwards the wrong one would be preferred in ${wrong < 1 ? 'fewer than 1' : Math.round(wrong)} of 100 cases.` }),
    ...(next.simulator ? [h('div', { class: 'row' }, run, h('label', {}, 'as if true: ', truth)),
      h('p', { class: 'soft small', text: 'Simulated runs are no measurements: they come into a new case, beside the measured ones.' })]
      : [h('p', { class: 'soft small', text: 'The simulator has no such rig: measure these runs.' })]),
  ];
}

/** The proposed runs in a new case, and discover there. */
async function simulate(page, truth) {
  let to = `${page.name}-simulated`.slice(0, 60);
  const taken = (await page.app.api('cases')).map((one) => one.name);
  for (let n = 2; taken.includes(to); n++) to = `${`${page.name}-simulated`.slice(0, 56)}-${n}`;
  if (await page.run({ do: 'experiment', to, truth })) page.app.go('workbench', to);
}

// ---------------------------------------------------------------- an effect of one's own

export class OwnEffect {
  constructor(page) {
    this.page = page;
    this.parameters = new Map(); // name -> its inputs
    const field = (name, properties) => h('input', { type: 'text', name, autocomplete: 'off', spellcheck: 'false', ...properties });
    this.name = field('effect-name', { value: 'my_effect', maxlength: '64' });
    this.expression = field('expression', { placeholder: 'k * omega**3', maxlength: '2000' });
    this.target = h('select', { name: 'target' });
    this.table = h('div');
    this.formula = h('div', { class: 'eq' });
    this.answer = h('p', { class: 'small', role: 'status' });
    this.names = h('p', { class: 'soft small' });
    this.button = h('button', { type: 'submit', text: 'Add it', disabled: true });
    const form = h('form', { class: 'form', onsubmit: (event) => { event.preventDefault(); this.add(); } },
      h('div', { class: 'two' }, h('label', {}, 'name', this.name), h('label', {}, 'acts on', this.target)),
      h('label', {}, 'expression', this.expression), this.formula, this.table, this.answer, this.names, h('div', {}, this.button));
    this.element = h('details', { class: 'panel own' }, h('summary', {}, h('h2', { text: 'Own effect' }), h('span', { class: 'soft small', text: 'units checked as you type' })), form);
    form.addEventListener('input', () => this.later());
    this.target.addEventListener('change', () => this.later());
  }

  close() { clearTimeout(this.timer); }

  take(view) {
    const chosen = this.target.value || view.targets.default;
    this.target.replaceChildren(...view.targets.all.map((name) => h('option', { value: name, text: name, selected: name === chosen })));
    this.names.textContent = `Known names: ${view.names.join(', ')}; any other becomes a parameter to fit.`;
  }

  later() {
    clearTimeout(this.timer);
    this.button.disabled = true;
    this.timer = setTimeout(() => this.check(), WAIT_MS);
  }

  body() {
    const parameters = {};
    for (const [name, inputs] of this.parameters) {
      const of = (key) => { // what is no number goes as it is, and the server says so
        const text = inputs[key].value.trim();
        return text === '' ? null : Number.isFinite(Number(text)) ? Number(text) : text;
      };
      parameters[name] = { value: of('value') ?? 0, min: of('min'), max: of('max'), unit: inputs.unit.value.trim() };
    }
    return { expression: this.expression.value.trim(), target: this.target.value, parameters };
  }

  command(body) {
    const options = Object.entries(body.parameters).map(([name, p]) => {
      const limits = p.min === null && p.max === null && !p.unit ? '' : `:${p.min ?? ''}:${p.max ?? ''}${p.unit ? `:${p.unit}` : ''}`;
      return quote(`--parameter=${name}=${p.value}${limits}`);
    });
    return ['terrapin add', this.page.folder, quote(this.name.value || 'my_effect'), quote(`--expression=${body.expression}`), quote(`--target=${body.target}`), ...options].join(' ');
  }

  async check() {
    const { app, name } = this.page;
    const body = this.body();
    const turn = (this.turn = (this.turn || 0) + 1);
    if (!body.expression) { this.told(null, ''); return; }
    let found;
    try { found = await app.api('expression', { body: { case: name, ...body } }); } catch (error) { this.told(false, error.message); return; }
    if (turn !== this.turn) return;
    this.formula.innerHTML = found.mathml || ''; // typeset by the server from a parsed formula
    const changed = this.rows(found);
    if (changed) { this.check(); return; } // with the parameters that it needs
    const named = /^[A-Za-z_]\w*$/.test(this.name.value);
    this.told(found.ok && named, named ? found.message : 'name: letters, digits and _ expected');
    app.showCommand(this.command(this.body()));
  }

  told(good, text) {
    this.answer.textContent = text;
    this.answer.className = `small ${good === null ? '' : good ? 'good' : 'bad'}`;
    this.button.disabled = !good;
  }

  /** A row of inputs for every name that has no meaning; true when that changed. */
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
    if (await this.page.run({ do: 'add', effects: [this.name.value], ...body })) {
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
  constructor(page) {
    this.page = page;
    this.result = h('div', { role: 'status' });
    this.scenario = h('select', { 'aria-label': 'Scenario to try the parameters in', onchange: () => { this.picked = this.scenario.value; this.choose(); } });
    this.scenarios = [{ name: 'heated_winding', effects: { motor_heating: {} } }, { name: 'steady_sand', effects: {} }]; // until the server has told
    this.warning = h('p', { class: 'warn small', hidden: true });
    this.button = h('button', { type: 'button', text: 'Export parameters', onclick: () => this.export() });
    this.hint = h('p', { class: 'soft small' });
    this.element = h('section', { class: 'panel', 'aria-label': 'Send to controller' }, h('h2', { text: 'Send to controller' }), this.hint,
      h('div', { class: 'row' }, this.button, h('label', {}, 'try in ', this.scenario)), this.warning, this.result);
  }

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
    const wanted = this.view.exports.length ? this.view.exports : this.view.missing;
    const common = (one) => wanted.filter((name) => name in one.effects).length;
    const best = [...this.scenarios].sort((a, b) => common(b) - common(a) || (b.name === 'steady_sand') - (a.name === 'steady_sand'))[0];
    const chosen = this.scenarios.find((one) => one.name === this.picked) || best;
    this.scenario.replaceChildren(...this.scenarios.map((one) => h('option', { value: one.name, text: one.name.replaceAll('_', ' '), selected: one === chosen })));
    const lacks = this.view.exports.filter((name) => !(name in chosen.effects));
    this.warning.hidden = !lacks.length;
    this.warning.textContent = `The robot of this scenario has no ${lacks.join(', ')}: there the parameters have nothing to compensate.`;
  }

  async export() {
    const result = await this.page.run({ do: 'export', scenario: this.scenario.value || 'steady_sand' });
    if (result) this.show(result);
  }

  async restore(id) {
    try { this.show((await this.page.app.api(`jobs/${id}`)).result); } catch { /* it is gone: nothing to show */ }
  }

  show(result) {
    const { page } = this;
    const [found, run] = Array.isArray(result) ? result : [result];
    if (!found?.parameters) return;
    const rows = Object.entries(found.parameters).map(([name, p]) => h('tr', {}, h('td', { text: name }), h('td', { class: 'n', text: number(p.value, 6) }), h('td', { text: p.unit })));
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

export function below(page) {
  const { view } = page;
  const parameters = h('section', { class: 'panel' }, h('h2', { text: 'Parameters of the model' }),
    h('table', {}, h('tbody', {}, view.parameters.map((p) => h('tr', {}, h('td', {}, p.key, p.at_bound ? h('span', { class: 'warn small', text: ' at its bound' }) : null),
      h('td', { class: 'wrap', text: `${number(p.value, 5)} ± ${number(p.sd, 2)}${unit(p.unit)}` }))))));
  const errors = h('section', { class: 'panel' }, h('h2', { text: 'Errors and noise' }),
    h('table', {}, h('thead', {}, h('tr', {}, ['', 'noise sd', 'training', 'held out', ''].map((text, i) => h('th', { class: i ? 'n' : '', text })))),
      h('tbody', {}, Object.entries(view.channels).map(([name, c]) => h('tr', {}, h('td', { text: name }), [c.noise_sd, c.train_rmse, c.heldout_rmse].map((v) => h('td', { class: 'n', text: number(v) })), h('td', { text: unit(c.unit) }))))),
    h('p', { class: 'soft small', text: `${view.noise}. Correlation from row to row within a run: ${number(view.correlation)}.` }));
  const found = [parameters, errors];
  if (view.operating.length) found.push(h('section', { class: 'panel' }, h('h2', { text: 'What these runs can show' }),
    h('table', {}, h('thead', {}, h('tr', {}, h('th', { text: 'an effect like this' }), h('th', { class: 'n', text: 'named first in' }))),
      h('tbody', {}, view.operating.map((o) => h('tr', {}, h('td', { text: `${o.effect} of ${number(o.size)} noise sd` }), h('td', { class: 'n', text: `${Math.round(100 * o.named)} of 100` })))))));
  if (view.history.length) found.push(h('section', { class: 'panel' }, h('h2', { text: 'History' }),
    h('ol', { class: 'small' }, view.history.slice(-12).map((one) => h('li', {}, `${one.action} `, h('b', { text: one.effects.join(' + ') }), `: held out ${number(one.before.heldout_error, 3)} → ${number(one.after.heldout_error, 3)}`)))));
  const map = heat(page);
  if (map) found.unshift(map);
  if (view.notes) found.push(h('section', { class: 'panel notes', html: view.notes }));
  return found;
}

/** Mean residual by run and range of the variable, as a table with coloured cells. */
function heat(page) {
  const { plot } = page.view, { variable, channel } = page.plots;
  const one = plot.heat.columns[variable];
  if (!one) return null;
  const bins = one.mean[channel][0].length, short = (v) => number(v, 3);
  const name = (i) => (one.single ? short(one.edges[i]) : `${short(one.edges[i])} to ${short(one.edges[i + 1])}`);
  const size = Math.max(3, ...one.mean[channel].flat().filter((v) => v !== null).map(Math.abs));
  const cell = (value, i, count) => {
    const td = h('td', { text: value === null ? '' : number(value, 2), title: `${name(i)}: ${count} rows` });
    if (value !== null) td.style.background = `color-mix(in srgb, var(${value > 0 ? '--red' : '--blue'}) ${Math.round(45 * Math.min(1, Math.abs(value) / size))}%, transparent)`;
    return td;
  };
  const rows = plot.heat.runs.map((run, r) => h('tr', {}, h('th', { scope: 'row', text: `${plot.runs[run]}${plot.held[run] ? ' ◇' : ''}` }), one.mean[channel][r].map((value, i) => cell(value, i, one.count[r][i]))));
  return h('section', { class: 'panel heat' }, h('div', { class: 'panel-head' }, h('h2', { text: page.view.verdict === 'adequate' ? 'Residual by run' : 'Which runs carry it' }), h('span', { text: `mean residual of ${channel} in noise sd, by ${variable}; ◇ held out` })),
    h('div', { class: 'scroll wide', tabindex: '0', role: 'region', 'aria-label': 'Residual by run' }, h('table', {}, h('thead', {}, h('tr', {}, h('th', { text: 'run' }), Array.from({ length: bins }, (_, i) => h('th', { scope: 'col', text: name(i) })))), h('tbody', {}, rows))));
}
