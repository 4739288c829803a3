// Load and health of the bus.
import { h } from '../app.js';

export class Bus {
  constructor() {
    this.load = h('progress', { class: 'bar', max: '1', value: 0, 'aria-label': 'Load of the bus' });
    this.health = h('div', { class: 'health' });
    this.said = '';
    this.element = h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Bus' })), this.load, this.health);
  }

  clear() { this.health.replaceChildren(); this.said = ''; }

  /** @param {Status} now */
  draw(now) {
    this.load.value = Math.min(1, now.load);
    const line = (/** @type {string} */ text, kind = '') => h('p', { class: `small ${kind}`, text });
    const worst = Object.keys(now.errors).length > 0 || now.silent || now.fit;
    const parts = [
      line(`load ${(100 * now.load).toFixed(0)} %, ${now.rate.toFixed(0)} frames/s, ${now.total.toLocaleString('en')} frames`),
      line(now.health, worst ? 'bad' : 'good'),
      line(`bus off ${now.bus_off} times; error counters ${now.counters ? `sending ${now.counters[0]}, receiving ${now.counters[1]}` : 'not told by this bus'}`),
      ...(now.damaged ? [line(`${now.damaged} damaged lines`, 'bad')] : []),
      ...(now.unknown.length ? [line(`unknown: ${now.unknown.slice(0, 6).map(([id, n]) => `${id} (${n})`).join(', ')}`, 'warn')] : [])];
    const said = parts.map((p) => p.className + p.textContent).join('\n');
    if (said !== this.said) { this.said = said; this.health.replaceChildren(...parts); }
  }
}
