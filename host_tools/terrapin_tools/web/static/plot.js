// Plots of the workbench: points, bands, curves and marked ranges on a canvas, with hover, keyboard and a table; and
// the ladder of errors as SVG, whose bars fall to their new height.
import { css, h, number, still } from './app.js';

const MARGIN = { left: 56, right: 10, top: 10, bottom: 34 };
const REACH = 22; // pixels within which a point answers the mouse
const TABLE_ROWS = 400;
/** @type {Record<string, number>} */
const STEPS = { ArrowRight: 1, ArrowLeft: -1, PageDown: 10, PageUp: -10 }; // rows that a key goes on

/** About `count` round numbers from low to high. @param {number} low @param {number} high @param {number} count */
export function ticks(low, high, count) {
  const range = high - low;
  if (!(range > 0)) return [low];
  const raw = range / count, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999) ?? 10 * power;
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * range; k++) found.push(Number((k * step).toPrecision(12)));
  return found;
}

/** The lowest and the highest value of all lists, with some room. @param {(number | null)[][]} lists @param {number} pad */
function span(lists, pad) {
  let low = Infinity, high = -Infinity;
  for (const list of lists) for (const v of list) if (v !== null && Number.isFinite(v)) { if (v < low) low = v; if (v > high) high = v; }
  if (low > high) return [0, 1];
  const room = (high - low || Math.abs(high) || 1) * pad;
  return [low - room, high + room];
}

// ---------------------------------------------------------------- a prediction as a curve

/** How much a line bends from point to point, in sd. @param {number[]} rows @param {number[]} y @param {number} noise */
function rough(rows, y, noise) {
  const turns = [];
  for (let i = 1; i + 1 < rows.length; i++) turns.push(Math.abs(y[rows[i]] - (y[rows[i - 1]] + y[rows[i + 1]]) / 2));
  turns.sort((a, b) => a - b);
  return turns.length ? turns[Math.floor(0.9 * turns.length)] / noise : 0;
}

/**
 * Lists of rows along which a prediction is a curve over x: over all runs, or within each; null where it is none.
 * @param {number[]} x @param {number[]} y @param {number} noise @param {number[]} run @param {number} runs
 */
export function curve(x, y, noise, run, runs) {
  /** @param {number[]} list */
  const sorted = (list) => list.sort((a, b) => x[a] - x[b] || y[a] - y[b]);
  const all = sorted(x.map((_, i) => i));
  if (!all.length) return null;
  const distinct = new Set(x).size;
  const gap = distinct > 40 ? 0.04 * (x[all[all.length - 1]] - x[all[0]]) : Infinity;
  /** @param {number[]} rows */
  const broken = (rows) => {
    /** @type {number[][]} */
    const parts = [[]];
    rows.forEach((i, n) => { if (n && x[i] - x[rows[n - 1]] > gap) parts.push([]); parts[parts.length - 1].push(i); });
    return parts;
  };
  const [low, high] = span([y], 0);
  const fine = Math.max(noise, 0.15 * (high - low)); // a bend of that size is seen as a bend, not as scatter
  /** @param {number[][]} parts */
  const smooth = (parts) => parts.filter((p) => rough(p, y, fine) < 0.6).length >= 0.9 * parts.length;
  const whole = broken(all);
  if (distinct > 3 && smooth(whole)) return whole;
  /** @type {number[][]} */
  const byRun = Array.from({ length: runs }, () => []);
  run.forEach((r, i) => byRun[r].push(i));
  const lines = byRun.filter((l) => l.length > 2).flatMap((l) => broken(sorted(l)));
  const sizes = lines.map((l) => new Set(l.map((i) => x[i])).size).sort((a, b) => a - b);
  if (lines.length && sizes[sizes.length >> 1] > 3 && smooth(lines)) return lines;
  return null;
}

// ---------------------------------------------------------------- canvas plot

