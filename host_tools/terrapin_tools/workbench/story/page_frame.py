"""The report's style, and its page as a Jinja template of a story: every value is escaped unless it says `safe`."""

__all__ = ["PAGE", "STYLE"]

LIGHT = """--name:light;--bg:#f6f7f9;--card:#fff;--ink:#1b2430;--soft:#5b6573;--mute:#b3bcc8;--line:#e0e4ea;
--hair:#e9ecf1;--grey-bar:#a3aebb;
--blue:#2a66d1;--teal:#0d7a70;--amber:#a86500;--red:#c73650;--band:rgba(42,102,209,.15);--fail:rgba(214,69,93,.10);
--floor:rgba(17,138,126,.14);color-scheme:light"""
DARK = """--name:dark;--bg:#12161c;--card:#1a2028;--ink:#e8edf3;--soft:#9aa7b7;--mute:#5d6a7a;--line:#2a323d;
--hair:#252d37;--grey-bar:#5f6d7e;
--blue:#6aa1ff;--teal:#3cc4b4;--amber:#ffb648;--red:#ff7088;--band:rgba(106,161,255,.20);--fail:rgba(255,112,136,.14);
--floor:rgba(60,196,180,.16);color-scheme:dark"""
STYLE = (
    f":root{{{LIGHT}}}:root[data-theme=dark]{{{DARK}}}"
    f"@media (prefers-color-scheme:dark){{:root:not([data-theme=light]){{{DARK}}}}}"
    """
*{box-sizing:border-box}
body{margin:0;background:var(--bg);color:var(--ink);font:14px/1.45 Inter,system-ui,-apple-system,"Segoe UI",sans-serif}
header{display:flex;align-items:center;gap:4px 16px;flex-wrap:wrap;padding:8px 20px;background:var(--card);
border-bottom:1px solid var(--line)}
header h1{font-size:16px;margin:0}header .what{color:var(--soft)}
.verdict{margin-left:auto;padding:3px 12px;border-radius:14px;font-weight:600;border:1px solid currentColor}
.v-adequate{color:var(--teal)}.v-missing{color:var(--red)}.v-ambiguous,.v-partial,.v-unexplained{color:var(--amber)}
.lead{padding:8px 20px 0;max-width:1640px;margin:auto}.lead p{font-size:16px;font-weight:600;margin:0}
.where{margin:2px 0 0;padding:0;list-style:none;display:flex;flex-wrap:wrap;gap:0 18px;color:var(--soft);font-size:13px}
.where b{color:var(--ink)}.where .warn{color:var(--amber)}
main{display:grid;grid-template-columns:minmax(0,1fr) 392px;gap:12px;padding:10px 20px;max-width:1640px;margin:auto}
.pair{display:grid;grid-template-columns:minmax(0,1.55fr) minmax(0,1fr);gap:12px}
.three{display:grid;grid-template-columns:repeat(auto-fit,minmax(350px,1fr));gap:12px;grid-column:1/-1;align-items:start}
section{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:8px 12px;margin-bottom:12px;
min-width:0}
.pair{margin-bottom:12px}.pair section,.three section{margin-bottom:0}
h2{margin:0 0 4px;font-size:13px;font-weight:600;display:flex;gap:2px 12px;align-items:center;flex-wrap:wrap}
[hidden]{display:none!important}.quiet{font:inherit;color:var(--soft);background:none;border:1px solid transparent;
border-radius:6px;cursor:pointer}.quiet:hover{border-color:var(--line)}.scroll{overflow:auto;max-height:420px}
h2 span{font-weight:400;color:var(--soft);font-size:12px}h2 .choices{margin-left:auto}h2 label{font-weight:400;
font-size:12px;color:var(--soft);margin-left:6px}
select,#theme{font:inherit;color:var(--ink);background:var(--card);border:1px solid var(--line);border-radius:6px;
padding:1px 6px;max-width:170px}
#theme{cursor:pointer;color:var(--soft)}
:focus-visible{outline:2px solid var(--blue);outline-offset:2px}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
th{text-align:left;color:var(--soft);font-weight:600;font-size:12px}td,th{padding:3px 8px 3px 0;vertical-align:top}
tbody tr{border-top:1px solid var(--line)}td.n,th.n{text-align:right}.n{font-variant-numeric:tabular-nums}
.warn{color:var(--amber)}.soft{color:var(--soft)}p{margin:5px 0}ol{margin:6px 0;padding-left:22px}
code{font:12px ui-monospace,monospace;background:var(--bg);border-radius:5px;padding:2px 6px;overflow-wrap:anywhere}
.wide{grid-column:1/-1}.notes{max-width:80ch}.notes h3{font-size:15px;margin:12px 0 4px}.notes h4{margin:12px 0 4px}
.notes table{display:block;overflow-x:auto}
.card{display:grid;gap:2px;width:100%;text-align:left;font:inherit;font-size:13px;color:var(--ink);background:none;
border:1px solid var(--line);border-radius:8px;padding:7px 10px;margin:0 0 7px}
button.card,button.all{cursor:pointer}button.card:hover{border-color:var(--blue)}.card.named{border-color:var(--amber)}
.card[aria-pressed=true],.all[aria-pressed=true]{border-color:var(--teal);box-shadow:inset 3px 0 0 var(--teal)}
.all{font:inherit;font-size:13px;width:100%;text-align:left;color:var(--ink);background:none;
border:1px solid var(--line);border-radius:8px;padding:5px 10px;margin-bottom:7px}
.row{display:flex;gap:10px;align-items:center}.row .bar{flex:1}
.bar{display:block;height:6px;min-width:40px;border-radius:3px;background:var(--line);overflow:hidden}
.bar i{display:block;height:100%;background:var(--blue)}
.eq{display:flex;flex-wrap:wrap;gap:2px 14px;font-size:16px;overflow-x:auto;overflow-y:hidden;
padding:3px 0 5px}math{font-family:"STIX Two Math","Latin Modern Math",
"Cambria Math",math,serif}
.value{white-space:nowrap;margin-right:8px}
.name{overflow-wrap:anywhere}
.next{border-left:4px solid var(--amber)}.next.ok{border-left-color:var(--teal)}
summary{cursor:pointer;color:var(--soft)}
footer{padding:0 20px 16px;color:var(--soft);font-size:12px;max-width:1640px;margin:auto}
@media (max-width:980px){main{display:flex;flex-direction:column;gap:0}main>div:not(.three){display:contents}
#ranking{order:1}.next{order:2}#heat{order:3}.three{order:4}.notes{order:5}}
@media (max-width:640px){main,.lead{padding-left:10px;padding-right:10px}header{padding:8px 10px}.verdict{margin-left:0}
.pair{grid-template-columns:minmax(0,1fr)}h2 .choices{margin-left:0}}
@media print{#theme,.tools{display:none}section{break-inside:avoid}}
"""
)

