// One case: verdict, plots, ranking, ladder, and what can be done with it.
import { lineOf } from './app.js';
import { ranking } from './cards.js';
import { Steps } from './case_edit.js';
import { CompareWith } from './compare_with.js';
import { CasePlots } from './plots/case_plots.js';
import { below, OwnEffect, nextStep, Controller } from './panels.js';
import { Ladder } from './plots/ladder.js';

/** @type {Record<string, string>} */
const WORDS = {
  compare: 'Comparing', discover: 'Looking for what is missing', add: 'Adding', remove: 'Removing',
  report: 'Writing the report', export: 'Exporting, and running the controller with it', experiment: 'Running the experiment',
  undo: 'Undoing', redo: 'Doing again', hold: 'Holding runs out', constant: 'Setting the constant',
};
const CHANGES = ['add', 'remove', 'undo', 'redo', 'hold', 'constant']; // after these an export is no longer the model's
const ACTIVE = ['queued', 'running'];

export class CasePage {
  /** @param {HTMLElement} element @param {App} app @param {string} name @param {string} before command line that made the case, up to `&& ` */
  constructor(element, app, name, before = '') {
    const { h } = app;
    this.element = element;
    this.app = app;
    this.name = name;
    this.before = before;
    /** @type {View | null} */
    this.view = null;
    /** @type {Preview | null} */
    this.preview = null;
    /** @type {Map<string, JobNews>} */
    this.jobs = new Map(); // that run
    this.closed = this.reported = false;
    this.drawing = 0; // jobs that have ended and are not drawn yet
    this.turn = 0;
    this.path = `cases/${encodeURIComponent(name)}`;
    this.folder = app.place('cases', name); // for a shell
    /** @type {string[]} */
    this.after = []; // what may have the focus next, by name, when what had it is gone
    this.own = new OwnEffect(this);
    this.steps = new Steps(this);
    this.compareWith = new CompareWith(this);
    this.controller = new Controller(this);
    this.top = h('div');
    this.jobBar = h('div', { class: 'job', role: 'status', hidden: true });
    this.plots = new CasePlots(() => { this.compareWith.check(); this.draw(); if (this.view) this.below.replaceChildren(...below(this, this.view)); });
    this.plots.ask = (part, asked, signal) => {
      const query = new URLSearchParams({ ...asked, residual: String(asked.residual), left: String(part.x[0]), right: String(part.x[1]), bottom: String(part.y[0]), top: String(part.y[1]), draft: String(!this.view) });
      return app.api(`${this.path}/rows?${query}`, { signal });
    };
    this.ladderHost = h('div');
    this.ladder = new Ladder(this.ladderHost);
    this.side = h('div', { class: 'side' });
    this.below = h('div', { class: 'below' });
    this.problem = h('div', { role: 'alert' });
    this.said = h('div', { role: 'status' });
    const ladder = h('section', { class: 'panel', 'aria-label': 'Error ladder' },
      h('div', { class: 'panel-head' }, h('h2', { text: 'Error ladder' }), h('span', { text: 'noise sd' }),
        h('span', { class: 'key train' }, h('i', { class: 'box' }), 'training'),
        h('span', { class: 'key held' }, h('i', { class: 'box' }), 'held out'),
        h('span', { class: 'key floor' }, h('i', { class: 'dashed' }), '1.0')),
      this.ladderHost);
    this.grid = h('div', { class: 'case-grid', hidden: true },
      h('div', { class: 'plots' }, this.compareWith.element, this.plots.overlayPanel, this.plots.besidePanel, h('div', { class: 'pair' }, this.plots.residualPanel, ladder)),
      this.side);
    this.element.replaceChildren(this.top, this.problem, this.said, this.jobBar, this.grid, this.below);
    this.top.replaceChildren(h('p', { class: 'soft', role: 'status', text: 'Comparing model and measurements…' }));
  }

  show() {
    this.head();
    if (!this.view) this.app.showCommand(`${this.before}terrapin compare ${this.folder}`);
    this.load();
    this.resume();
  }

  close() { this.closed = true; this.own.close(); this.steps.close(); }
  redraw() { if (this.view) this.draw(); }

