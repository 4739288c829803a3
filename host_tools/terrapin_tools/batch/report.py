"""The report of a batch: one HTML page without scripts. What failed, what makes it fail, how the numbers lie."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined

from terrapin_tools.batch.pictures import histogram, points, shares
from terrapin_tools.batch.summary import QUANTILES, Summary, share_limits
from terrapin_tools.batch.table import Table
from terrapin_tools.workbench.story.page_frame import STYLE

__all__ = ["render"]

MOST_COMMANDS = 50

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }}</title><style>{{ style|safe }}</style></head><body>
<header><h1>{{ title }}</h1><span class="what">{{ summary.runs }} runs</span>
<span class="verdict v-{{ "missing" if summary.failed else "adequate" }}">{{ summary.failed }} failed</span></header>
<div class="lead"><p>{{ percent(summary.failed / summary.runs) }} of the runs fail
(95 % limits {{ percent(summary.limits[0]) }} to {{ percent(summary.limits[1]) }}).</p>
<div class="soft"><code>{{ command }}</code></div></div>
<main><div>
<section><h2>What fails</h2>{% if summary.checks or summary.errors %}<table><thead><tr><th>check</th>
<th class="n">failed</th><th class="n">share</th></tr></thead><tbody>
{%- for text, count in summary.checks.items() %}<tr><td><code>{{ text }}</code></td><td class="n">{{ count }}</td>
<td class="n">{{ percent(count / summary.runs) }}</td></tr>{% endfor %}
{%- if summary.errors %}<tr><td class="warn">could not be run to the end</td><td class="n">{{ summary.errors }}</td>
<td class="n">{{ percent(summary.errors / summary.runs) }}</td></tr>
{%- for reason, count in summary.reasons.items() %}<tr><td class="soft">{{ reason }}</td><td class="n">{{ count }}</td>
<td class="n">{{ percent(count / summary.runs) }}</td></tr>{% endfor %}{% endif %}</tbody></table>
{%- else %}<p>The scenario has no checks.</p>{% endif %}</section>
{% if summary.classes %}<section><h2>What makes it fail <span>share of the variance of "failed" that the input explains
alone; bars: share that fails, with 95 % limits</span></h2>
{%- if not summary.failed %}<p>Nothing failed.</p>
{%- elif summary.failed == summary.runs %}<p>All failed: nothing that was varied decides it.</p>
{%- else %}
<table><tbody>{% for name, share in summary.decides["failed"].items() %}<tr><td><b>{{ name }}</b></td>
<td style="width:40%"><span class="bar" aria-hidden="true"><i style="width:{{ (100 * share)|round(1) }}%"></i></span>
</td><td class="n">{{ "%.2f"|format(share) }}</td></tr>{% endfor %}</tbody></table>{% endif %}
<div class="three">{% for picture in by_input %}<div>{{ picture|safe }}</div>{% endfor %}</div></section>{% endif %}
{% if map %}<section><h2>Where it fails <span>red: failed, green: passed</span></h2>{{ map|safe }}</section>{% endif %}
<section><h2>Numbers <span>quantiles over the runs; red: of failed runs</span></h2><table><thead><tr>
{%- for q in quantiles %}<th class="n">{{ "%.0f"|format(100 * q) }} %</th>{% endfor %}<th></th><th>decided most by</th>
</tr></thead><tbody>{% for text, values in summary.quantiles.items() %}<tr><th colspan="{{ quantiles|length + 2 }}"
scope="rowgroup"><code>{{ text }}</code>
{%- if units.get(text) %} <span class="soft">{{ units[text] }}</span>{% endif %}
{%- if summary.missing[text] %} <span class="warn">no value in {{ summary.missing[text] }} runs:
{{ summary.why_missing[text] }}</span>{% endif %}</th>
</tr><tr>
{%- for value in values %}<td class="n">{{ "-" if value is none else "%.4g"|format(value) }}</td>{% endfor %}
<td>{{ histograms[text]|safe }}</td><td>{{ decided[text] }}</td></tr>{% endfor %}</tbody></table></section>
</div><div>
<section class="next{{ "" if summary.failed else " ok" }}"><h2>Failed runs</h2>
{%- if commands %}<p>Each of these repeats one, bit for bit:</p>
{%- for line in commands[:most] %}<p><code>{{ line }}</code></p>{% endfor %}
{%- if commands|length > most %}<p class="soft">All {{ commands|length }} are in failed.sh.</p>{% endif %}
{%- else %}<p>None.</p>{% endif %}</section>
</div></main>
<footer>Made by <code>terrapin batch</code>. Every run is a row of runs.parquet.</footer></body></html>
"""


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def render(command: str, table: Table, summary: Summary, commands: Sequence[str]) -> str:
    """The page as text. `command`: the batch's own command line; `commands`: those that repeat the failed runs."""
    environment = Environment(autoescape=True, undefined=StrictUndefined)
    page: str = environment.from_string(PAGE).render(
        title=command.split()[2],
        command=command,
        style=STYLE,
        summary=summary,
        commands=commands,
        most=MOST_COMMANDS,
        quantiles=QUANTILES,
        units=table.units,
        percent=_percent,
        by_input=[_by_input(name, summary, table) for name in summary.classes],
        map=_map(table, summary),
        histograms={text: histogram(values, table.passed, text) for text, values in table.numbers.items()},
        decided={text: _decided(summary, text) for text in table.numbers},
    )
    return page


def _by_input(name: str, summary: Summary, table: Table) -> str:
    parts = summary.classes[name]
    share = [part.failed / part.runs if part.runs else 0.0 for part in parts]
    limits = [share_limits(part.failed, part.runs) for part in parts]
    return shares([part.name for part in parts], share, limits, f"failed by {name}", _label(name, table))


def _label(name: str, table: Table) -> str:
    unit = table.units.get(name)
    return f"{name}, {unit}" if unit else name


def _map(table: Table, summary: Summary) -> str:
    """The runs over the two inputs that decide most, of those that are numbers."""
    names = [name for name in summary.classes if isinstance(table.inputs[name], np.ndarray)][:2]
    if len(names) < 2 or not summary.failed:
        return ""
    x, y = (np.asarray(table.inputs[name]) for name in names)
    return points(x, y, table.passed, (_label(names[0], table), _label(names[1], table)), "failed over two inputs")


def _decided(summary: Summary, text: str) -> str:
    found: dict[str, Any] = dict(summary.decides[text])
    best = max(found, key=lambda name: found[name], default="")
    return f"{best} ({found[best]:.2f})" if best and found[best] >= 0.01 else ""
