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
            fit, block = _Refit(ranker, one).fit(), one.block
            picture = _picture(ranker, fit, one) if fit is not None else None
            picture = picture or drawn(
                one.beyond, block.waves, block.columns, block.target, block.size, ranker.case.units
            )
            kind, own = ("part", fit or ranker.fit(one.rest)) if one.rest else ("unknown", None)
            found[key] = Hypothesis(one.rest, kind, one.log_weight, own, column)
            curves.setdefault(column, picture)
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
        inside = [name for name in one.effects if _inside(ranker, name, values, column)]
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


class _Refit:
    """The terms beside a curve with the curve in the equations, on the training runs, by Gauss and Newton with the
    curve's own prior: a spring's constant beside a curve of its length takes what it can, and the curve the rest, where
    least squares alone would leave open what is whose."""

    def __init__(self, ranker: Ranker, one: _Weighed) -> None:
        self.ranker, self.one, waves = ranker, one, one.block.waves
        names = [f"c{i}" for i in range(WAVES)]
        formula = waves.formula(names), one.block.target
        parameters = tuple(Parameter(name, "1", 0.0) for name in names)
        model = ranker.model
        for name in one.rest:
            model = model.having(ranker.effects[name])
        self.model = model.having(Effect(CURVED, "", "", FOUND, (ranker.case.base.name,), parameters, (), *formula))
        self.bound = self.model.bind(ranker.case.inputs, ranker.case.train)
        self.curve = np.array([f.effect == CURVED for f in self.model.fitted])
        self.shared = _shared(ranker, one, self.model)
        size = likeliest(one.beyond, one.block.columns)[2] * one.block.size
        self.width = waves.cosines(np.full(WAVES, size))

    def fit(self) -> Fit | None:
        """None where no start leads anywhere."""
        assert self.one.answer.fit is not None
        known = {f.key: v for f, v in zip(self.one.answer.fit.model.fitted, self.one.answer.fit.theta, strict=True)}
        start = np.array([known.get(f.key, 0.0) for f in self.model.fitted])
        starts = [self._at(start), self._at(self._first(start))]
        best = min((fit for fit in starts if fit is not None), key=lambda fit: fit.cost, default=None)
        if best is None:
            return None
        theta = self._next(best)
        for _ in range(PASSES):
            fit = self._at(theta)
            if fit is not None and fit.cost < best.cost:
                best, theta = fit, self._next(fit)
            else:  # too far for what is linear
                theta = 0.5 * (best.theta + theta)
        return best

    def _at(self, theta: Array) -> Fit | None:
        prediction, slopes = self.bound.jacobian(theta)
        sigma = self.ranker.sigma[:, None]
        left = (self.ranker.train - prediction) / sigma
        cost = float((left * left).sum())
        stuck = ~self.shared & ((theta <= self.model.lower) | (theta >= self.model.upper))
        at_bound = tuple(f.key for f, there in zip(self.model.fitted, stuck, strict=True) if there)
        fit = Fit(self.bound, theta, left, slopes / sigma[..., None], self.ranker.sigma, cost, at_bound)
        return fit if np.isfinite(cost) else None

    def _first(self, start: Array) -> Array:
        """One step along the answer's motion, with what it has in the curve's place given back."""
        answer, block = self.one.answer.fit, self.one.block
        assert answer is not None
        keys, slopes = [f.key for f in answer.model.fitted], answer.jacobian.reshape(answer.residual.size, -1)
        given = [name for name in self.one.answer.effects if name not in self.one.rest]
        sizes = [next(i for i, f in enumerate(answer.model.fitted) if f.effect == name) for name in given]
        residual = answer.residual.reshape(-1) + slopes[:, sizes] @ answer.theta[sizes]
        on = np.tile(self.ranker.case.train[self.ranker.rows], len(self.ranker.sigma))
        shapes = block.columns[on] / block.size / block.waves.cosines(np.ones(WAVES))
        base = slopes[:, [keys.index(f.key) for f in self.model.fitted if f.effect != CURVED]]
        return self._moved(start, residual, base, shapes)

    def _next(self, fit: Fit) -> Array:
        slopes = fit.jacobian.reshape(fit.residual.size, -1)
        residual = fit.residual.reshape(-1) + slopes[:, self.curve] @ fit.theta[self.curve]
        return self._moved(fit.theta, residual, slopes[:, ~self.curve], slopes[:, self.curve])

    def _moved(self, theta: Array, residual: Array, base: Array, shapes: Array) -> Array:
        """The likeliest step of all others, and the likeliest curve, of which the residual has nothing taken."""
        every = np.concatenate([base, shapes * self.width], axis=1)
        prior = np.hstack([np.zeros((WAVES, base.shape[1])), np.eye(WAVES)])
        found = np.linalg.lstsq(np.vstack([every, prior]), np.append(residual, np.zeros(WAVES)), rcond=None)[0]
        new = theta.copy()
        new[~self.curve] += found[:-WAVES]
        new[self.curve] = found[-WAVES:] * self.width
        return np.where(self.shared, new, np.clip(new, self.model.lower, self.model.upper))


def _shared(ranker: Ranker, one: _Weighed, model: Model) -> Mask:
    """Parameters (fitted,) of the user's equations whose part a curve could take over, as a spring's constant beside a
    curve of its length: nothing says what is whose, so their bounds say nothing."""
    fit, found = one.answer.fit, set[str]()
    assert fit is not None
    basis = orthonormal(one.block.columns)
    slopes = fit.model.bind(ranker.case.inputs, ranker.rows).jacobian(fit.theta)[1] / ranker.sigma[:, None, None]
    for i, fitted in enumerate(fit.model.fitted):
        own = slopes[..., i].reshape(-1)
        if fitted.effect is None and np.linalg.norm(own - basis @ (basis.T @ own)) < SHARED * np.linalg.norm(own):
            found.add(fitted.key)
    return np.array([f.key in found for f in model.fitted])


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
    curve, free = np.array([f.effect == CURVED for f in model.fitted]), following(fit)
    base = np.concatenate([slopes[..., ~curve & free], ranker.analysis.nuisance], axis=-1)
    residual = left + slopes[..., curve] @ fit.theta[curve]
    beyond = Evidence(ranker.runs, residual, base, ranker.behind, ranker.nodes)
    alike = {None, *(name for name in one.rest if _inside(ranker, name, values, waves.column))}
    own = np.array([f.effect in alike for f in model.fitted])
    held = orthonormal(slopes[..., own & free].reshape(residual.size, -1))
    return drawn(beyond, along, block.columns, block.target, block.size, case.units, held)


def _inside(ranker: Ranker, name: str, values: Mapping[str, Array], column: str) -> bool:
    """Whether an effect is a formula in a column alone."""
    return name in ranker.sketches and read_by(ranker.sketches[name], values) == {column}
