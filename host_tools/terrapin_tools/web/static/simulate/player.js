// A run played back: the robot rolling, a slider for the moment, strip charts, and the checks.
import { fixed, h, still } from '../app.js';
import { Robot, at } from '../robot.js';
import { COLOURS, PLACES, Ring, Strip } from '../strip.js';

const DEGREE = Math.PI / 180;
// column, title, unit, the truth that belongs on its axis, the sd of a band around it, whether it is valid
const CHARTS = [
  ['estimate', 'C_t by the controller', 'N m', 'contact_torque', 'estimate_sd', 'estimate_valid'], ['contact_torque', 'contact torque C_t (truth)', 'N m'], ['slip', 'slip', '1'],
  ['swing_angle', 'swing angle', 'rad'], ['speed', 'speed', 'm/s'], ['sinkage', 'sinkage', 'm'], ['current', 'current', 'A'],
];
const DRAWN_MS = 60; // between pictures of the strip charts while it plays

export class Player {
  constructor() {
    /** @type {Run | null} */
    this.run = null;
    /** @type {Run | null} */
    this.other = null; // over it
    this.shown = this.playing = false;
    this.time = this.before = this.drawn = 0;
    this.name = h('h2', { text: 'The robot' });
    this.place = h('div');
    this.robot = new Robot(this.place);
    this.play = h('button', { type: 'button', text: 'Play', onclick: () => this.setPlaying(!this.playing) });
    this.pace = h('select', { 'aria-label': 'Pace' }, ...[0.1, 0.25, 0.5, 1, 2, 5].map((p) => h('option', { value: String(p), text: `${p} ×`, selected: p === 1 })));
    this.scrub = h('input', { type: 'range', min: '0', max: '1', step: '0.01', value: '0', 'aria-label': 'Moment', disabled: true, oninput: () => { this.go(Number(this.scrub.value)); } });
    this.clock = h('output', { class: 'n', text: '–' });
    this.facts = h('p', { class: 'small soft', 'aria-live': 'off' });
    this.charts = h('div');
    this.charts.style.height = '150px';
    this.strip = new Strip(this.charts);
    this.strip.empty = 'Slip, torque, swing and more, once there is a run.';
    this.strip.onPick = (picked) => { if (this.run) this.go(picked); };
    this.checks = h('ul', { class: 'checks' });
    this.checksTitle = h('h2', { text: 'Checks' });
  }

