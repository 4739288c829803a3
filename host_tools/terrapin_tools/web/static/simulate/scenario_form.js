// What can be changed of a scenario: ground, operator, effects and faults as sliders and lists; `body` is what is asked for.
import { h, number, unit } from '../app.js';

const DEGREE = Math.PI / 180;
const group = (/** @type {string} */ text, /** @type {Child[]} */ ...children) => h('fieldset', {}, h('legend', { text }), ...children);
const mostSupply = (/** @type {Scenario} */ scenario) => Math.max(20, Math.ceil(1.5 * scenario.supply)); // V
const words = (/** @type {string} */ name) => name.replaceAll('_', ' ');

export class ScenarioForm {
  /** `changed(command)` is called with the command line whenever something is. @param {(command: string) => void} changed */
  constructor(changed) {
    this.changed = changed;
    /** @type {Scenarios | null} */
    this.description = null;
    this.select = h('select', { id: 'sim-scenario', onchange: () => { this.choose(this.select.value); } });
    this.title = h('p', { class: 'soft small' });
    this.reset = h('button', { type: 'button', text: 'As shipped', onclick: () => this.choose(this.select.value) });
    this.link = h('select', { 'aria-label': 'Where the controller runs', onchange: () => this.command() },
      h('option', { value: 'inprocess', text: 'controller in this process' }), h('option', { value: 'pty', text: 'controller as a process, over a pty' }));
    this.form = h('div', { class: 'sim-form' });
  }

  /** The panel, with what starts a run. @param {HTMLButtonElement} start */
  panel(start) {
    return h('section', { class: 'panel sim-form' },
      h('div', { class: 'panel-head' }, h('h2', { text: 'Scenario' })),
      h('label', { for: 'sim-scenario', class: 'visually-hidden', text: 'Scenario' }), this.select, this.title,
      h('div', { class: 'row' }, start, this.reset), this.link, this.form);
  }

  /** What the server offers. @param {Scenarios} description */
  take(description) {
    this.description = description;
    this.select.replaceChildren(...description.scenarios.map((s) => h('option', { value: s.name, text: s.title || s.name })));
    this.select.value = 'steady_sand';
    this.choose(this.select.value);
  }

  /** A scenario as it is shipped, or as a run had it. @param {string} wanted @param {Run | null} run */
  choose(wanted, run = null) {
    const scenario = this.description?.scenarios.find((s) => s.name === wanted);
    if (!scenario) return;
    const as = run?.settings ?? scenario;
    this.scenario = scenario;
    this.select.value = wanted;
    /** @type {Changes} */
    this.changes = {
      ground: as.ground.map((g) => ({ terrain: g.terrain, slope: g.slope })), setpoints: as.orders.map((o) => o.setpoint),
      limiter: as.orders.some((o) => o.limiter), effects: structuredClone(as.effects), faults: structuredClone(as.faults),
      seed: as.seed, duration: as.duration, supply: as.supply, soil: as.soil,
    };
    this.title.textContent = run ? `${scenario.name} as in the run ${run.name}: ${run.changes.join(', ') || 'as shipped'}` : `${scenario.name}: ${scenario.duration} s, ${scenario.checks} checks`;
    this.fields();
  }

  /**
   * A slider from low to high; `change` gets its value times `factor`.
   * @param {string} text @param {number} low @param {number} high @param {number} value @param {number} step @param {string} unitText
   * @param {(value: number) => void} change
   */
  slider(text, low, high, value, step, unitText, change, factor = 1) {
    const out = h('output', { class: 'n' });
    const say = (/** @type {number} */ v) => { out.textContent = `${number(v, 3)}${unit(unitText)}`; };
    const input = h('input', {
      type: 'range', min: String(low), max: String(high), step: String(step), value: String(value / factor), 'aria-label': text,
      oninput: () => { say(Number(input.value)); change(Number(input.value) * factor); this.command(); },
    });
    say(value / factor);
    return h('div', { class: 'slider' }, h('span', { text }), out, input);
  }

  /** @param {string[]} list @param {string} value @param {(value: string) => void} change @param {string} label */
  options(list, value, change, label) {
    const box = h('select', { 'aria-label': label, onchange: () => { change(box.value); this.command(); } }, ...list.map((o) => h('option', { value: o, text: words(o), selected: o === value })));
    return box;
  }

