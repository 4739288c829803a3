// What happened, newest first; and the faults that are set: each with its cause, what the controller did, and what ends it.
import { h, told } from '../app.js';

const LISTED_EVERY = 250; // ms between looks
const KEPT = 500, LISTED = 100; // that are drawn, that are listed

export class Events {
  constructor() {
    /** @type {(Mark & { number: number })[]} */
    this.kept = []; // oldest first
    this.newest = this.listed = 0;
    this.log = h('ol', { class: 'event-list', tabindex: '0', 'aria-label': 'Events, newest first' });
    this.element = h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Events' })), this.log);
  }

  /** Another source: none of its events is known yet. */
  begin() {
    this.kept = [];
    this.log.replaceChildren();
    this.newest = this.listed = 0;
  }

  /** @param {(Mark & { number: number })[]} events */
  take(events) {
    for (const event of events) if (event.number > (this.kept.at(-1)?.number ?? 0)) this.kept.push(event);
    if (this.kept.length > KEPT) this.kept.splice(0, this.kept.length - KEPT);
  }

  /** List what is new, not too often. @param {number} zero what is called 0 s */
  draw(zero) {
    if (performance.now() - this.listed <= LISTED_EVERY) return;
    const rows = this.kept.slice(-LISTED).filter((event) => event.number > this.newest).reverse();
    if (!rows.length) return;
    this.listed = performance.now();
    this.newest = rows[0].number;
    for (const event of rows.reverse()) this.log.prepend(this.row(event, zero));
  }

  /** A line for an event: the oldest one, written anew, where the list is full. @param {Mark} event @param {number} zero */
  row(event, zero) {
    const row = this.log.children.length < LISTED ? h('li', {}, h('span', { class: 'soft n' }), h('b'), h('span')) : /** @type {HTMLElement} */ (this.log.lastChild);
    row.className = `event ${event.kind}`;
    [event.time === null ? '–' : `${(event.time - zero).toFixed(2)} s`, event.kind, event.text].forEach((text, place) => told(row.children[place], text));
    return row;
  }
}

export class Faults {
  constructor() {
    this.list = h('ul', { class: 'fault-list' });
    this.said = '';
    this.element = h('section', { class: 'panel', hidden: true, role: 'status' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Faults' })), this.list);
  }

  /** @param {Status | null} now null: nothing is watched */
  draw(now) {
    const faults = now?.faults ?? [], said = faults.map((f) => f.name).join();
    if (said === this.said) return;
    this.said = said;
    this.element.hidden = !faults.length;
    this.list.replaceChildren(...faults.map((f) => h('li', {}, h('b', { class: 'bad', text: f.name }), ` ${f.cause}. `,
      h('span', { class: 'soft', text: `The controller: ${f.reaction}. ` }),
      h('span', { text: f.latched === false ? 'It goes with its cause.' : f.name === 'stop_all' ? 'Release the stop: that clears it.' : 'Mend the cause, then Clear faults.' }))));
  }
}
