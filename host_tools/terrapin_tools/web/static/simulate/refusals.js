// The line that says why something was refused, where it was asked for.
import { h, lineOf } from '../app.js';

export class Refusals {
  constructor() { this.element = h('p', { class: 'notice bad', role: 'alert', hidden: true }); }

  /** @param {string} text */
  say(text) {
    this.element.hidden = false;
    this.element.textContent = text;
  }

  /**
   * The result of an action that somebody asked for; null, and the line, when it is refused.
   * @template T
   * @param {() => Promise<T>} action @returns {Promise<T | null>}
   */
  attempt(action) {
    this.element.hidden = true;
    return this.look(action);
  }

  /**
   * As `attempt`, of what nobody asked for: what the line says of an action before it stays.
   * @template T
   * @param {() => Promise<T>} action @returns {Promise<T | null>}
   */
  async look(action) {
    try { return await action(); } catch (error) { this.say(lineOf(error)); return null; }
  }
}
