"""The page of `terrapin papers`: one HTML file with everything in it."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from terrapin_tools.papers.part import Part, Table
from terrapin_tools.papers.printed import printed
from terrapin_tools.papers.verdict import ASSUMED, FAILED, REPRODUCED, Check, Outcome, worst

__all__ = ["page"]

STYLE = """
:root { color-scheme: light; --ink:#1d2430; --dim:#5b6573; --line:#e2e5ea; --back:#f6f6f3; --card:#fff;
  --good:#0d6b53; --goodb:#e2f3ec; --mid:#8a5a00; --midb:#fbf0d9; --bad:#a3243f; --badb:#fbe6ea; }
* { box-sizing:border-box; }
body { margin:0; background:var(--back); color:var(--ink); font:15px/1.5 "Source Sans 3",system-ui,sans-serif; }
main { max-width:1120px; margin:0 auto; padding:36px 24px 90px; }
h1 { font-size:29px; line-height:1.2; margin:0 0 6px; letter-spacing:-.01em; }
h2 { font-size:21px; line-height:1.25; margin:44px 0 2px; }
h3 { font-size:17px; margin:0; }
p { margin:7px 0; max-width:86ch; }
.dim { color:var(--dim); }
section { background:var(--card); border:1px solid var(--line); border-radius:8px; padding:18px 22px; margin:16px 0; }
header.part { display:flex; gap:12px; align-items:baseline; flex-wrap:wrap; margin-bottom:4px; }
.chip { font-size:12.5px; font-weight:600; padding:1px 9px; border-radius:10px; white-space:nowrap; }
.reproduced { color:var(--good); background:var(--goodb); }
.assumed { color:var(--mid); background:var(--midb); }
.failed { color:var(--bad); background:var(--badb); }
img { display:block; width:100%; height:auto; margin:12px 0 2px; }
figcaption { color:var(--dim); font-size:13.5px; } figure { margin:0; }
table { border-collapse:collapse; width:100%; margin:12px 0 4px; font-size:14px; font-variant-numeric:tabular-nums; }
caption { text-align:left; color:var(--dim); padding-bottom:4px; }
th { text-align:left; font-weight:600; color:var(--dim); font-size:12.5px; }
th,td { padding:5px 12px 5px 0; border-bottom:1px solid var(--line); vertical-align:top; }
td.why { color:var(--dim); font-size:13px; }
.checks td:nth-child(1) { width:23%; } .checks td:nth-child(2) { width:13%; } .checks td:nth-child(3) { width:31%; }
.summary td { padding:3px 12px 3px 0; } .summary td:nth-child(-n+3) { white-space:nowrap; }
.summary a { color:inherit; }
.rules { border-left:3px solid var(--line); padding-left:14px; margin:14px 0; }
table.data { width:auto; } .data th,.data td { white-space:nowrap; padding-right:22px; } .scroll { overflow-x:auto; }
@media print { body { background:#fff; } section { break-inside:avoid; border:0; padding:6px 0; } }
"""

RULES: Mapping[Outcome, str] = {
    REPRODUCED: "every number comes out within half a unit of its last printed digit (or the tolerance named with it), "
    "or a statement holds, from printed inputs alone or at every setting tried of those that are not printed.",
    ASSUMED: "the result depends on something that the paper does not print; what is shown holds for our assumption, "
    "or nothing can be held against it.",
    FAILED: "with all inputs printed, no reading that was tried comes within the tolerance, or none of the settings "
    "tried of what is not printed does. It is a statement about the printed text, not about the experiment.",
}


def _escape(text: str) -> str:
    return html.escape(text, quote=True)


GREEK = {"theta": "&theta;", "tau": "&tau;", "sigma": "&sigma;", "phi": "&phi;", "xi": "&xi;"}
SUBSCRIPT = re.compile(r"\b([A-Za-z]|theta|tau|sigma|phi|xi)_([A-Za-z0-9]{1,3})\b")
WORDS = re.compile(r"\b([a-z]{3,})_([a-z]{3,})\b")
POWER = re.compile(r"\^(-?\d+(?:\.\d+)?|\([^)]*\)|[a-z])")


def _typeset(text: str) -> str:
    """Escaped text with indices, powers and Greek letters as a paper sets them.

    >>> _typeset("tau_max = c + sigma tan(phi), 2 kN/m^2.71 <= K_s")
    '&tau;<sub>max</sub> = c + &sigma; tan(&phi;), 2 kN/m<sup>2.71</sup> &le; K<sub>s</sub>'
    """
    found = _escape(text).replace("&lt;=", "&le;").replace("&gt;=", "&ge;").replace("+-", "&plusmn;")
    found = WORDS.sub(r"\1 \2", SUBSCRIPT.sub(lambda m: f"{m[1]}<sub>{m[2]}</sub>", found))
    found = POWER.sub(lambda m: f"<sup>{m[1].strip('()')}</sup>", found)
    return re.sub(r"\b(theta|tau|sigma|phi|xi)\b", lambda m: GREEK[m[1]], found)


def _chip(outcome: Outcome) -> str:
    return f'<span class="chip {"failed" if outcome == FAILED else outcome}">{outcome}</span>'


def _chips(part: Part) -> str:
    """The verdicts on numbers and statements, as far as the part has them."""
    found = []
    for word, statements in (("numbers", False), ("statements", True)):
        outcome = worst(part.checks, statements)
        if outcome is not None:
            found.append(f'<span class="dim">{word}</span> {_chip(outcome)}')
    return " ".join(found)


def _anchor(part: Part) -> str:
    return f"{part.paper}-{part.title}".lower().replace(" ", "").replace(".", "")


def _check(check: Check) -> str:
    why = f'<div class="dim">{_typeset(check.why)}</div>' if check.why else ""
    return (
        f"<tr><td>{_typeset(check.what)}</td><td>{_typeset(check.printed)}</td><td>{_typeset(check.found)}{why}</td>"
        f"<td>{_typeset(check.near)}</td><td>{_chip(check.outcome)}</td></tr>"
    )


def _table(table: Table) -> str:
    head = "".join(f"<th>{_typeset(cell)}</th>" for cell in table.head)
    rows = "".join("<tr>" + "".join(f"<td>{_typeset(cell)}</td>" for cell in row) + "</tr>" for row in table.rows)
    return (
        f'<div class="scroll"><table class="data"><caption>{_typeset(table.caption)}</caption><tr>{head}</tr>{rows}'
        "</table></div>"
    )


def _part(part: Part, files: Mapping[str, Path]) -> str:
    pieces = [
        f'<section id="{_anchor(part)}"><header class="part"><h3>{_typeset(part.title)}</h3>{_chips(part)}'
        f'<span class="dim">{_typeset(part.about)}</span></header>'
    ]
    for figure in part.figures:
        data = base64.b64encode(files[figure.name].read_bytes()).decode("ascii")
        label = _escape(figure.caption)
        pieces.append(
            f'<figure><img style="max-width:{round(112 * figure.size[0])}px" src="data:image/svg+xml;base64,{data}" '
            f'alt="{label}">'
            f"<figcaption>{label}</figcaption></figure>"
        )
    pieces += [f"<p>{_typeset(text)}</p>" for text in part.text]
    pieces.append(
        '<table class="checks"><tr><th>what</th><th>printed</th><th>found here</th><th>how near</th>'
        "<th>verdict</th></tr>" + "".join(_check(check) for check in part.checks) + "</table>"
    )
    pieces += [_table(table) for table in part.tables]
    return "".join(pieces) + "</section>"


def _summary(parts: Sequence[Part]) -> str:
    rows = []
    for part in parts:
        cells = []
        for statements in (False, True):
            chosen = [check for check in part.checks if check.statement == statements]
            outcome = worst(part.checks, statements)
            good = sum(check.outcome == REPRODUCED for check in chosen)
            words = "" if outcome is None else f'{_chip(outcome)} <span class="dim">{good} of {len(chosen)}</span>'
            cells.append(f"<td>{words}</td>")
        name = printed()[part.paper]["authors"].split(",")[0].split(" et ")[0].split(" ")[-1]
        rows.append(
            f'<tr><td><a href="#{_anchor(part)}">{_escape(name)}, {_escape(part.title)}</a></td>'
            f"{''.join(cells)}<td>{_escape(part.about)}</td></tr>"
        )
    return (
        '<table class="summary"><tr><th>part</th><th>numbers, reproduced of all</th><th>statements, reproduced of all'
        "</th><th>what it shows</th></tr>" + "".join(rows) + "</table>"
    )


def page(parts: Sequence[Part], files: Mapping[str, Path]) -> str:
    """The whole page; `files` holds the figures by name."""
    rules = "".join(f"<p>{_chip(outcome)} {_escape(RULES[outcome])}</p>" for outcome in (REPRODUCED, ASSUMED, FAILED))
    body = []
    for key, paper in printed().items():
        body.append(
            f"<h2>{_escape(paper['title'])}</h2>"
            f'<p class="dim">{_escape(paper["authors"])}, {_escape(paper["where"])}</p>'
        )
        body += [_part(part, files) for part in parts if part.paper == key]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Three papers, recomputed</title><style>{STYLE}</style></head><body><main>"
        "<h1>Three papers on rolling on soft ground, recomputed</h1>"
        '<p class="dim">Figures and tables regenerated by Terrapin (terrapin papers), each beside what the paper '
        "prints. Every verdict is computed by the rules below. Numbers and statements drawn from them are judged "
        "apart, each by its worst check. Corrections are welcome.</p>"
        f'<div class="rules">{rules}</div><section>{_summary(parts)}</section>{"".join(body)}</main></body></html>\n'
    )
