// Strip charts over one time axis, on one canvas: each signal in a lane of its own, events in the last, one cursor over
// all. Where several points fall on a pixel, the line spans from the lowest to the highest: no spike is lost.
import { css, fixed, h, number, quantity } from './app.js';
import { ticks } from './plots/painting.js';

const KEPT = 1 << 15; // points of a signal
const RATE = 30; // redraws a second
const LEFT = 64, RIGHT = 12, TITLE = 18, GAP = 8, AXIS = 20, EVENTS = 52, THICK = 1.5;
export const PLACES = /** @type {Record<string, number>} */ ({ slip: 3, 'MOTION.slip': 3 }); // decimals that a signal without a unit is worth
export const COLOURS = ['--blue', '--teal', '--amber', '--red', '--soft', '--ink'];
/** @type {Record<string, string>} */
const MARKS = { fault: '--red', injected: '--amber', limiter: '--blue', parameter: '--teal', mark: '--ink', clock: '--red', bus: '--red', state: '--soft', report: '--soft' };

// The style sheet of the Live and Simulate tabs, there before either is mounted: one that comes late moves what a hand is on.
const sheet = h('link', { rel: 'stylesheet', href: '/static/live.css' });
const came = new Promise((then) => { sheet.onload = sheet.onerror = then; });
document.head.append(sheet);
await came;

/** The latest points of one signal; times rise. */
export class Ring {
  constructor() { this.times = new Float64Array(KEPT); this.values = new Float32Array(KEPT); this.count = 0; }
  /** @param {number} time @param {number} value */
  push(time, value) {
    if (this.count && time < this.time(this.count - 1)) return; // sent twice, once as the past
    const place = this.count % KEPT;
    this.times[place] = time; this.values[place] = value; this.count++;
  }
  clear() { this.count = 0; }
  get first() { return Math.max(0, this.count - KEPT); }
  /** @param {number} index */
  time(index) { return this.times[index % KEPT]; }
  /** @param {number} index */
  value(index) { return this.values[index % KEPT]; }
  /** Index of the first point at or after a time. @param {number} time */
  find(time) {
    let low = this.first, high = this.count;
    while (low < high) { const middle = (low + high) >> 1; if (this.time(middle) < time) low = middle + 1; else high = middle; }
    return low;
  }
  /** The value that held at a time; null before the first. @param {number} time */
  at(time) {
    const index = this.find(time + 1e-9) - 1;
    return index < this.first ? null : this.value(index);
  }
}

/** Objects that are used again: eight strips at 30 redraws a second would throw away 40 MB a second. @template T */
class Again {
  /** @param {() => T} make */
  constructor(make) {
    this.make = make;
    /** @type {T[]} */
    this.used = [];
    /** @type {T[]} */
    this.spare = [];
  }
  clear() { for (let one = this.used.pop(); one; one = this.used.pop()) this.spare.push(one); }
  take() { const one = this.spare.pop() ?? this.make(); this.used.push(one); return one; }
}
const newColumns = () => new Again(() => ({ x: 0, first: 0.5, low: 0.5, high: 0.5, last: 0.5 }));
const newBars = () => new Again(() => ({ x: 0, wide: 0, low: 0.5, high: 0.5 }));

/**
 * A column of pixels for each stretch of time from begin to end: [first, lowest, highest, last] of the points in it.
 * Columns without a point are left out. They hold until `made` is used again. Exported for its test.
 * @param {Ring} ring @param {number} begin @param {number} end @param {number} width @param {Again<Column>} made
 */
export function columns(ring, begin, end, width, made = newColumns()) {
  made.clear();
  const scale = width / (end - begin);
  /** @type {Column | null} */
  let column = null;
  let index = Math.max(ring.first, ring.find(begin) - 1);
  for (; index < ring.count; index++) {
    const time = ring.time(index);
    if (time > end) break;
    const x = Math.round((time - begin) * scale), value = ring.value(index);
    if (column && column.x === x) {
      if (value < column.low) column.low = value;
      if (value > column.high) column.high = value;
      column.last = value;
    } else { column = made.take(); column.x = x; column.first = column.low = column.high = column.last = value; }
  }
  return made.used;
}

