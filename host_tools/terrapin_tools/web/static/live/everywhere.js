// The stop in the page's head: on every tab, as long as something that can be stopped is watched.

/** @param {HTMLElement} button @param {App} app */
export function stopEverywhere(button, app) {
  let held = false;
  /** @param {Stands | null} now */
  const draw = (now) => {
    held = Boolean(now?.held);
    button.hidden = !now?.stop;
    button.textContent = held ? 'Stopped' : 'Stop';
    button.setAttribute('aria-pressed', String(held));
    button.title = now ? `${held ? 'Release it on the Live tab' : 'Stop'}: ${now.name}${now.driven ? ', driven by a page' : ''}` : '';
  };
  button.addEventListener('click', async () => {
    if (held) { app.go('live'); return; }
    try { app.announce((await app.api('live/command', { body: { request: 'idle' } })).done); } catch (error) { app.announce(app.lineOf(error)); }
  });
  const ask = () => app.api('live').then((found) => { draw(found.stands); }, () => {}); // whoever asks next says what is wrong
  app.onEvent((event) => { if (event.live !== undefined) draw(event.live); else if (event.back) void ask(); });
  void ask();
}