  fields() {
    const { description, scenario, changes } = this;
    if (!description || !scenario || !changes) return;
    const effects = description.effects.filter((e) => !(e.name in changes.effects) && (!e.soil || scenario.contact));
    this.form.replaceChildren(
      group('Ground', ...this.ground(description, scenario, changes)),
      group('Operator', ...this.operator(scenario, changes)),
      group('Effects', ...Object.entries(changes.effects).flatMap(([effect, values]) => this.effect(description, changes, effect, values)),
        this.add('Add an effect …', effects.map((e) => [e.name, e.title]), (wanted) => this.addEffect(description, changes, wanted))),
      group('Faults', ...changes.faults.flatMap((fault, i) => this.fault(description, changes, fault, i)),
        this.add('Add a fault …', Object.keys(description.faults).map((k) => [k, words(k)]), (kind) => this.addFault(description, changes, kind))));
    this.command();
  }

  /** @param {Scenarios} description @param {Scenario} scenario @param {Changes} changes */
  ground(description, scenario, changes) {
    const ground = scenario.ground.flatMap((g, i) => {
      const where = scenario.ground.length > 1 ? ` from ${number(g.from)} m` : '';
      const slope = this.slider(`slope${where}`, -20, 20, changes.ground[i].slope, 0.5, '°', (v) => { changes.ground[i].slope = v; }, DEGREE);
      return scenario.contact ? [slope] : [h('div', { class: 'row' }, h('span', { class: 'small grow', text: `ground${where}` }), this.options(description.terrains, g.terrain, (v) => { changes.ground[i].terrain = v; }, `Ground${where}`)), slope];
    });
    if (scenario.soil) ground.unshift(h('div', { class: 'row' }, h('span', { class: 'small grow', text: 'soil' }), this.options(description.soils, scenario.soil, (v) => { changes.soil = v; }, 'Soil')));
    return ground;
  }

  /** @param {Scenario} scenario @param {Changes} changes */
  operator(scenario, changes) {
    const orders = scenario.orders.map((o, i) => {
      const speed = o.control === 'speed', set = Math.abs(o.setpoint);
      const most = speed ? Math.max(1.5, Math.ceil(2 * set)) : Math.max(12, Math.ceil(Math.max(scenario.supply, set)));
      return o.request !== 'run' ? null : this.slider(`${o.control} from ${number(o.at)} s`, -most, most, o.setpoint, speed ? 0.01 : 0.1, speed ? 'm/s' : 'V', (v) => { changes.setpoints[i] = v; });
    });
    const limiter = h('input', { type: 'checkbox', id: 'sim-limiter', checked: changes.limiter, onchange: () => { changes.limiter = limiter.checked; this.command(); } });
    return [...orders,
      h('div', { class: 'row' }, limiter, h('label', { for: 'sim-limiter', text: 'slip limiter' })),
      this.slider('supply', 0, mostSupply(scenario), changes.supply, 0.1, 'V', (v) => { changes.supply = v; }),
      this.slider('duration', 1, Math.max(60, scenario.duration), changes.duration, 1, 's', (v) => { changes.duration = v; }),
      this.slider('seed', 0, 50, changes.seed, 1, '', (v) => { changes.seed = v; })];
  }

  /** A list of what can be added: values with the words for them. @param {string} text @param {string[][]} list @param {(value: string) => void} change */
  add(text, list, change) {
    const box = h('select', { 'aria-label': text, onchange: () => { if (box.value) { change(box.value); this.fields(); } } }, h('option', { value: '', text }), ...list.map(([value, shownText]) => h('option', { value, text: shownText })));
    return h('div', { class: 'row part-head' }, box);
  }

  /** @param {Scenarios} description @param {Changes} changes @param {string} wanted */
  addEffect(description, changes, wanted) {
    const effect = description.effects.find((e) => e.name === wanted);
    if (!effect) return;
    changes.effects[wanted] = Object.fromEntries(effect.parameters.map((p, i) => [p.name, i ? p.start : Number((p.low < 0 && p.high <= 0 ? p.low / 4 : p.high / 4).toPrecision(2))]));
  }