/**
 * The line through columns as bars, at most one a column of pixels: { x, wide, low, high }. Between columns it is straight,
 * or with `steps` keeps its value up to the next. Bars cost a twentieth of what a stroked path of so many corners does,
 * where the processor draws. They hold until `made` is used again. Exported for its test.
 * @param {Column[]} found @param {boolean} steps @param {Again<Bar>} made
 */
export function bars(found, steps, made = newBars()) {
  made.clear();
  for (let i = 0; i < found.length; i++) {
    const c = found[i], before = found[i - 1], after = found[i + 1];
    const begin = !before ? c.first : steps ? before.last : c.first + (before.last - c.first) / (c.x - before.x) / 2;
    const gap = after ? after.x - c.x : 0, step = after && !steps ? (after.first - c.last) / gap : 0, end = c.last + step / 2;
    if (c.x >= 0) bar(made, c.x, Math.min(c.low, begin, end), Math.max(c.high, begin, end), 1);
    const seen = Math.max(1, -c.x); // the first point may lie far to the left
    if (steps && gap > seen) bar(made, c.x + seen, c.last, c.last, gap - seen);
    else for (let k = seen; k < gap; k++) {
      const a = c.last + step * (k - 0.5), b = c.last + step * (k + 0.5);
      bar(made, c.x + k, Math.min(a, b), Math.max(a, b), 1);
    }
  }
  return made.used;
}

/** One bar more, or the last one longer. @param {Again<Bar>} made @param {number} x @param {number} low @param {number} high @param {number} wide */
function bar(made, x, low, high, wide) {
  const last = made.used[made.used.length - 1];
  if (last && last.low === low && last.high === high && last.x + last.wide === x) { last.wide += wide; return; }
  const next = made.take();
  next.x = x; next.wide = wide; next.low = low; next.high = high;
}

/** strip.lanes = [{ name, unit, words, colour, ring }]; strip.events = [{ time, kind, text }]; strip.end: latest time. */
export class Strip {
  /** @param {HTMLElement} host @param {(time: number | null) => void} onCursor */
  constructor(host, onCursor = () => {}) {
    this.host = host;
    this.onCursor = onCursor;
    /** @type {Lane[]} */
    this.lanes = [];
    /** @type {Mark[]} */
    this.events = [];
    this.seconds = 15; this.end = 0;
    this.made = { found: newColumns(), truth: newColumns(), other: newColumns(), bars: newBars() };
    /** @type {number | null} */
    this.paused = null; // the time at which the picture stands
    /** @type {number | null} */
    this.cursor = null; // a time
    /** @type {number | null} */
    this.fixed = null; // a time that the cursor shows while nobody points
    this.zero = 0; // what the axis calls 0 s
    this.empty = 'Tick a signal in the list to see it here.';
    /** @type {((time: number) => void) | null} */
    this.onPick = null; // (time) => ..., when somebody clicks
    /** @type {number | null | undefined} */
    this.cursorX = null; // pixels
    /** @type {{ x: number, at: number } | null} */
    this.drag = null;
    /** @type {Record<string, string> | null} */
    this.colours = null;
    this.ratio = this.wide = this.left = 1;
    /** @type {Pen | undefined} */
    this.pen = undefined;
    this.redraws = 0; this.rate = 0;
    this.canvas = h('canvas', { tabindex: '0', role: 'img', 'aria-label': 'Strip charts; arrow keys move the time cursor' });
    host.classList.add('strip-charts');
    host.replaceChildren(this.canvas);
    this.canvas.addEventListener('pointermove', (event) => this.point(event));
    this.canvas.addEventListener('pointerleave', () => { this.cursorX = null; this.still(); });
    this.canvas.addEventListener('keydown', (event) => this.key(event));
    this.canvas.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    this.canvas.addEventListener('pointerdown', (event) => {
      this.drag = { x: event.offsetX, at: this.until };
      if (this.onPick && this.cursor !== null) this.onPick(this.cursor);
    });
    addEventListener('pointerup', () => { this.drag = null; });
    this.size = [0, 0];
    new ResizeObserver(() => { this.size = [host.clientWidth, host.clientHeight]; this.still(); }).observe(host);
    this.running = false;
    this.due = 0; this.counted = performance.now(); this.before = 0;
  }

