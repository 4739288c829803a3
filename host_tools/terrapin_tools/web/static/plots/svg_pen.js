// What a plot draws on a canvas, as SVG text: the part of a canvas's context that the plots use.
/** @param {string} text */
const escaped = (text) => text.replaceAll('&', '&amp;').replaceAll('<', '&lt;').replaceAll('>', '&gt;');
/** @param {number} v */
const short = (v) => String(Number(v.toFixed(2)));
/** @type {Record<string, string>} */
const ANCHOR = { left: 'start', center: 'middle', right: 'end' };
/** @type {Record<string, number>} */
const DOWN = { top: 0.8, middle: 0.32, bottom: -0.2, alphabetic: 0 }; // of the font's size
const STATE = ['fillStyle', 'strokeStyle', 'lineWidth', 'globalAlpha', 'font', 'textAlign', 'textBaseline', 'dash', 'move', 'clipId'];

/** Draw on it as on a CanvasRenderingContext2D, then ask for text(). */
export class SvgPen {
  /** @param {number} width @param {number} height [px] */
  constructor(width, height) {
    this.size = [width, height];
    this.fillStyle = this.strokeStyle = '#000';
    this.lineWidth = this.globalAlpha = 1;
    this.lineJoin = 'round';
    this.font = '12px sans-serif';
    this.textAlign = 'left';
    this.textBaseline = 'alphabetic';
    this.dash = '';
    this.move = '';
    this.clipId = '';
    this.clips = 0;
    /** @type {any[]} */
    this.stack = [];
    /** @type {string[]} */
    this.path = [];
    /** @type {string[]} */
    this.parts = [];
  }

  save() { this.stack.push(Object.fromEntries(STATE.map((key) => [key, /** @type {any} */ (this)[key]]))); }
  restore() { Object.assign(this, this.stack.pop()); }
  /** @param {number} x @param {number} y */
  translate(x, y) { this.move += `translate(${short(x)} ${short(y)})`; }
  /** @param {number} angle */
  rotate(angle) { this.move += `rotate(${short((angle * 180) / Math.PI)})`; }
  /** @param {number[]} list */
  setLineDash(list) { this.dash = list.join(' '); }
  beginPath() { this.path = []; }
  closePath() { this.path.push('Z'); }
  /** @param {number} x @param {number} y */
  moveTo(x, y) { this.path.push(`M${short(x)} ${short(y)}`); }
  /** @param {number} x @param {number} y */
  lineTo(x, y) { this.path.push(`L${short(x)} ${short(y)}`); }
  /** A whole circle. @param {number} x @param {number} y @param {number} r */
  arc(x, y, r) { this.path.push(`M${short(x - r)} ${short(y)}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`); }
  /** @param {number} x @param {number} y @param {number} w @param {number} h */
  rect(x, y, w, h) { this.path.push(`M${short(x)} ${short(y)}h${short(w)}v${short(h)}h${short(-w)}Z`); }
  clip() {
    this.clipId = `clip${++this.clips}`;
    this.parts.push(`<clipPath id="${this.clipId}"><path d="${this.path.join('')}"/></clipPath>`);
  }
  /** Attributes that every mark has. */
  common() {
    return (this.move ? ` transform="${this.move}"` : '') + (this.globalAlpha < 1 ? ` opacity="${short(this.globalAlpha)}"` : '')
      + (this.clipId ? ` clip-path="url(#${this.clipId})"` : '');
  }
  fill() { this.parts.push(`<path d="${this.path.join('')}" fill="${this.fillStyle}"${this.common()}/>`); }
  stroke() {
    this.parts.push(`<path d="${this.path.join('')}" fill="none" stroke="${this.strokeStyle}" stroke-width="${this.lineWidth}"`
      + `${this.dash ? ` stroke-dasharray="${this.dash}"` : ''} stroke-linejoin="round"${this.common()}/>`);
  }
  /** @param {number} x @param {number} y @param {number} w @param {number} h */
  fillRect(x, y, w, h) { this.beginPath(); this.rect(x, y, w, h); this.fill(); }
  /** @param {string} text @param {number} x @param {number} y */
  fillText(text, x, y) {
    const size = parseFloat(this.font) || 12;
    this.parts.push(`<text x="${short(x)}" y="${short(y + size * DOWN[this.textBaseline])}" font-size="${size}" text-anchor="${ANCHOR[this.textAlign]}" fill="${this.fillStyle}"${this.common()}>${escaped(text)}</text>`);
  }

  /** The picture. */
  text() {
    const [width, height] = this.size;
    return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}" font-family="Helvetica, Arial, sans-serif">\n${this.parts.join('\n')}\n</svg>\n`;
  }
}
