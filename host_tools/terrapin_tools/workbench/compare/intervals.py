"""Profile-likelihood intervals of the fitted parameters, and what each is most correlated with.

A parameter is held off its fit, the others are fitted again, and the cost rises: where it has risen by that of 1.96 sd,
the interval ends. For a model that is linear in its parameters the ends are +-1.96 sd; else the sides differ, or the
cost never rises so far and the interval is open. The rise is counted in the sds that the answer tells: what noise that
is not white (common to a run, correlated) adds to an sd scales it, as Pace, Salvan and Sartori (2011, Statistica Sinica
21, 129) do for likelihoods of parts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.compare.comparison import Analysis, covered, measured
from terrapin_tools.workbench.model.fitting import covariance, minimiser
from terrapin_tools.workbench.noise.kinds import Node

__all__ = ["Interval", "intervals"]

SDS = 1.959964  # of a normal distribution, either side of 95 %
FARTHER = 12  # doublings of the way out before a side is open; half and twice of it give the same ends in its tests
NARROWED = 40  # refits at most between a place inside and one outside
CLOSE = 2e-3  # share of the rise that an end may be off
WHITE = Node(0.0, 0.0, 0.0, 0.0, 1.0)
EDGE = 0.9  # share of the rise inside an end beyond which the model gives no numbers


@dataclass(frozen=True)
class Interval:
    """Of one parameter at 95 %, in its `unit`: None where the cost does not rise so far; `ends`: why a side is so.

    A side `closes`, is at a `bound` of the fit, is `open` (nothing rises, however far), or stops where the model gives
    `no numbers`.
    """

    value: float
    low: float | None
    high: float | None
    ends: tuple[str, str]
    unit: str
    partner: str  # the parameter that it is most correlated with, "" for the only one
    correlation: float


def intervals(analysis: Analysis, report: Callable[[str], None] = lambda _: None) -> dict[str, Interval]:
    """Of every parameter of the fit that is no whole number, by its key."""
    fit, found = analysis.fit, {}
    model = fit.model
    white = np.sqrt(np.diag(covariance(fit, analysis.case.run[analysis.case.train], WHITE)[0]))
    both = covered(fit, analysis.case, analysis.noise.sigma, analysis.told)[0]
    sds = np.sqrt(np.diag(both))
    with np.errstate(divide="ignore", invalid="ignore"):
        related = np.nan_to_num(both / np.outer(sds, sds)) * (1.0 - np.eye(len(sds)))
    refit = minimiser(fit.bound, measured(model, model.case.train), analysis.noise.sigma)
    for place, one in enumerate(model.fitted):
        if one.whole:
            continue
        report(f"interval of {one.key}")
        sides = [_side(analysis, refit, place, white[place], way) for way in (-1.0, 1.0)]
        partner = int(np.argmax(np.abs(related[place])))
        known = len(sds) > 1
        found[one.key] = Interval(
            value=float(fit.theta[place]),
            low=sides[0][0],
            high=sides[1][0],
            ends=(sides[0][1], sides[1][1]),
            unit=one.unit or "1",
            partner=model.fitted[partner].key if known else "",
            correlation=float(np.clip(related[place, partner], -1.0, 1.0)) if known else 0.0,
        )
    return found


def _side(
    analysis: Analysis, refit: Callable[..., tuple[Array, float]], place: int, white: float, way: float
) -> tuple[float | None, str]:
    """Where the interval ends that way, and why there."""
    fit, model = analysis.fit, analysis.fit.model
    sd = float(analysis.sd[place])
    bound = float((model.lower if way < 0 else model.upper)[place])
    if not (np.isfinite(sd) and sd > 0.0 and white > 0.0):
        return (bound, "bound") if np.isfinite(bound) else (None, "open")
    free = np.array([not one.whole for one in model.fitted])
    free[place] = False

    def rise(value: float, near: Array) -> tuple[float, Array]:
        """Distance from the fit in 1.96 sd, as the cost has it, where the parameter is `value`; the others there."""
        start = near.copy()
        start[place] = value
        with np.errstate(all="ignore"):
            theta, cost = refit(start, free)
        gain = (cost - fit.cost) * (white / sd) ** 2
        return float(np.sqrt(max(gain, 0.0))) / SDS if np.isfinite(cost) else np.inf, theta

    found = _outward(rise, float(fit.theta[place]), fit.theta, way * SDS * sd, bound)
    return _narrowed(rise, found) if isinstance(found, _Between) else found


Rise = Callable[[float, Array], tuple[float, Array]]


@dataclass(frozen=True)
class _Between:
    """The end lies between two values: at the one inside the rise is `low`, with the others at `near`; `high`, 1 or
    more, at the one outside."""

    inside: float
    low: float
    near: Array
    outside: float
    high: float


def _outward(rise: Rise, inside: float, near: Array, step: float, bound: float) -> _Between | tuple[float | None, str]:
    """Where an end lies on the way from the fit; or the end, where the way ends first, and why."""
    first, low = inside, 0.0
    for _ in range(FARTHER + 1):
        outside = first + step
        at_bound = np.sign(step) * (outside - bound) >= 0.0
        outside = bound if at_bound else outside
        if outside == inside:
            return bound, "bound"
        high, theta = rise(outside, near)
        if high >= 1.0:
            return _Between(inside, low, near, outside, high)
        if at_bound:
            return bound, "bound"
        inside, low, near = outside, high, theta
        step *= 2.0
    return None, "open"


def _narrowed(rise: Rise, found: _Between) -> tuple[float, str]:
    """The end between two values, by the secant within the middle eight tenths."""
    inside, low, near, outside, high = vars(found).values()
    for _ in range(NARROWED):
        if abs(high - 1.0) <= CLOSE:
            return outside, "closes"
        share = (1.0 - low) / (high - low) if np.isfinite(high) else 0.5
        middle = inside + min(max(share, 0.1), 0.9) * (outside - inside)
        if middle in (inside, outside):
            break
        value, theta = rise(middle, near)
        if value >= 1.0:
            outside, high = middle, value
        else:
            inside, low, near = middle, value, theta
            if 1.0 - low <= CLOSE:
                return inside, "closes"
    return inside, "closes" if low >= EDGE else "no numbers"
