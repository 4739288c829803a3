"""Noise as rigs make it: white and correlated from row to row, offsets and gains from run to run, slow drifts in runs.

Of a run with m rows, the noise has the covariance

    s^2 [ W ((1 - share) I + share R(rho)) W + offset^2 1 1' + drift^2 l l' + gain^2 g g' ],    R_ij = rho^|i - j|

l: the straight line over the run of mean 0 and rms 1; g: what the model predicts, of rms 1 over all runs; W: diagonal,
W^2 = 1 - grow + grow g^2, for instruments that are right to some percent of the reading; s: rms of a row without
offset, drift and gain. Runs are independent of each other: they are the unit of replication, not the rows. Of several
channels all have one kind of noise, or one of them has another than the rest.
White noise beside AR(1) noise is an ARMA(1, 1) process, whose innovations a filter of one state gives; offset, drift
and gain are three more columns a run. Everything that is asked of the data needs only inner products x' V^-1 y, and of
these each filter is gone through once (NODES share them), however many offsets, drifts and gains are weighed.

Sources: Harvey, Forecasting, Structural Time Series Models and the Kalman Filter (1989), ch. 3, for the filter; Hillis
and Steele, Data Parallel Algorithms (1986), for all its rows at once; Woodbury's identity for the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_tools.workbench.noise.kinds import Kind, Node, One, Two

__all__ = [
    "WALKED",
    "WAVES",
    "Filtered",
    "Products",
    "Runs",
    "carried",
    "doublings",
    "orthonormal",
]

SCALED = 3  # rows of a run from which a factor on it differs from noise of its rows; chosen by hand
WAVES = 6  # half waves over the test, that a walk is made of: 91 % of its variance
WALKED = 8  # runs from which a walk over the test differs from an offset a run; chosen by hand
OWN = 3  # columns that each run has of its own: constant, line and prediction
SETTLED = 1e-13  # change of the filter's gain in a row, below which it is constant
MOST = 2**21  # numbers of one array in which several nodes are gone through at once; bounds the memory
WIDE = 32  # columns that are filtered at once: those of a long recording stay in the processor's cache
FORGOTTEN = 1e-18  # share of a row that is not carried on to later ones: below rounding


def orthonormal(columns: Array) -> Array:
    """An orthonormal basis of the columns (rows, count); columns that add nothing are left out."""
    if columns.shape[1] == 0:
        return columns
    norm = np.sqrt((columns * columns).sum(axis=0))
    kept = columns[:, norm > 0] / norm[norm > 0]
    if kept.shape[1] == 0:
        return np.zeros((columns.shape[0], 0))
    u, s, _ = np.linalg.svd(kept, full_matrices=False)
    return np.asarray(u[:, s > 1e-9 * s[0]])


@cache
def _gain(share: float, rho: float) -> tuple[Array, Array]:
    """Gain of the filter and variance of its innovation by place in a run; the last ones hold for all later places."""
    p = share
    gains: list[float] = []
    variances: list[float] = []
    while len(gains) < 2 or abs(gains[-1] - gains[-2]) >= SETTLED:
        variances.append(p + 1.0 - share)
        gains.append(p / variances[-1])
        p = rho * rho * p * (1.0 - gains[-1]) + share * (1.0 - rho * rho)
    return np.array(gains), np.array(variances)


def doublings(rate: Array) -> list[tuple[int, Array]]:
    """What `carried` does for y_t = x_t + rate_t y_(t-1): (rows,), 0 at the first row and wherever it begins anew.

    After the first step a row holds its own and the one before, after the second four of them, and so on.
    """
    steps = []
    reach = 1
    while reach < len(rate) and np.abs(rate).max() > FORGOTTEN:
        steps.append((reach, rate[reach:, None]))
        rate = np.concatenate([np.zeros(reach), rate[reach:] * rate[:-reach]])
        reach *= 2
    return steps


def carried(columns: Array, steps: Sequence[tuple[int, Array]]) -> Array:
    """y_t = x_t + rate_t y_(t-1) of columns (rows, count), in their place.

    >>> carried(np.array([[1.0], [0.0], [0.0], [4.0]]), doublings(np.array([0.0, 0.5, 0.5, 0.0]))).ravel().tolist()
    [1.0, 0.5, 0.25, 4.0]
    """
    for reach, rate in steps:
        columns[reach:] += rate * columns[:-reach]
    return columns


@dataclass(frozen=True)
class Filtered:
    """Columns (channels * rows, count) made independent at one correlation, their products with each run's filtered
    constant, line and prediction (channels * runs * 3, count), and the filtered waves over the test
    (channels * rows, waves)."""

    columns: Array
    sums: Array
    over_test: Array

    @cached_property
    def waves(self) -> Array:
        """Products of waves and columns (waves, count); few kinds of noise ask for them."""
        return np.asarray(self.over_test.T @ self.columns)

    def only(self, part: slice) -> Filtered:
        """Some of the columns."""
        return Filtered(self.columns[:, part], self.sums[:, part], self.over_test)


@dataclass(frozen=True)
class Products:
    """x' V^-1 y of two sets of columns, (count, its count), at every node of one filter."""

    runs: Runs
    left: Filtered
    right: Filtered

    @cached_property
    def plain(self) -> Array:
        return np.asarray(self.left.columns.T @ self.right.columns)

    def at(self, node: Node) -> Array:
        return np.asarray(self.each((node,))[0])

    def each(self, nodes: Sequence[Node]) -> Array:
        """At several nodes of that filter: (nodes, left's count, right's)."""
        found = np.repeat(self.plain[None], len(nodes), axis=0)
        left, right = self.left.sums, self.right.sums
        for places in _handfuls([i for i, node in enumerate(nodes) if node.of_runs], right.size):
            found[places] -= left.T @ self.runs.weigh([nodes[i] for i in places], right)
        for i, node in enumerate(nodes):
            if node.walk:
                taken = self.runs.against_waves(node, self.left).T @ self.runs.wave_weight(node)
                found[i] -= taken @ self.runs.against_waves(node, self.right)
        return found


