// A report's plots: the page's own, drawn from the data in the report.
import { css } from './basics.js';
import { CasePlots } from './case_plots.js';
import { heat } from './heat.js';
import { Ladder } from './ladder.js';

/** @param {string} id */
const $ = (id) => /** @type {HTMLElement} */ (document.getElementById(id));
/** @type {ReportData} */
const data = JSON.parse($('data').textContent);
let preview = -1; // which of data.previews is shown

const plots = new CasePlots(draw), ladder = new Ladder($('ladder'));
plots.take({ title: '', base: '', effects: [], runs: data.runs.length, held_out: [], plot: data });

function draw() {
  const channels = Object.fromEntries(data.channels.map((c) => [c.name, c.previews[preview]]));
  plots.draw(preview < 0 ? null : { effects: data.sets[preview], channels });
  ladder.show(data.ladder);
  const map = heat(data, data.by_run, plots.variable, plots.channel, (run) => plots.pickRun(run));
  $('heat').replaceChildren(...(map ? [map] : []));
}

const buttons = /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll('button[data-preview]'));
for (const button of buttons) {
  button.addEventListener('click', () => {
    preview = preview === Number(button.dataset.preview) ? -1 : Number(button.dataset.preview);
    for (const other of buttons) other.setAttribute('aria-pressed', String(Number(other.dataset.preview) === preview));
    draw();
  });
}
const dark = matchMedia('(prefers-color-scheme: dark)');
$('theme').addEventListener('click', () => { document.documentElement.dataset.theme = css('--name') === 'dark' ? 'light' : 'dark'; draw(); });
dark.addEventListener('change', draw);

$('overlay').replaceChildren(plots.overlayPanel);
$('residual').replaceChildren(plots.residualPanel);
const first = /** @type {HTMLElement | null} */ (document.querySelector('button.all, .card.named[data-preview]'));
if (first) first.click(); else draw();
