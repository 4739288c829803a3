// Load and health of the bus; and all controllers on it, when there are several: how each stands, and a button to watch
// another one.
import { h, told } from '../app.js';

/** @type {['MOTION.slip' | 'GROUND.torque' | 'ELECTRICAL.current', string, number][]} */
const COLUMNS = [['MOTION.slip', 'slip', 2], ['GROUND.torque', 'C_t, N m', 3], ['ELECTRICAL.current', 'current, A', 2]];

export class Bus {
  constructor() {
    this.load = h('progress', { class: 'bar', max: '1', value: 0, 'aria-label': 'Load of the bus' });
    this.health = h('div', { class: 'health' });
    this.element = h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Bus' })), this.load, this.health);
  }

  clear() { this.load.value = 0; this.health.replaceChildren(h('p', { class: 'small soft', text: 'Nothing is watched.' })); }

  /** @param {Status} now */
  draw(now) {
    this.load.value = Math.min(1, now.load);
    /** @type {(text: string, kind?: string) => [string, string]} */
    const line = (text, kind = '') => [text, `small ${kind}`];
    const worst = Object.keys(now.errors).length > 0 || now.silent || now.fit;
    const parts = [
      line(`load ${(100 * now.load).toFixed(0)} %, ${now.rate.toFixed(0)} frames/s, ${now.total.toLocaleString('en')} frames`),
      line(now.health, worst ? 'bad' : 'good'),
      line(`bus off ${now.bus_off} times; error counters ${now.counters ? `sending ${now.counters[0]}, receiving ${now.counters[1]}` : 'not told by this bus'}`),
      ...(now.damaged ? [line(`${now.damaged} damaged lines`, 'bad')] : []),
      ...(now.unknown.length ? [line(`unknown: ${now.unknown.slice(0, 6).map(([id, n]) => `${id} (${n})`).join(', ')}`, 'warn')] : [])];
    while (this.health.children.length > parts.length) this.health.lastChild?.remove();
    parts.forEach(([text, kind], place) => {
      const p = this.health.children[place] ?? this.health.appendChild(h('p'));
      p.className = kind;
      told(p, text);
    });
  }
}

export class Nodes {
  /** @param {(node: number) => void} watch */
  constructor(watch) {
    this.watch = watch;
    /** @type {Map<number, { row: HTMLElement, cells: HTMLElement[] }>} */
    this.rows = new Map();
    this.body = h('tbody');
    this.element = h('section', { class: 'panel nodes', hidden: true }, h('div', { class: 'panel-head' }, h('h2', { text: 'Controllers on this bus' })),
      h('table', {}, h('thead', {}, h('tr', {}, ...['node', 'state', ...COLUMNS.map(([, title]) => title), 'shown'].map((text) => h('th', { scope: 'col', text })))), this.body));
  }

  clear() { this.rows.clear(); this.body.replaceChildren(); this.element.hidden = true; }

  /** @param {Status} now */
  draw(now) {
    this.element.hidden = now.nodes.length < 2;
    if (now.nodes.map((line) => line.node).join() !== [...this.rows.keys()].join()) this.list(now.nodes);
    for (const line of now.nodes) {
      const texts = [line.said || '-', ...COLUMNS.map(([name, , digits]) => line[name]?.toFixed(digits) ?? '-')];
      this.rows.get(line.node)?.cells.forEach((cell, place) => { told(cell, texts[place]); });
    }
  }

  /** @param {NodeLine[]} lines */
  list(lines) {
    this.rows.clear();
    for (const line of lines) {
      const cells = ['said', ...COLUMNS].map(() => h('td'));
      const choice = line.watched ? h('span', { class: 'soft', text: 'watched' }) : h('button', { type: 'button', text: 'Watch', 'aria-label': `Watch node ${line.node}`, onclick: () => { this.watch(line.node); } });
      this.rows.set(line.node, { cells, row: h('tr', {}, h('th', { scope: 'row', text: String(line.node) }), ...cells, h('td', {}, choice)) });
    }
    this.body.replaceChildren(...[...this.rows.values()].map(({ row }) => row));
  }
}
