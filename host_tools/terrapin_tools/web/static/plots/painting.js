// How a plot of a case is drawn: axes, marked ranges, bands, curves and points.
import { css, number } from './basics.js';

const LINEAR = { x: false, y: false };
export const MARGIN = { left: 56, right: 10, top: 10, bottom: 34 };

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

/** The same on a logarithmic axis: 1, 2 and 5 of each power of ten, or the powers alone. @param {number} low @param {number} high @param {number} count */
function logTicks(low, high, count) {
  const from = Math.floor(Math.log10(low)), to = Math.ceil(Math.log10(high));
  const each = Math.max(1, Math.ceil((to - from) / count)), found = [];
  for (let k = from; k <= to; k += each) for (const m of each > 1 || to - from > count ? [1] : [1, 2, 5]) found.push(m * 10 ** k);
  const inside = found.filter((v) => v >= low && v <= high);
  return inside.length > 1 ? inside : ticks(low, high, count).filter((v) => v > 0);
}

/** A value to its place, linear or logarithmic; what no logarithm has lies far outside. @param {number[]} range @param {number} from @param {number} to @param {boolean} log @returns {Scale} */
function scale([low, high], from, to, log) {
  const wide = to - from;
  if (!log) return (v) => from + ((v - low) / (high - low)) * wide;
  const all = Math.log(high / low);
  return (v) => (v > 0 ? from + (Math.log(v / low) / all) * wide : from - 10 * wide);
}

/** The way back. @param {number[]} range @param {number} from @param {number} to @param {boolean} log @returns {Scale} */
function back([low, high], from, to, log) {
  return (u) => (log ? low * (high / low) ** ((u - from) / (to - from)) : low + ((u - from) / (to - from)) * (high - low));
}

