// Which runs carry the residual, and where.
import { h, number } from './basics.js';

/**
 * Mean residual by run and range of a variable, as a table with coloured cells; a run's name picks its rows out.
 * @param {PlotData} plot @param {string} title @param {string} variable @param {string} channel @param {(run: number) => void} pick
 */
export function heat(plot, title, variable, channel, pick) {
  const one = plot.heat.columns[variable];
  if (!one) return null;
  const bins = one.mean[channel][0].length;
  /** @param {number} v */
  const short = (v) => number(v, 3);
  /** @param {number} i */
  const name = (i) => (one.single ? short(one.edges[i]) : `${short(one.edges[i])} to ${short(one.edges[i + 1])}`);
  const size = Math.max(3, ...one.mean[channel].flat().filter((v) => v !== null).map(Math.abs));
  /** @param {number | null} value @param {number} i @param {number} count */
  const cell = (value, i, count) => {
    const td = h('td', { text: value === null ? '' : number(value, 2), title: `${name(i)}: ${count} rows` });
    if (value !== null) td.style.background = `color-mix(in srgb, var(${value > 0 ? '--red' : '--blue'}) ${Math.round(45 * Math.min(1, Math.abs(value) / size))}%, transparent)`;
    return td;
  };
  const rows = plot.heat.runs.map((run, r) => h('tr', {}, h('th', { scope: 'row' }, h('button', { type: 'button', title: 'Pick its rows out', text: `${plot.runs[run]}${plot.held[run] ? ' ◇' : ''}`, onclick: () => pick(run) })), one.mean[channel][r].map((value, i) => cell(value, i, one.count[r][i]))));
  return h('section', { class: 'panel heat' }, h('div', { class: 'panel-head' }, h('h2', { text: title }), h('span', { text: `mean residual of ${channel} in noise sd, by ${variable}; ◇ held out` })),
    h('div', { class: 'scroll wide', tabindex: '0', role: 'region', 'aria-label': 'Residual by run' }, h('table', {}, h('thead', {}, h('tr', {}, h('th', { text: 'run' }), Array.from({ length: bins }, (_, i) => h('th', { scope: 'col', text: name(i) })))), h('tbody', {}, rows))));
}
