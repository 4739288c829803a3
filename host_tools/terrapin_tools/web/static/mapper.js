// Measurements into a case: drop files, see what was guessed of their columns, correct it, make the case.
// What is typed is kept by the server beside the first of the files (its draft), so that a reload loses nothing.
import { lineOf } from './app.js';
import { MapForm } from './mapping/map_form.js';
import { asQuery, choices } from './mapping/map_read.js';

const KEEP_MS = 300; // after the last key, before what is typed is kept

export class Mapper {
  /** `opened(name)` is called with the case that was made. @param {App} app @param {(name: string) => void} opened */
  constructor(app, opened) {
    this.app = app;
    this.opened = opened;
    /** @type {Upload[]} */
    this.uploads = [];
    /** @type {Base[] | undefined} */
    this.bases = undefined;
    /** @type {MapForm | null} */
    this.sheet = null;
    /** @type {string | null} */
    this.job = null; // that makes the case
    this.command = '';
    this.timer = this.turn = 0;
    this.keeping = false;
    const { h } = app;
    this.input = h('input', { type: 'file', multiple: true, class: 'visually-hidden', id: 'files', onchange: () => { this.send(this.input.files); this.input.value = ''; } });
    this.zone = h('div', { class: 'drop' },
      h('p', {}, h('strong', { text: 'New case: drop measurements here' })),
      h('p', { class: 'soft small', text: 'CSV, a spreadsheet, MATLAB, HDF5, Parquet, ...; or a CAN log (candump, BLF, ASC, MF4, MCAP) with its DBC' }),
      this.input, h('label', { for: 'files', class: 'button', text: 'Choose files…' }));
    this.progress = h('div', { 'aria-live': 'polite' });
    this.form = h('div');
    this.element = h('section', { 'aria-label': 'New case from measurements' }, this.zone, this.progress, this.form);
    addEventListener('pagehide', () => { if (this.timer) this.keep(); });
    this.restore();
    for (const type of ['dragenter', 'dragover']) this.zone.addEventListener(type, (event) => { event.preventDefault(); this.zone.classList.add('over'); });
    for (const type of ['dragleave', 'drop']) this.zone.addEventListener(type, () => this.zone.classList.remove('over'));
    this.zone.addEventListener('drop', (event) => { event.preventDefault(); this.send(event.dataTransfer?.files); });
  }

  // ---------------------------------------------------------------- sending

  /** @param {FileList | null | undefined} files */
  async send(files) {
    if (!files) return;
    const all = Array.from(files); // an input's list is emptied with it, while the first is on its way
    for (const file of all) {
      try { this.uploads.push(await this.upload(file)); } catch (error) { this.doubt(file, lineOf(error)); continue; }
    }
    if (!this.uploads.length) return;
    await this.map(this.draft()); // what is typed already stays
    this.keep();
  }

  /** A file that was refused: why, and the readings between which to choose where there are two. @param {File} file @param {string} text */
  doubt(file, text) {
    const { h } = this.app, said = this.tell(file.name, text);
    for (const reading of choices(text)) {
      const [[key, value]] = Object.entries(reading);
      said.append(' ', h('button', { type: 'button', text: `Read it with ${key} ${value}`, onclick: async () => {
        said.remove();
        try { this.uploads.push(await this.upload(file, reading)); } catch (error) { this.doubt(file, lineOf(error)); return; }
        const draft = this.draft() ?? { base: '', fields: {}, columns: [], constants: {} };
        await this.map({ ...draft, fields: { ...draft.fields, [`read_${key}`]: value } });
        this.keep();
      } }));
    }
  }

  /** Look at the files again, read as somebody says. @param {Record<string, string>} reading */
  async reread(reading) {
    if (!this.sheet) return;
    const { sheet } = this, { fields, constants } = sheet.draft();
    sheet.problem.replaceChildren();
    try {
      this.uploads = await Promise.all(this.uploads.map((one) => (one.kind === 'dbc' || one.kind === 'log' ? one : this.app.api(`uploads/${one.id}/preview?dbc=${asQuery(reading)}`))));
    } catch (error) { sheet.refuse(lineOf(error)); return; }
    await this.map({ base: '', fields, columns: [], constants }); // of other columns the guesses are new
    this.keep();
  }

  /** XMLHttpRequest, because fetch does not say how far it has sent. @param {File} file @param {Record<string, string>} reading @returns {Promise<Upload>} */
  upload(file, reading = {}) {
    const { h } = this.app;
    const request = new XMLHttpRequest();
    const bar = h('progress', { max: '1', value: 0, 'aria-label': `sending ${file.name}` }), said = h('span', { class: 'line soft', text: 'sending' });
    const row = h('div', { class: 'job' }, bar, h('strong', { text: file.name }), said, h('button', { type: 'button', text: 'Cancel', onclick: () => request.abort() }));
    this.progress.append(row);
    return /** @type {Promise<Upload>} */ (new Promise((resolve, reject) => {
      request.open('POST', `/api/uploads?name=${encodeURIComponent(file.name)}${asQuery(reading)}`);
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
    })).finally(() => row.remove());
  }

