"""The script of the report: draws from the page's own data with Plotly, follows theme, choices and cards."""

SCRIPT = """
const D = JSON.parse(document.getElementById('data').textContent);
const $ = id => document.getElementById(id);
const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const label = (name, unit) => unit && unit !== '1' ? name + ', ' + unit : name;
let variable = D.variable, channel = 0, preview = -1, picked = -1;
const held = D.run.map(r => D.held[r]);
const narrow = () => window.innerWidth < 700;
const layout = extra => Object.assign({paper_bgcolor:'rgba(0,0,0,0)', plot_bgcolor:'rgba(0,0,0,0)',
  font:{color:css('--ink'), family:'Inter,system-ui,sans-serif', size:12}, margin:{l:58,r:10,t:8,b:38},
  showlegend:false, hovermode:'closest', hoverlabel:{bgcolor:css('--card'), bordercolor:css('--line'),
  font:{color:css('--ink')}}, modebar:{bgcolor:'rgba(0,0,0,0)', color:css('--soft'), activecolor:css('--blue')}},
  extra);
const axis = (title, extra) => Object.assign({title:{text:title, standoff:6}, gridcolor:css('--line'),
  zerolinecolor:css('--line'), linecolor:css('--line'), automargin:true}, extra);
const config = {displaylogo:false, responsive:true, displayModeBar:'hover',
  modeBarButtons:[['toImage', 'zoom2d', 'pan2d', 'resetScale2d']]};
const quiet = {displayModeBar:false, responsive:true};
function median(list) { const s = [...list].sort((a, b) => a - b); return s.length ? s[s.length >> 1] : 0; }
function rough(line, y, sd) {
  const turns = [];
  for (let i = 1; i + 1 < line.length; i++)
    turns.push(Math.abs(y[line[i]] - (y[line[i - 1]] + y[line[i + 1]]) / 2));
  turns.sort((a, b) => a - b);
  return turns.length ? turns[Math.floor(.9 * turns.length)] / sd : 0;
}
// A prediction is drawn as a line where it is a curve over the variable, over all runs or within each; else as dashes.
// A line breaks where there are no rows.
function curve(x, y, sd) {
  const sorted = list => list.sort((a, b) => x[a] - x[b] || y[a] - y[b]);
  const all = sorted(x.map((_, i) => i)), span = x[all[all.length - 1]] - x[all[0]];
  const gap = new Set(x).size > 40 ? .04 * span : Infinity;
  const broken = line => {
    const parts = [[]];
    line.forEach((i, n) => { if (n && x[i] - x[line[n - 1]] > gap) parts.push([]); parts[parts.length - 1].push(i); });
    return parts;
  };
  const smooth = parts => parts.filter(p => rough(p, y, sd) < .6).length >= .9 * parts.length;
  const whole = broken(all);
  if (new Set(x).size > 3 && smooth(whole)) return whole;
  const byRun = D.runs.map(() => []);
  D.run.forEach((r, i) => byRun[r].push(i));
  const lines = byRun.filter(l => l.length > 2).flatMap(l => broken(sorted(l)));
  if (lines.length && median(lines.map(l => new Set(l.map(i => x[i])).size)) > 3 && smooth(lines)) return lines;
  return null;
}
function joined(lines, v) { return lines.flatMap(l => [...l.map(i => v[i]), null]); }
function model(x, y, name, color, width, dash, sd, unit) {
  const lines = curve(x, y, sd);
  if (lines) return {x:joined(lines, x), y:joined(lines, y), mode:'lines', type:'scatter', name:name, hoverinfo:'skip',
    line:{color:color, width:width, dash:dash}};
  return {x:x, y:y, mode:'markers', type:'scatter', name:name, text:D.run.map(r => D.runs[r]),
    marker:{symbol:'line-ew', size:11, line:{width:width, color:color}},
    hovertemplate:'run %{text}<br>' + name + ' %{y:.4g} ' + unit + '<extra></extra>'};
}
function band(x, y, half, sd) {
  const lines = curve(x, y, sd);
  if (!lines) return [{x:x, y:y, mode:'markers', type:'scatter', hoverinfo:'skip', marker:{opacity:0},
    error_y:{type:'constant', value:half, color:css('--band'), thickness:6, width:0}}];
  return lines.slice(0, 60).map(l => ({x:[...l.map(i => x[i]), ...[...l].reverse().map(i => x[i])],
    y:[...l.map(i => y[i] + half), ...[...l].reverse().map(i => y[i] - half)], type:'scatter', mode:'lines',
    fill:'toself', fillcolor:css('--band'), line:{width:0}, hoverinfo:'skip'}));
}
function dots(x, y, which, name, unit, color) {
  const on = held.map((h, i) => h === which ? i : -1).filter(i => i >= 0), dense = x.length > 600;
  return {x:on.map(i => x[i]), y:on.map(i => y[i]), text:on.map(i => D.runs[D.run[i]]), mode:'markers', type:'scatter',
    name:name, marker:{size:dense ? 5 : 7, symbol:which ? 'diamond-open' : 'circle', color:color,
    opacity:picked < 0 ? (which ? 1 : .6) : on.map(i => D.run[i] === picked ? 1 : .12), line:{width:which ? 1.4 : 0,
    color:color}},
    hovertemplate:'run %{text}<br>' + variable + ' %{x:.4g}<br>%{y:.4g} ' + unit + '<extra>' + name + '</extra>'};
}
function fails(extra) {
  const x = D.columns[variable].values, span = x.reduce((a, v) => [Math.min(a[0], v), Math.max(a[1], v)], [x[0], x[0]]);
  const pad = .012 * (span[1] - span[0]);
  return D.where.filter(w => w.variable === variable && w.channel === D.channels[channel].name).map(w =>
    Object.assign({type:'rect', xref:'x', yref:'paper', x0:w.range[0] - pad, x1:w.range[1] + pad, y0:0, y1:1,
    fillcolor:css('--fail'), line:{width:0}, layer:'below'}, extra));
}
function drawFit() {
  const c = D.channels[channel], x = D.columns[variable].values, unit = D.columns[variable].unit, sd = c.noise_sd;
  const traces = band(x, c.predicted, 1.96 * sd, sd);
  if (c.base) traces.push(model(x, c.base, 'base model', css('--soft'), 1.5, 'dot', sd, c.unit));
  traces.push(dots(x, c.measured, false, 'training', c.unit, css('--ink')),
    dots(x, c.measured, true, 'held out', c.unit, css('--ink')));
  traces.push(model(x, c.predicted, 'model', css('--blue'), 2.2, 'solid', sd, c.unit));
  if (preview >= 0)
    traces.push(model(x, c.previews[preview], 'with ' + D.previews[preview], css('--teal'), 2.2, 'solid', sd, c.unit));
  Plotly.react('overlay', traces, layout({height:narrow() ? 280 : 265, margin:{l:58,r:10,t:24,b:38},
    xaxis:axis(label(variable, unit)),
    yaxis:axis(label(c.name, c.unit)), shapes:fails()}), config);
  const residual = c.measured.map((m, i) => (m - c.predicted[i]) / sd);
  const floor = {type:'rect', xref:'paper', yref:'y', x0:0, x1:1, y0:-1.96, y1:1.96, fillcolor:css('--floor'),
    line:{width:0}, layer:'below'};
  const left = [dots(x, residual, false, 'training', 'sd', css('--ink')), dots(x, residual, true, 'held out', 'sd',
    css('--ink'))];
  if (preview >= 0) left.push({x:x, y:c.measured.map((m, i) => (m - c.previews[preview][i]) / sd), mode:'markers',
    type:'scatter', marker:{size:4, color:css('--teal')}, opacity:.8, name:'left over', hoverinfo:'skip'});
  Plotly.react('residual', left, layout({height:200, xaxis:axis(label(variable, unit)),
    yaxis:axis('noise sd'), shapes:[floor, ...fails()]}), quiet);
  const mine = D.where.find(w => w.variable === variable && w.channel === c.name);
  $('range').textContent = !mine ? '' :
    'fails ' + [...new Set(mine.range.map(v => v.toPrecision(4) * 1))].join(' to ');
  $('previewed').hidden = preview < 0;
  $('previewed').textContent = preview < 0 ? '' : '\\u2501 with ' + D.previews[preview];
}
function drawLadder() {
  const names = D.ladder.map(r => r.added === null ? 'base' :
    '+ ' + r.added.replaceAll('_', ' ').replaceAll('+', '<br>+ '));
  const values = D.ladder.flatMap(r => [r.train_error, r.heldout_error]).filter(v => v > 0);
  const log = Math.max(...values) > 12, top = Math.max(...values, 1.2);
  const text = v => v === null ? '' : v >= 100 ? v.toFixed(0) : v.toPrecision(3);
  const bars = (key, color, title) => ({x:names, y:D.ladder.map(r => r[key]), type:'bar', name:title,
    marker:{color:color}, text:D.ladder.map(r => text(r[key])), textposition:'outside', cliponaxis:false,
    textfont:{size:11}, hovertemplate:'%{x}<br>%{y:.3g} noise sd<extra>' + title + '</extra>'});
  const floor = log ? Math.min(.5, ...values.map(v => v * .8)) : 0;
  Plotly.react('ladder', [bars('train_error', css('--mute'), 'training'), bars('heldout_error', css('--blue'),
    'held out')], layout({height:200, barmode:'group', bargap:.3, margin:{l:40,r:6,t:16,b:40}, yaxis:axis('',
    log ? {type:'log', dtick:1, range:[Math.log10(floor), Math.log10(top * 2)]} : {range:[0, top * 1.15]}),
    xaxis:axis('', {tickangle:0, type:'category'}), shapes:[{type:'line', xref:'paper', x0:0, x1:1, y0:1, y1:1,
    line:{color:css('--teal'), width:1.8, dash:'dash'}}]}), quiet);
}
function drawHeat() {
  const h = D.heat.columns[variable], c = D.channels[channel].name;
  $('heatbox').hidden = !h;
  if (!h) return;
  const short = v => String(+v.toPrecision(3)), z = h.mean[c], bins = z[0].length;
  const name = i => h.single ? short(h.edges[i]) : short(h.edges[i]) + ' to ' + short(h.edges[i + 1]);
  const size = Math.max(3, ...z.flat().filter(v => v !== null).map(Math.abs));
  const runs = D.heat.runs.map(r => D.runs[r] + (D.held[r] ? ' \u25c7' : ''));
  const scale = [[0, css('--cold')], [.5, css('--card')], [1, css('--hot')]];
  const at = z[0].map((_, i) => i), every = Math.ceil(bins / (narrow() ? 4 : 8));
  const hover = 'run %{y}<br>' + variable + ' %{customdata}<br>mean residual %{z:.2g} noise sd<extra></extra>';
  Plotly.react('heat', [{type:'heatmap', x:at, y:runs, z:z, zmin:-size, zmax:size, colorscale:scale, xgap:1, ygap:1,
    customdata:h.count.map(row => row.map((n, i) => name(i) + ', ' + n + ' rows')), hoverongaps:false,
    hovertemplate:hover, colorbar:{thickness:10, len:.9, outlinewidth:0, title:{text:'sd', side:'top'}}}],
    layout({height:Math.min(640, 80 + Math.max(9, 26 - runs.length / 2) * runs.length), margin:{l:58,r:8,t:6,b:40},
    xaxis:axis(label(variable, D.columns[variable].unit), {tickvals:at.filter(i => i % every === 0),
    ticktext:at.filter(i => i % every === 0).map(name), tickfont:{size:10}, showgrid:false, zeroline:false}),
    yaxis:axis('', {type:'category', autorange:'reversed', tickfont:{size:10}, showgrid:false})}), quiet);
}
function draw() { drawFit(); drawLadder(); drawHeat(); }
for (const [id, set] of [['variable', v => { variable = v; }], ['channel', v => { channel = +v; }]]) {
  const select = $(id);
  if (select) select.addEventListener('change', () => { set(select.value); draw(); });
}
for (const card of document.querySelectorAll('button[data-preview]')) card.addEventListener('click', () => {
  preview = preview === +card.dataset.preview ? -1 : +card.dataset.preview;
  for (const other of document.querySelectorAll('button[data-preview]'))
    other.setAttribute('aria-pressed', String(+other.dataset.preview === preview));
  drawFit();
});
function theme(name) { document.documentElement.dataset.theme = name; draw(); }
$('theme').addEventListener('click', () => theme(css('--name') === 'dark' ? 'light' : 'dark'));
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', draw);
const first = document.querySelector('button.all, .card.named[data-preview]');
if (first) first.click(); else draw();
if (first) draw();
$('heat').on && $('heat').on('plotly_click', e => {
  const r = D.heat.runs[e.points[0].pointIndex[0]];
  picked = picked === r ? -1 : r;
  drawFit();
});
"""
