// The robot as its telemetry has it, rolling beside its strips: at the cursor where somebody points, else now.
import { h } from './app.js';
import { Robot } from './robot.js';

/** @typedef {import('./strip.js').Ring} Ring */

const SIGNALS = ['ATTITUDE.angle', 'ATTITUDE.swing_angle', 'ATTITUDE.pitch', 'ATTITUDE.pitch_valid', 'MOTION.ground_speed', 'MOTION.slip', 'MOTION.slip_valid', 'STATUS.state', 'GROUND.terrain'];
const DRAWN_MS = 60; // between pictures
const GAP = 1; // s without a picture after which the way is not guessed
const TURN = 2 * Math.PI;

export class Rolling {
  constructor() {
    this.place = h('div', { class: 'small-robot' });
    this.robot = new Robot(this.place, 7, 3.6);
    this.element = h('section', { class: 'panel', hidden: true }, h('h2', { class: 'visually-hidden', text: 'The robot' }), this.place);
    /** @type {Map<string, Ring>} */
    this.rings = new Map();
    /** @type {Signal[]} */
    this.signals = [];
    this.radius = 0; // m
    this.way = this.time = this.drawn = 0; // m, s, ms
  }

  /** Another source, or none. @param {Hello} said @param {Signal[]} signals */
  begin(said, signals) {
    this.signals = signals;
    this.radius = said.radius ?? 0;
    this.way = this.time = 0;
    this.element.hidden = !this.radius || this.wanted().length === 0;
  }

  /** The signals that it needs, as far as there are such: all of them, or none. */
  wanted() { return SIGNALS.every((name) => this.signals.some((s) => s.name === name)) ? SIGNALS : []; }

  /** @param {(name: string) => Ring | null} ring */
  take(ring) {
    this.rings = new Map(SIGNALS.flatMap((name) => { const one = ring(name); return one ? [[name, one]] : []; }));
  }

  /** @param {number} end latest time [s] @param {number | null} cursor a time that somebody points at */
  draw(end, cursor) {
    const now = performance.now();
    if (this.element.hidden || now - this.drawn < DRAWN_MS) return;
    this.drawn = now;
    const time = cursor ?? end;
    const value = (/** @type {string} */ name) => this.rings.get(name)?.at(time) ?? null;
    const speed = value('MOTION.ground_speed'), passed = end - this.time;
    if (passed > 0 && passed < GAP) this.way += (this.rings.get('MOTION.ground_speed')?.at(end) ?? 0) * passed;
    this.time = end;
    const state = value('STATUS.state'), terrain = value('GROUND.terrain'), slope = value('ATTITUDE.pitch_valid') ? value('ATTITUDE.pitch') ?? 0 : 0;
    const word = (/** @type {string} */ name, /** @type {number | null} */ code) => (code === null ? '' : this.signals.find((s) => s.name === name)?.words?.[code] ?? '');
    const ground = word('GROUND.terrain', terrain);
    const xs = [this.way - 5, this.way, this.way + 5];
    this.robot.show({
      name: '', run: { title: '', complete: true }, checks: [], faults: [], settings: null, changes: [], course: '', judged: '', radius: this.radius, words: { state: { 0: word('STATUS.state', state) } },
      ground: { x: xs, height: xs.map((x) => Math.tan(slope) * x) }, segments: [{ from: -Infinity, terrain: ground === 'unknown' || !ground ? 'ground not known to the controller' : ground }],
      columns: { time: [time], position: [this.way], angle: [(value('ATTITUDE.angle') ?? 0) % TURN], swing_angle: [value('ATTITUDE.swing_angle')], speed: [speed], slip: [value('MOTION.slip_valid') ? value('MOTION.slip') : null], state: [0] },
    });
  }
}
