// The overlay and the residual of a case: what is drawn of a view, and the choice of variable and channel.
import { css, h, number, unit } from './basics.js';
import { curve } from './painting.js';
import { Plot } from './plot.js';

/** Standard deviation. @param {number[]} values */
const spread = (values) => {
  const mean = values.reduce((a, v) => a + v, 0) / values.length;
  return Math.sqrt(values.reduce((a, v) => a + (v - mean) ** 2, 0) / values.length) || 1;
};

export class CasePlots {
  /** @param {() => void} changed another variable or channel was chosen */
  constructor(changed) {
    this.changed = changed;
    /** @type {Draft | null} */
    this.view = null;
    this.variable = this.channel = ''; // what is shown
    /** @type {{ variable?: string, channel?: string }} */
    this.picked = {}; // what the user chose; else the view says what matters most
    /** @type {number | null} */
    this.run = null; // whose rows are picked out
    const overlay = h('div', { class: 'tall' }), residual = h('div');
    this.overlay = new Plot(overlay, 'Model and measurement');
    this.residual = new Plot(residual, 'Residual');
    overlay.classList.add('tall');
    this.keys = h('span', { class: 'row' });
    this.choices = h('span', { class: 'choices' });
    this.axis = h('span', { class: 'axis' });
    this.range = h('span', { class: 'key fails' });
    this.picks = h('div', { class: 'soft small', role: 'status' });
    for (const plot of [this.overlay, this.residual]) plot.onselect = (rows) => this.pick(rows);
    this.overlayPanel = h('section', { class: 'panel' },
      h('div', { class: 'panel-head' }, h('h2', { text: 'Model and measurement' }), this.keys, this.choices, this.overlay.tools()), overlay, this.picks);
    overlay.append(this.axis); // the choice of variable stands where the name of the axis would
    this.residualPanel = h('section', { class: 'panel' },
      h('div', { class: 'panel-head' }, h('h2', { text: 'Residual' }), h('span', { text: 'shaded: 95 % of the noise' }), this.range,
        h('span', { class: 'choices' }, this.tableButton(), this.residual.tools())), residual);
  }

  /** Pick rows out in both plots; null: none. @param {number[] | null} rows */
  pick(rows) {
    const selected = rows ? new Set(rows) : null, plot = this.view?.plot;
    for (const one of [this.overlay, this.residual]) { one.selected = selected; one.redraw(); }
    this.run = null;
    this.picks.textContent = !rows || !plot ? ''
      : `${rows.length} rows picked out, of ${[...new Set(rows.map((i) => plot.runs[plot.run[i]]))].join(', ')}`;
  }

  /** Pick out the rows of a run, or none when they are already. @param {number} run */
  pickRun(run) {
    const again = this.run === run, plot = this.view?.plot;
    this.pick(again || !plot ? null : plot.run.flatMap((r, i) => (r === run ? [i] : [])));
    this.run = again ? null : run;
  }

  tableButton() {
    return h('button', {
      type: 'button', class: 'quiet', 'aria-pressed': 'false', text: 'Table', onclick: (event) => {
        const on = event.target.getAttribute('aria-pressed') !== 'true';
        event.target.setAttribute('aria-pressed', String(on));
        this.residual.showTable(on);
      },
    });
  }

  /** @param {Draft} view */
  take(view) {
    if (view.plot.run.length !== this.view?.plot.run.length) this.pick(null);
    this.view = view;
    const plot = view.plot;
    const { variable, channel } = this.picked;
    this.variable = variable && plot.columns[variable] ? variable : plot.variable;
    this.channel = channel && plot.channels.some((c) => c.name === channel) ? channel : plot.channels[0].name;
    /** @param {string} label @param {string[][]} names @param {string} chosen @param {(name: string) => void} set */
    const select = (label, names, chosen, set) => h('label', {}, `${label} `, h('select', { onchange: (event) => { set(event.target.value); this.changed(); } },
      names.map(([name, text]) => h('option', { value: name, selected: name === chosen, text }))));
    /** @param {string} name @param {{ unit: string }} one */
    const named = (name, one) => [name, one.unit && one.unit !== '1' ? `${name}, ${one.unit}` : name];
    this.axis.replaceChildren(select('against', Object.entries(plot.columns).map(([name, one]) => named(name, one)), this.variable, (v) => { this.variable = this.picked.variable = v; }));
    this.choices.replaceChildren(...(plot.channels.length > 1
      ? [select('channel', plot.channels.map((c) => named(c.name, c)), this.channel, (v) => { this.channel = this.picked.channel = v; })] : []));
  }

  /** Show the residual of a channel against a variable. @param {string} variable @param {string} channel */
  choose(variable, channel) {
    if (!this.view) return;
    const { plot } = this.view;
    if (plot.columns[variable]) this.picked.variable = variable;
    if (plot.channels.some((c) => c.name === channel)) this.picked.channel = channel;
    this.take(this.view);
    this.changed();
  }