  /** @param {string} name of a file @param {string} text */
  tell(name, text) {
    const { h } = this.app;
    /** @type {HTMLElement} */
    const said = h('p', { class: 'notice bad', role: 'alert' }, h('b', { text: name }), `:${text.startsWith(`${name}:`) ? text.slice(name.length + 1) : ` ${text}`} `, h('button', { type: 'button', class: 'quiet', text: 'Dismiss', onclick: () => { said.remove(); } }));
    this.progress.append(said);
    return said;
  }

  // ---------------------------------------------------------------- mapping

  /** Show the form for what was sent; `draft`: what was typed in it before. @param {Omit<MapDraft, 'uploads'> | null} draft */
  async map(draft) {
    this.bases ??= /** @type {Base[]} */ (await this.app.api('bases'));
    const data = this.uploads.filter((one) => one.kind !== 'dbc'), dbc = this.uploads.find((one) => one.kind === 'dbc');
    if (!data.length) { this.form.replaceChildren(this.app.h('p', { class: 'notice', text: `${dbc?.name} is here: now drop the log that it describes.` })); return; }
    let [first] = data;
    const reading = Object.fromEntries(Object.entries(draft?.fields ?? {}).flatMap(([key, value]) => (key.startsWith('read_') && value ? [[key.slice(5), value]] : [])));
    if (first.kind === 'log' && dbc) {
      try { first = await this.app.api(`uploads/${first.id}/preview?dbc=${dbc.id}`); } catch (error) { this.tell(first.name, lineOf(error)); }
    }
    if (first.kind !== 'log' && Object.keys(reading).length) {
      try { first = await this.app.api(`uploads/${first.id}/preview?dbc=${asQuery(reading)}`); } catch (error) { this.tell(first.name, lineOf(error)); }
    }
    /** @type {Suiting | null} */
    let suiting = null;
    if (first.kind !== 'log') { // which model is fitted best, as the command line says it; without an answer the names decide
      try { suiting = await this.app.api(`uploads/${first.id}/bases?${asQuery(reading).slice(1)}`); } catch { suiting = null; }
    }
    this.draw({ bases: this.bases, data, dbc, first, suiting }, draft?.base || suiting?.base || first.base_guess || '', draft);
  }

  /** What each file holds, as `terrapin look` says it. @param {MapSource} source @returns {Promise<string>} */
  async look({ data, dbc }) {
    const found = [];
    for (const one of data) {
      const bus = one.kind === 'log' ? `?dbc=${dbc?.id ?? ''}` : `?dbc=${asQuery(this.sheet?.reading?.said() ?? {})}`;
      try { found.push((await this.app.api(`uploads/${one.id}/look${bus}`)).lines.join('\n')); } catch (error) { found.push(lineOf(error)); }
    }
    return found.join('\n\n');
  }

  /** The form for a base model. @param {MapSource} source @param {string} base @param {Partial<MapTyped> | null} draft */
  draw(source, base, draft) {
    const sheet = new MapForm(source, base, draft, {
      make: () => this.make(), discard: () => this.discard(), later: () => this.later(), remodel: () => this.remodel(source), reread: (reading) => { void this.reread(reading); },
      look: (show) => { this.look(source).then(show); },
    });
    this.sheet = sheet;
    this.app.keepFocus(this.form, () => this.form.replaceChildren(sheet.element));
    sheet.constants(draft?.constants);
    sheet.element.addEventListener('change', (event) => { // only what a column is changes the constants: who goes on to one keeps it
      const changed = /** @type {HTMLElement} */ (event.target);
      if (sheet.rows.some((one) => one.is === changed || (sheet.base.own_dynamics && one.unit === changed)) || changed.dataset.key === 'channel') this.app.keepFocus(sheet.extra, () => sheet.constants());
    });
    this.tellCommand();
  }

  /** Another base model: its roles are guessed anew, and what belongs to the columns themselves stays. @param {MapSource} source */
  remodel(source) {
    if (!this.sheet) return;
    const { fields, columns } = this.sheet.draft();
    this.draw(source, this.sheet.model.value, { fields, columns: columns.map((one) => ({ ...one, name: undefined })), constants: {} });
    this.later();
  }

  // ---------------------------------------------------------------- kept by the server

