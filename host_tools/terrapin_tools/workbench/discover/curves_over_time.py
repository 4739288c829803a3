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

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_tools.workbench.discover.leftover import absent
from terrapin_tools.workbench.discover.ranker import WITHIN, Hypothesis, Ranker
from terrapin_tools.workbench.formulas.expressions import FOUND, read_by, readable
from terrapin_tools.workbench.formulas.free_curves import ROUGH, WAVES, Curve, Waves, drawn, likeliest
from terrapin_tools.workbench.model.effect_columns import acting, loudness
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.linearised import following
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.model.priors import CURVE
from terrapin_tools.workbench.noise.covariance import orthonormal
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import Evidence

__all__ = ["curved", "curves_over_time"]

SETS = 3  # likeliest answers along whose motion a curve is weighed, for time
SHARED = 0.2  # of what a parameter changes: what is left beside a curve that could take its part
PASSES = 10  # of a refit
LONGEST = 40  # letters of a column's name: with more, a curve is too long for a formula
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
    """The terms beside a curve, with the curve in the equations, on the training runs; and the curve along that motion.

    By Gauss and Newton with the curve's own prior: a spring's constant beside a curve of its length takes what it can,
    and the curve the rest, where least squares alone would leave open what is whose.
    """
    answer, block, case = one.answer.fit, one.block, ranker.case
    assert answer is not None
    waves, names = block.waves, [f"c{i}" for i in range(WAVES)]
    model = ranker.model
    for name in one.rest:
        model = model.having(ranker.effects[name])
    parameters = tuple(Parameter(name, "1", 0.0) for name in names)
    model = model.having(
        Effect(CURVED, "", "", FOUND, (case.base.name,), parameters, (), waves.formula(names), block.target)
    )
    bound, sigma = model.bind(case.inputs, case.train), ranker.sigma[:, None]
    curve = np.array([f.effect == CURVED for f in model.fitted])
    width = waves.cosines(np.full(WAVES, likeliest(one.beyond, block.columns)[2] * block.size))

    def moved(theta: Array, residual: Array, base: Array, shapes: Array) -> Array:
        """From where the curve is 0: the likeliest step of all others, and the likeliest curve."""
        every = np.concatenate([base, shapes * width], axis=1)
        prior = np.hstack([np.zeros((WAVES, base.shape[1])), np.eye(WAVES)])
        found = np.linalg.lstsq(np.vstack([every, prior]), np.append(residual, np.zeros(WAVES)), rcond=None)[0]
        new = theta.copy()
        new[~curve] += found[:-WAVES]
        new[curve] = found[-WAVES:] * width
        return np.where(shared, new, np.clip(new, model.lower, model.upper))

    # along the answer's motion, with what it has in the curve's place given back
    keys = [f.key for f in answer.model.fitted]
    known = dict(zip(keys, answer.theta, strict=True))
    theta = np.array([known.get(f.key, 0.0) for f in model.fitted])
    slopes = answer.jacobian.reshape(answer.residual.size, -1)
    sizes = [next(i for i, f in enumerate(answer.model.fitted) if f.effect == n) for n in _given_back(one)]
    residual = answer.residual.reshape(-1) + slopes[:, sizes] @ answer.theta[sizes]
    on = np.tile(case.train[ranker.rows], len(ranker.sigma))
    shapes = block.columns[on] / block.size / waves.cosines(np.ones(WAVES))
    shared = _shared(ranker, answer, block, model)
    theta = moved(theta, residual, slopes[:, [keys.index(f.key) for f in model.fitted if f.effect != CURVED]], shapes)
    drawn_along = drawn(one.beyond, waves, block.columns, block.target, block.size, case.units)
    best: tuple[float, Array, Array, Array] | None = None
    for _ in range(PASSES):
        prediction, slopes = bound.jacobian(theta)
        left, scaled = (ranker.train - prediction) / sigma, slopes / sigma[..., None]
        cost = float((left * left).sum())
        if cost < (np.inf if best is None else best[0]):
            best = cost, theta, left, scaled
            flat = scaled.reshape(left.size, -1)
            theta = moved(theta, left.reshape(-1) + flat[:, curve] @ theta[curve], flat[:, ~curve], flat[:, curve])
        elif best is None:
            return ranker.fit(one.rest), drawn_along
        else:  # too far for what is linear
            theta = 0.5 * (best[1] + theta)
    assert best is not None
    cost, theta, left, scaled = best
    stuck = ~shared & ((theta <= model.lower) | (theta >= model.upper))
    at_bound = tuple(f.key for f, there in zip(model.fitted, stuck, strict=True) if there)
    fit = Fit(bound, theta, left, scaled, ranker.sigma, cost, at_bound)
    return fit, _picture(ranker, fit, one) or drawn_along


def _shared(ranker: Ranker, fit: Fit, block: _Block, model: Model) -> Mask:
    """Parameters (fitted,) of the user's equations whose part a curve could take over, as a spring's constant beside a
    curve of its length: nothing says what is whose, so their bounds say nothing."""
    basis = orthonormal(block.columns)
    slopes = fit.model.bind(ranker.case.inputs, ranker.rows).jacobian(fit.theta)[1] / ranker.sigma[:, None, None]
    found = set()
    for i, fitted in enumerate(fit.model.fitted):
        one = slopes[..., i].reshape(-1)
        if fitted.effect is None and np.linalg.norm(one - basis @ (basis.T @ one)) < SHARED * np.linalg.norm(one):
            found.add(fitted.key)
    return np.array([f.key in found for f in model.fitted])


def _given_back(one: _Weighed) -> list[str]:
    """What an answer has in the place of the curve."""
    return [name for name in one.answer.effects if name not in one.rest]


def _picture(ranker: Ranker, fit: Fit, one: _Weighed) -> Curve | None:
    """The curve along the motion of the fit that has it; None where that goes nowhere."""
    model, case, waves = fit.model, ranker.case, one.block.waves
    prediction, slopes = model.bind(case.inputs, ranker.rows).jacobian(fit.theta)
    if not np.isfinite(prediction).all():
        return None
    values, _, _ = readable(model, fit.theta, ranker.rows)
    along = Waves(waves.column, "", values[waves.column], waves.factor, waves.power)
    block = _block(ranker, fit, along, one.block.target)
    if not np.isfinite(block.size):
        return None
    slopes, left = slopes / ranker.sigma[:, None, None], (ranker.values - prediction) / ranker.sigma[:, None]
    curve, own = (np.array([f.effect == name for f in model.fitted]) for name in (CURVED, None))
    base = np.concatenate([slopes[..., ~curve & following(fit)], ranker.analysis.nuisance], axis=-1)
    residual = left + slopes[..., curve] @ fit.theta[curve]
    beyond = Evidence(ranker.runs, residual, base, ranker.behind, ranker.nodes)
    held = orthonormal(slopes[..., own & following(fit)].reshape(residual.size, -1))
    return drawn(beyond, along, block.columns, block.target, block.size, case.units, held)
