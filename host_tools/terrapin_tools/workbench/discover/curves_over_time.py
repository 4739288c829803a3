"""Curves without a formula in equations of the user's own: any function of a state, or of what drives them, that a
derivative lacks.

Around the present fit, which lacks it, the motion is another one, along which no curve is right. Along the motion of an
answer it nearly is: so the curve is asked for in the place of the answer's formulas in the same column, whatever they
imitate, with what they do given back to the residual, or beside them all. What is likely is refitted with the curve in
the equations, for what stands beside it is right only then.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.bases import free_name
from terrapin_tools.workbench.discover.leftover import absent
from terrapin_tools.workbench.discover.ranker import WITHIN, Hypothesis, Ranker
from terrapin_tools.workbench.formulas.expressions import Sketch, as_effect, read_by, readable
from terrapin_tools.workbench.formulas.free_curves import ROUGH, WAVES, Curve, Waves, drawn, likeliest
from terrapin_tools.workbench.model.effect_columns import acting, loudness
from terrapin_tools.workbench.model.fitting import Fit, fit_model
from terrapin_tools.workbench.model.priors import CURVE
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import Evidence

__all__ = ["curved", "curves_over_time"]

SETS = 3  # likeliest answers along whose motion a curve is weighed, for time
LONGEST = 40  # letters of a column's name: with more, a curve is too long for a formula
PASSES = 2  # of a refit, each along the motion of the one before
CURVED = "curve"  # name of the curve as an effect of a refit


@dataclass(frozen=True)
class _Block:
    """What each of a curve's waves changes on a target: columns (channels * rows, WAVES), in noise sd, the loudest 1
    rms; `size` of that on the target, in its unit."""

    waves: Waves
    target: str
    columns: Array
    size: float


@dataclass(frozen=True)
class _Weighed:
    """A curve beside the terms `rest` of an answer, with its log of evidence times prior."""

    log_weight: float
    answer: Hypothesis
    rest: tuple[str, ...]
    block: _Block
    beyond: Evidence


def curves_over_time(ranker: Ranker, ranked: Sequence[Hypothesis]) -> tuple[list[Hypothesis], Mapping[str, Curve]]:
    """Answers with a curve, refitted, and the likeliest curve of each column; `ranked`: answers, likeliest first."""
    if ranker.case.dynamics is None or not ranker.analysis.missing:
        return [], {}
    sets = [h for h in ranked if h.effects and h.fit is not None and not absent(h.fit, h.effects)]
    along = [h for h in sets if h.fit is not None and ranker.sound(h.fit, h.effects)][:SETS]
    every = sorted((w for one in along for w in _beside(ranker, one)), key=lambda w: -w.log_weight)
    least = max([one.log_weight for one in ranked[:1]] + [one.log_weight for one in every[:1]]) - WITHIN
    found: dict[tuple[frozenset[str], str], Hypothesis] = {}
    curves: dict[str, Curve] = {}
    for one in every:
        key, column = (frozenset(one.rest), one.block.waves.column), one.block.waves.column
        if one.log_weight > least and key not in found:
            fit, curve = _refitted(ranker, one)
            kind = "part" if one.rest else "unknown"
            found[key] = Hypothesis(one.rest, kind, one.log_weight, fit if one.rest else None, column)
            curves.setdefault(column, curve)
    return list(found.values()), curves


def curved(fit: Fit) -> bool:
    """Whether a fit has a curve without a formula in its equations."""
    return any(effect.name == CURVED for effect in fit.model.effects)


def _beside(ranker: Ranker, one: Hypothesis) -> Iterator[_Weighed]:
    """A curve of each column in the place of what an answer has in it, and beside it."""
    assert one.fit is not None
    values, _, _ = readable(one.fit.model, one.fit.theta, ranker.rows)
    blocks = {name: _blocks(ranker, one.fit, name, own) for name, own in values.items()}
    among = float(np.log(sum(map(len, blocks.values())) / CURVE))
    for column, listed in blocks.items():
        inside = [n for n in one.effects if n in ranker.sketches and read_by(ranker.sketches[n], values) == {column}]
        for given_back in [inside, []] if inside else [[]]:
            rest = tuple(name for name in one.effects if name not in given_back)
            beyond = ranker.beyond(one.fit, given_back)
            logs = np.array([_weight(beyond, block.columns) for block in listed])
            if not logs.size:
                continue
            total = one.log_weight + float(logsumexp(logs)) - among
            total -= _members(ranker, one.fit, given_back, beyond) + ranker.lost(given_back)
            total += (ranker.log_prior(rest) if rest else 0.0) - ranker.log_prior(one.effects)
            yield _Weighed(total, one, rest, listed[int(np.argmax(logs))], beyond)


def _weight(beyond: Evidence, block: Array) -> float:
    picks = np.arange(block.shape[1])[None, :]
    return float(beyond.blocks(beyond.gram(block), picks, np.zeros(picks.shape))[0])


def _members(ranker: Ranker, fit: Fit, names: Sequence[str], beyond: Evidence) -> float:
    """Log evidence of formulas that were given back to the residual, at the scales that they were fitted with."""
    if not names:
        return beyond.nothing
    places = [next(i for i, f in enumerate(fit.model.fitted) if f.effect == name) for name in names]
    slopes = fit.model.bind(ranker.case.inputs, ranker.rows).jacobian(fit.theta)[1][..., places]
    columns = (slopes / ranker.sigma[:, None, None]).reshape(-1, len(places))
    return _weight(beyond, columns / np.sqrt((columns**2).mean(axis=0)))


def _blocks(ranker: Ranker, fit: Fit, column: str, values: Array) -> list[_Block]:
    """The curves of a column, in each derivative that is a law."""
    if np.unique(values).size < 2 * WAVES or len(column) > LONGEST:
        return []
    base = ranker.case.base
    every = [
        _block(ranker, fit, Waves(column, "", values, np.ones(len(values)), power), target)
        for target in (name for name, prior in base.targets() if name in base.forces and prior == 1.0)
        for power in ROUGH
    ]
    return [block for block in every if np.isfinite(block.size)]


def _block(ranker: Ranker, fit: Fit, waves: Waves, target: str) -> _Block:
    changes = acting(fit.model, fit.theta, target, ranker.rows, ranker.sigma)(waves.at(waves.values).T)
    size = max(loudness(change) for change in changes)
    with np.errstate(divide="ignore", invalid="ignore"):  # of what changes nothing
        return _Block(waves, target, (changes / size).reshape(len(changes), -1).T, float(np.float64(1.0) / size))


def _refitted(ranker: Ranker, one: _Weighed) -> tuple[Fit, Curve]:
    """The terms beside a curve, with the curve in the equations; and the curve along that motion."""
    assert one.answer.fit is not None
    fit, block, beyond = one.answer.fit, one.block, one.beyond
    size = free_name("k", {*ranker.case.inputs, *ranker.case.fit})
    model = ranker.model
    for name in one.rest:
        model = model.having(ranker.effects[name])
    for _ in range(PASSES):
        waves, sizes = block.waves, likeliest(beyond, block.columns)[0] * block.size
        sketch = Sketch(f"{size}*({waves.formula(sizes)})", block.target, waves.column, {}, 1.0, size)
        whole = model.having(as_effect(sketch, ranker.case, CURVED))
        known = {f.key: value for f, value in zip(fit.model.fitted, fit.theta, strict=True) if f.effect != CURVED}
        start = np.array([known.get(f.key, 1.0) for f in whole.fitted])
        fit = fit_model(whole.bind(ranker.case.inputs, ranker.case.train), ranker.train, ranker.sigma, [start])
        values, _, _ = readable(whole, fit.theta, ranker.rows)
        along = Waves(waves.column, "", values[waves.column], waves.factor, waves.power)
        if not np.isfinite((again := _block(ranker, fit, along, block.target)).size):
            break
        block, beyond = again, ranker.beyond(fit, [CURVED])
    return fit, drawn(beyond, block.waves, block.columns, block.target, block.size, ranker.case.units)
