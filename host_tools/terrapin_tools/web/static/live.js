// The Live tab: one source that the server watches; every browser sees the same. Pause, filter and the choice of signals
// are this browser's own.
import { h, lineOf, told } from './app.js';
import { Bus, Nodes } from './live/bus.js';
import { Drive } from './live/drive.js';
import { Events, Faults } from './live/events.js';
import { Flash } from './live/flash.js';
import { Layouts } from './live/layouts.js';
import { Parameters } from './live/parameters.js';
import { Recorder } from './live/record.js';
import { Replay } from './live/replay.js';
import { Signals } from './live/signals.js';
import { Source } from './live/source.js';
import { Telemetry } from './live/telemetry.js';
import { Tiles } from './live/tiles.js';
import { Rolling } from './rolling.js';
import { COLOURS, PLACES, Strip } from './strip.js';

const FIRST = ['MOTION.slip', 'GROUND.torque', 'ELECTRICAL.current', 'ACTUATE.state'];
/** @type {Record<string, string>} */
const TRUTH = { 'GROUND.torque': 'TRUTH.torque', 'MOTION.slip': 'TRUTH.slip', 'MOTION.ground_speed': 'TRUTH.ground_speed' }; // on one axis with it
/** @type {Record<string, string>} */
const VALID = { 'GROUND.torque': 'GROUND.valid', 'MOTION.slip': 'MOTION.slip_valid', 'ATTITUDE.pitch': 'ATTITUDE.pitch_valid' }; // whether it is worth anything
/** @type {Record<string, string>} */
const SD = { 'GROUND.torque': 'GROUND.torque_sd' }; // of a band around it
const SECONDS = [5, 15, 30, 60, 120, 300];
const MOST = 8; // lanes
const KEY = 'terrapin-live-signals';

/** @param {HTMLElement} element @param {App} app @returns {Tab} */
export function mount(element, app) {
  return new Live(element, app);
}

/** @implements {LiveDesk} */
class Live {
  /** @param {HTMLElement} element @param {App} app */
  constructor(element, app) {
    this.element = element;
    this.app = app;
    this.shown = false;
    /** @type {string[]} */
    this.chosen = JSON.parse(localStorage.getItem(KEY) || 'null') || FIRST; // signals that are drawn
    this.run = this.run.bind(this);
    this.tell = this.tell.bind(this);
    this.telemetry = new Telemetry(app, { hello: (said) => this.hello(said), status: (said) => this.status(said), until: (time, anew) => this.until(time, anew), tell: this.tell });
    this.source = new Source(this);
    this.tiles = new Tiles();
    this.replay = new Replay(this);
    this.faults = new Faults();
    this.parameters = new Parameters(this);
    this.flash = new Flash(this);
    this.bus = new Bus();
    this.nodes = new Nodes((node) => { void this.source.choose(node); });
    this.recorder = new Recorder(this, () => this.source.offer());
    this.events = new Events();
    this.signals = new Signals(this.telemetry, (name, box) => this.pick(name, box));
    this.notice = h('p', { class: 'notice bad', role: 'alert', hidden: true });
    const place = h('div');
    this.rolling = new Rolling();
    place.addEventListener('dragover', (event) => event.preventDefault());
    place.addEventListener('drop', (event) => { event.preventDefault(); this.signals.tick(event.dataTransfer?.getData('text/plain') ?? ''); });
    this.strip = new Strip(place, (time) => this.cursorMoved(time));
    this.drive = new Drive(this);
    this.pause = h('button', { type: 'button', text: 'Pause', 'aria-pressed': 'false', onclick: () => { this.setPaused(this.strip.paused === null); } });
    this.counts = h('p', { class: 'soft small counts' });
    this.cursorSaid = h('span', { class: 'soft small' });
    element.append(h('h1', { class: 'visually-hidden', text: 'Live' }), this.source.element, this.notice, this.replay.element, this.faults.element, this.nodes.element, this.tiles.element,
      h('div', { class: 'live-grid' }, h('div', { class: 'live-left' }, this.chartPanel(place), this.signals.element, this.parameters.element),
        h('div', { class: 'side' }, this.rolling.element, this.drive.element, this.bus.element, this.recorder.element, this.events.element, this.flash.element)));
    element.addEventListener('keydown', (event) => {
      if (event.key === ' ' && event.target === this.strip.canvas) { event.preventDefault(); this.setPaused(this.strip.paused === null); }
    });
  }

