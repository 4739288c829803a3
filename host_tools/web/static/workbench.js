// The Workbench tab: list of cases, and a case. What it shows comes from the server, so a reload loses nothing and two
// browsers show the same; what is chosen to look at (variable, channel, preview) is this browser's own.
import { CasePage } from './case_page.js';
import { Mapper } from './mapper.js';

export function mount(element, app) {
  const { h } = app;
  let page = null; // the case that is open
  let mapper = null;
  let before = ''; // command line that made the case that is opened next

  async function list() {
    page?.close();
    page = null;
    app.context();
    const place = h('div', { class: 'start' });
    const cases = h('section', { class: 'panel cases', 'aria-label': 'Cases in this workspace' });
    const examples = h('section', { class: 'panel', 'aria-label': 'Examples' });
    mapper ??= new Mapper(app, (name) => app.go('workbench', name)); // what is being mapped stays while one looks elsewhere
    place.append(h('div', {}, mapper.element, cases), examples);
    element.replaceChildren(h('h1', { class: 'visually-hidden', text: 'Workbench' }), place);
    app.showCommand(mapper.command || `terrapin compare ${app.place('cases')}`);
    await Promise.all([fillCases(cases), fillExamples(examples)]);
  }

  async function fillCases(section) {
    let found;
    try { found = await app.api('cases'); } catch (error) { section.replaceChildren(notice(error.message)); return; }
    const rows = found.map((one) => h('li', {},
      h('div', { class: 'grow' },
        h('a', { href: `#workbench/${encodeURIComponent(one.name)}`, text: one.title || one.name }),
        h('div', { class: one.error ? 'bad small' : 'soft small', text: one.error || facts(one) })),
      one.verdict ? h('span', { class: `chip small ${one.verdict}`, text: VERDICTS[one.verdict] || one.verdict }) : null,
      h('button', { type: 'button', class: 'quiet', text: 'Delete', 'aria-label': `Delete ${one.name}`, onclick: () => remove(one.name, section) })));
    app.keepFocus(section, () => section.replaceChildren(h('h2', { text: 'Cases in this workspace' }),
      rows.length ? h('ul', { class: 'case-list' }, rows) : h('p', { class: 'soft', text: 'None yet: open an example, or drop measurements above.' })));
  }

  async function fillExamples(section) {
    let found;
    try { found = await app.api('examples'); } catch (error) { section.replaceChildren(notice(error.message)); return; }
    section.replaceChildren(h('h2', { text: 'Examples' }),
      h('p', { class: 'soft small', text: 'Opened as a copy in the workspace; the example itself stays as it is.' }),
      h('ul', { class: 'case-list' }, found.map((one) => h('li', {},
        h('div', { class: 'grow' }, h('div', { text: one.title }), h('div', { class: 'soft small', text: one.name })),
        h('button', { type: 'button', text: 'Open', 'aria-label': `Open the example ${one.name}`, onclick: (event) => openExample(one.name, event.target) })))));
  }

  async function openExample(name, button) {
    button.disabled = true;
    try {
      const made = await app.api(`examples/${encodeURIComponent(name)}`, { method: 'POST' });
      before = `terrapin case --example ${name} --to ${app.place('cases', name)} && `;
      app.go('workbench', made.name);
    } catch (error) { button.disabled = false; button.after(notice(error.message)); }
  }

  async function remove(name, section) {
    app.showCommand(`rm -r ${app.place('cases', name)} && rm -f ${app.place('reports', `${name}.html`)} ${app.place('exports', `${name}.toml`)}`);
    if (!confirm(`Delete the case ${name} with its measurements from the workspace?`)) return;
    try { await app.api(`cases/${encodeURIComponent(name)}`, { method: 'DELETE' }); } catch (error) { section.prepend(notice(error.message)); return; }
    fillCases(section);
  }

  const notice = (text) => h('p', { class: 'notice bad', role: 'alert', text });

  app.onEvent((event) => {
    if (event.upload || event.back) mapper?.event(event);
    if (page) page.event(event);
    else if ((event.case || event.cases || event.back) && element.isConnected && !element.hidden) {
      const section = element.querySelector('.cases');
      if (section) fillCases(section);
    }
  });

  return {
    show(rest) {
      if (!rest) { list(); return; }
      if (page?.name !== rest) {
        page?.close();
        page = new CasePage(element, app, rest, before);
        before = '';
      }
      page.show();
    },
    redraw() { page?.redraw(); },
  };
}

const VERDICTS = { adequate: 'adequate', missing: 'something is missing', ambiguous: 'cannot tell', unexplained: 'unexplained' };

function facts(one) {
  const parts = [one.name, [one.base, ...(one.effects || [])].join(' + ')];
  if (one.runs) parts.push(`${one.runs} runs`);
  if (one.rows) parts.push(`${one.rows} rows`);
  return parts.join(' · ');
}
