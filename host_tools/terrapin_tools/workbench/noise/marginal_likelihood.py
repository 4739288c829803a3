"""How well a set of effects explains the measurements: the marginal likelihood under the noise of real rigs.

A hypothesis is a linear model around a fit: residual = base columns * (anything) + effect columns * coefficients +
noise. The base parameters are integrated over all values, the coefficients over a normal prior whose width (in noise sd
of the effect's rms) is itself spread over a grid, the kind of noise over the nodes of covariance.py. The noise sd is
integrated over all values where the case does not state it; where it does, the statement counts as an estimate with
STATED degrees of freedom, because nobody knows an sd better than that. What is left is one number a hypothesis. It
falls with every needless parameter, and by the chain rule it is the likelihood of the training runs times that of the
held-out runs predicted from them.

Sources: MacKay, Information Theory, Inference, and Learning Algorithms (2003), ch. 28; Harville (1974) for the
restricted likelihood that integrating over the base parameters gives.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from terrapin_hil.arrays import Array, Index
from terrapin_tools.workbench.noise.covariance import Filtered, Runs, orthonormal
from terrapin_tools.workbench.noise.kinds import NODES, PLAIN, Kind, Node, by_filter, considered
from terrapin_tools.workbench.noise.log_sums import logsumexp

__all__ = ["SIZES", "STATED", "Evidence", "Gram"]

# Prior widths of an effect's rms [noise sd], equal shares. Up to 160: at 40 two large effects that are both true paid
# more than one that is not.
SIZES = np.array([0.3, 1.0, 3.0, 10.0, 40.0, 160.0])
STATED = 15.0  # degrees of freedom of an sd that a user states: it is right to 18 %
CHUNK = 1024  # columns that are handled at once; bounds the memory
LIKELY = 1e-3  # posterior, under nothing or any one column, from which a kind of noise is weighed further; by hand
FREE = np.zeros(0)  # no parameter stands at a bound
ROUNDING = 1e-11  # share of a column beyond the base, below which it is the base's


@dataclass(frozen=True)
class Gram:
    """Columns beyond the base, at each kind of noise: inner products with each other and with the residual."""

    products: Array  # (nodes, D, D)
    scores: Array  # (nodes, D)
    moves: Array  # (nodes, B, D), what each changes at the bounded parameters of the base


class Evidence:
    """Marginal likelihoods of hypotheses around one fit.

    Parameters
    ----------
    runs : the rows, of as many channels as the residual has.
    residual : (channels, rows), measured minus predicted, in noise sd.
    base : (channels, rows, parameters), derivatives of the prediction, in noise sd.
    behind : degrees of freedom behind the noise sd: STATED where the case gives it, 0 where it is integrated over all
        values (one factor for all channels).
    nodes : kinds of noise that are weighed, places in NODES; all that so many channels may have when not given.
    bounds : of the first parameters, 1 where one stands at a bound below which it cannot go, -1 where it cannot go
        above, 0 where it is free, as all others are. Of the values that the data leave it those within count.
    """

    def __init__(
        self,
        runs: Runs,
        residual: Array,
        base: Array,
        behind: float,
        nodes: Collection[int] | None = None,
        bounds: Array = FREE,
    ) -> None:
        self.runs, self.behind = runs, behind
        self.channels, self.rows = residual.shape
        self.nodes = tuple(range(considered(self.channels)) if nodes is None else nodes)
        self.base, self.signs = base, bounds
        self.flat = orthonormal(base.reshape(self.channels * self.rows, -1))
        self.residual = residual.reshape(-1)
        count = self.flat.shape[1]
        self.freedom = self.channels * self.rows - count
        self.filters = by_filter(self.nodes)
        self.both: dict[Kind, Filtered] = {}  # columns of the base, and the residual
        inner = np.empty((len(self.nodes), count, count))
        cross = np.empty((len(self.nodes), count))
        square, start = np.empty(len(self.nodes)), np.empty(len(self.nodes))
        columns = np.column_stack([self.flat, self.residual])
        for kind, places in self.filters.items():
            self.both[kind] = both = runs.filtered(columns, kind)
            these = [self.node(place) for place in places]
            products = runs.products(both, both).each(these)
            inner[places], cross[places] = products[:, :count, :count], products[:, :count, count]
            square[places] = products[:, count, count]
            start[places] = [np.log(node.prior) - 0.5 * runs.log_determinant(node) for node in these]
        self.inverse = np.linalg.inv(inner)
        self.taken = np.einsum("nij,nj->ni", self.inverse, cross)  # the base's coefficients
        self.total = np.maximum(square - np.einsum("ni,ni->n", cross, self.taken), 1e-300)
        self.start = start - 0.5 * np.linalg.slogdet(inner)[1]
        self.bounds = _inward(base.reshape(len(self.flat), -1), bounds, self.flat)
        self.inward = self.taken @ self.bounds.T
        self.spread = np.einsum("bi,nij,bj->nb", self.bounds, self.inverse, self.bounds)

    def node(self, place: int) -> Node:
        return NODES[self.nodes[place]]

    def fit_term(self, squares: Array) -> Array:
        """Log likelihood of whitened sums of squares, the sd integrated over."""
        if self.behind:
            return np.asarray(-0.5 * (self.behind + self.freedom) * np.log(self.behind + squares))
        return np.asarray(-0.5 * self.freedom * np.log(np.maximum(squares, 1e-300)))

    def _within(self, inward: Array, spread: Array, squares: Array) -> Array:
        """Log probability that the bounded parameters (..., B) are within, with these means and variances, in noise sd,
        where the whitened sum of squares is `squares` (...,): the sd is integrated over, so it is Student's t, here as
        a normal variate (Wallace, Annals of Mathematical Statistics 30, 1959)."""
        freedom = self.behind + self.freedom
        far = (
            inward
            * inward
            / np.maximum(spread, 1e-300)
            / np.maximum((self.behind + squares) / freedom, 1e-300)[..., None]
        )
        return np.asarray(log_ndtr(np.sign(inward) * np.sqrt(freedom * np.log1p(far / freedom))).sum(axis=-1))

    @property
    def _each(self) -> Array:
        """Log evidence of "nothing is missing" in each kind of noise: (nodes,)."""
        within = self._within(self.inward, self.spread, self.total)
        return np.asarray(self.start + self.fit_term(self.total) + within)

    @property
    def nothing(self) -> float:
        """Log evidence of "nothing is missing"."""
        return float(logsumexp(self._each))

    @property
    def posterior(self) -> Array:
        """Of each kind of noise, if nothing is missing: (nodes,)."""
        logs = self._each
        return np.asarray(np.exp(logs - logsumexp(logs)))

    def likeliest(self) -> tuple[Node, float]:
        """The kind of noise that is likeliest if nothing is missing, and the sd of a row in it."""
        place = int(np.argmax(self._each))
        return self.node(place), float(
            np.sqrt((self.behind + self.total[place]) / max(self.behind + self.freedom, 1.0))
        )

    def of_few(self) -> Evidence:
        """The same with two kinds of noise: white, and the likeliest one if nothing is missing."""
        best = self.nodes[int(np.argmax(self.posterior))]
        shape = (self.channels, self.rows)
        return Evidence(self.runs, self.residual.reshape(shape), self.base, self.behind, sorted({0, best}), self.signs)

    def among(self, columns: Array) -> tuple[int, ...]:
        """Kinds of noise (places in NODES) that are likely if nothing is missing, or any one of columns
        (channels * rows, D), and those in which runs are alike."""
        norms, scores, _ = self._free(columns)
        gain = (scores**2 / np.maximum(norms, 1e-300)) if columns.shape[1] else np.zeros((len(self.nodes), 0))
        logs = self.start[:, None] + self.fit_term(self.total[:, None] - np.column_stack([np.zeros(len(gain)), gain]))
        share = np.exp(logs - logsumexp(logs, axis=0)).max(axis=1)
        plain = np.isin(self.nodes, PLAIN)
        return tuple(np.array(self.nodes)[(share > LIKELY) | plain].tolist())

    def whitened(self, columns: Array, node: Node) -> Array:
        """Columns (channels * rows, D) whitened in one kind of noise, freed of what the base can take up."""
        basis = orthonormal(self.runs.whiten(self.flat, node))
        white = self.runs.whiten(columns, node)
        return np.asarray(white - basis @ (basis.T @ white))

    def distance(self, gap: Array, slopes: Array, node: Node) -> float:
        """Squared length of `gap` (channels, rows) beyond `slopes` (channels, rows, P), in one kind of noise."""
        white = self.runs.whiten(gap.reshape(-1, 1), node)[:, 0]
        basis = orthonormal(self.runs.whiten(slopes.reshape(gap.size, -1), node))
        left = white - basis @ (basis.T @ white)
        return float(left @ left)

    def gram(self, columns: Array) -> Gram:
        """Products of columns (channels * rows, D) with each other and the residual, beyond the base."""
        count = columns.shape[1]
        products, scores = np.empty((len(self.nodes), count, count)), np.empty((len(self.nodes), count))
        moves = np.empty((len(self.nodes), len(self.bounds), count))
        for kind, places in self.filters.items():
            white, nodes = self.runs.filtered(columns, kind), [self.node(place) for place in places]
            shared, score = self._shared(kind, white, nodes)
            own = self.runs.products(white, white).each(nodes)
            products[places] = own - np.swapaxes(shared, 1, 2) @ (self.inverse[places] @ shared)
            scores[places] = score - np.einsum("ni,nij->nj", self.taken[places], shared)
            moves[places] = self.bounds @ self.inverse[places] @ shared
        return Gram(products, scores, moves)

    def _shared(self, kind: Kind, white: Filtered, nodes: Sequence[Node]) -> tuple[Array, Array]:
        """Products of filtered columns with the base (nodes, parameters, D), and with the residual (nodes, D)."""
        found = self.runs.products(self.both[kind], white).each(nodes)
        return found[:, :-1], found[:, -1]

    def _free(self, columns: Array) -> tuple[Array, Array, Array]:
        """Squared length of each column (channels * rows, D) beyond the base, its product with the residual, and what
        it changes at the bounded parameters of the base (nodes, B, D)."""
        count = columns.shape[1]
        norms, scores = np.empty((len(self.nodes), count)), np.empty((len(self.nodes), count))
        moves = np.empty((len(self.nodes), len(self.bounds), count))
        for kind, places in self.filters.items():
            for begin in range(0, count, CHUNK):
                part = slice(begin, min(begin + CHUNK, count))
                white, nodes = self.runs.filtered(columns[:, part], kind), [self.node(place) for place in places]
                shared, score = self._shared(kind, white, nodes)
                whole = self.runs.squares(white, nodes)
                norm = whole - np.einsum("nij,nij->nj", shared, self.inverse[places] @ shared)
                score = score - np.einsum("ni,nij->nj", self.taken[places], shared)
                visible = norm > ROUNDING * whole
                norms[places, part], scores[places, part] = np.where(visible, norm, 0.0), np.where(visible, score, 0.0)
                moves[places, :, part] = self.bounds @ self.inverse[places] @ shared
        return norms, scores, moves

    def single(self, columns: Array) -> Array:
        """Log evidence of each column (channels * rows, D) alone, size free in sign: (D,)."""
        norms, scores, moves = self._free(columns)
        moves = np.swapaxes(moves, 1, 2)
        found = np.full(columns.shape[1], -np.inf)
        for size in SIZES:
            shrink = 1.0 + size * size * norms
            gain = size * size * scores**2 / shrink
            left, mean = self.total[:, None] - gain, (size * size * scores / shrink)[..., None]
            spread = self.spread[:, None] + moves**2 * (size * size / shrink)[..., None]
            logs = self.start[:, None] + self.fit_term(left) - 0.5 * np.log(shrink)
            logs += self._within(self.inward[:, None] - moves * mean, spread, left)
            found = np.logaddexp(found, logsumexp(logs, axis=0))
        return np.asarray(found - np.log(len(SIZES)))

    def pairs(self, gram: Gram, first: Index, second: Index, signs: Array | None = None) -> Array:
        """Log evidence of pairs of single columns of one Gram: (pairs,); `signs` (pairs, 2) as of `blocks`."""
        if len(self.bounds):  # which has no form as short
            picks = np.column_stack([first, second])
            free = np.zeros(picks.shape) if signs is None else signs
            cuts = range(CHUNK, len(picks), CHUNK)
            parts = zip(np.split(picks, cuts), np.split(free, cuts), strict=True)
            return np.concatenate([self.blocks(gram, own, sign) for own, sign in parts])
        bounded = np.flatnonzero(np.any(signs, axis=1)) if signs is not None else np.zeros(0, dtype=int)
        found = np.full(len(first), -np.inf)
        for place in range(len(self.nodes)):
            own, scores = np.diagonal(gram.products[place]), gram.scores[place]
            a, c, b = own[first], own[second], gram.products[place][first, second]
            x, y = scores[first], scores[second]
            for size in SIZES:
                v = size * size
                p, q, o = 1.0 + v * a, 1.0 + v * c, v * b
                det = np.maximum(p * q - o * o, 1e-300)
                gain = v * (q * x * x - 2.0 * o * x * y + p * y * y) / det
                logs = self.start[place] + self.fit_term(np.maximum(self.total[place] - gain, 1e-300))
                if bounded.size and signs is not None:
                    for k, (mean, spread) in enumerate(((q * x - o * y, q), (p * y - o * x, p))):
                        at = mean[bounded] * np.sqrt(v / (spread[bounded] * det[bounded]))
                        side = signs[bounded, k]
                        logs[bounded] += np.where(side != 0, np.log(2.0) + log_ndtr(side * at), 0.0)
                found = np.logaddexp(found, logs - 0.5 * np.log(det))
        return np.asarray(found - np.log(len(SIZES)))

    def blocks(self, gram: Gram, picks: Index, signs: Array, offset: Array | None = None) -> Array:
        """Log evidence of sets of columns, all picked from one Gram: (sets,).

        `picks` (sets, d) indices into its columns; `signs` (sets, d): 1 where a coefficient cannot be negative, -1
        where it cannot be positive, 0 where it is free. `offset` (D,): the residual was taken at these coefficients.
        """
        count = picks.shape[1]
        a = gram.products[:, picks[:, :, None], picks[:, None, :]]  # (nodes, sets, d, d)
        scores, totals = gram.scores, self.total[:, None]
        moves, inward = gram.moves[:, :, picks].transpose(0, 2, 3, 1), self.inward[:, None]
        if offset is not None:  # the residual at coefficients 0 is that at `offset` plus columns * offset
            moved = np.einsum("rij,j->ri", gram.products, offset)
            totals = totals + (2.0 * gram.scores @ offset + moved @ offset)[:, None]
            scores, inward = gram.scores + moved, inward + (gram.moves @ offset)[:, None]
        b = scores[:, picks]
        best = np.full((len(SIZES), *b.shape[:2]), -np.inf)
        for i, size in enumerate(SIZES):
            inner = np.eye(count) + size * size * a
            solved = np.linalg.solve(inner, b[..., None])[..., 0] * size * size
            gain = (b * solved).sum(axis=-1)
            left = np.maximum(totals - gain, 1e-300)
            logs = self.fit_term(left) - 0.5 * np.linalg.slogdet(inner)[1]
            if len(self.bounds):
                mean = inward - np.einsum("nsd,nsdb->nsb", solved, moves)
                own = size * size * (moves * np.linalg.solve(inner, moves)).sum(axis=2)
                logs = logs + self._within(mean, self.spread[:, None] + own, left)
            if np.any(signs):
                spread = size * np.sqrt(np.maximum(np.diagonal(np.linalg.inv(inner), axis1=-2, axis2=-1), 1e-300))
                inside = np.log(2.0) + log_ndtr(signs * solved / spread)
                logs = logs + np.where(signs != 0, inside, 0.0).sum(axis=-1)
            best[i] = logs
        logs = best + self.start[:, None]
        return np.asarray(logsumexp(logs, axis=(0, 1)) - np.log(len(SIZES)))


def _inward(columns: Array, bounds: Array, flat: Array) -> Array:
    """What an orthonormal basis of the columns (rows, parameters) adds to each parameter that stands at a bound, away
    from it: (B, count)."""
    norm = np.linalg.norm(columns, axis=0)
    at = np.flatnonzero(bounds) if bounds.any() else np.zeros(0, dtype=int)
    at = at[norm[at] > 0.0]
    if not len(at):
        return np.zeros((0, flat.shape[1]))
    inverse = np.linalg.pinv(np.where(norm > 0.0, columns / np.maximum(norm, 1e-300), 0.0))
    return np.asarray(bounds[at, None] * (inverse[at] @ flat))
