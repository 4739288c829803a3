// The right side of a case: what is in the model, what may be missing, the next experiment, the controller.
import { h } from './app.js';

const FULL = 4; // candidates shown in full

/** What is in the model, and what may be missing. @param {CasePage} page @param {View} view */
export function ranking(page, view) {
  const parts = [];
  if (view.model.length) parts.push(h('section', { class: 'panel', 'aria-label': 'In the model' }, h('h2', { text: 'In the model' }), view.model.map((one) => inside(page, one))));
  if (!view.discovered || view.cards.length || view.missing.length > 1) parts.push(missing(page, view)); // a heading over nothing says nothing
  if (view.catalogue.length) parts.push(any(page, view));
  return parts;
}

/** Any effect of the catalogue, drawn or added whatever discover says. @param {CasePage} page @param {View} view */
function any(page, view) {
  const choice = h('select', { 'aria-label': 'Effect of the catalogue' }, view.catalogue.map((name) => h('option', { value: name, text: name })));
  return h('details', { class: 'panel fold' }, h('summary', {}, h('h2', { text: 'Any effect of the catalogue' })),
    h('div', { class: 'row' }, choice,
      h('button', { type: 'button', text: 'Draw it', title: 'Fitted and drawn over the model; nothing is changed', onclick: () => page.showPreview([choice.value]) }),
      h('button', { type: 'button', text: 'Add it', 'aria-label': 'Add it from the catalogue', onclick: () => page.run({ do: 'add', effects: [choice.value] }) })));
}

/** @param {string[]} texts */
const values = (texts) => h('div', { class: 'values small' }, texts.map((text) => h('span', { text })));

/** @param {CasePage} page @param {InModel} one */
function inside(page, one) {
  return h('article', { class: 'card inside' },
    h('div', { class: 'head' }, h('span', { class: 'name grow', text: one.effect }),
      one.own ? h('button', { type: 'button', class: 'act', text: 'Edit', 'aria-label': `Edit ${one.effect}`, onclick: () => one.own && page.own.edit(one.effect, one.own) }) : null,
      h('button', { type: 'button', class: 'act', text: 'Remove', 'aria-label': `Remove ${one.effect}`, onclick: () => page.run({ do: 'remove', effect: one.effect }) })),
    h('div', { class: 'eq', html: one.equation }), values(one.values));
}

/** @param {CasePage} page @param {View} view */
function missing(page, view) {
  const section = h('section', { class: 'panel', 'aria-label': view.heading }, h('h2', { text: view.heading }));
  if (!view.discovered) {
    section.append(h('p', { class: 'soft', text: view.next.text }));
    if (view.next.do === 'discover') section.append(h('button', { type: 'button', class: 'main', text: 'Discover', onclick: () => page.run({ do: 'discover' }) }));
    return section;
  }
  if (view.cards.length) section.append(h('p', { class: 'soft small', text: view.measure }));
  if (view.missing.length > 1) section.append(together(page, view.missing));
  const named = view.cards.filter((one) => one.named);
  const shown = [...named, ...view.cards.filter((one) => !one.named).slice(0, Math.max(0, FULL - named.length))];
  section.append(...shown.map((one) => card(page, one)));
  const rest = view.cards.filter((one) => !shown.includes(one));
  if (rest.length) section.append(h('details', {}, h('summary', { text: `${rest.length} less likely` }), rest.map((one) => card(page, one))));
  return section;
}

/** @param {CasePage} page @param {string[]} effects */
function together(page, effects) {
  return h('article', { class: 'card named', 'data-effects': effects.join('+') },
    h('div', { class: 'head' },
      h('button', { type: 'button', class: 'name grow', 'aria-pressed': 'false', text: effects.join(' + '), onclick: () => page.showPreview(effects) }),
      h('button', { type: 'button', class: 'act main', text: 'Add all', onclick: () => page.run({ do: 'add', effects }) })));
}

/** @param {CasePage} page @param {Card} one */
function card(page, one) {
  return h('article', { class: `card${one.named ? ' named' : ''}`, 'data-effects': one.effect },
    h('div', { class: 'head' },
      h('button', { type: 'button', class: 'name', 'aria-pressed': 'false', text: one.effect, title: 'Show what it would do', onclick: () => page.showPreview([one.effect]) }),
      h('progress', { class: 'bar', max: '1', value: one.probability, 'aria-label': `probability of ${one.effect}` }),
      h('span', { class: 'n', text: one.chance }),
      h('button', { type: 'button', class: 'act', text: 'Add', 'aria-label': `Add ${one.effect}`, onclick: () => page.run({ do: 'add', effects: [one.effect] }) })),
    h('div', { class: 'eq' }, h('span', { html: one.equation }), one.acts ? h('span', { class: 'soft small', text: one.acts }) : null),
    h('p', { text: one.reason }), values(one.values));
}
