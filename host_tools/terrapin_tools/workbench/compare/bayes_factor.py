"""How much likelier the residuals are if something is missing than if nothing is: one number for a whole data set.

Every alternative (an effect of the catalogue at one shape, shapes of one column, a mishap of the test: mishaps.py)
gets its marginal likelihood (Evidence): its size, the kind of noise and the noise sd are integrated over *under that
alternative*. A missing effect makes the noise look larger and more correlated than it is; a test that estimates
both before it looks for the effect hides it. The sd is always integrated over all values, so that no error in a stated
one can move the statistic: noise that is larger than stated is a finding of its own, not a missing effect. Alternatives
are averaged with prior weights, so many unlikely shapes cost the likely ones little. The logarithm of the average's
ratio to the likelihood of "nothing" is the statistic.

Sources: Good (1957) and Berger & Delampady (1987) for the Bayes factor as a test statistic; for the rest see
marginal_likelihood.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.model.data_columns import Shapes
from terrapin_tools.workbench.model.effect_columns import Shape
from terrapin_tools.workbench.model.priors import alternatives
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import SIZES, Evidence
from terrapin_tools.workbench.noise.mishaps import Mishap

__all__ = ["BayesFactor", "Block", "blocks_of"]

WEIGHT = alternatives()  # prior of each family, given that one is true


@dataclass(frozen=True)
class Block:
    """One alternative: columns (channels * rows, count) in noise sd of unit size, and its share of the family."""

    family: str
    columns: Array
    share: float


def blocks_of(
    effects: Mapping[str, Sequence[Shape]],
    shapes: Mapping[str, Shapes],
    runs: Runs,
    varying: Sequence[Array] = (),
    wrong: Sequence[Mishap] = (),
) -> list[Block]:
    """The alternatives on these rows. Each effect, column, mishap and varying parameter has the same share of its
    family.

    Parameters
    ----------
    effects : for each effect its shapes, with columns (channels * rows, count) in noise sd.
    shapes : for each column of the data its smooth shapes (count, rows).
    runs : the rows.
    varying : what it changes that a parameter goes with a column, (channels * rows, 1) each, in noise sd.
    wrong : what may have gone wrong on the rig.
    """
    channels, rows = runs.channels, runs.rows
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
    found += [Block("varying", columns, 1.0 / len(varying)) for columns in varying]
    for kind in {one.kind: None for one in wrong}:
        columns = [column for one in wrong if one.kind == kind for column in one.columns.T]
        found += [Block(kind, column[:, None], 1.0 / len(columns)) for column in columns]
    return found


class BayesFactor:
    """The statistic for any number of residual vectors on the same rows.

    Parameters
    ----------
    runs : the rows, of as many channels as there are.
    base : (channels, rows, parameters), derivatives of the prediction, in noise sd.
    blocks : the alternatives, from `blocks_of`.
    behind : degrees of freedom behind the noise sd; 0: it is integrated over all values.
    nodes : kinds of noise that are weighed, places in NODES; all of them when not given.
    """

    def __init__(
        self,
        runs: Runs,
        base: Array,
        blocks: Sequence[Block],
        behind: float = 0.0,
        nodes: Sequence[int] | None = None,
    ) -> None:
        channels, rows, _ = base.shape
        self.runs = runs
        self.evidence = Evidence(runs, np.zeros((channels, rows)), base, behind, nodes)
        self.weight = np.log([WEIGHT[block.family] * block.share for block in blocks])
        self.width = [block.columns.shape[1] for block in blocks]
        self.edges = np.concatenate([[0], np.cumsum(self.width)[:-1]]).astype(int)
        self.columns = np.concatenate([np.zeros((channels * rows, 0)), *(block.columns for block in blocks)], axis=1)

    def __call__(self, residuals: Array) -> tuple[Array, Array]:
        """Log Bayes factors of residuals, and the posterior of the kind of noise if nothing is missing.

        Parameters
        ----------
        residuals : (channels * rows, sets), in noise sd.

        Returns
        -------
        (sets,) : log Bayes factor of "something is missing" against "nothing".
        (nodes, sets) : posterior of each kind of noise.
        """
        null, parts = self.weigh(residuals)
        nothing = logsumexp(null, axis=0)
        return logsumexp(parts, axis=0) - nothing, np.exp(null - nothing)

    def weigh(self, residuals: Array) -> tuple[Array, Array]:
        """Log evidence of nothing, and of something, at each kind of noise: (nodes, sets) each."""
        evidence, runs = self.evidence, self.runs
        null = np.empty((len(evidence.nodes), residuals.shape[1]))
        parts = np.empty_like(null)
        for kind, places in evidence.filters.items():
            base, columns, drawn = (
                evidence.both[kind].only(slice(0, -1)),
                runs.filtered(self.columns, kind),
                runs.filtered(residuals, kind),
            )
            among, crossed = runs.products(columns, columns), runs.products(base, columns)
            with_base, with_columns = runs.products(base, drawn), runs.products(columns, drawn)
            for place in places:
                node, inverse = evidence.node(place), evidence.inverse[place]
                shared, seen = crossed.at(node), with_base.at(node)
                total = np.maximum(runs.squares(drawn, (node,))[0] - (seen * (inverse @ seen)).sum(axis=0), 1e-300)
                null[place] = evidence.start[place] + evidence.fit_term(total)
                products = among.at(node) - shared.T @ inverse @ shared
                scores = with_columns.at(node) - shared.T @ (inverse @ seen)
                squares = np.maximum(np.diagonal(products), 0.0).copy()
                for begin, count in zip(self.edges, self.width, strict=True):
                    if count > 1:  # rotated, so that the columns of a block are orthogonal and shrink one at a time
                        part = slice(int(begin), int(begin) + count)
                        values, vectors = np.linalg.eigh(products[part, part])
                        squares[part], scores[part] = np.maximum(values, 0.0), vectors.T @ scores[part]
                parts[place] = evidence.start[place] + self._something(total, scores * scores, squares)
        return null, parts

    def _something(self, total: Array, scores: Array, squares: Array) -> Array:
        """Log likelihood, (sets,), averaged over alternatives and sizes, from squared scores (columns, sets)."""
        logs = np.empty((len(SIZES), len(self.weight), len(total)))
        for place, variance in enumerate(SIZES**2):
            shrink = 1.0 + variance * squares
            gain = np.add.reduceat(scores * (variance / shrink)[:, None], self.edges, axis=0)
            price = 0.5 * np.add.reduceat(np.log(shrink), self.edges)
            left = np.maximum(total - gain, 1e-300)
            logs[place] = self.evidence.fit_term(left) + (self.weight - price)[:, None]
        top = logs.max(axis=(0, 1))
        return np.asarray(top + np.log(np.exp(logs - top).sum(axis=(0, 1)) / len(SIZES)))
