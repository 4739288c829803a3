// The calibration on the hard floor, led step by step: what to do first, how far it is, what it found.
import { fixed, h, told } from '../app.js';

/** @typedef {import('./telemetry.js').Telemetry} Telemetry */

export class Calibration {
  /** `over` is called when the controller has ended it. @param {() => void} over */
  constructor(over) {
    this.over = over;
    this.begun = this.ended = false;
    this.steps = ['Stand it on a hard, level floor with a few metres free before it; set the sign of the setpoint to the way it is to roll.', '', ''].map((text) => h('li', { text }));
    this.element = h('div', { hidden: true }, h('b', { class: 'small', text: 'Calibration' }), h('div', { role: 'status' }, h('ol', { class: 'small led' }, this.steps)));
  }

  /** It was asked for. */
  begin() {
    this.begun = this.ended = false;
    this.element.hidden = false;
    this.told(1, 'It starts …');
    this.told(2, 'Internal friction is what remains of the torque once the floor’s own is taken out.');
    this.mark(1);
  }

  /** Nothing is driven any more, or something else is. */
  leave() { if (!this.ended) this.element.hidden = true; }

  /** @param {number} place @param {string} text */
  told(place, text) { told(this.steps[place], text); }

  /** The step that is under way. @param {number} place */
  mark(place) { this.steps.forEach((step, i) => { step.className = i < place ? 'good' : i > place ? 'soft' : ''; if (i === place) step.setAttribute('aria-current', 'step'); else step.removeAttribute('aria-current'); }); }

  /** @param {Telemetry} telemetry @param {number | undefined} set how many speeds were read from the controller, else as many as it begins with */
  draw(telemetry, set) {
    if (this.element.hidden || this.ended) return;
    const state = telemetry.word('STATUS.state'), done = telemetry.value('CALIBRATION.step') ?? 0, all = set ?? telemetry.hello?.speeds;
    if (state === 'calibrate') {
      this.begun = true;
      this.told(1, `It rolls at one speed after the other: ${done} of ${all ?? 'some'} finished. Space stops.`);
      return;
    }
    if (!this.begun) return; // asked for, and not yet begun
    this.ended = true;
    const value = (/** @type {string} */ name) => telemetry.value(`CALIBRATION.${name}`), report = telemetry.word('STATUS.report') ?? 'ended';
    this.told(1, `It has rolled at ${done} speeds.`);
    this.told(2, report === 'calibrated' ? `Found: ${fixed((value('coulomb') ?? 0) * 1e3, 2)} mN m and ${fixed((value('viscous') ?? 0) * 1e3, 3)} mN m s/rad; the worst speed lies ${fixed((value('residual') ?? 0) * 1e3, 2)} mN m beside the line. In use from now on.`
      : `Nothing is changed: ${report.replaceAll('_', ' ')}. The events say when; try again on a harder or longer floor.`);
    this.mark(3);
    this.over();
  }
}