  /** Both plots, with what is previewed. @param {Preview | null} preview */
  draw(preview) {
    if (!this.view) return;
    const { plot } = this.view;
    const c = plot.channels.find((one) => one.name === this.channel) || plot.channels[0], column = plot.columns[this.variable];
    const x = { values: column.values, name: this.variable, unit: column.unit, chosen: true };
    const known = c.noise_sd !== null, noise = c.noise_sd ?? 1; // not known before the case is judged
    /** @param {number[]} values */
    const along = (values) => curve(x.values, values, known ? noise : 0.05 * spread(c.measured), plot.run, plot.runs.length);
    const held = plot.run.map((r) => plot.held[r]);
    const rows = [held.flatMap((on, i) => (on ? [] : [i])), held.flatMap((on, i) => (on ? [i] : []))];
    const fails = plot.where.filter((w) => w.variable === this.variable && w.channel === this.channel);
    const predicted = along(c.predicted), added = preview?.channels?.[this.channel];
    /** @type {Line[]} */
    const lines = [];
    if (c.base) lines.push({ values: c.base, lines: along(c.base), color: css('--soft'), width: 1.6, dash: [3, 4] });
    lines.push({ values: c.predicted, lines: predicted, color: css('--blue'), width: 2.2 });
    if (added) lines.push({ values: added, lines: along(added), color: css('--teal'), width: 2.4 });
    /** @param {number[]} values @returns {Points[]} */
    const both = (values, extra = {}) => [
      { values, rows: rows[0], kind: 'dot', color: css('--ink'), ...extra },
      { values, rows: rows[1], kind: 'held', color: css('--ink'), ...extra },
    ];
    /** @param {number} i */
    const tell = (i) => `run ${plot.runs[plot.run[i]]}${held[i] ? ', held out' : ''}\n${this.variable} ${number(x.values[i])}${unit(x.unit)}\nmeasured ${number(c.measured[i])}${unit(c.unit)}\nmodel ${number(c.predicted[i])}${unit(c.unit)}`
      + (added ? `\nwith it ${number(added[i])}${unit(c.unit)}` : '') + `\nresidual ${number(left[i], 3)}${known ? ' noise sd' : unit(c.unit)}`;
    const left = c.measured.map((m, i) => (m - c.predicted[i]) / noise);
    const ranges = fails.map((w) => w.range);
    const span = fails.map((w) => [...new Set(w.range.map((v) => number(v)))].join(' to ')).join(', ');
    this.overlay.draw({
      x, y: { name: c.name, unit: c.unit }, points: both(c.measured), lines, ranges, describe: tell,
      bands: !known ? [] : [{ values: c.predicted, lines: predicted, half: 1.96 * noise, color: css('--band') },
        ...(added ? [{ values: added, lines: along(added), half: 1.96 * noise, color: css('--floor') }] : [])],
      table: () => this.table(plot, x, c, left),
      alt: `${c.name} measured and predicted against ${this.variable}, ${x.values.length} rows of ${plot.runs.length} runs.${span ? ` The model fails at ${span}${unit(x.unit)}.` : ''} Arrow keys step through the rows.`,
    });
    const after = added ? c.measured.map((m, i) => (m - added[i]) / noise) : null;
    this.residual.draw({
      x: { ...x, chosen: false }, y: { name: 'residual', unit: known ? 'noise sd' : c.unit }, ranges, lines: [], bands: [], level: known ? [-1.96, 1.96] : null, describe: tell,
      points: [...both(left), ...(after ? both(after, { color: css('--teal'), size: 2.4, alpha: 0.9 }) : [])],
      table: () => this.table(plot, x, c, left),
      alt: `Residual of ${c.name} in noise sd against ${this.variable}.${span ? ` It stands out at ${span}${unit(x.unit)}.` : ' It stands out nowhere.'} Arrow keys step through the rows.`,
    });
    this.range.textContent = span ? `fails ${span}${unit(x.unit)}` : '';
    this.legend(Boolean(c.base), added ? preview?.effects : undefined, fails.length);
  }

  /**
   * @param {PlotData} plot @param {Axis & { values: number[] }} x @param {PlotChannel} c @param {number[]} left
   * @returns {PlotTable}
   */
  table(plot, x, c, left) {
    /** @param {Axis} one */
    const name = (one) => (one.unit && one.unit !== '1' ? `${one.name}, ${one.unit}` : one.name);
    return {
      columns: ['run', name(x), `measured ${name(c)}`, 'model', 'residual'],
      rows: x.values.map((v, i) => [plot.runs[plot.run[i]], v, c.measured[i], c.predicted[i], left[i]]),
    };
  }

  /** @param {boolean} base @param {string[] | undefined} added effects that are previewed @param {number} fails */
  legend(base, added, fails) {
    /** @param {string} kind @param {string} mark @param {string} text */
    const key = (kind, mark, text) => h('span', { class: `key ${kind}` }, h('i', { class: mark }), text);
    this.keys.replaceChildren(...[
      key('', 'dot', 'training'), key('', 'ring', 'held out'),
      base ? key('base', 'dashed', 'base model') : null,
      key('model', '', `${base ? 'extended model' : 'base model'}, 95 % band`),
      added ? key('with', '', `with ${added.join(' + ')}`) : null,
      fails ? key('fails', 'box', 'fails here') : null,
    ].filter((one) => one !== null));
  }
}