  get until() { return this.paused ?? this.end; }

  /** After a change between light and dark. */
  recolour() { this.colours = null; this.draw(); }

  start() {
    if (this.running) return;
    this.running = true;
    /** @param {number} now */
    const step = (now) => {
      if (!this.running) return;
      requestAnimationFrame(step);
      if (now < this.due - 4) return;
      this.due = Math.max(this.due + 1000 / RATE, now - 1000 / RATE); // a late one does not make the next late
      this.draw();
    };
    requestAnimationFrame(step);
  }

  stop() { this.running = false; }

  /** Draw now, where nothing else does. */
  still() { if (!this.running) this.draw(); }

  /** @param {boolean} on */
  pause(on) { this.paused = on ? this.end : null; }

  /** @param {PointerEvent} event */
  point(event) {
    if (this.drag && this.paused !== null) {
      this.paused = this.drag.at - (event.offsetX - this.drag.x) * this.seconds / Math.max(1, this.wide);
      return;
    }
    this.cursorX = event.offsetX;
    this.still();
  }

  /** @param {WheelEvent} event */
  wheel(event) {
    if (this.paused === null) return; // the page scrolls
    event.preventDefault();
    this.seconds = Math.min(300, Math.max(0.5, this.seconds * (event.deltaY > 0 ? 1.25 : 0.8)));
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const step = event.key === 'ArrowLeft' ? -1 : event.key === 'ArrowRight' ? 1 : 0;
    if (event.key === 'Escape') { this.cursorX = null; this.still(); return; }
    if (!step) return;
    event.preventDefault();
    this.cursorX = Math.min(LEFT + this.wide, Math.max(LEFT, (this.cursorX ?? LEFT + this.wide) + step * (event.shiftKey ? 40 : 4)));
    this.still();
  }