/** The lowest and the highest value of all lists, with some room. @param {(number | null)[][]} lists @param {number} pad @param {boolean} log those above zero alone */
function span(lists, pad, log = false) {
  let low = Infinity, high = -Infinity;
  for (const list of lists) for (const v of list) if (v !== null && Number.isFinite(v) && (!log || v > 0)) { if (v < low) low = v; if (v > high) high = v; }
  if (low > high) return log ? [1, 10] : [0, 1];
  if (log) { const room = high > low ? (high / low) ** pad : 2; return [low / room, high * room]; }
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

// ---------------------------------------------------------------- marks

/** From where to where the axes go that show all. @param {PlotSpec} spec @param {Logs} log */
export function extent(spec, log = LINEAR) {
  const tall = [...spec.points.map((p) => p.rows.map((i) => p.values[i])), ...spec.lines.map((l) => l.values)];
  for (const band of spec.bands) tall.push(band.values.map((v) => v + band.half), band.values.map((v) => v - band.half));
  if (spec.level) tall.push(spec.level);
  return { xs: span([spec.x.values], 0.03, log.x), ys: span(tall, 0.05, log.y) };
}

/**
 * Draw on a canvas, or as SVG.
 * @param {Pen} c @param {PlotSpec} spec @param {number} width @param {number} height
 * @param {Zoomed | null} view what is zoomed into @param {Set<number> | null} selected rows @param {Logs} log which axes are logarithmic @returns {PlotMap}
 */
export function paint(c, spec, width, height, view, selected, log = LINEAR) {
  const box = { x0: MARGIN.left, x1: width - MARGIN.right, y0: height - MARGIN.bottom, y1: MARGIN.top };
  const shown = view ?? (log.x || log.y ? null : spec.frame), { xs, ys } = shown ? { xs: shown.x, ys: shown.y } : extent(spec, log);
  const X = scale(xs, box.x0, box.x1, log.x), Y = scale(ys, box.y0, box.y1, log.y);
  frame(c, spec, box, xs, ys, X, Y, log);
  c.save();
  c.beginPath();
  c.rect(box.x0, box.y1, box.x1 - box.x0, box.y0 - box.y1);
  c.clip();
  const x = spec.x.values;
  for (const band of spec.bands) drawBand(c, x, band, X, Y);
  for (const one of spec.lines.filter((l) => l.under)) drawLine(c, x, one, X, Y);
  for (const points of spec.points) drawPoints(c, x, points, X, Y, selected);
  for (const one of spec.lines.filter((l) => !l.under)) drawLine(c, x, one, X, Y);
  c.restore();
  return { box, xs, ys, X, Y, x: back(xs, box.x0, box.x1, log.x), y: back(ys, box.y0, box.y1, log.y) };
}

/**
 * Axes, level, and the ranges that are marked.
 * @param {Pen} c @param {PlotSpec} spec @param {{ x0: number, x1: number, y0: number, y1: number }} box
 * @param {number[]} xs @param {number[]} ys @param {Scale} X @param {Scale} Y @param {Logs} log
 */
function frame(c, spec, box, xs, ys, X, Y, log) {
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
  for (const t of (log.y ? logTicks : ticks)(ys[0], ys[1], Math.max(2, (box.y0 - box.y1) / 42))) {
    line(c, box.x0, Y(t), box.x1, Y(t));
    c.fillText(number(t), box.x0 - 7, Y(t));
  }
  c.textAlign = 'center';
  c.textBaseline = 'top';
  const room = (box.x1 - box.x0) / 90;
  for (const t of (log.x ? logTicks : ticks)(xs[0], xs[1], Math.max(2, room))) {
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

/**
 * What the marks mean, from the left on in rows. @param {Pen} c @param {Key[]} keys @param {number} width @param {number} tall of a row [px]
 * @returns {number} of rows
 */
export function legend(c, keys, width, tall) {
  let x = MARGIN.left, row = 0;
  c.font = '12px system-ui, sans-serif';
  c.textBaseline = 'middle';
  c.textAlign = 'left';
  for (const { text, mark, color } of keys) {
    const wide = 34 + 6.6 * text.length; // about what the letters take
    if (x > MARGIN.left && x + wide > width) { x = MARGIN.left; row += 1; }
    const y = (row + 0.5) * tall + 2;
    c.fillStyle = c.strokeStyle = color;
    c.lineWidth = mark === 'line' ? 2.2 : 1.6;
    c.setLineDash(mark === 'dashed' ? [3, 4] : []);
    if (mark === 'box') c.fillRect(x, y - 5, 16, 10);
    else if (mark === 'line' || mark === 'dashed') line(c, x, y, x + 16, y);
    else drawPoints(c, [0], { values: [0], rows: [0], kind: mark, color }, () => x + 8, () => y, null);
    c.setLineDash([]);
    c.fillStyle = css('--ink');
    c.fillText(text, x + 22, y);
    x += wide;
  }
  return keys.length ? row + 1 : 0;
}

/** @param {Pen} c @param {number[]} x @param {Band} band @param {Scale} X @param {Scale} Y */
function drawBand(c, x, band, X, Y) {
  c.fillStyle = band.color;
  if (!band.lines) { // no curve: a short bar about each prediction
    band.values.forEach((v, i) => c.fillRect(X(x[i]) - 4, Y(v + band.half), 8, Y(v - band.half) - Y(v + band.half)));
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
function drawLine(c, x, one, X, Y) {
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
    one.values.forEach((v, i) => dash(c, X(x[i]), Y(v)));
  }
  c.stroke();
  c.setLineDash([]);
}

/** @param {Pen} c @param {number[]} x @param {Points} one @param {Scale} X @param {Scale} Y @param {Set<number> | null} selected */
function drawPoints(c, x, one, X, Y, selected) {
  const many = x.length, size = one.size || (many > 3000 ? 1.5 : many > 600 ? 2.2 : 3.4);
  const alpha = one.alpha ?? (many > 3000 ? 0.3 : many > 600 ? 0.55 : 0.8);
  c.fillStyle = c.strokeStyle = one.color;
  c.lineWidth = 1.5;
  for (const i of one.rows) {
    const u = X(x[i]), v = Y(one.values[i]);
    c.globalAlpha = !selected ? alpha : selected.has(i) ? 1 : 0.12;
    c.beginPath();
    if (one.kind === 'held') {
      const d = size * 1.35;
      c.moveTo(u - d, v); c.lineTo(u, v - d); c.lineTo(u + d, v); c.lineTo(u, v + d); c.closePath();
      c.stroke();
    } else { c.arc(u, v, size, 0, 6.2832); c.fill(); }
  }
  c.globalAlpha = 1;
}

/** A short level stroke about a place. @param {Pen} c @param {number} x @param {number} y */
const dash = (c, x, y) => { c.moveTo(x - 5, y); c.lineTo(x + 5, y); };
/** @param {Axis} axis */
export const label = (axis) => (axis.unit && axis.unit !== '1' ? `${axis.name}, ${axis.unit}` : axis.name);
/** @param {Pen} c @param {number} x0 @param {number} y0 @param {number} x1 @param {number} y1 */
function line(c, x0, y0, x1, y1) {
  c.beginPath();
  c.moveTo(Math.round(x0) + 0.5, Math.round(y0) + 0.5);
  c.lineTo(Math.round(x1) + 0.5, Math.round(y1) + 0.5);
  c.stroke();
}
