// The overlay and the residual of a case: what is drawn of a view, and the choice of variable and channel.
import { css, h, number, unit } from './basics.js';
import { curve, extent } from './painting.js';
import { Plot } from './plot.js';

const FAILS = 'fails here';
const SETTLED_MS = 80; // after the last step of a zoom, before its rows are asked for

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
    this.times = ''; // a column that the variable is multiplied by; none: ''
    /** @type {Other | null} */
    this.other = null; // another model, or case, that this one is held against
    this.apart = false; // beside it in the place of over it
    /** @type {{ variable?: string, channel?: string }} */
    this.picked = {}; // what the user chose; else the view says what matters most
    /** @type {number | null} */
    this.run = null; // whose rows are picked out
    /** @type {{ overlay: PlotSpec, residual: PlotSpec } | null} */
    this.whole = null; // what is drawn where nothing is refined
    /** @type {Set<number> | null} */
    this.chosen = null; // rows that are picked out, by their number; of another case drawn over this one below zero
    /** @type {Preview | null} */
    this.preview = null;
    /** @type {Set<string>} */
    this.hidden = new Set(); // what the legend has switched off
    /** @type {((part: Zoomed, asked: { variable: string, times: string, channel: string, residual: boolean }, signal: AbortSignal) => Promise<Refined>) | null} */
    this.ask = null; // where all rows are had from, of a plot that is thinned
    const overlay = h('div', { class: 'tall' }), residual = h('div');
    this.overlay = new Plot(overlay, 'Model and measurement');
    this.residual = new Plot(residual, 'Residual');
    overlay.classList.add('tall');
    this.keys = h('span', { class: 'row keys' });
    this.choices = h('span', { class: 'choices' });
    this.axis = h('span', { class: 'axis' });
    this.logs = this.overlay.logs(this.residual);
    this.range = h('span', { class: 'key fails' });
    this.picks = h('div');
    this.thinned = h('div');
    this.finer = [new Finer(this, this.overlay), new Finer(this, this.residual)];
    for (const one of this.finer) one.plot.onselect = (rows) => this.pick(rows, one);
    const besideOverlay = h('div'), besideResidual = h('div');
    this.beside = { overlay: new Plot(besideOverlay, 'Other model and measurement'), residual: new Plot(besideResidual, 'Its residual') };
    besideOverlay.classList.add('tall');
    this.besideName = h('h2');
    this.besidePanel = h('section', { class: 'panel beside', hidden: true }, h('div', { class: 'panel-head' }, this.besideName, h('span', { class: 'choices' }, this.beside.overlay.tools())), besideOverlay, besideResidual);
    this.overlayPanel = h('section', { class: 'panel' },
      h('div', { class: 'panel-head' }, h('h2', { text: 'Model and measurement' }), this.keys, this.choices, this.overlay.tools()), overlay, this.axis, h('div', { class: 'soft small', role: 'status' }, this.picks, this.thinned));
    this.residualPanel = h('section', { class: 'panel' },
      h('div', { class: 'panel-head' }, h('h2', { text: 'Residual' }), h('span', { text: 'shaded: 95 % of the noise' }), this.range,
        h('span', { class: 'choices' }, this.tableButton(), this.residual.tools())), residual);
  }

  /** Pick rows out in both plots; null: none. @param {number[] | null} rows as they are drawn in `one` @param {{ drawn: PlotData | null }} one */
  pick(rows, one = this.finer[0]) {
    const plot = one.drawn ?? this.view?.plot;
    this.chosen = rows && plot ? new Set(rows.map((i) => numberOf(plot, i))) : null;
    this.run = null;
    for (const other of this.finer) { this.mark(other); other.plot.redraw(); }
    this.picks.textContent = !rows || !plot ? ''
      : `${rows.length} rows picked out, of ${[...new Set(rows.map((i) => plot.runs[plot.run[i]] ?? this.other?.title))].join(', ')}`;
  }

  /** The rows that are picked out, as a plot draws them. @param {Finer} one */
  mark({ plot, drawn }) {
    const data = drawn ?? this.view?.plot, { chosen, run } = this;
    plot.selected = !chosen || !data ? null : new Set(plot.order.filter((i) => chosen.has(numberOf(data, i)) || (run !== null && data.run[i] === run)));
  }

  /** Pick out the rows of a run, or none when they are already. @param {number} run */
  pickRun(run) {
    const again = this.run === run, plot = this.view?.plot;
    this.pick(again || !plot ? null : plot.run.flatMap((r, i) => (r === run ? [i] : [])), { drawn: null });
    this.run = again ? null : run;
    for (const other of this.finer.filter((one) => one.drawn)) { this.mark(other); other.plot.redraw(); }
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
    const columns = Object.entries(plot.columns).map(([name, one]) => named(name, one));
    if (!plot.columns[this.times]) this.times = '';
    this.axis.replaceChildren(select('against', columns, this.variable, (v) => { this.variable = this.picked.variable = v; }),
      select(' ×', [['', '1'], ...columns], this.times, (v) => { this.times = v; }), ...this.logs);
    this.choices.replaceChildren(...(plot.channels.length > 1
      ? [select('channel', plot.channels.map((c) => named(c.name, c)), this.channel, (v) => { this.channel = this.picked.channel = v; })] : []));
  }

  /** Show the residual of a channel against a variable. @param {string} variable @param {string} channel */
  choose(variable, channel) {
    if (!this.view) return;
    const { plot } = this.view;
    if (plot.columns[variable]) { this.picked.variable = variable; this.times = ''; }
    if (plot.channels.some((c) => c.name === channel)) this.picked.channel = channel;
    this.take(this.view);
    this.changed();
  }

  /** Both plots, with what is previewed, and with the other model. @param {Preview | null} preview */
  draw(preview) {
    if (!this.view) return;
    const { plot } = this.view, { other } = this;
    this.preview = preview;
    /** @type {Extra[]} */
    const extras = [];
    if (preview?.channels) extras.push({ label: `with ${preview.effects.join(' + ')}`, channels: preview.channels, color: '--teal', band: '--floor' });
    const foreign = other?.plot && this.column(other.plot) && other.plot.channels.some((c) => c.name === this.channel) ? other.plot : null;
    if (other && !other.plot && !this.apart) extras.push({ label: other.title, channels: other.channels, color: '--violet' });
    const mine = this.specs(plot, extras), second = foreign ?? (other && !other.plot ? withChannels(plot, other.channels) : null);
    const its = second && (this.apart || foreign) ? this.specs(second, []) : null;
    if (its && other && foreign && !this.apart && !this.hidden.has(other.title)) over(mine, its, other.title, other.error);
    if (its && this.apart) {
      if (!other?.error) { alike(mine.overlay, its.overlay); alike(mine.residual, its.residual); }
      this.besideName.textContent = other?.title ?? '';
      this.besidePanel.hidden = false; // else its plots have no size to be drawn in
      this.besidePanel.parentElement?.classList.add('apart');
      this.beside.overlay.draw(its.overlay);
      this.beside.residual.draw(its.residual);
    }
    this.besidePanel.hidden = !(its && this.apart);
    this.besidePanel.parentElement?.classList.toggle('apart', !this.besidePanel.hidden);
    this.whole = mine;
    for (const one of this.finer) one.begin();
    this.range.textContent = mine.span ? `fails ${mine.span}` : '';
    const known = extras.map((one) => [one.label, one.color]);
    if (foreign && other && !this.apart) known.push([other.title, '--violet']);
    this.legend(mine.base, known, mine.span !== '');
  }

  /** What the plots are drawn over, of a case: a column, or the product of two; null where it has none of that name. @param {PlotData} plot */
  column(plot) {
    const one = plot.columns[this.variable], two = this.times ? plot.columns[this.times] : null;
    if (!one || (this.times && !two)) return null;
    if (!two) return { name: this.variable, unit: one.unit, values: one.values };
    const units = [one.unit, two.unit].filter((u) => u && u !== '1');
    return { name: `${this.variable} × ${this.times}`, unit: units.join(' · '), values: one.values.map((v, i) => v * two.values[i]) };
  }

  /** Overlay and residual of a model, with others drawn over it. @param {PlotData} plot @param {Extra[]} extras */
  specs(plot, extras) {
    const c = plot.channels.find((one) => one.name === this.channel) || plot.channels[0], column = this.column(plot);
    if (!column) throw new Error('a plot without its column');
    const x = { ...column, chosen: true };
    const known = c.noise_sd !== null, noise = c.noise_sd ?? 1; // not known before the case is judged
    /** @param {number[]} values */
    const along = (values) => curve(x.values, values, known ? noise : 0.05 * spread(c.measured), plot.run, plot.runs.length);
    const held = plot.run.map((r) => plot.held[r]);
    const rows = [held.flatMap((on, i) => (on ? [] : [i])), held.flatMap((on, i) => (on ? [i] : []))];
    const fails = this.times ? [] : plot.where.filter((w) => w.variable === this.variable && w.channel === this.channel);
    const predicted = along(c.predicted);
    const added = extras.flatMap((one) => (one.channels[this.channel] ? [{ ...one, values: one.channels[this.channel] }] : []));
    /** @type {Line[]} */
    const lines = [];
    const { hidden } = this;
    if (c.base && !hidden.has('base')) lines.push({ values: c.base, lines: along(c.base), color: css('--soft'), width: 1.6, dash: [3, 4] });
    if (!hidden.has('model')) lines.push({ values: c.predicted, lines: predicted, color: css('--blue'), width: 2.2 });
    for (const one of added) if (!hidden.has(one.label)) lines.push({ values: one.values, lines: along(one.values), color: css(one.color), width: 2.4 });
    /** @param {number[]} values @returns {Points[]} */
    const both = (values, extra = {}) => [
      { values, rows: hidden.has('training') ? [] : rows[0], kind: 'dot', color: css('--ink'), ...extra },
      { values, rows: hidden.has('held out') ? [] : rows[1], kind: 'held', color: css('--ink'), ...extra },
    ];
    const left = c.measured.map((m, i) => (m - c.predicted[i]) / noise);
    /** @param {number} i */
    const tell = (i) => `run ${plot.runs[plot.run[i]]}${held[i] ? ', held out' : ''}\n${x.name} ${number(x.values[i])}${unit(x.unit)}\nmeasured ${number(c.measured[i])}${unit(c.unit)}\nmodel ${number(c.predicted[i])}${unit(c.unit)}`
      + added.map((one) => `\n${one.label} ${number(one.values[i])}${unit(c.unit)}`).join('') + `\nresidual ${number(left[i], 3)}${known ? ' noise sd' : unit(c.unit)}`;
    const ranges = hidden.has(FAILS) ? [] : fails.map((w) => w.range);
    const spans = fails.map((w) => [...new Set(w.range.map((v) => number(v)))].join(' to ')).join(', ');
    const span = spans ? `${spans}${unit(x.unit)}` : '';
    const table = () => this.table(plot, x, c, left, known, added, held);
    /** @type {Key[]} */
    const marks = [
      ...(rows[0].length && !hidden.has('training') ? [{ text: 'measured', mark: /** @type {const} */ ('dot'), color: css('--ink') }] : []),
      ...(rows[1].length && !hidden.has('held out') ? [{ text: 'measured, held out', mark: /** @type {const} */ ('held'), color: css('--ink') }] : []),
    ];
    /** @type {Key[]} */
    const marked = ranges.length ? [{ text: 'the model fails', mark: 'box', color: css('--fail') }] : [];
    /** @type {Key[]} */
    const modelled = hidden.has('model') ? [] : [{ text: this.title(Boolean(c.base), known), mark: 'line', color: css('--blue') }];
    /** @type {PlotSpec} */
    const overlay = {
      keys: [...marks, ...(c.base && !hidden.has('base') ? [{ text: 'base model', mark: /** @type {const} */ ('dashed'), color: css('--soft') }] : []), ...modelled,
        ...added.filter((one) => !hidden.has(one.label)).map((one) => ({ text: one.label, mark: /** @type {const} */ ('line'), color: css(one.color) })), ...marked],
      x, y: { name: c.name, unit: c.unit }, points: both(c.measured), lines, ranges, describe: tell,
      bands: !known ? [] : [...(hidden.has('model') ? [] : [{ values: c.predicted, lines: predicted, half: 1.96 * noise, color: css('--band') }]),
        ...added.flatMap((one) => (one.band && !hidden.has(one.label) ? [{ values: one.values, lines: along(one.values), half: 1.96 * noise, color: css(one.band) }] : []))],
      table,
      alt: `${c.name} measured and predicted against ${x.name}, ${x.values.length} rows of ${plot.runs.length} runs.${span ? ` The model fails at ${span}.` : ''} Arrow keys step through the rows.`,
    };
    /** @type {PlotSpec} */
    const residual = {
      keys: [...marks, ...added.filter((one) => !hidden.has(one.label)).map((one) => ({ text: one.label, mark: /** @type {const} */ ('dot'), color: css(one.color) })),
        ...(known ? [{ text: '95 % of the noise', mark: /** @type {const} */ ('box'), color: css('--floor') }] : []), ...marked],
      x: { ...x, chosen: false }, y: { name: 'residual', unit: known ? 'noise sd' : c.unit }, ranges, lines: [], bands: [], level: known ? [-1.96, 1.96] : null, describe: tell,
      points: [...both(left), ...added.filter((one) => !hidden.has(one.label)).flatMap((one) => both(c.measured.map((m, i) => (m - one.values[i]) / noise), { color: css(one.color), size: 2.4, alpha: 0.9 }))],
      table,
      alt: `Residual of ${c.name} in noise sd against ${x.name}.${span ? ` It stands out at ${span}.` : ' It stands out nowhere.'} Arrow keys step through the rows.`,
    };
    return { overlay, residual, span, base: Boolean(c.base) };
  }

  /** What the line of the model is called. @param {boolean} extended @param {boolean} known whether its noise is */
  title(extended, known) { return `${extended ? 'extended model' : 'base model'}${known ? ', 95 % band' : ''}`; }

  /**
   * @param {PlotData} plot @param {Axis & { values: number[] }} x @param {PlotChannel} c @param {number[]} left @param {boolean} known whether the noise is
   * @param {{ label: string, values: number[] }[]} added @param {boolean[]} held @returns {PlotTable}
   */
  table(plot, x, c, left, known, added, held) {
    /** @param {Axis} one */
    const name = (one) => (one.unit && one.unit !== '1' ? `${one.name}, ${one.unit}` : one.name);
    return {
      columns: ['run', name(x), `measured ${name(c)}`, `model ${name(c)}`, name({ name: 'residual', unit: known ? 'noise sd' : c.unit }), 'held out', ...added.map((one) => `${one.label} ${name(c)}`)],
      rows: x.values.map((v, i) => [plot.runs[plot.run[i]], v, c.measured[i], c.predicted[i], left[i], held[i] ? 'yes' : 'no', ...added.map((one) => one.values[i])]),
    };
  }

  /** @param {boolean} base @param {string[][]} added label and colour of what is drawn over it @param {boolean} fails */
  legend(base, added, fails) {
    /** @param {string} kind @param {string} mark @param {string} text @param {string} name of what it switches */
    const key = (kind, mark, text, name = text) => h('button', {
      type: 'button', class: `key ${kind}`, 'aria-pressed': String(!this.hidden.has(name)), title: 'Show or hide it', onclick: () => {
        if (!this.hidden.delete(name)) this.hidden.add(name);
        this.draw(this.preview);
        /** @type {HTMLElement | undefined} */ ([.../** @type {Iterable<HTMLElement>} */ (this.keys.children)].find((one) => one.textContent === text))?.focus();
      },
    }, h('i', { class: mark }), text);
    this.keys.replaceChildren(...[
      key('', 'dot', 'training'), key('', 'ring', 'held out'),
      base ? key('base', 'dashed', 'base model', 'base') : null,
      key('model', '', this.title(base, true), 'model'),
      ...added.map(([text, color]) => key(color === '--violet' ? 'other' : 'with', '', text)),
      fails ? key('fails', 'box', FAILS) : null,
    ].filter((one) => one !== null));
  }
}

