// The stop, in the page's head: in sight on every tab, as long as something that can be stopped is watched. It is released
// on the Live tab, where one sees what then happens.
import { told } from '../plots/basics.js';

const STOP_MS = 1000; // after it has become “release”, in which it does not
/** What it does, by how the source is stopped. @type {Record<string, string>} */
export const STOPS = {
  bus: 'Stop sends STOP_ALL: the bridge of every controller on this bus goes off, and stays off whatever else asks for run; the fault stop_all shows it. It is sent again and again until the stop is released, which clears the controller that is watched (one with a link key takes that only from a server that has the key). It needs this computer and the bus, and cuts no power: the red button on the robot works always.',
  simulator: 'Stop opens the emergency stop of the simulated robot until it is released: the bridge goes off in the same tick. A controller that has been stopped wants its faults cleared before it runs again, as the real one does.',
};

/** @param {HTMLElement} button @param {HTMLElement} line where it says that it failed @param {App} app */
export function stopEverywhere(button, line, app) {
  let held = false, heldSince = 0;
  const here = () => location.hash.startsWith('#live');
  const word = () => { told(button, !held ? 'Stop' : here() ? 'Release the stop' : 'Stopped'); };
  /** @param {Stands | null} now */
  const draw = (now) => {
    if (now?.held && !held) heldSince = performance.now();
    held = Boolean(now?.held);
    button.hidden = !now?.stop;
    word();
    button.setAttribute('aria-pressed', String(held));
    button.title = now ? `${held ? 'Release it on the Live tab' : 'Stop'}: ${now.name}${now.driven ? ', driven by a page' : ''}` : '';
  };
  button.addEventListener('click', async () => {
    if (held && !here()) { app.go('live'); return; }
    if (held && performance.now() - heldSince < STOP_MS) return; // a hurried second click does not let go
    try {
      const answer = await app.api('live/command', { body: { request: held ? 'release' : 'idle' } });
      line.textContent = '';
      app.announce(answer.done);
      app.showCommand(answer.command);
    } catch (error) { line.textContent = app.lineOf(error); }
  });
  addEventListener('hashchange', word);
  const ask = () => app.api('live').then((found) => { draw(found.stands); }, () => {}); // whoever asks next says what is wrong
  app.onEvent((event) => { if (event.live !== undefined) draw(event.live); else if (event.back) void ask(); });
  void ask();
}
