// The frame of the page: token, requests, jobs, events, tabs, and the strip with the command line.
// Each tab is a module with `export function mount(element, app)`; it returns { show(rest), hide(), redraw() }, all
// optional. `rest` is what follows the tab's name in the address: #workbench/heated_motor -> "heated_motor".

import { stopEverywhere } from './live/everywhere.js';
import { css, fixed, h, number, quantity, still, told, unit } from './plots/basics.js';

export { css, fixed, h, number, quantity, still, told, unit };

const TABS = [
  { name: 'workbench', title: 'Workbench' },
  { name: 'simulate', title: 'Simulate' },
  { name: 'live', title: 'Live' },
];
const ENDED = ['done', 'failed', 'cancelled'];
const POLL_MS = 400;
/** An element of index.html. @param {string} id */
const $ = (id) => /** @type {HTMLElement} */ (document.getElementById(id));

// ---------------------------------------------------------------- small helpers, exported for the tabs

/** @param {Element} element */
const label = (element) => element.getAttribute('aria-label') || element.textContent.trim();
const CONTROLS = 'button:not(:disabled), a[href], select, input, summary, [tabindex="0"]';

/**
 * Draw anew inside `root`. Who had the focus there keeps it: on the control of the same name, else the first there is
 * of those named in `others`, else the heading.
 * @param {Element} root @param {() => void} draw @param {string[]} others
 */
export function keepFocus(root, draw, others = []) {
  const had = document.activeElement, inside = had !== null && had !== root && root.contains(had);
  const name = inside ? label(had) : '';
  draw();
  /** @param {Element} element */
  const seen = (element) => element.isConnected && element.getClientRects().length > 0 && !('disabled' in element && element.disabled);
  if (!inside || (document.activeElement === had && seen(had))) return;
  const controls = [...root.querySelectorAll(CONTROLS)].filter(seen);
  const next = seen(had) ? had : [name, ...others].map((text) => controls.find((one) => label(one) === text)).find(Boolean);
  focus(/** @type {HTMLElement | null} */ (next || root.querySelector('h1, h2')));
}

/** Put the focus on an element, whatever it is. @param {HTMLElement | null | undefined} element */
export function focus(element) {
  if (element && element.tabIndex < 0 && !element.matches(CONTROLS)) element.setAttribute('tabindex', '-1');
  element?.focus({ preventScroll: true });
}

/** A word for a shell, quoted where it must be. @param {string} text */
export const quote = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", `'"'"'`)}'`);

/** What an error says. @param {unknown} error */
export const lineOf = (error) => (error instanceof Error ? error.message : String(error));

/** For screen readers: what has just happened. @param {string} text */
export function announce(text) {
  $('announce').textContent = '';
  requestAnimationFrame(() => { $('announce').textContent = text; });
}

// ---------------------------------------------------------------- token and requests

function takeToken() {
  const address = new URL(location.href);
  const given = address.searchParams.get('token');
  if (given) {
    sessionStorage.setItem('terrapin-token', given);
    address.searchParams.delete('token');
    history.replaceState(null, '', address.pathname + address.search + address.hash);
  }
  return sessionStorage.getItem('terrapin-token'); // none after a new tab: the cookie does it then
}
const token = takeToken();

/** What the server answered, as an Error whose message is its line. */
export class Refused extends Error {
  /** @param {number} status @param {string} message */
  constructor(status, message) { super(message); this.status = status; }
}

/** JSON from /api. Throws Refused. @param {string} path @param {Asked} options @returns {Promise<any>} */
export async function api(path, options = {}) {
  const headers = { ...options.headers };
  if (token) headers.Authorization = `Bearer ${token}`;
  const given = options.body;
  if (given !== undefined && !(given instanceof Blob)) headers['Content-Type'] = 'application/json';
  const body = given === undefined || given instanceof Blob ? given : JSON.stringify(given);
  let answer;
  try {
    answer = await fetch(`/api/${path.replace(/^\/?(api\/)?/, '')}`, {
      method: options.method || (body === undefined ? 'GET' : 'POST'), headers, body, signal: options.signal,
      credentials: 'same-origin', keepalive: options.keepalive,
    });
  } catch (error) {
    if (error instanceof Error && error.name === 'AbortError') throw error;
    throw new Refused(0, 'The server does not answer. Is terrapin web still running?');
  }
  const text = await answer.text();
  let content = null;
  try { content = text ? JSON.parse(text) : null; } catch { /* told below, with the status */ }
  if (answer.ok) return content;
  if (answer.status === 401) throw new Refused(401, 'This page has no valid token: open the address that terrapin web printed.');
  throw new Refused(answer.status, oneLine(content) || `${path}: status ${answer.status}`);
}