  /** The strip charts with what belongs to them. @param {HTMLElement} place */
  chartPanel(place) {
    const seconds = h('select', { 'aria-label': 'Seconds shown', onchange: () => { this.strip.seconds = Number(seconds.value); } }, ...SECONDS.map((s) => h('option', { value: String(s), text: `${s} s`, selected: s === 15 })));
    const markText = h('input', { type: 'text', value: 'mark', maxlength: '60', 'aria-label': 'Words of the mark' });
    const mark = h('button', { type: 'button', text: 'Mark', onclick: () => this.command({ request: 'mark', text: markText.value || 'mark' }) });
    const layouts = new Layouts(() => ({ signals: this.chosen, seconds: this.strip.seconds }), (layout) => {
      seconds.value = String(layout.seconds);
      this.strip.seconds = layout.seconds;
      this.choose(layout.signals);
      this.signals.list();
    });
    return h('section', { class: 'panel' },
      h('div', { class: 'panel-head' }, h('h2', { text: 'Signals over time' }), this.cursorSaid, h('div', { class: 'choices' }, layouts.element, markText, mark, seconds, this.pause)),
      place, this.counts);
  }

  /**
   * The result of an action; null, and a line on the page, when it is refused.
   * @template T
   * @param {() => Promise<T>} action @returns {Promise<T | null>}
   */
  async run(action) {
    try { this.notice.hidden = true; return await action(); } catch (error) { this.tell(lineOf(error)); return null; }
  }

  /** @param {string} text */
  tell(text) { this.notice.hidden = !text; this.notice.textContent = text; }

  /** @param {{ request?: string, text?: string, page?: string }} body */
  async command(body) {
    const answer = await this.run(() => this.app.api('live/command', { body }));
    if (answer) { this.app.announce(answer.done); this.app.showCommand(answer.command); }
    return answer;
  }

  // ---------------------------------------------------------------- what comes

  /** Another source, or none. @param {Hello} said */
  hello(said) {
    const { app, telemetry } = this, watched = telemetry.hello !== null;
    this.events.begin();
    this.strip.end = 0;
    this.strip.events = this.events.kept;
    this.setPaused(false);
    if (telemetry.signals.length && !this.chosen.some((name) => telemetry.index.has(name))) this.chosen = telemetry.signals.slice(0, 3).map((s) => s.name);
    if (said.command) app.showCommand(said.command);
    app.context(said.name || '');
    for (const part of [this.drive, this.replay, this.parameters, this.flash]) part.begin(said);
    this.rolling.begin(said, telemetry.signals);
    this.source.kind = said.kind || '';
    this.source.take(said.watch ?? null);
    this.recorder.begin(watched);
    this.want();
    this.signals.chosen = this.chosen;
    this.signals.list();
    if (!watched) { this.source.draw(null); this.tiles.clear(); this.faults.draw(null); this.bus.clear(); this.nodes.clear(); this.counts.textContent = ''; this.tell(''); }
  }

  /** Draw the signals that are chosen, as far as there are such. */
  want() {
    const { telemetry } = this;
    const known = this.chosen.filter((name) => telemetry.index.has(name));
    /** What belongs to a signal, where there is such. @param {string} name @param {Record<string, string>} of */
    const beside = (name, of) => (of[name] && telemetry.index.has(of[name]) ? of[name] : null);
    const extra = known.flatMap((name) => [beside(name, TRUTH), beside(name, SD), beside(name, VALID)]).filter((name) => name !== null && !known.includes(name));
    const all = [...new Set([...known, .../** @type {string[]} */ (extra), ...this.rolling.wanted()])], rings = telemetry.want(all);
    const ring = (/** @type {string | null} */ name) => (name === null ? null : rings[all.indexOf(name)] ?? null);
    this.rolling.take(ring);
    this.strip.lanes = known.map((name, place) => {
      const { unit, words } = telemetry.signals[telemetry.index.get(name) ?? 0];
      return { name, unit, words, colour: COLOURS[place % COLOURS.length], ring: rings[place], truth: ring(beside(name, TRUTH)), sd: ring(beside(name, SD)), valid: ring(beside(name, VALID)), places: PLACES[name] };
    });
  }

