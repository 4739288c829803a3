"""A refitted set of effects as a linear model around that fit: what its evidence is computed from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array, Mask
from terrapin_tools.workbench.model.data_columns import is_phase
from terrapin_tools.workbench.model.effect_columns import loudness
from terrapin_tools.workbench.model.fitting import Fit

__all__ = ["AT_BOUND", "Linear", "bounds", "following", "linearise"]

ABSURD = (
    1e5  # noise sd (rms): a fit that is so large off the training rows is none, and sums of squares lose all digits
)
AT_BOUND = 3.0  # log evidence taken off an effect whose size wants to leave its bounds


@dataclass(frozen=True)
class Linear:
    """Residual (channels, rows) of a fit, derivatives `base` (channels, rows, P) of the model's own parameters, their
    `bounds` (P,), and `columns` (channels * rows, D) of the effects, all in noise sd; a coefficient is a size in noise
    sd (rms).

    `offset` (D,): the coefficients at the fit. `signs` (D,): 1 or -1 where a coefficient can only have that sign.
    `lost`: log evidence that effects at a bound cost.
    """

    residual: Array
    base: Array
    bounds: Array
    columns: Array
    offset: Array
    signs: Array
    lost: float


def following(fit: Fit) -> Mask:
    """Which fitted parameters (fitted,) may follow what is added: all but those that ended at a bound. The model's own
    may even so, for what is missing may have driven them there; not along the motion that such a value gives equations
    over time."""
    own = not fit.model.case.base.whole_runs
    return np.array([f.key not in fit.at_bound or (own and f.effect is None) for f in fit.model.fitted], dtype=bool)


def bounds(fit: Fit) -> Array:
    """1 for each fitted parameter (fitted,) that stands at its lower bound, -1 for one at its upper, 0 for others."""
    low = fit.theta - fit.model.lower < fit.model.upper - fit.theta
    stuck = np.array([f.key in fit.at_bound for f in fit.model.fitted], dtype=bool)
    return np.where(stuck, np.where(low, 1.0, -1.0), 0.0)


def _around(fit: Fit, measured: Array, rows: Mask, sigma: Array) -> tuple[Array, Array]:
    """Residual and derivatives of a fit on rows, in noise sd: over time, its own on the rows that it was made on."""
    case = fit.model.case
    own = case.train[rows]
    known = case.base.whole_runs and np.array_equal(sigma, fit.sigma) and own.sum() == fit.residual.shape[1]
    rest = rows & ~case.train if known else rows
    if known and not rest.any():
        return fit.residual, fit.jacobian
    prediction, slopes = fit.model.bind(case.inputs, rest).jacobian(fit.theta)
    left = (measured[:, ~own] if known else measured) - prediction
    residual, scaled = left / sigma[:, None], slopes / sigma[:, None, None]
    if not known:
        return residual, scaled
    whole, derivatives = np.empty(measured.shape), np.empty((*measured.shape, slopes.shape[-1]))
    whole[:, own], whole[:, ~own] = fit.residual, residual
    derivatives[:, own], derivatives[:, ~own] = fit.jacobian, scaled
    return whole, derivatives


def linearise(fit: Fit, names: Sequence[str], measured: Array, rows: Mask, sigma: Array) -> Linear:
    """The fit on `rows` with the effects `names` as columns, their shapes as fitted.

    Raises ValueError when an effect has no influence, an absurd one, or size 0 and with it no phase.
    """
    residual, slopes = _around(fit, measured, rows, sigma)
    own = np.array([f.effect not in names for f in fit.model.fitted], dtype=bool) & following(fit)
    columns: list[Array] = []
    offset: list[float] = []
    signs: list[float] = []
    lost = 0.0
    for name in names:
        effect = next(e for e in fit.model.effects if e.name == name)
        if not effect.parameters:  # a fault of the table: it has no size, and no column
            continue
        at = next(i for i, f in enumerate(fit.model.fitted) if f.effect == name)
        first = fit.model.fitted[at]
        size = float(fit.theta[at])
        block = [slopes[..., at]]
        loud = loudness(slopes[..., at : at + 1])
        if loud == 0.0 or not np.isfinite(loud):
            raise ValueError(f"{name} has no influence here")
        if abs(size) * loud > ABSURD:
            raise ValueError(f"{name} would be {abs(size) * loud:g} noise sd on rows that were not fitted")
        if size != 0.0 and first.key in fit.at_bound:
            lost += AT_BOUND
            continue
        for i, parameter in enumerate(effect.parameters):
            if is_phase(parameter):
                if size == 0.0:
                    raise ValueError(f"{name} has size 0, and with it no phase")
                block.append(slopes[..., at + i] / size)
        waves = len(block) > 1
        columns += [(b / loud).reshape(-1) for b in block]
        offset += [size * loud, *([0.0] * (len(block) - 1))]
        free = 0.0 if waves else 1.0 if first.lower >= 0.0 else -1.0 if first.upper <= 0.0 else 0.0
        signs += [free] * len(block)
    stacked = np.array(columns).T if columns else np.zeros((residual.size, 0))
    return Linear(residual, slopes[..., own], bounds(fit)[own], stacked, np.array(offset), np.array(signs), lost)
