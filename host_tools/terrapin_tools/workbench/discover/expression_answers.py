"""What no catalogue has: short expressions alone, sums of them, and beside effects of the catalogue.

They compete with all other answers. A sum takes its next term where the evidence gains more than chance would give and
the held-out runs are predicted better; at most three terms, so that an answer stays one that a person can read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import logsumexp

from terrapin_hil.physics.effects import Effect
from terrapin_tools.workbench.discover.expressions import SCALE_COST, Library, Sketch, as_effect, library
from terrapin_tools.workbench.discover.hypothesis import Hypothesis
from terrapin_tools.workbench.discover.leftover import absent, pays
from terrapin_tools.workbench.noise.marginal_likelihood import Evidence

if TYPE_CHECKING:
    from terrapin_tools.workbench.discover.ranker import Ranker

__all__ = ["beside_effects", "expressions"]

REFITTED = 6  # expressions; chosen by hand, for time
OF_ONE_COLUMN = 2  # of them at most: shapes of one column look alike, and another column must get its chance
WITHIN = 12.0  # log evidence behind the best beyond which no expression is refitted: as in ranking.py
ROUGHLY = 0.2  # of the log evidence that the best term gains; chosen by hand
INSTEAD = 4  # likeliest terms around the best refit; chosen by hand, for time
TERMS = 3  # of a sum, so that a person can read it
SUMMED = 2  # expressions beside which a second term is looked for; chosen by hand, for time
NEXT_TERM = 0.02  # prior factor of a further term; chosen by hand
# Log evidence (a factor of 20) by which a sum, or an expression beside effects, must beat all shorter answers. By hand.
MIXED = 3.0
MISFIT = 3.0  # standard deviations of the sum of squares above its mean that noise may explain; chosen by hand


@dataclass(frozen=True)
class _Longer:
    """The best sketch to add to a hypothesis: the weight of all that could be added, and the sketch."""

    weight: float
    sketch: Sketch
    base: Hypothesis


def _longer(ranker: Ranker, base: Hypothesis, share: float) -> _Longer:
    """What an expression more would do; `share` is the prior probability that there is one more."""
    listed = ranker.listed
    assert listed is not None
    assert base.fit is not None
    beyond, _ = ranker.beyond(base.fit)
    gains = beyond.single(listed.columns) - beyond.nothing + np.log([s.prior for s in listed.sketches]) + np.log(share)
    return _Longer(base.log_weight + float(logsumexp(gains)), listed.sketches[int(np.argmax(gains))], base)


def expressions(
    ranker: Ranker, prior: float, best: float
) -> tuple[list[Hypothesis], dict[str, Effect], dict[str, float]]:
    """Expressions around the present fit; the best are refitted. Others keep their weight as a group."""
    case, flat = ranker.case, ranker.base.reshape(ranker.evidence.residual.size, -1)
    catalogue = (
        np.concatenate([s.columns for s in ranker.flat], axis=1) if ranker.flat else np.zeros((flat.shape[0], 0))
    )
    listed: Library = library(ranker.model, ranker.analysis.fit.theta, ranker.rows, ranker.sigma, catalogue, flat)
    ranker.listed = listed
    if not listed.sketches:
        return [], {}, {}
    logs = ranker.evidence.single(listed.columns)
    weight = logs + np.log([s.prior for s in listed.sketches]) + np.log(prior)
    columns: dict[str, list[float]] = {}
    for sketch, value in zip(listed.sketches, weight, strict=True):
        columns.setdefault(sketch.column, []).append(float(value))
    column_weight = {name: float(logsumexp(values)) for name, values in columns.items()}
    order = np.argsort(-weight, kind="stable")
    found: list[Hypothesis] = []
    effects: dict[str, Effect] = {}
    grouped: dict[str, list[float]] = {}
    tried: dict[str, int] = {}
    within = WITHIN
    texts: set[tuple[str, str]] = set()
    if case.dynamics is not None:  # a lacking term bends the motion: what is told straight around it is told roughly
        within = max(WITHIN, ROUGHLY * float(weight[order[0]] - ranker.evidence.nothing))
    for index in order:
        chosen: Sketch = listed.sketches[index]
        close = weight[index] > max(best, weight[order[0]]) - within
        room = len(effects) < REFITTED and tried.get(chosen.column, 0) < OF_ONE_COLUMN
        if case.dynamics is not None:
            room &= (chosen.target, chosen.text) not in texts
        if room and close and ranker.analysis.missing:
            texts.add((chosen.target, chosen.text))
            tried[chosen.column] = tried.get(chosen.column, 0) + 1
            found.append(_refitted(ranker, chosen, effects, prior, float(weight[index])))
        else:
            grouped.setdefault(chosen.column, []).append(float(weight[index]))
    if case.dynamics is not None and found:
        for chosen in _instead(ranker, max(found, key=lambda h: h.log_weight), texts):
            found.append(_refitted(ranker, chosen, effects, prior, -np.inf))
    found += _sums(ranker, found, effects, max([best, *(h.log_weight for h in found)]))
    for column, values in grouped.items():
        found.append(Hypothesis((), "expression", float(logsumexp(values)), None, column))
    return found, effects, column_weight


def _refitted(ranker: Ranker, chosen: Sketch, effects: dict[str, Effect], prior: float, rough: float) -> Hypothesis:
    """A sketch refitted, under the next free name; `rough` is its log weight where the refit cannot tell."""
    name = f"expression_{len(effects) + 1}"
    effects[name] = as_effect(chosen, ranker.case, name)
    fit = ranker.fit((name,), {name: effects[name]})
    value = ranker.around(fit, (name,))
    cost = float(np.log(chosen.prior) + np.log(prior)) - SCALE_COST * len(chosen.scales)
    return Hypothesis((name,), "expression", rough if value is None else value + cost, fit, chosen.column)


def _instead(ranker: Ranker, best: Hypothesis, tried: set[tuple[str, str]]) -> list[Sketch]:
    """Sketches that could stand for the best refitted one, judged around the motion that it gives.

    There the motion is nearly right, and with it the terms along it; around the present fit it is not.
    """
    fit = best.fit
    assert fit is not None
    prediction, slopes = fit.model.bind(ranker.case.inputs, ranker.rows).jacobian(fit.theta)
    slopes = slopes / ranker.sigma[:, None, None]
    at = next(i for i, f in enumerate(fit.model.fitted) if f.effect == best.effects[0])
    residual = (ranker.values - prediction) / ranker.sigma[:, None] + slopes[..., at] * fit.theta[at]
    base = slopes[..., [f.effect != best.effects[0] for f in fit.model.fitted]]
    none = np.zeros((residual.size, 0))
    listed = library(fit.model, fit.theta, ranker.rows, ranker.sigma, none, base.reshape(residual.size, -1))
    logs = Evidence(ranker.ar1, residual, base, ranker.known).single(listed.columns)
    order = np.argsort(-(logs + np.log([s.prior for s in listed.sketches])), kind="stable")
    chosen: dict[tuple[str, str], Sketch] = {}
    for index in order[:INSTEAD]:
        sketch = listed.sketches[index]
        if (sketch.target, sketch.text) not in tried:
            chosen.setdefault((sketch.target, sketch.text), sketch)
    return list(chosen.values())


def _add(ranker: Ranker, longer: _Longer, kind: str, effects: dict[str, Effect]) -> Hypothesis | None:
    """The longer answer, refitted; None when it does not pay on the held-out runs, or leaves an effect no size."""
    name = f"expression_{len(effects) + 1}"
    effect = as_effect(longer.sketch, ranker.case, name)
    fit = ranker.fit((*longer.base.effects, name), {**effects, name: effect})
    assert longer.base.fit is not None
    if absent(fit, longer.base.effects) or not pays(ranker.analysis, fit, longer.base.fit):
        return None
    effects[name] = effect
    column = longer.base.column or longer.sketch.column
    return Hypothesis((*longer.base.effects, name), kind, longer.weight, fit, column)


def _sums(ranker: Ranker, singles: Sequence[Hypothesis], effects: dict[str, Effect], best: float) -> list[Hypothesis]:
    """Two or three terms, each next one found around the refitted sum so far."""
    found: list[Hypothesis] = []
    for single in sorted(singles, key=lambda h: -h.log_weight)[:SUMMED]:
        present = single
        while len(present.effects) < TERMS and present.fit and ranker.sound(present.fit, present.effects):
            longer = _longer(ranker, present, NEXT_TERM)
            if longer.weight < max([best, *(h.log_weight for h in found)]) + MIXED:
                break
            added = _add(ranker, longer, "expression", effects)
            if added is None:
                break
            found.append(added)
            present = added
    return found


def beside_effects(
    ranker: Ranker, share: float, found: Sequence[Hypothesis], effects: dict[str, Effect]
) -> list[Hypothesis]:
    """A set of the catalogue with one expression more, where that is much better than all else.

    Looked for beside the best set; where that helps, or the best set leaves more than noise, also beside every single
    effect (the best set may hold a stand-in for what the expression says better).
    """
    listed = ranker.listed
    sets = [
        h
        for h in found
        if h.kind == "catalogue"
        and h.fit is not None
        and not absent(h.fit, h.effects)
        and ranker.sound(h.fit, h.effects)
    ]
    if not sets or listed is None or not listed.sketches or not ranker.analysis.missing:
        return []
    best = max(h.log_weight for h in found if h.kind != "expression" or len(h.effects) < 2)  # sums compete with these
    top = max(sets, key=lambda h: h.log_weight)
    assert top.fit is not None
    choices = [_longer(ranker, top, share)] if top.log_weight > best - WITHIN else []
    index = int(np.argmin(np.abs(ranker.evidence.rho - ranker.analysis.noise.rho)))
    beyond, _ = ranker.beyond(top.fit)
    excess = (beyond.total[index] - beyond.freedom) / np.sqrt(2.0 * beyond.freedom)
    if any(c.weight > best + MIXED for c in choices) or (ranker.known and excess > MISFIT):
        choices += [_longer(ranker, h, share) for h in sets if len(h.effects) == 1]
    if not choices:
        return []
    chosen = max(choices, key=lambda c: c.weight)
    if chosen.weight < best + MIXED:
        return []
    added = _add(ranker, chosen, "mixed", effects)
    return [] if added is None else [added]
