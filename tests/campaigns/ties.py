"""Ties: do the data really not tell apart what an answer leaves open?

A tie is right only if each set that it tells gives what is in the data, all parameters refitted, but for a D2 below
ADMISSIBLE (docs/campaigns.md): else the program shrugged where it could have told. Where the covariance of the noise is
not given, it counts as independent from row to row, which is too strict for what changes slowly. Where no set gives the
data exactly (a rig of another simulator), D2 is beyond the best of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import least_squares

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.discover.discovery import Discovery
from terrapin_tools.workbench.model.fitting import Fit, fit_model
from tests.campaigns.resumed import Record

__all__ = ["ADMISSIBLE", "MOST_TOLD", "distances", "is_tie", "rivals", "told"]

ADMISSIBLE = 9.0  # squared, in noise sd
MOST_TOLD = 4  # sets of an answer that still is one, where a campaign bounds them


def told(found: Discovery) -> tuple[tuple[str, ...], ...]:
    """The sets of an answer: all of a tie, the one that is missing, or none."""
    return found.rivals or ((found.missing,) if found.missing else ())


def distances(
    found: Discovery, inputs: Mapping[str, Array], true: Array, sigma: Array, covariance: Sequence[Array] = ()
) -> list[float]:
    """D2 of each told set.

    inputs : as Case.inputs gives them, without noise. true : (channels, rows of the case), what is measured, without
    noise. sigma : (channels,), of the noise. covariance : (rows, rows) of each channel, in units of sigma**2.
    """
    fits = {h.effects: h.fit for h in found.ranking.hypotheses if h.fit is not None}
    every = np.ones(true.shape[1], dtype=bool)
    nearest = []
    for names in told(found):
        bound = fits[names].model.bind(inputs, every)
        fit = fit_model(bound, true, sigma, [fits[names].theta])
        nearest.append(round(_whitened(fit, true, sigma, covariance) if covariance else fit.cost, 1))
    return nearest


def _whitened(fit: Fit, true: Array, sigma: Array, covariance: Sequence[Array]) -> float:
    """The least of the squared distance under a covariance, from the fit for independent noise on."""
    model = fit.bound.model
    free = [i for i, one in enumerate(model.fitted) if not one.whole]
    lower, upper = model.lower[free], model.upper[free]
    roots = [cholesky(one, lower=True) for one in covariance]

    def apart(part: Array) -> tuple[Array, Array]:
        theta = fit.theta.copy()
        theta[free] = part
        predicted, slopes = fit.bound.jacobian(theta)
        residual, slopes = (predicted - true) / sigma[:, None], slopes[..., free] / sigma[:, None, None]
        columns = np.concatenate([residual[..., None], slopes], axis=-1)
        white = np.concatenate(
            [solve_triangular(root, one, lower=True) for root, one in zip(roots, columns, strict=True)]
        )
        return white[:, 0], white[:, 1:]

    start = np.clip(fit.theta[free], lower, upper)
    margin = 1e-9 * np.maximum(1.0, np.abs(start))
    start = np.clip(start, lower + margin, upper - margin)
    scale = 1.0 / np.maximum(np.abs(apart(start)[1]).max(axis=0), 1e-12)
    found = least_squares(
        lambda part: apart(part)[0],
        start,
        lambda part: apart(part)[1],
        bounds=(lower, upper),
        x_scale=scale,
        max_nfev=50,
    )
    return float(2.0 * found.cost)


def is_tie(distances: Sequence[float], exact: bool = True) -> bool:
    """Whether the data do not tell apart sets of these D2; one set alone is no tie that could be wrong. `exact`: one of
    the sets that may be told gives the data."""
    least = 0.0 if exact else min(distances, default=0.0)
    return len(distances) < 2 or all(one - least < ADMISSIBLE for one in distances)


def rivals(records: Sequence[Record]) -> float:
    """Sets that are told beside the first, in the mean of the records with an answer that names something."""
    counts = [len(r["distances"]) - 1 for r in records if r.get("distances")]
    return sum(counts) / max(len(counts), 1)
