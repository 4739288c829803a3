"""The kinds of noise that are weighed, and how likely each is before anything was measured.

A kind (`Node`) says of what the covariance of a run is made (covariance.py has the formula): what neighbours share,
what differs from run to run, what wanders over the test, what grows with the reading. Of several channels one may
have another kind than the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from terrapin_hil.arrays import Array

__all__ = ["ALIKE", "ALL", "ALONE", "NODES", "PLAIN", "Kind", "Node", "One", "Two", "by_filter", "considered"]

GROWN = 0.08  # prior of noise that grows with the reading; chosen by hand
CHANNELS = 6  # of which each may have another kind of noise than the rest; further ones belong to the rest
ALL = -1  # channels
ALONE = 2.0  # sd of a row by which runs may differ that have one row each: more is the noise of a row

Numbers = TypeVar("Numbers", float, Array)
One = tuple[float, float, float]  # share, rho and grow of a Node


class Two(NamedTuple):
    """Of a node that one channel has, and of the rest."""

    only: int
    own: One
    floor: float
    others: One
    their_floor: float


Kind = One | Two


@dataclass(frozen=True)
class Node:
    """One kind of noise, and how likely it is before anything was measured."""

    share: float  # of the variance of a row that is correlated with its neighbours'
    rho: float  # that correlation
    offset: float  # sd from run to run, in sd of a row
    drift: float  # sd of the line over a run
    prior: float
    walk: float = 0.0  # sd of what wanders over the whole test, from run to run, in sd of a row
    gain: float = 0.0  # sd of a factor on the prediction from run to run, times the prediction's rms, in sd of a row
    grow: float = 0.0  # share of the variance of a row that goes with the square of the prediction
    only: int = ALL  # the channel that has it, and what the others have
    rest: Node | None = None

    @property
    def filter(self) -> Kind:
        """What makes the rows of a run independent, but for what they have in common."""
        own, rest = (self.share, self.rho, self.grow), self.rest
        if rest is None:
            return own
        return Two(self.only, own, self.floor, (rest.share, rest.rho, rest.grow), rest.floor)

    def of(self, channel: int) -> Node:
        """What a channel alone has."""
        if self.rest is None:
            return self
        return replace(self, only=ALL, rest=None) if self.only == channel else self.rest

    @property
    def floor(self) -> float:
        """Rms of whole runs that nothing was fitted to, in sd of a row."""
        return float(np.sqrt(1.0 + self.between(1.0)))

    def between(self, reading: Numbers) -> Numbers:
        """Variance from run to run, in that of a row, at a reading squared over its mean square."""
        return self.offset**2 + self.drift**2 + self.walk**2 + self.gain**2 * reading

    @property
    def of_runs(self) -> bool:
        """Whether runs differ by more than their rows do."""
        return bool(self.offset or self.drift or self.gain or (self.rest is not None and self.rest.of_runs))

    def thin(self, rows: int) -> float:
        """How many independent rows one of a run of so many is worth, for what is the same in all of them."""
        alike = 1.0 - self.share + self.share * (1.0 + self.rho) / (1.0 - self.rho)
        return float(1.0 / (alike + rows * self.offset**2))

    def words(self, channels: Sequence[str] = ()) -> str:
        """As a person would name it, of a case with these channels.

        >>> Node(0.5, 0.6, 1.0, 0.0, 0.1).words()
        'white + AR(1) + run offsets'
        """
        parts = [*(["white"] if self.share < 1.0 else []), *(["AR(1)"] if self.share > 0.0 else [])]
        parts[-1] += " growing with the reading" if self.grow else ""
        slow = {
            "run offsets": self.offset, "run gains": self.gain, "drift": self.drift, "drift over the test": self.walk
        }  # fmt: skip
        told = " + ".join([*parts, *(name for name, size in slow.items() if size)])
        if self.rest is None:
            return told
        return f"{told} in {channels[self.only] if channels else 'one channel'}, {self.rest.words()} elsewhere"


def _nodes() -> tuple[Node, ...]:
    """By hand: independent rows and runs are the likeliest; the rates by family of noise in docs/rates.md are what
    comes of it. Correlations above 0.9 are those of fast loggers."""
    correlated = {(0.5, 0.6): 0.1, (0.5, 0.9): 0.1, (1.0, 0.3): 0.1, (1.0, 0.6): 0.1, (1.0, 0.8): 0.1}
    slow = {(1.0, 0.92): 0.08, (1.0, 0.98): 0.06}
    # what is mounted anew, zeroed or filled differs by far more than rows scatter
    offsets = {0.0: 0.4, 0.25: 0.15, 0.5: 0.15, 1.0: 0.15, 2.0: 0.13, 6.0: 0.01, 20.0: 0.01}
    found = [
        Node(*kind, tau, 0.0, (0.74 - GROWN) * p * q)
        for kind, p in {(0.0, 0.0): 0.36, **correlated}.items()
        for tau, q in offsets.items()
    ]
    # noise that is alike over most of a run is hard to tell from an offset: one of each is enough
    found += [
        Node(*kind, tau, 0.0, (0.74 - GROWN) * p * q) for kind, p in slow.items() for tau, q in ((0.0, 0.6), (1.0, 0.4))
    ]
    found += [
        Node(share, rho, tau, delta, 0.11 * 0.5 * 0.5 * q)
        for share, rho in ((0.0, 0.0), (0.5, 0.6))
        for delta in (0.4, 1.0)
        for tau, q in ((0.0, 0.4), (0.5, 0.3), (1.0, 0.3))
    ]
    found += [
        Node(*kind, tau, 0.0, 0.07 * 0.5 * q, walk)
        for kind in ((0.0, 0.0), (0.5, 0.6))
        for tau, walk, q in ((0.0, 0.5, 0.4), (0.5, 0.5, 0.3), (0.0, 1.0, 0.3))
    ]
    # soil that is prepared anew, an amplifier that warms: runs differ by a factor, often by far more than rows scatter
    found += [
        Node(*kind, tau, 0.0, 0.08 * 0.5 * q, 0.0, gain)
        for kind in ((0.0, 0.0), (0.5, 0.6))
        for tau, gain, q in ((0.0, 0.5, 0.3), (0.0, 1.5, 0.3), (0.5, 1.5, 0.1), (0.0, 5.0, 0.3))
    ]
    # an instrument that is right to some percent of its reading, or one that counts
    found += [
        Node(0.0, 0.0, tau, 0.0, GROWN * p * q, grow=grow)
        for grow, p in ((0.5, 0.4), (0.98, 0.6))
        for tau, q in ((0.0, 0.6), (0.5, 0.4))
    ]
    return tuple(found)


def _unlike(channel: int) -> tuple[Node, ...]:
    """One channel has other noise than the rest; priors beside those of `_nodes`, by hand."""
    white, grown = ALIKE[0], Node(0.0, 0.0, 0.0, 0.0, 1.0, grow=0.98)
    weak, slow = (Node(1.0, rho, 0.0, 0.0, 1.0) for rho in (0.4, 0.8))
    small, middle, large = (Node(0.0, 0.0, tau, 0.0, 1.0) for tau in (0.5, 1.0, 2.0))
    found = [
        *((small, white, 0.016), (middle, white, 0.012), (large, white, 0.012)),
        *((weak, white, 0.012), (slow, white, 0.012), (Node(0.5, 0.9, 0.0, 0.0, 1.0), white, 0.008)),
        (Node(0.5, 0.6, 1.0, 0.0, 1.0), white, 0.008),
        (Node(0.0, 0.0, 0.0, 0.0, 1.0, gain=1.5), white, 0.01),
        *((grown, white, 0.01), (grown, weak, 0.005), (grown, slow, 0.005)),
        *((one, rest, 0.006) for rest in (weak, slow, grown) for one in (small, middle)),
    ]
    return tuple(replace(one, prior=prior, only=channel, rest=rest) for one, rest, prior in found)


ALIKE = _nodes()
UNLIKE = tuple(_unlike(channel) for channel in range(CHANNELS))
NODES = ALIKE + tuple(node for one in UNLIKE for node in one)
# runs that are alike
PLAIN = tuple(i for i, node in enumerate(ALIKE) if not (node.of_runs or node.walk))


def considered(channels: int) -> int:
    """How many of NODES, from the first on, are kinds of noise of a case with so many channels."""
    return len(ALIKE) + (len(UNLIKE[0]) * min(channels, CHANNELS) if channels > 1 else 0)


def by_filter(nodes: Sequence[int]) -> dict[Kind, list[int]]:
    """Places in `nodes`, by what filter the node takes."""
    found: dict[Kind, list[int]] = {}
    for place, index in enumerate(nodes):
        found.setdefault(NODES[index].filter, []).append(place)
    return found