  /** The latest time; `anew`: times have begun anew. @param {number} time */
  until(time, anew = false) { this.strip.end = anew ? time : Math.max(this.strip.end, time); }

  /** @param {Status} said */
  status(said) {
    const { strip } = this;
    strip.zero = said.begin > 1e6 ? said.begin : 0; // times of a bus count from 1970
    this.events.take(said.events);
    this.source.draw(said);
    if (said.state === 'gone') this.tell(`${said.note}. What was recorded is whole. Watch connects again.`);
    else if (said.note) this.tell(said.note);
    else if (said.fit) this.tell(said.fit);
    this.drive.draw(said);
    if (!this.shown) return;
    this.replay.draw(said);
    this.faults.draw(said);
    this.tiles.draw(this.telemetry, said);
    this.bus.draw(said);
    this.nodes.draw(said);
    this.count(said);
    this.recorder.draw(said);
    this.events.draw(strip.zero);
    this.signals.draw();
  }

  /** Counts beside the picture. @param {Status} now */
  count(now) {
    const { telemetry, strip } = this;
    const text = `${telemetry.frames.toLocaleString('en')} frames in pictures, ${(telemetry.missed).toLocaleString('en')} missed by this page, ${now.lost} lost before the log; ${strip.rate.toFixed(0)} redraws/s`;
    told(this.counts, text);
    Object.assign(this.element.dataset, { frames: telemetry.frames, total: now.total, missed: telemetry.missed, lost: now.lost, redraws: strip.redraws, rate: strip.rate.toFixed(1), state: now.state, skipped: telemetry.skipped });
  }

  // ---------------------------------------------------------------- what is looked at

  /** Draw a signal, or do so no more. @param {string} name @param {HTMLInputElement} box */
  pick(name, box) {
    if (box.checked && this.chosen.filter((n) => this.telemetry.index.has(n)).length >= MOST) { box.checked = false; this.tell(`At most ${MOST} signals are drawn at a time.`); return; }
    this.choose(box.checked ? [...this.chosen, name] : this.chosen.filter((n) => n !== name));
  }

  /** @param {string[]} names of the signals that are drawn from now on */
  choose(names) {
    this.chosen = names;
    localStorage.setItem(KEY, JSON.stringify(names));
    this.signals.chosen = names;
    this.want();
  }

  /** @param {number | null} time */
  cursorMoved(time) {
    const text = time === null ? '' : `cursor at ${(time - this.strip.zero).toFixed(3)} s`;
    told(this.cursorSaid, text);
    this.rolling.draw(this.strip.until, time);
  }

  /** @param {boolean} on */
  setPaused(on) {
    this.strip.pause(on);
    this.pause.textContent = on ? 'Go on' : 'Pause';
    this.pause.setAttribute('aria-pressed', String(on));
  }

  /** @param {string} rest what is watched from now on, if nothing is */
  show(rest) {
    const { app, telemetry } = this;
    this.shown = true;
    void this.source.offer().then(() => this.source.wanted(rest));
    void this.flash.look();
    this.strip.start();
    telemetry.open();
    app.context(telemetry.hello?.name || '');
    if (telemetry.hello?.command) app.showCommand(telemetry.hello.command);
  }

  hide() {
    this.shown = false;
    this.strip.stop();
    if (!this.drive.mine) this.telemetry.close(); // who drives goes on, and space goes on stopping
  }

  redraw() { this.strip.recolour(); this.rolling.robot.draw(); }
}
