"""Noise in what the model reads: a speed that is measured, too, is not the speed that acted.

Where a setting is held during a run and what was measured of it only scatters about it, the model follows that scatter
although the robot did not. A column for each such input, the prediction with what was measured less that with the run's
mean, takes this up; its coefficient is minus the share of the deviation that is noise, so one outside 0 to 1 is
something else, and is left in. The difference is taken in full: near standstill noise turns a measured speed round.

Source: Fuller, Measurement Error Models (1987), ch. 1.
"""

from __future__ import annotations

import numpy as np

from terrapin_hil.arrays import Array, Mask
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.noise.covariance import Runs, orthonormal
from terrapin_tools.workbench.noise.kinds import Node
from terrapin_tools.workbench.noise.mishaps import within_runs

__all__ = ["input_noise", "undecided"]

LIKE_NOISE = 2.5  # standard errors above 0 from which neighbouring deviations go together: the setting moved
SEEN = 2.0  # standard errors that the share must be away from 0
ROUGHLY = 0.1  # by which a share may lie above 1: the parameters were fitted without its column
UNDECIDED = 10.0  # noise sd by which the noise of an input moves a prediction that says nothing then; chosen by hand


def input_noise(fit: Fit, rows: Mask, residual: Array, slopes: Array, sigma: Array, node: Node, whole: Mask) -> Array:
    """Columns (channels, rows, count), in the channels' units, for the inputs whose noise shows in the residual.

    Parameters
    ----------
    fit : of the model; one that integrates over a run has no such columns.
    rows : (all rows,), mask of the case's rows.
    residual : (channels, rows), measured minus predicted, in the channels' units.
    slopes : (channels, rows, parameters), derivatives of the prediction, in the same units.
    sigma : (channels,), noise sd in the same units.
    node, whole : the kind of noise, and whose sd it is (see `Runs`).
    """
    case, channels = fit.model.case, len(residual)
    none = np.zeros((*residual.shape, 0))
    if case.base.whole_runs:
        return none
    runs = Runs(case.run[rows], channels, fit.model.bind(case.inputs, rows).predict(fit.theta), whole=whole)
    found = [c for name in case.inputs if (c := _column(fit, name, rows)) is not None]
    if not found:
        return none
    stacked = np.stack(found, axis=-1)

    def white(values: Array) -> Array:
        return runs.whiten((values / sigma[:, None, None]).reshape(channels * runs.rows, -1), node)

    basis = orthonormal(white(slopes))
    gap, columns = white(residual[..., None])[:, 0], white(stacked)
    gap, columns = gap - basis @ (basis.T @ gap), columns - basis @ (basis.T @ columns)
    kept = list(range(len(found)))
    while kept:
        inverse = np.linalg.pinv(columns[:, kept].T @ columns[:, kept])
        share = -inverse @ (columns[:, kept].T @ gap)
        left = gap + columns[:, kept] @ share
        error = np.sqrt(np.diagonal(inverse) * float(left @ left) / max(len(gap) - basis.shape[1] - len(kept), 1))
        wrong = (share < SEEN * error) | (share > 1.0 + np.maximum(SEEN * error, ROUGHLY))
        if not wrong.any():
            break
        kept.pop(int(np.argmin(np.where(wrong, share / np.maximum(error, 1e-300), np.inf))))
    return np.asarray(stacked[..., kept])


def _column(fit: Fit, name: str, rows: Mask) -> Array | None:
    """The prediction with an input as measured less that with its run's mean (channels, rows); None where the input is
    constant in the runs, or its deviations are no noise."""
    inputs = fit.model.case.inputs
    values, runs = inputs[name][rows], Runs(fit.model.case.run[rows])
    off = within_runs(runs.run, values)
    span = float(np.ptp(inputs[name]))
    if runs.length.min() < 3 or float(np.abs(off).max()) <= 1e-9 * max(span, 1e-300):
        return None
    ordered = runs.sort(off[:, None])[:, 0]
    later = np.ones(len(off), dtype=bool)
    later[runs.begin] = False
    neighbours = ordered[later] @ ordered[np.flatnonzero(later) - 1] / float(ordered @ ordered)
    expected = -1.0 / float(runs.length.mean())  # the mean of a run is taken off
    if neighbours - expected > LIKE_NOISE / np.sqrt(len(off)):
        return None
    still = inputs[name].copy()
    still[rows] = values - off
    with np.errstate(all="ignore"):
        held = fit.model.bind({**inputs, name: still}, rows).predict(fit.theta)
        column = fit.model.bind(inputs, rows).predict(fit.theta) - held
    return column if bool(np.isfinite(column).all()) and bool(np.any(column)) else None


def undecided(nuisance: Array, sigma: Array, share: float) -> Mask:
    """Rows (rows,) whose prediction the noise of an input leaves open: near standstill it turns the direction round.

    Parameters
    ----------
    nuisance : (channels, rows, count), as `input_noise` gives them.
    sigma : (channels,), noise sd.
    share : of the rows that may be so at most; where there are more, the columns must do.
    """
    moved = np.abs(nuisance).max(axis=2, initial=0.0) / sigma[:, None]
    found: Mask = moved.max(axis=0) > UNDECIDED
    return found if found.mean() <= share else np.zeros_like(found)
