// The Workbench tab: list of cases, and a case. What it shows comes from the server, so a reload loses nothing and two
// browsers show the same; what is chosen to look at (variable, channel, preview) is this browser's own.
import { h, lineOf } from './app.js';
import { CasePage } from './case_page.js';
import { Mapper } from './mapper.js';
import { thumbnail } from './plots/thumbnail.js';

/** @param {HTMLElement} element @param {App} app @returns {Tab} */
export function mount(element, app) { return new Workbench(element, app); }

const EXAMPLE = 'heated_motor'; // whose fit fails in the picture
const notice = (/** @type {string} */ text) => h('p', { class: 'notice bad', role: 'alert', text });

class Workbench {
  /** @param {HTMLElement} element @param {App} app */
  constructor(element, app) {
    this.element = element;
    this.app = app;
    /** @type {CasePage | null} */
    this.page = null; // the case that is open
    /** @type {Mapper | null} */
    this.mapper = null;
    this.before = ''; // command line that made the case that is opened next
    app.onEvent((event) => this.event(event));
  }

  async list() {
    const { app } = this;
    this.page?.close();
    this.page = null;
    app.context();
    const place = h('div', { class: 'start' });
    const cases = h('section', { class: 'panel cases', 'aria-label': 'Cases in this workspace' });
    const examples = h('section', { class: 'panel', 'aria-label': 'Examples' });
    this.mapper ??= new Mapper(app, (name) => app.go('workbench', name)); // what is being mapped stays while one looks elsewhere
    place.append(h('div', {}, this.mapper.element, cases), examples);
    this.element.replaceChildren(this.purpose(), place);
    app.showCommand(this.mapper.command || `terrapin compare ${app.place('cases')}`);
    await Promise.all([this.fillCases(cases), this.fillExamples(examples)]);
  }

  /** What this is for, in two sentences and a picture; three steps. */
  purpose() {
    const picture = h('figure', { class: 'hero' });
    const section = h('section', { class: 'panel purpose' }, h('div', {},
      h('h1', { text: 'Does your model of the ground hold, and if not, what does it lack?' }),
      h('p', { text: 'Terrapin compares a model with your measurements, says whether anything is missing beyond the noise, names the effect that explains it, and shows how far the error falls once it is added. What it finds goes back into the controller of the robot, which you can try and drive here without one.' }),
      h('ol', { class: 'three' },
        h('li', {}, 'Open an example, or drop a table of your own below.'),
        h('li', {}, 'See where the model fails, and press ', h('b', { text: 'Discover' }), '.'),
        h('li', {}, 'Add what is missing; ', h('b', { text: '↶' }), ' (Ctrl-Z) takes it back.')),
      h('p', { class: 'row' }, h('a', { class: 'button', href: '#live/robot:floor', text: 'Drive a robot in simulation' }), h('a', { class: 'button', href: '#simulate', text: 'Run a scenario' }))), picture);
    void this.picture(EXAMPLE, 320, 150).then((drawn) => {
      if (drawn) picture.append(drawn, h('figcaption', { class: 'soft small' }, 'A fit that fails: ', h('span', { class: 'measured', text: 'measured' }), ' current of a motor that warms, and ', h('span', { class: 'predicted', text: 'the model' }), ' that does not know it.'));
    });
    return section;
  }

  /** A small picture of an example; null where there is none. @param {string} name @param {number} width @param {number} height */
  async picture(name, width, height) {
    try { return thumbnail(await this.app.api(`examples/${encodeURIComponent(name)}/picture`), width, height); } catch { return null; }
  }

