// Measurements into a case: drop files, see what was guessed of their columns, correct it, make the case.
// What is typed is kept by the server beside the first of the files (its draft), so that a reload loses nothing.
import { number } from './app.js';

const KINDS = '.csv,.parquet,.dbc,.log,.blf,.asc,.mf4,.mcap';
const MOST_ROWS = 2e6; // of a case
const KEEP_MS = 300; // after the last key, before what is typed is kept
const FUNCTIONS = ['abs', 'sign', 'sqrt', 'exp', 'log', 'sin', 'cos', 'tan', 'tanh', 'min', 'max'];
const plain = (name) => {
  const word = name.replace(/\s*[[(].*$/, '').replace(/\W+/g, '_').replace(/^_+|_+$/g, '').toLowerCase();
  return /^[a-z_]/.test(word) ? word : `c_${word}`;
};

export class Mapper {
  /** `opened(name)` is called with the case that was made. */
  constructor(app, opened) {
    Object.assign(this, { app, opened, uploads: [], job: null, command: '' });
    const { h } = app;
    this.input = h('input', { type: 'file', multiple: true, accept: KINDS, class: 'visually-hidden', id: 'files', onchange: () => { this.send(this.input.files); this.input.value = ''; } });
    this.zone = h('div', { class: 'drop' },
      h('p', {}, h('strong', { text: 'New case: drop measurements here' })),
      h('p', { class: 'soft small', text: 'CSV or Parquet; or a CAN log (candump, BLF, ASC, MF4, MCAP) with its DBC' }),
      this.input, h('label', { for: 'files', class: 'button', text: 'Choose files…' }));
    this.progress = h('div', { 'aria-live': 'polite' });
    this.form = h('div');
    this.element = h('section', { 'aria-label': 'New case from measurements' }, this.zone, this.progress, this.form);
    addEventListener('pagehide', () => { if (this.timer) this.keep(); });
    this.restore();
    for (const type of ['dragenter', 'dragover']) this.zone.addEventListener(type, (event) => { event.preventDefault(); this.zone.classList.add('over'); });
    for (const type of ['dragleave', 'drop']) this.zone.addEventListener(type, () => this.zone.classList.remove('over'));
    this.zone.addEventListener('drop', (event) => { event.preventDefault(); this.send(event.dataTransfer.files); });
  }

  // ---------------------------------------------------------------- sending

  async send(files) {
    for (const file of files) {
      try { this.uploads.push(await this.upload(file)); } catch (error) { this.tell(file.name, error.message); continue; }
    }
    if (!this.uploads.length) return;
    await this.map(this.base ? this.draft() : null); // what is typed already stays
    this.keep();
  }

  /** XMLHttpRequest, because fetch does not say how far it has sent. */
  upload(file) {
    const { h } = this.app;
    const request = new XMLHttpRequest();
    const bar = h('progress', { max: '1', value: 0, 'aria-label': `sending ${file.name}` }), said = h('span', { class: 'line soft', text: 'sending' });
    const row = h('div', { class: 'job' }, bar, h('strong', { text: file.name }), said, h('button', { type: 'button', text: 'Cancel', onclick: () => request.abort() }));
    this.progress.append(row);
    return new Promise((resolve, reject) => {
      request.open('POST', `/api/uploads?name=${encodeURIComponent(file.name)}`);
      if (this.app.token()) request.setRequestHeader('Authorization', `Bearer ${this.app.token()}`);
      request.setRequestHeader('Content-Type', 'application/octet-stream');
      request.upload.onprogress = (event) => { if (event.lengthComputable) { bar.value = event.loaded / event.total; said.textContent = event.loaded < event.total ? `${Math.round(event.loaded / 1e5) / 10} of ${Math.round(event.total / 1e5) / 10} MB` : 'reading'; } };
      request.onload = () => {
        let answer = null;
        try { answer = JSON.parse(request.responseText); } catch { /* the status says it */ }
        if (request.status < 300) resolve(answer); else reject(new Error(answer?.detail || `status ${request.status}`));
      };
      request.onerror = () => reject(new Error('the server does not answer'));
      request.onabort = () => reject(new Error('cancelled'));
      request.send(file);
    }).finally(() => row.remove());
  }

  tell(name, text) {
    const { h } = this.app;
    this.progress.append(h('p', { class: 'notice bad', role: 'alert' }, h('b', { text: name }), `: ${text} `, h('button', { type: 'button', class: 'quiet', text: 'Dismiss', onclick: (event) => event.target.parentNode.remove() })));
  }

  // ---------------------------------------------------------------- mapping

  async map(draft) {
    this.bases ??= await this.app.api('bases');
    const data = this.uploads.filter((one) => one.kind !== 'dbc'), dbc = this.uploads.find((one) => one.kind === 'dbc');
    if (!data.length) { this.form.replaceChildren(this.app.h('p', { class: 'notice', text: `${dbc.name} is here: now drop the log that it describes.` })); return; }
    let [first] = data;
    if (first.kind === 'log' && dbc) {
      try { first = await this.app.api(`uploads/${first.id}/preview?dbc=${dbc.id}`); } catch (error) { this.tell(first.name, error.message); }
    }
    this.data = data;
    this.dbc = dbc;
    this.first = first;
    this.draw(draft?.base || first.base_guess || 'equation', draft);
  }

  /** The form for a base model; `draft`: what was typed in it before. */
  draw(base, draft) {
    const { h } = this.app, { first } = this, fields = draft?.fields || {};
    this.base = this.bases.find((one) => one.name === base);
    const name = plain(first.name.replace(/\.\w+$/, '')).slice(0, 60) || 'case';
    const text = (properties) => h('input', { type: 'text', autocomplete: 'off', spellcheck: 'false', ...properties });
    this.title = text({ value: fields.title ?? first.name.replace(/\.\w+$/, '').replaceAll('_', ' '), maxlength: '200' });
    this.caseName = text({ value: fields.name ?? name, maxlength: '64', pattern: '[A-Za-z0-9][A-Za-z0-9_.\\-]{0,63}', required: true });
    this.model = h('select', { onchange: () => this.remodel() }, this.bases.map((one) => h('option', { value: one.name, text: one.name, selected: one === this.base })));
    const run = fields.run ?? first.run_guess;
    this.run = h('select', {}, h('option', { value: '', text: 'each file is one run' }), first.columns.map((c) => h('option', { value: c.name, text: c.name, selected: c.name === run })));
    this.period = first.kind === 'log' ? text({ value: fields.period ?? '10 ms' }) : null;
    const rows = this.data.reduce((sum, one) => sum + one.rows, 0);
    this.every = first.kind === 'log' ? null : text({ inputmode: 'numeric', value: fields.every ?? String(Math.max(1, Math.ceil(rows / MOST_ROWS))) });
    this.rows = first.columns.filter((c) => c.numeric && c.name !== first.run_guess).map((c) => this.row(c, draft?.columns?.find((one) => one.column === c.name)));
    this.extra = h('div', { class: 'form' });
    this.problem = h('div', { role: 'alert' });
    this.making = h('div', { class: 'job', role: 'status', hidden: true });
    this.submit = h('button', { type: 'submit', class: 'main', text: 'Make the case' });
    const label = (words, input) => h('label', {}, words, input);
    const form = h('form', { class: 'panel form', 'aria-label': 'Map the columns', onsubmit: (event) => { event.preventDefault(); this.make(); } },
      h('h2', { text: 'Map the columns' }),
      h('p', { class: 'soft small', text: `${this.data.map((one) => one.name).join(', ')}: ${first.rows} ${first.kind === 'log' ? 'frames' : 'rows'}. Guessed from the names of the columns; correct what is wrong. What is not mapped is looked at all the same.` }),
      first.warnings.map((line) => h('p', { class: 'warn small', text: line })),
      h('div', { class: 'four' }, label('name', this.caseName), label('title', this.title), label('model', this.model), label('run', this.run), this.period ? label('one row every', this.period) : label('every n-th row', this.every)),
      h('div', { class: 'scroll wide', tabindex: '0', role: 'region', 'aria-label': 'Columns' }, h('table', { class: 'inputs' },
        h('thead', {}, h('tr', {}, ['column', 'first values', 'is', 'unit', 'noise sd'].map((words) => h('th', { scope: 'col', text: words })))),
        h('tbody', {}, this.rows.map((one) => one.element)))),
      this.extra, this.problem, this.making,
      h('div', { class: 'row' }, this.submit, h('button', { type: 'button', text: 'Discard', onclick: () => this.discard() })));
    this.app.keepFocus(this.form, () => this.form.replaceChildren(form));
    this.constants(draft?.constants);
    form.addEventListener('change', (event) => { // only what a column is changes the constants: who goes on to one keeps it
      if (this.rows.some((one) => one.is === event.target) || event.target.dataset.key === 'channel') this.app.keepFocus(this.extra, () => this.constants());
    });
    for (const type of ['input', 'change']) form.addEventListener(type, () => this.later());
    this.tellCommand();
  }

  /** Another base model: its roles are guessed anew, and what belongs to the columns themselves stays. */
  remodel() {
    const { fields, columns } = this.draft();
    this.draw(this.model.value, { fields, columns: columns.map((one) => ({ ...one, name: undefined })), constants: {} });
    this.later();
  }

  // ---------------------------------------------------------------- kept by the server

  /** What is typed. */
  draft() {
    const fields = { name: this.caseName, title: this.title, run: this.run, period: this.period, every: this.every };
    return {
      uploads: this.uploads.map((one) => one.id), base: this.base.name,
      fields: Object.fromEntries(Object.entries(fields).flatMap(([key, input]) => (input ? [[key, input.value]] : []))),
      columns: this.rows.map((one) => ({ column: one.column.name, name: one.is.value, unit: one.unit.value, sigma: one.sigma.value })),
      constants: Object.fromEntries([...this.extra.querySelectorAll('[data-key]')].map((input) => [input.dataset.key, input.value])),
    };
  }

  later() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => { this.keep(); this.tellCommand(); }, KEEP_MS);
  }

  async keep() {
    clearTimeout(this.timer);
    this.timer = 0;
    if (!this.base || !this.uploads.length) return;
    this.keeping = true;
    try { await this.app.api(`uploads/${this.uploads[0].id}/draft`, { method: 'PUT', body: this.draft(), keepalive: true }); } catch { /* the next key tries again */ }
    this.keeping = false;
  }

  /** Go on with what was half done before a reload, or is in another browser. */
  async restore() {
    let all, jobs;
    try { [all, jobs] = await Promise.all([this.app.api('uploads?drafts=true'), this.app.api('jobs')]); } catch { return; } // the list of cases says what is wrong
    const one = all.find((upload) => upload.draft);
    if (!one || (this.uploads.length && this.uploads[0].id !== one.id) || this.job || this.timer || this.keeping || this.form.contains(document.activeElement)) return;
    if (this.base && JSON.stringify(this.draft()) === JSON.stringify(one.draft)) return; // it is what this browser has told
    this.uploads = one.draft.uploads.map((id) => all.find((upload) => upload.id === id)).filter(Boolean);
    await this.map(one.draft);
    const job = jobs.find((found) => found.do === 'make' && found.case === one.draft.fields.name && ['queued', 'running'].includes(found.state));
    if (job) this.follow(job.id);
  }

  event(event) {
    const mine = this.uploads[0]?.id === event.upload;
    if (event.back || (event.state === 'draft' && (!this.uploads.length || mine))) this.restore();
    else if (event.state === 'mapped' && mine && !this.job) this.clear(); // another browser has made the case
  }

  // ---------------------------------------------------------------- one column, and the constants

  row(column, typed) {
    const { h } = this.app, { base } = this;
    const free = base.name === 'equation';
    const names = free ? [] : [...base.channels.map((c) => c.name), ...base.roles.map((r) => r.name)];
    const guess = typed?.name !== undefined ? typed.name : names.includes(column.role_guess) && !(base.name === 'rolling_steady' && column.role_guess === 'voltage') ? column.role_guess : '';
    const is = free ? h('input', { type: 'text', value: typed?.name ?? plain(column.name), 'aria-label': `name of ${column.name}; empty: not mapped` })
      : h('select', { 'aria-label': `what ${column.name} is` }, h('option', { value: '', text: 'not mapped' }),
        h('optgroup', { label: 'measured (predicted by the model)' }, base.channels.map((c) => h('option', { value: c.name, text: c.name, selected: c.name === guess }))),
        h('optgroup', { label: 'inputs' }, base.roles.filter((r) => !base.channels.some((c) => c.name === r.name)).map((r) => h('option', { value: r.name, text: `${r.name}${r.needed ? ' (needed)' : ''}`, selected: r.name === guess }))));
    const canonical = [...base.channels, ...base.roles].find((one) => one.name === guess)?.unit;
    const unit = h('input', { type: 'text', class: 'short', value: typed?.unit ?? (column.unit_guess || canonical || ''), placeholder: '1', 'aria-label': `unit of ${column.name}` });
    const sigma = h('input', { type: 'text', class: 'short', value: typed?.sigma ?? '', inputmode: 'decimal', placeholder: 'estimated', 'aria-label': `noise sd of ${column.name}` });
    const values = column.preview.slice(0, 4).map((v) => (Number.isFinite(Number(v)) ? number(Number(v)) : v)).join('  ');
    const note = column.unit_guess || !canonical ? null : h('span', { class: 'warn small', text: 'unit assumed' });
    return { column, is, unit, sigma, element: h('tr', {}, h('th', { scope: 'row', text: column.name }), h('td', { class: 'soft small', text: values, title: `${number(column.min)} to ${number(column.max)}` }), h('td', {}, is), h('td', {}, unit, note), h('td', {}, sigma)) };
  }

  /** Constants that no table can tell, what is fitted, and the formula of an equation. */
  constants(typed = {}) {
    const { h } = this.app, { base } = this;
    const mapped = this.rows.map((one) => one.is.value).filter(Boolean);
    const kept = (key, value) => typed[key] ?? this.extra.querySelector(`[data-key="${key}"]`)?.value ?? value ?? '';
    const input = (key, value, properties = {}) => h('input', { type: 'text', 'data-key': key, value: kept(key, value), autocomplete: 'off', spellcheck: 'false', ...properties });
    const parts = [];
    if (base.name === 'equation') {
      const channel = h('select', { 'data-key': 'channel' }, mapped.map((name, i) => h('option', { value: name, text: name, selected: kept('channel') ? name === kept('channel') : i === mapped.length - 1 })));
      const others = mapped.filter((name) => name !== channel.value);
      parts.push(h('div', { class: 'four' }, h('label', {}, 'predicted', channel), h('label', { class: 'span' }, 'by the formula', input('formula', others.length ? `offset + gradient*${others[0]}` : 'offset', { required: true }))),
        h('p', { class: 'soft small', text: 'Names that are no columns become parameters to fit.' }));
    } else {
      const fit = fitted(base.fit);
      const roles = base.roles.filter((r) => r.needed && !mapped.includes(r.name) && r.name !== 'omega' && r.name !== 'slip' && r.name !== 'time');
      const names = [...base.parameters.filter((p) => p.name !== fit?.name && p.default === null), ...roles.filter((r) => !base.parameters.some((p) => p.name === r.name)).map((r) => ({ ...r, placeholder: r.name === 'load' ? '20 N' : '' }))];
      if (names.length) {
        parts.push(h('h3', { text: 'Constants that no table can tell' }), h('div', { class: 'four' }, names.map((p) => h('label', {}, `${p.name}${p.unit && p.unit !== '1' ? `, ${p.unit}` : ''}`, input(p.name, p.placeholder, { required: true, 'data-constant': p.name })))));
      }
      if (fit) parts.push(h('p', { class: 'soft small', text: `Fitted: ${fit.name}, from ${fit.value} within ${fit.min} to ${fit.max}.` }));
    }
    this.extra.replaceChildren(...parts);
  }

  /** The case that is asked for; an Error says what is missing. */
  order() {
    const { base } = this;
    const columns = {};
    for (const one of this.rows) {
      if (!one.is.value || (base.name === 'equation' && !/^[A-Za-z_]\w*$/.test(one.is.value))) continue;
      const sigma = one.sigma.value.trim();
      if (columns[one.is.value]) throw new Error(`${one.is.value}: two columns are mapped to it, expected one`);
      if (sigma && !(Number(sigma) > 0)) throw new Error(`noise sd of ${one.column.name}: found ${sigma}, expected a number above 0, or nothing`);
      columns[one.is.value] = { column: one.column.name, unit: one.unit.value.trim(), ...(sigma ? { sigma: Number(sigma) } : {}) };
    }
    const parameters = {}, fit = {}, equation = {};
    for (const input of this.extra.querySelectorAll('[data-constant]')) {
      const text = input.value.trim();
      parameters[input.dataset.constant] = text !== '' && Number.isFinite(Number(text)) ? Number(text) : text;
    }
    if (base.name === 'equation') {
      const formula = this.extra.querySelector('[data-key=formula]').value;
      equation[this.extra.querySelector('[data-key=channel]').value] = formula;
      for (const name of new Set(formula.match(/[A-Za-z_]\w*/g) || [])) {
        if (!columns[name] && !FUNCTIONS.includes(name) && !/^\d/.test(name)) fit[name] = { value: name === 'gradient' ? 1 : 0 };
      }
    } else {
      const found = fitted(base.fit);
      if (found) fit[found.name] = { value: found.value, min: found.min, max: found.max };
    }
    const every = this.every ? this.every.value.trim() : '1';
    if (!/^[1-9]\d{0,6}$/.test(every)) throw new Error(`every n-th row: found ${every}, expected a whole number from 1`);
    return {
      name: this.caseName.value.trim(), title: this.title.value.trim(), base: base.name, uploads: this.data.map((one) => one.id), run: this.run.value, every: Number(every),
      columns, parameters, fit, equation, ...(this.dbc ? { dbc: this.dbc.id } : {}), ...(this.period ? { period: this.period.value.trim() } : {}),
    };
  }

  /** The command line that would make the case as it is mapped now. */
  async tellCommand() {
    if (!this.base || !this.form.firstChild.checkValidity()) return; // Make says what is missing
    let body;
    try { body = this.order(); } catch { return; }
    const turn = (this.turn = (this.turn || 0) + 1);
    try {
      const { command } = await this.app.api('command', { body });
      if (turn !== this.turn || !this.element.isConnected) return;
      this.command = command;
      this.app.showCommand(command);
    } catch { /* Make says what is wrong */ }
  }

  async make() {
    this.problem.replaceChildren();
    let body, started;
    try {
      body = this.order();
      clearTimeout(this.timer);
      await this.keep();
      started = await this.app.api('cases', { body });
    } catch (error) { this.refuse(error.message); return; }
    this.app.showCommand(started.command);
    await this.follow(started.id);
  }

  /** Show how far the job is that makes the case, to its end. */
  async follow(id) {
    const { app } = this, { h } = app;
    this.job = id;
    this.submit.disabled = true;
    const said = h('span', { class: 'line soft' });
    this.making.hidden = false;
    const stop = h('button', { type: 'button', text: 'Cancel', onclick: () => app.cancel(id).catch((error) => this.refuse(error.message)) });
    this.making.replaceChildren(h('progress', { 'aria-label': 'Making the case' }), h('strong', { text: 'Making the case' }), said, stop);
    app.focus(stop); // what was pressed is pressed
    let ended = null;
    try {
      ended = await app.follow(id, (job) => { said.textContent = job.state === 'queued' ? 'waiting for other work' : job.progress.at(-1) || ''; });
    } catch (error) { this.refuse(error.message); }
    const had = this.making.contains(document.activeElement);
    this.job = null;
    this.making.hidden = true;
    this.submit.disabled = false;
    if (ended?.state === 'done') { this.clear(); this.opened(ended.case); return; }
    if (ended) this.refuse(ended.state === 'cancelled' ? 'Cancelled: nothing was made.' : ended.error);
    if (had) app.focus(this.submit);
  }

  refuse(text) { this.problem.replaceChildren(this.app.h('p', { class: 'notice bad', text })); }

  /** Forget the mapping and the files. */
  discard() {
    for (const one of this.uploads) this.app.api(`uploads/${one.id}`, { method: 'DELETE' }).catch((error) => this.tell(one.name, error.message));
    this.clear();
    this.app.focus(this.input);
  }

  clear() {
    clearTimeout(this.timer);
    this.timer = 0;
    this.uploads = [];
    this.base = undefined;
    this.command = '';
    this.form.replaceChildren();
    this.progress.replaceChildren();
  }
}

/** "f_o = { value = 0.05, min = 0.0, max = 0.5 }" as an object; null for none. */
function fitted(line) {
  const found = /^\s*(\w+)\s*=\s*\{(.*)\}\s*$/.exec(line || '');
  if (!found) return null;
  const entries = Object.fromEntries(found[2].split(',').map((part) => part.split('=').map((word) => word.trim())));
  return { name: found[1], value: Number(entries.value), min: Number(entries.min), max: Number(entries.max) };
}
