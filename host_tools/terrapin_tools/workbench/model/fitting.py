"""Weighted least squares: the model's and the effects' parameters together, within bounds, from several starts.

Residuals are in noise standard deviations. A model with one effect more starts where its parent ended (with the
effect's size at 0), so its error can never be larger than the parent's; further starts come from the effect's grid,
screened by a linear fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_tools.workbench.model.data_columns import GRID_LIMIT, is_phase
from terrapin_tools.workbench.model.model import Bound, Model
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import Node

__all__ = ["Fit", "covariance", "extend", "fit_model", "minimise", "minimiser"]

Evaluate = Callable[[Array], tuple[Array, Array]]

ENOUGH = 1e-9  # relative gain at which a fit stops
# Of a model that is integrated over time, whose fits take long: relative, and a gain that is none: 0.005 of a nat.
ENOUGH_OF_RUNS = (1e-6, 1e-2)
EDGE = 0.01  # of the cost that a step must gain there, before a place without numbers: three that do not, and it ends
HOPELESS = 0.05  # of the way to what another model reaches: three such steps in a row, and this one does not
# Of what a step promises, the sum of squares by the derivatives alone, a fit gains at most so many times as much, from
# its start and later. In 808 of two cylinders and a car none that came near the best gained more. Chosen by hand.
REACH = (5.0, 3.0)
TRUSTED = 1e-2  # damping up to which what a step promises is about the whole way
# Behind another model, squares or a share of its cost, from which no posterior knows one: noise that goes together over
# rows weighs each square less. Of further starts of the same model, what they must gain: a quarter of a nat.
BEHIND, SHARE_BEHIND, BETTER = 100.0, 0.1, 0.5
# Times the cost from which a start's size is halved, and how often at most. One pair of a car took 27 of 89 s of
# processor without; halved down to the cost itself a cylinder's search took 58 s for 49.
OFF, HALVED = 2.0, 6
SCREENED = 4  # starts kept of an effect's grid
UNSEEN = 1e-12  # of the largest curvature: less is none
KEPT = 6  # evaluations


@dataclass(frozen=True)
class Fit:
    """A fitted model on its training rows. Residuals (channels, rows) are measured - predicted, in noise sd."""

    bound: Bound
    theta: Array
    residual: Array
    jacobian: Array  # of the prediction, in noise sd (channels, rows, parameters)
    sigma: Array  # (channels,), that noise sd
    cost: float  # sum of squared residuals
    at_bound: tuple[str, ...]  # parameters that ended at a bound

    @property
    def model(self) -> Model:
        return self.bound.model


@dataclass(frozen=True)
class _Here:
    """The sum of squares around one place: its gradient, what moves, and the normal equations of that, scaled."""

    gradient: Array
    moving: Mask
    scale: Array
    normal: Array

    @classmethod
    def at(cls, theta: Array, residual: Array, jacobian: Array, lower: Array, upper: Array, free: Mask) -> _Here:
        gradient = jacobian.T @ residual
        held = ~free | ((theta <= lower) & (gradient > 0)) | ((theta >= upper) & (gradient < 0))
        moving = ~held & (np.abs(jacobian).max(axis=0, initial=0.0) > 0)
        columns = jacobian[:, moving]
        scale = np.sqrt((columns * columns).sum(axis=0))
        return cls(gradient, moving, scale, columns.T @ columns / np.outer(scale, scale))

    def step(self, damping: float) -> Array:
        found = np.zeros_like(self.gradient)
        damped = self.normal + damping * np.eye(len(self.scale))
        found[self.moving] = -np.linalg.solve(damped, self.gradient[self.moving] / self.scale) / self.scale
        return found


@dataclass
class _Patience:
    """When a search that still gains ends; as of `minimise`. How often in a row a step gained little, for each why."""

    enough: tuple[float, float]
    aim: float
    edge: float
    slow: int = 0
    far: int = 0
    cut: int = 0

    def least(self, cost: float) -> float:
        return max(self.enough[0] * cost, self.enough[1])

    def over(self, gain: float, cost: float, blocked: bool) -> bool:
        self.slow = self.slow + 1 if gain <= 1e-6 * cost else 0
        self.far = self.far + 1 if gain <= HOPELESS * (cost - self.aim) else 0
        self.cut = self.cut + 1 if blocked and gain <= self.edge * cost else 0
        return gain <= self.least(cost) or 3 in (self.slow, self.far, self.cut)


def minimise(
    evaluate: Evaluate,
    residual: Callable[[Array], Array],
    start: Array,
    lower: Array,
    upper: Array,
    free: Mask,
    enough: tuple[float, float] = (ENOUGH, 0.0),
    aim: float = np.inf,
    edge: float = 0.0,
    ahead: bool = False,
    floor: float = np.inf,
) -> tuple[Array, float]:
    """Levenberg and Marquardt's method inside a box; only parameters whose `free` is true move.

    `evaluate` gives residuals (m,) and their derivatives (m, parameters), `residual` the residuals alone. Stops when a
    step gains, or promises, less than `enough`, a share of the cost (1e-9: a thousandth of a noise sd in the
    parameters) or so much of it, or when three in a row gain less than 1e-6 (a valley that the data do not close).
    Returns parameters and cost, which is never above that of the start.

    `aim` is a cost that something else has reached: three steps in a row that gain less than a twentieth of what lies
    between end the search. So do three that gain less than the share `edge` of the cost and were cut short because
    farther on there are no numbers: a way to an inertia of zero, along which each solution takes longer than the last.

    `ahead`: the first step of each turn is tried with its derivatives, which costs less than a second solution where
    it holds, as most do.

    `floor`: the search ends where REACH times what a step promises (a score test of all that is free) is not enough to
    come below that cost.
    """
    theta = np.clip(start, lower, upper)
    r, jac = evaluate(theta)
    cost, damping, patience = float(r @ r), 1e-4, _Patience(enough, aim, edge)
    for turn in range(100):
        if not np.isfinite(cost):
            return theta, np.inf
        here = _Here.at(theta, r, jac, lower, upper, free)
        if not here.moving.any():
            break
        improved = blocked = tried = False
        there: tuple[Array, Array] | None = None  # residuals and derivatives of the step that is tried first
        while damping < 1e12:
            new = np.clip(theta + here.step(damping), lower, upper)
            promised = abs(float(here.gradient @ (new - theta)))
            if np.array_equal(new, theta) or promised <= 0.1 * patience.least(cost):
                break
            if not tried and damping <= TRUSTED and cost - REACH[min(turn, 1)] * promised > floor:
                return theta, cost
            there = evaluate(new) if ahead and not tried else None
            tried = True
            new_r = residual(new) if there is None else there[0]
            new_cost = float(new_r @ new_r)
            if np.isfinite(new_cost) and new_cost < cost:
                improved = True
                break
            blocked |= not np.isfinite(new_cost)
            damping = max(damping, 1e-12) * 8.0
        if not improved:
            break
        gain = cost - new_cost
        theta, cost = new, new_cost
        if patience.over(gain, cost, blocked):
            break
        damping = max(damping / 20.0, 1e-14)
        r, jac = evaluate(theta) if there is None else there
    return theta, cost


def _asks(model: Model) -> bool:
    """Whether a fit asks of each start whether it can come near at all: a body over time, whose fits take long. Not
    equations of the user's own, of which a term may turn up far from where it starts."""
    return model.case.base.whole_runs and not model.case.base.own_dynamics


