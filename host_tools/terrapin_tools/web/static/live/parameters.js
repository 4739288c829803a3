// The controller's parameters: value, range, default; what differs from the default is marked; a change is written at once.
import { h, number } from '../app.js';

export class Parameters {
  /** @param {LiveDesk} desk */
  constructor(desk) {
    this.desk = desk;
    /** @type {ParameterLine[]} */
    this.known = [];
    this.filter = h('input', { type: 'text', placeholder: 'part of a name', 'aria-label': 'Filter parameters', oninput: () => { this.list(); } });
    this.read = h('button', { type: 'button', text: 'Read all', onclick: () => this.load() });
    this.keep = h('button', { type: 'button', text: 'Keep in flash', disabled: true, onclick: () => this.write({ do: 'save' }) });
    this.body = h('tbody');
    this.said = h('p', { class: 'soft small', text: 'Read what the controller is set to. Written values hold until its next reset, unless kept in flash; they are refused while the bridge is on.' });
    this.table = h('div', { class: 'signal-table', tabindex: '0', role: 'region', 'aria-label': 'Parameters', hidden: true }, h('table', {},
      h('thead', {}, h('tr', {}, ...['Parameter', 'Value', 'Unit', 'Range', 'Default', 'Meaning'].map((t) => h('th', { scope: 'col', text: t })))), this.body));
    this.element = h('section', { class: 'panel signals', hidden: true }, h('div', { class: 'panel-head' }, h('h2', { text: 'Parameters' }),
      h('div', { class: 'choices' }, this.filter, this.read, this.keep)), this.said, this.table);
  }

  /** Another source, or none. @param {Hello} said */
  begin(said) {
    this.element.hidden = !said.drive;
    this.known = [];
    this.table.hidden = this.keep.disabled = true;
  }

  async load() {
    const { app, run } = this.desk;
    this.read.disabled = true;
    const found = await run(() => app.api('live/parameters'));
    this.read.disabled = false;
    if (!found) return;
    app.showCommand(found.command);
    this.known = found.parameters;
    this.table.hidden = this.keep.disabled = false;
    this.list();
  }

  list() {
    const part = this.filter.value.trim().toLowerCase(), shown = this.known.filter((p) => p.name.includes(part));
    const changed = this.known.filter((p) => p.value !== p.default).map((p) => p.name);
    if (this.known.length) this.said.textContent = `${this.known.length} parameters; ${changed.length ? `not at their default: ${changed.join(', ')}` : 'all at their defaults'}.`;
    this.body.replaceChildren(...shown.map((p) => {
      const value = h('input', { type: 'text', class: 'short', value: p.text, 'aria-label': `${p.name}${p.unit ? ` in ${p.unit}` : ''}`, onchange: () => { void this.set(p, value); } });
      return h('tr', { class: p.value === p.default ? null : 'changed' }, h('th', { scope: 'row', text: p.name }), h('td', {}, value), h('td', { class: 'soft', text: p.unit }),
        h('td', { class: 'soft n', text: `${number(p.low)} to ${number(p.high)}` }), h('td', { class: 'soft n', text: number(p.default, 6) }), h('td', { class: 'soft', text: p.meaning }));
    }));
  }

  /** @param {ParameterLine} parameter @param {HTMLInputElement} input */
  async set(parameter, input) {
    const value = Number(input.value.replace(',', '.'));
    if (!input.value.trim() || !Number.isFinite(value)) { input.setAttribute('aria-invalid', 'true'); this.desk.tell(`${parameter.name}: found “${input.value}”, expected a number${parameter.unit ? ` in ${parameter.unit}` : ''}`); return; }
    if (await this.write({ name: parameter.name, value })) await this.load(); else input.setAttribute('aria-invalid', 'true');
  }

  /** @param {object} body */
  async write(body) {
    const { app, run } = this.desk;
    const answer = await run(() => app.api('live/parameters', { body }));
    if (answer) { app.announce(answer.done); app.showCommand(answer.command); }
    return answer;
  }
}
