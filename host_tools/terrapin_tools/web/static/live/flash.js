// Signed images put on the controller that is watched. Its boot loader verifies them, and what runs stays until the new one
// has started well.
import { h } from '../app.js';

const MOST = 180e3; // bytes: a slot has 128 kB

/** The bytes of a file as base64. @param {File} file */
async function base64(file) {
  return btoa([...new Uint8Array(await file.arrayBuffer())].map((byte) => String.fromCharCode(byte)).join(''));
}

export class Flash {
  /** @param {LiveDesk} desk */
  constructor(desk) {
    this.desk = desk;
    /** @type {string | null} */
    this.job = null;
    this.files = h('input', { type: 'file', accept: '.bin', multiple: true, 'aria-label': 'Signed images, one a slot', onchange: () => { this.start.disabled = !this.files.files?.length; } });
    this.start = h('button', { type: 'button', text: 'Flash …', disabled: true, onclick: () => { this.names.textContent = [...this.files.files ?? []].map((file) => file.name).join(', '); this.dialog.showModal(); } });
    this.stop = h('button', { type: 'button', text: 'Cancel', hidden: true, onclick: () => { const { job } = this; if (job) void desk.run(() => desk.app.cancel(job)); } });
    this.names = h('b');
    /** @type {HTMLDialogElement} */
    this.dialog = h('dialog', { 'aria-label': 'Flash the controller' }, h('h2', { text: 'Flash the controller?' }),
      h('p', {}, this.names, ' goes into the slot that is not in use. The motor has to be off; nothing is watched meanwhile. What runs now comes back where the new image does not confirm itself.'),
      h('div', { class: 'row' }, h('button', { type: 'button', class: 'main', text: 'Flash', onclick: () => { this.dialog.close(); void this.go(); } }), h('button', { type: 'button', text: 'Cancel', onclick: () => { this.dialog.close(); } })));
    this.said = h('p', { class: 'soft small', role: 'status', text: 'Images that `terrapin image sign` has signed, one a slot: the right one is taken.' });
    this.element = h('section', { class: 'panel flash-panel', hidden: true }, h('div', { class: 'panel-head' }, h('h2', { text: 'Firmware' })), this.files, h('div', { class: 'row' }, this.start, this.stop), this.said, this.dialog);
  }

  /** Another source, or none. @param {Hello} said */
  begin(said) { this.element.hidden = !this.job && !(said.kind === 'bus' && said.drive); }

  async go() {
    const { app, run, tell } = this.desk, files = [...this.files.files ?? []], large = files.find((file) => file.size > MOST);
    if (large) { tell(`${large.name}: ${Math.round(large.size / 1e3)} kB, expected a signed image of at most 128 kB`); return; }
    this.start.disabled = true;
    const images = await Promise.all(files.map(async (file) => ({ name: file.name, data: await base64(file) })));
    /** @type {Started | null} */
    const started = await run(() => app.api('live/flash', { body: { images } }));
    this.start.disabled = false;
    if (!started) return;
    app.showCommand(started.command);
    await this.follow(started.id);
  }

  /** One that another page started, or this one before a reload. */
  async look() {
    /** @type {Job[] | null} */
    const jobs = await this.desk.run(() => this.desk.app.api('jobs'));
    const mine = jobs?.find((one) => one.do === 'flash' && (one.state === 'running' || one.state === 'queued'));
    if (mine && !this.job) await this.follow(mine.id);
  }

  /** @param {string} id of a job */
  async follow(id) {
    const { app, run } = this.desk;
    this.job = id;
    this.element.hidden = this.stop.hidden = false;
    const ended = await run(() => app.follow(id, (job) => { this.said.textContent = job.progress.at(-1) ?? 'It waits for the controller …'; }));
    this.job = null;
    this.stop.hidden = true;
    const text = !ended ? '' : ended.state === 'done' ? ended.result?.text?.trim() ?? 'done' : ended.state === 'cancelled' ? 'Cancelled: what ran before runs on.' : ended.error ?? 'failed';
    this.said.textContent = text;
    this.said.classList.toggle('bad', ended?.state === 'failed');
    app.announce(text);
  }
}
