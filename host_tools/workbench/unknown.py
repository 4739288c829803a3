"""What no catalogue has: short expressions alone, and beside effects of the catalogue, as answers that compete."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import logsumexp

from hil.physics.effects import Effect
from host_tools.workbench.expressions import SCALE_COST, Library, Sketch, as_effect, library
from host_tools.workbench.hypothesis import Hypothesis

if TYPE_CHECKING:
    from host_tools.workbench.ranking import _Ranker

__all__ = ["beside_effects", "expressions"]

EXPRESSIONS_REFITTED = 4
WITHIN = 12.0  # log evidence behind the best at which an expression is no longer worth a refit
MIXED = 3.0  # log evidence by which an expression beside catalogued effects must beat the best answer without it
MISFIT = 3.0  # standard deviations of the sum of squares above its mean, from which a set leaves more than noise


def expressions(
    ranker: _Ranker, prior: float, best: float
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
    for place, index in enumerate(order):
        chosen: Sketch = listed.sketches[index]
        close = weight[index] > max(best, weight[order[0]]) - WITHIN
        if place < EXPRESSIONS_REFITTED and close and ranker.analysis.missing:
            name = f"expression_{len(effects) + 1}"
            effect = as_effect(chosen, case, name)
            fit = ranker.fit((name,), {name: effect})
            value = ranker.around(fit, (name,))
            refitted = (
                float(weight[index])
                if value is None
                else value + float(weight[index] - logs[index]) - SCALE_COST * len(chosen.scales)
            )
            effects[name] = effect
            found.append(Hypothesis((name,), "expression", refitted, fit, chosen.column))
        else:
            grouped.setdefault(chosen.column, []).append(float(weight[index]))
    for column, values in grouped.items():
        found.append(Hypothesis((), "expression", float(logsumexp(values)), None, column))
    return found, effects, column_weight


def beside_effects(
    ranker: _Ranker, share: float, found: Sequence[Hypothesis], effects: dict[str, Effect]
) -> list[Hypothesis]:
    """A set of the catalogue with one expression more, where that is much better than all else.

    Looked for beside the best set; where that helps, or the best set leaves more than noise, also beside every single
    effect (the best set may hold a stand-in for what the expression says better).
    """
    listed = ranker.listed
    sets = [h for h in found if h.kind == "catalogue" and h.fit is not None]
    if not sets or listed is None or not listed.sketches or not ranker.analysis.missing:
        return []
    best = max(h.log_weight for h in found)
    top = max(sets, key=lambda h: h.log_weight)
    assert top.fit is not None
    prior = np.log([s.prior for s in listed.sketches]) + np.log(share)

    def beside(base: Hypothesis) -> tuple[float, int, Hypothesis]:
        assert base.fit is not None
        beyond, _ = ranker.beyond(base.fit)
        gains = beyond.single(listed.columns) - beyond.nothing + prior
        return base.log_weight + float(logsumexp(gains)), int(np.argmax(gains)), base

    choices = [beside(top)] if top.log_weight > best - WITHIN else []
    index = int(np.argmin(np.abs(ranker.evidence.rho - ranker.analysis.noise.rho)))
    beyond, _ = ranker.beyond(top.fit)
    excess = (beyond.total[index] - beyond.freedom) / np.sqrt(2.0 * beyond.freedom)
    if any(weight > best + MIXED for weight, _, _ in choices) or (ranker.known and excess > MISFIT):
        choices += [beside(h) for h in sets if len(h.effects) == 1]
    if not choices:
        return []
    weight, chosen, base = max(choices, key=lambda choice: choice[0])
    if weight < best + MIXED:
        return []
    sketch = listed.sketches[chosen]
    name = f"expression_{len(effects) + 1}"
    effects[name] = as_effect(sketch, ranker.case, name)
    fit = ranker.fit((*base.effects, name), {name: effects[name]})
    return [Hypothesis((*base.effects, name), "mixed", weight, fit, sketch.column)]