  /** Fetch what the server knows and draw it. */
  async load() {
    const turn = ++this.turn;
    void this.steps.ask();
    if (!this.view) await this.sketch(); // the plot first: the verdict takes the same processors
    if (this.closed || turn !== this.turn) return;
    try {
      const view = await this.app.api(`${this.path}/view`);
      if (!this.closed && turn === this.turn) this.take(view);
    } catch (error) {
      if (this.closed || turn !== this.turn) return;
      this.complain(error);
      if (this.view) return;
      this.grid.hidden = true; // no numbers, no picture
      this.top.replaceChildren(this.app.h('div', { class: 'lead' }, this.app.h('div', { class: 'actions' }, this.steps.element))); // the way back
    }
  }

  /** The plot before the verdict, which takes longer on many rows. */
  async sketch() {
    const { h } = this.app;
    let found;
    try { found = await this.app.api(`${this.path}/view?draft=true`); } catch { return; } // the view says what is wrong
    if (this.view || this.closed) return;
    this.grid.hidden = false;
    this.plots.take(found);
    this.plots.draw(null);
    this.app.context(h('a', { href: '#workbench', text: 'Cases' }), ' / ', h('b', { text: found.title }));
    this.side.replaceChildren(h('section', { class: 'panel' }, h('p', { class: 'soft', text: 'Estimating the noise, and whether anything is missing…' })));
  }

  /** Show what the server knows. @param {View} view */
  take(view) {
    const before = this.view;
    this.view = view;
    const known = [...view.cards.map((card) => card.effect), ...view.catalogue];
    if (this.preview && !this.preview.effects.every((name) => known.includes(name))) this.preview = null;
    if (before && JSON.stringify(before) === JSON.stringify(view)) return;
    this.grid.hidden = false;
    this.app.keepFocus(this.element, () => { // moving an element takes the focus from it, and from who types in it
      this.plots.take(view);
      this.head();
      this.lead();
      this.side.replaceChildren(...ranking(this, view), ...nextStep(this, view), this.own.element, this.controller.element);
      this.own.take(view);
      this.controller.take(view);
      void this.compareWith.take(view);
      this.below.replaceChildren(...below(this, view));
    }, this.after);
    this.mark();
    this.draw();
    if (!before || before.headline !== view.headline) this.app.announce(`${view.chip}. ${view.headline}`);
    if (view.discovered && !before?.discovered && view.missing.length) this.showPreview(view.missing, true);
  }

  /** What went wrong; null: nothing does any more. @param {unknown} error */
  complain(error) {
    const { h } = this.app;
    this.problem.replaceChildren(...(error ? [h('p', { class: 'notice bad', text: lineOf(error) })] : []));
  }

  /** A line that stays until the next action: elements or text. @param {(string | Node)[]} parts */
  say(...parts) {
    this.said.replaceChildren(...(parts.length ? [this.app.h('p', { class: 'notice fine' }, ...parts)] : []));
  }

  // ---------------------------------------------------------------- the verdict

  head() {
    const { h } = this.app, { view } = this;
    this.app.context(h('a', { href: '#workbench', text: 'Cases' }), ' / ', h('b', { text: view?.title || this.name }),
      view ? ` · ${view.runs} runs, ${view.held_out.length} held out · ${[view.base, ...view.effects].join(' + ')}` : '');
  }

  lead() {
    const { h } = this.app, { view } = this;
    if (!view) return;
    const where = view.where.map((one) => h('li', {}, h('button', {
      type: 'button', title: 'Show the residual against it', onclick: () => this.plots.choose(one.variable, one.channel),
    }, h('b', { text: one.variable }), ` ${one.text}`)));
    const main = view.next.do;
    this.top.replaceChildren(h('div', { class: 'lead' },
      h('div', { class: 'row' }, h('span', { class: `chip ${view.verdict}`, text: view.chip }), h('h1', { class: 'headline grow', text: view.headline })),
      h('div', { class: 'actions' },
        main === 'add' ? h('button', { type: 'button', class: 'main', text: `Add ${view.missing.join(' + ')}`, onclick: () => this.run({ do: 'add', effects: view.missing }) }) : null,
        this.steps.element,
        h('button', { type: 'button', text: 'Compare', title: 'Compare model and measurements again', onclick: () => this.compare() }),
        h('button', { type: 'button', class: main === 'discover' ? 'main' : '', text: 'Discover', onclick: () => this.run({ do: 'discover' }) }),
        h('button', { type: 'button', text: 'Report', onclick: () => this.report() }),
        this.reported ? h('a', { class: 'small', href: `/api/${this.path}/report`, target: '_blank', rel: 'noopener', text: 'Last report' }) : null),
      h('ul', { class: 'facts' }, where, view.remarks.map((text) => h('li', { text })))));
  }

