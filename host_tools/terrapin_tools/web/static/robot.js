// The robot rolling, from the columns of a run: shell, swinging inner device, ground with slope and sinkage, and a plot
// of what belongs to the moment under it. Lengths are to scale, but for the sinkage, which is drawn three times as deep.
import { css, fixed, h, unit } from './app.js';

const DEEPER = 3; // sinkage of some millimetres would not be seen
const GROUNDS = { hard_floor: '#8b96a5', agricultural: '#7a6a4f', red_terrain: '#a5553b', dry_peat: '#5d4a3c', sand: '#c9a86a' };

/**
 * The value of a column at a row, straight lines between rows; null where there is none.
 * @param {Columns} columns @param {string} name @param {number} row
 */
export function at(columns, name, row) {
  const column = columns[name];
  if (!column) return null;
  const low = Math.floor(row), a = column[low], b = column[Math.min(low + 1, column.length - 1)];
  return a === null || b === null ? a : a + (b - a) * (row - low);
}

export class Robot {
  /** @param {HTMLElement} host @param {number} across radii that are seen from left to right @param {number} tall from top to bottom */
  constructor(host, across = 16, tall = 5.2) {
    this.host = host;
    this.across = across;
    this.tall = tall;
    this.canvas = h('canvas', { role: 'img', 'aria-label': 'The robot on its way; the numbers below say the same' });
    host.classList.add('robot');
    host.replaceChildren(this.canvas);
    /** @type {Run | null} */
    this.run = null;
    this.row = 0;
    new ResizeObserver(() => this.draw()).observe(host);
  }

  /** @param {Run} run */
  show(run) { this.run = run; this.row = 0; this.draw(); }

  /** Where the ground of a run is at x, and how steep. @param {Run} run @param {number} x */
  ground(run, x) {
    const { x: xs, height } = run.ground, step = xs[1] - xs[0];
    const place = Math.min(xs.length - 2, Math.max(0, (x - xs[0]) / step)), low = Math.floor(place);
    const steep = (height[low + 1] - height[low]) / step;
    return { y: height[low] + (place - low) * step * steep, angle: Math.atan(steep) };
  }

  draw() {
    const width = this.host.clientWidth, height = this.host.clientHeight, ratio = devicePixelRatio || 1;
    if (!width || !height) return;
    const wide = Math.round(width * ratio), tall = Math.round(height * ratio);
    if (this.canvas.width !== wide || this.canvas.height !== tall) { this.canvas.width = wide; this.canvas.height = tall; } // each time is a canvas anew
    const pen = /** @type {Pen} */ (this.canvas.getContext('2d'));
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = css('--bg');
    pen.fillRect(0, 0, width, height);
    pen.font = '12px system-ui, sans-serif';
    if (!this.run) {
      pen.fillStyle = css('--soft');
      pen.fillText('Run a scenario, or choose a run, to see the robot roll.', 16, 28);
      return;
    }
    const { columns, radius } = this.run;
    /** @param {string} name */
    const value = (name) => at(columns, name, this.row);
    const scale = Math.min(width / (radius * this.across), height / (radius * this.tall)); // pixels a metre
    const position = value('position') ?? 0, here = this.ground(this.run, position);
    const sunk = Math.max(0, value('sinkage') || 0) * DEEPER;
    /** @type {Scale} */
    const px = (x) => width * 0.42 + (x - position) * scale;
    /** @type {Scale} */
    const py = (y) => height * 0.66 - (y - here.y) * scale;
    this.soil(this.run, pen, width, height, position, sunk, scale, px, py);
    const slope = here.angle;
    // the shell's middle is a radius above the ground, at right angles to it, less what it has sunk in
    const cx = px(position) - Math.sin(slope) * (radius - sunk) * scale, cy = py(here.y) - Math.cos(slope) * (radius - sunk) * scale;
    const state = columns.state?.[Math.floor(this.row)];
    this.body(pen, cx, cy, radius * scale, value('angle') ?? 0, value('swing_angle') ?? 0, typeof state === 'number' ? this.run.words.state[state] : '');
    this.says(pen, cx, cy, radius * scale, value);
  }