/** What a plot shows is its PlotSpec (types.d.ts). */
export class Plot {
  /** @param {HTMLElement} host @param {string} name */
  constructor(host, name) {
    /** @type {PlotSpec | null} */
    this.spec = null;
    /** @type {number | null} */
    this.at = null; // the row that is pointed at
    /** @type {number[]} */
    this.order = []; // rows by x
    /** @type {HTMLElement | null} */
    this.table = null;
    /** @type {{ X: Scale, Y: Scale } | null} */
    this.map = null;
    this.name = name;
    this.host = host;
    host.classList.add('plot');
    this.canvas = h('canvas', { tabindex: '0', role: 'img', 'aria-label': name });
    this.tip = h('div', { class: 'tip', hidden: true });
    this.said = h('div', { class: 'visually-hidden', 'aria-live': 'polite' });
    host.replaceChildren(this.canvas, this.tip, this.said);
    this.canvas.addEventListener('pointermove', (event) => this.hover(event));
    this.canvas.addEventListener('pointerleave', () => this.point(null));
    this.canvas.addEventListener('blur', () => this.point(null));
    this.canvas.addEventListener('keydown', (event) => this.key(event));
    new ResizeObserver(() => this.redraw()).observe(host);
  }

  /** @param {PlotSpec} spec */
  draw(spec) {
    this.spec = spec;
    this.at = null;
    this.canvas.setAttribute('aria-label', spec.alt || this.name);
    const rows = new Set(spec.points.flatMap((p) => p.rows)); // each once, however often it is drawn
    this.order = [...rows].sort((a, b) => spec.x.values[a] - spec.x.values[b]);
    if (this.table) this.showTable(true);
    this.redraw();
  }

  redraw() {
    const { spec } = this;
    const width = this.host.clientWidth, height = this.host.clientHeight;
    if (!spec || !width || !height) return;
    const scale = devicePixelRatio || 1;
    this.canvas.width = Math.round(width * scale);
    this.canvas.height = Math.round(height * scale);
    const c = /** @type {Pen} */ (this.canvas.getContext('2d'));
    c.scale(scale, scale);
    c.clearRect(0, 0, width, height);
    const box = { x0: MARGIN.left, x1: width - MARGIN.right, y0: height - MARGIN.bottom, y1: MARGIN.top };
    const xs = span([spec.x.values], 0.03);
    const tall = [...spec.points.map((p) => p.rows.map((i) => p.values[i])), ...spec.lines.map((l) => l.values)];
    for (const band of spec.bands) tall.push(band.values.map((v) => v + band.half), band.values.map((v) => v - band.half));
    if (spec.level) tall.push(spec.level);
    const ys = span(tall, 0.05);
    /** @type {Scale} */
    const X = (v) => box.x0 + ((v - xs[0]) / (xs[1] - xs[0])) * (box.x1 - box.x0);
    /** @type {Scale} */
    const Y = (v) => box.y0 + ((v - ys[0]) / (ys[1] - ys[0])) * (box.y1 - box.y0);
    this.map = { X, Y };
    this.frame(c, spec, box, xs, ys, X, Y);
    c.save();
    c.beginPath();
    c.rect(box.x0, box.y1, box.x1 - box.x0, box.y0 - box.y1);
    c.clip();
    const x = spec.x.values;
    for (const band of spec.bands) this.band(c, x, band, X, Y);
    for (const one of spec.lines.filter((l) => l.under)) this.line(c, x, one, X, Y);
    for (const points of spec.points) this.points(c, x, points, X, Y);
    for (const one of spec.lines.filter((l) => !l.under)) this.line(c, x, one, X, Y);
    c.restore();
    if (this.at !== null) this.mark(c);
  }