  draw() {
    const { view, preview } = this;
    if (!view) return;
    this.plots.draw(preview);
    const inside = view.plot.ladder.slice(0, 1 + view.effects.length); // what discover found is not in the model yet
    this.ladder.show(inside, preview?.channels ? { added: preview.effects.join(' + '), train_error: preview.train_error ?? 0, heldout_error: preview.heldout_error ?? null } : null);
  }

  /**
   * Fetch and show what the model would predict with effects added; a second time: hide it. `own`: the formula of the one.
   * @param {string[]} effects @param {OwnFormula | null} own
   */
  async showPreview(effects, quietly = false, own = null) {
    const same = !own && this.preview && this.preview.effects.join() === effects.join();
    this.preview = same ? null : { effects };
    this.mark();
    this.draw();
    if (same) return;
    const wanted = this.preview;
    if (!quietly && !own) this.app.showCommand(`terrapin add ${this.folder} ${effects.join(' ')}`);
    this.complain(null);
    try {
      const query = effects.map((name) => `effect=${encodeURIComponent(name)}`).join('&');
      /** @type {Preview} */
      const found = await (own ? this.app.api(`${this.path}/draw`, { body: { effect: effects[0], ...own } }) : this.app.api(`${this.path}/view?${query}`));
      if (this.preview !== wanted || this.closed) return;
      this.preview = found;
      this.draw();
      if (!quietly) this.app.announce(`With ${effects.join(' and ')} the held-out error would be ${this.app.number(found.heldout_error ?? found.train_error, 3)} noise sd.`);
    } catch (error) {
      if (this.preview !== wanted || this.closed) return;
      this.preview = null;
      this.mark();
      if (!quietly) this.complain(error);
    }
  }

  mark() {
    const chosen = this.preview ? this.preview.effects.join('+') : '';
    for (const card of /** @type {NodeListOf<HTMLElement>} */ (this.side.querySelectorAll('[data-effects]'))) {
      const on = card.dataset.effects === chosen;
      card.classList.toggle('shown', on);
      card.querySelector('[aria-pressed]')?.setAttribute('aria-pressed', String(on));
    }
  }

  // ---------------------------------------------------------------- what can be done

  /**
   * Run a command as a job; its result, or null when it failed or was cancelled (which the page then says).
   * @param {{ do: string, effect?: string, effects?: string[], [option: string]: any }} body
   */
  async run(body) {
    this.complain(null);
    this.say();
    this.after = body.do === 'undo' ? ['Undo', 'Redo'] : body.do === 'redo' ? ['Redo', 'Undo'] : body.do === 'add' ? [`Remove ${body.effects?.[0]}`] : body.do === 'remove' ? [`Add ${body.effect}`, 'Discover'] : [];
    try {
      const result = await this.app.job(this.name, body, (job) => this.progress(job));
      if (this.closed) return result;
      if (body.do === 'add' || body.do === 'remove') this.fall(body, result);
      return result;
    } catch (error) {
      if (!this.closed) this.complain(error);
      return null;
    } finally {
      this.drawing += 1; // what it has come to is compared and drawn: until then the bar stays
      this.bar();
      if (!this.closed) await this.load();
      this.drawing -= 1;
      this.bar();
    }
  }

  async compare() {
    const before = JSON.stringify(this.view);
    if (await this.run({ do: 'compare' }) && JSON.stringify(this.view) === before) this.say('Compared again: nothing in the case has changed, the answer is as before.');
  }