  /** @param {Element} section */
  async fillCases(section) {
    /** @type {CaseSummary[]} */
    let found;
    try { found = await this.app.api('cases'); } catch (error) { section.replaceChildren(notice(lineOf(error))); return; }
    const rows = found.map((one) => h('li', {},
      h('div', { class: 'grow' },
        h('a', { href: `#workbench/${encodeURIComponent(one.name)}`, text: one.title || one.name }),
        h('div', { class: one.error ? 'bad small' : 'soft small', text: one.error || facts(one) })),
      one.verdict ? h('span', { class: `chip small ${one.verdict}`, text: one.chip }) : null,
      h('button', { type: 'button', class: 'quiet', text: 'Delete', 'aria-label': `Delete ${one.name}`, onclick: () => this.remove(one.name, section) })));
    this.app.keepFocus(section, () => section.replaceChildren(h('h2', { text: 'Cases in this workspace' }),
      rows.length ? h('ul', { class: 'case-list' }, rows) : h('p', { class: 'soft', text: 'None yet: open an example, or drop measurements above.' })));
  }

  /** @param {Element} section */
  async fillExamples(section) {
    /** @type {Example[]} */
    let found;
    try { found = await this.app.api('examples'); } catch (error) { section.replaceChildren(notice(lineOf(error))); return; }
    section.replaceChildren(h('h2', { text: 'Examples' }),
      h('p', { class: 'soft small', text: 'Opened as a copy in the workspace; the example itself stays as it is.' }),
      h('ul', { class: 'case-list' }, found.map((one) => h('li', {}, this.small(one.name),
        h('div', { class: 'grow' }, h('div', { text: one.title }), h('div', { class: 'soft small', text: one.about }), h('div', { class: 'soft small', text: one.name })),
        h('button', { type: 'button', text: 'Open', 'aria-label': `Open the example ${one.name}`, onclick: (event) => this.openExample(one.name, event.target) })))));
  }

  /** Where the picture of an example comes. @param {string} name */
  small(name) {
    const place = h('span', { class: 'thumbnail-place' });
    void this.picture(name, 96, 54).then((drawn) => { if (drawn) place.append(drawn); });
    return place;
  }

  /** @param {string} name @param {HTMLButtonElement} button */
  async openExample(name, button) {
    const { app } = this;
    button.disabled = true;
    try {
      const made = await app.api(`examples/${encodeURIComponent(name)}`, { method: 'POST' });
      this.before = `terrapin case example ${name} --to ${app.place('cases', name)} && `;
      app.go('workbench', made.name);
    } catch (error) { button.disabled = false; button.after(notice(lineOf(error))); }
  }

  /** @param {string} name @param {Element} section */
  async remove(name, section) {
    const { app } = this;
    app.showCommand(`rm -r ${app.place('cases', name)} && rm -f ${app.place('reports', `${name}.html`)} ${app.place('exports', `${name}.toml`)}`);
    if (!confirm(`Delete the case ${name} with its measurements from the workspace?`)) return;
    try { await app.api(`cases/${encodeURIComponent(name)}`, { method: 'DELETE' }); } catch (error) { section.prepend(notice(lineOf(error))); return; }
    this.fillCases(section);
  }

  /** @param {News} event */
  event(event) {
    if (event.upload || event.back) this.mapper?.event(event);
    if (this.page) this.page.event(event);
    else if ((event.case || event.cases || event.back) && this.element.isConnected && !this.element.hidden) {
      const section = this.element.querySelector('.cases');
      if (section) this.fillCases(section);
    }
  }

  /** @param {string} rest name of the case; empty: the list of cases */
  show(rest) {
    if (!rest) { this.list(); return; }
    if (this.page?.name !== rest) {
      this.page?.close();
      this.page = new CasePage(this.element, this.app, rest, this.before);
      this.before = '';
    }
    this.page.show();
  }

  redraw() { this.page?.redraw(); }
}

/** @param {CaseSummary} one */
function facts(one) {
  const parts = [one.name, [one.base, ...(one.effects || [])].join(' + ')];
  if (one.runs) parts.push(`${one.runs} runs`);
  if (one.rows) parts.push(`${one.rows} rows`);
  return parts.join(' · ');
}
