// The Simulate tab: a scenario with changes, run as a job; the robot rolling; the run kept as a case.
import { h } from './app.js';
import { Batches } from './simulate/batches.js';
import { Player } from './simulate/player.js';
import { Refusals } from './simulate/refusals.js';
import { RunList } from './simulate/run_list.js';
import { ScenarioForm } from './simulate/scenario_form.js';

/** @param {HTMLElement} element @param {App} app @returns {Tab} */
export function mount(element, app) {
  return new Simulate(element, app);
}

class Simulate {
  /** @param {HTMLElement} element @param {App} app */
  constructor(element, app) {
    this.app = app;
    /** @type {string | null} */
    this.job = null; // that is watched
    this.shown = this.opening = false;
    this.refusals = new Refusals();
    this.form = new ScenarioForm((command) => { this.batches.offer(this.form.scenario); if (this.shown && !this.opening) app.showCommand(command); });
    this.player = new Player();
    this.runs = new RunList({ app, refusals: this.refusals, open: (run) => this.open(run), watch: (job) => this.watch(job, null) });
    this.batches = new Batches({ app, body: () => this.form.body(), watch: (job, run) => this.watch(job, run) });
    this.start = h('button', { type: 'button', class: 'main', text: 'Run', onclick: () => this.go() });
    this.line = h('span', { class: 'line' });
    this.progress = h('progress', { max: '100', value: 0, 'aria-label': 'Progress' });
    this.bar = h('div', { class: 'job', hidden: true }, this.progress, this.line,
      h('button', { type: 'button', text: 'Cancel', onclick: () => { const { job } = this; if (job) this.refusals.attempt(() => app.cancel(job)); } }));
    this.other = h('select', { 'aria-label': 'Another run over this one', onchange: () => this.overlay() });
    element.append(h('h1', { class: 'visually-hidden', text: 'Simulate' }), h('div', { class: 'sim-grid' }, this.form.panel(this.start),
      h('div', { class: 'plots' }, this.refusals.element, this.bar, ...this.player.panels(this.other),
        h('div', { class: 'below' }, h('section', { class: 'panel' }, this.player.checksTitle, this.player.checks), this.runs.element), this.batches.element)));
    app.onEvent((event) => this.event(event));
  }

  async load() {
    /** @type {Scenarios | null} */
    const description = await this.refusals.look(() => this.app.api('scenarios'));
    if (description) this.form.take(description);
    if (this.player.run?.settings) this.form.choose(this.player.run.settings.name, this.player.run); // it was there first
  }

  // ---------------------------------------------------------------- running

  async go() {
    this.start.disabled = true;
    /** @type {(Started & { run: string }) | null} */
    const started = await this.refusals.attempt(() => this.app.api('simulate', { body: this.form.body() }));
    this.start.disabled = false;
    if (started) { this.app.showCommand(started.command); await this.watch(started.id, started.run, true); }
  }

  /** Follow a job to its end, then show its run, if there is one; `own`: of the form. @param {string} id @param {string | null} wanted */
  async watch(id, wanted, own = false) {
    const { app, bar, line, progress, start } = this;
    this.job = id;
    bar.hidden = false;
    start.disabled = true;
    progress.removeAttribute('value');
    line.textContent = 'waiting';
    const ended = await this.refusals.attempt(() => app.follow(id, (now) => {
      const last = now.progress[now.progress.length - 1] || now.state;
      line.textContent = last;
      const share = /(\d+) %/.exec(last);
      if (share) progress.value = Number(share[1]);
    }));
    this.job = null;
    bar.hidden = true;
    start.disabled = false;
    await this.runs.list();
    this.offer();
    if (!ended) return null;
    if (ended.state === 'failed') { this.refusals.say(ended.error || 'failed'); return null; }
    if (ended.state === 'cancelled') app.announce('cancelled');
    if (ended.state === 'done') app.announce('the run is done');
    if (wanted) await this.open(wanted, ended.state === 'done', own);
    return ended;
  }

  /** Show a run, with what it was done with in the form, unless it is the form's own: that may have been changed since. @param {string} wanted */
  async open(wanted, roll = true, own = false) {
    /** @type {Run | null} */
    const run = await this.refusals.attempt(() => this.app.api(`simulate/${encodeURIComponent(wanted)}/signals`));
    if (!run) return;
    this.player.other = null;
    this.player.open(run, roll);
    this.runs.open(run);
    this.opening = true; // the command that was shown is the run's
    if (run.settings && !own) this.form.choose(run.settings.name, run);
    this.opening = false;
    this.offer();
    if (this.shown) history.replaceState(null, '', `#simulate/${encodeURIComponent(wanted)}`); // a reload opens it again
  }

  /** Which other runs can be drawn over the one that is open. */
  offer() {
    const here = this.player.run?.name, kept = this.player.other?.name || '';
    this.other.replaceChildren(h('option', { value: '', text: 'no other run' }), ...this.runs.names.filter((name) => name !== here).map((name) => h('option', { value: name, text: `and ${name}`, selected: name === kept })));
    this.other.hidden = this.other.options.length < 2;
  }

  async overlay() {
    const wanted = this.other.value;
    /** @type {Run | null} */
    const run = wanted ? await this.refusals.attempt(() => this.app.api(`simulate/${encodeURIComponent(wanted)}/signals`)) : null;
    this.player.overlay(run);
  }

  /** What another browser runs, or this one before a reload. */
  async running() {
    /** @type {Job[] | null} */
    const jobs = await this.refusals.look(() => this.app.api('jobs'));
    if (jobs) this.batches.running(jobs);
    const mine = jobs?.find((one) => one.do === 'simulate' && (one.state === 'running' || one.state === 'queued'));
    if (mine && !this.job) this.watch(mine.id, /runs\/([^/ ]+)/.exec(mine.command.split('--out ')[1] || '')?.[1] || null);
  }

  /** @param {News} event */
  event(event) {
    if (!this.shown || this.job || this.start.disabled || !(event.back || event.do === 'simulate' || event.do === 'batch' || event.do === 'case')) return;
    if (event.state === 'running' || event.do === 'batch') this.running();
    else if (event.back || event.error !== undefined) this.runs.list();
  }

  // ---------------------------------------------------------------- the tab

  /** @param {string} rest name of a run; empty: the one that is open */
  show(rest) {
    this.shown = this.player.shown = true;
    if (!this.form.description) this.load();
    void this.runs.list().then(() => this.offer());
    this.batches.list();
    this.running();
    if (rest && this.player.run?.name !== rest) void this.open(rest, false);
    this.player.draw();
  }

  hide() {
    this.shown = this.player.shown = false;
    this.player.setPlaying(false);
  }

  redraw() {
    this.player.draw();
    this.player.strip.recolour();
  }
}
