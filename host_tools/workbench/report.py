"""One self-contained HTML page of an analysis: verdict first, then where it fails, the ladder, the parameters."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from hil.physics.effects import catalogue
from host_tools.workbench.analysis import Analysis, predict
from host_tools.workbench.answer import compare_answer
from host_tools.workbench.directions import numeric_columns
from host_tools.workbench.markdown import to_html
from host_tools.workbench.report_page import fill
from host_tools.workbench.show import number, verdict_line

__all__ = ["render"]

MAX_POINTS = 4000  # rows drawn; of more, every k-th


def render(analysis: Analysis, discovered: dict[str, Any] | None = None) -> str:
    """The page as text. `discovered`: the last answer of `terrapin discover` on this case, for the ranking."""
    from plotly.offline import get_plotlyjs

    case = analysis.case
    answer = compare_answer(analysis, 0.0)
    data = _data(analysis, answer)
    runs = len({*case.run[analysis.rows].tolist()})
    held = len({*case.run[case.test].tolist()})
    effects = "".join(f" + {name}" for name in case.effects)
    choices = _select("variable", [(name, name) for name in data["columns"]], data["variable"])
    if len(data["channels"]) > 1:
        choices = _select("channel", [(str(i), c["name"]) for i, c in enumerate(data["channels"])], "0") + choices
    return fill(
        title=html.escape(case.title),
        what=html.escape(f"{runs} runs, {held} held out \u00b7 {case.base.name}{effects}"),
        verdict="missing" if analysis.missing else "adequate",
        chip="something is missing" if analysis.missing else "adequate",
        base_key="<span> &#9473; base model</span>" if case.effects else "",
        fail_key='<span style="color:var(--red)"> &#9646; fails here</span>' if analysis.where else "",
        choices=f"<label>{choices}</label>",
        sentence=html.escape(verdict_line(analysis)),
        where=_where(analysis),
        ranking=_ranking(discovered),
        parameters=_parameters(analysis),
        errors=_errors(analysis, answer),
        notes=f'<section class="wide notes">{to_html(case.notes)}</section>' if case.notes else "",
        data=json.dumps(data).replace("</", "<\\/"),
        plotly=get_plotlyjs().replace("</script", "<\\/script"),
    )


def _data(analysis: Analysis, answer: dict[str, Any]) -> dict[str, Any]:
    case = analysis.case
    count = int(analysis.rows.sum())
    every = slice(None, None, max(1, -(-count // MAX_POINTS)))

    def numbers(values: Any) -> list[float]:
        return [float(f"{v:.7g}") for v in np.asarray(values)[every]]

    columns = {
        name: {"values": numbers(values[analysis.rows]), "unit": case.units.get(name, "")}
        for name, values in numeric_columns(case).items()
    }
    columns["row"] = {"values": numbers(np.arange(1, count + 1)), "unit": ""}
    if analysis.where:
        variable = analysis.where[0].variable
    else:
        roles = [role for role in (*case.base.needs, *case.roles) if role in case.roles]
        varying = [role for role in roles if np.ptp(case.roles[role]) > 0]
        variable = varying[0] if varying else "row"
    base = predict(analysis.ladder[0].fit, analysis.rows) if case.effects else None
    channels = []
    order = list(analysis.model.channels)
    if analysis.where:  # the channel that fails most stands first
        order.sort(key=lambda name: name != analysis.where[0].channel)
    for name in order:
        i = analysis.model.channels.index(name)
        channels.append(
            {
                "name": name,
                "unit": case.units[name],
                "noise_sd": float(analysis.noise.sigma[i]),
                "measured": numbers(analysis.prediction[i] + analysis.residual[i]),
                "predicted": numbers(analysis.prediction[i]),
                "residual": numbers(analysis.residual[i] / analysis.noise.sigma[i]),
                "base": None if base is None else numbers(base[i]),
            }
        )
    return {
        "variable": variable,
        "columns": columns,
        "channels": channels,
        "run": [case.run_names[i] for i in case.run[analysis.rows][every]],
        "held": [bool(v) for v in case.test[analysis.rows][every]],
        "where": answer["where"],
        "ladder": answer["ladder"],
    }


def _select(name: str, options: Sequence[tuple[str, str]], chosen: str) -> str:
    entries = "".join(
        f'<option value="{html.escape(value)}"{" selected" if value == chosen else ""}>{html.escape(text)}</option>'
        for value, text in options
    )
    return f'<select id="{name}" aria-label="{name}">{entries}</select> '


def _where(analysis: Analysis) -> str:
    if not analysis.where:
        return ""
    items = []
    for failure in analysis.where:
        unit = analysis.case.units.get(failure.variable, "")
        span = f"{number(failure.low)} to {number(failure.high)}" + (f" {unit}" if unit not in ("", "1") else "")
        side = "above" if failure.mean_residual > 0 else "below"
        along = " (along the motion)" if failure.with_direction else ""
        items.append(
            f"<li><b>{html.escape(failure.variable)}</b> {html.escape(span)}: {html.escape(failure.channel)} measured "
            f"{abs(failure.mean_residual):.1f} noise sd {side} the model{along}</li>"
        )
    return f"<p>Where it fails, strongest first:</p><ul>{''.join(items)}</ul>"


def _ranking(discovered: dict[str, Any] | None) -> str:
    if not discovered or not discovered.get("candidates"):
        return ""
    rows = []
    for candidate in discovered["candidates"][:6]:
        probability = float(candidate.get("probability") or 0.0)
        effect = catalogue().get(candidate["effect"])
        about = effect.title if effect else candidate.get("expression", "")
        share = f"{100 * probability:.0f}"
        rows.append(
            f"<tr><td><b>{html.escape(candidate['effect'])}</b><br><span class='soft'>{html.escape(about)}</span></td>"
            f"<td class='n'>{share} %<div class='bar'><i style='width:{share}%'></i></div></td></tr>"
        )
    following = discovered.get("next_experiment")
    reason = f"<p><b>Next experiment.</b> {html.escape(str(following.get('reason', '')))}</p>" if following else ""
    return f"<section><h2>What is missing</h2><table><tbody>{''.join(rows)}</tbody></table>{reason}</section>"


def _parameters(analysis: Analysis) -> str:
    rows = []
    for fitted, value, sd in zip(analysis.model.fitted, analysis.fit.theta, analysis.sd, strict=True):
        stuck = '<br><span class="warn">at its bound</span>' if fitted.key in analysis.fit.at_bound else ""
        unit = "" if fitted.unit in ("", "1") else html.escape(fitted.unit)
        amount = f"{value:.5g} &plusmn; {sd:.2g}"
        rows.append(f"<tr><td>{html.escape(fitted.key)}{stuck}</td><td class='n'>{amount}</td><td>{unit}</td></tr>")
    for effect in analysis.model.effects:
        rows.append(
            f"<tr><td colspan='3'><span class='soft'>{html.escape(effect.name)}:</span> "
            f"<code>{html.escape(effect.expression)}</code> on {html.escape(effect.target)}</td></tr>"
        )
    return f"<table><tbody>{''.join(rows)}</tbody></table>" if rows else "<p>None is fitted.</p>"


def _errors(analysis: Analysis, answer: dict[str, Any]) -> str:
    rows = ""
    for name, c in answer["channels"].items():
        cells = "".join(f"<td class='n'>{number(c[key])}</td>" for key in ("noise_sd", "train_rmse", "heldout_rmse"))
        rows += f"<tr><td>{html.escape(name)}</td>{cells}<td>{html.escape(c['unit'])}</td></tr>"
    head = (
        "<tr><th>rms</th><th class='n'>noise</th><th class='n'>training</th><th class='n'>held out</th><th></th></tr>"
    )
    source = html.escape(f"{analysis.noise.source}; correlation within a run {analysis.noise.rho:g}")
    return f"<table><thead>{head}</thead><tbody>{rows}</tbody></table><p class='soft'>{source}</p>"
