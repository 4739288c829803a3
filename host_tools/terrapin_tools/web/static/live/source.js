// The bar that says what is watched: a bus, a log or the simulator, with the options of each.
import { h, told } from '../app.js';

export class Source {
  /** @param {LiveDesk} desk */
  constructor(desk) {
    this.desk = desk;
    this.kind = ''; // of what is watched
    /** @type {Watch | null} */
    this.watched = null; // what was asked for, by whichever browser
    this.source = h('select', { id: 'live-source', 'aria-label': 'Source', onchange: () => { this.options(); } });
    this.watch = h('button', { type: 'button', class: 'main', text: 'Watch', disabled: true, onclick: () => this.begin() });
    this.leave = h('button', { type: 'button', text: 'Leave', onclick: () => this.end() });
    this.typed = h('input', { type: 'text', id: 'live-typed', placeholder: 'socketcan:can0, serial:/dev/ttyACM0, can:INTERFACE:CHANNEL', hidden: true, 'aria-label': 'Link' });
    this.speed = h('select', { id: 'live-speed', 'aria-label': 'Speed of a log' }, ...[1, 2, 5, 10, 100].map((s) => h('option', { value: String(s), text: `${s} ×` })));
    this.bitrate = h('select', { id: 'live-bitrate', 'aria-label': 'Bit rate of the bus' }, ...[125, 250, 500, 1000].map((k) => h('option', { value: String(k * 1000), text: `${k} kbit/s`, selected: k === 500 })));
    this.controller = h('select', { id: 'live-controller', 'aria-label': 'Controller of the simulator' }, h('option', { value: 'inprocess', text: 'in this process' }), h('option', { value: 'pty', text: 'a process, over a pty' }));
    this.node = h('select', { id: 'live-node', 'aria-label': 'Node number of the controller' }, h('option', { value: '', text: 'node of the link' }));
    this.dbc = h('select', { id: 'live-dbc', 'aria-label': 'DBC' });
    this.file = h('input', { type: 'file', id: 'live-file', hidden: true, accept: '.log,.blf,.asc,.trc,.csv,.txt,.db,.mf4,.mcap,.parquet,.dbc', onchange: () => this.upload() });
    this.chip = h('span', { class: 'chip small', role: 'status' });
    const open = h('button', { type: 'button', text: 'Open a log or DBC …', onclick: () => { this.file.click(); } });
    this.element = h('div', { class: 'panel live-bar row' },
      h('label', { for: 'live-source', text: 'Source' }), this.source, this.typed, this.bitrate, this.speed, this.controller, this.node, this.dbc, open, this.file, this.watch, this.leave, this.chip);
  }

  /** What there is to watch. */
  async offer() {
    const { app, run } = this.desk, { source, dbc } = this;
    /** @type {[Link[], { nodes: number }] | null} */
    const found = await run(() => Promise.all([app.api('links'), app.api('status')]));
    if (!found) return;
    const [links, { nodes }] = found;
    for (let n = this.node.options.length - 1; n < nodes; n++) this.node.append(h('option', { value: String(n), text: `node ${n}` }));
    const before = source.value;
    /** @param {string} kind */
    const options = (kind) => links.filter((l) => l.kind === kind).map((l) => h('option', { value: l.source, text: l.title }));
    source.replaceChildren(
      h('optgroup', { label: 'Buses' }, ...options('bus'), h('option', { value: 'typed', text: 'another bus …' })),
      h('optgroup', { label: 'To drive' }, ...options('robot')), h('optgroup', { label: 'Logs in the workspace' }, ...options('log')), h('optgroup', { label: 'Simulator' }, ...options('simulator')));
    const named = links[0]?.title.endsWith('--link)') ? links[0].source : 'simulator:steady_sand';
    const wanted = this.watched?.source || before;
    source.value = [...source.options].some((o) => o.value === wanted) && wanted ? wanted : named;
    const dbcBefore = dbc.value;
    dbc.replaceChildren(h('option', { value: '', text: 'the controller’s DBC' }), ...options('dbc'));
    dbc.value = [...dbc.options].some((o) => o.value === dbcBefore) ? dbcBefore : '';
    this.options();
    this.watch.disabled = false; // there is something to watch from now on
  }

