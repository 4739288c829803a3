"""Rows that stand alone: far off what the other rows of their run say about them. A glitch does, an effect is shared by
neighbours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import stdtrit

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_tools.workbench.noise.covariance import Runs, orthonormal
from terrapin_tools.workbench.noise.kinds import NODES, Node
from terrapin_tools.workbench.noise.marginal_likelihood import STATED
from terrapin_tools.workbench.noise.precision import Precision
from terrapin_tools.workbench.noise.restricted import restricted_likelihood

__all__ = ["ODD_SHARE", "farthest", "gathered", "odd_limit", "odd_rows", "standing_alone"]

ODD = 0.01  # false alarm rate of "a row of this case stands alone"; chosen by hand
ODD_SHARE = 0.05  # of the rows that may stand alone at most: more are no exception
ODD_MOST = 300  # rows, for time: more are no exception either
FEWEST = 20  # rows of which one may stand alone; chosen by hand
TOGETHER = 1e-3  # chance of accidents to lie that close in any column, below which they are none: as rare as is usual
GROWS = np.array([node.grow > 0.0 for node in NODES])


def odd_limit(rows: int) -> int:
    """Rows that may stand alone at most: two of twenty, and a twentieth of more than forty."""
    return max(int(ODD_SHARE * rows), 2 if rows >= FEWEST else 0)


def farthest(residual: Array, rows: Mask) -> Array:
    """Of each row what the channel says that is farthest off: (all rows,) from residuals (channels, rows) in their own
    sd; 0 outside `rows` (all rows,)."""
    found = np.zeros(len(rows))
    found[rows] = np.take_along_axis(residual, np.abs(residual).argmax(axis=0)[None], axis=0)[0]
    return found


def gathered(odd: Mask, residual: Array, run: Index, columns: Mapping[str, Array], looked_at: Mask) -> bool:
    """Whether rows that stand alone lie together in a column: then something happens there, and they are no accidents.

    Of rows that follow each other one counts, for a glitch may last. Of n such rows all lie in a share w of the rows,
    ordered by the column, with a chance of at most n w^(n-1), and all on one side of the model with 2^(1-n); so many
    columns are looked at. Runs: (rows,) numbers; odd, looked_at, residual (as of `farthest`): (rows,).
    """
    order = np.argsort(run, kind="stable")
    lasts = np.zeros_like(odd)
    lasts[order[1:]] = odd[order[:-1]] & (np.diff(run[order]) == 0)
    few = np.flatnonzero(odd & ~lasts)
    if len(few) < 3:
        return False
    shares = [
        np.mean((values[looked_at] >= values[few].min()) & (values[looked_at] <= values[few].max()))
        for values in columns.values()
        if np.isfinite(values).all() and len(np.unique(values)) > 2  # in a group or not is no place
    ]
    aside = 0.5 if len(np.unique(np.sign(residual[few]))) == 1 else 1.0
    return bool(shares) and len(shares) * len(few) * (aside * min(shares)) ** (len(few) - 1) < TOGETHER


def standing_alone(
    runs: Sequence[Runs], residuals: Sequence[Array], bases: Sequence[Array], sigma: Sequence[float | None]
) -> Mask:
    """Rows (rows,) that stand alone in any channel, in the likeliest kind of noise.

    Glitches at large readings look like noise that grows with the reading: that is believed where it is the likeliest
    without them, too. For the parameters see `restricted_likelihood`.
    """
    criterion = restricted_likelihood(runs, residuals, bases, sigma)[0]
    grows = GROWS[: len(criterion)]
    calm = NODES[int(np.argmin(np.where(grows, np.inf, criterion)))]
    odd = _in_any(runs, residuals, bases, sigma, calm)
    if not (odd.any() and grows[np.argmin(criterion)]):
        return odd
    kept = [one.without(odd) for one in runs]
    left = [orthonormal(basis[~odd]) for basis in bases]
    again = restricted_likelihood(kept, [residual[~odd] for residual in residuals], left, sigma)[0]
    return _in_any(runs, residuals, bases, sigma, NODES[np.argmin(again)]) if grows[np.argmin(again)] else odd


def _in_any(
    runs: Sequence[Runs], residuals: Sequence[Array], bases: Sequence[Array], sigma: Sequence[float | None], node: Node
) -> Mask:
    nodes = [node.of(channel) for channel in range(len(runs))]
    each = zip(runs, residuals, bases, nodes, sigma, strict=True)
    return np.asarray(np.any([odd_rows(*one) for one in each], axis=0))


def odd_rows(runs: Runs, residual: Array, basis: Array, node: Node, sigma: float | None) -> Mask:
    """Rows (rows,) that stand alone: far off what the other rows of their run say about them.

    Each residual is judged given all others, externally studentised, against Student's t at ODD over all rows; the
    farthest first, again without it until none is left.

    Parameters
    ----------
    runs : the rows, of one channel.
    residual : (rows,), measured minus predicted.
    basis : (rows, count), orthonormal columns that were fitted.
    node : the likeliest kind of noise.
    sigma : the stated sd in the unit of the residual; None: there is none.
    """
    odd = np.zeros(runs.rows, dtype=bool)
    behind = STATED if sigma is not None else 0.0
    scaled = residual / (sigma if sigma is not None else max(float(np.sqrt(np.mean(residual**2))), 1e-150))
    precision = Precision(runs, node)
    x = basis[runs.order]
    weighed = precision.times(np.column_stack([x, scaled[runs.order]]))
    inner = np.linalg.inv(x.T @ weighed[:, :-1])
    # of P = V^-1 - V^-1 x (x' V^-1 x)^-1 x' V^-1: P times the residual, and its diagonal
    left = weighed[:, -1] - weighed[:, :-1] @ (inner @ (x.T @ weighed[:, -1]))
    own = precision.diagonal - np.einsum("ij,jk,ik->i", weighed[:, :-1], inner, weighed[:, :-1])
    total = float(scaled[runs.order] @ left)
    gone: list[Array] = []
    limit = min(odd_limit(runs.rows), ODD_MOST)
    for count in range(limit + 1):
        free = runs.rows - count - x.shape[1] + behind - 1.0
        if free < 5.0:
            return odd
        square = left * left / np.maximum(own, 1e-12)
        others = np.maximum(behind + total - square, 1e-30) / free
        farthest = int(np.argmax(square / others))
        if np.sqrt(square[farthest] / others[farthest]) < stdtrit(free, 1.0 - 0.5 * ODD / runs.rows):
            return odd
        if count == limit:
            break
        odd[runs.order[farthest]] = True
        # a row less is P less the product of its own column with itself
        unit = np.zeros((runs.rows, 1))
        unit[farthest] = 1.0
        column = precision.times(unit)[:, 0] - weighed[:, :-1] @ (inner @ weighed[farthest, :-1])
        column -= sum((one * one[farthest] for one in gone), np.zeros(runs.rows))
        gone.append(column / np.sqrt(own[farthest]))
        total -= square[farthest]
        left = left - gone[-1] * (left[farthest] / np.sqrt(own[farthest]))
        own = own - gone[-1] ** 2
        left[odd[runs.order]], own[odd[runs.order]] = 0.0, 1.0
    return np.zeros_like(odd)  # so many are no exception
