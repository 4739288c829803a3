// What the server sends of the source that is watched: its signals, pictures of their values, and how it stands.
import { Ring } from '../strip.js';

const HEAD = 32; // bytes of a picture's head
const SAMPLES = 1; // a picture of what is new; else of the past
const SLOWEST_MS = 8000; // between tries to connect

/** What a Telemetry tells. @typedef {{ hello(said: Hello): void, status(said: Status): void, until(time: number, anew?: boolean): void, tell(text: string): void }} Listener */

export class Telemetry {
  /** @param {App} app @param {Listener} listener */
  constructor(app, listener) {
    this.app = app;
    this.listener = listener;
    this.shown = false;
    /** @type {Map<string, Ring>} */
    this.rings = new Map(); // of the signals that were ever looked at
    /** @type {WebSocket | null} */
    this.socket = null;
    this.wait = 500; // ms
    /** @type {(number | null)[]} */
    this.values = [];
    /** @type {Hello | null} */
    this.hello = null;
    /** @type {Signal[]} */
    this.signals = [];
    /** @type {Map<string, number>} */
    this.index = new Map(); // of the signals, by name
    this.epoch = this.frames = this.missed = this.skipped = this.last = 0;
    /** @type {number | null} */
    this.next = null; // frame
  }

  /** Forget what was watched; null: nothing is watched now. @param {Hello | null} said */
  begin(said) {
    this.hello = said;
    this.signals = (said?.signals || []).map((s) => ({ ...s, words: s.words && Object.fromEntries(Object.entries(s.words).map(([word, value]) => [value, word])) }));
    this.index = new Map(this.signals.map((s, i) => [s.name, i]));
    this.epoch = this.frames = this.missed = this.skipped = this.last = 0;
    this.next = null;
    this.rings.clear();
  }

  open() {
    this.shown = true;
    if (!this.socket) this.connect();
  }

  /** To the server, as far as it is there. @param {object} message */
  send(message) { if (this.socket?.readyState === 1) this.socket.send(JSON.stringify(message)); }

  close() {
    this.shown = false;
    if (this.socket?.readyState === 1) this.socket.close(); // one that still connects closes when it is open: else the browser warns
  }

  connect() {
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    const token = this.app.token();
    const socket = new WebSocket(`${scheme}://${location.host}/api/live/socket${token ? `?token=${encodeURIComponent(token)}` : ''}`);
    this.socket = socket;
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => { this.wait = 500; if (!this.shown) socket.close(); };
    socket.onmessage = (message) => {
      if (typeof message.data !== 'string') { this.picture(message.data); return; }
      /** @type {Hello | Status} */
      const said = JSON.parse(message.data);
      if (said.type === 'hello') { this.begin(said.name === null ? null : said); this.listener.hello(said); return; }
      this.values = said.values;
      this.listener.status(said);
    };
    socket.onclose = (event) => {
      if (event.reason) this.listener.tell(`Live view: ${event.reason}`);
      this.socket = null;
      if (this.shown) { setTimeout(() => { if (this.shown && !this.socket) this.connect(); }, this.wait); this.wait = Math.min(SLOWEST_MS, this.wait * 2); }
    };
  }

  /** Ask for the points of these signals; their rings. @param {string[]} names that are known */
  want(names) {
    const rings = names.map((name) => {
      const ring = this.rings.get(name) || new Ring();
      this.rings.set(name, ring);
      return ring;
    });
    for (const name of this.rings.keys()) if (!names.includes(name)) this.rings.delete(name);
    this.send({ want: names.map((name) => this.index.get(name)) });
    return rings;
  }

  /** Take the points of a picture. Its layout: terrapin_tools/web/live/picture.py. @param {ArrayBuffer} buffer */
  picture(buffer) {
    const view = new DataView(buffer);
    const kind = view.getUint8(1), columns = view.getUint16(2, true), count = view.getUint32(4, true), epoch = view.getUint32(8, true), frames = view.getUint32(12, true);
    const first = view.getFloat64(16, true), base = view.getFloat64(24, true);
    if (epoch !== this.epoch) { this.epoch = epoch; for (const ring of this.rings.values()) ring.clear(); this.listener.until(base, true); }
    if (kind === SAMPLES) {
      if (this.next !== null) { this.missed += Math.max(0, first - this.next); this.skipped += Math.max(0, count - this.last - 1); }
      this.next = first + frames; this.frames += frames; this.last = count;
      this.listener.until(base);
      if (this.socket?.readyState === 1) this.socket.send(`{"seen":${count}}`);
    }
    let at = HEAD;
    for (let c = 0; c < columns; c++) {
      const signal = this.signals[view.getUint16(at, true)], points = view.getUint16(at + 2, true);
      at += 4;
      const ring = signal ? this.rings.get(signal.name) : null;
      if (ring && kind !== SAMPLES) ring.clear();
      if (ring) for (let p = 0; p < points; p++) ring.push(base + view.getFloat32(at + 8 * p, true), view.getFloat32(at + 8 * p + 4, true));
      at += 8 * points;
    }
  }

  /** The value of a signal; null where there is none. @param {string} name */
  value(name) {
    const i = this.index.get(name);
    return i === undefined ? null : this.values[i] ?? null;
  }

  /** The word that stands for a signal's value, or null. @param {string} name */
  word(name) {
    const i = this.index.get(name), value = this.value(name);
    return i === undefined || value === null ? null : this.signals[i].words?.[value] ?? null;
  }
}