  /** @param {Scenarios} description @param {Changes} changes @param {string} wanted @param {Record<string, number>} values */
  effect(description, changes, wanted, values) {
    const effect = description.effects.find((e) => e.name === wanted);
    if (!effect) return [];
    return [this.partHead(effect.title, () => { delete changes.effects[wanted]; }),
      ...effect.parameters.map((p) => this.slider(`${p.name}: ${p.meaning}`, p.low, p.high, values[p.name] ?? p.start, (p.high - p.low) / 200, p.unit, (v) => { values[p.name] = Number(v.toPrecision(6)); }))];
  }

  /** Where the slider of a fault's value ends; null without a value. @param {string} kind */
  mostOf(kind) {
    const high = this.description?.faults[kind].high ?? null;
    return high !== null && kind === 'supply' && this.scenario ? Math.max(high, mostSupply(this.scenario)) : high;
  }

  /** @param {Scenarios} description @param {Changes} changes @param {string} kind */
  addFault(description, changes, kind) {
    const { channels } = description.faults[kind], high = this.mostOf(kind);
    changes.faults.push({ kind, channel: channels[0] || '', value: high === null ? 0 : high / 2, begin: Math.round(changes.duration / 3), end: null });
  }

  /** @param {Scenarios} description @param {Changes} changes @param {Fault} fault @param {number} i */
  fault(description, changes, fault, i) {
    const { channels, unit: unitText } = description.faults[fault.kind];
    const end = changes.duration, most = this.mostOf(fault.kind), high = most === null ? null : Math.max(most, fault.value ?? 0);
    return [this.partHead(words(fault.kind), () => { changes.faults.splice(i, 1); }),
      ...(channels.length ? [this.options(channels, fault.channel, (v) => { fault.channel = v; }, 'Channel')] : []),
      ...(high !== null ? [this.slider('value', 0, high, fault.value ?? 0, high / 200, unitText, (v) => { fault.value = v; })] : []),
      this.slider('from', 0, end, fault.begin, 0.1, 's', (v) => { fault.begin = v; }),
      this.slider('to', 0, end, fault.end ?? end, 0.1, 's', (v) => { fault.end = v >= end ? null : v; })];
  }

  /** @param {string} text @param {() => void} remove */
  partHead(text, remove) {
    return h('div', { class: 'part-head' }, h('b', { text }), h('button', { type: 'button', class: 'quiet', text: 'Remove', 'aria-label': `Remove ${text}`, onclick: () => { remove(); this.fields(); } }));
  }

  /** What is asked of the server: only what differs from the scenario as shipped. */
  body() {
    const { description, scenario, changes } = this;
    /** @type {Record<string, any>} */
    const found = { scenario: scenario?.name, link: this.link.value };
    if (!description || !scenario || !changes) return found;
    const same = (/** @type {unknown} */ a, /** @type {unknown} */ b) => JSON.stringify(a) === JSON.stringify(b);
    for (const key of /** @type {const} */ (['duration', 'supply', 'soil', 'seed'])) if (changes[key] !== scenario[key]) found[key] = changes[key];
    const ground = changes.ground.map((g, i) => ({ ...(g.terrain !== scenario.ground[i].terrain ? { terrain: g.terrain } : {}), ...(Math.abs(g.slope - scenario.ground[i].slope) > 1e-9 ? { slope: g.slope } : {}) }));
    if (ground.some((g) => Object.keys(g).length)) found.ground = ground;
    if (!same(changes.setpoints, scenario.orders.map((o) => o.setpoint))) found.setpoints = changes.setpoints.map((s, i) => (s === scenario.orders[i].setpoint ? null : s));
    if (changes.limiter !== scenario.orders.some((o) => o.limiter)) found.limiter = changes.limiter;
    if (!same(changes.effects, scenario.effects)) found.effects = changes.effects;
    if (!same(changes.faults, scenario.faults)) found.faults = changes.faults.map((f) => ({ ...f, value: description.faults[f.kind].high === null ? null : f.value }));
    return found;
  }

  command() {
    const { scenario, changes } = this;
    if (!scenario || !changes) return;
    const changed = Object.keys(this.body()).some((key) => !['scenario', 'link', 'seed'].includes(key));
    this.reset.disabled = !changed && changes.seed === scenario.seed;
    this.changed(`terrapin run ${changed ? 'the scenario with these changes' : scenario.name}${this.link.value === 'pty' ? ' --link pty' : ''}${changes.seed !== scenario.seed ? ` --seed ${changes.seed}` : ''}`);
  }
}
