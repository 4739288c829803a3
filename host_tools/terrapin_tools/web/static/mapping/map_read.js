// How a table is to be read, where the file itself does not say it or says it wrong: the options of --read.
import { h } from '../app.js';

/** key -> what it is called, and its values where there are few @type {[string, string, string[]][]} */
const KEYS = [
  ['separator', 'separator', ['comma', 'semicolon', 'tab', 'bar']], ['decimal', 'decimal mark', ['point', 'comma']],
  ['names', 'line of the names', []], ['units', 'line of units (0: none)', []], ['dates', 'dates', ['day first', 'month first']],
  ['clock', 'clock times', ['h:m', 'm:s']], ['part', 'sheet, group or topic (*: all)', []], ['range', 'cells (A3:F90)', []],
  ['encoding', 'encoding', []], ['runs', 'runs (repeat, gap:SECONDS, trigger:COLUMN)', []],
];

export class Reading {
  /** @param {Record<string, string>} fields what was typed, by read_KEY @param {(reading: Record<string, string>) => void} again */
  constructor(fields, again) {
    /** @type {[string, HTMLInputElement | HTMLSelectElement][]} */
    this.inputs = KEYS.map(([key, , values]) => {
      const given = fields[`read_${key}`] ?? '';
      return [key, values.length ? h('select', {}, h('option', { value: '', text: 'as found' }), values.map((value) => h('option', { value, text: value, selected: value === given })))
        : h('input', { type: 'text', maxlength: '200', value: given, placeholder: 'as found', autocomplete: 'off', spellcheck: 'false' })];
    });
    this.element = h('details', { class: 'wide', open: Object.keys(this.said()).length > 0 }, h('summary', { text: 'Read it otherwise' }),
      h('div', { class: 'four' }, this.inputs.map(([, input], i) => h('label', {}, KEYS[i][1], input))),
      h('div', { class: 'row' }, h('button', { type: 'button', text: 'Read it again', onclick: () => again(this.said()) })));
  }

  /** What is not left to the file. */
  said() { return Object.fromEntries(this.inputs.flatMap(([key, input]) => (input.value.trim() ? [[key, input.value.trim()]] : []))); }

  /** What is typed, for the draft. */
  fields() { return Object.fromEntries(this.inputs.flatMap(([key, input]) => (input.value ? [[`read_${key}`, input.value]] : []))); }
}

/** For the address of a request. @param {Record<string, string>} reading */
export const asQuery = (reading) => Object.entries(reading).map(([key, value]) => `&read=${encodeURIComponent(`${key}=${value}`)}`).join('');

/** The readings between which a refusal asks to choose. @param {string} text @returns {Record<string, string>[]} */
export function choices(text) {
  const asked = text.split('say which it is with --read ')[1];
  return asked ? [...asked.matchAll(/(\w+)=('[^']*'|[^\s']+)/g)].map(([, key, value]) => ({ [key]: value.replaceAll("'", '') })) : [];
}
