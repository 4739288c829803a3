"""One self-contained HTML page of chapters: text, tables and pictures."""

from __future__ import annotations

import base64
import html
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["Chapter", "Table", "write_page"]

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


@dataclass(frozen=True)
class Table:
    """Rows of text under a head; numbers come formatted."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass
class Chapter:
    """One part of the page: plain sentences, then what backs them."""

    title: str
    text: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    pictures: list[tuple[Path, str]] = field(default_factory=list)  # PNG, and what it shows
    commands: list[str] = field(default_factory=list)  # that do the same
    links: list[tuple[Path, str]] = field(default_factory=list)  # files beside the page


def _table(table: Table) -> str:
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in table.head)
    rows = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows)
    return f"<table><caption>{html.escape(table.caption)}</caption><tr>{head}</tr>{rows}</table>"


def _chapter(number: int, chapter: Chapter, folder: Path) -> str:
    parts = [f'<section id="c{number}"><h2>{number}. {html.escape(chapter.title)}</h2>']
    parts += [f"<p>{html.escape(line)}</p>" for line in chapter.text]
    for file, caption in chapter.pictures:
        data = base64.b64encode(file.read_bytes()).decode("ascii")
        label = html.escape(caption, quote=True)
        parts.append(f'<img src="data:image/png;base64,{data}" alt="{label}"><p class="dim">{label}</p>')
    parts += [_table(table) for table in chapter.tables]
    for file, caption in chapter.links:
        target = html.escape(file.relative_to(folder).as_posix(), quote=True)
        parts.append(f'<p><a href="{target}">{html.escape(caption)}</a></p>')
    if chapter.commands:
        parts.append('<p class="dim">The same by hand:</p><pre>' + html.escape("\n".join(chapter.commands)) + "</pre>")
    return "".join(parts) + "</section>"


def write_page(file: Path, title: str, summary: str, chapters: list[Chapter]) -> None:
    """Write the page; pictures go into it, links stay beside it."""
    body = "".join(_chapter(i, chapter, file.parent) for i, chapter in enumerate(chapters, 1))
    index = "".join(f'<a href="#c{i}">{i}. {html.escape(c.title)}</a>' for i, c in enumerate(chapters, 1))
    file.write_text(
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{STYLE}</style>'
        f'<main><h1>{html.escape(title)}</h1><p class="dim">{html.escape(summary)}</p><nav>{index}</nav>{body}'
        "</main></html>\n",
        encoding="utf-8",
    )