class _Problem:
    """Residuals of a bound model against measurements, flattened, in noise sd; optionally whitened."""

    def __init__(self, bound: Bound, measured: Array, sigma: Array, aim: float) -> None:
        self.bound, self.measured, self.weight = bound, measured, 1.0 / sigma[:, None]
        self.aim = aim
        whole_runs = bound.model.case.base.whole_runs
        self.asks = _asks(bound.model)
        self.floor = max(aim + BEHIND, (1.0 + SHARE_BEHIND) * aim) if self.asks else np.inf
        self.enough, self.edge = (ENOUGH_OF_RUNS, EDGE) if whole_runs else ((ENOUGH, 0.0), 0.0)
        self.ahead = whole_runs
        self.known: dict[bytes, tuple[Array, Array]] = {}  # the last evaluations, where each takes long

    def minimum(self, start: Array, free: Mask) -> tuple[Array, float]:
        """Parameters and cost, from a start; only parameters whose `free` is true move."""
        lower, upper = self.bound.model.lower, self.bound.model.upper
        stop = self.enough, self.aim, self.edge, self.ahead, self.floor
        return minimise(self.evaluate, self.residual, start, lower, upper, free, *stop)

    def nearer(self, start: Array, size: int, cost: float) -> tuple[Array, bool]:
        """The start with its size halved until the cost is at most OFF times that without it: along the derivatives a
        size may look fine that sends a body off, to where each solution takes a hundred times as long. And whether it
        came so near."""
        residual = self.evaluate(start)[0]
        for _ in range(HALVED):
            if float(residual @ residual) <= OFF * cost:
                break
            start = start.copy()
            start[size] *= 0.5
            residual = self.residual(start)
        return start, float(residual @ residual) <= OFF * cost

    def residual(self, theta: Array) -> Array:
        prediction = self.bound.predict(theta)
        return ((prediction - self.measured) * self.weight).reshape(-1)

    def evaluate(self, theta: Array) -> tuple[Array, Array]:
        key = theta.tobytes()
        if key not in self.known:
            prediction, slopes = self.bound.jacobian(theta)
            residual = (prediction - self.measured) * self.weight
            found = residual.reshape(-1), (slopes * self.weight[..., None]).reshape(residual.size, -1)
            if not self.ahead:
                return found
            if len(self.known) == KEPT:
                del self.known[next(iter(self.known))]
            self.known[key] = found
        return self.known[key]