  /**
   * Axes, level, and the ranges that are marked.
   * @param {Pen} c @param {PlotSpec} spec @param {{ x0: number, x1: number, y0: number, y1: number }} box
   * @param {number[]} xs @param {number[]} ys @param {Scale} X @param {Scale} Y
   */
  frame(c, spec, box, xs, ys, X, Y) {
    c.font = '12px system-ui, sans-serif';
    c.lineWidth = 1;
    if (spec.level) {
      c.fillStyle = css('--floor');
      c.fillRect(box.x0, Y(spec.level[1]), box.x1 - box.x0, Y(spec.level[0]) - Y(spec.level[1]));
    }
    const pad = 0.012 * (xs[1] - xs[0]);
    for (const [low, high] of spec.ranges) {
      c.fillStyle = css('--fail');
      const left = Math.max(box.x0, X(low - pad)), right = Math.min(box.x1, X(high + pad));
      c.fillRect(left, box.y1, right - left, box.y0 - box.y1);
      c.fillStyle = css('--red');
      c.fillRect(left, box.y0 - 2, right - left, 3);
    }
    c.strokeStyle = css('--hair');
    c.fillStyle = css('--soft');
    c.textBaseline = 'middle';
    c.textAlign = 'right';
    for (const t of ticks(ys[0], ys[1], Math.max(2, (box.y0 - box.y1) / 42))) {
      line(c, box.x0, Y(t), box.x1, Y(t));
      c.fillText(number(t), box.x0 - 7, Y(t));
    }
    c.textAlign = 'center';
    c.textBaseline = 'top';
    const room = (box.x1 - box.x0) / 90;
    for (const t of ticks(xs[0], xs[1], Math.max(2, room))) {
      if (X(t) > box.x1 - 4 || X(t) < box.x0) continue;
      line(c, X(t), box.y0, X(t), box.y0 + 4);
      c.fillText(number(t), X(t), box.y0 + 6);
    }
    c.strokeStyle = css('--mute');
    line(c, box.x0, box.y0, box.x1, box.y0);
    if (spec.level) { c.strokeStyle = css('--mute'); line(c, box.x0, Y(0), box.x1, Y(0)); }
    c.fillStyle = css('--ink');
    c.textAlign = 'right';
    c.textBaseline = 'bottom';
    if (!spec.x.chosen) c.fillText(label(spec.x), box.x1, box.y0 + MARGIN.bottom - 1);
    c.save();
    c.translate(12, (box.y0 + box.y1) / 2);
    c.rotate(-Math.PI / 2);
    c.textAlign = 'center';
    c.textBaseline = 'middle';
    c.fillText(label(spec.y), 0, 0);
    c.restore();
  }

  /** @param {Pen} c @param {number[]} x @param {Band} band @param {Scale} X @param {Scale} Y */
  band(c, x, band, X, Y) {
    c.fillStyle = band.color;
    if (!band.lines) { // no curve: a short bar about each prediction
      const up = Math.abs(Y(band.half) - Y(0));
      x.forEach((v, i) => c.fillRect(X(v) - 4, Y(band.values[i]) - up, 8, 2 * up));
      return;
    }
    for (const rows of band.lines) {
      c.beginPath();
      rows.forEach((i, n) => c[n ? 'lineTo' : 'moveTo'](X(x[i]), Y(band.values[i] + band.half)));
      [...rows].reverse().forEach((i) => c.lineTo(X(x[i]), Y(band.values[i] - band.half)));
      c.closePath();
      c.fill();
    }
  }

  /** @param {Pen} c @param {number[]} x @param {Line} one @param {Scale} X @param {Scale} Y */
  line(c, x, one, X, Y) {
    c.strokeStyle = one.color;
    c.lineWidth = one.width;
    c.setLineDash(one.dash || []);
    c.lineJoin = 'round';
    c.beginPath();
    if (one.lines) {
      for (const rows of one.lines) {
        const wide = X(x[rows[rows.length - 1]]) - X(x[rows[0]]);
        if (wide < 6) dash(c, X(x[rows[0]]) + wide / 2, Y(one.values[rows[0]]) / 2 + Y(one.values[rows[rows.length - 1]]) / 2); // a run at one setting
        else rows.forEach((i, n) => c[n ? 'lineTo' : 'moveTo'](X(x[i]), Y(one.values[i])));
      }
    } else {
      c.setLineDash([]);
      x.forEach((v, i) => dash(c, X(v), Y(one.values[i])));
    }
    c.stroke();
    c.setLineDash([]);
  }

  /** @param {Pen} c @param {number[]} x @param {Points} one @param {Scale} X @param {Scale} Y */
  points(c, x, one, X, Y) {
    const many = x.length, size = one.size || (many > 3000 ? 1.5 : many > 600 ? 2.2 : 3.4);
    c.globalAlpha = one.alpha ?? (many > 3000 ? 0.3 : many > 600 ? 0.55 : 0.8);
    c.fillStyle = c.strokeStyle = one.color;
    c.lineWidth = 1.5;
    for (const i of one.rows) {
      const u = X(x[i]), v = Y(one.values[i]);
      c.beginPath();
      if (one.kind === 'held') {
        const d = size * 1.35;
        c.moveTo(u - d, v); c.lineTo(u, v - d); c.lineTo(u + d, v); c.lineTo(u, v + d); c.closePath();
        c.stroke();
      } else { c.arc(u, v, size, 0, 6.2832); c.fill(); }
    }
    c.globalAlpha = 1;
  }

