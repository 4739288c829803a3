// The Live tab: one source that the server watches; every browser sees the same. Pause, filter and the choice of signals
// are this browser's own.
import { COLOURS, Ring, Strip, style } from './strip.js';

const FIRST = ['MOTION.slip', 'GROUND.torque', 'ELECTRICAL.current', 'ACTUATE.state'];
const SECONDS = [5, 15, 30, 60, 120, 300];
const MOST = 8; // lanes
const HEAD = 32; // bytes of a picture's head
const SAMPLES = 1;
const ROWS_EVERY = 250; // ms between looks at the numbers of the table, and at the list of events
const EVENTS = 500, LISTED = 100; // that are drawn, that are listed
const STOP_MS = 1000; // after the button has become “release”, in which it does not
const STOP_WORDS = {
  bus: 'Asks the controller for idle, thirty times a second, until it is pressed again. It goes on when this page is closed; it needs this computer and the bus: it is no emergency stop and cuts no power. Another node that asks for run can win in between. The red button on the robot works always.',
  simulator: 'Opens the emergency stop of the simulated robot until it is pressed again: the bridge goes off in the same tick. A controller that has been stopped wants “clear” before it runs again, as the real one does.',
  '': 'A log has nothing to stop.',
};
const KEY = 'terrapin-live-signals';