def minimiser(bound: Bound, measured: Array, sigma: Array) -> Callable[[Array, Mask], tuple[Array, float]]:
    """Parameters and cost from a start, of which only those move whose mask is true; else as of `fit_model`."""
    return _Problem(bound, measured, sigma, np.inf).minimum


def fit_model(
    bound: Bound,
    measured: Array,
    sigma: Array,
    starts: Sequence[Array],
    aim: float = np.inf,
    absent: tuple[int, float] | None = None,
) -> Fit:
    """Fit from each start and keep the best. `measured` (channels, rows); `sigma` (channels,) in the same units; `aim`
    as of `minimise`; `absent`: place of a size, and the cost without it.
    """
    model = bound.model
    problem = _Problem(bound, measured, sigma, aim)
    whole = np.array([f.whole for f in model.fitted], dtype=bool)
    best, best_cost = np.clip(model.start, model.lower, model.upper), np.inf
    for start in starts:
        if absent is not None:
            start, came = problem.nearer(start, *absent)
            if not came and best_cost < absent[1]:
                continue  # one that sends the body off however small, beside one that leads somewhere
        theta, cost = problem.minimum(start, ~whole)
        if model.case.base.whole_runs:  # further starts need not crawl far above it
            problem.aim = min(problem.aim, cost)
            problem.floor = min(problem.floor, cost - BETTER if problem.asks else np.inf)
        if whole.any() and not problem.asks:
            theta, cost = _neighbours(problem, model, theta, cost, whole)
        if cost < best_cost * (1.0 - 1e-12):
            best, best_cost = theta, cost
    if whole.any() and problem.asks:  # a grid of them was looked at: the best one's will do
        best, best_cost = _neighbours(problem, model, best, best_cost, whole)
    best = _wrapped(model, best)
    residual, slopes = problem.evaluate(best)
    shape = measured.shape
    close = 1e-9 * np.abs(best)
    near = (best - model.lower <= close) | (model.upper - best <= close)
    return Fit(
        bound=bound,
        theta=best,
        residual=-residual.reshape(shape),
        jacobian=slopes.reshape(*shape, -1),
        sigma=sigma,
        cost=float(residual @ residual),
        at_bound=tuple(f.key for f, stuck in zip(model.fitted, near, strict=True) if stuck and not f.whole),
    )


