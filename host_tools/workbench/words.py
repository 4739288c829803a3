"""What discover found, in plain words for a terminal, in the order in which one asks.

1 is anything missing, 2 where does the model fail, 3 what is missing, 4 how sure, 5 what to measure next when the data
cannot tell, 6 what it depends on when no catalogue has it; then the errors step by step and the command that adds it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np

from hil.physics.effects import Effect
from host_tools.workbench.confidence import EVEN, Operating
from host_tools.workbench.discovery import Discovery
from host_tools.workbench.fit import covariance
from host_tools.workbench.show import number, verdict_line

__all__ = ["tell"]

SHOWN = 6  # candidates
NAMED_RUNS = 4  # runs that are named as carrying the misfit
WIDTH = 110
UNLIKELY = 0.005  # probability below which a candidate is shown only when nothing else is


def tell(found: Discovery) -> str:
    """The answer as text."""
    case = found.analysis.case
    runs = len({*case.run[found.analysis.rows]})
    lines = [f"{case.title}: {runs} runs, model {' + '.join([case.base.name, *case.effects])}", ""]
    lines += ["1. " + verdict_line(found.analysis)]
    if found.verdict == "adequate":
        if found.answer_probability < EVEN:
            analysis = found.analysis
            lines[-1] = f"1. No alarm (p = {analysis.adequacy.p_value:.2g}, false alarm rate {analysis.level:g})."
        lines += _adequate(found)
        return "\n".join([*lines, *_resampled(found), "", *_ladder(found)])
    lines += ["", *_where(found), "", *_what(found), "", *_sure(found), *_resampled(found)]
    if found.verdict == "ambiguous":
        lines += ["", *_next(found)]
    unknown = _unknown(found)
    if unknown:
        lines += ["", *unknown]
    lines += ["", *_ladder(found)]
    if found.missing:
        which = "it" if found.verdict == "missing" else "the likeliest"
        lines += ["", f"Add {which}:  {_command(found)}"]
    return "\n".join(lines)


def _command(found: Discovery) -> str:
    return f"terrapin add {found.analysis.case.folder} {' '.join(found.missing)}"


def _adequate(found: Discovery) -> list[str]:
    p = found.answer_probability
    if p >= EVEN:
        lines = [f"   The model is adequate (probability {p:.2f} that nothing is missing)."]
    elif found.ranking.blind:
        lines = [
            "   These runs could not show it either: the model's own parameters take up whatever these columns say.",
            "   Measure at more settings, or fit fewer parameters.",
        ]
    else:
        likeliest = max(found.ranking.hypotheses, key=lambda h: h.log_weight)
        what = " + ".join(likeliest.effects) or f"something that depends on {likeliest.column or 'no one column'}"
        share = f"{p:.2f}" if p >= 0.01 else "below 0.01"
        lines = [
            "   The model passes the test, but that does not make it right: compared with all other answers, that",
            f"   nothing is missing has probability {share}. Likeliest, but not shown: {what}.",
            "   Give each channel's sigma, map the columns that may matter, or measure more runs.",
        ]
    strong = [c for c in found.candidates if c.probability > 0.05][:3]
    if strong:
        names = ", ".join(f"{c.effect.name} ({c.probability:.2f})" for c in strong)
        lines.append(f"   Too small to tell, if there at all: {names}.")
    return lines


def _unit(found: Discovery, variable: str) -> str:
    unit = found.analysis.case.units.get(variable, "")
    return "" if unit in ("", "1") else f" {unit}"


def _where(found: Discovery) -> list[str]:
    lines = ["2. Where the model fails (measured - predicted, in noise sd, mean over the range):"]
    seen = set()
    for failure in found.where:
        if (failure.variable, failure.channel) in seen:
            continue
        seen.add((failure.variable, failure.channel))
        span = f"{number(failure.low)} to {number(failure.high)}{_unit(found, failure.variable)}"
        towards = " along the motion" if failure.with_direction else ""
        lines.append(f"   {failure.variable} {span}: {failure.channel} {failure.mean_residual:+.1f}{towards}")
    if found.odd_runs:
        which = "Run" if len(found.odd_runs) == 1 else "Runs"
        stands = "stands out by itself" if len(found.odd_runs) == 1 else "stand out by themselves"
        there = "it" if len(found.odd_runs) == 1 else "them"
        lines.append(f"   {which} {', '.join(found.odd_runs)} {stands}: look at {there} before looking for physics.")
    else:
        lines.append(f"   {_carried(found)}")
    return lines


def _carried(found: Discovery) -> str:
    """The runs whose misfit beyond noise makes up half of all."""
    analysis = found.analysis
    run = analysis.case.run[analysis.rows]
    square = ((analysis.residual / analysis.noise.sigma[:, None]) ** 2).mean(axis=0) - 1.0
    each = {int(r): float(square[run == r].sum()) for r in np.unique(run)}
    order = sorted(each, key=lambda r: -each[r])
    total = sum(max(value, 0.0) for value in each.values())
    half, carrying = 0.0, []
    for r in order:
        if half >= 0.5 * total:
            break
        half += each[r]
        carrying.append(r)
    if not carrying:
        return "No run is further off than its noise: the misfit is in how the rows follow each other."
    error = {r: float(np.sqrt(max(square[run == r].mean() + 1.0, 0.0))) for r in carrying}
    names = ", ".join(f"{analysis.case.run_names[r]} (error {number(error[r])})" for r in carrying[:NAMED_RUNS])
    more = f" and {len(carrying) - NAMED_RUNS} more" if len(carrying) > NAMED_RUNS else ""
    return f"Half of it is in {len(carrying)} of {len(order)} runs: {names}{more}."


def _what(found: Discovery) -> list[str]:
    case = found.analysis.case
    if found.odd_runs and found.verdict == "unexplained":
        lines = ["3. What is missing: nothing in general. What fails is a single run, not the model."]
    elif found.verdict == "unexplained":
        lines = ["3. What is missing: unknown. No effect of the catalogue and no short expression explains it."]
        if found.leaves is not None and found.best is not None:
            errors = f"{number(found.best.train_error)} training, {number(found.best.heldout_error)} held out"
            lines.append(f"   The best set, {found.best.added}, leaves more than noise: error {errors}.")
    elif found.verdict == "ambiguous":
        sets = " or ".join(" + ".join(effects) for effects in found.rivals)
        lines = [f"3. These data cannot tell: {sets} explain them equally well."]
    else:
        lines = [f"3. Missing: {' + '.join(found.missing)}."]
    lines += _named(found, "catalogue")
    shown = [c for c in found.candidates if c.probability >= UNLIKELY or c.effect.name in found.missing][:SHOWN]
    shown = shown or list(found.candidates[:1])
    weight = "if one is it" if found.verdict == "unexplained" else " probability"
    lines += ["", f"   candidate alone          {weight}  held-out error  explains"]
    for candidate in shown:
        lines.append(
            f"   {candidate.effect.name:<26}{candidate.probability:>11.3f}  {number(candidate.noise_ratio):>14}"
            f"  {100 * candidate.explains:>6.0f} %"
        )
    unnamed = [c.effect for c in shown if c.kind == "expression" and c.effect.name not in found.missing]
    return lines + [_formula(effect, case.base.channels) for effect in unnamed]


def _unknown(found: Discovery) -> list[str]:
    """What no catalogue has: the expressions, or what the misfit depends on."""
    if found.verdict == "unexplained":
        if found.odd_runs or not found.where:
            return []
        return [f"6. What it depends on: {found.where[0].variable} most. See 2 for the range."]
    formulas = _named(found, "expression")
    if not formulas:
        return []
    return [
        "6. In no catalogue, but in these data:",
        *formulas,
        "   It holds inside the range of these measurements, not beyond.",
    ]


def _named(found: Discovery, kind: str) -> list[str]:
    """Effects of that kind among the named ones, and the values of their parameters, all refitted together."""
    if not found.missing:
        return []
    fit = found.ladder[-1].fit
    case, rho = found.analysis.case, found.analysis.noise.rho
    variance = np.diag(covariance(fit, case.run[case.train], rho)[0])
    kinds = {c.effect.name: c.kind for c in found.candidates}
    lines = []
    for effect in fit.model.effects:
        if effect.name not in found.missing or kinds.get(effect.name, "catalogue") != kind:
            continue
        if kind == "expression":
            lines.append(_formula(effect, case.base.channels))
        else:
            lines.append(f"   {effect.name}: {effect.title}")
        for i, fitted in enumerate(fit.model.fitted):
            if fitted.effect == effect.name:
                unit = "" if fitted.unit in ("", "1") else f" {fitted.unit}"
                sd = f" +- {np.sqrt(variance[i]):.2g}" if variance[i] > 0.0 else ""
                note = " (at its bound)" if fitted.key in fit.at_bound else ""
                lines.append(f"      {fitted.name} = {fit.theta[i]:.4g}{sd}{unit}{note}")
    return lines


def _formula(effect: Effect, channels: Sequence[str]) -> str:
    """What an expression says: its name tells nothing."""
    return f"   {effect.name} = {effect.expression}, {_acts(effect.target, channels)}"


def _acts(target: str, channels: Sequence[str]) -> str:
    if target in ("resistance", "drag"):
        return f"added to the resisting {'torque' if target == 'resistance' else 'force'}"
    return f"added to {target}" if target in channels else f"{target} is multiplied by 1 + it"


def _sure(found: Discovery) -> list[str]:
    if found.verdict == "unexplained":
        return [
            f"4. How sure: {found.answer_probability:.2f} that none of these effects alone or together is the answer."
        ]
    what = " + ".join(found.missing)
    lead = "the likeliest is " if found.verdict == "ambiguous" else ""
    lines = [f"4. How sure: {lead}{what}, with probability {found.answer_probability:.2f}."]
    sizes: dict[str, Operating] = {}
    for operating in found.operating:
        sizes.setdefault(number(operating.size), operating)
    for size, operating in sizes.items():
        lines.append(
            f"   With these runs, {operating.effect} of {size} noise sd would be named first in "
            f"{round(100 * operating.named)} of 100 cases."
        )
    return lines


def _resampled(found: Discovery) -> list[str]:
    """How often each answer wins on resampled sets of runs."""
    if not found.selected:
        return []
    lines = ["   Drawn anew from these runs, the likeliest answer is:"]
    for one in found.selected[:SHOWN]:
        name = " + ".join(one.effects) or one.kind
        lines.append(f"   {name:<48}{100 * one.frequency:>5.1f} %")
    return lines


def _next(found: Discovery) -> list[str]:
    plan = found.experiment
    if plan is None:
        return ["5. No experiment that this rig can make would tell them apart: treat them as one effect."]
    lines = [f"5. Measure next: {plan.runs} runs that vary {' and '.join(plan.vary)}."]
    for setting, count in _counted(plan.settings):
        values = ", ".join(f"{role} {number(value)}{_set_unit(found, role)}" for role, value in setting)
        lines.append(f"   {count} x {values}")
    if plan.hold:
        kept = [(role, _rounded(found, role, value)) for role, value in plan.hold.items()]
        held = ", ".join(f"{role} {number(value)}{_set_unit(found, role)}" for role, value in kept)
        lines.append(f"   Hold {held}.")
    lines += textwrap.wrap(f"Why: {plan.reason}", WIDTH, initial_indent="   ", subsequent_indent="   ")
    wrong = 100 * plan.error_rate
    share = f"{wrong:.0f}" if wrong >= 1 else "fewer than 1"
    return [*lines, f"   Afterwards the wrong one would be preferred in {share} of 100 cases."]


def _rounded(found: Discovery, role: str, value: float) -> float:
    """0 for what is as good as 0 on the scale of the measurements."""
    values = found.analysis.case.roles.get(role)
    return 0.0 if values is not None and abs(value) < 0.01 * float(np.abs(values).max()) else value


def _set_unit(found: Discovery, role: str) -> str:
    case = found.analysis.case
    unit = case.units.get(role, case.parameter_units.get(role, ""))
    return "" if unit in ("", "1") else f" {unit}"


def _counted(settings: Sequence[Mapping[str, float]]) -> list[tuple[list[tuple[str, float]], int]]:
    """Settings in order, each once, with how many runs it gets."""
    counts: dict[tuple[tuple[str, float], ...], int] = {}
    for setting in settings:
        key = tuple(setting.items())
        counts[key] = counts.get(key, 0) + 1
    return [(list(key), count) for key, count in counts.items()]


def _ladder(found: Discovery) -> list[str]:
    lines = ["Errors in noise sd (1.0 is the noise floor):    training  held out"]
    for rung in found.ladder:
        lines.append(
            f"   {rung.added or '(base model)':<42}{number(rung.train_error):>11}{number(rung.heldout_error):>10}"
        )
    return lines
