// Plots of a case, on the page and in a report: points, bands, curves and marked ranges on a canvas, with hover, zoom,
// selection, keyboard, a table, and export.
import { css, h, number } from './basics.js';
import { legend, paint } from './painting.js';
import { SvgPen } from './svg_pen.js';

const REACH = 22; // pixels within which a point answers the mouse
const SETTLED_MS = 150; // without another drawing, after which the mouse is made ready for
const TABLE_ROWS = 400;
const COLOURS = ['--ink', '--soft', '--blue', '--violet', '--teal', '--band', '--floor', '--fail', '--red']; // of what a plot draws
const FIGURE = { width: 640, height: 420, row: 18, foot: 6, sharp: 3 }; // px that a saved figure has; a picture has three for each
/** @type {Record<string, number>} */
const ZOOM = { '+': 0.8, '=': 0.8, '-': 1.25, 0: 0 }; // key -> share of what is shown; 0 shows all
/** @type {Record<string, number[]>} */
const MOVES = { ArrowRight: [0.1, 0], ArrowLeft: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
/** @type {Record<string, number>} */
const STEPS = { ArrowRight: 1, ArrowLeft: -1, PageDown: 10, PageUp: -10 }; // rows that a key goes on

// ---------------------------------------------------------------- canvas plot

/**
 * What a plot shows is its PlotSpec (types.d.ts). Dragged over, it zooms in; with Shift, or after Select or Lasso, it picks
 * rows out and tells `onselect`. Double click and 0 show all again, + and - zoom, Shift with the arrows moves.
 */
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
    /** @type {PlotMap | null} */
    this.map = null;
    /** @type {Zoomed | null} */
    this.view = null; // what is zoomed into
    /** @type {Set<number> | null} */
    this.selected = null;
    /** @type {(rows: number[] | null) => void} */
    this.onselect = () => {};
    /** @type {(view: Zoomed | null) => void} */
    this.onzoom = () => {};
    /** @type {Map<string, number[]> | null} */
    this.cells = null; // rows by where they are drawn, for the mouse
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    /** @type {{ u: number, v: number } | null} */
    this.from = null; // where the mouse was pressed
    /** @type {{ u: number, v: number }[]} */
    this.way = []; // from there on
    /** @type {'' | 'box' | 'lasso'} */
    this.selecting = ''; // how dragging picks rows out
    this.log = { x: false, y: false }; // which axes are logarithmic
    this.name = name;
    this.host = host;
    host.classList.add('plot');
    this.canvas = h('canvas', { tabindex: '0', role: 'img', 'aria-label': name });
    this.tip = h('div', { class: 'tip', hidden: true });
    this.ring = h('div', { class: 'pointed', hidden: true });
    this.frameOf = h('div', { class: 'dragged', hidden: true });
    this.said = h('div', { class: 'visually-hidden', 'aria-live': 'polite' });
    host.replaceChildren(this.canvas, this.ring, this.frameOf, this.tip, this.said);
    this.canvas.addEventListener('pointerdown', (event) => this.press(event));
    this.canvas.addEventListener('pointermove', (event) => (this.from ? this.drag(event) : this.hover(event)));
    this.canvas.addEventListener('pointerup', (event) => this.release(event));
    this.canvas.addEventListener('pointercancel', () => this.letGo());
    this.canvas.addEventListener('pointerleave', () => this.point(null));
    this.canvas.addEventListener('dblclick', () => this.zoom(null));
    this.canvas.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    this.canvas.addEventListener('blur', () => this.point(null));
    this.canvas.addEventListener('keydown', (event) => this.key(event));
    new ResizeObserver(() => this.redraw()).observe(host);
  }

  /** @param {PlotSpec} spec */
  draw(spec) {
    const { spec: before } = this;
    if (before && (before.x.name !== spec.x.name || before.y.name !== spec.y.name)) this.view = null;
    this.spec = spec;
    this.point(null);
    this.canvas.setAttribute('aria-label', spec.alt || this.name);
    const rows = new Set(spec.points.flatMap((p) => p.rows)); // each once, however often it is drawn
    this.order = [...rows].sort((a, b) => spec.x.values[a] - spec.x.values[b]);
    if (this.table) this.showTable(true);
    this.redraw();
  }

  redraw() {
    const width = this.host.clientWidth, height = this.host.clientHeight;
    if (!this.spec || !width || !height) return;
    const scale = devicePixelRatio || 1;
    this.canvas.width = Math.round(width * scale);
    this.canvas.height = Math.round(height * scale);
    const c = /** @type {Pen} */ (this.canvas.getContext('2d'));
    c.scale(scale, scale);
    c.clearRect(0, 0, width, height);
    this.cells = null;
    this.map = paint(c, this.spec, width, height, this.view, this.selected, this.log);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => { if (this.map && this.spec) this.cells ??= this.drawn(this.map, this.spec); }, SETTLED_MS); // before the mouse comes
    if (this.at !== null) this.mark(this.at);
  }

  /** A ring about the row that is pointed at. @param {number} row @returns {{ u: number, v: number } | null} */
  mark(row) {
    const { map, spec } = this;
    const one = spec?.points.find((p) => p.rows.includes(row));
    if (!map || !spec || !one) return null;
    const u = map.X(spec.x.values[row]), v = map.Y(one.values[row]);
    const inside = u >= map.box.x0 && u <= map.box.x1 && v >= map.box.y1 && v <= map.box.y0;
    this.ring.hidden = !inside;
    Object.assign(this.ring.style, { left: `${u - 8}px`, top: `${v - 8}px` });
    return inside ? { u, v } : null;
  }

  // ---------------------------------------------------------------- mouse

  /** Where the mouse is, in pixels of the plot. @param {MouseEvent} event */
  where(event) {
    const box = this.canvas.getBoundingClientRect();
    return { u: event.clientX - box.left, v: event.clientY - box.top };
  }

  /** Rows by the cell of REACH pixels in which each of their points lies. @param {PlotMap} map @param {PlotSpec} spec */
  drawn(map, spec) {
    /** @type {Map<string, number[]>} */
    const cells = new Map();
    for (const one of spec.points) {
      for (const i of one.rows) {
        const key = `${Math.floor(map.X(spec.x.values[i]) / REACH)} ${Math.floor(map.Y(one.values[i]) / REACH)}`;
        const list = cells.get(key);
        if (list) list.push(i); else cells.set(key, [i]);
      }
    }
    return cells;
  }

  /** @param {PointerEvent} event */
  hover(event) {
    const { map, spec } = this;
    if (!map || !spec) return;
    this.cells ??= this.drawn(map, spec);
    const { u, v } = this.where(event), a = Math.floor(u / REACH), b = Math.floor(v / REACH);
    const close = new Set([-1, 0, 1].flatMap((p) => [-1, 0, 1].flatMap((q) => this.cells?.get(`${a + p} ${b + q}`) ?? [])));
    let best = null, near = REACH ** 2;
    for (const one of spec.points) {
      for (const i of close) {
        const d = (map.X(spec.x.values[i]) - u) ** 2 + (map.Y(one.values[i]) - v) ** 2;
        if (d < near) { near = d; best = i; }
      }
    }
    this.point(best);
  }

  /** @param {PointerEvent} event */
  press(event) {
    if (event.button !== 0 || event.pointerType === 'touch') return; // a finger scrolls the page
    this.from = this.where(event);
    this.way = [this.from];
    this.canvas.setPointerCapture(event.pointerId);
    this.point(null);
  }

  /** The box between where the mouse was pressed and where it is, within the axes. @param {PointerEvent} event */
  dragged(event) {
    const { from, map } = this;
    if (!from || !map) return null;
    const to = this.where(event), { box } = map;
    /** @param {number} v @param {number} low @param {number} high */
    const within = (v, low, high) => Math.min(high, Math.max(low, v));
    const us = [from.u, to.u].map((u) => within(u, box.x0, box.x1)).sort((a, b) => a - b);
    const vs = [from.v, to.v].map((v) => within(v, box.y1, box.y0)).sort((a, b) => a - b);
    return us[1] - us[0] < 4 && vs[1] - vs[0] < 4 ? null : { us, vs };
  }

  /** @param {PointerEvent} event */
  drag(event) {
    const found = this.dragged(event), lasso = this.selecting === 'lasso';
    this.frameOf.hidden = !found;
    this.way.push(this.where(event));
    if (lasso) Object.assign(this.frameOf.style, { inset: '0', width: '', height: '', clipPath: `polygon(${this.way.map(({ u, v }) => `${u}px ${v}px`).join(',')})` });
    else if (found) Object.assign(this.frameOf.style, { inset: '', left: `${found.us[0]}px`, top: `${found.vs[0]}px`, width: `${found.us[1] - found.us[0]}px`, height: `${found.vs[1] - found.vs[0]}px`, clipPath: '' });
  }

  letGo() { this.from = null; this.frameOf.hidden = true; }

  /** @param {PointerEvent} event */
  release(event) {
    const found = this.dragged(event), { map, way } = this;
    this.letGo();
    if (this.selecting === 'lasso' && way.length > 2) this.choose((u, v) => inside(way, u, v));
    else if (!found || !map) return;
    else if (this.selecting || event.shiftKey) this.choose((u, v) => u >= found.us[0] && u <= found.us[1] && v >= found.vs[0] && v <= found.vs[1]);
    else {
      this.zoom({ x: found.us.map(map.x), y: [map.y(found.vs[1]), map.y(found.vs[0])] });
    }
  }

  /** Pick out the rows that are drawn within. @param {(u: number, v: number) => boolean} within whether a place of the plot [px] is */
  choose(within) {
    const { map, spec } = this;
    if (!map || !spec) return;
    const rows = new Set(spec.points.flatMap((one) => one.rows.filter((i) => within(map.X(spec.x.values[i]), map.Y(one.values[i])))));
    this.onselect(rows.size ? [...rows] : null);
  }

  /** Show a part; null: all. @param {Zoomed | null} view */
  zoom(view) {
    this.view = view;
    this.host.dataset.zoomed = view ? 'yes' : '';
    this.redraw();
    this.onzoom(view);
  }

  /** Zoom about a place, or move. @param {number} factor of what is shown @param {number} u @param {number} v shares, 0 to 1 */
  scale(factor, u = 0.5, v = 0.5, right = 0, up = 0) {
    const { map } = this;
    if (!map) return;
    /** @param {number[]} range @param {number} at @param {number} move @param {boolean} log */
    const part = (range, at, move, log) => {
      const [low, high] = log ? range.map(Math.log) : range;
      const wide = high - low, begin = low + at * wide * (1 - factor) + move * wide, ends = [begin, begin + factor * wide];
      return log ? ends.map(Math.exp) : ends;
    };
    this.zoom({ x: part(map.xs, u, right, this.log.x), y: part(map.ys, v, up, this.log.y) });
  }

  /** @param {WheelEvent} event */
  wheel(event) {
    const { map } = this;
    if (!map || !(event.ctrlKey || event.metaKey)) return; // the page scrolls
    event.preventDefault();
    const { u, v } = this.where(event), { box } = map;
    this.scale(event.deltaY < 0 ? 0.8 : 1.25, (u - box.x0) / (box.x1 - box.x0), (box.y0 - v) / (box.y0 - box.y1));
  }

  // ---------------------------------------------------------------- keys and pointing

  /** @param {KeyboardEvent} event */
  key(event) {
    const step = STEPS[event.key] || 0, zoom = ZOOM[event.key], move = event.shiftKey && MOVES[event.key];
    if (event.key === 'Escape') { this.point(null); this.onselect(null); }
    if (zoom !== undefined || move) event.preventDefault();
    if (zoom === 0) return this.zoom(null);
    if (zoom) return this.scale(zoom);
    if (move) return this.scale(1, 0.5, 0.5, move[0], move[1]);
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
    const place = row === null ? null : this.mark(row);
    this.tip.hidden = place === null;
    if (row === null) this.ring.hidden = true;
    if (row === null || !place || !this.spec) return;
    this.tip.textContent = this.spec.describe(row);
    const { u, v } = place;
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

  // ---------------------------------------------------------------- export

  /** Buttons: select, show all, and the plot as PNG, SVG and CSV. */
  tools() {
    /** @param {string} text @param {string} title @param {() => void} onclick */
    const button = (text, title, onclick) => h('button', { type: 'button', class: 'quiet', title: `${this.name}: ${title}`, 'aria-label': `${this.name}: ${title}`, text, onclick });
    /** @type {['box' | 'lasso', string, string][]} */
    const ways = [['box', 'Select', 'dragging picks the rows in a box out instead of zooming'], ['lasso', 'Lasso', 'dragging picks the rows within a line out']];
    const chosen = ways.map(([way, text, title]) => button(text, title, () => {
      this.selecting = this.selecting === way ? '' : way;
      chosen.forEach((one, i) => one.setAttribute('aria-pressed', String(ways[i][0] === this.selecting)));
    }));
    for (const one of chosen) one.setAttribute('aria-pressed', 'false');
    return h('span', { class: 'tools' }, chosen, button('All', 'show all, pick none out', () => { this.zoom(null); this.onselect(null); }),
      button('PNG', 'save as PNG', () => this.png().toBlob((blob) => { if (blob) save(blob, this.file('png')); })),
      button('SVG', 'save as SVG, for a paper', () => save(new Blob([this.svg()], { type: 'image/svg+xml' }), this.file('svg'))),
      button('CSV', 'save its rows as CSV', () => save(new Blob([this.csv()], { type: 'text/csv' }), this.file('csv'))));
  }

  /** Buttons that make an axis logarithmic, or linear again. @param {Plot} beside a plot with the same x axis */
  logs(beside) {
    return /** @type {const} */ (['x', 'y']).map((axis) => {
      const title = `${this.name}: ${axis} axis logarithmic, of what is above zero`;
      const one = h('button', {
        type: 'button', class: 'key', title, 'aria-label': title, text: `log ${axis}`, 'aria-pressed': 'false', onclick: () => {
          this.log[axis] = !this.log[axis] && this.positive(axis);
          one.setAttribute('aria-pressed', String(this.log[axis]));
          if (axis === 'x') { beside.log.x = this.log.x; beside.zoom(null); }
          this.zoom(null);
        },
      });
      return one;
    });
  }

  /** Whether there is something above zero to draw. @param {'x' | 'y'} axis */
  positive(axis) { return Boolean(this.spec && (axis === 'x' ? [this.spec.x.values] : this.spec.points.map((p) => p.values)).some((list) => list.some((v) => v > 0))); }

  /** @param {string} ending */
  file(ending) { return `${this.name}-${this.spec?.y.name ?? ''}-${this.spec?.x.name ?? ''}.${ending}`.toLowerCase().replaceAll(/[^\w.]+/g, '_'); }

  /** What is shown as it stands in a paper: light, with what its marks mean, and its axes' names. @param {Pen} pen */
  figure(pen) {
    const { theme } = document.documentElement.dataset, now = COLOURS.map(css);
    document.documentElement.dataset.theme = 'light';
    const paper = COLOURS.map(css);
    /** @template {{ color: string }} T @param {T[]} list @returns {T[]} */
    const light = (list) => list.map((one) => ({ ...one, color: paper[now.indexOf(one.color)] ?? one.color }));
    try {
      const { spec } = this;
      if (spec) this.onPaper(pen, { ...spec, points: light(spec.points), lines: light(spec.lines), bands: light(spec.bands), keys: light(spec.keys ?? []) });
    } finally {
      if (theme === undefined) delete document.documentElement.dataset.theme; else document.documentElement.dataset.theme = theme;
    }
  }

  /** @param {Pen} pen @param {PlotSpec} spec in the colours of paper */
  onPaper(pen, spec) {
    const { width, height } = FIGURE;
    pen.fillStyle = css('--card');
    pen.fillRect(0, 0, width, height);
    const top = FIGURE.row * legend(pen, spec.keys ?? [], width, FIGURE.row);
    pen.save();
    pen.translate(0, top);
    paint(pen, { ...spec, x: { ...spec.x, chosen: false } }, width, height - top - FIGURE.foot, this.view, this.selected, this.log);
    pen.restore();
  }

  /** As SVG text. */
  svg() {
    const pen = new SvgPen(FIGURE.width, FIGURE.height);
    this.figure(/** @type {Pen} */ (/** @type {unknown} */ (pen)));
    return pen.text();
  }

  /** As a picture. */
  png() {
    const { width, height, sharp } = FIGURE, canvas = h('canvas', { width: width * sharp, height: height * sharp });
    const pen = /** @type {Pen} */ (canvas.getContext('2d'));
    pen.scale(sharp, sharp);
    this.figure(pen);
    return canvas;
  }

  /** The rows as CSV; those that are picked out, where some are. */
  csv() {
    if (!this.spec) return '';
    const { columns, rows } = this.spec.table(), { selected } = this;
    /** @param {string | number | null} cell */
    const quoted = (cell) => (typeof cell === 'string' && /[",\n]/.test(cell) ? `"${cell.replaceAll('"', '""')}"` : String(cell ?? ''));
    return [columns, ...rows.filter((_, i) => !selected || selected.has(i))].map((row) => row.map(quoted).join(',')).join('\n') + '\n';
  }
}

/** Whether a place lies within a closed line: crossed an odd number of times on the way out. @param {{ u: number, v: number }[]} line @param {number} u @param {number} v */
function inside(line, u, v) {
  return line.filter((a, i) => {
    const b = line[(i + 1) % line.length];
    return a.v > v !== b.v > v && u < a.u + (b.u - a.u) * (v - a.v) / (b.v - a.v);
  }).length % 2 === 1;
}

/** Hand a file to the browser. @param {Blob} blob @param {string} name */
function save(blob, name) {
  const address = URL.createObjectURL(blob), link = h('a', { href: address, download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}