  draw() {
    const [width, height] = this.size, ratio = this.ratio = devicePixelRatio || 1; // asking the page itself would make it lay out anew
    if (!width || !height) return;
    const { canvas } = this;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
    }
    const pen = this.pen ??= /** @type {Pen} */ (canvas.getContext('2d', { alpha: false }));
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = this.colours?.['--card'] || css('--card');
    pen.fillRect(0, 0, width, height);
    pen.font = '12px system-ui, sans-serif';
    pen.textBaseline = 'middle';
    this.wide = width - LEFT - RIGHT;
    this.left = Math.round(LEFT * ratio) / ratio; // on a pixel of the screen
    const end = this.until, begin = end - this.seconds;
    /** @type {Scale} */
    const x = (time) => LEFT + (time - begin) / this.seconds * this.wide;
    this.cursor = this.cursorX === null || this.cursorX === undefined || this.cursorX < LEFT ? this.fixed : begin + (this.cursorX - LEFT) / this.wide * this.seconds;
    this.colours ??= Object.fromEntries(['--card', '--ink', '--soft', '--line', '--hair', '--mute', ...COLOURS].map((name) => [name, css(name)]));
    const { colours } = this;
    const bottom = height - AXIS - EVENTS;
    const each = this.lanes.length ? bottom / this.lanes.length : 0;
    this.lanes.forEach((lane, place) => this.lane(pen, lane, place * each, each, begin, end, colours));
    if (!this.lanes.length) {
      pen.fillStyle = colours['--soft'];
      pen.textAlign = 'left';
      pen.fillText(this.empty, LEFT, bottom / 2);
    }
    this.lastLane(pen, bottom, begin, end, x, colours);
    pen.strokeStyle = colours['--line'];
    pen.fillStyle = colours['--soft'];
    pen.textAlign = 'center';
    for (const tick of ticks(begin - this.zero, end - this.zero, Math.max(2, this.wide / 110))) {
      if (tick > -1e-9) pen.fillText(`${number(tick, 7)} s`, Math.min(width - 28, x(tick + this.zero)), height - AXIS / 2);
    }
    if (this.cursor !== null) {
      pen.strokeStyle = colours['--ink'];
      pen.globalAlpha = 0.6;
      line(pen, x(this.cursor), 0, x(this.cursor), height - AXIS);
      pen.globalAlpha = 1;
    }
    this.onCursor(this.cursor);
    this.redraws++;
    const now = performance.now();
    if (now - this.counted >= 1000) {
      this.rate = (this.redraws - this.before) * 1000 / (now - this.counted);
      this.counted = now; this.before = this.redraws;
    }
  }

  /**
   * @param {Pen} pen @param {Lane} lane @param {number} top @param {number} height @param {number} begin @param {number} end
   * @param {Record<string, string>} colours
   */
  lane(pen, lane, top, height, begin, end, colours) {
    const { made } = this, pixels = Math.round(this.wide * this.ratio);
    const found = columns(lane.ring, begin, end, pixels, made.found);
    const base = top + height - GAP, room = height - TITLE - GAP;
    let low = Infinity, high = -Infinity;
    const truth = lane.truth ? columns(lane.truth, begin, end, pixels, made.truth) : [];
    const other = lane.other ? columns(lane.other, begin, end, pixels, made.other) : [];
    for (const part of [found, truth, other]) for (const c of part) { if (c.low < low) low = c.low; if (c.high > high) high = c.high; }
    if (low > high) { low = 0; high = 1; }
    if (lane.words) { low = Math.min(low, 0); high = Math.max(high, low + 1); }
    const pad = (high - low) * 0.06 || Math.abs(high) * 0.05 || 1;
    const bottom = low - pad, span = high + pad - bottom;
    /** @type {Scale} */
    const y = (value) => base - (value - bottom) / span * room;
    pen.lineWidth = 1;
    pen.textAlign = 'right';
    const marks = lane.words ? [...new Set(found.flatMap((c) => [c.low, c.high]))] : ticks(bottom, bottom + span, Math.max(1, room / 34));
    let free = Infinity; // words that would lie on each other are left out
    for (const tick of marks.sort((a, b) => a - b)) {
      pen.strokeStyle = colours['--hair'];
      line(pen, LEFT, y(tick), LEFT + this.wide, y(tick));
      pen.fillStyle = colours['--soft'];
      if (free - y(tick) < 11) continue;
      free = y(tick);
      pen.fillText(lane.words ? (lane.words[tick] ?? number(tick)).slice(0, 10) : number(tick), LEFT - 6, y(tick));
    }
    pen.fillStyle = colours[lane.colour];
    const drawn = bars(found, Boolean(lane.words), made.bars);
    /** @param {{ x: number, wide: number }} bar */
    const when = (bar) => begin + (bar.x + bar.wide) / this.ratio / this.wide * this.seconds;
    /** @param {number} time */
    const isValid = (time) => !lane.valid || lane.valid.at(time) !== 0;
    if (lane.sd) { // two standard deviations on either side
      pen.globalAlpha = 0.2;
      for (const bar of drawn) {
        if (!isValid(when(bar))) continue;
        const wide = 2 * (lane.sd.at(when(bar)) ?? 0);
        const over = Math.max(top + TITLE, y(bar.high + wide)), under = Math.min(base, y(bar.low - wide));
        pen.fillRect(this.left + bar.x / this.ratio, over, bar.wide / this.ratio, Math.max(0, under - over));
      }
      pen.globalAlpha = 1;
    }
    for (const bar of drawn) {
      const over = y(bar.high) - THICK / 2;
      pen.globalAlpha = isValid(when(bar)) ? 1 : 0.3;
      pen.fillRect(this.left + bar.x / this.ratio, over, bar.wide / this.ratio, y(bar.low) + THICK / 2 - over);
    }
    pen.globalAlpha = 1;
    /** @type {[Column[], string][]} */
    const over = [[other, '--mute'], [truth, '--ink']];
    for (const [one, colour] of over) {
      pen.fillStyle = colours[colour];
      for (const bar of bars(one, Boolean(lane.words), made.bars)) pen.fillRect(this.left + bar.x / this.ratio, y(bar.high) - THICK / 2, bar.wide / this.ratio, y(bar.low) - y(bar.high) + THICK);
    }
    const shown = lane.ring.at(this.cursor ?? end);
    const truly = lane.truth?.at(this.cursor ?? end);
    /** @param {number | null | undefined} value */
    const says = (value, sd = 0) => (lane.places === undefined ? quantity(value, lane.unit, sd) : fixed(value, lane.places));
    const valid = isValid(this.cursor ?? end);
    const said = !valid ? 'not valid' : shown === null ? '–' : lane.words ? lane.words[shown] ?? number(shown) : says(shown, (lane.sd?.at(this.cursor ?? end) ?? 0) * 2);
    pen.textAlign = 'left';
    pen.fillStyle = colours[lane.colour];
    pen.fillRect(LEFT, top + 5, 8, 8);
    pen.fillStyle = colours['--ink'];
    const beside = lane.sd && valid ? ' (2 sd)' : '';
    if (!valid) pen.fillStyle = colours['--soft'];
    pen.fillText(`${lane.name}   ${said}${beside}${truly === null || truly === undefined ? '' : `   truth ${says(truly)}`}${lane.other ? `   grey: ${says(lane.other.at(this.cursor ?? end))}` : ''}`, LEFT + 14, top + 9);
  }

  /**
   * The lane of events.
   * @param {Pen} pen @param {number} top @param {number} begin @param {number} end @param {Scale} x @param {Record<string, string>} colours
   */
  lastLane(pen, top, begin, end, x, colours) {
    pen.strokeStyle = colours['--line'];
    pen.lineWidth = 1;
    line(pen, LEFT, top + 1, LEFT + this.wide, top + 1);
    pen.fillStyle = colours['--soft'];
    pen.textAlign = 'right';
    pen.fillText('events', LEFT - 6, top + 14);
    pen.textAlign = 'left';
    const free = [LEFT, LEFT, LEFT]; // where each row of words has room again
    const taken = new Set(); // a babbling node can fill the lane: one mark of a colour on a pixel will do
    for (const event of this.events) {
      if (event.time === null || event.time < begin || event.time > end) continue;
      const at = Math.round(x(event.time)), colour = MARKS[event.kind] || '--soft';
      pen.fillStyle = colours[colour];
      if (!taken.has(colour + at)) {
        taken.add(colour + at);
        pen.fillRect(at, top + 1, 1, EVENTS - 1);
        pen.fillRect(at - 2, top + 1, 4, 6);
      }
      const row = free.findIndex((from) => from <= at);
      if (row < 0) continue;
      const text = event.text.length > 34 ? `${event.text.slice(0, 33)}…` : event.text;
      const wide = event.wide ??= pen.measureText(text).width;
      if (at + 5 + wide > LEFT + this.wide + RIGHT) continue;
      pen.fillText(text, at + 5, top + 10 + row * 15);
      free[row] = at + wide + 12;
    }
  }
}

/** @param {Pen} pen @param {number} x1 @param {number} y1 @param {number} x2 @param {number} y2 */
function line(pen, x1, y1, x2, y2) {
  pen.beginPath();
  pen.moveTo(Math.round(x1) + 0.5, Math.round(y1) + 0.5);
  pen.lineTo(Math.round(x2) + 0.5, Math.round(y2) + 0.5);
  pen.stroke();
}
