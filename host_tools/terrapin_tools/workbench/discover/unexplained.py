"""What is told where nothing known explains a misfit: a mishap of the test, or a curve that nobody has a name for.

The curve is any function of one column, alone, times the direction of motion, or times a role: WAVES cosines
over the column's range, of one prior size. They pay for each of them, so a named effect or a short formula that is true
beats the curve; where the curve beats these, they only imitate something else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.compare.adequacy import ROUNDING
from terrapin_tools.workbench.compare.comparison import Analysis, error
from terrapin_tools.workbench.discover.expressions import COLUMNS, HARDLY
from terrapin_tools.workbench.discover.leftover import absent, around
from terrapin_tools.workbench.discover.ranker import Hypothesis
from terrapin_tools.workbench.discover.ranking import Ranking
from terrapin_tools.workbench.model.data_columns import numeric_columns
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import SIZES, Evidence

__all__ = ["DIRECTION", "Curve", "curve", "curves"]

WAVES = (8, 24)  # half waves over a column's range: a smooth curve, and one with a narrow bump
FACTORS, MOST = ("omega", "load"), 3  # of a curve: these roles, or the first of a model that has neither
DIRECTION = "direction"
PRIOR = 0.05  # of something that neither the catalogue nor the vocabulary has
KNOWN = 0.9  # share of the squares from which a formula is known, although a curve in its column is left; by hand
PARTS = 3  # likeliest sets beside which a curve is weighed, for time
POINTS = 41  # at which the curve is told


@dataclass(frozen=True)
class Curve:
    """What is missing in a channel as a function of a column; `by`: times that role at its rms, or the direction.

    `y` (in the channel's unit, its mean over the rows taken off: the model's own parameters may hold it) and its `sd`
    at `x`; `rms` is that of the curve over the rows, `in_sd` the same in noise sd.
    """

    column: str
    unit: str
    channel: str
    channel_unit: str
    by: str
    rms: float
    in_sd: float
    x: tuple[float, ...]
    y: tuple[float, ...]
    sd: tuple[float, ...]


@dataclass(frozen=True)
class _Waves:
    """The cosines of a column, times a factor: (rows, count)."""

    column: str
    by: str
    values: Array  # of the column, or its magnitude (rows,)
    factor: Array
    count: int

    def at(self, values: Array) -> Array:
        place = (values - self.values.min()) / np.ptp(self.values)
        order = np.arange(1, self.count + 1)
        return np.asarray(np.sqrt(2.0) * np.cos(np.pi * np.outer(place, order)) / np.sqrt(order))  # slow ones larger

    def block(self, channel: int, channels: int) -> Array:
        """Columns (channels * rows, count) in noise sd."""
        found = np.zeros((channels, len(self.values), self.count))
        found[channel] = self.at(self.values) * self.factor[:, None]
        return found.reshape(-1, self.count)


def curves(analysis: Analysis, ranking: Ranking) -> list[Hypothesis]:
    """For each column a hypothesis that some function of it is missing, alone and beside each of the likeliest sets.
    None for models that are integrated over time, in which a curve of a column is no part of a row's prediction.

    A formula in the column of a curve is part of the curve: beside it, it is nothing that is known, unless it takes
    nearly all of what is missing.
    """
    evidence = ranking.evidence
    if analysis.case.base.whole_runs or evidence is None:
        return []
    every = [h for h in ranking.hypotheses if h.effects and h.fit is not None and not absent(h.fit, h.effects)]
    sets = every[:PARTS] if analysis.missing else []
    left = [error(h.fit, analysis.rows, analysis.noise.sigma) for h in sets if h.fit is not None]
    if min((rms for rms in left if rms is not None), default=1.0) < ROUNDING:
        return []  # of what was computed, not measured: a size in noise sd is beyond every prior, and says nothing
    found = [Hypothesis((), "unknown", weight, None, name) for name, weight in _weights(analysis, evidence).items()]
    for one in sets:
        assert one.fit is not None
        beyond = around(analysis, one.fit, evidence.nodes)
        read = [ranking.columns.get(name, "") for name in one.effects]
        takes = 1.0 - float(np.sum(beyond.residual**2)) / float(np.sum(evidence.residual**2))
        for name, weight in _weights(analysis, beyond, WAVES[:1]).items():
            total = one.log_weight + weight - beyond.nothing
            if name not in read or takes >= KNOWN:
                found.append(replace(one, kind="part", log_weight=total, column=name))
            elif set(read) == {name}:
                found.append(Hypothesis((), "unknown", total, None, name))
    return found


def _weights(analysis: Analysis, evidence: Evidence, counts: Sequence[int] = WAVES) -> dict[str, float]:
    """Log of evidence times prior of a curve, by column."""
    every = list(_every(analysis, counts))
    among = len(every) * evidence.channels
    logs: dict[str, list[float]] = {}
    for waves in every:
        logs.setdefault(waves.column, []).extend(_logs(evidence, waves))
    return {name: float(logsumexp(np.array(own))) + float(np.log(PRIOR / among)) for name, own in logs.items()}


def _logs(evidence: Evidence, waves: _Waves) -> list[float]:
    """Log evidence in each channel."""
    blocks = [waves.block(channel, evidence.channels) for channel in range(evidence.channels)]
    picks = np.arange(len(blocks) * waves.count).reshape(len(blocks), waves.count)
    return [
        float(v) for v in evidence.blocks(evidence.gram(np.concatenate(blocks, axis=1)), picks, np.zeros(picks.shape))
    ]


def _every(analysis: Analysis, counts: Sequence[int] = WAVES) -> Iterator[_Waves]:
    rows, roles = analysis.rows, analysis.case.roles
    factors: dict[str, Array] = {"": np.ones(int(rows.sum()))}
    if "omega" in roles and len(np.unique(np.sign(roles["omega"][rows]))) > 1:
        factors[DIRECTION] = np.sign(roles["omega"][rows])
    for name in [n for n in FACTORS if n in roles] or list(roles)[:MOST]:
        values = roles[name][rows]
        if np.std(values) > HARDLY * np.abs(values).mean():
            factors[name] = values / np.sqrt(np.mean(values * values))
    for name, whole in list(numeric_columns(analysis.case).items())[:COLUMNS]:
        values = whole[rows]
        for count in counts:
            if np.unique(values).size < 2 * count:
                continue
            for by, factor in factors.items():
                own = np.abs(values) if by == DIRECTION else values
                if np.ptp(own) > 0.0:
                    yield _Waves(name, by, own, factor, count)


def curve(analysis: Analysis, evidence: Evidence, column: str) -> Curve:
    """The likeliest curve of a column, with the sd that these data leave it."""
    of_column = [waves for waves in _every(analysis) if waves.column == column]
    logs = np.array([_logs(evidence, waves) for waves in of_column])
    place, channel = np.unravel_index(int(np.argmax(logs)), logs.shape)
    waves = of_column[int(place)]
    block = waves.block(int(channel), evidence.channels)
    node, _ = evidence.likeliest()
    white = evidence.whitened(np.column_stack([block, evidence.residual]), node)
    shapes, residual = white[:, :-1], white[:, -1]
    products, score = shapes.T @ shapes, shapes.T @ residual
    free = np.eye(waves.count)
    gains = [
        score @ np.linalg.solve(free / size**2 + products, score) - np.linalg.slogdet(free + size**2 * products)[1]
        for size in SIZES
    ]
    spread = np.linalg.inv(free / SIZES[int(np.argmax(gains))] ** 2 + products)
    mean = spread @ score
    left = residual - shapes @ mean
    row = float(left @ left) / max(len(left) - waves.count, 1)
    middle = waves.at(waves.values).mean(axis=0)
    x = np.linspace(waves.values.min(), waves.values.max(), POINTS)
    there = waves.at(x) - middle
    name, sigma = analysis.model.channels[int(channel)], float(analysis.noise.sigma[int(channel)])
    rms = float(np.sqrt(np.mean(((waves.at(waves.values) - middle) @ mean) ** 2)))
    sd = np.sqrt(row * np.einsum("ij,jk,ik->i", there, spread, there))
    return Curve(
        column=column,
        unit=analysis.case.units.get(column, ""),
        channel=name,
        channel_unit=analysis.case.units.get(name, ""),
        by=waves.by,
        rms=rms * sigma,
        in_sd=rms,
        x=tuple(float(v) for v in x),
        y=tuple(float(v) for v in there @ mean * sigma),
        sd=tuple(float(v) for v in sd * sigma),
    )