  /** Show the options of the source that is chosen. */
  options() {
    const [kind] = this.source.value.split(':');
    this.typed.hidden = this.source.value !== 'typed';
    this.speed.hidden = kind !== 'log' && kind !== 'upload';
    this.controller.hidden = kind !== 'simulator';
    this.node.hidden = kind === 'robot' || kind === 'simulator';
    this.dbc.hidden = kind === 'robot';
    this.bitrate.hidden = ['log', 'upload', 'simulator', 'robot'].includes(kind);
  }

  /** What is watched, by whichever browser: it stands in the choice. @param {Watch | null} watched */
  take(watched) {
    this.watched = watched;
    if (!watched || ![...this.source.options].some((one) => one.value === watched.source)) return;
    this.source.value = watched.source;
    this.options();
  }

  /** Another controller of what is watched. @param {number} node */
  choose(node) {
    this.node.value = String(node);
    if (this.watched) return this.open({ ...this.watched, node });
    return undefined;
  }

  async begin() {
    const node = this.node.hidden || !this.node.value ? {} : { node: Number(this.node.value) };
    await this.open({ source: this.source.value === 'typed' ? this.typed.value.trim() : this.source.value, dbc: this.dbc.hidden ? '' : this.dbc.value, speed: Number(this.speed.value), bitrate: Number(this.bitrate.value), controller: this.controller.value, ...node });
  }

  /** What an address names, where nothing is watched yet: #live/robot:floor. @param {string} name */
  async wanted(name) {
    const { app, run, tell } = this.desk;
    if (!name) return;
    if (![...this.source.options].some((one) => one.value === name)) { tell(`found no “${name}” to watch: choose one of the sources`); return; }
    history.replaceState(null, '', '#live'); // a reload shows what is watched then
    this.source.value = name;
    this.options();
    const now = await run(() => app.api('live'));
    if (now && now.name === null) await this.begin();
  }

  /** @param {Watch} body */
  async open(body) {
    const { app, run } = this.desk;
    this.watch.disabled = true;
    if (body.source.startsWith('robot:')) this.chip.textContent = 'a robot is started …';
    const answer = await run(() => app.api('live', { body }));
    this.watch.disabled = false;
    if (answer) app.showCommand(answer.command);
  }

  async end() {
    const { app, run } = this.desk;
    const answer = await run(() => app.api('live', { method: 'DELETE' }));
    if (answer) app.showCommand(answer.command);
  }

  async upload() {
    const { app, run, tell } = this.desk, chosen = this.file.files?.[0];
    this.file.value = '';
    if (!chosen) return;
    this.chip.textContent = `sending ${chosen.name} …`;
    /** @type {Upload | null} */
    const found = await run(() => app.api(`uploads?name=${encodeURIComponent(chosen.name)}`, { method: 'POST', body: chosen }));
    this.chip.textContent = '';
    if (!found) return;
    await this.offer();
    if (found.kind === 'dbc') this.dbc.value = found.id;
    else if (found.kind === 'log') { this.source.value = `upload:${found.id}`; this.options(); } else tell(`${found.name} is a table, expected a log: the workbench takes tables.`);
    if (found.warnings.length) tell(`${found.name}: ${found.warnings.join('; ')}`);
  }

  /** How what is watched stands; null: nothing is. @param {Status | null} now */
  draw(now) {
    const plays = this.kind === 'log' ? 'replay' : 'live';
    told(this.chip, now ? { live: now.silent ? 'silent' : plays, over: this.kind === 'log' ? 'replay, at its end' : 'over', gone: 'gone' }[now.state] : 'nothing is watched');
    this.chip.className = now ? `chip small ${now.state === 'gone' ? 'missing' : now.silent || now.state === 'over' || this.kind === 'log' ? 'ambiguous' : 'adequate'}` : 'chip small';
  }
}