/** The number of a row that is drawn; of another case drawn over it below zero. @param {PlotData} plot @param {number} i */
const numberOf = (plot, i) => (i < plot.run.length ? plot.columns.row.values[i] : plot.run.length - i - 1);

/** A plot whose rows are thinned: zoomed, it asks for those of the part, and draws what it has until they come. */
class Finer {
  /** @param {CasePlots} plots @param {Plot} plot */
  constructor(plots, plot) {
    this.plots = plots;
    this.plot = plot;
    /** @type {PlotData | null} */
    this.drawn = null; // the part, as it was answered
    /** @type {Zoomed | null} */
    this.part = null;
    /** @type {AbortController | null} */
    this.asked = null;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    plot.onzoom = () => this.later();
  }

  /** Draw what there is, and ask for more where it is zoomed. */
  begin() {
    const { whole } = this.plots;
    if (!whole) return;
    this.drawn = null;
    this.show(whole);
    this.later();
  }

  /** @param {{ overlay: PlotSpec, residual: PlotSpec }} specs */
  show(specs) {
    const { plots, plot } = this;
    plot.draw(plot === plots.overlay ? specs.overlay : specs.residual);
    plots.mark(this);
    if (plot.selected) plot.redraw();
  }

  /** Whether what was answered holds all of a part. @param {Zoomed} view */
  holds({ x, y }) { return this.part !== null && x[0] >= this.part.x[0] && x[1] <= this.part.x[1] && y[0] >= this.part.y[0] && y[1] <= this.part.y[1]; }

