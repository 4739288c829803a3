"""The frame of the report: style and script of the page, with places for text ($name) and data."""

from __future__ import annotations

from string import Template

__all__ = ["PAGE"]

STYLE = """
:root{--bg:#f6f7f9;--card:#fff;--ink:#1b2430;--soft:#5b6573;--line:#e0e4ea;--blue:#2a66d1;--teal:#0d7a70;--amber:#a86500;
--red:#c73650;--fail:rgba(214,69,93,.10);--floor:rgba(17,138,126,.16);color-scheme:light dark}
@media (prefers-color-scheme:dark){:root{--bg:#12161c;--card:#1a2028;--ink:#e8edf3;--soft:#9aa7b7;--line:#2a323d;
--blue:#6aa1ff;--teal:#3cc4b4;--amber:#ffb648;--red:#ff7088;--fail:rgba(255,112,136,.14);--floor:rgba(60,196,180,.16)}}
*{box-sizing:border-box}
body{margin:0;background:var(--bg);color:var(--ink);font:14px/1.45 Inter,system-ui,-apple-system,"Segoe UI",sans-serif}
header{display:flex;align-items:center;gap:8px 18px;flex-wrap:wrap;padding:10px 20px;background:var(--card);
border-bottom:1px solid var(--line)}
header h1{font-size:16px;margin:0}header .what{color:var(--soft)}
.verdict{margin-left:auto;padding:4px 12px;border-radius:14px;font-weight:600;border:1px solid currentColor}
.verdict.adequate{color:var(--teal)}.verdict.missing{color:var(--red)}
main{display:grid;grid-template-columns:minmax(0,1fr) 380px;gap:14px;padding:14px 20px;max-width:1600px;margin:auto}
@media (max-width:900px){main{grid-template-columns:minmax(0,1fr)}}
section{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:10px 14px;margin-bottom:14px}
h2{margin:0 0 4px;font-size:13px;color:var(--soft);font-weight:600;display:flex;gap:10px;align-items:center;
flex-wrap:wrap}
h2 label{margin-left:auto;font-weight:400}select{font:inherit;color:var(--ink);background:var(--card);
border:1px solid var(--line);border-radius:6px;padding:2px 6px;max-width:180px}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
th{text-align:left;color:var(--soft);font-weight:600;font-size:12px}td,th{padding:3px 8px 3px 0;vertical-align:top}
tbody tr{border-top:1px solid var(--line)}td.n,th.n{text-align:right}
.warn{color:var(--amber)}.soft{color:var(--soft)}p{margin:6px 0}ul{margin:6px 0;padding-left:18px}
code{font:12px ui-monospace,monospace;background:var(--bg);border-radius:5px;padding:1px 5px;overflow-wrap:anywhere}
.wide{grid-column:1/-1}.notes{max-width:75ch}.notes h3{font-size:15px;margin:12px 0 4px}.notes h4{margin:12px 0 4px}
.bar{height:6px;border-radius:3px;background:var(--line);overflow:hidden}
.bar i{display:block;height:100%;background:var(--blue)}
"""

