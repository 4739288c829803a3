// Faults that are set: each with its cause, what the controller did, and what ends it.
import { h } from '../app.js';

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