  later() {
    const { plots, plot } = this, data = plots.view?.plot;
    this.asked?.abort();
    clearTimeout(this.timer);
    const thinned = data && data.kept < data.rows;
    this.say(thinned ? `${count(data.kept)} of ${count(data.rows)} rows are drawn, the worst of each stretch among them${plots.ask ? '; zoom in for more' : ''}.` : '');
    if (this.drawn && (!plot.view || !this.holds(plot.view))) { this.begin(); return; }
    if (!plot.view) return;
    if (thinned && plots.ask && !plots.preview && !plots.other) this.timer = setTimeout(() => { void this.refine(); }, SETTLED_MS);
  }

  async refine() {
    const { plots, plot } = this, { view } = plots, part = plot.view;
    if (!view || !part || !plots.ask) return;
    const residual = plot === plots.residual, asked = this.asked = new AbortController(), begin = performance.now();
    let found;
    try {
      found = await plots.ask(part, { variable: plots.variable, times: plots.times, channel: plots.channel, residual }, asked.signal);
    } catch (error) {
      if (!asked.signal.aborted) this.say(`Only the thinned rows are drawn: ${error instanceof Error ? error.message : error}`);
      return;
    }
    if (asked.signal.aborted || plots.view !== view) return;
    const whole = view.plot, channel = whole.channels.find((c) => c.name === plots.channel) ?? whole.channels[0];
    this.drawn = { ...whole, columns: found.columns, run: found.run, channels: [{ ...channel, ...found.channel }] };
    this.part = part;
    this.show(plots.specs(this.drawn, []));
    this.say(found.kept < found.rows ? `${count(found.kept)} of the ${count(found.rows)} rows in this part are drawn; zoom in for more.` : `All ${count(found.rows)} rows in this part are drawn.`);
    plot.host.dataset.refined = String(found.kept);
    plot.host.dataset.took = (performance.now() - begin + SETTLED_MS).toFixed(0); // ms from the zoom to the picture
  }

