// One case: verdict, plots, ranking, ladder, and what can be done with it.
import { Plot, Ladder } from './plot.js';
import { CasePlots } from './case_plots.js';
import { ranking } from './cards.js';

const WORDS = { compare: 'Comparing', discover: 'Looking for what is missing', add: 'Adding', remove: 'Removing', report: 'Writing the report', export: 'Exporting', experiment: 'Running the experiment' };

export class CasePage {
  constructor(element, app, name) {
    Object.assign(this, { element, app, name, view: null, preview: null, picked: null, jobs: new Map(), closed: false });
    this.path = `cases/${encodeURIComponent(name)}`;
    this.build();
  }

  build() {
    const { h } = this.app;
    this.top = h('div');
    this.jobBar = h('div', { class: 'job', role: 'status', hidden: true });
    this.plots = new CasePlots(this.app, () => this.draw());
    this.ladderHost = h('div');
    this.ladder = new Ladder(this.ladderHost);
    this.side = h('div', { class: 'side' });
    this.below = h('div', { class: 'below' });
    this.problem = h('div', { role: 'alert' });
    this.ladderPanel = h('section', { class: 'panel' },
      h('div', { class: 'panel-head' }, h('h2', { text: 'Error ladder' }), h('span', { text: 'noise sd' }),
        h('span', { class: 'key train' }, h('i', { class: 'box' }), 'training'),
        h('span', { class: 'key held' }, h('i', { class: 'box' }), 'held out')),
      this.ladderHost);
    this.grid = h('div', { class: 'case-grid', hidden: true },
      h('div', { class: 'plots' }, this.plots.overlayPanel, h('div', { class: 'pair' }, this.plots.residualPanel, this.ladderPanel)),
      this.side);
    this.element.replaceChildren(this.top, this.problem, this.jobBar, this.grid, this.below);
    this.top.replaceChildren(h('p', { class: 'soft', role: 'status', text: 'Comparing model and measurements…' }));
  }

  show() {
    this.app.showCommand(`terrapin compare ${this.name}`);
    this.load();
    this.resume();
  }

  close() { this.closed = true; }
  redraw() { if (this.view) this.draw(); }

  /** Fetch what the server knows and draw it. */
  async load() {
    const turn = (this.turn = (this.turn || 0) + 1);
    try {
      const view = await this.app.api(`${this.path}/view`);
      if (this.closed || turn !== this.turn) return;
      this.take(view);
    } catch (error) {
      if (this.closed || turn !== this.turn) return;
      this.complain(error);
      if (!this.view) this.top.replaceChildren(this.back());
    }
  }

  take(view) {
    const { app } = this;
    const before = this.view;
    this.view = view;
    const sets = view.cards.map((card) => card.effect);
    if (this.preview && !this.preview.effects.every((name) => sets.includes(name))) this.preview = null;
    this.grid.hidden = false;
    app.context(view.title);
    this.plots.take(view);
    this.lead();
    this.renderSide();
    this.renderBelow();
    this.draw();
    if (!before || before.headline !== view.headline) app.announce(`${view.chip}. ${view.headline}`);
    if (view.discovered && !before?.discovered && view.missing.length) this.showPreview(view.missing, true);
  }

  back() {
    const { h } = this.app;
    return h('p', {}, h('a', { href: '#workbench', text: 'All cases' }));
  }

  complain(error) {
    const { h } = this.app;
    if (!error) { this.problem.replaceChildren(); return; }
    this.problem.replaceChildren(h('p', { class: 'notice bad', text: error.message || String(error) }));
  }

  // ---------------------------------------------------------------- the verdict

  lead() {
    const { h } = this.app, { view } = this;
    const where = view.where.map((one) => h('li', {}, h('button', {
      type: 'button', title: 'Show the residual against it', onclick: () => this.plots.choose(one.variable, one.channel),
    }, h('b', { text: one.variable }), ` ${one.text}`)));
    const main = view.next.do;
    this.top.replaceChildren(h('div', { class: 'lead' },
      h('div', {},
        h('p', { class: 'headline', text: view.headline })),
      h('div', { class: 'actions' },
        h('span', { class: `chip ${view.verdict}`, text: view.chip }),
        h('button', { type: 'button', text: 'Compare', onclick: () => this.run({ do: 'compare' }) }),
        h('button', { type: 'button', class: main === 'discover' ? 'main' : '', text: 'Discover', onclick: () => this.run({ do: 'discover' }) }),
        h('button', { type: 'button', text: 'Report', onclick: () => this.run({ do: 'report' }) }),
        h('a', { href: '#workbench', class: 'small', text: 'All cases' })),
      h('ul', { class: 'facts' }, where.slice(0, 3), h('li', { text: `${view.runs} runs, ${view.held_out.length} held out · ${[view.base, ...view.effects].join(' + ')}` }))));
  }

