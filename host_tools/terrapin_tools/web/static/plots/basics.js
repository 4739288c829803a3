// Elements, numbers and colours: what the plots need, on the page and in a report.

/**
 * An element: h('button', { class: 'x', onclick: f, text: 'Add' }, child, ...). Text is never read as HTML.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag @param {Properties} properties @param {Child[]} children @returns {HTMLElementTagNameMap[K]}
 */
export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (key === 'text') element.textContent = value;
    else if (key === 'html') element.innerHTML = value; // only what the server itself has typeset (MathML, notes)
    else if (key.startsWith('on')) element.addEventListener(key.slice(2), value);
    else if (key === 'value' || key === 'checked' || key === 'disabled' || key === 'selected') Object.assign(element, { [key]: value });
    else element.setAttribute(key, value === true ? '' : value);
  }
  const parts = /** @type {(Node | string | null | undefined | false)[]} */ (children.flat());
  element.append(...parts.filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** Four digits, as short as they go; a dash for what is not there. @param {number | null | undefined} value */
export function number(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  const short = Number(value.toPrecision(digits));
  const text = short !== 0 && Math.abs(short) < 1e-4 ? short.toExponential() : String(short);
  return text.replaceAll('-', '−');
}

/** As many decimals as the quantity is worth, so that noise is no number. @param {number | null | undefined} value @param {number} decimals */
export function fixed(value, decimals) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  const text = value.toFixed(decimals);
  return (Number(text) === 0 ? text.replace('-', '') : text).replace('-', '−');
}

const PREFIXED = ['N', 'V', 'A', 'W', 'J', 'Pa', 'm', 's', 'Hz', 'H', 'F', 'ohm'];
/** @type {Record<string, string>} */
const PREFIXES = { '-9': 'n', '-6': 'µ', '-3': 'm', 3: 'k', 6: 'M', 9: 'G' };

/**
 * A quantity with its unit, very small or large by a prefix of it: 12.06 mN m; with two digits of its sd, where there is
 * one, and as many of its own: 170.1 ± 5.3 mN m. As `amount` of workbench/story/sentences.py has it.
 * @param {number | null | undefined} value @param {string} text of the unit
 */
export function quantity(value, text, sd = 0, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  const size = Math.max(Math.abs(value), sd), prefixed = PREFIXED.includes(text.split(/[ /]/)[0]);
  const power = !size || !prefixed || (size >= 0.1 && size < 1e4) ? 0 : 3 * Math.floor(Math.log10(size) / 3);
  const prefix = PREFIXES[power] ?? '', scale = prefix ? 10 ** -power : 1;
  const places = sd > 0 ? Math.min(9, Math.max(0, 1 - Math.floor(Math.log10(sd * scale)))) : 0;
  return `${sd > 0 ? `${fixed(value * scale, places)} ± ${fixed(sd * scale, places)}` : number(value * scale, digits)}${prefix ? ` ${prefix}${text}` : unit(text)}`;
}

/** A unit to stand behind a number; nothing for a plain number. @param {string | null | undefined} text */
export const unit = (text) => (text && text !== '1' ? ` ${text}` : '');

/** A colour of the style sheet. @param {string} name */
export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
export const still = () => matchMedia('(prefers-reduced-motion: reduce)').matches;

/** Have an element say a text, in the text node that it has: what is told many times a second makes nothing anew. @param {Element} element @param {string} text */
export function told(element, text) {
  const { firstChild } = element;
  if (!(firstChild instanceof Text) || firstChild.nextSibling || !text) { if (element.textContent !== text) element.textContent = text; } else if (firstChild.data !== text) firstChild.data = text;
}