  /** @param {string} text */
  say(text) { this.plots.thinned.textContent = text; if (!this.drawn) delete this.plot.host.dataset.refined; }
}

/** @param {number} n */
const count = (n) => n.toLocaleString('en');

/** The same rows with what another model predicts. @param {PlotData} plot @param {Record<string, number[]>} channels @returns {PlotData} */
function withChannels(plot, channels) {
  return { ...plot, where: [], channels: plot.channels.map((c) => ({ ...c, base: null, predicted: channels[c.name] ?? c.predicted })) };
}

/** Both on the axes that show all of either. @param {PlotSpec} one @param {PlotSpec} two */
function alike(one, two) {
  const a = extent(one), b = extent(two);
  /** @param {number[]} p @param {number[]} q */
  const both = (p, q) => [Math.min(p[0], q[0]), Math.max(p[1], q[1])];
  one.frame = two.frame = { x: both(a.xs, b.xs), y: both(a.ys, b.ys) };
}

/**
 * Draw another case over one: its rows come behind the rows that are there, in its own colour.
 * @param {{ overlay: PlotSpec, residual: PlotSpec }} mine @param {{ overlay: PlotSpec, residual: PlotSpec }} its @param {string} title @param {string | undefined} apart why its values cannot lie on the same axes
 */
function over(mine, its, title, apart) {
  if (apart) return;
  for (const [one, two] of [[mine.overlay, its.overlay], [mine.residual, its.residual]]) {
    const first = one.x.values.length, { describe } = one, color = css('--violet');
    /** @param {number[]} values */
    const behind = (values) => [...Array.from({ length: first }, () => NaN), ...values];
    /** @param {number[]} rows */
    const moved = (rows) => rows.map((i) => i + first);
    one.x = { ...one.x, values: [...one.x.values, ...two.x.values] };
    one.points.push(...two.points.map((p) => ({ ...p, values: behind(p.values), rows: moved(p.rows), color, size: 2.6 })));
    const [model] = two.lines.slice(-1);
    if (model) one.lines.push({ ...model, values: behind(model.values), lines: (model.lines ?? two.x.values.map((_, i) => [i])).map(moved), color });
    one.describe = (row) => (row < first ? describe(row) : `${title}\n${two.describe(row - first)}`);
  }
}
