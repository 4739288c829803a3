"""An analysis in plain words, for a terminal or a pipe."""

from __future__ import annotations

import math
from collections.abc import Sequence

from host_tools.workbench.analysis import Analysis

__all__ = ["describe", "ladder_lines", "number", "verdict_line"]


def number(value: float | None) -> str:
    """Four digits, as short as they go; a dash for what is not there."""
    if value is None or not math.isfinite(value):
        return "-"
    return f"{value:.4g}"


def verdict_line(analysis: Analysis) -> str:
    p, level = analysis.adequacy.p_value, analysis.level
    share = f"p = {p:.2g}" if p >= 1e-12 else "p < 1e-12"
    if analysis.missing:
        return f"Something is missing from the model ({share}, false alarm rate {level:g})."
    return f"Nothing is missing that these data could show ({share}, false alarm rate {level:g})."


def describe(analysis: Analysis) -> str:
    """The answer of compare: verdict first, then where it fails, parameters, errors."""
    case = analysis.case
    held = sorted({case.run_names[i] for i in case.run[case.test]})
    used = len({*case.run[case.train | case.test]})
    lines = [f"{case.title}: {used} runs, {len(held)} held out, model {case.base.name}"]
    if case.effects:
        lines[0] += " + " + " + ".join(case.effects)
    lines += ["", verdict_line(analysis)]
    if analysis.where:
        lines += ["", "Where it fails (residual = measured - predicted, in noise sd):"]
        rows = []
        for failure in analysis.where:
            unit = case.units.get(failure.variable, "")
            span = f"{number(failure.low)} to {number(failure.high)}" + (f" {unit}" if unit not in ("", "1") else "")
            towards = " along the motion" if failure.with_direction else ""
            rows.append([failure.variable, span, f"{failure.channel} {failure.mean_residual:+.1f}{towards}"])
        lines += _table(rows)
    lines += ["", "Parameters:"]
    rows = []
    for fitted, value, sd in zip(analysis.model.fitted, analysis.fit.theta, analysis.sd, strict=True):
        unit = "" if fitted.unit in ("", "1") else fitted.unit
        note = "at its bound" if fitted.key in analysis.fit.at_bound else ""
        rows.append([fitted.key, f"{value:.5g}", f"+- {sd:.2g}", unit, note])
    lines += _table(rows)
    lines += ["", f"Errors ({analysis.noise.source}; correlation within a run {analysis.noise.rho:g}):"]
    rows = [["channel", "noise sd", "training rms", "held-out rms", ""]]
    inside = case.test[analysis.rows]
    for i, name in enumerate(analysis.model.channels):
        residual = analysis.residual[i]
        train = float((residual[~inside] ** 2).mean() ** 0.5)
        test = float((residual[inside] ** 2).mean() ** 0.5) if inside.any() else None
        rows.append([name, number(analysis.noise.sigma[i]), number(train), number(test), case.units[name]])
    lines += _table(rows)
    lines += ["", *ladder_lines(analysis)]
    return "\n".join(lines)


def ladder_lines(analysis: Analysis) -> list[str]:
    rows = [["added", "training", "held out"]]
    for rung in analysis.ladder:
        rows.append([rung.added or "(base model)", number(rung.train_error), number(rung.heldout_error)])
    return ["Error ladder, in noise sd (1.0 is the noise floor):", *_table(rows)]


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]
