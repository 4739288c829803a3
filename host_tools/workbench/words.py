"""What discover found, in plain words for a terminal: is anything missing, where, what, how sure, and what next."""

from __future__ import annotations

import textwrap

from host_tools.workbench.discovery import Candidate, Discovery
from host_tools.workbench.show import number, verdict_line

__all__ = ["tell"]

SHOWN = 6  # candidates


def tell(found: Discovery) -> str:
    """The answer as text, verdict first."""
    case = found.analysis.case
    runs = len({*case.run[found.analysis.rows]})
    lines = [f"{case.title}: {runs} runs, model {' + '.join([case.base.name, *case.effects])}", ""]
    lines += ["1. " + verdict_line(found.analysis), ""]
    lines += _where(found)
    lines += _what(found)
    lines += _ladder(found)
    if found.verdict == "ambiguous":
        lines += _next(found)
    if found.verdict == "missing":
        lines += ["", f"Add it:  terrapin add CASE {' '.join(found.missing)}"]
    return "\n".join(lines)


def _where(found: Discovery) -> list[str]:
    if not found.where:
        return []
    units = found.analysis.case.units
    lines = ["2. Where the model fails (residual = measured - predicted, in noise sd):"]
    for failure in found.where:
        unit = units.get(failure.variable, "")
        span = f"{number(failure.low)} to {number(failure.high)}" + (f" {unit}" if unit not in ("", "1") else "")
        lines.append(f"   {failure.variable}: {span}, {failure.channel} {failure.mean_residual:+.1f}")
    for run in found.odd_runs:
        lines.append(f"   Run {run} stands out by itself: look at that run before looking for physics.")
    return [*lines, ""]


def _what(found: Discovery) -> list[str]:
    sure = f"probability {found.answer_probability:.2f}"
    if found.verdict == "adequate":
        lines = [f"   The model is adequate ({sure} that nothing is missing)."]
        strong = [c for c in found.candidates if c.probability > 0.05][:3]
        if strong:
            names = ", ".join(f"{c.effect.name} ({c.probability:.2f})" for c in strong)
            lines.append(f"   Too small to tell, if there at all: {names}.")
        return lines
    if found.verdict == "unexplained":
        lines = ["3. No effect of the catalogue and no short expression explains it."]
    elif found.verdict == "ambiguous":
        sets = " or ".join(" + ".join(effects) for effects in found.rivals)
        lines = [f"3. These data cannot tell: {sets} explain them equally well. Likeliest: {_sum(found)} ({sure})."]
    else:
        lines = [f"3. Missing: {_sum(found)} ({sure})."]
    lines += ["", "   candidate alone           probability  held-out error  explains"]
    for candidate in found.candidates[:SHOWN]:
        lines.append(
            f"   {candidate.effect.name:<26}{candidate.probability:>9.3f}  {number(candidate.noise_ratio):>14}"
            f"  {100 * candidate.explains:>6.0f} %"
        )
    for candidate in found.candidates:
        if candidate.effect.name in found.missing:
            lines += _parameters(candidate)
    for operating in found.operating:
        lines.append(
            f"4. With these runs, {operating.effect} of {number(operating.size)} noise sd "
            f"would be named first in {round(100 * operating.named)} of 100 cases."
        )
    return lines


def _sum(found: Discovery) -> str:
    return " + ".join(found.missing)


def _parameters(candidate: Candidate) -> list[str]:
    count = len(candidate.fit.theta) - len(candidate.effect.parameters)
    lines = []
    if candidate.kind == "expression":
        lines.append(f"   {candidate.effect.name} = {candidate.effect.expression}   on {candidate.effect.target}")
    for i, parameter in enumerate(candidate.effect.parameters):
        unit = "" if parameter.unit in ("", "1") else f" {parameter.unit}"
        value, sd = candidate.fit.theta[count + i], candidate.sd[count + i]
        lines.append(f"   {candidate.effect.name}.{parameter.name} = {value:.4g} +- {sd:.2g}{unit}")
    return lines


def _ladder(found: Discovery) -> list[str]:
    lines = ["", "Errors in noise sd (1.0 is the noise floor): training, held out"]
    for rung in found.ladder:
        lines.append(
            f"   {rung.added or '(base model)':<40}{number(rung.train_error):>8}{number(rung.heldout_error):>10}"
        )
    return lines


def _next(found: Discovery) -> list[str]:
    plan = found.experiment
    if plan is None:
        return ["", "5. No experiment within the range of these runs would tell them apart: treat them as one effect."]
    lines = ["", f"5. Measure next: {plan.runs} runs over these settings of {' and '.join(plan.vary)}:"]
    for setting in plan.settings:
        values = ", ".join(f"{role} {number(value)}" for role, value in setting.items())
        lines.append(f"   {values}")
    lines += textwrap.wrap(plan.reason, 110, initial_indent="   ", subsequent_indent="   ")
    lines.append(
        f"   Afterwards the wrong one would be preferred in {max(1, round(100 * plan.error_rate))} of 100 cases."
    )
    return lines
