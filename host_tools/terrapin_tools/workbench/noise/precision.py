"""The inverse of the noise's covariance, times columns and on its diagonal, in time that grows with the rows alone.

Within a run the covariance is W (b 1 + a R) W + offset, drift and gain, with R the AR(1) correlation, whose inverse T
is tridiagonal, and W what grows with the reading. From R (a 1 + b T) = a R + b 1 follows

    (a R + b 1)^-1 = (1 - a (a 1 + b T)^-1) / b,

a tridiagonal system; offset, drift and gain come in by Woodbury's identity, three columns a run, and so does a walk
over the test, a few columns in all.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import Node

__all__ = ["Precision"]

SETTLED = 1e-15  # relative change of a recurrence below which it is at its limit


class Precision:
    """V^-1 of one kind of noise with s = 1, for rows of one channel sorted by run (`Runs.order`)."""

    def __init__(self, runs: Runs, node: Node) -> None:
        self.runs, self.a, self.b, self.rho = runs, node.share, 1.0 - node.share, node.rho
        self.sd = runs.sd(node.grow)
        self.bands = self._bands()
        self.random = runs.own * np.array([node.offset, node.drift, node.gain])
        self.weighed = self._rows_alone(self.random)
        inner = np.eye(self.random.shape[1]) + self._summed(self.random[:, :, None] * self.weighed[:, None, :])
        self.inner = np.linalg.inv(inner)
        taken = np.einsum("ri,rij,rj->r", self.weighed, np.repeat(self.inner, runs.length, axis=0), self.weighed)
        self.diagonal = self._diagonal() / self.sd**2 - taken  # (rows,)
        waves = node.walk * runs.waves if node.walk else np.zeros((runs.rows, 0))
        weighed = self._runs_alone(waves)
        # C C' = W (1 + W' V^-1 W)^-1 W', between V^-1: what the walk over the test takes off
        root = np.linalg.cholesky(np.linalg.inv(np.eye(waves.shape[1]) + waves.T @ weighed))
        self.walk = weighed @ root
        self.diagonal = self.diagonal - (self.walk * self.walk).sum(axis=1)

    def times(self, columns: Array) -> Array:
        """V^-1 times columns (rows, count)."""
        return np.asarray(self._runs_alone(columns) - self.walk @ (self.walk.T @ columns))

    def _runs_alone(self, columns: Array) -> Array:
        """Without the walk over the test."""
        alone = self._rows_alone(columns)
        sums = self._summed(self.weighed[:, :, None] * columns[:, None, :])  # (runs, 3, count)
        back = np.repeat(self.inner @ sums, self.runs.length, axis=0)
        return np.asarray(alone - np.einsum("ri,ric->rc", self.weighed, back))

    def _summed(self, rows: Array) -> Array:
        return np.asarray(np.add.reduceat(rows, self.runs.begin, axis=0))

    def _bands(self) -> Array:
        """T, or a 1 + b T where rows have noise of their own: its upper diagonal and diagonal (2, rows)."""
        runs, rho = self.runs, self.rho
        scale = 1.0 / (1.0 - rho * rho)
        ends = (runs.place == 0).astype(float) + (runs.place == np.repeat(runs.length, runs.length) - 1)
        diagonal = scale * (1.0 + rho * rho - rho * rho * ends)
        diagonal[ends == 2.0] = 1.0
        beside = np.where(runs.place == 0, 0.0, -rho * scale)
        return (
            np.array([beside, diagonal]) if self.b == 0.0 else np.array([self.b * beside, self.a + self.b * diagonal])
        )

    def _rows_alone(self, columns: Array) -> Array:
        """Without offset, drift and gain."""
        return self._filtered(columns / self.sd[:, None]) / self.sd[:, None]

    def _filtered(self, columns: Array) -> Array:
        if self.a == 0.0:
            return columns
        if self.b == 0.0:
            above, diagonal = self.bands[0, 1:, None], self.bands[1][:, None]
            found = diagonal * columns
            found[:-1] += above * columns[1:]
            found[1:] += above * columns[:-1]
            return np.asarray(found / self.a)
        return np.asarray((columns - self.a * solveh_banded(self.bands, columns)) / self.b)

    def _diagonal(self) -> Array:
        if self.a == 0.0:
            return np.ones(self.runs.rows)
        if self.b == 0.0:
            return np.asarray(self.bands[1] / self.a)
        runs = self.runs
        scale = 1.0 / (1.0 - self.rho**2)
        squared = (self.b * self.rho * scale) ** 2
        # what elimination from one end takes off a diagonal entry, by its place; from the other end it is the same
        taken = np.zeros(int(runs.length.max()))
        pivot = self.a + self.b * scale
        for place in range(1, len(taken)):
            taken[place] = squared / pivot
            if place > 1 and abs(taken[place] - taken[place - 1]) < SETTLED * taken[place]:
                taken[place:] = taken[place]
                break
            pivot = self.a + self.b * scale * (1.0 + self.rho**2) - taken[place]
        behind = np.repeat(runs.length, runs.length) - 1 - runs.place
        inverse = 1.0 / (self.bands[1] - taken[runs.place] - taken[behind])
        return np.asarray((1.0 - self.a * inverse) / self.b)