PAGE = """<!doctype html>
{%- macro bar(share) %}<span class="bar" aria-hidden="true"><i style="width:{{ (100 * share)|round(1) }}%"></i></span>
{%- endmacro %}
{%- macro values(values) %}{% for name, value in values.items() %}<span class="value">{{ name }} = {{ amount(value) }}
{{- stuck(value, " ") }}</span> {% endfor %}{% endmacro %}
{%- macro card(one) %}{% set effect = one.proposal %}{% set curve = curves.get((effect.effect,)) %}
<{{ "div" if curve is none else "button" }} class="card{{ " named" if one.named }}"
{%- if curve is not none %} data-preview="{{ curve }}" aria-pressed="false"{% endif %}>
<span class="row"><b>{{ effect.effect }}</b>{{ bar(effect.probability) }}
<span class="n">{{ chance(effect.probability) }}</span></span>
{%- if one.title|lower|replace(" ", "_") != effect.effect %}<span class="soft">{{ one.title }}</span>{% endif %}
<span class="eq">{{ mathml(one.latex)|safe }}
{%- if one.acts %} <span class="soft">{{ one.acts }}</span>{% endif %}</span>
<span>{{ one.reason }}</span><span class="soft">{{ values(one.values) }}</span>
</{{ "div" if curve is none else "button" }}>
{%- endmacro %}
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ story.title }}</title><style>{{ style|safe }}</style></head><body>
<header><h1>{{ story.title }}</h1>
<span class="what">{{ story.runs }} run{{ 's' if story.runs != 1 }}, {{ story.held_out|length }} held out ·
{{ story.model }}</span>
<span class="verdict v-{{ story.verdict }}">{{ story.chip }}</span>
<button id="theme" aria-label="light or dark">&#9680;</button></header>
<div class="lead"><p>{{ story.headline }}</p><div class="soft">{{ story.alarm }}</div>
<ul class="where">{% for place in story.where %}<li><b>{{ place.variable }}</b> {{ place.sentence }}</li>{% endfor %}
{%- for note in story.intake + story.notes %}<li class="warn">{{ note }}</li>{% endfor %}</ul></div>
<main><div>
<div id="overlay"></div>
{%- if data.kept < data.rows %}<p class="soft">{{ data.kept }} of {{ data.rows }} rows are drawn: of each stretch those
with the lowest and the highest residual. Every number on this page is of all rows.</p>{% endif %}
<div class="pair">
<div id="residual"></div>
<section><h2>Error ladder <span>noise sd; <b style="color:var(--grey-bar)">&#9646;</b> training
<b style="color:var(--blue)">&#9646;</b> held out; dashed: {{ "floor" if story.noise.floor else "1.0" }}</span></h2>
<div id="ladder"></div>
{%- if history %}<details><summary>History: {{ history|length }} step{{ "s" if history|length != 1 }}</summary><ol>
{%- for step in history %}
<li>{{ step.action }} <b>{{ step.effects|join(" + ") or "nothing" }}</b>: held out
{{ in_sd(step.before.heldout_error) }} &rarr; {{ in_sd(step.after.heldout_error) }}</li>{% endfor %}</ol></details>
{%- endif %}</section>
</div>
<div id="heat"></div>
</div><div>
{% if not story.found %}<section><h2>{{ story.heading }}</h2><p class="soft">{{ not_looked }}</p></section>
{%- elif story.cards %}<section id="ranking"><h2>{{ story.heading }} <span class="soft">{{ story.measure }};
click: what it would do</span></h2>
{%- if story.found.missing|length > 1 and story.found.missing in curves %}
<button class="all" data-preview="{{ curves[story.found.missing] }}" aria-pressed="false">Show all together:
{{ story.found.missing|join(" + ") }}</button>{% endif %}
{%- for one in story.cards[:full] %}{{ card(one) }}{% endfor %}
{%- if story.cards[full:] %}<details><summary>{{ story.cards[full:]|length }} less likely</summary><table><tbody>
{%- for one in story.cards[full:] %}<tr><td><b>{{ one.proposal.effect }}</b><br><span class="soft">{{ one.reason }}
</span></td><td class="n">{{ chance(one.proposal.probability) }}</td></tr>{% endfor %}</tbody></table></details>
{%- endif %}
</section>{% endif %}
{%- if story.front %}<section><h2>Short answers first <span>errors in noise sd; probability to be all that is
missing</span></h2><table><thead><tr><th class="n">terms</th><th></th><th class="n">training</th>
<th class="n">held out</th><th></th><th class="n">probability</th></tr></thead><tbody>
{%- for one in story.front %}<tr><td class="n">{{ one.terms }}</td><td class="name">{{ one.name }}</td>
<td class="n">{{ one.training }}</td><td class="n">{{ one.held_out }}</td><td>{{ bar(one.share) }}</td>
<td class="n">{{ one.probability }}</td></tr>{% endfor %}</tbody></table></section>{% endif %}
{%- if curve_svg %}<section><h2>A curve that has no formula here <span>band: 95 %</span></h2>{{ curve_svg|safe }}
</section>{% endif %}
<section class="next{{ " ok" if story.verdict in ("adequate", "missing") }}"><h2>Next</h2><p>{{ story.next.text }}</p>
{%- if story.next.settings %}<table><thead><tr><td></td>
{%- for role in story.next.vary %}<th class="n">{{ role }}</th>{% endfor %}</tr></thead><tbody>
{%- for setting in story.next.settings %}<tr>{% for value in setting %}<td class="n">{{ value }}</td>{% endfor %}</tr>
{%- endfor %}</tbody></table>{% endif %}
{%- if story.next.after %}<p class="soft">{{ story.next.after }}</p>{% endif %}
{%- if story.next.command %}<p>{{ story.next.offer }}: <code>{{ story.next.command }}</code></p>{% endif %}</section>
</div>
<div class="three">
<section><h2>Parameters of the model</h2>
{%- for left, formula in formulas %}<p><span class="soft">{{ left }} =</span>
<span class="eq">{{ formula|safe }}</span></p>{% endfor %}
{%- if story.parameters or model %}<table><tbody>{% for key, value in story.parameters.items() %}<tr><td>{{ key }}
{%- if value.at_bound %}<br><span class="warn">{{ stuck(value) }}</span>{% endif %}</td>
<td class="n">{{ amount(value) }}</td></tr>{% endfor %}
{%- for effect in model %}<tr><td colspan="2"><b>{{ effect.name }}</b> <span class="soft">in the model</span>
<span class="eq">{{ mathml(effect.equation)|safe }}</span></td></tr>{% endfor %}</tbody></table>
{%- else %}<p>None is fitted.</p>{% endif %}</section>
<section><h2>Errors and noise</h2><table><thead><tr><th></th><th class="n">noise sd</th><th class="n">training</th>
<th class="n">held out</th><th></th></tr></thead><tbody>
{%- for name, c in story.channels.items() %}<tr><td>{{ name }}</td>
{%- for value in (c.noise_sd, c.train_rmse, c.heldout_rmse) %}<td class="n">{{ number(value) }}</td>{% endfor %}
<td>{{ c.unit }}</td></tr>{% endfor %}</tbody></table>
<p class="soft">{{ story.noise_told[:1]|upper }}{{ story.noise_told[1:] }}.</p></section>
{% if story.chances %}<section><h2>What these runs can show</h2><table><tbody>{% for what, often in story.chances %}
<tr><td>{{ what }}</td><td class="n">{{ often }}</td></tr>{% endfor %}</tbody></table></section>{% endif %}
</div>
{%- if notes %}<section class="wide notes">{{ notes|safe }}</section>{% endif %}
</main>
<footer>Made by <code>terrapin report</code>. Errors without a unit are in noise sd: {{ floor(story.noise) }}.
Probabilities are calibrated: of all given with 0.9, nine in ten are right.</footer>
<script type="application/json" id="data">{{ json|safe }}</script>
<script>{{ script|safe }}</script>
</body></html>
"""
