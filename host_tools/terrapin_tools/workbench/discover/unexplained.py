"""What is told where nothing known explains a misfit: a mishap of the test, or a curve that nobody has a name for.

The curve is any function of one column, alone, times the direction of motion, or times a role: WAVES cosines
over the column's range, of one prior size; or a narrow bump at one of many places. They pay for each of them, so a
named effect or a short formula that is true beats the curve; where the curve beats these, they only imitate something
else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.compare.adequacy import ROUNDING
from terrapin_tools.workbench.compare.comparison import Analysis, error
from terrapin_tools.workbench.discover.leftover import absent, around
from terrapin_tools.workbench.discover.ranker import Hypothesis
from terrapin_tools.workbench.discover.ranking import Ranking
from terrapin_tools.workbench.formulas.expressions import COLUMNS, HARDLY
from terrapin_tools.workbench.model.data_columns import numeric_columns
from terrapin_tools.workbench.model.priors import CURVE
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import SIZES, Evidence

__all__ = ["DIRECTION", "Curve", "curve", "curves"]

WAVES = 9  # of a curve: its mean, and half waves over a column's range
FEWEST = 3  # rows of a bump; fewer stand alone
BUMPS = 50  # places of a narrow bump over a column's range, at which it is as wide (sd)
FACTORS, MOST = ("omega", "load"), 3  # of a curve: these roles, or the first of a model that has neither
DIRECTION = "direction"
KNOWN = 0.9  # share of the squares from which a formula is known, although a curve in its column is left; by hand
PARTS, MORE = 3, 40  # likeliest sets beside which a curve of any column, or of the likeliest, is weighed, for time
POINTS = 121  # at which the curve is told


@dataclass(frozen=True)
class Curve:
    """What is missing in a channel as a function of a column; `by`: times that role at its rms, or the direction.

    `y` (in the channel's unit, without its mean and what else the model's own parameters may hold) and its `sd` are at
    `x`; `rms` is that of the curve over the rows, `in_sd` the same in noise sd.
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


def bridged(at: Callable[[Array], Array], x: Array, values: Array) -> Array:
    """The shapes (places, count) of a curve at `x`, straight over gaps between `values` that are wider than half the
    shortest wave: there the rows leave open what the waves do, and that may be anything."""
    ends = np.unique(values)
    right = np.clip(np.searchsorted(ends, x), 1, len(ends) - 1)
    low, high = ends[right - 1], ends[right]
    wide = high - low > np.ptp(values) / (WAVES - 1)
    share = ((x - low) / (high - low))[:, None]
    return np.where(wide[:, None], (1.0 - share) * at(low) + share * at(high), at(x))


@dataclass(frozen=True)
class _Waves:
    """A constant and the cosines of a column, times a factor: (rows, WAVES). Without the constant the mean of a curve
    looks like an effect beside it: that of one times the direction like dry friction."""

    column: str
    by: str
    values: Array  # of the column, or its magnitude (rows,)
    factor: Array

    def at(self, values: Array) -> Array:
        order = np.arange(1, WAVES)
        waves = np.sqrt(2.0) * np.cos(np.pi * np.outer(self.place(values), order)) / np.sqrt(order)  # slow ones larger
        return np.column_stack([np.ones(len(values)), waves])

    def place(self, values: Array) -> Array:
        return np.asarray((values - self.values.min()) / np.ptp(self.values))

    def block(self, channel: int, channels: int) -> Array:
        """Columns (channels * rows, count) in noise sd."""
        own = self.at(self.values) * self.factor[:, None]
        found = np.zeros((channels, *own.shape))
        found[channel] = own
        return found.reshape(-1, own.shape[1])

    def log_evidence(self, evidence: Evidence) -> list[float]:
        """In each channel."""
        blocks = [self.block(channel, evidence.channels) for channel in range(evidence.channels)]
        picks = np.arange(len(blocks) * WAVES).reshape(len(blocks), WAVES)
        found = evidence.blocks(evidence.gram(np.concatenate(blocks, axis=1)), picks, np.zeros(picks.shape))
        return [float(value) for value in found]

    def likeliest(self, evidence: Evidence, channel: int) -> _Waves:
        return self


