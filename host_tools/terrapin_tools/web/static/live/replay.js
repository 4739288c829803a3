// Where in a log the replay is: a slider to seek, its speed, and whether it begins anew at its end.
import { h, told } from '../app.js';

export class Replay {
  /** @param {LiveDesk} desk */
  constructor(desk) {
    this.desk = desk;
    this.held = false; // somebody moves the slider
    this.place = h('input', { type: 'range', min: '0', max: '1', step: 'any', value: '0', 'aria-label': 'Place in the log', oninput: () => { this.held = true; }, onchange: () => this.seek() });
    this.speed = h('select', { 'aria-label': 'Speed of the replay', onchange: () => { void this.ask({ speed: Number(this.speed.value) }); } }, ...[0.1, 0.5, 1, 2, 5, 10, 100].map((s) => h('option', { value: String(s), text: `${s} ×` })));
    this.loop = h('input', { type: 'checkbox', onchange: () => { void this.ask({ loop: this.loop.checked }); } });
    this.said = h('output', { class: 'soft small' });
    this.element = h('section', { class: 'panel replay-bar', hidden: true, 'aria-label': 'Replay' }, h('b', { text: 'Replay' }), this.place, this.said, this.speed, h('label', { class: 'row' }, this.loop, 'loop'));
  }

  /** Another source, or none. @param {Hello} said */
  begin(said) { this.element.hidden = said.name === null || said.kind !== 'log'; this.held = false; }

  async seek() { await this.ask({ position: Number(this.place.value) }); this.held = false; }

  /** @param {object} body */
  async ask(body) {
    const { app, run } = this.desk;
    const answer = await run(() => app.api('live/replay', { body }));
    if (answer) app.showCommand(answer.command);
  }

  /** @param {Status} now */
  draw(now) {
    const { replay } = now;
    if (!replay) return;
    this.place.disabled = replay.length === null;
    this.place.max = String(replay.length ?? 1);
    if (!this.held) this.place.value = String(replay.position);
    if (document.activeElement !== this.speed) this.speed.value = String(replay.speed);
    this.loop.checked = replay.loop;
    const text = `${replay.position.toFixed(1)} of ${replay.length === null ? '…' : replay.length.toFixed(1)} s`;
    told(this.said, text);
  }
}
