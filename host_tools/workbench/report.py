"""One self-contained HTML page of a case: verdict, where it fails, what is missing, the ladder, what to do next."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from typing import Any

from hil.physics.effects import Effect
from hil.physics.expression import parse
from host_tools.workbench.analysis import Analysis
from host_tools.workbench.answer import compare_answer
from host_tools.workbench.bases import ROLES
from host_tools.workbench.markdown import to_html
from host_tools.workbench.mathml import from_latex
from host_tools.workbench.reasons import headline, reason
from host_tools.workbench.report_data import CARDS, page_data, previews
from host_tools.workbench.report_page import fill
from host_tools.workbench.show import number

__all__ = ["render"]

CHIPS = {
    "adequate": "adequate",
    "missing": "something is missing",
    "ambiguous": "the data cannot tell",
    "unexplained": "unexplained",
}
TITLES = {  # of the candidates
    "adequate": "Too small to tell, if there at all",
    "unexplained": "Nearest, if it is one of these",
}


def render(analysis: Analysis, discovered: dict[str, Any] | None = None, history: Sequence[dict[str, Any]] = ()) -> str:
    """The page as text. `discovered`: what `terrapin discover` answers of this very case; `history`: of its steps."""
    from plotly.offline import get_plotlyjs

    case = analysis.case
    answer = discovered if discovered is not None else compare_answer(analysis, 0.0)
    shown = previews(analysis, discovered)
    data = page_data(analysis, answer, shown)
    runs = len({*case.run[analysis.rows].tolist()})
    held = len({*case.run[case.test].tolist()})
    effects = "".join(f" + {name}" for name in case.effects)
    choices = _select("variable", "against", [(name, name) for name in data["columns"]], data["variable"])
    if len(data["channels"]) > 1:
        pairs = [(str(i), c["name"]) for i, c in enumerate(data["channels"])]
        choices = _select("channel", "channel", pairs, "0") + choices
    thinned = ""
    if data["kept"] < data["rows"]:
        thinned = (
            f"<p class='soft'>{data['kept']} of {data['rows']} rows are drawn: of each stretch those with the lowest "
            "and the highest residual. Every number on this page is of all rows.</p>"
        )
    return fill(
        title=html.escape(case.title),
        what=html.escape(f"{runs} runs, {held} held out \u00b7 {case.base.name}{effects}"),
        verdict=answer["verdict"],
        chip=CHIPS[answer["verdict"]],
        base_key="<span>&#9478; base model</span>" if case.effects else "",
        fail_key='<span class="key-fail">&#9646; fails here</span>' if answer["where"] else "",
        heat="Residual by run" if answer["verdict"] == "adequate" else "Which runs carry it",
        choices=choices,
        sentence=html.escape(headline(analysis, discovered)),
        where=_where(analysis, answer),
        ranking=_ranking(analysis, discovered, [preview.effects for preview in shown]),
        next=_next(analysis, discovered),
        history=_history(history),
        parameters=_parameters(analysis),
        errors=_errors(analysis, answer),
        operating=_operating(discovered),
        notes=f'<section class="wide notes">{to_html(case.notes)}</section>' if case.notes else "",
        thinned=thinned,
        data=json.dumps(data, separators=(",", ":")).replace("<", "\\u003c"),
        plotly=get_plotlyjs().replace("</script", "<\\/script"),
    )


def _select(name: str, label: str, options: Sequence[tuple[str, str]], chosen: str) -> str:
    entries = "".join(
        f'<option value="{html.escape(value)}"{" selected" if value == chosen else ""}>{html.escape(text)}</option>'
        for value, text in options
    )
    return f'<label>{label} <select id="{name}">{entries}</select></label> '


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"


def _where(analysis: Analysis, answer: dict[str, Any]) -> str:
    if not answer["where"]:
        return ""
    along = {(f.variable, f.channel) for f in analysis.where if f.with_direction}
    items = []
    for failure in answer["where"][:4]:
        unit = _unit(analysis.case.units.get(failure["variable"], ""))
        mean = failure["mean_residual_in_sd"]
        way = ", along the motion" if (failure["variable"], failure["channel"]) in along else ""
        low, high = (number(value) for value in failure["range"])
        items.append(
            f"<li><b>{html.escape(failure['variable'])}</b> {low} to {high}{html.escape(unit)}: "
            f"{html.escape(failure['channel'])} measured {abs(mean):.1f} noise sd "
            f"{'above' if mean > 0 else 'below'} the model{way}</li>"
        )
    odd = [
        f"<li class='warn'>Run {html.escape(str(run))} stands out by itself: look at that run before looking for "
        "physics.</li>"
        for run in answer.get("odd_runs", [])
    ]
    return f"<ul class='where'>{''.join([*items, *odd])}</ul>"


def _equation(effect: Effect | None, candidate: dict[str, Any]) -> str:
    """Typeset: what the catalogue prints; for an expression, the formula and what it acts on."""
    if effect is not None and candidate["kind"] != "expression":
        return from_latex(effect.equation)
    return from_latex(f"{{{parse(candidate['expression']).to_latex()}}}") + (
        f" <span class='soft'>on {html.escape(str(candidate.get('target', '')))}</span>"
    )


def _values(parameters: dict[str, dict[str, Any]]) -> str:
    parts = [
        f"<span class='value'>{html.escape(name)} = {number(p['value'])} &plusmn; {float(p['sd']):.2g}"
        f"{html.escape(_unit(str(p['unit'])))}</span>"
        for name, p in parameters.items()
    ]
    return " ".join(parts)


def _ranking(analysis: Analysis, answer: dict[str, Any] | None, shown: Sequence[tuple[str, ...]]) -> str:
    """Cards: what is in the model, then the candidates, likeliest first. A click shows what the candidate would do."""
    if answer is None:
        return (
            "<section><h2>What is missing</h2><p class='soft'>Not looked for: <code>terrapin discover</code> does, "
            "or <code>terrapin report</code> without <code>--no-discover</code>.</p></section>"
        )
    library = analysis.case.library
    sets = {effects: i for i, effects in enumerate(shown)}
    parts = []
    missing = tuple(answer["missing"])
    if len(missing) > 1 and missing in sets:
        parts.append(
            f"<button class='all' data-preview='{sets[missing]}' aria-pressed='false'>Show all together: "
            f"{html.escape(' + '.join(missing))}</button>"
        )
    named = list(dict.fromkeys(name for effects in (missing, *answer["rivals"]) for name in effects))
    first = [c for c in answer["candidates"] if c["effect"] in named]
    first.sort(key=lambda c: named.index(c["effect"]))
    others = [c for c in answer["candidates"] if c["effect"] not in named]
    full = [*first, *others[: max(0, CARDS - len(first))]] if answer["verdict"] != "adequate" else others[: CARDS // 2]
    for candidate in full:
        parts.append(_card(analysis, answer, candidate, sets.get((candidate["effect"],)), candidate in first))
    rest = [c for c in answer["candidates"] if c not in full]
    if rest:
        rows = "".join(
            f"<tr><td><b>{html.escape(c['effect'])}</b><br><span class='soft'>"
            f"{html.escape(reason(analysis, answer, c, library.get(c['effect'])))}</span></td>"
            f"<td class='n'>{_chance(c['probability'])}</td></tr>"
            for c in rest
        )
        parts.append(
            f"<details><summary>{len(rest)} less likely</summary><table><tbody>{rows}</tbody></table></details>"
        )
    title = TITLES.get(answer["verdict"], "What is missing")
    hint = "<span class='soft'>click: what it would do</span>" if shown else ""
    return f"<section id='ranking'><h2>{title} {hint}</h2>{''.join(parts)}</section>" if parts else ""


def _chance(probability: float) -> str:
    if probability < 0.005:
        return "&lt; 1 %"
    return f"{100 * probability:.1f} %" if probability > 0.985 else f"{100 * probability:.0f} %"


def _card(
    analysis: Analysis, answer: dict[str, Any], candidate: dict[str, Any], preview: int | None, named: bool
) -> str:
    name, probability = candidate["effect"], float(candidate["probability"])
    effect = analysis.case.library.get(name)
    tag = "button" if preview is not None else "div"
    act = f" data-preview='{preview}' aria-pressed='false'" if preview is not None else ""
    title = effect.title if effect is not None and effect.title else "Expression found in the residuals"
    about = "" if title.lower().replace(" ", "_") == name else f"<span class='soft'>{html.escape(title)}</span>"
    return (
        f"<{tag} class='card{' named' if named else ''}'{act}><span class='row'><b>{html.escape(name)}</b>"
        f"<span class='bar' aria-hidden='true'><i style='width:{100 * probability:.1f}%'></i></span>"
        f"<span class='n'>{_chance(probability)}</span></span>"
        f"{about}<span class='eq'>{_equation(effect, candidate)}</span>"
        f"<span>{html.escape(reason(analysis, answer, candidate, effect))}</span>"
        f"<span class='soft'>{_values(candidate['parameters'])}</span></{tag}>"
    )


def _next(analysis: Analysis, answer: dict[str, Any] | None) -> str:
    """The next experiment, or the command that puts in what was found."""
    if answer is None:
        return ""
    folder = html.escape(analysis.case.folder.name or str(analysis.case.folder))
    if answer["verdict"] == "missing":
        command = f"terrapin add {folder} {' '.join(answer['missing'])}"
        text = "Put it in, and see the error fall:"
        return f"<section class='next ok'><h2>Next</h2><p>{text}</p><code>{html.escape(command)}</code></section>"
    if answer["verdict"] == "adequate":
        return (
            "<section class='next ok'><h2>Next</h2><p>Nothing to add. New runs outside these ranges would test more "
            "than more runs inside them.</p></section>"
        )
    plan = answer.get("next_experiment")
    if answer["verdict"] == "unexplained" or plan is None:
        text = (
            "No experiment within the limits of these runs would tell the rivals apart: treat them as one effect."
            if answer["verdict"] == "ambiguous"
            else "Look at the runs that carry it (below), and measure what may go with it: a column that is not there "
            "cannot be named."
        )
        return f"<section class='next'><h2>Next</h2><p>{text}</p></section>"
    units = {**ROLES, **analysis.case.units}
    roles = plan["vary"]
    head = "".join(f"<th class='n'>{html.escape(r)}{html.escape(_unit(units.get(r, '')))}</th>" for r in roles)
    rows = "".join(
        "<tr>" + "".join(f"<td class='n'>{number(setting[r])}</td>" for r in roles) + "</tr>"
        for setting in plan["settings"]
    )
    hold = ", ".join(
        f"{html.escape(r)} {number(v)}{html.escape(_unit(units.get(r, '')))}" for r, v in plan["hold"].items()
    )
    wrong = max(1, round(100 * float(plan["error_rate"])))
    return (
        f"<section class='next'><h2>Next experiment</h2><p><b>{plan['runs']} runs</b> over these settings of "
        f"{html.escape(' and '.join(roles))}. {html.escape(plan['reason'])}</p>"
        f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
        f"<p class='soft'>{f'Hold {hold}. ' if hold else ''}Afterwards the wrong one would be preferred in {wrong} of "
        "100 cases.</p></section>"
    )


def _history(history: Sequence[dict[str, Any]]) -> str:
    if not history:
        return ""
    items = []
    for entry in history:
        before, after = entry["before"].get("heldout_error"), entry["after"].get("heldout_error")
        names = html.escape(" + ".join(map(str, entry["effects"])))
        change = f"held out {number(before)} &rarr; {number(after)}"
        items.append(f"<li>{html.escape(str(entry['action']))} <b>{names}</b>: {change}</li>")
    return f"<details><summary>History: {len(items)} steps</summary><ol>{''.join(items)}</ol></details>"


def _parameters(analysis: Analysis) -> str:
    rows = []
    for fitted, value, sd in zip(analysis.model.fitted, analysis.fit.theta, analysis.sd, strict=True):
        stuck = '<br><span class="warn">at its bound</span>' if fitted.key in analysis.fit.at_bound else ""
        amount = f"{value:.5g} &plusmn; {sd:.2g}"
        rows.append(
            f"<tr><td>{html.escape(fitted.key)}{stuck}</td><td class='n'>{amount}</td>"
            f"<td>{html.escape(_unit(fitted.unit))}</td></tr>"
        )
    for effect in analysis.model.effects:
        rows.append(
            f"<tr><td colspan='3'><b>{html.escape(effect.name)}</b> <span class='soft'>in the model</span>"
            f"<span class='eq'>{from_latex(effect.equation)}</span></td></tr>"
        )
    return f"<table><tbody>{''.join(rows)}</tbody></table>" if rows else "<p>None is fitted.</p>"


def _errors(analysis: Analysis, answer: dict[str, Any]) -> str:
    rows = ""
    for name, c in answer["channels"].items():
        cells = "".join(f"<td class='n'>{number(c[key])}</td>" for key in ("noise_sd", "train_rmse", "heldout_rmse"))
        rows += f"<tr><td>{html.escape(name)}</td>{cells}<td>{html.escape(c['unit'])}</td></tr>"
    head = (
        "<tr><th></th><th class='n'>noise sd</th><th class='n'>training</th><th class='n'>held out</th><th></th></tr>"
    )
    source = html.escape(f"{analysis.noise.source[:1].upper()}{analysis.noise.source[1:]}.")
    rho = f"Correlation from row to row within a run: {analysis.noise.rho:g}."
    return f"<table><thead>{head}</thead><tbody>{rows}</tbody></table><p class='soft'>{source} {rho}</p>"


def _operating(answer: dict[str, Any] | None) -> str:
    """How often such an effect would be named with these runs, and how often the answer came out of a bootstrap."""
    if not answer or not (answer.get("operating") or answer.get("selected")):
        return ""
    items = "".join(
        f"<tr><td><b>{html.escape(o['effect'])}</b> of {number(o['size'])} noise sd</td>"
        f"<td class='n'>{round(100 * o['named'])} of 100<span class='bar'><i style='width:{100 * o['named']:.0f}%'></i>"
        "</span></td></tr>"
        for o in answer.get("operating", [])
    )
    items += "".join(
        f"<tr><td>{html.escape(' + '.join(s['effects']) or s['kind'])} <span class='soft'>runs drawn anew</span></td>"
        f"<td class='n'>{round(100 * s['frequency'])} of 100</td></tr>"
        for s in answer.get("selected", [])
    )
    return (
        "<section><h2>What these runs can show</h2><table><thead><tr><th>an effect like this</th>"
        f"<th class='n'>named first in</th></tr></thead><tbody>{items}</tbody></table></section>"
    )
