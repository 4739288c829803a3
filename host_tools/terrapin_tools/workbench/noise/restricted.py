"""Restricted likelihood of residuals at each kind of noise (Harville 1974): what was fitted is integrated over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import ALONE, NODES, Kind, Node, considered
from terrapin_tools.workbench.noise.marginal_likelihood import STATED

__all__ = ["likelihood", "restricted_likelihood"]


def restricted_likelihood(
    runs: Sequence[Runs], residuals: Sequence[Array], bases: Sequence[Array], sigma: Sequence[float | None]
) -> tuple[Array, Array]:
    """-2 log restricted likelihood of the residuals at each kind of noise, and their sums of squares.

    Parameters
    ----------
    runs : the rows, for each channel.
    residuals : for each channel (rows,), in any one unit.
    bases : for each channel (rows, count), orthonormal columns that were fitted.
    sigma : for each channel the noise sd in the unit of its residuals, an estimate with STATED degrees of freedom;
        None: it is profiled.

    Returns
    -------
    (nodes,) : -2 log likelihood, up to a constant; the prior of each node is in it. Infinite where runs cannot show it.
    (nodes, channels) : whitened residual sums of squares, in the unit of the residuals squared.
    """
    nodes = NODES[: considered(len(residuals))]
    criterion = np.array([-2.0 * np.log(node.prior) for node in nodes])
    squares = np.zeros((len(nodes), len(residuals)))
    for channel, (rows, residual, basis, sd) in enumerate(zip(runs, residuals, bases, sigma, strict=True)):
        places: dict[Node, list[int]] = {}  # several kinds of noise may be one in this channel
        for place, node in enumerate(nodes):
            places.setdefault(replace(node.of(channel), prior=1.0), []).append(place)
        kinds: dict[Kind, list[Node]] = {}
        for node in places:
            kinds.setdefault(node.filter, []).append(node)
        for kind, these in kinds.items():
            both = rows.filtered(np.column_stack([basis, residual]), kind)
            for node, product in zip(these, rows.products(both, both).each(these), strict=True):
                inner, taken = product[:-1, :-1], product[:-1, -1]
                total = max(float(product[-1, -1] - taken @ np.linalg.solve(inner, taken)), 1e-300)
                fit = float(likelihood(np.asarray(total), rows.rows - basis.shape[1], sd))
                squares[places[node], channel] = total
                criterion[places[node]] += fit + rows.log_determinant(node) + np.linalg.slogdet(inner)[1]
    if runs[0].rows == runs[0].runs:
        criterion[[node.offset > ALONE for node in nodes]] = np.inf
    return criterion, squares


def likelihood(squares: Array, rows: int, sigma: float | None) -> Array:
    """-2 log likelihood of whitened sums of squares, but for what depends on the kind of noise alone."""
    if sigma is not None:
        return np.asarray((STATED + rows) * np.log(STATED + squares / (sigma * sigma)))
    return np.asarray(rows * np.log(np.maximum(squares, 1e-300)))
