// The panel that drives the robot that is watched. Armed by a dialog; commands go out only while this page's heart beats,
// so a page that is closed, hidden or cut off drives nothing. While armed, space stops wherever the focus is.
import { h, number, told, unit } from '../app.js';
import { Calibration } from './calibration.js';
import { STOPS } from './everywhere.js';

const BEAT_MS = 100; // the server lets go 400 ms after the last one
const TERRAINS = ['hard_floor', 'sand', 'agricultural', 'red_terrain', 'dry_peat'];
const WHY = {
  '': 'Choose “a simulated robot … to drive” above, or a bus with a controller, and press Watch.',
  log: 'This is a replay: what it shows has happened, and nothing here can drive it.',
  simulator: 'A scenario drives itself. To drive one yourself choose “a simulated robot … to drive” above.',
  other: 'The DBC is not the controller’s own, so this page cannot speak to it.',
};
/** @type {Record<string, [number, number]>} */
const RANGES = { speed: [1, 0.01], voltage: [12, 0.1] }; // of the slider where the source says none, and its step

export class Drive {
  /** @param {LiveDesk & { telemetry: import('./telemetry.js').Telemetry, command(body: object): Promise<any>, setPaused(on: boolean): void, strip: { paused: number | null }, parameters: import('./parameters.js').Parameters }} desk */
  constructor(desk) {
    this.desk = desk;
    this.page = this.kind = '';
    this.mine = this.leaving = this.can = false;
    /** @type {Record<string, { limit: number }>} */
    this.limits = {};
    this.request = 'idle';
    /** @type {number | undefined} */
    this.timer = undefined;
    this.arm = h('button', { type: 'button', text: 'Arm …', onclick: () => { this.dialog.showModal(); this.yes.focus(); } });
    this.clear = h('button', { type: 'button', text: 'Clear faults', onclick: () => { this.ask('idle'); desk.command({ request: 'clear' }); } }); // after it nothing runs before an IDLE
    this.run = h('button', { type: 'button', class: 'main', text: 'Run', onclick: () => this.ask(this.request === 'run' ? 'idle' : 'run') });
    this.calibrate = h('button', { type: 'button', text: 'Calibrate', onclick: () => { this.led.begin(); this.ask('calibrate'); } });
    this.led = new Calibration(() => this.ask('idle'));
    this.off = h('button', { type: 'button', text: 'Disarm', onclick: () => this.disarm() });
    this.control = h('select', { 'aria-label': 'What is set', onchange: () => this.ranges() }, ...Object.keys(RANGES).map((name) => h('option', { value: name, text: name })));
    this.slider = h('input', { type: 'range', 'aria-label': 'Setpoint', oninput: () => { this.number.value = this.slider.value; this.beat(); } });
    this.number = h('input', { type: 'number', class: 'short', 'aria-label': 'Setpoint as a number', onchange: () => this.typed() });
    this.unit = h('span', { class: 'soft' });
    this.limiter = h('input', { type: 'checkbox', checked: true, onchange: () => this.beat() });
    this.yes = h('button', { type: 'button', class: 'main', text: 'Arm', onclick: () => this.armed() });
    this.dialog = h('dialog', { 'aria-label': 'Arm the robot' }, h('h2', { text: 'Arm the robot?' }),
      h('p', { text: 'From now on this page drives it: it moves as soon as you press Run. Space stops it at once, whatever has the focus; so does every other page of this server. Commands end when this page is closed or hidden, and the controller then switches its bridge off.' }),
      h('div', { class: 'row' }, this.yes, h('button', { type: 'button', text: 'Cancel', onclick: () => { this.dialog.close(); this.arm.focus(); } })));
    this.words = h('p', { class: 'soft small' });
    this.said = h('p', { class: 'small', role: 'status' });
    this.ground = h('select', { 'aria-label': 'Ground of the simulated robot', onchange: () => { void this.change(`ground = ${this.ground.value}`); } }, ...TERRAINS.map((name) => h('option', { value: name, text: name.replace('_', ' ') })));
    this.slope = h('select', { 'aria-label': 'Slope of the simulated robot', onchange: () => { void this.change(`slope = ${this.slope.value} deg`); } }, ...[0, 2, 5, 8].map((d) => h('option', { value: String(d), text: `${d}°` })));
    this.controls = h('div', { class: 'form', hidden: true },
      h('div', { class: 'row' }, this.control, this.number, this.unit),
      this.slider, h('label', { class: 'row' }, this.limiter, 'slip limiter'),
      h('div', { class: 'row' }, this.run, this.calibrate, this.off));
    this.simulated = h('div', { class: 'row', hidden: true }, h('span', { class: 'soft small', text: 'Simulated ground' }), this.ground, this.slope);
    this.stops = h('p', { class: 'soft small' });
    this.about = h('details', { class: 'small', hidden: true }, h('summary', { text: 'What Stop does' }), this.stops);
    this.element = h('section', { class: 'panel drive-panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Drive' })),
      this.words, h('div', { class: 'row' }, this.arm, this.clear), this.controls, this.led.element, this.simulated, this.said, this.about, this.dialog);
    this.ranges();
    addEventListener('keydown', (event) => this.key(event), true);
    addEventListener('keyup', (event) => { if (event.key === ' ' && this.mine) { event.preventDefault(); event.stopPropagation(); } }, true);
    document.addEventListener('visibilitychange', () => { if (document.hidden && this.mine) { this.stopBeating(); } });
  }

  /** Another source, or none. @param {Hello} said */
  begin(said) {
    this.stopBeating();
    this.page = said.page || '';
    this.kind = said.name === null ? '' : said.kind || 'bus';
    this.limits = said.drive || {};
    this.ranges();
    this.can = Boolean(said.drive);
    this.say();
    this.about.hidden = said.name === null || !said.stop;
    this.stops.textContent = STOPS[said.stop || ''] ?? '';
    this.arm.disabled = this.clear.disabled = !this.can;
    this.controls.hidden = true;
    this.simulated.hidden = this.kind !== 'robot';
    this.said.textContent = '';
    if (this.dialog.open) this.dialog.close();
  }

  /** How this page stands to the robot. */
  say() {
    told(this.words, !this.can ? WHY[/** @type {keyof typeof WHY} */ (this.kind)] ?? WHY.other
      : this.mine ? 'Armed: this page drives. Space stops, whatever has the focus.' : 'Nothing goes to the robot before you arm it.');
  }

  /** What the robot that is watched takes either way, in whole steps, and the step. @returns {[number, number]} */
  range() {
    const [most, step] = RANGES[this.control.value], limit = this.limits[this.control.value]?.limit ?? most;
    return [Number((Math.floor(limit / step + 1e-6) * step).toFixed(2)), step];
  }

  /** A setpoint that was typed: what is beyond the slider's ends is not taken as it is, and said. */
  typed() {
    const [most] = this.range(), asked = Number(this.number.value) || 0, taken = Math.min(most, Math.max(-most, asked));
    if (taken !== asked) this.desk.tell(`setpoint: found ${number(asked)} ${this.unit.textContent}, expected at most ${most} either way: ${number(taken)} is set`);
    this.number.value = this.slider.value = String(taken);
    this.beat();
  }

  ranges() {
    const [most, step] = this.range();
    for (const input of [this.slider, this.number]) Object.assign(input, { min: String(-most), max: String(most), step: String(step), value: '0' });
    this.unit.textContent = this.control.value === 'voltage' ? 'V' : 'm/s';
    this.beat();
  }

  async armed() {
    this.dialog.close();
    const answer = await this.desk.command({ request: 'arm', page: this.page });
    if (!answer) return;
    this.mine = true;
    this.request = 'idle';
    this.number.value = this.slider.value = '0';
    this.timer = setInterval(() => this.beat(), BEAT_MS);
    this.controls.hidden = false;
    this.arm.disabled = true;
    this.beat();
    this.run.focus();
  }

  /** @param {string} request */
  ask(request) { this.request = request; if (request !== 'calibrate') this.led.leave(); this.run.textContent = request === 'run' ? 'Halt' : 'Run'; this.beat(); }

  /** This page is there, and wants this. */
  beat() {
    if (!this.mine || document.hidden) return;
    const [most] = this.range(), setpoint = Math.min(most, Math.max(-most, Number(this.number.value) || 0));
    this.desk.telemetry.send({ beat: { request: this.request, control: this.control.value, setpoint, limiter: this.limiter.checked } });
  }

  async disarm() { this.ask('idle'); await this.desk.command({ request: 'disarm', page: this.page }); }

  stopBeating() { clearInterval(this.timer); this.mine = false; this.controls.hidden = true; this.run.textContent = 'Run'; this.request = 'idle'; this.led.leave(); }

  /** @param {string} change */
  async change(change) {
    const { app, run } = this.desk;
    const answer = await run(() => app.api('live/robot', { body: { change } }));
    if (answer) { app.announce(answer.done); app.showCommand(answer.command); }
  }

  /** While armed space stops, whatever has the focus; P pauses the picture. @param {KeyboardEvent} event */
  key(event) {
    const typing = event.target instanceof HTMLInputElement && event.target.type === 'text';
    if (this.mine && event.key === ' ') {
      if (!typing || this.element.getClientRects().length) event.preventDefault(); // what is typed on another tab keeps its spaces
      event.stopPropagation();
      this.stopBeating();
      void this.desk.command({ request: 'idle' });
    } else if (event.key === 'p' && !typing && !event.ctrlKey && !event.metaKey && !event.altKey && this.element.getClientRects().length) {
      this.desk.setPaused(this.desk.strip.paused === null);
    }
  }

  /** @param {Status} now */
  draw(now) {
    const { drive } = now, other = Boolean(drive?.driver) && drive?.driver !== this.page;
    if (this.mine && drive && drive.driver !== this.page) {
      this.ended = (this.ended || 0) + 1; // a status may have been on its way when it was armed
      if (this.ended > 3) { this.stopBeating(); if (!now.stop_held) this.desk.tell(`No longer armed: ${drive.ended}. Arm again to go on.`); }
    } else this.ended = 0;
    if (this.mine && now.state !== 'live') this.stopBeating(); // it is gone: what is told once must do
    this.arm.disabled = !this.can || this.mine || other || now.stop_held || now.state !== 'live';
    this.clear.disabled = !this.can || now.stop_held || now.state !== 'live';
    const text = !this.can ? '' : other ? 'Another page drives. Stop works here all the same.' : now.stop_held ? 'Stopped. Release the stop, then arm again.'
      : this.mine && now.faults.length ? `Nothing moves while a fault is set: ${now.faults.map((f) => f.name).join(', ')}. Mend its cause, then Clear faults.`
      : this.mine && drive ? `${drive.leaving ? 'halting' : drive.request} ${drive.setpoint.toFixed(2)}${unit(drive.control === 'voltage' ? 'V' : 'm/s')}; ${drive.sent} commands sent` : '';
    told(this.said, text);
    this.say();
    this.led.draw(this.desk.telemetry, this.desk.parameters.known.find((p) => p.name === 'calibrate_steps')?.value);
    this.element.classList.toggle('armed', this.mine);
  }
}
