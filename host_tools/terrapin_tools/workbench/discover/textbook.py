"""The plain name of an answer: catalogued effects in the place of formulas that imitate them.

On a real rig a small rest is nearly always left: a resistance that warms, a friction that is not quite dry. A sum of
formulas takes up effect and rest together, is likelier than the effect alone, and tells a reader nothing. Where a set
of catalogued effects with no more parameters gives the same curve but for a small share of what was found, and predicts
the held-out runs as well, the shortest such set is the answer; the rest is left to the next round.
"""

from __future__ import annotations

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.zero_points import ZERO
from terrapin_tools.workbench.compare.comparison import Analysis, error, predict
from terrapin_tools.workbench.discover.leftover import absent
from terrapin_tools.workbench.discover.ranker import Hypothesis
from terrapin_tools.workbench.discover.ranking import Ranking
from terrapin_tools.workbench.model.constants import named
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.table_faults import at_fault

__all__ = ["plain_names"]

REST = 0.01  # share of the sum of squares of what was found that may differ; chosen by hand
WORSE = 1.03  # held-out error over that of the formulas, at most; chosen by hand
AS_LIKELY = 1.6  # log weight behind the likeliest of them within which another plain name is a rival; chosen by hand


def plain_names(analysis: Analysis, ranking: Ranking, top: Hypothesis) -> tuple[list[Hypothesis], float]:
    """Sets of catalogued effects that do what an answer with formulas does, likeliest first, and the probability of the
    first: its share of that of all answers that are this curve.

    The shortest such set; several if they are about as likely; none if there is none, or no formula in the answer.
    """
    if top.kind == "catalogue" or top.fit is None:
        return [], 0.0
    found = _curve(analysis, top.fit) - _curve(analysis, analysis.fit)
    allowed = REST * float((found * found).sum())
    alike = [one for one in _plain(ranking) if _instead(analysis, one.fit, top.fit, allowed)]
    shortest = min((len(one.effects) for one in alike), default=0)
    alike = [one for one in alike if len(one.effects) == shortest]
    alike = [one for one in alike if one.log_weight > alike[0].log_weight - AS_LIKELY]
    if not alike:
        return [], 0.0
    same = [
        float(p)
        for h, p in zip(ranking.hypotheses, ranking.posterior, strict=True)
        if h.effects and h.fit is not None and _gap(analysis, h.fit, alike[0].fit) <= allowed
    ]
    return alike, sum(same) / sum(float(np.exp(one.log_weight - alike[0].log_weight)) for one in alike)


def _plain(ranking: Ranking) -> list[Hypothesis]:
    """Refitted sets of catalogued effects, likeliest first; what may be wrong in the case is no effect."""
    return [
        one
        for one in ranking.hypotheses
        if one.kind == "catalogue"
        and one.effects
        and not any(named(name) or at_fault(name) or name.startswith(ZERO) for name in one.effects)
        and not absent(one.fit, one.effects)
    ]


def _instead(analysis: Analysis, fit: Fit | None, top: Fit, allowed: float) -> bool:
    if fit is None or len(fit.theta) > len(top.theta) or _gap(analysis, fit, top) > allowed:
        return False
    held, after = (error(one, analysis.case.test, analysis.noise.sigma) for one in (top, fit))
    return held is None or after is None or max(after, 1.0) <= WORSE * max(held, 1.0)


def _curve(analysis: Analysis, fit: Fit) -> Array:
    return np.asarray(predict(fit, analysis.rows) / analysis.noise.sigma[:, None])


def _gap(analysis: Analysis, first: Fit, other: Fit | None) -> float:
    if other is None:
        return np.inf
    gap = _curve(analysis, first) - _curve(analysis, other)
    return float((gap * gap).sum())
