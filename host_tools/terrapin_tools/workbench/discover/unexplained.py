"""What is told where nothing known explains a misfit: a curve that nobody has a name for (free_curves.py), of one
column, alone, times the direction of motion, or times a role.

Where the curve beats named effects and short formulas, they only imitate something else.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.compare.adequacy import ROUNDING
from terrapin_tools.workbench.compare.comparison import Analysis, error
from terrapin_tools.workbench.discover.leftover import absent, around
from terrapin_tools.workbench.discover.ranker import Hypothesis
from terrapin_tools.workbench.discover.ranking import Ranking
from terrapin_tools.workbench.formulas.expressions import COLUMNS, HARDLY
from terrapin_tools.workbench.formulas.free_curves import BUMPS, DIRECTION, WAVES, Bump, Curve, Waves, drawn
from terrapin_tools.workbench.model.data_columns import numeric_columns
from terrapin_tools.workbench.model.priors import CURVE
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import Evidence

__all__ = ["curve", "curves"]

FACTORS, MOST = ("omega", "load"), 3  # of a curve: these roles, or the first of a model that has neither
KNOWN = 0.9  # share of the squares from which a formula is known, although a curve in its column is left; by hand
PARTS, MORE = 3, 40  # likeliest sets beside which a curve of any column, or of the likeliest, is weighed, for time


def curves(analysis: Analysis, ranking: Ranking) -> list[Hypothesis]:
    """For each column a hypothesis that some function of it is missing, alone and beside each of the likeliest sets.

    A formula in the column of a curve is part of the curve: beside it, it is nothing that is known, unless it takes
    nearly all of what is missing.
    """
    evidence = ranking.evidence
    if evidence is None:
        return []
    every = [h for h in ranking.hypotheses if h.effects and h.fit is not None and not absent(h.fit, h.effects)]
    sets = every[:PARTS] if analysis.missing else []
    left = [error(h.fit, analysis.rows, analysis.noise.sigma) for h in sets if h.fit is not None]
    if min((rms for rms in left if rms is not None), default=1.0) < ROUNDING:
        return []  # of what was computed, not measured: a size in noise sd is beyond every prior, and says nothing
    found = [Hypothesis((), "unknown", weight, None, name) for name, weight in _weights(analysis, evidence).items()]
    beside = [_beside(analysis, ranking, one) for one in sets]
    if any(beside):  # the likeliest sets hold pieces of the curve; beside it a shorter one may do
        column = max(chain.from_iterable(beside), key=lambda h: h.log_weight).column
        beside += [_beside(analysis, ranking, one, column) for one in every[PARTS:MORE]]
    return [*found, *chain.from_iterable(beside)]


def _beside(analysis: Analysis, ranking: Ranking, one: Hypothesis, column: str = "") -> list[Hypothesis]:
    """A curve of each column, or of that one, beside a set."""
    evidence = ranking.evidence
    assert one.fit is not None
    assert evidence is not None
    beyond, found = around(analysis, one.fit, evidence.nodes), list[Hypothesis]()
    if one.log_weight > beyond.nothing:  # it is not that of this fit, and a gain over it means nothing
        return []
    read = [ranking.columns.get(name, "") for name in one.effects]
    takes = 1.0 - float(np.sum(beyond.residual**2)) / float(np.sum(evidence.residual**2))
    for name, weight in _weights(analysis, beyond, column, bumps=False).items():
        total = one.log_weight + weight - beyond.nothing
        if name not in read or takes >= KNOWN:
            found.append(replace(one, kind="part", log_weight=total, column=name))
        elif set(read) == {name}:
            found.append(Hypothesis((), "unknown", total, None, name))
    return found


def _weights(analysis: Analysis, evidence: Evidence, column: str = "", bumps: bool = True) -> dict[str, float]:
    """Log of evidence times prior of a curve, by column, or of that one."""
    every = list(_every(analysis))
    among = len(every) * evidence.channels
    logs: dict[str, list[float]] = {}
    for waves in every:
        if (not column or waves.column == column) and (bumps or not isinstance(waves, Bump)):
            logs.setdefault(waves.column, []).extend(waves.log_evidence(evidence))
    return {name: float(logsumexp(np.array(own))) + float(np.log(CURVE / among)) for name, own in logs.items()}


def _every(analysis: Analysis) -> Iterator[Waves]:
    rows, roles = analysis.rows, analysis.case.roles
    factors: dict[str, Array] = {"": np.ones(int(rows.sum()))}
    if "omega" in roles and len(np.unique(np.sign(roles["omega"][rows]))) > 1:
        factors[DIRECTION] = np.sign(roles["omega"][rows])
    for name in [n for n in FACTORS if n in roles] or list(roles)[:MOST]:
        values = roles[name][rows]
        if np.std(values) > HARDLY * np.abs(values).mean():
            factors[name] = values / np.sqrt(np.mean(values * values))
    for name, whole in list(numeric_columns(analysis.case).items())[:COLUMNS]:
        values, count = whole[rows], np.unique(whole[rows]).size
        for by, factor in factors.items():
            own = np.abs(values) if by == DIRECTION else values
            if count >= 2 * WAVES and np.ptp(own) > 0.0:
                yield Waves(name, by, own, factor)
        if count >= BUMPS:
            yield Bump(name, "", values, factors[""])


def curve(analysis: Analysis, evidence: Evidence, column: str) -> Curve:
    """The likeliest curve of a column, with the sd that these data leave it."""
    of_column = [waves for waves in _every(analysis) if waves.column == column]
    logs = np.array([waves.log_evidence(evidence) for waves in of_column])
    place, channel = np.unravel_index(int(np.argmax(logs)), logs.shape)
    waves = of_column[int(place)].likeliest(evidence, int(channel))
    block = waves.block(int(channel), evidence.channels)
    name, sigma = analysis.model.channels[int(channel)], float(analysis.noise.sigma[int(channel)])
    return drawn(evidence, waves, block, name, sigma, analysis.case.units)
