"""How well a set of effects explains the measurements: the marginal likelihood under noise correlated within runs.

A hypothesis is a linear model around a fit: residual = base columns * (anything) + effect columns * coefficients +
AR(1) noise. The base parameters are integrated over all values, the coefficients over a normal prior whose width (in
noise sd of the effect's rms) is itself spread over a grid, the correlation over a grid, and the noise sd over all
values where the case does not give it. What is left is one number a hypothesis. It falls with every needless
parameter, and by the chain rule it is the likelihood of the training runs times that of the held-out runs predicted
from them.

Sources: MacKay, Information Theory, Inference, and Learning Algorithms (2003), ch. 28; Harville (1974) for the
restricted likelihood that integrating over the base parameters gives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import log_ndtr, logsumexp

from terrapin_tools.workbench.noise.ar1 import RHO_GRID, Ar1, orthonormal

__all__ = ["SIZES", "Evidence", "Gram"]

Array = npt.NDArray[np.float64]

SIZES = np.array([0.3, 1.0, 3.0, 10.0, 40.0])  # prior widths of an effect's rms [noise sd], equal shares; by hand
UNCORRELATED = 0.4  # prior probability of independent rows, the rest spread over the grid; chosen by hand
CHUNK = 1024  # columns that are handled at once; bounds the memory


@dataclass(frozen=True)
class Gram:
    """Columns beyond the base, at each correlation: inner products with each other and with the residual."""

    products: Array  # (rho, D, D)
    scores: Array  # (rho, D)


class Evidence:
    """Marginal likelihoods of hypotheses around one fit.

    Parameters
    ----------
    ar1 : correlation of the rows within runs.
    residual : (channels, rows), measured minus predicted, in noise sd.
    base : (channels, rows, parameters), derivatives of the prediction, in noise sd.
    known : whether the noise sd is given; else it is integrated over (one factor for all channels).
    """

    def __init__(self, ar1: Ar1, residual: Array, base: Array, known: bool) -> None:
        self.ar1, self.known = ar1, known
        self.channels, self.rows = residual.shape
        flat = base.reshape(self.channels * self.rows, -1)
        scale = np.sqrt((flat * flat).sum(axis=0))
        self.flat = flat[:, scale > 0]
        self.residual = residual.reshape(-1)
        self.rho = np.array(RHO_GRID)
        self.basis: list[Array] = []
        self.white: list[Array] = []
        total, start = [], []
        for rho in self.rho:
            columns = self._whiten(self.flat, rho)
            basis = orthonormal(columns)
            white = self._whiten(self.residual[:, None], rho)[:, 0]
            white = white - basis @ (basis.T @ white)
            # |X' V^-1 X| over that at rho = 0: the scale of the base parameters cancels between hypotheses
            sign, log_design = np.linalg.slogdet(columns.T @ columns / np.outer(scale[scale > 0], scale[scale > 0]))
            self.basis.append(basis)
            self.white.append(white)
            total.append(float(white @ white))
            start.append(-0.5 * (self.channels * ar1.log_determinant(rho) + (log_design if sign > 0 else 0.0)))
        self.total = np.array(total)
        self.freedom = self.channels * self.rows - self.flat.shape[1]
        self.start = np.array(start) + self.log_prior()

    def _whiten(self, columns: Array, rho: float) -> Array:
        split = columns.reshape(self.channels, self.rows, -1)
        return np.concatenate([self.ar1.whiten(split[c], rho) for c in range(self.channels)])

    def whitened(self, ordered: Array, rho: float) -> Array:
        """As the whitening of `project`, of columns that are sorted by run already."""
        if rho == 0.0:
            return ordered
        white = ordered.copy()
        white[1:] = (ordered[1:] - rho * ordered[:-1]) / np.sqrt(1.0 - rho * rho)
        first = np.tile(self.ar1.first, self.channels)
        white[first] = ordered[first]
        return white

    def fit_term(self, squares: Array) -> Array:
        logs = -0.5 * squares if self.known else -0.5 * self.freedom * np.log(np.maximum(squares, 1e-300))
        return np.asarray(logs)

    @staticmethod
    def log_prior() -> Array:
        """Log prior probability of each correlation of RHO_GRID."""
        rho = np.array(RHO_GRID)
        return np.asarray(np.log(np.where(rho == 0.0, UNCORRELATED, (1.0 - UNCORRELATED) / (len(rho) - 1))))

    @property
    def nothing(self) -> float:
        """Log evidence of "nothing is missing"."""
        return float(logsumexp(self.start + self.fit_term(self.total)))

    def project(self, columns: Array, index: int) -> Array:
        """Columns (channels * rows, D) whitened at RHO_GRID[index], freed of what the base can take up."""
        white = self._whiten(columns, self.rho[index])
        return np.asarray(white - self.basis[index] @ (self.basis[index].T @ white))

    def distance(self, gap: Array, slopes: Array, rho: float) -> float:
        """Squared length of `gap` (channels, rows) beyond `slopes` (channels, rows, P), at a correlation."""
        white = self._whiten(gap.reshape(-1, 1), rho)[:, 0]
        basis = orthonormal(self._whiten(slopes.reshape(gap.size, -1), rho))
        left = white - basis @ (basis.T @ white)
        return float(left @ left)

    def gram(self, columns: Array) -> Gram:
        products, scores = [], []
        for index in range(len(self.rho)):
            free = self.project(columns, index)
            products.append(free.T @ free)
            scores.append(free.T @ self.white[index])
        return Gram(np.array(products), np.array(scores))

    def single(self, columns: Array) -> Array:
        """Log evidence of each column (channels * rows, D) alone, size free in sign: (D,)."""
        found = []
        for begin in range(0, columns.shape[1], CHUNK):
            norms, scores = self._free(columns[:, begin : begin + CHUNK])
            variance = SIZES[:, None, None] ** 2
            shrink = 1.0 + variance * norms
            gain = variance * scores**2 / shrink
            logs = self.start[:, None] + self.fit_term(self.total[:, None] - gain) - 0.5 * np.log(shrink)
            found.append(logsumexp(logs, axis=(0, 1)) - np.log(len(SIZES)))
        return np.concatenate(found) if found else np.zeros(0)

    def _free(self, columns: Array) -> tuple[Array, Array]:
        """Squared length of each column beyond the base, and its product with the residual: (rho, D) each.

        Whitened products at any correlation follow from four sums (of first rows, of later rows, of their predecessors,
        of neighbours), so thousands of columns are gone through once, not once for each correlation.
        """
        scaled = self.flat / np.sqrt((self.flat * self.flat).sum(axis=0))
        x, y = self._by_run(columns), self._by_run(np.column_stack([scaled, self.residual]))
        first = np.tile(self.ar1.first, self.channels)
        later = np.flatnonzero(~first)
        xf, xl, xp = x[first], x[later], x[later - 1]
        yf, yl, yp = y[first], y[later], y[later - 1]
        own = [(a * b).sum(axis=0) for a, b in ((xf, xf), (xl, xl), (xp, xp), (xl, xp))]
        cross = [xf.T @ yf, xl.T @ yl, xp.T @ yp, xl.T @ yp + xp.T @ yl]
        norms = np.empty((len(self.rho), columns.shape[1]))
        scores = np.empty_like(norms)
        for index, rho in enumerate(self.rho):
            scale = 1.0 - rho * rho
            norm = own[0] + (own[1] + rho * rho * own[2] - 2.0 * rho * own[3]) / scale
            product = cross[0] + (cross[1] + rho * rho * cross[2] - rho * cross[3]) / scale
            base = self._whiten(scaled, rho)
            # base = basis @ triangle, so that products with the basis follow from those with the base
            triangle = self.basis[index].T @ base
            inside = product[:, :-1] @ np.linalg.pinv(triangle)
            white = self._whiten(self.residual[:, None], rho)[:, 0]
            norms[index] = np.maximum(norm - (inside * inside).sum(axis=1), 0.0)
            scores[index] = product[:, -1] - inside @ (self.basis[index].T @ white)
        return norms, scores

    def _by_run(self, columns: Array) -> Array:
        """Columns (channels * rows, D) in the order in which they are whitened."""
        split = columns.reshape(self.channels, self.rows, -1)
        return split[:, self.ar1.order].reshape(self.channels * self.rows, -1)

    def blocks(self, gram: Gram, picks: npt.NDArray[np.int64], signs: Array, offset: Array | None = None) -> Array:
        """Log evidence of sets of columns, all picked from one Gram: (sets,).

        `picks` (sets, d) indices into its columns; `signs` (sets, d): 1 where a coefficient cannot be negative, -1
        where it cannot be positive, 0 where it is free. `offset` (D,): the residual was taken at these coefficients.
        """
        count = picks.shape[1]
        a = gram.products[:, picks[:, :, None], picks[:, None, :]]  # (rho, sets, d, d)
        scores, totals = gram.scores, self.total[:, None]
        if offset is not None:  # the residual at coefficients 0 is that at `offset` plus columns * offset
            moved = np.einsum("rij,j->ri", gram.products, offset)
            totals = totals + (2.0 * gram.scores @ offset + moved @ offset)[:, None]
            scores = gram.scores + moved
        b = scores[:, picks]
        best = np.full((len(SIZES), *b.shape[:2]), -np.inf)
        for i, size in enumerate(SIZES):
            inner = np.eye(count) + size * size * a
            solved = np.linalg.solve(inner, b[..., None])[..., 0] * size * size
            gain = (b * solved).sum(axis=-1)
            logs = self.fit_term(totals - gain) - 0.5 * np.linalg.slogdet(inner)[1]
            if np.any(signs):
                spread = size * np.sqrt(np.maximum(np.diagonal(np.linalg.inv(inner), axis1=-2, axis2=-1), 1e-300))
                inside = np.log(2.0) + log_ndtr(signs * solved / spread)
                logs = logs + np.where(signs != 0, inside, 0.0).sum(axis=-1)
            best[i] = logs
        logs = best + self.start[:, None]
        return np.asarray(logsumexp(logs, axis=(0, 1)) - np.log(len(SIZES)))