def _neighbours(problem: _Problem, model: Model, theta: Array, cost: float, whole: Mask) -> tuple[Array, float]:
    """Try the whole numbers on either side."""
    for index in np.flatnonzero(whole):
        middle = round(theta[index])
        for beside in (middle - 1.0, middle + 1.0):
            start = theta.copy()
            start[index] = np.clip(beside, model.lower[index], model.upper[index])
            new, new_cost = problem.minimum(start, ~whole)
            if new_cost < cost:
                theta, cost = new, new_cost
    return theta, cost


def _wrapped(model: Model, theta: Array) -> Array:
    """Phases, which the catalogue bounds by two turns, in (-pi, pi]."""
    turn = 2.0 * np.pi
    phase = np.array([is_phase(f) for f in model.fitted], dtype=bool)
    return np.where(phase, np.pi - np.mod(np.pi - theta, turn), theta)


def extend(
    parent: Fit,
    effect_name: str,
    inputs_bound: Bound,
    measured: Array,
    sigma: Array,
    more: Sequence[Array] = (),
    aim: float = np.inf,
) -> Fit:
    """Fit a model that has one effect more than `parent`, warm-started there and at the starts `more`.

    The parent is among the starts, so the cost is at most its own where the effect can be absent. `aim` as of
    `minimise`.
    """
    model = inputs_bound.model
    count = len(parent.theta)
    assert len(model.fitted) > count or not any(f.effect == effect_name for f in model.fitted)
    stated = np.concatenate([parent.theta, model.start[count:]])
    screened = _screened(parent, inputs_bound, stated, measured, sigma)
    if screened and _asks(model) and model.start[count] == 0.0:
        # with no size a shape has no derivative: it starts from the grid's, but where these lead nowhere
        fit = fit_model(inputs_bound, measured, sigma, [*screened, *more], aim, (count, parent.cost))
        return fit if fit.cost <= parent.cost else fit_model(inputs_bound, measured, sigma, [stated], aim)
    starts = [stated, *screened, *more]
    if len(model.start) > count and model.start[count] != 0.0:  # a size that was found beside other values
        absent = stated.copy()
        absent[count] = np.clip(0.0, model.lower[count], model.upper[count])
        starts.append(absent)
    return fit_model(inputs_bound, measured, sigma, starts, aim)


def _screened(parent: Fit, bound: Bound, absent: Array, measured: Array, sigma: Array) -> list[Array]:
    """The grid's combinations that explain most when the effect's size enters linearly, with that size."""
    model, count = bound.model, len(parent.theta)
    fresh = model.fitted[count:]
    if not fresh or not any(f.grid for f in fresh):
        return []
    axes = [f.grid if f.grid and i else (0.0,) if i == 0 else (f.start,) for i, f in enumerate(fresh)]
    combinations = list(product(*axes))[:GRID_LIMIT]
    size_step = 1e-3 * (fresh[0].grid[0] if fresh[0].grid else 1.0)
    if np.isfinite(fresh[0].upper):
        size_step = min(size_step, 1e-3 * fresh[0].upper)
    sets = np.repeat(absent[None, :], len(combinations), axis=0)
    sets[:, count:] = combinations
    sets[:, count] = size_step
    weight = 1.0 / sigma[:, None]
    first = sets[0].copy()
    first[count] = absent[count]
    apart, which, sign = _half_turns(combinations, [is_phase(f) for f in fresh])
    values = bound.near(np.vstack([first, sets[apart]]))
    base = values[0]
    change = ((values[1:] - base) / size_step * weight).reshape(len(apart), -1)[which] * sign[:, None]
    residual = ((measured - base) * weight).reshape(-1)
    flat = parent.jacobian.reshape(residual.size, -1)
    basis = np.linalg.qr(flat)[0] if flat.shape[1] else np.zeros((residual.size, 0))
    change = change - (change @ basis) @ basis.T
    residual = residual - basis @ (basis.T @ residual)
    norm = (change * change).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.where(norm > 1e-12, (change @ residual) / norm, 0.0)
    size = np.clip(size, fresh[0].lower, fresh[0].upper)
    gain = size * (2.0 * (change @ residual) - size * norm)
    order = np.argsort(-gain, kind="stable")[:SCREENED]
    starts = []
    for index in order:
        start = sets[index].copy()
        start[count] = size[index]
        starts.append(start)
    return starts