  /** What is typed; null when there is no form. @returns {MapDraft | null} */
  draft() {
    return this.sheet ? { uploads: this.uploads.map((one) => one.id), base: this.sheet.base.name, ...this.sheet.draft() } : null;
  }

  later() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => { this.keep(); this.tellCommand(); }, KEEP_MS);
  }

  async keep() {
    clearTimeout(this.timer);
    this.timer = 0;
    if (!this.sheet || !this.uploads.length) return;
    this.keeping = true;
    try { await this.app.api(`uploads/${this.uploads[0].id}/draft`, { method: 'PUT', body: this.draft(), keepalive: true }); } catch { /* the next key tries again */ }
    this.keeping = false;
  }

  /** Go on with what was half done before a reload, or is in another browser. */
  async restore() {
    /** @type {Upload[]} */
    let all;
    /** @type {Job[]} */
    let jobs;
    try { [all, jobs] = await Promise.all([this.app.api('uploads?drafts=true'), this.app.api('jobs')]); } catch { return; } // the list of cases says what is wrong
    const one = all.find((upload) => upload.draft), draft = one?.draft;
    if (!one || !draft || (this.uploads.length && this.uploads[0].id !== one.id) || this.job || this.timer || this.keeping || this.form.contains(document.activeElement)) return;
    if (this.sheet && JSON.stringify(this.draft()) === JSON.stringify(draft)) return; // it is what this browser has told
    this.uploads = draft.uploads.map((id) => all.find((upload) => upload.id === id)).filter((upload) => upload !== undefined);
    await this.map(draft);
    const job = jobs.find((found) => found.do === 'make' && found.case === draft.fields.name && ['queued', 'running'].includes(found.state));
    if (job) this.follow(job.id);
  }

  /** @param {News} event */
  event(event) {
    const mine = this.uploads[0]?.id === event.upload;
    if (event.back || (event.state === 'draft' && (!this.uploads.length || mine))) this.restore();
    else if (event.state === 'mapped' && mine && !this.job) this.clear(); // another browser has made the case
  }

  /** The command line that would make the case as it is mapped now. */
  async tellCommand() {
    if (!this.sheet?.element.checkValidity()) return; // Make says what is missing
    let body;
    try { body = this.sheet.order(); } catch { return; }
    const turn = ++this.turn;
    try {
      const { command } = await this.app.api('command', { body });
      if (turn !== this.turn || !this.element.isConnected) return;
      this.command = command;
      this.app.showCommand(command);
    } catch { /* Make says what is wrong */ }
  }

  async make() {
    if (!this.sheet) return;
    const { sheet } = this;
    sheet.problem.replaceChildren();
    /** @type {Started} */
    let started;
    try {
      const body = sheet.order();
      clearTimeout(this.timer);
      await this.keep();
      started = await this.app.api('cases', { body });
    } catch (error) { sheet.refuse(lineOf(error)); return; }
    this.app.showCommand(started.command);
    await this.follow(started.id);
  }

  /** Show how far the job is that makes the case, to its end. @param {string} id */
  async follow(id) {
    const { app, sheet } = this, { h } = app;
    if (!sheet) return;
    this.job = id;
    sheet.submit.disabled = true;
    const said = h('span', { class: 'line soft' });
    sheet.making.hidden = false;
    const stop = h('button', { type: 'button', text: 'Cancel', onclick: () => app.cancel(id).catch((error) => sheet.refuse(lineOf(error))) });
    sheet.making.replaceChildren(h('progress', { 'aria-label': 'Making the case' }), h('strong', { text: 'Making the case' }), said, stop);
    app.focus(stop); // what was pressed is pressed
    /** @type {Job | null} */
    let ended = null;
    try {
      ended = await app.follow(id, (job) => { said.textContent = job.state === 'queued' ? 'waiting for other work' : job.progress.at(-1) || ''; });
    } catch (error) { sheet.refuse(lineOf(error)); }
    const had = sheet.making.contains(document.activeElement);
    this.job = null;
    sheet.making.hidden = true;
    sheet.submit.disabled = false;
    if (ended?.state === 'done') { this.clear(); this.opened(ended.case || ''); return; }
    if (ended) sheet.refuse(ended.state === 'cancelled' ? 'Cancelled: nothing was made.' : ended.error || 'failed');
    if (had) app.focus(sheet.submit);
  }

  /** Forget the mapping and the files. */
  discard() {
    for (const one of this.uploads) this.app.api(`uploads/${one.id}`, { method: 'DELETE' }).catch((error) => this.tell(one.name, lineOf(error)));
    this.clear();
    this.app.focus(this.input);
  }

  clear() {
    clearTimeout(this.timer);
    this.timer = 0;
    this.uploads = [];
    this.sheet = null;
    this.command = '';
    this.form.replaceChildren();
    this.progress.replaceChildren();
  }
}
