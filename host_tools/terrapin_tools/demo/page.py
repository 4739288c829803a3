"""One self-contained HTML page of chapters: text, tables and pictures."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from pathlib import Path

from jinja2 import Environment, StrictUndefined

from terrapin_tools.papers.part import Table

__all__ = ["Chapter", "write_page"]

STYLE = """
:root {
  color-scheme: light dark;
  --ink: #1c2430; --dim: #5c6675; --paper: #fff; --back: #f4f5f7; --line: #dfe3e8;
}
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e9ee; --dim: #9aa4b2; --paper: #1b2028; --back: #12161c; --line: #303742; }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--back); color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
main { max-width: 1080px; margin: 0 auto; padding: 24px 20px 80px; }
section { background: var(--paper); border: 1px solid var(--line); border-radius: 8px; padding: 20px 24px; }
section { margin: 18px 0; }
h1 { font-size: 26px; margin: 12px 0 4px; }
h2 { font-size: 19px; margin: 0 0 8px; }
p { margin: 6px 0; max-width: 78ch; }
.dim { color: var(--dim); }
a { color: inherit; }
img { width: 100%; height: auto; margin: 12px 0 2px; border-radius: 4px; background: #fff; }
table { border-collapse: collapse; margin: 12px 0; }
caption { text-align: left; color: var(--dim); padding-bottom: 4px; }
th, td { text-align: left; padding: 3px 18px 3px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
td { font-variant-numeric: tabular-nums; }
pre { background: var(--back); border: 1px solid var(--line); border-radius: 6px; padding: 10px 12px; }
pre { overflow-x: auto; font-size: 13px; }
nav a { display: block; }
@media print { section { break-inside: avoid; } }
"""


@dataclass
class Chapter:
    """One part of the page: plain sentences, then what backs them."""

    title: str
    text: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    pictures: list[tuple[Path, str]] = field(default_factory=list)  # PNG, and what it shows
    commands: list[str] = field(default_factory=list)  # that do the same
    links: list[tuple[Path, str]] = field(default_factory=list)  # files beside the page


PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>{{ title }}</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>{{ style|safe }}</style>
<main><h1>{{ title }}</h1><p class="dim">{{ summary }}</p>
<nav>{% for one in chapters %}<a href="#c{{ loop.index }}">{{ loop.index }}. {{ one.title }}</a>{% endfor %}</nav>
{% for one in chapters %}<section id="c{{ loop.index }}"><h2>{{ loop.index }}. {{ one.title }}</h2>
{%- for line in one.text %}<p>{{ line }}</p>{% endfor %}
{%- for file, caption in one.pictures %}
<img src="data:image/png;base64,{{ base64(file) }}" alt="{{ caption }}"><p class="dim">{{ caption }}</p>{% endfor %}
{%- for table in one.tables %}
<table><caption>{{ table.caption }}</caption><tr>{% for cell in table.head %}<th>{{ cell }}</th>{% endfor %}</tr>
{%- for row in table.rows %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{%- endfor %}</table>{% endfor %}
{%- for file, caption in one.links %}<p><a href="{{ beside(file) }}">{{ caption }}</a></p>{% endfor %}
{%- if one.commands %}<p class="dim">The same by hand:</p><pre>{{ one.commands|join("\\n") }}</pre>{% endif %}</section>
{% endfor %}</main></html>
"""


def write_page(file: Path, title: str, summary: str, chapters: list[Chapter]) -> None:
    """Write the page; pictures go into it, links stay beside it."""
    template = Environment(autoescape=True, undefined=StrictUndefined).from_string(PAGE)
    page = template.render(
        title=title,
        summary=summary,
        chapters=chapters,
        style=STYLE,
        base64=lambda picture: base64.b64encode(picture.read_bytes()).decode("ascii"),
        beside=lambda link: link.relative_to(file.parent).as_posix(),
    )
    file.write_text(page, encoding="utf-8")
