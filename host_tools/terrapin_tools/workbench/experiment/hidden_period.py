"""Something periodic along the way, where no angle and no position is measured: a tooth, a pole, a splice.

The way is the integral of a speed over time within each run, so where a run begins on the wave is not known: the power
of each run is taken by itself, and summed. A slow change of the residual has power at every low rate; it is taken off
by the median of the rates around each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.compare.comparison import Analysis

__all__ = ["HiddenPeriod", "hidden_period"]

PLACES = {
    "rad/s": ("rad", "deg"),
    "m/s": ("m", "mm", "cm"),
}  # units of a speed, and of a place that would hold its wave
ROWS = 30  # of a run at least
WAVES = 3.0  # over a run at least
EACH = 2.5  # rows a wave at least; with two a wave looks like a slower one
STEPS = 3  # rates looked at between two that are independent
AROUND = 61  # rates over which the median is taken
MOST = 20_000  # rates, for time
SURE = 1e-4  # probability that noise alone looks like it, all rates together


@dataclass(frozen=True)
class HiddenPeriod:
    """`rate`: waves a turn (of a speed in rad/s), or a metre; `chance`: that noise looks like it."""

    speed: str
    channel: str
    rate: float
    per: str
    chance: float


def hidden_period(analysis: Analysis) -> HiddenPeriod | None:
    """The surest wave along the integral of a speed that is mapped, where its angle or position is not: None without
    one."""
    case = analysis.case
    found = [
        one
        for speed, unit in case.units.items()
        if unit in PLACES and speed in case.inputs and not _measured(case, PLACES[unit])
        for one in _along(analysis, speed, unit)
    ]
    return min(found, key=lambda one: one.chance, default=None)


def _measured(case: Case, units: tuple[str, ...]) -> bool:
    return any(case.units.get(name) in units and float(np.ptp(v)) > 0.0 for name, v in case.inputs.items())


def _along(analysis: Analysis, speed: str, unit: str) -> list[HiddenPeriod]:
    case, rows = analysis.case, analysis.rows
    time = case.inputs.get("time")
    if time is None:
        return []
    ways: list[tuple[Array, Array]] = []  # of each run: the way, and what is left (channels, rows)
    for run in np.unique(case.run[rows]):
        own = case.run[rows] == run
        t, v = time[rows][own], case.inputs[speed][rows][own]
        if own.sum() >= ROWS and (np.diff(t) > 0.0).all():
            way = np.concatenate([[0.0], np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2.0)])  # by trapezoids
            if np.ptp(way) > 0.0:
                ways.append((way, analysis.residual[:, own] / analysis.noise.sigma[:, None]))
    if not ways:
        return []
    length = [float(np.ptp(way)) for way, _ in ways]
    lowest = min(WAVES / one for one in length)
    highest = max(way.size / (EACH * one) for (way, _), one in zip(ways, length, strict=True))
    rates = np.arange(lowest, highest, 1.0 / (STEPS * max(length)))[:MOST]
    found = []
    for place, channel in enumerate(analysis.model.channels):
        each = np.array([_power(way, left[place], rates) for way, left in ways])
        count = np.isfinite(each).sum(axis=0)
        logs = np.where(2 * count >= len(ways), np.log(gammaincc(np.maximum(count, 1), np.nansum(each, axis=0))), 0.0)
        best = int(np.argmin(logs))
        chance = float(np.exp(logs[best])) * rates.size / STEPS
        if chance < SURE:
            whole = 2.0 * np.pi if unit == "rad/s" else 1.0
            found.append(HiddenPeriod(speed, channel, rates[best] * whole, "turn" if whole > 1.0 else "metre", chance))
    return found


def _power(way: Array, left: Array, rates: Array) -> Array:
    """Of noise at every rate (rates,): that of an exponential with mean 1; NaN where the run is too short or too fast
    for the wave."""
    length, found = float(np.ptp(way)), np.full(rates.size, np.nan)
    seen = (rates * length >= WAVES) & (rates * length * EACH <= way.size)
    if seen.sum() < AROUND:
        return found
    from scipy.ndimage import median_filter
    from scipy.signal import lombscargle  # takes a second, and a case needs a column of speed to come here

    trend = np.polynomial.Polynomial.fit(way, left, 1)
    share = lombscargle(way, left - trend(way), 2.0 * np.pi * rates[seen], normalize=True, floating_mean=True)
    power = -0.5 * (way.size - 3) * np.log1p(-np.clip(share, 0.0, 1.0 - 1e-12))
    level = median_filter(power, AROUND, mode="nearest") / np.log(2.0)
    found[seen] = power / np.maximum(level, 1.0)
    return found