  /**
   * The ladder moves as soon as the command has answered; the rest of the page follows.
   * @param {{ do: string, effect?: string, effects?: string[] }} body @param {{ ladder: Rung[], model: { effects: string[] } }} result
   */
  fall(body, result) {
    this.preview = null;
    if (!this.view) return;
    this.view.plot.ladder = result.ladder;
    this.view.effects = result.model.effects;
    this.draw();
    const last = result.ladder[result.ladder.length - 1], n = this.app.number;
    this.app.announce(`${body.do === 'add' ? 'Added' : 'Removed'} ${(body.effects || [body.effect]).join(', ')}: held-out error ${n(last.heldout_error ?? last.train_error, 3)} noise sd.`);
  }

  async report() {
    if (!await this.run({ do: 'report' })) return;
    this.reported = true;
    this.app.keepFocus(this.top, () => this.lead());
    this.reportLink();
  }

  reportLink() {
    const { h } = this.app;
    this.say('The report is written: ', h('a', { href: `/api/${this.path}/report`, target: '_blank', rel: 'noopener', text: 'open it' }), ', or ',
      h('a', { href: `/api/${this.path}/report`, download: `${this.name}.html`, text: 'save it' }), '.');
  }

  /** Jobs of this case that run (after a reload, or from another browser), and what the last export said. */
  async resume() {
    /** @type {Job[]} */
    let jobs;
    try { jobs = await this.app.api('jobs'); } catch { return; } // the view says what is wrong
    if (this.closed) return;
    const mine = jobs.filter((job) => job.case === this.name);
    for (const id of this.jobs.keys()) if (!mine.some((job) => job.id === id)) this.progress({ id, state: 'failed' }); // gone
    for (const job of mine) if (ACTIVE.includes(job.state) || this.jobs.has(job.id)) this.progress(job); // ended while we were away
    const last = mine.find((job) => ['export', ...CHANGES].includes(job.do) && job.state === 'done'); // newest first
    if (last?.do === 'export') this.controller.restore(last.id);
    this.reported = mine.some((job) => job.do === 'report' && job.state === 'done');
    if (this.view) this.app.keepFocus(this.top, () => this.lead());
  }

  /** @param {JobNews} job */
  progress(job) {
    if (job.state && ACTIVE.includes(job.state)) this.jobs.set(job.id, job); else this.jobs.delete(job.id);
    this.bar();
  }

  /** The first job that runs, with what it says; or that what it came to is being drawn. */
  bar() {
    const { h } = this.app, [first] = this.jobs.values();
    if (this.closed) return;
    this.app.keepFocus(this.element, () => { this.jobBar.hidden = !first && !this.drawing; }, this.after);
    if (!first) {
      this.jobBar.replaceChildren(...(this.drawing ? [h('progress', { 'aria-label': 'Drawing' }), h('strong', { text: 'Comparing, and drawing it' })] : []));
      return;
    }
    const line = first.progress?.length ? first.progress[first.progress.length - 1] : '';
    const doing = WORDS[first.do || ''] || first.do;
    this.app.keepFocus(this.jobBar, () => this.jobBar.replaceChildren(h('progress', { 'aria-label': doing }),
      h('strong', { text: `${doing}${first.state === 'queued' ? ' (waiting)' : ''}` }),
      h('span', { class: 'line soft', text: line }),
      h('button', { type: 'button', text: 'Cancel', onclick: () => this.app.cancel(first.id).catch((error) => this.complain(error)) })));
  }

  /** @param {News} event */
  async event(event) {
    if (event.back) { this.load(); this.resume(); return; }
    if (event.case !== this.name) return;
    if (event.deleted) { this.app.go('workbench'); return; }
    if (event.job === undefined) { this.load(); return; }
    if (event.state === 'done' && CHANGES.includes(event.do || '')) this.controller.result.replaceChildren();
    const state = /** @type {JobState | undefined} */ (event.state);
    if (state && !ACTIVE.includes(state)) { this.progress({ id: event.job, state }); return; }
    const known = this.jobs.get(event.job) || { id: event.job, progress: [] };
    this.progress({ ...known, ...event, state: state ?? known.state, id: event.job, progress: event.line ? [event.line] : known.progress });
  }
}