SCRIPT = """
const D = JSON.parse(document.getElementById('data').textContent);
const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const base = (extra) => Object.assign({paper_bgcolor:'rgba(0,0,0,0)', plot_bgcolor:'rgba(0,0,0,0)',
  font:{color:css('--ink'), family:'Inter,system-ui,sans-serif', size:12}, margin:{l:64,r:12,t:8,b:40},
  showlegend:false, hovermode:'closest', modebar:{bgcolor:'rgba(0,0,0,0)', color:css('--soft')}}, extra);
const axis = (title, extra) => Object.assign({title:{text:title, standoff:8}, gridcolor:css('--line'),
  zerolinecolor:css('--line'), linecolor:css('--line')}, extra);
const config = {displaylogo:false, responsive:true,
  modeBarButtons:[['toImage', 'zoom2d', 'pan2d', 'zoomIn2d', 'zoomOut2d', 'resetScale2d']]};
const label = (name, unit) => unit && unit !== '1' ? name + ', ' + unit : name;
let variable = D.variable, channel = 0;
const held = D.held.map(Boolean);
function ranges(axisName) {
  return D.where.filter(w => w.variable === variable && w.channel === D.channels[channel].name).map(w => ({type:'rect',
    xref:'x', yref:'paper', x0:w.range[0], x1:w.range[1], y0:0, y1:1, fillcolor:css('--fail'), line:{width:0},
    layer:'below'}));
}
function split(y, which) { return y.filter((_, i) => held[i] === which); }
function dots(x, y, which, name, unit) {
  const runs = D.run.filter((_, i) => held[i] === which);
  return {x:split(x, which), y:split(y, which), text:runs, mode:'markers', type:'scatter', name:name,
    marker:{size:7, symbol:which ? 'diamond-open' : 'circle', color:css('--ink'), opacity:which ? 1 : .65,
    line:{width:which ? 1.5 : 0, color:css('--ink')}},
    hovertemplate:'run %{text}<br>' + variable + ' %{x:.4g}<br>%{y:.4g} ' + unit + '<extra>' + name + '</extra>'};
}
function draw() {
  const c = D.channels[channel], x = D.columns[variable].values, unit = D.columns[variable].unit;
  const band = 1.96 * c.noise_sd;
  const model = {x:x, y:c.predicted, mode:'markers', type:'scatter', name:'model', error_y:{type:'constant', value:band,
    color:css('--blue'), thickness:5, width:0}, opacity:.55, marker:{symbol:'line-ew', size:11,
    line:{width:2.2, color:css('--blue')}}, text:D.run,
    hovertemplate:'run %{text}<br>model %{y:.4g} ' + c.unit + '<extra></extra>'};
  const traces = [model];
  if (c.base) traces.push({x:x, y:c.base, mode:'markers', type:'scatter', name:'base model', text:D.run,
    marker:{symbol:'line-ew', size:11, line:{width:1.4, color:css('--soft')}},
    hovertemplate:'run %{text}<br>base model %{y:.4g} ' + c.unit + '<extra></extra>'});
  traces.push(dots(x, c.measured, false, 'training', c.unit), dots(x, c.measured, true, 'held out', c.unit));
  Plotly.react('overlay', traces, base({height:300, xaxis:axis(label(variable, unit)),
    yaxis:axis(label(c.name, c.unit)), shapes:ranges()}), config);
  const floor = {type:'rect', xref:'paper', yref:'y', x0:0, x1:1, y0:-1.96, y1:1.96, fillcolor:css('--floor'),
    line:{width:0}, layer:'below'};
  Plotly.react('residual', [dots(x, c.residual, false, 'training', 'sd'), dots(x, c.residual, true, 'held out', 'sd')],
    base({height:230, xaxis:axis(label(variable, unit)), yaxis:axis('residual, noise sd'),
    shapes:[floor, ...ranges()]}), config);
  const names = D.ladder.map(r => r.added === null ? 'base model' : '+ ' + r.added.replaceAll('_', '<br>'));
  const bars = (key, color, title) => ({x:names, y:D.ladder.map(r => r[key]), type:'bar', name:title,
    marker:{color:color}, text:D.ladder.map(r => r[key] === null ? '' : r[key].toPrecision(3)), textposition:'outside',
    cliponaxis:false, hovertemplate:'%{x}<br>%{y:.3g} noise sd<extra>' + title + '</extra>'});
  Plotly.react('ladder', [bars('train_error', css('--soft'), 'training'), bars('heldout_error', css('--blue'),
    'held out')], base({height:220, barmode:'group', margin:{l:44,r:8,t:18,b:44}, yaxis:axis('', {rangemode:'tozero'}),
    xaxis:axis('', {automargin:true, tickangle:0}), shapes:[{type:'line', xref:'paper', x0:0, x1:1, y0:1, y1:1,
    line:{color:css('--teal'), width:1.6, dash:'dash'}}]}), {displayModeBar:false, responsive:true});
}
for (const [id, set] of [['variable', v => { variable = v; }], ['channel', v => { channel = +v; }]]) {
  const select = document.getElementById(id);
  if (select) select.addEventListener('change', () => { set(select.value); draw(); });
}
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', draw);
draw();
"""

PAGE = Template(
    """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title><style>$style</style></head><body>
<header><h1>$title</h1><span class="what">$what</span><span class="verdict $verdict">$chip</span></header>
<main><div>
<section><h2>Model and measurement <span class="soft">&#9679; training &#9671; held out
<span style="color:var(--blue)">&#9473; model, 95 % of the noise</span>$base_key$fail_key</span>$choices</h2>
<div id="overlay" role="img" aria-label="measured and predicted values"></div></section>
<section><h2>Residual, measured - predicted <span class="soft">in noise sd; the band holds 95 % of noise</span></h2>
<div id="residual" role="img" aria-label="residuals"></div></section>
</div><div>
<section><h2>Verdict</h2><p>$sentence</p>$where</section>
$ranking
<section><h2>Error ladder, in noise sd <span class="soft">dashed: the noise floor</span></h2>
<div id="ladder" role="img" aria-label="errors of the model with each effect added"></div></section>
<section><h2>Parameters</h2>$parameters</section>
<section><h2>Errors</h2>$errors</section>
</div>
$notes
</main>
<script type="application/json" id="data">$data</script>
<script>$plotly</script><script>$script</script>
</body></html>
"""
)


def fill(**parts: str) -> str:
    """The whole page; every part is HTML already."""
    return PAGE.substitute(style=STYLE, script=SCRIPT, **parts)
