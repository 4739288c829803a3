// Tiles with what matters most of a robot, or the count of frames of another bus.
import { fixed, h, number, quantity, told } from '../app.js';

/** @typedef {import('./telemetry.js').Telemetry} Telemetry */

export class Tiles {
  constructor() {
    this.element = h('dl', { class: 'tiles' });
    /** @type {Map<string, { dd: HTMLElement, hint: HTMLElement }>} */
    this.parts = new Map();
  }

  clear() { this.element.replaceChildren(); }

  /** Show one tile; only what differs is written. @param {string} title @param {string} text */
  one(title, text, kind = '', hint = '') {
    let part = this.parts.get(title);
    if (!part || !part.dd.isConnected) {
      part = { dd: h('dd'), hint: h('span', { class: 'hint' }) };
      this.parts.set(title, part);
      this.element.append(h('div', { class: 'tile', 'data-tile': title }, h('dt', { text: title }), part.dd, h('dd', { class: 'hint-line' }, part.hint)));
    }
    told(part.dd, text);
    if (part.dd.className !== kind) part.dd.className = kind;
    told(part.hint, hint);
  }

  /** @param {Telemetry} telemetry @param {Status} now */
  draw(telemetry, now) {
    const { hello } = telemetry;
    if (!hello) return;
    if (telemetry.index.has('STATUS.state')) this.robot(telemetry, hello, now);
    else this.one('Frames', String(now.total), '', `${now.rate.toFixed(0)}/s`);
  }

  /** @param {Telemetry} telemetry @param {Hello} hello @param {Status} now */
  robot(telemetry, hello, now) {
    const value = (/** @type {string} */ name) => telemetry.value(name);
    const word = (/** @type {string} */ name) => telemetry.word(name) ?? number(value(name));
    const safe = word('STATUS.state') === 'safe';
    this.one('State', word('ACTUATE.state') === '–' ? word('STATUS.state') : word('ACTUATE.state'), safe ? 'bad' : '', value('ACTUATE.enable') ? 'bridge on' : 'bridge off');
    const { faults } = now;
    this.one('Faults', faults.length ? faults.map((f) => f.name).join(', ') : 'none', faults.length ? 'bad' : 'good', faults.length ? `${faults[0].cause}; ${faults[0].reaction}` : '');
    const slip = value('MOTION.slip'), over = (slip ?? 0) > (hello.slip_limit ?? 0);
    const known = Boolean(value('MOTION.slip_valid'));
    this.one('Slip', known ? fixed(slip, 3) : 'not valid', !known ? 'soft' : over ? 'bad' : '', `limit ${number(hello.slip_limit)}`);
    const torque = value('GROUND.torque'), sd = value('GROUND.torque_sd') ?? 0;
    const valid = Boolean(value('GROUND.valid')), unknown = !value('GROUND.terrain');
    this.one('C_t, mN m', torque === null ? '–' : valid ? quantity(torque * 1e3, '', sd * 1e3) : 'not valid', valid ? '' : 'soft', valid ? 'valid' : 'not steady');
    this.one('Terrain', word('GROUND.terrain'), unknown ? 'soft' : '', unknown ? 'not told apart yet' : `by ${fixed(value('GROUND.margin'), 1)} sd`);
    this.one('Motor', `${fixed(value('ELECTRICAL.current'), 3)} A`, '', `${fixed(value('ELECTRICAL.voltage'), 2)} V, ${fixed(value('ELECTRICAL.temperature'), 1)} °C`);
    this.one('Speed', `${fixed(value('MOTION.ground_speed'), 3)} m/s`, '', `shell ${fixed(value('MOTION.shell_speed'), 2)} rad/s`);
    this.one('Supply', `${fixed(value('ELECTRICAL.supply'), 2)} V`, '', value('ACTUATE.limiting') ? 'the slip limiter holds' : 'no limiter at work');
  }
}