/** The line of an error's answer. @param {any} content @returns {string} */
function oneLine(content) {
  const detail = content && content.detail;
  if (Array.isArray(detail)) return detail.map((d) => `${(d.loc || []).slice(1).join('.')}: ${d.msg}`).join('; ');
  return typeof detail === 'string' ? detail : '';
}

// ---------------------------------------------------------------- jobs

/**
 * Follow a job to its end; onProgress(job) with every change. Resolves with the job, whatever its state.
 * @param {string} id @param {(job: Job) => void} onProgress @returns {Promise<Job>}
 */
export async function follow(id, onProgress = () => {}) {
  let before = '';
  for (;;) {
    /** @type {Job} */
    const found = await api(`jobs/${encodeURIComponent(id)}`);
    const now = JSON.stringify([found.state, found.progress]);
    if (now !== before) { before = now; onProgress(found); }
    if (ENDED.includes(found.state)) return found;
    await woken(id, POLL_MS);
  }
}

/**
 * Start a job on a case and follow it. Resolves with its result; throws Refused with the error's line otherwise.
 * @param {string} caseName @param {object} body @param {(job: Job) => void} onProgress @returns {Promise<any>}
 */
export async function job(caseName, body, onProgress = () => {}) {
  const started = await api(`cases/${encodeURIComponent(caseName)}/jobs`, { body });
  if (started.command) showCommand(started.command);
  const ended = await follow(started.id, onProgress);
  if (ended.state === 'done') return ended.result;
  throw new Refused(ended.state === 'cancelled' ? 0 : 422, ended.state === 'cancelled' ? 'Cancelled; the case is as it was.' : ended.error || 'failed');
}

/** @param {string} id of a job */
export const cancel = (id) => api(`jobs/${encodeURIComponent(id)}`, { method: 'DELETE' });

/** @type {Map<string, (() => void)[]>} */
const wakers = new Map(); // job id -> functions to call when it changed
/** Resolves when the server says that a job has changed, or after some time. @param {string} id @param {number} milliseconds */
function woken(id, milliseconds) {
  return /** @type {Promise<void>} */ (new Promise((resolve) => {
    const timer = setTimeout(done, milliseconds);
    const list = wakers.get(id) || [];
    function done() {
      clearTimeout(timer);
      const left = (wakers.get(id) || []).filter((f) => f !== done);
      if (left.length) wakers.set(id, left); else wakers.delete(id);
      resolve();
    }
    wakers.set(id, [...list, done]);
  }));
}

// ---------------------------------------------------------------- the workspace

let workspace = 'terrapin-workspace';
const known = api('status').then((found) => { workspace = found.workspace; }, () => {}); // whoever asks next says what is wrong

/** Where a thing lies, as a word for a shell: place('cases', 'heated_motor'). @param {string[]} parts */
export const place = (...parts) => quote([workspace, ...parts].join('/'));

// ---------------------------------------------------------------- events: what another browser or a job changed

/** @type {Set<(event: News) => void>} */
const listeners = new Set();
/** fn(event) for every event of the server, and { lost: true } / { back: true }. Returns what stops it. @param {(event: News) => void} fn */
export function onEvent(fn) { listeners.add(fn); return () => listeners.delete(fn); }
/** @param {News} event */
const tell = (event) => { for (const fn of listeners) fn(event); };

let wait = 500, wasLost = false;
function connect() {
  const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
  const query = token ? `?token=${encodeURIComponent(token)}` : '';
  const socket = new WebSocket(`${scheme}://${location.host}/api/events${query}`);
  socket.onopen = () => {
    wait = 500;
    $('connection').textContent = '';
    if (wasLost) { wasLost = false; tell({ back: true }); }
  };
  socket.onmessage = (message) => {
    let event;
    try { event = JSON.parse(message.data); } catch { return; }
    if (event.job !== undefined) for (const wake of wakers.get(String(event.job)) || []) wake();
    tell(event);
  };
  socket.onclose = () => {
    if (!wasLost) { wasLost = true; tell({ lost: true }); }
    $('connection').textContent = 'no connection, trying again';
    setTimeout(connect, wait);
    wait = Math.min(8000, wait * 2);
  };
}

// ---------------------------------------------------------------- the command line strip