  /** The robot, and what it did. @param {HTMLElement} beside what stands beside the charts' title */
  panels(beside) {
    return [
      h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, this.name),
        this.place, h('div', { class: 'play' }, this.play, this.pace, this.scrub, this.clock), this.facts),
      h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'What it did' }), h('div', { class: 'choices' }, beside)), this.charts),
    ];
  }

  /** Another run over this one, or none. @param {Run | null} other */
  overlay(other) {
    this.other = other;
    if (this.run) this.open(this.run, false);
  }

  /** A run, rolling or at its begin. @param {Run} run @param {boolean} roll */
  open(run, roll) {
    this.run = run;
    const { columns } = run, { time: times } = columns;
    this.robot.show(run);
    this.name.textContent = `${run.name}${run.run.title ? `: ${run.run.title}` : ''}${run.run.complete ? '' : ' (cut short)'}`;
    this.time = times[0];
    Object.assign(this.scrub, { min: String(times[0]), max: String(times[times.length - 1]), value: String(this.time), disabled: false });
    /** @param {Run} of */
    const there = (of) => (/** @type {string | undefined} */ key) => (key && of.columns[key]?.some((v) => v) ? ringOf(of, key) : null);
    const mine = there(run), theirs = this.other ? there(this.other) : () => null;
    this.strip.lanes = CHARTS.filter(([key]) => mine(key) && !(key === 'contact_torque' && mine('estimate'))).slice(0, 6).map(([key, text, unitText, truth, sd, valid], i) => (
      { name: text, unit: unitText, words: null, colour: COLOURS[i % COLOURS.length], ring: ringOf(run, key), truth: mine(truth), sd: mine(sd), valid: valid && run.columns[valid] ? ringOf(run, valid) : null, other: theirs(key), places: PLACES[key] }));
    this.strip.seconds = times[times.length - 1] - times[0] || 1;
    this.strip.end = times[times.length - 1];
    this.strip.events = events(run);
    this.charts.style.height = `${Math.max(1, this.strip.lanes.length) * 86 + 76}px`;
    this.showChecks(run);
    this.draw();
    this.setPlaying(roll && !still());
  }

  /** @param {Run} run */
  showChecks(run) {
    const passed = run.checks.filter((c) => c.passed).length, failed = passed < run.checks.length;
    this.checksTitle.textContent = run.checks.length ? `Checks: ${passed} of ${run.checks.length} hold` : 'Checks';
    this.checks.replaceChildren(
      ...(run.changes.length ? [h('li', { text: `This run: ${run.changes.join(', ')}.` })] : []),
      ...(failed && run.course ? [h('li', { text: run.course })] : []),
      ...(run.checks.length ? run.checks.map((c) => h('li', {}, h('b', { class: c.passed ? 'good' : 'bad', text: c.passed ? 'holds' : 'fails' }), h('code', { text: c.missed || c.found }))) : [h('li', { class: 'soft', text: 'This run has none, or did not end.' })]),
      ...(failed ? [h('li', { class: 'soft', text: run.judged })] : []));
  }

  /** Stop at a moment. @param {number} time */
  go(time) {
    this.time = time;
    this.setPlaying(false);
    this.draw();
  }

  /** @param {boolean} on */
  setPlaying(on) {
    const { run } = this;
    this.playing = on && run !== null;
    this.play.textContent = this.playing ? 'Pause' : 'Play';
    if (!this.playing || !run) return;
    const times = run.columns.time, last = times[times.length - 1];
    if (this.time >= last - 1e-9) this.time = times[0];
    this.before = performance.now();
    const step = (/** @type {number} */ now) => {
      if (!this.playing || !this.shown) return;
      this.time = Math.min(last, this.time + (now - this.before) / 1000 * Number(this.pace.value));
      this.before = now;
      this.draw();
      if (this.time >= last) this.setPlaying(false); else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  draw() {
    const { run, time } = this;
    if (!run) { this.robot.draw(); return; }
    const { columns } = run, times = columns.time;
    const row = Math.min(times.length - 1, Math.max(0, (time - times[0]) / ((times[times.length - 1] - times[0]) || 1) * (times.length - 1)));
    this.robot.row = row;
    this.robot.draw();
    this.scrub.value = String(time);
    this.clock.textContent = `${time.toFixed(2)} s`;
    this.facts.textContent = factsOf(run, row);
    if (!this.playing || performance.now() - this.drawn > DRAWN_MS) {
      this.drawn = performance.now();
      this.strip.fixed = time;
      this.strip.draw();
    }
  }
}

/** A column over time. @param {Run} run @param {string} key */
function ringOf(run, key) {
  const ring = new Ring(), { time } = run.columns;
  run.columns[key].forEach((v, row) => { if (v !== null) ring.push(time[row], v); });
  return ring;
}

/** What stands under the robot at a row. @param {Run} run @param {number} row */
function factsOf(run, row) {
  const { columns } = run;
  /** Between rows, in a smaller unit; as is for 1. @param {string} key */
  const value = (key, divisor = 1) => { const v = at(columns, key, row); return v === null ? null : v / divisor; };
  const whole = (/** @type {string} */ key) => (columns[key] ? columns[key][Math.floor(row)] : null);
  const estimate = whole('estimate'), code = whole('state'), state = code === null ? '' : run.words.state[code];
  return [
    `at ${fixed(value('position'), 3)} m`, `${fixed(value('speed'), 3)} m/s`, `slip ${fixed(value('slip'), 3)}`,
    `C_t ${fixed(value('contact_torque', 1e-3), 1)} mN m, by the controller ${whole('estimate_valid') ? fixed(estimate === null ? null : estimate * 1e3, 1) : 'not valid'}`,
    `swing ${fixed(value('swing_angle', DEGREE), 1)}°`, `slope ${fixed(value('slope', DEGREE), 1)}°`, state ? `state ${state}` : '',
  ].filter(Boolean).join('  ·  ');
}

/** What happened in a run: faults that were injected, states, the limiter. @param {Run} run @returns {Mark[]} */
function events(run) {
  const { columns } = run;
  /** @type {(Mark & { time: number })[]} */
  const found = [];
  for (const fault of run.faults) {
    found.push({ time: fault.begin, kind: 'injected', text: `${fault.text} injected` });
    if (fault.end !== null) found.push({ time: fault.end, kind: 'injected', text: `${fault.text} over` });
  }
  (columns.state || []).forEach((state, i) => { if (i && state !== columns.state[i - 1] && state !== null) found.push({ time: columns.time[i], kind: 'state', text: run.words.state[state] }); });
  (columns.limiting || []).forEach((on, i) => { if (i && on && !columns.limiting[i - 1]) found.push({ time: columns.time[i], kind: 'limiter', text: 'limiter holds' }); });
  return found.sort((a, b) => a.time - b.time);
}
