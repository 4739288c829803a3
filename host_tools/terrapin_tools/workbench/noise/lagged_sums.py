"""Inner products under noise that is correlated from row to row within runs (AR(1)), at any correlation at little cost.

x' V^-1 y = first + (later + rho^2 before - rho cross) / (1 - rho^2), where the four are sums over the first rows of the
runs, over the rows that have a predecessor, over their predecessors, and over neighbours. The sums are taken once; a
correlation more costs nothing that grows with the number of rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from terrapin_tools.workbench.noise.ar1 import Ar1

__all__ = ["Lagged", "Sums"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Sums:
    """The four sums of one product, all of one shape."""

    first: Array
    later: Array
    before: Array
    cross: Array

    def at(self, rho: float) -> Array:
        """The product at a correlation."""
        inner = self.later + rho * rho * self.before - rho * self.cross
        return np.asarray(self.first + inner / (1.0 - rho * rho))


class Lagged:
    """Columns (channels * rows, count) of the runs of `ar1`, sorted by run within each channel."""

    def __init__(self, ar1: Ar1, channels: int, columns: Array) -> None:
        split = columns.reshape(channels, ar1.rows, -1)
        self.columns = split[:, ar1.order].reshape(channels * ar1.rows, -1)
        self.starts = np.flatnonzero(np.tile(ar1.first, channels))
        self.ends = np.append(self.starts[1:], len(self.columns)) - 1
        self._pairs: Array | None = None

    def _neighbours(self) -> Array:
        """Each row plus its predecessor; of the first row of a run, 0."""
        if self._pairs is None:
            self._pairs = np.zeros_like(self.columns)
            np.add(self.columns[1:], self.columns[:-1], out=self._pairs[1:])
            self._pairs[self.starts] = 0.0
        return self._pairs

    def with_each(self, other: Lagged) -> Sums:
        """Products of every column with every column of `other`: (count, its count)."""
        x, y = self.columns, other.columns
        total = x.T @ y
        first = x[self.starts].T @ y[self.starts]
        later = total - first
        before = total - x[self.ends].T @ y[self.ends]
        return Sums(first, later, before, self._neighbours().T @ other._neighbours() - later - before)

    def squares(self) -> Sums:
        """Products of every column with itself: (count,)."""
        x, pairs = self.columns, self._neighbours()
        total = np.einsum("ij,ij->j", x, x)
        first = (x[self.starts] ** 2).sum(axis=0)
        later, before = total - first, total - (x[self.ends] ** 2).sum(axis=0)
        return Sums(first, later, before, np.einsum("ij,ij->j", pairs, pairs) - later - before)

    def part(self, begin: int, count: int) -> Lagged:
        """Some of the columns."""
        found = object.__new__(Lagged)
        found.columns, found.starts, found.ends = self.columns[:, begin : begin + count], self.starts, self.ends
        found._pairs = self._neighbours()[:, begin : begin + count]
        return found
