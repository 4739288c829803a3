"""Curves that no formula is known for: any function of one column, or a narrow bump in it.

The function is WAVES cosines over the column's range, of one prior size; the bump stands at one of many places. They
pay for each of them, so a named effect or a short formula that is true beats the curve. Slow waves are larger, in a
smooth curve by far: as in a smoothing spline (Wahba, Spline Models for Observational Data, 1990), whose coefficients
fall with the square of the order. In a rough one, as friction that turns round, they fall with its root.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.bases import formula_name
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import SIZES, Evidence

__all__ = ["BUMPS", "DIRECTION", "ROUGH", "WAVES", "Bump", "Curve", "Waves", "bridged", "drawn", "likeliest"]

WAVES = 9  # of a curve: its mean, and half waves over a column's range
ROUGH = (0.5, 2.0)  # power of the order that the waves of a curve fall with
FEWEST = 3  # rows of a bump; fewer stand alone
BUMPS = 50  # places of a narrow bump over a column's range, at which it is as wide (sd)
DIRECTION = "direction"
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
class Waves:
    """A constant and the cosines of a column, times a factor: (rows, WAVES). Without the constant the mean of a curve
    looks like an effect beside it: that of one times the direction like dry friction."""

    column: str
    by: str
    values: Array  # of the column, or its magnitude (rows,)
    factor: Array
    power: float = ROUGH[0]

    def at(self, values: Array) -> Array:
        order = np.arange(1, WAVES)
        waves = np.sqrt(2.0) * np.cos(np.pi * np.outer(self.place(values), order)) / order**self.power
        return np.column_stack([np.ones(len(values)), waves])

    def formula(self, names: Sequence[str]) -> str:
        """The curve as a formula in the column, with these names for the sizes of its cosines."""
        low, turn, column = float(self.values.min()), float(np.pi / np.ptp(self.values)), formula_name(self.column)
        each = (f"{name}*cos({order * turn:.7g}*({column} - ({low:.7g})))" for order, name in enumerate(names))
        return " + ".join(each)

    def cosines(self, coefficients: Array) -> Array:
        """Sizes of the cosines (WAVES,) of a curve with these coefficients."""
        return np.append(coefficients[0], coefficients[1:] * np.sqrt(2.0) / np.arange(1, WAVES) ** self.power)

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

    def likeliest(self, evidence: Evidence, channel: int) -> Waves:
        return self


@dataclass(frozen=True)
class Bump(Waves):
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

    def likeliest(self, evidence: Evidence, channel: int) -> Waves:
        return replace(self, centres=(self.centres[int(np.argmax(self._each(evidence, channel)))],))


def likeliest(evidence: Evidence, block: Array) -> tuple[Array, Array, float]:
    """Coefficients (WAVES,) of a block (channels * rows, WAVES), their covariance (WAVES, WAVES), and the likeliest of
    their prior sizes."""
    node, _ = evidence.likeliest()
    white = evidence.whitened(np.column_stack([block, evidence.residual]), node)
    shapes, residual = white[:, :-1], white[:, -1]
    products, score = shapes.T @ shapes, shapes.T @ residual
    free = np.eye(shapes.shape[1])
    gains = [
        score @ np.linalg.solve(free / size**2 + products, score) - np.linalg.slogdet(free + size**2 * products)[1]
        for size in SIZES
    ]
    size = float(SIZES[int(np.argmax(gains))])
    spread = np.linalg.inv(free / size**2 + products)
    mean = spread @ score
    left = residual - shapes @ mean
    return mean, spread * float(left @ left) / max(len(left) - shapes.shape[1], 1), size


def drawn(
    evidence: Evidence,
    waves: Waves,
    block: Array,
    target: str,
    unit_size: float,
    units: Mapping[str, str],
    held: Array | None = None,
) -> Curve:
    """The likeliest curve, with the sd that these data leave it. What the model's own parameters may hold, a slope as
    well as the mean, is no part of it.

    Parameters
    ----------
    block : (channels * rows, WAVES), what each of the waves changes, in noise sd.
    target : what the curve adds to, which is `unit_size` where a coefficient of the block is 1.
    held : (channels * rows, P), orthonormal, what the model's own parameters change; the base of the evidence where it
        is not given.
    """
    mean, spread, _ = likeliest(evidence, block)
    basis = evidence.flat if held is None else held
    own = np.linalg.lstsq(block, block - basis @ (basis.T @ block), rcond=None)[0]
    mean, spread = own @ mean, own @ spread @ own.T
    shown = waves.at(waves.values)
    middle = shown.mean(axis=0)
    x = np.linspace(waves.values.min(), waves.values.max(), POINTS)
    there = bridged(waves.at, x, waves.values) - middle
    sd = np.sqrt(np.einsum("ij,jk,ik->i", there, spread, there))
    rms = float(np.sqrt(np.mean((shown @ mean * waves.factor) ** 2)))
    return Curve(
        column=waves.column,
        unit=units.get(waves.column, ""),
        channel=target,
        channel_unit=units.get(target, ""),
        by=waves.by,
        rms=rms * unit_size,
        in_sd=float(np.linalg.norm(block @ mean) / np.sqrt(len(waves.values))),
        x=tuple(float(v) for v in x),
        y=tuple(float(v) for v in there @ mean * unit_size),
        sd=tuple(float(v) for v in sd * unit_size),
    )
