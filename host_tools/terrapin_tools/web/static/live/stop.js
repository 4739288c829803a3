// The button that stops the robot, and lets it go again.
import { h, told } from '../app.js';

const STOP_MS = 1000; // after the button has become “release”, in which it does not
const WORDS = {
  bus: 'STOP_ALL: the bridge of every controller on this bus goes off, and stays off until it is told “clear”, whatever else asks for run; the fault stop_all shows it. Sent again and again until the button is pressed once more, which sends “clear” to the controller that is watched (one with a link key takes it only from a server that has the key). It needs this computer and the bus, and cuts no power: the red button on the robot works always.',
  simulator: 'Opens the emergency stop of the simulated robot until it is pressed again: the bridge goes off in the same tick. A controller that has been stopped wants “clear” before it runs again, as the real one does.',
  '': 'A log has nothing to stop.',
};

export class Stop {
  /** @param {(request: string) => Promise<void>} command */
  constructor(command) {
    this.command = command;
    this.held = this.there = false;
    this.heldSince = 0;
    this.button = h('button', { type: 'button', class: 'stop', text: 'Stop the robot', 'aria-pressed': 'false', onclick: () => this.toggle() });
    this.words = h('p', { class: 'soft small' });
    this.element = h('section', { class: 'panel stop-panel' }, h('h2', { class: 'visually-hidden', text: 'Stop' }), h('div', { class: 'row' }, this.button), this.words);
  }

  /** Another source, or none. @param {Hello} said */
  begin(said) {
    this.held = false;
    this.there = said.name !== null && Boolean(said.stop);
    this.button.disabled = !said.stop;
    this.words.textContent = WORDS[said.stop || ''];
  }

  /** @param {Status} now */
  draw(now) {
    this.held = now.stop_held;
    if (now.stop_held && this.button.getAttribute('aria-pressed') !== 'true') this.heldSince = performance.now();
    this.button.setAttribute('aria-pressed', String(now.stop_held));
    told(this.button, now.stop_held ? 'Stopped: clear' : 'Stop the robot');
    this.button.disabled = !this.there || now.state !== 'live';
  }

  async toggle() {
    if (this.held && performance.now() - this.heldSince < STOP_MS) return; // a hurried second click does not let go
    await this.command(this.held ? 'release' : 'idle');
  }
}
