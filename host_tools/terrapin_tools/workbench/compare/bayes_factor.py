"""How much likelier the residuals are if something is missing than if nothing is: one number for a whole data set.

Every alternative (an effect of the catalogue at one shape, shapes of one column, an offset of one run, more noise than
stated) gets its marginal likelihood under AR(1) noise (Evidence): its size, the correlation and, where it is not
given, the noise sd are integrated over *under that alternative*. A missing effect makes the noise look larger and more
correlated than it is; a test that estimates both before it looks for the effect hides it. Alternatives are averaged
with prior weights, so many unlikely shapes cost the likely ones little. The logarithm of the average's ratio to the
likelihood of "nothing" is the statistic; its distribution when nothing is missing hardly depends on the correlation.

Sources: Good (1957) and Berger & Delampady (1987) for the Bayes factor as a test statistic; for the rest see
marginal_likelihood.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from terrapin_tools.workbench.model.data_columns import Shapes
from terrapin_tools.workbench.model.effect_columns import Shape
from terrapin_tools.workbench.noise.ar1 import Ar1
from terrapin_tools.workbench.noise.lagged_sums import Lagged
from terrapin_tools.workbench.noise.marginal_likelihood import SIZES, Evidence

__all__ = ["BayesFactor", "Block", "blocks_of"]

Array = npt.NDArray[np.float64]

# Prior of each family, given that one is true. Chosen by hand; docs/discovery.md states them.
WEIGHT = {"catalogue": 0.6, "column": 0.3, "run": 0.06, "scale": 0.04}
SCALES = np.array([1.1, 1.25, 1.5, 2.0, 4.0])  # true noise sd over the stated one, in family "scale"; by hand


@dataclass(frozen=True)
class Block:
    """One alternative: columns (channels * rows, count) in noise sd of unit size, and its share of the family."""

    family: str
    columns: Array
    share: float


def blocks_of(
    effects: Mapping[str, Sequence[Shape]], shapes: Mapping[str, Shapes], run: npt.NDArray[np.int64], channels: int
) -> list[Block]:
    """The alternatives on these rows. Each effect, column and run has the same share of its family.

    Parameters
    ----------
    effects : for each effect its shapes, with columns (channels * rows, count) in noise sd.
    shapes : for each column of the data its smooth shapes (count, rows).
    run : (rows,), the run of each row.
    channels : number of channels.
    """
    rows = len(run)
    found: list[Block] = []
    present = [listed for listed in effects.values() if listed]
    for listed in present:
        found += [Block("catalogue", shape.columns, 1.0 / len(present) / len(listed)) for shape in listed]
    for shape in shapes.values():
        kinds = [*([shape.together] if len(shape.together) else []), *(one[None] for one in shape.singly)]
        for channel in range(channels):
            for kind in kinds:
                block = np.zeros((channels, rows, len(kind)))
                block[channel] = kind.T
                share = 1.0 / len(shapes) / channels / len(kinds)
                found.append(Block("column", block.reshape(channels * rows, -1), share))
    runs = np.unique(run)
    for one in runs if len(runs) > 2 else ():
        for channel in range(channels):
            offset = np.zeros((channels, rows, 1))
            offset[channel, run == one] = 1.0
            found.append(Block("run", offset.reshape(channels * rows, 1), 1.0 / len(runs) / channels))
    return found


class BayesFactor:
    """The statistic for any number of residual vectors on the same rows.

    Parameters
    ----------
    ar1 : correlation of the rows within runs.
    base : (channels, rows, parameters), derivatives of the prediction, in noise sd.
    known : whether the noise sd is given; else it is integrated over.
    blocks : the alternatives, from `blocks_of`.
    """

    def __init__(self, ar1: Ar1, base: Array, known: bool, blocks: Sequence[Block]) -> None:
        channels, rows, _ = base.shape
        self.evidence = Evidence(ar1, np.zeros((channels, rows)), base, known)
        self.weight = np.log([WEIGHT[block.family] * block.share for block in blocks])
        width = [block.columns.shape[1] for block in blocks]
        self.edges = np.concatenate([[0], np.cumsum(width)[:-1]]).astype(int)
        columns = np.concatenate([np.zeros((channels * rows, 0)), *(block.columns for block in blocks)], axis=1)
        flat = self.evidence.flat
        self.ar1, self.channels = ar1, channels
        self.base = Lagged(ar1, channels, flat / np.sqrt((flat * flat).sum(axis=0)))
        self.columns = Lagged(ar1, channels, columns)
        crossed, own = self.base.with_each(self.columns), self.columns.squares()
        several = [(begin, count) for begin, count in zip(self.edges, width, strict=True) if count > 1]
        parts = [self.columns.part(begin, count) for begin, count in several]
        within = [part.with_each(part) for part in parts]
        # by correlation: what maps products with the base to those with its orthonormal basis, the columns' share in
        # that basis, rotations that make each block orthogonal (so sizes shrink one at a time), and squared lengths
        self.inward: list[Array] = []
        self.shared: list[Array] = []
        self.turns: list[list[tuple[slice, Array]]] = []
        self.squares: list[Array] = []
        for index, rho in enumerate(self.evidence.rho):
            basis = self.evidence.basis[index]
            inward = np.asarray(np.linalg.pinv(basis.T @ self.evidence.whitened(self.base.columns, rho)).T, float)
            shared = inward @ crossed.at(rho)
            squares = np.maximum(own.at(rho) - (shared * shared).sum(axis=0), 0.0)
            turns: list[tuple[slice, Array]] = []
            for (begin, count), sums in zip(several, within, strict=True):
                part = slice(int(begin), int(begin) + count)
                values, vectors = np.linalg.eigh(sums.at(rho) - shared[:, part].T @ shared[:, part])
                squares[part] = np.maximum(values, 0.0)
                turns.append((part, vectors))
            self.inward.append(inward)
            self.shared.append(shared)
            self.turns.append(turns)
            self.squares.append(squares)

    def __call__(self, residuals: Array) -> tuple[Array, Array]:
        """Log Bayes factors of residuals, and the posterior of the correlation if nothing is missing.

        Parameters
        ----------
        residuals : (channels * rows, sets), in noise sd.

        Returns
        -------
        (sets,) : log Bayes factor of "something is missing" against "nothing".
        (grid, sets) : posterior of each correlation of RHO_GRID.
        """
        evidence, sets = self.evidence, residuals.shape[1]
        drawn = Lagged(self.ar1, self.channels, residuals)
        own, with_base, with_columns = drawn.squares(), self.base.with_each(drawn), self.columns.with_each(drawn)
        grid = len(evidence.rho)
        null = np.empty((grid, sets))
        parts = np.empty((grid, sets))
        for index in range(grid):
            rho = evidence.rho[index]
            taken = self.inward[index] @ with_base.at(rho)
            total = np.maximum(own.at(rho) - (taken * taken).sum(axis=0), 1e-300)
            null[index] = evidence.start[index] + evidence.fit_term(total)
            scores = with_columns.at(rho) - self.shared[index].T @ taken
            for part, vectors in self.turns[index]:
                scores[part] = vectors.T @ scores[part]
            scores *= scores
            logs = np.empty((len(SIZES), len(self.weight), sets))
            for place, variance in enumerate(SIZES**2):
                shrink = 1.0 + variance * self.squares[index]
                gain = np.add.reduceat(scores * (variance / shrink)[:, None], self.edges, axis=0)
                price = 0.5 * np.add.reduceat(np.log(shrink), self.edges)
                logs[place] = evidence.fit_term(total - gain) + (self.weight - price)[:, None]
            top = logs.max(axis=(0, 1))
            parts[index] = evidence.start[index] + top + np.log(np.exp(logs - top).sum(axis=(0, 1)) / len(SIZES))
            if evidence.known:
                noisier = -0.5 * total / SCALES[:, None] ** 2 - evidence.freedom * np.log(SCALES)[:, None]
                weight = np.log(WEIGHT["scale"] / len(SCALES))
                parts[index] = np.logaddexp(parts[index], evidence.start[index] + weight + logsumexp(noisier, axis=0))
        nothing = logsumexp(null, axis=0)
        return logsumexp(parts, axis=0) - nothing, np.exp(null - nothing)
