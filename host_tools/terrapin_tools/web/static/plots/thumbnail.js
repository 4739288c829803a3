// A small picture of a case: measured points, and what the model says, over one column. No axes: it is a picture to choose by.
import { h } from './basics.js';

/** @param {Thumbnail} picture @param {number} width @param {number} height */
export function thumbnail(picture, width, height) {
  const { x, measured, predicted } = picture, pad = 4, made = 'http://www.w3.org/2000/svg';
  /** @param {number[]} values @param {number} from @param {number} to */
  const scale = (values, from, to) => {
    const low = Math.min(...values), span = Math.max(...values) - low || 1;
    return (/** @type {number} */ value) => (from + (value - low) / span * (to - from)).toFixed(1);
  };
  const X = scale(x.values, pad, width - pad), Y = scale([...measured, ...predicted], height - pad, pad);
  const svg = document.createElementNS(made, 'svg');
  for (const [name, value] of Object.entries({ viewBox: `0 0 ${width} ${height}`, class: 'thumbnail', role: 'img', 'aria-label': `${picture.y.name} over ${x.name}: measured, and as the model has it` })) svg.setAttribute(name, value);
  measured.forEach((value, i) => {
    for (const [y, kind] of /** @type {[number, string][]} */ ([[value, 'measured'], [predicted[i], 'predicted']])) {
      const dot = document.createElementNS(made, 'circle');
      for (const [name, text] of Object.entries({ cx: X(x.values[i]), cy: Y(y), r: kind === 'measured' ? '2' : '1.6', class: kind })) dot.setAttribute(name, text);
      svg.append(dot);
    }
  });
  return h('span', { class: 'thumbnail-box' }, svg);
}
