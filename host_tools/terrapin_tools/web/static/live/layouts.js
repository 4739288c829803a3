// Layouts that are kept by name in this browser: which signals are drawn, and over how many seconds.
import { h } from '../app.js';

/** @typedef {{ signals: string[], seconds: number }} Layout */

const KEY = 'terrapin-live-layouts';

export class Layouts {
  /** @param {() => Layout} now what is shown @param {(layout: Layout) => void} show */
  constructor(now, show) {
    this.now = now;
    this.show = show;
    /** @type {Record<string, Layout>} */
    this.kept = JSON.parse(localStorage.getItem(KEY) || '{}');
    this.choice = h('select', { 'aria-label': 'Layout', onchange: () => this.chosen() });
    this.name = h('input', { type: 'text', class: 'short', maxlength: '30', placeholder: 'name', 'aria-label': 'Name of the layout' });
    this.drop = h('button', { type: 'button', text: 'Drop', title: 'Forget this layout', 'aria-label': 'Drop the layout', onclick: () => this.keep(this.choice.value, null) });
    this.element = h('span', { class: 'row layouts' }, this.choice, this.drop, this.name,
      h('button', { type: 'button', text: 'Keep', title: 'Keep these signals and seconds under this name', 'aria-label': 'Keep the layout', onclick: () => this.keep(this.name.value.trim() || 'mine', this.now()) }));
    this.list('');
  }

  /** @param {string} chosen */
  list(chosen) {
    this.choice.replaceChildren(h('option', { value: '', text: 'layout …' }), ...Object.keys(this.kept).sort().map((name) => h('option', { value: name, text: name, selected: name === chosen })));
    this.drop.hidden = !chosen;
  }

  chosen() {
    const layout = this.kept[this.choice.value];
    this.drop.hidden = !layout;
    if (layout) this.show(layout);
  }

  /** @param {string} name @param {Layout | null} layout null: forget it */
  keep(name, layout) {
    if (layout) this.kept[name] = layout; else delete this.kept[name];
    localStorage.setItem(KEY, JSON.stringify(this.kept));
    this.name.value = '';
    this.list(layout ? name : '');
    this.choice.focus();
  }
}