/** Show the command that does what was just done. @param {string} text */
export function showCommand(text) {
  $('command').textContent = text;
  $('copy').textContent = 'Copy';
}

/** Copy text; true when it was. @param {string} text */
export async function copyText(text) {
  try { await navigator.clipboard.writeText(text); return true; } catch { return false; }
}

$('copy').addEventListener('click', async () => {
  const good = await copyText($('command').textContent);
  if (!good) getSelection()?.selectAllChildren($('command'));
  $('copy').textContent = good ? 'Copied' : 'Press Ctrl+C';
  announce(good ? 'Command copied' : 'Command selected, press Control C');
});

// ---------------------------------------------------------------- light and dark

const dark = matchMedia('(prefers-color-scheme: dark)');
const isDark = () => (document.documentElement.dataset.theme || (dark.matches ? 'dark' : 'light')) === 'dark';
/** Light or dark; none: as it was. @param {string} [name] */
function setTheme(name) {
  if (name) { document.documentElement.dataset.theme = name; localStorage.setItem('terrapin-theme', name); }
  $('theme').textContent = isDark() ? 'Light' : 'Dark';
  for (const tab of mounted.values()) tab.redraw?.();
}
$('theme').addEventListener('click', () => setTheme(isDark() ? 'light' : 'dark'));
dark.addEventListener('change', () => setTheme());

// ---------------------------------------------------------------- tabs

/** @type {Map<string, Tab>} */
const mounted = new Map(); // name -> what mount returned
/** @type {Map<string, HTMLElement>} */
const places = new Map(); // name -> its element
let current = '';

/** Go to a place: go('workbench', 'heated_motor'). @param {string} tab */
export function go(tab, rest = '') {
  const hash = `#${tab}${rest ? `/${rest.split('/').map(encodeURIComponent).join('/')}` : ''}`;
  if (location.hash === hash) route(); else location.hash = hash;
}

/** Beside the tabs: what is open, as text or elements. @param {(string | Node)[]} parts */
export function context(...parts) { $('context').replaceChildren(...parts.filter(Boolean)); }

/** @type {Map<string, Promise<void>>} */
const loading = new Map(); // name -> until it is mounted

/** @param {string} name @param {HTMLElement} host */
async function load(name, host) {
  try {
    const module = await import(`./${name}.js`);
    mounted.set(name, module.mount(host, app) || {});
  } catch (error) {
    host.append(h('p', { class: 'notice', role: 'alert', text: `This part could not be loaded: ${lineOf(error)}` }));
    console.warn(error);
  }
}

let turns = 0;
async function route() {
  const turn = ++turns;
  let parts;
  try { parts = location.hash.slice(1).split('/').map(decodeURIComponent); } catch { parts = ['']; }
  const [name, ...rest] = parts;
  const tab = TABS.find((one) => one.name === name) || TABS[0];
  for (const link of /** @type {Iterable<HTMLElement>} */ ($('tabs').children)) {
    if (link.dataset.tab === tab.name) link.setAttribute('aria-current', 'page');
    else link.removeAttribute('aria-current');
  }
  document.title = `${tab.title} – Terrapin`;
  if (current !== tab.name) {
    if (current) mounted.get(current)?.hide?.();
    for (const other of places.values()) other.hidden = true;
    current = tab.name;
    context('');
  }
  const host = places.get(tab.name) || h('div', { class: `tab tab-${tab.name}` });
  if (!places.has(tab.name)) {
    places.set(tab.name, host);
    $('main').append(host);
    loading.set(tab.name, load(tab.name, host));
  }
  await Promise.all([loading.get(tab.name), known]);
  if (turn !== turns) return; // gone on while it loaded
  host.hidden = false;
  mounted.get(tab.name)?.show?.(rest.join('/'));
  if (turn > 1 && document.activeElement === document.body) focus($('main')); // what was clicked is gone
}

export const app = {
  api, job, follow, cancel, showCommand, copyText, onEvent, go, context, announce, h, number, unit, css, still, Refused,
  keepFocus, focus, quote, place, lineOf,
  token: () => token,
};

for (const tab of TABS) $('tabs').append(h('a', { href: `#${tab.name}`, 'data-tab': tab.name, text: tab.title }));
document.documentElement.dataset.theme = localStorage.getItem('terrapin-theme') || '';
if (!document.documentElement.dataset.theme) delete document.documentElement.dataset.theme;
addEventListener('hashchange', route);
setTheme();
connect();
stopEverywhere($('stop'), $('connection'), app);
route();
