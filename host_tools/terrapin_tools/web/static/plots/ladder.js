// The ladder of errors as SVG, whose bars fall to their new height.
import { number, still } from './basics.js';
import { ticks } from './painting.js';

const FALL_MS = 650;
/** @param {string} tag @param {Record<string, string | number>} attributes @param {string} [text] */
const svg = (tag, attributes = {}, text) => {
  const element = document.createElementNS('http://www.w3.org/2000/svg', tag);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  if (text !== undefined) element.textContent = text;
  return element;
};
/** @param {number | null | undefined} v */
const sd = (v) => (v === null || v === undefined ? '' : v >= 100 ? v.toFixed(0) : v.toPrecision(3));

/** Words in two lines of at most `fit` letters; what is left over is cut. @param {string} text @param {number} fit */
function wrap(text, fit) {
  const lines = [''];
  for (const word of text.split(' ')) {
    const last = lines[lines.length - 1];
    if (!last || last === '+' || `${last} ${word}`.length <= fit) lines[lines.length - 1] = last ? `${last} ${word}` : word;
    else lines.push(word);
  }
  if (lines.length > 2) lines[1] += '…';
  return lines.slice(0, 2).map((part) => (part.length > fit + 1 ? `${part.slice(0, fit)}…` : part));
}

/** ladder.show([{added, train_error, heldout_error}], ghost | null): a rung that is new falls from the one before. */
export class Ladder {
  /** @param {HTMLElement} host */
  constructor(host) {
    this.host = host;
    host.classList.add('plot', 'ladder');
    /** @type {Rung[]} */
    this.rungs = [];
    /** @type {Shown[]} */
    this.shown = [];
    /** @type {Rung | null} */
    this.ghost = null;
    this.timer = 0;
    this.svg = svg('svg', { role: 'img', 'aria-label': 'Error ladder' });
    host.replaceChildren(this.svg);
    new ResizeObserver(() => this.redraw()).observe(host);
  }

  /** @param {Rung[]} rungs @param {Rung | null} ghost */
  show(rungs, ghost = null) {
    /** @param {Rung} a @param {Rung | undefined} b */
    const same = (a, b) => a && b && a.added === b.added;
    let common = 0;
    while (common < rungs.length && same(rungs[common], this.rungs[common])) common++;
    const first = this.rungs.length === 0;
    this.ghost = ghost;
    const from = rungs.map((rung, i) => {
      if (i < common && this.shown[i]) return this.shown[i];
      return first ? { train: rung.train_error, held: rung.heldout_error }
        : { train: rungs[Math.max(0, common - 1)].train_error, held: rungs[Math.max(0, common - 1)].heldout_error };
    });
    const moving = rungs.some((r, i) => from[i].train !== r.train_error || from[i].held !== r.heldout_error);
    this.rungs = rungs;
    this.svg.setAttribute('aria-label', this.words());
    cancelAnimationFrame(this.timer);
    if (!moving || still()) { this.shown = rungs.map((r) => ({ train: r.train_error, held: r.heldout_error })); this.redraw(); return; }
    const begin = performance.now();
    /** @param {number} now */
    const tick = (now) => {
      let busy = false;
      this.shown = rungs.map((rung, i) => { // one after the other, as they were added
        const t = Math.min(1, Math.max(0, (now - begin - Math.max(0, i - common) * FALL_MS * 0.8) / FALL_MS));
        const ease = t * t * (3 - 2 * t);
        if (t < 1) busy = true;
        /** @param {number | null} a @param {number | null} b */
        const mix = (a, b) => (a === null || b === null ? b : a * (b / a) ** ease || b);
        return { train: mix(from[i].train, rung.train_error), held: mix(from[i].held, rung.heldout_error) };
      });
      this.redraw();
      if (busy) this.timer = requestAnimationFrame(tick);
    };
    tick(begin);
  }

  words() {
    const rungs = this.rungs.map((r) => `${r.added === null ? 'base model' : `with ${r.added}`}: training ${sd(r.train_error)}`
      + (r.heldout_error === null ? '' : `, held out ${sd(r.heldout_error)}`));
    return `Error ladder in noise sd. ${rungs.join('; ')}.`;
  }

  redraw() {
    const width = this.host.clientWidth, height = this.host.clientHeight;
    if (!width || !this.rungs.length) return;
    const box = { x0: 34, x1: width - 4, y0: height - 40, y1: 14 };
    const ghost = this.ghost ? [{ added: this.ghost.added, ghost: true, train: this.ghost.train_error, held: this.ghost.heldout_error }] : [];
    const all = [...this.rungs.map((r, i) => ({ added: r.added, ghost: false, ...this.shown[i] })), ...ghost];
    const values = [...this.rungs.flatMap((r) => [r.train_error, r.heldout_error]), ...ghost.flatMap((g) => [g.train, g.held])].filter((v) => v !== null).filter((v) => v > 0);
    const top = Math.max(1.3, ...values), log = top > 12;
    const low = log ? Math.min(0.5, ...values.map((v) => v * 0.8)) : 0;
    /** @type {Scale} */
    const share = (v) => (log ? Math.log(Math.max(v, low) / low) / Math.log((top * 1.6) / low) : v / (top * 1.13));
    /** @type {Scale} */
    const Y = (v) => box.y0 - share(v) * (box.y0 - box.y1);
    const parts = [];
    const marks = log ? [1, 3, 10, 30, 100, 300, 1000, 1e4].filter((t) => t > low && t < top * 1.6) : ticks(0, top * 1.1, 4);
    for (const t of marks) {
      parts.push(svg('line', { class: 'grid', x1: box.x0, x2: box.x1, y1: Y(t), y2: Y(t) }));
      parts.push(svg('text', { x: box.x0 - 6, y: Y(t) + 4, 'text-anchor': 'end' }, number(t)));
    }
    const step = (box.x1 - box.x0) / all.length, wide = Math.min(34, step * 0.36);
    all.forEach((rung, i) => {
      const middle = box.x0 + (i + 0.5) * step;
      /** @type {[string, number | null, number][]} */
      const pair = [['train', rung.train, middle - wide - 2], ['held', rung.held, middle + 2]];
      pair.forEach(([kind, value, x]) => {
        if (value === null || value === undefined) return;
        const y = Y(value);
        parts.push(svg('rect', { class: rung.ghost ? 'ghost' : kind, x, y, width: wide, height: Math.max(0, box.y0 - y), rx: 2 }));
        if (wide < 24 && kind === 'train' && rung.held !== null) return; // no room for both numbers
        parts.push(svg('text', { class: rung.ghost ? 'ghost-text' : 'value', x: wide < 24 ? middle : x + wide / 2, y: y - 4, 'text-anchor': 'middle' }, sd(value)));
      });
      const name = rung.added === null ? 'base model' : `${rung.ghost ? 'with' : '+'} ${rung.added.replaceAll('_', ' ')}`;
      wrap(name, Math.max(6, Math.floor(step / 6.4))).forEach((part, n) => {
        const text = svg('text', { class: rung.ghost ? 'ghost-text' : '', x: middle, y: box.y0 + 15 + 13 * n, 'text-anchor': 'middle' }, part);
        text.append(svg('title', {}, name));
        parts.push(text);
      });
    });
    parts.push(svg('line', { class: 'floor', x1: box.x0, x2: box.x1, y1: Y(1), y2: Y(1) }));
    this.svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
    this.svg.replaceChildren(...parts);
    this.host.dataset.rungs = String(this.rungs.length);
    const last = this.rungs[this.rungs.length - 1];
    this.host.dataset.heldout = String(last.heldout_error ?? last.train_error);
  }
}