def _half_turns(combinations: Sequence[tuple[float, ...]], phase: Sequence[bool]) -> tuple[Index, Index, Array]:
    """Of combinations of values, those that differ by more than half a turn of a phase, which is the other sign: their
    places, and for each combination which of them it is, and its sign."""
    first: dict[tuple[float, ...], tuple[int, int]] = {}
    which, sign = np.zeros(len(combinations), dtype=np.int64), np.ones(len(combinations))
    for place, values in enumerate(combinations):
        halves = [round(v / np.pi, 9) if waves else 0.0 for v, waves in zip(values, phase, strict=True)]
        key = tuple(h % 1.0 if waves else v for v, h, waves in zip(values, halves, phase, strict=True))
        turned = int(sum(np.floor(h) for h in halves))
        which[place], reference = first.setdefault(key, (len(first), turned))
        sign[place] = -1.0 if (turned - reference) % 2 else 1.0
    return np.unique(which, return_index=True)[1], which, sign


def covariance(fit: Fit, run: Index, node: Node, sd: Array | None = None) -> tuple[Array, Array]:
    """Covariance of the parameters: from the kind of noise, and cluster-robust over runs.

    `run` (rows,) names the run of each training row; `sd` (channels,) is that of a row, in the sd that the fit was made
    with (1 unless given). The second makes no assumption about noise
    or misfit inside a run, but with few runs it is itself noisy (small-sample factor G / (G - 1)). What the data do not
    determine (a direction in which nothing changes: an effect that the model's own parameters can take up) has an sd a
    million times as large as what they do.
    """
    channels, rows, count = fit.jacobian.shape
    runs = Runs(run, channels, fit.bound.predict(fit.theta) if node.gain or node.grow else None)
    flat = runs.sort(fit.jacobian.reshape(channels * rows, count))
    flat = np.where(np.isfinite(flat).all(axis=0), flat, 0.0)  # what has no derivative is not determined
    scale = np.sqrt((flat * flat).sum(axis=0))
    flat = flat / np.where(scale > 0, scale, 1.0)
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(flat.T @ flat)
    seen = values > UNSEEN * values.max(initial=0.0)
    inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
    free = vectors[:, ~seen] @ vectors[:, ~seen].T / (UNSEEN * max(1.0, values.max(initial=0.0)))
    noisy = flat if sd is None else flat * np.repeat(sd, rows)[:, None]
    middle = noisy.T @ runs.times(noisy, node)
    score = np.add.reduceat(flat * runs.sort(fit.residual.reshape(-1, 1)), runs.begin, axis=0)
    score = score.reshape(channels, runs.runs, count).sum(axis=0)
    factor = runs.runs / (runs.runs - 1) if runs.runs > 1 else 1.0
    outer = np.outer(scale, scale)
    robust = factor * (inverse @ score.T @ score @ inverse)
    return (inverse @ middle @ inverse + free) / outer, (robust + free) / outer