  /**
   * The ground, which the robot dents, with its kinds and a ruler.
   * @param {Run} run @param {Pen} pen @param {number} width @param {number} height @param {number} position
   * @param {number} sunk @param {number} scale @param {Scale} px @param {Scale} py
   */
  soil(run, pen, width, height, position, sunk, scale, px, py) {
    const from = position - (width * 0.42) / scale, to = position + (width * 0.58) / scale;
    const { segments, radius } = run, half = Math.sqrt(Math.max(0, 2 * radius * sunk));
    /** @type {Scale} */
    const surface = (x) => {
      const d = x - position;
      const dent = Math.abs(d) < half ? sunk - (radius - Math.sqrt(Math.max(0, radius * radius - d * d))) : d < 0 && d > -half * 8 ? 0 : 0;
      return this.ground(run, x).y - Math.max(0, dent) - (d <= -half && sunk > 0 ? 0.35 * sunk : 0); // a shallow rut is left behind
    };
    const kinds = segments.map((s, i) => ({ ...s, from: i ? s.from : -Infinity, to: segments[i + 1]?.from ?? Infinity })).filter((s) => s.from < to && s.to > from);
    for (const kind of kinds) {
      const a = Math.max(kind.from, from), b = Math.min(kind.to, to);
      pen.beginPath();
      pen.moveTo(px(a), height);
      const steps = Math.max(2, Math.ceil((b - a) * scale / 3));
      for (let i = 0; i <= steps; i++) { const x = a + (b - a) * i / steps; pen.lineTo(px(x), py(surface(x))); }
      pen.lineTo(px(b), height);
      pen.closePath();
      pen.fillStyle = /** @type {Record<string, string>} */ (GROUNDS)[kind.terrain] || GROUNDS.sand;
      pen.globalAlpha = 0.55;
      pen.fill();
      pen.globalAlpha = 1;
    }
    pen.fillStyle = css('--ink');
    pen.textAlign = 'center';
    const each = 0.25;
    for (let mark = Math.ceil(from / each) * each; mark < to; mark += each) {
      const y = py(this.ground(run, mark).y);
      pen.fillRect(px(mark), y + 10, 1, Math.abs(mark % 1) < 1e-6 ? 12 : 6);
      if (Math.abs(mark - Math.round(mark)) < 1e-6) pen.fillText(`${Math.round(mark)} m`, px(mark), Math.min(height - 22, y + 34));
    }
    pen.textAlign = 'left';
    for (const kind of kinds) { // over the marks, at the foot
      const a = px(Math.max(kind.from, from)), b = px(Math.min(kind.to, to)), name = kind.terrain.replaceAll('_', ' '), wide = pen.measureText(name).width;
      if (b - a < Math.min(60, wide)) continue;
      const left = Math.max(4, Math.min(Math.max(a + 10, 10), width - wide - 6));
      pen.fillStyle = css('--card');
      pen.fillRect(left - 4, height - 19, wide + 8, 17);
      pen.fillStyle = css('--ink');
      pen.fillText(name, left, height - 6);
    }
  }

  /**
   * The shell at a place on the canvas, turned by `angle`, and the inner device that swings in it.
   * @param {Pen} pen @param {number} cx @param {number} cy @param {number} r @param {number} angle @param {number} swing @param {string} state
   */
  body(pen, cx, cy, r, angle, swing, state) {
    const safe = state === 'safe', colour = css(safe ? '--red' : '--blue');
    pen.lineWidth = Math.max(2, r * 0.06);
    pen.strokeStyle = colour;
    pen.fillStyle = css('--card');
    pen.globalAlpha = 0.9;
    pen.beginPath(); pen.arc(cx, cy, r, 0, 2 * Math.PI); pen.fill();
    pen.globalAlpha = 1;
    pen.stroke();
    pen.lineWidth = Math.max(1.5, r * 0.035);
    for (let spoke = 0; spoke < 6; spoke++) { // marks on the shell that turn with it
      const a = angle + spoke * Math.PI / 3;
      pen.beginPath();
      pen.moveTo(cx + Math.cos(a) * r * (spoke ? 0.88 : 0.7), cy + Math.sin(a) * r * (spoke ? 0.88 : 0.7));
      pen.lineTo(cx + Math.cos(a) * r * 0.97, cy + Math.sin(a) * r * 0.97);
      pen.stroke();
    }
    // the inner device hangs below the middle and swings by swing_angle; its drive wheel runs in the shell
    pen.save();
    pen.translate(cx, cy);
    pen.rotate(-swing);
    pen.fillStyle = css('--teal');
    pen.strokeStyle = css('--teal');
    pen.beginPath(); pen.moveTo(0, 0); pen.lineTo(0, r * 0.6); pen.lineWidth = Math.max(2, r * 0.05); pen.stroke();
    pen.beginPath(); pen.roundRect(-r * 0.32, r * 0.28, r * 0.64, r * 0.3, r * 0.08); pen.fill();
    pen.fillStyle = css('--ink');
    pen.beginPath(); pen.arc(0, r * 0.72, r * 0.225, 0, 2 * Math.PI); pen.fill();
    pen.restore();
    pen.fillStyle = css('--ink');
    pen.beginPath(); pen.arc(cx, cy, Math.max(2, r * 0.05), 0, 2 * Math.PI); pen.fill();
  }

  /**
   * Speed, slip and sinkage beside the robot.
   * @param {Pen} pen @param {number} cx @param {number} cy @param {number} r @param {(name: string) => number | null} value
   */
  says(pen, cx, cy, r, value) {
    pen.fillStyle = css('--ink');
    pen.font = '600 13px system-ui, sans-serif';
    const slip = value('slip'), sinkage = value('sinkage');
    const lines = [`${fixed(value('speed'), 3)}${unit('m/s')}`, slip === null ? '' : `slip ${fixed(slip, 3)}`, sinkage !== null && sinkage > 1e-6 ? `sinkage ${fixed(sinkage * 1e3, 1)} mm (drawn ${DEEPER} ×)` : ''];
    lines.filter(Boolean).forEach((text, i) => pen.fillText(text, cx + r + 16, cy - r * 0.4 + 17 * i));
    pen.font = '12px system-ui, sans-serif';
  }
}
