// The panel that records what is watched into the workspace's folder logs.
import { h, told } from '../app.js';

const size = (/** @type {number} */ b) => (b < 1e6 ? `${(b / 1e3).toFixed(0)} kB` : `${(b / 1e6).toFixed(1)} MB`);

export class Recorder {
  /** `recorded` is called when a log has ended. @param {LiveDesk} desk @param {() => void} recorded */
  constructor(desk, recorded) {
    this.desk = desk;
    this.recorded = recorded;
    this.on = false;
    this.name = h('input', { type: 'text', 'aria-label': 'Name of the log', maxlength: '56' });
    this.kind = h('select', { 'aria-label': 'Kind of log' }, ...['.mf4', '.mcap', '.blf', '.log'].map((k) => h('option', { value: k, text: k })));
    this.button = h('button', { type: 'button', text: 'Record', onclick: () => this.toggle() });
    this.said = h('p', { class: 'soft small' });
    this.element = h('section', { class: 'panel' }, h('div', { class: 'panel-head' }, h('h2', { text: 'Record' })), h('div', { class: 'record-row' }, this.name, this.kind, this.button), this.said);
    this.newName();
  }

  newName() {
    const d = new Date(), two = (/** @type {number} */ n) => String(n).padStart(2, '0');
    this.name.value = `live-${d.getFullYear()}${two(d.getMonth() + 1)}${two(d.getDate())}-${two(d.getHours())}${two(d.getMinutes())}${two(d.getSeconds())}`;
  }

  /** Another source, or none. @param {boolean} watched */
  begin(watched) {
    this.on = false;
    this.button.disabled = !watched;
  }

  /** @param {Status} now */
  draw(now) {
    const { recording, last_log: done } = now;
    this.on = Boolean(recording);
    told(this.button, recording ? 'End the log' : 'Record');
    this.button.setAttribute('aria-pressed', String(this.on));
    this.button.classList.toggle('recording', this.on);
    this.button.disabled = !recording && now.state !== 'live';
    this.name.disabled = this.kind.disabled = this.on;
    told(this.said, recording ? `${recording.name}: ${recording.frames.toLocaleString('en')} frames, ${size(recording.bytes)}, ${recording.seconds.toFixed(0)} s`
      : done ? `${done.name} holds ${done.frames.toLocaleString('en')} frames, ${size(done.bytes)}; it is among the sources now.` : 'Into the workspace’s folder logs. A crash costs the last half second at most.');
  }

  async toggle() {
    const { app, run } = this.desk, { on } = this;
    /** @type {(Recording & { command: string }) | null} */
    const answer = await run(() => app.api('live/record', { body: on ? { do: 'stop' } : { do: 'start', name: this.name.value.trim() + this.kind.value } }));
    if (!answer) return;
    if (answer.command) app.showCommand(answer.command);
    app.announce(on ? `${answer.name} ended with ${answer.frames} frames` : `recording ${answer.name}`);
    if (on) { this.newName(); this.recorded(); }
  }
}