  /** A ring about the row that is pointed at. @param {Pen} c */
  mark(c) {
    const { at, map, spec } = this;
    if (at === null || !map || !spec) return;
    const { X, Y } = map, one = spec.points.find((p) => p.rows.includes(at));
    if (!one) return;
    c.strokeStyle = css('--ink');
    c.lineWidth = 1.5;
    c.beginPath();
    c.arc(X(spec.x.values[at]), Y(one.values[at]), 7, 0, 6.2832);
    c.stroke();
  }

  /** @param {PointerEvent} event */
  hover(event) {
    const { map, spec } = this;
    if (!map || !spec) return;
    const box = this.canvas.getBoundingClientRect(), { X, Y } = map;
    const u = event.clientX - box.left, v = event.clientY - box.top;
    let best = null, near = REACH ** 2;
    for (const one of spec.points) {
      for (const i of one.rows) {
        const d = (X(spec.x.values[i]) - u) ** 2 + (Y(one.values[i]) - v) ** 2;
        if (d < near) { near = d; best = i; }
      }
    }
    this.point(best);
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const step = STEPS[event.key] || 0;
    if (event.key === 'Escape') this.point(null);
    if (!step && event.key !== 'Home' && event.key !== 'End') return;
    event.preventDefault();
    const last = this.order.length - 1, now = this.at === null ? (step > 0 ? -1 : last + 1) : this.order.indexOf(this.at);
    const next = event.key === 'Home' ? 0 : event.key === 'End' ? last : Math.min(last, Math.max(0, now + step));
    this.point(this.order[next]);
    this.said.textContent = this.tip.textContent;
  }

  /** Point at a row; null: at none. @param {number | null} row */
  point(row) {
    if (row === this.at) return;
    this.at = row ?? null;
    this.tip.hidden = this.at === null;
    this.redraw();
    const { map, spec } = this;
    const one = row === null ? null : spec?.points.find((p) => p.rows.includes(row));
    if (row === null || !one || !spec || !map) return;
    this.tip.textContent = spec.describe(row);
    const { X, Y } = map, u = X(spec.x.values[row]), v = Y(one.values[row]);
    const left = u + this.tip.offsetWidth + 16 > this.host.clientWidth ? u - this.tip.offsetWidth - 12 : u + 12;
    this.tip.style.left = `${Math.max(0, left)}px`;
    this.tip.style.top = `${Math.max(0, Math.min(v - 14, this.host.clientHeight - this.tip.offsetHeight))}px`;
  }

  /** The same numbers as a table, in place of the drawing. @param {boolean} on */
  showTable(on) {
    this.table?.remove();
    this.table = null;
    if (!on || !this.spec) return;
    const { columns, rows } = this.spec.table();
    const body = rows.slice(0, TABLE_ROWS).map((row) => h('tr', {}, row.map((cell) => h('td', { text: typeof cell === 'number' ? number(cell) : cell }))));
    this.table = h('div', { class: 'table', tabindex: '0', role: 'region', 'aria-label': `${this.name}, table` },
      rows.length > TABLE_ROWS ? h('p', { class: 'soft', text: `The first ${TABLE_ROWS} of ${rows.length} rows.` }) : null,
      h('table', {}, h('thead', {}, h('tr', {}, columns.map((name) => h('th', { text: name })))), h('tbody', {}, body)));
    this.host.append(this.table);
  }
}

/** A short level stroke about a place. @param {Pen} c @param {number} x @param {number} y */
const dash = (c, x, y) => { c.moveTo(x - 5, y); c.lineTo(x + 5, y); };
/** @param {Axis} axis */
const label = (axis) => (axis.unit && axis.unit !== '1' ? `${axis.name}, ${axis.unit}` : axis.name);
/** @param {Pen} c @param {number} x0 @param {number} y0 @param {number} x1 @param {number} y1 */
function line(c, x0, y0, x1, y1) {
  c.beginPath();
  c.moveTo(Math.round(x0) + 0.5, Math.round(y0) + 0.5);
  c.lineTo(Math.round(x1) + 0.5, Math.round(y1) + 0.5);
  c.stroke();
}

// ---------------------------------------------------------------- ladder

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