class Runs:
    """Rows that belong to runs, in file order, of one or more channels with independent noise.

    Parameters
    ----------
    run : (rows,), the run of each row.
    channels : columns below are (channels * rows, count), channel by channel.
    level : (channels, rows), what the model predicts, in any unit; without it, and in runs of fewer than SCALED rows,
        a gain changes nothing.
    felt : (channels, rows, OWN), what is left of `shifts` where starts are fitted that follow them; None: all of them.
    whole : (channels,), whose sd is that of whole runs, so that what runs have of their own is in it; None: none. It
        counts where channels have unlike noise: what all have is in each sd or in none.
    """

    def __init__(
        self,
        run: Index,
        channels: int = 1,
        level: Array | None = None,
        felt: Array | None = None,
        whole: Mask | None = None,
    ) -> None:
        self.felt, self.whole = felt, whole
        self.run, self.rows, self.channels = run, len(run), channels
        self.order = np.argsort(run, kind="stable")
        self.sorted = bool((np.diff(run) >= 0).all())
        sorted_run = run[self.order]
        first = np.ones(self.rows, dtype=bool)
        first[1:] = sorted_run[1:] != sorted_run[:-1]
        begin = np.flatnonzero(first)
        length = np.diff(np.append(begin, self.rows))
        self.runs = len(begin)
        self.begin = np.concatenate([begin + c * self.rows for c in range(channels)])
        self.length = np.tile(length, channels)
        place = np.arange(self.rows) - np.repeat(begin, length)
        self.position = np.empty(self.rows, dtype=np.int64)  # of a row within its run
        self.position[self.order] = place
        self.place = np.tile(place, channels)
        middle = 0.5 * (np.repeat(length, length) - 1.0)
        rms = np.sqrt(np.maximum(np.repeat(length, length) ** 2 - 1.0, 0.0) / 12.0)
        self.line = np.empty(self.rows)
        self.line[self.order] = (place - middle) / np.where(rms > 0.0, rms, 1.0)
        level = np.zeros((channels, self.rows)) if level is None else level
        rms = np.sqrt(np.mean(level * level, axis=1, keepdims=True))
        many = np.empty(self.rows, dtype=bool)
        many[self.order] = np.repeat(length >= SCALED, length)
        self.reading = np.where(rms > 0.0, level, 1.0) / np.where(rms > 0.0, rms, 1.0)  # (channels, rows)
        self.sorted_reading = self.reading[:, self.order].reshape(-1)
        self.level = np.where(many & (rms > 0.0), self.reading, 0.0)  # the same, for a gain
        self._parts = [slice(b, b + n) for b, n in zip(self.begin, self.length, strict=True)]
        self._steps: dict[Kind, list[tuple[int, Array]]] = {}
        self._owns: dict[Kind, Array] = {}
        self._corners: dict[Kind, Array] = {}
        self._weights: dict[Node, Array] = {}
        self._halves: dict[Node, list[tuple[Index, Array]]] = {}
        self._determinants: dict[Node, Array] = {}
        self._wave_columns: dict[Kind, Array] = {}
        self._waves_filtered: dict[Kind, Filtered] = {}
        self._wave_inners: dict[Node, Array] = {}
        self._wave_weights: dict[Node, Array] = {}
        self._wave_turns: dict[Node, Array] = {}

    def without(self, rows: Mask) -> Runs:
        """The other rows."""
        felt = None if self.felt is None else self.felt[:, ~rows]
        return Runs(self.run[~rows], self.channels, self.reading[:, ~rows], felt, self.whole)

    def sort(self, columns: Array) -> Array:
        """Columns (channels * rows, count) with the rows of each run together; the very columns where they are so."""
        if self.sorted:
            return columns.reshape(self.channels * self.rows, -1)
        split = columns.reshape(self.channels, self.rows, -1)
        return split[:, self.order].reshape(self.channels * self.rows, -1)

    def sd(self, grow: float) -> Array:
        """Of each row (channels * rows,), sorted, of rms 1: how it grows with the reading."""
        return np.asarray(np.sqrt(1.0 - grow + grow * self.sorted_reading**2))

    # -- the filter ---------------------------------------------------------------------------------------------------

    def _innovations(self, ordered: Array, kind: Kind) -> Array:
        if not isinstance(kind, Two):
            return self._of_one(ordered, kind, range(self.channels))
        white = np.empty(ordered.shape)
        for channels, one, floor in (
            (range(kind.only), kind.others, kind.their_floor),
            (range(kind.only, kind.only + 1), kind.own, kind.floor),
            (range(kind.only + 1, self.channels), kind.others, kind.their_floor),
        ):
            if channels:
                mine = slice(channels.start * self.rows, channels.stop * self.rows)
                white[mine] = self._of_one(ordered[mine], one, channels)
                white[mine] *= self._larger(floor, channels)
        return white

    def _of_one(self, ordered: Array, kind: One, channels: range) -> Array:
        """Of some channels that follow each other, (their rows, count)."""
        share, rho, grow = kind
        count = len(channels) * self.rows
        if grow:
            ordered = ordered / self.sd(grow)[channels.start * self.rows :][:count, None]
        if share == 0.0:
            return ordered
        gain, variance = _gain(share, rho)
        begin = self.begin[: len(channels) * self.runs]
        sd = np.sqrt(variance[np.minimum(self.place[:count], len(variance) - 1)])[:, None]
        if share < 1.0 and kind not in self._steps:
            back = rho * (1.0 - gain)
            rate = np.where(self.place > 0, back[np.minimum(self.place - 1, len(back) - 1)], 0.0)
            self._steps[kind] = doublings(rate)
        steps = self._steps[kind] if share < 1.0 else []
        steps = [(reach, rate[: count - reach]) for reach, rate in steps if reach < count]
        white = np.empty(ordered.shape)
        for first in range(0, ordered.shape[1], WIDE):
            columns = ordered[:, first : first + WIDE]
            found = np.empty(columns.shape)
            np.multiply(columns[:-1], -rho, out=found[1:])
            found[1:] += columns[1:]
            found[begin] = columns[begin]
            carried(found, steps)
            found /= sd
            white[:, first : first + WIDE] = found
        return white

    def _rows_of(self, channel: int) -> slice:
        return slice(channel * self.rows, (channel + 1) * self.rows)

    def _runs_of(self, channel: int) -> slice:
        return slice(channel * self.runs, (channel + 1) * self.runs)

    def _larger(self, floor: float, channels: range) -> Array:
        """The rms of whole runs, where that is in the sd, by row of some channels (their rows, 1)."""
        whole = np.zeros(self.channels, dtype=bool) if self.whole is None else self.whole
        return np.repeat(np.where(whole[channels.start : channels.stop], floor, 1.0), self.rows)[:, None]

    def _correlated(self, columns: Array, rho: float) -> Array:
        """y_t = x_t + rho y_(t-1) in each run: columns (channels * rows, count), sorted, in their place."""
        return carried(columns, doublings(np.where(self.place > 0, rho, 0.0)))

    @property
    def shifts(self) -> Array:
        """What each run may have of its own: constant, line and prediction (channels, rows, OWN), in file order."""
        line = np.broadcast_to(self.line, self.level.shape)
        return np.stack([np.ones(self.level.shape), line, self.level], axis=-1)

    @cached_property
    def own(self) -> Array:
        """The same as the rows show it: (channels * rows, OWN), sorted."""
        return self.sort((self.shifts if self.felt is None else self.felt).reshape(-1, OWN))

    def filtered(self, columns: Array, kind: Kind) -> Filtered:
        """Columns (channels * rows, count) in file order, ready for `products`."""
        return self._filtered(self.sort(columns), kind)

    def _filtered(self, ordered: Array, kind: Kind) -> Filtered:
        white = self._innovations(ordered, kind)
        sums = self._by_run(self._own(kind), white).reshape(OWN * len(self.begin), -1)
        return Filtered(white, sums, self._filtered_waves(kind))

    def _own(self, kind: Kind) -> Array:
        """What each run has of its own, filtered."""
        if isinstance(kind, Two):  # not scaled: sizes of what runs have are in sd of a row
            found, mine = self._own(kind.others).copy(), self._rows_of(kind.only)
            found[mine] = self._own(kind.own)[mine]
            return found
        if kind not in self._owns:
            self._owns[kind] = self._innovations(self.own, kind)
        return self._owns[kind]

    def _by_run(self, left: Array, right: Array) -> Array:
        """Products of columns (channels * rows, count), sorted, in each run: (channels * runs, left's, right's)."""
        count, length = len(self.begin), int(self.length[0])
        if (self.length == length).all():
            split = (part.reshape(count, length, part.shape[1]) for part in (left, right))
            return np.asarray(np.swapaxes(next(split), 1, 2) @ next(split))
        found = np.empty((count, left.shape[1], right.shape[1]))
        for one, part in zip(found, self._parts, strict=True):
            np.matmul(left[part].T, right[part], out=one)
        return found

    def products(self, left: Filtered, right: Filtered) -> Products:
        return Products(self, left, right)

    def squares(self, columns: Filtered, nodes: Sequence[Node]) -> Array:
        """x' V^-1 x of each column at several nodes of one filter: (nodes, count)."""
        found = np.repeat(np.einsum("ij,ij->j", columns.columns, columns.columns)[None], len(nodes), axis=0)
        for places in _handfuls([i for i, node in enumerate(nodes) if node.of_runs], columns.sums.size):
            found[places] -= np.einsum("ij,nij->nj", columns.sums, self.weigh([nodes[i] for i in places], columns.sums))
        for i, node in enumerate(nodes):
            if node.walk:
                against = self.against_waves(node, columns)
                found[i] -= np.einsum("ij,ij->j", against, self.wave_weight(node) @ against)
        return found

    def _corner(self, kind: Kind) -> Array:
        """Products of constant, line and prediction with each other, a run: (channels * runs, 3, 3)."""
        if kind not in self._corners:
            own = self._own(kind)
            self._corners[kind] = self._by_run(own, own)
        return self._corners[kind]

    def _weight(self, node: Node) -> Array:
        """T (1 + T Z'Z T)^-1 T of each run, with T the sizes of what it has of its own: (channels * runs, 3, 3)."""
        if node not in self._weights and node.rest is not None:
            self._weights[node] = self._weight(node.rest).copy()
            mine = self._runs_of(node.only)
            self._weights[node][mine] = self._weight(node.of(node.only))[mine]
        if node not in self._weights:
            size = _sizes(node)
            inner = np.eye(OWN) + size @ self._corner(node.filter) @ size
            self._weights[node] = size @ np.linalg.inv(inner) @ size
        return self._weights[node]

    def weigh(self, nodes: Sequence[Node], sums: Array) -> Array:
        """What Woodbury's identity takes off a product, from the sums of runs (runs * 3, count): (nodes, ...)."""
        weight = np.array([self._weight(node) for node in nodes])
        return np.asarray((weight @ sums.reshape(len(self.begin), OWN, -1)).reshape(len(nodes), *sums.shape))

    # -- what wanders over the whole test ------------------------------------------------------------------------------

    @cached_property
    def waves(self) -> Array:
        """A walk over the test as cosines (channels * rows, channels * WAVES), sorted, together of unit mean square.

        Karhunen and Loeve's expansion of Brownian motion without its mean; runs follow each other by their number. Too
        few runs have none: (channels * rows, 0).
        """
        if self.runs < WALKED:
            return np.zeros((self.channels * self.rows, 0))
        k = np.arange(1, WAVES + 1)
        weight = np.sqrt(2.0 / (1.0 / k**2).sum()) / k
        one = weight * np.cos(np.pi * np.outer((np.arange(self.rows) + 0.5) / self.rows, k))
        return np.kron(np.eye(self.channels), one)

    def _filtered_waves(self, kind: Kind) -> Array:
        if kind not in self._wave_columns:
            self._wave_columns[kind] = self._innovations(self.waves, kind)
        return self._wave_columns[kind]

    def against_waves(self, node: Node, columns: Filtered) -> Array:
        """W' V^-1 x (waves, count), with V all but the walk."""
        if not node.of_runs:
            return columns.waves
        own = self._own_waves(node.filter).sums
        return np.asarray(columns.waves - own.T @ self.weigh((node,), columns.sums)[0])

    def _own_waves(self, kind: Kind) -> Filtered:
        """The waves as any other columns."""
        if kind not in self._waves_filtered:
            self._waves_filtered[kind] = self._filtered(self.waves, kind)
        return self._waves_filtered[kind]

    def _wave_inner(self, node: Node) -> Array:
        """1 + w^2 W' V^-1 W (waves, waves), with V all but the walk."""
        if node not in self._wave_inners:
            against = self.against_waves(node, self._own_waves(node.filter))
            self._wave_inners[node] = np.asarray(np.eye(self.waves.shape[1]) + node.walk**2 * against)
        return self._wave_inners[node]

    def wave_weight(self, node: Node) -> Array:
        """What Woodbury's identity takes off a product for the walk: (waves, waves)."""
        if node not in self._wave_weights:
            self._wave_weights[node] = np.asarray(node.walk**2 * np.linalg.inv(self._wave_inner(node)))
        return self._wave_weights[node]

    # -- whole vectors -----------------------------------------------------------------------------------------------

    def whiten(self, columns: Array, node: Node) -> Array:
        """Columns (channels * rows, count) made independent with unit variance, if the noise had s = 1; sorted."""
        white = self._without_walk(self._innovations(self.sort(columns), node.filter), node)
        if not node.walk:
            return white
        if node not in self._wave_turns:
            own = self._without_walk(self._filtered_waves(node.filter), node)
            u, s, _ = np.linalg.svd(node.walk * own, full_matrices=False)
            self._wave_turns[node] = u * np.sqrt(1.0 - 1.0 / np.sqrt(1.0 + s * s))
        turn = self._wave_turns[node]
        return np.asarray(white - turn @ (turn.T @ white))

    def _without_walk(self, white: Array, node: Node) -> Array:
        """What the filter has made white, freed of offsets, drifts and gains."""
        if not node.of_runs:
            return white
        white = white.copy()
        for rows, turn in self._turns(node):
            own = white[rows]  # (runs, length, count)
            white[rows] = own - turn @ (np.swapaxes(turn, 1, 2) @ own)
        return white

    def _turns(self, node: Node) -> list[tuple[Index, Array]]:
        """For the runs of each length: their rows (runs, length), and U (runs or 1, length, 3), so that 1 - U U' takes
        offset, drift and gain from what the filter has made white."""
        if node not in self._halves:
            every = range(self.channels)
            if node.rest is None:
                self._halves[node] = self._turns_of(node, every)
            else:
                others = [channel for channel in every if channel != node.only]
                own = self._turns_of(node.of(node.only), [node.only])
                self._halves[node] = own + self._turns_of(node.rest, others)
        return self._halves[node]

    def _turns_of(self, node: Node, channels: Sequence[int]) -> list[tuple[Index, Array]]:
        """The same in some channels, that have one kind of noise."""
        if not node.of_runs:
            return []
        own, found = self._own(node.filter) @ _sizes(node), []
        mine = np.repeat(np.isin(np.arange(self.channels), channels), self.runs)
        for length in np.unique(self.length):
            rows = self.begin[mine & (self.length == length)][:, None] + np.arange(length)
            # where nothing goes with the prediction or with starts, runs of one length have the same
            alone = node.gain or node.grow or self.felt is not None
            u, s, _ = np.linalg.svd(own[rows if alone else rows[:1]], full_matrices=False)
            found.append((rows, u * np.sqrt(1.0 - 1.0 / np.sqrt(1.0 + s * s))[:, None, :]))
        return found

    def log_determinants(self, node: Node) -> Array:
        """Of the covariance of each run's rows, s = 1, but for the walk: (channels * runs,)."""
        if node in self._determinants:
            return self._determinants[node]
        found = self._determinants[node] = np.zeros(len(self.begin))
        if node.rest is not None:
            mine = self._runs_of(node.only)
            found += self.log_determinants(node.rest) - self._share(node.rest)
            own = node.of(node.only)
            found[mine] = (self.log_determinants(own) - self._share(own))[mine]
            return found
        if node.share > 0.0:
            variance = _gain(node.share, node.rho)[1]
            found += np.add.reduceat(np.log(variance[np.minimum(self.place, len(variance) - 1)]), self.begin)
        if node.grow:
            found += 2.0 * np.add.reduceat(np.log(self.sd(node.grow)), self.begin)
        if node.of_runs:
            size = _sizes(node)
            found += np.linalg.slogdet(np.eye(OWN) + size @ self._corner(node.filter) @ size)[1]
        return found

    def _share(self, node: Node) -> Array:
        """What the log determinants (channels * runs,) are larger by than where the sd is that of whole runs."""
        whole = np.zeros(self.channels) if self.whole is None else self.whole
        return np.asarray(2.0 * np.log(node.floor) * np.repeat(whole, self.runs) * self.length)

    def log_determinant(self, node: Node) -> float:
        """Of the covariance of all rows, s = 1."""
        walk = float(np.linalg.slogdet(self._wave_inner(node))[1]) if node.walk else 0.0
        return float(self.log_determinants(node).sum()) + walk

    def draw(self, random: np.random.Generator, sets: int, node: Node) -> Array:
        """Noise (channels * rows, sets) of this kind with s = 1, in file order."""
        if node.rest is not None:
            return self._of_two(node, lambda one: self.draw(random, sets, one), -1.0)
        total = self.channels * self.rows
        ordered = np.sqrt(1.0 - node.share) * random.standard_normal((total, sets)) if node.share < 1.0 else 0.0
        if node.share > 0.0:
            slow = np.sqrt(1.0 - node.rho**2) * random.standard_normal((total, sets))
            slow[self.begin] /= np.sqrt(1.0 - node.rho**2)
            ordered = ordered + np.sqrt(node.share) * self._correlated(slow, node.rho)
        ordered = ordered * self.sd(node.grow)[:, None]
        for size, column in zip(np.diagonal(_sizes(node)), self.own.T, strict=True):
            if size:
                drawn = np.repeat(random.standard_normal((len(self.begin), sets)), self.length, axis=0)
                ordered = ordered + size * column[:, None] * drawn
        if node.walk:
            ordered = ordered + node.walk * self.waves @ random.standard_normal((self.waves.shape[1], sets))
        split = np.asarray(ordered).reshape(self.channels, self.rows, sets)
        drawn = np.empty_like(split)
        drawn[:, self.order] = split
        return drawn.reshape(total, sets)

    def _of_two(self, node: Node, of: Callable[[Node], Array], power: float) -> Array:
        """Rows (channels * rows, count), in file order or sorted, of each channel's kind of noise; `power` of the rms
        of whole runs where that is in the sd."""
        own, rest = node.of(node.only), node.rest
        assert rest is not None, "a node of two kinds"
        every, mine = range(self.channels), self._rows_of(node.only)
        found = of(rest) * self._larger(rest.floor**power, every)
        found[mine] = (of(own) * self._larger(own.floor**power, every))[mine]
        return found

    def times(self, columns: Array, node: Node) -> Array:
        """The covariance (s = 1) times columns (channels * rows, count), both sorted by run."""
        if node.rest is not None:
            return self._of_two(node, lambda one: self.times(columns, one), -2.0)
        sd = self.sd(node.grow)[:, None]
        result = (1.0 - node.share) * sd**2 * columns
        if node.share > 0.0:
            grown = sd * columns
            ahead = np.where(np.roll(self.place, -1) > 0, node.rho, 0.0)  # of the row after, where the run goes on
            backward = carried(grown[::-1].copy(), doublings(ahead[::-1]))[::-1]
            result += node.share * sd * (self._correlated(grown.copy(), node.rho) + backward - grown)
        for size, column in zip(np.diagonal(_sizes(node)), self.own.T, strict=True):
            if size:
                for part in self._parts:
                    result[part] += size * size * np.outer(column[part], column[part] @ columns[part])
        if node.walk:
            result = result + node.walk**2 * self.waves @ (self.waves.T @ columns)
        return np.asarray(result)


def _sizes(node: Node) -> Array:
    """Sd of what each run has of its own: (OWN, OWN), diagonal."""
    return np.diag([node.offset, node.drift, node.gain])


def _handfuls(places: list[int], size: int) -> list[list[int]]:
    """Places, so many together that as many arrays of a size hold at most MOST numbers, at least one."""
    count = max(1, MOST // max(1, size))
    return [places[begin : begin + count] for begin in range(0, len(places), count)]