  // ---------------------------------------------------------------- right side

  renderSide() {
    this.side.replaceChildren(...ranking(this));
  }

  renderBelow() {}

  draw() {
    this.plots.draw(this.preview);
    const { view, preview } = this;
    const ghost = preview?.channels ? { added: preview.effects.join(' + '), train_error: preview.train_error, heldout_error: preview.heldout_error } : null;
    this.ladder.show(view.plot.ladder, ghost);
  }

  /** Fetch and show what the model would predict with effects added; a second time: hide it. */
  async showPreview(effects, quietly = false) {
    const same = this.preview && this.preview.effects.join() === effects.join();
    this.preview = same ? null : { effects };
    this.mark();
    if (same) { this.draw(); return; }
    const wanted = this.preview;
    try {
      const query = effects.map((name) => `effect=${encodeURIComponent(name)}`).join('&');
      const found = await this.app.api(`${this.path}/view?${query}`);
      if (this.preview !== wanted || this.closed) return;
      this.preview = found;
      this.draw();
      if (!quietly) this.app.announce(`With ${effects.join(' and ')} the held-out error would be ${this.app.number(found.heldout_error ?? found.train_error, 3)} noise sd.`);
      this.app.showCommand(`terrapin add ${this.name} ${effects.join(' ')}`);
    } catch (error) {
      if (this.preview !== wanted) return;
      this.preview = null;
      this.mark();
      if (!quietly) this.complain(error);
    }
  }

  mark() {
    const chosen = this.preview ? this.preview.effects.join('+') : '';
    for (const card of this.side.querySelectorAll('[data-effects]')) {
      const on = card.dataset.effects === chosen;
      card.classList.toggle('shown', on);
      card.querySelector('[aria-pressed]')?.setAttribute('aria-pressed', String(on));
    }
  }

  // ---------------------------------------------------------------- jobs

  async run(body) {
    this.complain(null);
    try {
      const result = await this.app.job(this.name, body, (job) => this.progress(job));
      if (body.do === 'add' || body.do === 'remove') {
        this.preview = null;
        if (result?.ladder) { this.view.plot.ladder = result.ladder; this.draw(); } // falls at once; the rest follows
      }
      return result;
    } catch (error) {
      this.complain(error);
      return null;
    } finally {
      if (!this.closed) await this.load();
    }
  }

  /** Jobs of this case that run already (after a reload, or from another browser). */
  async resume() {
    try {
      for (const job of await this.app.api('jobs')) if (job.case === this.name) this.progress(job);
    } catch { /* the view says what is wrong */ }
  }

  progress(job) {
    const { h } = this.app;
    if (['queued', 'running'].includes(job.state)) this.jobs.set(job.id, job); else this.jobs.delete(job.id);
    const [first] = this.jobs.values();
    this.jobBar.hidden = !first;
    if (!first) return;
    const line = first.progress?.length ? first.progress[first.progress.length - 1] : '';
    this.jobBar.replaceChildren(h('progress', { 'aria-label': WORDS[first.do] || first.do }),
      h('strong', { text: `${WORDS[first.do] || first.do}${first.state === 'queued' ? ' (waiting)' : ''}` }),
      h('span', { class: 'line soft', text: line }),
      h('button', { type: 'button', text: 'Cancel', onclick: () => this.app.cancel(first.id).catch((error) => this.complain(error)) }));
  }

  async event(event) {
    if (event.case !== this.name && !event.back) return;
    if (event.job !== undefined) {
      try { this.progress(await this.app.api(`jobs/${encodeURIComponent(event.job)}`)); } catch { this.jobs.delete(event.job); }
    } else { this.load(); }
    if (event.back) this.resume();
  }
}