export function mount(element, app) {
  const { h, api, number } = app;
  style();
  const state = { signals: [], index: new Map(), values: [], epoch: 0, frames: 0, next: null, missed: 0, pictures: 0, skipped: 0, last: 0, status: null, hello: null };
  const rings = new Map(); // name -> Ring, of the signals that were ever looked at
  let chosen = JSON.parse(localStorage.getItem(KEY) || 'null') || FIRST;
  let pattern = /(?:)/;
  let socket = null, shown = false, wait = 500, events = [];

  // ---------------------------------------------------------------- the page
  const source = h('select', { id: 'live-source', 'aria-label': 'Source' });
  const watch = h('button', { type: 'button', class: 'main', text: 'Watch', onclick: begin });
  const leave = h('button', { type: 'button', text: 'Leave', onclick: end });
  const typed = h('input', { type: 'text', id: 'live-typed', placeholder: 'socketcan:can0, serial:/dev/ttyACM0, can:INTERFACE:CHANNEL', hidden: true, 'aria-label': 'Link' });
  const speed = h('select', { id: 'live-speed', 'aria-label': 'Speed of a log' }, ...[1, 2, 5, 10, 100].map((s) => h('option', { value: String(s), text: `${s} ×` })));
  const bitrate = h('select', { id: 'live-bitrate', 'aria-label': 'Bit rate of the bus' }, ...[125, 250, 500, 1000].map((k) => h('option', { value: String(k * 1000), text: `${k} kbit/s`, selected: k === 500 })));
  const controller = h('select', { id: 'live-controller', 'aria-label': 'Controller of the simulator' }, h('option', { value: 'inprocess', text: 'in this process' }), h('option', { value: 'pty', text: 'a process, over a pty' }));
  const dbc = h('select', { id: 'live-dbc', 'aria-label': 'DBC' });
  const file = h('input', { type: 'file', id: 'live-file', hidden: true, accept: '.log,.blf,.asc,.mf4,.mcap,.parquet,.dbc', onchange: uploadFile });
  const openFile = h('button', { type: 'button', text: 'Open a log or DBC …', onclick: () => file.click() });
  const chip = h('span', { class: 'chip small', role: 'status' });
  const notice = h('p', { class: 'notice bad', role: 'alert', hidden: true });
  const tiles = h('dl', { class: 'tiles' });
  const place = h('div');
  const strip = new Strip(place, cursorMoved);
  const pause = h('button', { type: 'button', text: 'Pause', 'aria-pressed': 'false', onclick: () => setPaused(strip.paused === null) });
  const seconds = h('select', { 'aria-label': 'Seconds shown', onchange: () => { strip.seconds = Number(seconds.value); } }, ...SECONDS.map((s) => h('option', { value: String(s), text: `${s} s`, selected: s === 15 })));
  const markText = h('input', { type: 'text', value: 'mark', maxlength: '60', 'aria-label': 'Words of the mark' });
  const mark = h('button', { type: 'button', text: 'Mark', onclick: () => command({ request: 'mark', text: markText.value || 'mark' }) });
  const counts = h('p', { class: 'soft small counts' });
  const cursorSaid = h('span', { class: 'soft small' });
  const health = h('div', { class: 'health' });
  const load = h('progress', { class: 'bar', max: '1', value: 0, 'aria-label': 'Load of the bus' });
  const recordName = h('input', { type: 'text', 'aria-label': 'Name of the log', maxlength: '56' });
  const recordKind = h('select', { 'aria-label': 'Kind of log' }, ...['.mf4', '.mcap', '.blf', '.log'].map((k) => h('option', { value: k, text: k })));
  const record = h('button', { type: 'button', text: 'Record', onclick: toggleRecord });
  const recorded = h('p', { class: 'soft small' });
  const stop = h('button', { type: 'button', class: 'stop', text: 'Stop the robot', 'aria-pressed': 'false', onclick: toggleStop });
  const stopWords = h('p', { class: 'soft small' });
  const filter = h('input', { type: 'text', placeholder: 'regular expression, such as slip|torque', 'aria-label': 'Filter signals', oninput: setFilter });
  const table = h('tbody');
  const log = h('ol', { class: 'event-list', tabindex: '0', 'aria-label': 'Events, newest first' });

  element.append(
    h('div', { class: 'panel live-bar row' },
      h('label', { for: 'live-source', text: 'Source' }), source, typed, bitrate, speed, controller, dbc, openFile, file, watch, leave, chip),
    notice, tiles,
    h('div', { class: 'live-grid' },
      h('section', { class: 'panel' },
        h('div', { class: 'panel-head' }, h('h2', { text: 'Signals over time' }), cursorSaid, h('div', { class: 'choices' }, markText, mark, seconds, pause)),
        place, counts),
      h('div', { class: 'side' },
        h('section', { class: 'panel stop-panel' }, h('h2', { class: 'visually-hidden', text: 'Stop' }), h('div', { class: 'row' }, stop), stopWords),
        h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Bus' })), load, health),
        h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Record' })), h('div', { class: 'record-row' }, recordName, recordKind, record), recorded),
        h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Events' })), log))),
    h('section', { class: 'panel signals' },
      h('div', { class: 'panel-head' }, h('h2', { text: 'All signals' }), h('div', { class: 'choices' }, filter)),
      h('div', { class: 'signal-table', tabindex: '0', role: 'region', 'aria-label': 'All signals' }, h('table', {}, h('thead', {}, h('tr', {}, ...['Plot', 'Signal', 'Value', 'Unit'].map((t, i) => h('th', { scope: 'col', class: i === 2 ? 'n' : null, text: t })))), table))));
  source.addEventListener('change', options);
  newName();

  // ---------------------------------------------------------------- source

  async function run(action) {
    try { notice.hidden = true; return await action(); } catch (error) { tell(error.message); return null; }
  }
  function tell(text) { notice.hidden = !text; notice.textContent = text; }

  async function offer() {
    const links = await run(() => api('links'));
    if (!links) return;
    const before = source.value;
    const group = (title, kind) => h('optgroup', { label: title }, ...links.filter((l) => l.kind === kind).map((l) => h('option', { value: l.source, text: l.title })));
    source.replaceChildren(
      h('optgroup', { label: 'Buses' }, ...group('', 'bus').children, h('option', { value: 'typed', text: 'another bus …' })),
      group('Logs in the workspace', 'log'), group('Simulator', 'simulator'));
    const named = links[0]?.title.endsWith('--link)') ? links[0].source : 'simulator:steady_sand';
    source.value = [...source.options].some((o) => o.value === before) && before ? before : named;
    const dbcBefore = dbc.value;
    dbc.replaceChildren(h('option', { value: '', text: 'the controller’s DBC' }), ...links.filter((l) => l.kind === 'dbc').map((l) => h('option', { value: l.source, text: l.title })));
    dbc.value = [...dbc.options].some((o) => o.value === dbcBefore) ? dbcBefore : '';
    options();
  }
  function options() {
    const kind = source.value.split(':')[0];
    typed.hidden = source.value !== 'typed';
    speed.hidden = kind !== 'log' && kind !== 'upload';
    controller.hidden = kind !== 'simulator';
    bitrate.hidden = ['log', 'upload', 'simulator'].includes(kind);
  }
  async function begin() {
    const body = { source: source.value === 'typed' ? typed.value.trim() : source.value, dbc: dbc.value, speed: Number(speed.value), bitrate: Number(bitrate.value), controller: controller.value };
    watch.disabled = true;
    const answer = await run(() => api('live', { body }));
    watch.disabled = false;
    if (answer) app.showCommand(answer.command);
  }
  async function uploadFile() {
    const [chosenFile] = file.files;
    file.value = '';
    if (!chosenFile) return;
    chip.textContent = `sending ${chosenFile.name} …`;
    const found = await run(() => api(`uploads?name=${encodeURIComponent(chosenFile.name)}`, { method: 'POST', body: chosenFile }));
    chip.textContent = '';
    if (!found) return;
    await offer();
    if (found.kind === 'dbc') dbc.value = found.id;
    else if (found.kind === 'log') { source.value = `upload:${found.id}`; options(); } else tell(`${found.name} is a table, expected a log: the workbench takes tables.`);
    if (found.warnings.length) tell(`${found.name}: ${found.warnings.join('; ')}`);
  }
  async function end() {
    const answer = await run(() => api('live', { method: 'DELETE' }));
    if (answer) app.showCommand(answer.command);
  }

  // ---------------------------------------------------------------- what comes

  function connect() {
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    const token = app.token();
    socket = new WebSocket(`${scheme}://${location.host}/api/live/socket${token ? `?token=${encodeURIComponent(token)}` : ''}`);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => { wait = 500; };
    socket.onmessage = (message) => {
      if (typeof message.data === 'string') {
        const said = JSON.parse(message.data);
        if (said.type === 'hello') hello(said); else status(said);
      } else picture(message.data);
    };
    socket.onclose = (event) => {
      if (event.reason) tell(`Live view: ${event.reason}`);
      socket = null;
      if (shown) { setTimeout(() => { if (shown && !socket) connect(); }, wait); wait = Math.min(8000, wait * 2); }
    };
  }

  function hello(said) {
    state.hello = said.name === null ? null : said;
    state.signals = said.signals || [];
    state.index = new Map(state.signals.map((s, i) => [s.name, i]));
    for (const signal of state.signals) if (signal.words) signal.words = Object.fromEntries(Object.entries(signal.words).map(([word, value]) => [value, word]));
    Object.assign(state, { epoch: 0, frames: 0, next: null, missed: 0, pictures: 0, skipped: 0, last: 0, status: null });
    rings.clear();
    events = [];
    strip.end = 0; strip.events = events;
    setPaused(false);
    if (state.signals.length && !chosen.some((name) => state.index.has(name))) chosen = state.signals.slice(0, 3).map((s) => s.name);
    if (said.command) app.showCommand(said.command);
    app.context(said.name || '');
    stop.disabled = !said.stop;
    stopWords.textContent = STOP_WORDS[said.stop || ''];
    record.disabled = !state.hello;
    log.replaceChildren();
    newest = listed = 0;
    want(); list();
    if (!state.hello) { chip.textContent = 'nothing is watched'; chip.className = 'chip small'; tiles.replaceChildren(); health.replaceChildren(); counts.textContent = ''; tell(''); }
  }

  function want() {
    const known = chosen.filter((name) => state.index.has(name));
    strip.lanes = known.map((name, place) => {
      const signal = state.signals[state.index.get(name)];
      if (!rings.has(name)) rings.set(name, new Ring());
      return { name, unit: signal.unit, words: signal.words, colour: COLOURS[place % COLOURS.length], ring: rings.get(name) };
    });
    for (const name of rings.keys()) if (!known.includes(name)) rings.delete(name);
    if (socket?.readyState === 1) socket.send(JSON.stringify({ want: known.map((name) => state.index.get(name)) }));
  }

  function picture(buffer) {
    const view = new DataView(buffer);
    const kind = view.getUint8(1), columns = view.getUint16(2, true), count = view.getUint32(4, true), epoch = view.getUint32(8, true), frames = view.getUint32(12, true);
    const first = view.getFloat64(16, true), base = view.getFloat64(24, true);
    if (epoch !== state.epoch) { state.epoch = epoch; for (const ring of rings.values()) ring.clear(); strip.end = base; }
    if (kind === SAMPLES) {
      if (state.next !== null) { state.missed += Math.max(0, first - state.next); state.skipped += Math.max(0, count - state.last - 1); }
      state.next = first + frames; state.frames += frames; state.pictures++; state.last = count;
      strip.end = Math.max(strip.end, base);
      if (socket?.readyState === 1) socket.send(`{"seen":${count}}`);
    }
    let at = HEAD;
    for (let c = 0; c < columns; c++) {
      const signal = state.signals[view.getUint16(at, true)], points = view.getUint16(at + 2, true);
      at += 4;
      const ring = signal ? rings.get(signal.name) : null;
      if (ring && kind !== SAMPLES) ring.clear();
      if (ring) for (let p = 0; p < points; p++) ring.push(base + view.getFloat32(at + 8 * p, true), view.getFloat32(at + 8 * p + 4, true));
      at += 8 * points;
    }
  }

  function status(said) {
    state.status = said;
    state.values = said.values;
    strip.zero = said.begin > 1e6 ? said.begin : 0; // times of a bus count from 1970
    for (const event of said.events) if (event.number > (events.at(-1)?.number ?? 0)) events.push(event);
    if (events.length > EVENTS) events.splice(0, events.length - EVENTS);
    const words = { live: said.silent ? 'silent' : 'live', over: 'over', gone: 'gone' }[said.state];
    chip.textContent = words;
    chip.className = `chip small ${said.state === 'gone' ? 'missing' : said.silent || said.state === 'over' ? 'ambiguous' : 'adequate'}`;
    if (said.state === 'gone') tell(`${said.note}. What was recorded is whole. Watch connects again.`);
    else if (said.note) tell(said.note);
    else if (said.fit) tell(said.fit);
    if (shown) { tile(); bus(); recording(); if (performance.now() - listed > ROWS_EVERY) listEvents(); if (tableSeen && performance.now() - drawnRows > ROWS_EVERY) rows(); }
  }

  // ---------------------------------------------------------------- drawn from the status

  const value = (name) => { const i = state.index.get(name); return i === undefined ? null : state.values[i]; };
  const word = (name) => { const v = value(name); if (v === null || v === undefined) return '–'; return state.signals[state.index.get(name)].words?.[v] ?? number(v); };
  const tileParts = new Map();
  function one(title, text, kind = '', hint = '') {
    let part = tileParts.get(title);
    if (!part || !part.dd.isConnected) {
      part = { dd: h('dd'), hint: h('span', { class: 'hint' }) };
      tileParts.set(title, part);
      tiles.append(h('div', { class: 'tile', 'data-tile': title }, h('dt', { text: title }), part.dd, h('dd', { class: 'hint-line' }, part.hint)));
    }
    if (part.dd.textContent !== text) part.dd.textContent = text;
    if (part.dd.className !== kind) part.dd.className = kind;
    if (part.hint.textContent !== hint) part.hint.textContent = hint;
  }
  function tile() {
    const { status: now, hello: said } = state;
    if (!said) return;
    if (state.index.has('STATUS.state')) {
      const safe = word('STATUS.state') === 'safe';
      one('State', word('ACTUATE.state') === '–' ? word('STATUS.state') : word('ACTUATE.state'), safe ? 'bad' : '', value('ACTUATE.enable') ? 'bridge on' : 'bridge off');
      const faults = now.faults;
      one('Faults', faults.length ? faults.map((f) => f.name).join(', ') : 'none', faults.length ? 'bad' : 'good', faults.length ? `${faults[0].cause}; ${faults[0].reaction}` : '');
      const slip = value('MOTION.slip'), over = slip > said.slip_limit;
      one('Slip', number(slip, 3), over ? 'bad' : '', `${value('MOTION.slip_valid') ? '' : 'not valid, '}limit ${number(said.slip_limit)}`);
      const sd = value('GROUND.torque_sd');
      one('C_t, mN m', value('GROUND.torque') === null ? '–' : `${(value('GROUND.torque') * 1e3).toFixed(1).replace('-', '−')} ± ${(sd * 1e3).toFixed(1)}`, '', value('GROUND.valid') ? 'valid' : 'not valid: not steady');
      one('Terrain', word('GROUND.terrain'), '', `by ${number(value('GROUND.margin'), 2)} sd`);
      one('Motor', `${number(value('ELECTRICAL.current'), 3)} A`, '', `${number(value('ELECTRICAL.voltage'), 3)} V, ${number(value('ELECTRICAL.temperature'), 3)} °C`);
      one('Speed', `${number(value('MOTION.ground_speed'), 3)} m/s`, '', `shell ${number(value('MOTION.shell_speed'), 3)} rad/s`);
      one('Supply', `${number(value('ELECTRICAL.supply'), 4)} V`, '', value('ACTUATE.limiting') ? 'the slip limiter holds' : 'no limiter at work');
    } else {
      one('Frames', String(now.total), '', `${now.rate.toFixed(0)}/s`);
    }
  }
  let healthSaid = '', heldSince = 0;
  function bus() {
    const now = state.status;
    load.value = Math.min(1, now.load);
    const line = (text, kind = '') => h('p', { class: `small ${kind}`, text });
    const worst = Object.keys(now.errors).length > 0 || now.silent || now.fit;
    const parts = [
      line(`load ${(100 * now.load).toFixed(0)} %, ${now.rate.toFixed(0)} frames/s, ${now.total.toLocaleString('en')} frames`),
      line(now.health, worst ? 'bad' : 'good'),
      line(`bus off ${now.bus_off} times; error counters ${now.counters ? `sending ${now.counters[0]}, receiving ${now.counters[1]}` : 'not told by this bus'}`),
      ...(now.damaged ? [line(`${now.damaged} damaged lines`, 'bad')] : []),
      ...(now.unknown.length ? [line(`unknown: ${now.unknown.slice(0, 6).map(([id, n]) => `${id} (${n})`).join(', ')}`, 'warn')] : [])];
    const saidNow = parts.map((p) => p.className + p.textContent).join('\n');
    if (saidNow !== healthSaid) { healthSaid = saidNow; health.replaceChildren(...parts); }
    const text = `${state.frames.toLocaleString('en')} frames in pictures, ${(state.missed).toLocaleString('en')} missed by this page, ${now.lost} lost before the log; ${strip.rate.toFixed(0)} redraws/s`;
    if (counts.textContent !== text) counts.textContent = text;
    Object.assign(element.dataset, { frames: state.frames, total: now.total, missed: state.missed, lost: now.lost, redraws: strip.redraws, rate: strip.rate.toFixed(1), state: now.state, skipped: state.skipped });
  }
  function recording() {
    const now = state.status, on = now.recording;
    record.textContent = on ? 'End the log' : 'Record';
    record.setAttribute('aria-pressed', String(Boolean(on)));
    record.classList.toggle('recording', Boolean(on));
    record.disabled = !on && now.state !== 'live';
    recordName.disabled = recordKind.disabled = Boolean(on);
    const size = (b) => (b < 1e6 ? `${(b / 1e3).toFixed(0)} kB` : `${(b / 1e6).toFixed(1)} MB`);
    const done = now.last_log;
    recorded.textContent = on ? `${on.name}: ${on.frames.toLocaleString('en')} frames, ${size(on.bytes)}, ${on.seconds.toFixed(0)} s`
      : done ? `${done.name} holds ${done.frames.toLocaleString('en')} frames, ${size(done.bytes)}; it is among the sources now.` : 'Into the workspace’s folder logs. A crash costs the last half second at most.';
    if (now.stop_held && stop.getAttribute('aria-pressed') !== 'true') heldSince = performance.now();
    stop.setAttribute('aria-pressed', String(now.stop_held));
    stop.textContent = now.stop_held ? 'Stopped: release' : 'Stop the robot';
    stop.disabled = !state.hello?.stop || now.state !== 'live';
  }

  let cells = [], tableSeen = false, drawnRows = 0;
  new IntersectionObserver((entries) => { tableSeen = entries[entries.length - 1].isIntersecting; }).observe(table.closest('.signal-table'));
  function list() {
    cells = [];
    table.replaceChildren(...state.signals.filter((s) => pattern.test(s.name)).map((signal) => {
      const box = h('input', { type: 'checkbox', checked: chosen.includes(signal.name), 'aria-label': `Plot ${signal.name}`, onchange: () => pick(signal.name, box) });
      const cell = h('td', { class: 'n' });
      cells.push([cell, state.index.get(signal.name), signal]);
      return h('tr', {}, h('td', {}, box), h('td', { text: signal.name }), cell, h('td', { class: 'soft', text: signal.unit }));
    }));
    rows();
  }
  function rows() {
    drawnRows = performance.now();
    for (const [cell, i, signal] of cells) {
      const v = state.values[i];
      const text = v === null || v === undefined ? '–' : signal.words?.[v] ?? number(v, 6);
      if (cell.textContent !== text) cell.textContent = text;
    }
  }
  function pick(name, box) {
    if (box.checked && chosen.filter((n) => state.index.has(n)).length >= MOST) { box.checked = false; tell(`At most ${MOST} signals are drawn at a time.`); return; }
    chosen = box.checked ? [...chosen, name] : chosen.filter((n) => n !== name);
    localStorage.setItem(KEY, JSON.stringify(chosen));
    want();
  }
  function setFilter() {
    try { pattern = new RegExp(filter.value, 'i'); filter.removeAttribute('aria-invalid'); } catch { filter.setAttribute('aria-invalid', 'true'); return; }
    list();
  }
  let listed = 0, newest = 0;
  function listEvents() {
    const rows = events.slice(-LISTED).filter((event) => event.number > newest).reverse();
    if (!rows.length) return;
    listed = performance.now();
    newest = rows[0].number;
    for (let more = log.children.length + rows.length - LISTED; more > 0 && log.lastChild; more--) log.lastChild.remove();
    log.prepend(...rows.map((event) => h('li', { class: `event ${event.kind}` }, h('span', { class: 'soft n', text: event.time === null ? '–' : `${(event.time - strip.zero).toFixed(2)} s` }), h('b', { text: event.kind }), h('span', { text: event.text }))));
  }
  function cursorMoved(time) {
    const text = time === null ? '' : `cursor at ${(time - strip.zero).toFixed(3)} s`;
    if (cursorSaid.textContent !== text) cursorSaid.textContent = text;
  }
  function setPaused(on) {
    strip.pause(on);
    pause.textContent = on ? 'Go on' : 'Pause';
    pause.setAttribute('aria-pressed', String(on));
  }

  // ---------------------------------------------------------------- record and stop

  function newName() {
    const d = new Date(), two = (n) => String(n).padStart(2, '0');
    recordName.value = `live-${d.getFullYear()}${two(d.getMonth() + 1)}${two(d.getDate())}-${two(d.getHours())}${two(d.getMinutes())}${two(d.getSeconds())}`;
  }
  async function toggleRecord() {
    const on = Boolean(state.status?.recording);
    const answer = await run(() => api('live/record', { body: on ? { do: 'stop' } : { do: 'start', name: recordName.value.trim() + recordKind.value } }));
    if (!answer) return;
    if (answer.command) app.showCommand(answer.command);
    app.announce(on ? `${answer.name} ended with ${answer.frames} frames` : `recording ${answer.name}`);
    if (on) { newName(); offer(); }
  }
  async function toggleStop() {
    const held = Boolean(state.status?.stop_held);
    if (held && performance.now() - heldSince < STOP_MS) return; // a hurried second click does not let go
    await command({ request: held ? 'release' : 'idle' });
  }
  async function command(body) {
    const answer = await run(() => api('live/command', { body }));
    if (answer) { app.announce(answer.done); app.showCommand(answer.command); }
  }

  element.addEventListener('keydown', (event) => {
    if (event.key === ' ' && event.target === strip.canvas) { event.preventDefault(); setPaused(strip.paused === null); }
  });

  return {
    show() { shown = true; offer(); strip.start(); if (!socket) connect(); app.context(state.hello?.name || ''); if (state.hello?.command) app.showCommand(state.hello.command); },
    hide() { shown = false; strip.stop(); socket?.close(); },
    redraw() { strip.recolour(); },
  };
}