@dataclass(frozen=True)
class _Bump(_Waves):
    """A narrow bump at one of BUMPS places of a column (rows, BUMPS): a resonance. As a sum of waves it would cost as
    many of them; its place is one number."""

    centres: tuple[float, ...] = tuple((np.arange(BUMPS) + 0.5) / BUMPS)

    def at(self, values: Array) -> Array:
        bumps, there = (
            np.exp(-0.5 * (BUMPS * (self.place(one)[:, None] - np.array(self.centres))) ** 2)
            for one in (values, self.values)
        )
        return np.asarray(bumps / np.maximum(np.sqrt((there * there).mean(axis=0)), 1e-9))

    def _each(self, evidence: Evidence, channel: int) -> Array:
        """Log evidence of each place; a place with fewer than FEWEST rows is that of rows that stand alone."""
        own = self.block(channel, evidence.channels)
        total, squares = np.abs(own).sum(axis=0), (own * own).sum(axis=0)
        return np.where(total**2 > FEWEST * squares, evidence.single(own), -np.inf)

    def log_evidence(self, evidence: Evidence) -> list[float]:
        each = [self._each(evidence, channel) for channel in range(evidence.channels)]
        return [float(logsumexp(own)) - float(np.log(BUMPS)) for own in each]

    def likeliest(self, evidence: Evidence, channel: int) -> _Waves:
        return replace(self, centres=(self.centres[int(np.argmax(self._each(evidence, channel)))],))


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
        if (not column or waves.column == column) and (bumps or not isinstance(waves, _Bump)):
            logs.setdefault(waves.column, []).extend(waves.log_evidence(evidence))
    return {name: float(logsumexp(np.array(own))) + float(np.log(CURVE / among)) for name, own in logs.items()}


def _every(analysis: Analysis) -> Iterator[_Waves]:
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
                yield _Waves(name, by, own, factor)
        if count >= BUMPS:
            yield _Bump(name, "", values, factors[""])


def curve(analysis: Analysis, evidence: Evidence, column: str) -> Curve:
    """The likeliest curve of a column, with the sd that these data leave it."""
    of_column = [waves for waves in _every(analysis) if waves.column == column]
    logs = np.array([waves.log_evidence(evidence) for waves in of_column])
    place, channel = np.unravel_index(int(np.argmax(logs)), logs.shape)
    waves = of_column[int(place)].likeliest(evidence, int(channel))
    block = waves.block(int(channel), evidence.channels)
    node, _ = evidence.likeliest()
    white = evidence.whitened(np.column_stack([block, evidence.residual]), node)
    shapes, residual = white[:, :-1], white[:, -1]
    products, score = shapes.T @ shapes, shapes.T @ residual
    free = np.eye(shapes.shape[1])
    gains = [
        score @ np.linalg.solve(free / size**2 + products, score) - np.linalg.slogdet(free + size**2 * products)[1]
        for size in SIZES
    ]
    spread = np.linalg.inv(free / SIZES[int(np.argmax(gains))] ** 2 + products)
    mean = spread @ score
    left = residual - shapes @ mean
    row = float(left @ left) / max(len(left) - shapes.shape[1], 1)
    # what the model's own parameters may hold, a slope as well as the mean, is no part of the picture
    own = np.linalg.lstsq(block, block - evidence.flat @ (evidence.flat.T @ block), rcond=None)[0]
    mean, spread = own @ mean, own @ spread @ own.T
    middle = waves.at(waves.values).mean(axis=0)
    x = np.linspace(waves.values.min(), waves.values.max(), POINTS)
    there = bridged(waves.at, x, waves.values) - middle
    name, sigma = analysis.model.channels[int(channel)], float(analysis.noise.sigma[int(channel)])
    rms = float(np.linalg.norm(block @ mean) / np.sqrt(len(waves.values)))
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
