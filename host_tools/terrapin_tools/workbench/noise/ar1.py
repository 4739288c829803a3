"""Noise that is correlated from row to row within a run (AR(1)), and what the data say about it.

The standard deviation is the one that the case gives, else that of repeated settings, else what the smoothest model
that the data support leaves. That model is the fitted one with those shapes in the data's columns that earn their
place. The correlation always comes from that smoothest model, by restricted maximum likelihood on a grid. The simulated
null repeats this, so that every p-value includes the uncertainty of the correlation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from terrapin_tools.workbench.bases import RUNNING

__all__ = [
    "RHO_GRID",
    "Ar1",
    "Noise",
    "estimate_noise",
    "least_noise",
    "repeated_settings",
    "restricted_likelihood",
    "within_scatter",
]

Array = npt.NDArray[np.float64]

# Correlations that are weighed, denser near 1, where the same step changes the noise more. Chosen by hand.
RHO_GRID = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.78, 0.84, 0.89, 0.925, 0.95, 0.97, 0.98, 0.988, 0.994)
SHAPES_LIMIT = 12  # shapes that the smoothest model may take up; chosen by hand
ENTRY = (
    20.0  # squared score, in noise variances, at which a shape enters: 1e-5 a shape by chance, over hundreds of them
)
TRIED = (0, 5, 9, 12)  # places in RHO_GRID at which a shape is tried beside the present one; chosen by hand
FEW_REPEATS = 30  # degrees of freedom below which the repeats alone give too rough an sd; chosen by hand (13 % of sd)
REPEATS_NEEDED = 4  # degrees of freedom that repeated settings must give; chosen by hand
# Share of a channel's spread below which no noise was measured. Chosen by hand, after cases of computed numbers, whose
# sd of rounding (1e-151 in one) made every formula wrong.
EXACT = 1e-6


@dataclass(frozen=True)
class Noise:
    """Noise of each channel: its sd in the channel's unit, where that comes from, and how rows are correlated."""

    sigma: Array  # (channels,)
    known: npt.NDArray[np.bool_]  # (channels,): given in the case
    rho: float
    source: str  # one sentence for people
    freedom: Array  # degrees of freedom behind each sigma; inf when given
    groups: npt.NDArray[np.int64] | None  # (rows,) repeated settings that gave sigma, None when they did not


class Ar1:
    """The correlation rho^|lag| of rows of one run, for rows in file order."""

    def __init__(self, run: npt.NDArray[np.int64]) -> None:
        self.order = np.argsort(run, kind="stable")
        sorted_run = run[self.order]
        self.first = np.ones(len(run), dtype=bool)
        self.first[1:] = sorted_run[1:] != sorted_run[:-1]
        self.rows = len(run)
        self.run = run
        begin = np.maximum.accumulate(np.where(self.first, np.arange(len(run)), 0))
        self.position = np.empty(len(run), dtype=np.int64)  # of a row within its run
        self.position[self.order] = np.arange(len(run)) - begin
        self.runs = int(self.first.sum())

    def whiten(self, values: Array, rho: float) -> Array:
        """Rows (rows, ...) made independent with unit variance, if their noise had unit variance; in sorted order."""
        ordered = values[self.order]
        if rho == 0.0:
            return ordered
        white = ordered.copy()
        white[1:] = (ordered[1:] - rho * ordered[:-1]) / np.sqrt(1.0 - rho * rho)
        white[self.first] = ordered[self.first]
        return white

    def colour(self, white: Array, rho: float) -> Array:
        """Noise (rows, ...) of unit variance and correlation rho from independent normal numbers, in file order."""
        coloured = white * np.sqrt(1.0 - rho * rho)
        coloured[self.first] = white[self.first]
        if rho > 0.0:
            begin = np.flatnonzero(self.first)
            length = np.diff(np.append(begin, self.rows))
            for place in range(1, int(length.max())):  # all runs at once
                row = begin[length > place] + place
                coloured[row] += rho * coloured[row - 1]
        result = np.empty_like(white)
        result[self.order] = coloured
        return result

    def log_determinant(self, rho: float) -> float:
        return float((self.rows - self.runs) * np.log1p(-rho * rho))


def orthonormal(columns: Array) -> Array:
    """An orthonormal basis of the columns (rows, count); columns that add nothing are left out."""
    if columns.shape[1] == 0:
        return columns
    norm = np.sqrt((columns * columns).sum(axis=0))
    kept = columns[:, norm > 0] / norm[norm > 0]
    if kept.shape[1] == 0:
        return np.zeros((columns.shape[0], 0))
    u, s, _ = np.linalg.svd(kept, full_matrices=False)
    return np.asarray(u[:, s > 1e-9 * s[0]])


def restricted_likelihood(
    ar1: Ar1, residuals: Sequence[Array], bases: Sequence[Array], sigma: Sequence[float | None]
) -> tuple[Array, Array]:
    """-2 log restricted likelihood of the residuals at each correlation of RHO_GRID, and their sums of squares.

    Parameters
    ----------
    ar1 : correlation of the rows within runs.
    residuals : for each channel (rows, sets), in any one unit.
    bases : for each channel (rows, count), orthonormal columns that were fitted.
    sigma : for each channel the noise sd in the unit of its residuals; None: it is profiled.

    Returns
    -------
    (grid, sets) : -2 log likelihood, up to a constant.
    (grid, channels, sets) : whitened residual sums of squares, in the unit of the residuals squared.
    """
    sets = residuals[0].shape[1]
    criterion = np.zeros((len(RHO_GRID), sets))
    squares = np.zeros((len(RHO_GRID), len(residuals), sets))
    for i, rho in enumerate(RHO_GRID):
        log_correlation = ar1.log_determinant(rho)
        for channel, (residual, basis, sd) in enumerate(zip(residuals, bases, sigma, strict=True)):
            white = ar1.whiten(residual, rho)
            total = (white * white).sum(axis=0)
            log_design = 0.0
            if basis.shape[1]:
                q, r = np.linalg.qr(ar1.whiten(basis, rho))
                total = total - ((q.T @ white) ** 2).sum(axis=0)
                log_design = 2.0 * float(np.log(np.abs(np.diag(r))).sum())
            total = np.maximum(total, 1e-300)
            squares[i, channel] = total
            free = ar1.rows - basis.shape[1]
            fit = total / (sd * sd) if sd is not None else free * np.log(total)
            criterion[i] += log_correlation + log_design + fit
    return criterion, squares


def repeated_settings(roles: Mapping[str, Array], rows: int) -> npt.NDArray[np.int64]:
    """A number for each row; rows with the same number are repeated settings.

    All mapped roles except time, angle and acceleration agree within 1 % of their range.
    """
    settings = [values for name, values in roles.items() if name not in RUNNING]
    if not settings:
        return np.arange(rows)
    stacked = np.column_stack(settings)
    span = np.ptp(stacked, axis=0)
    tolerance = np.where(span > 0, 0.01 * span, np.inf)
    group = np.full(rows, -1, dtype=np.int64)
    order = np.argsort(stacked[:, 0], kind="stable")
    sorted_first = stacked[order, 0]
    count = 0
    for row in range(rows):
        if group[row] >= 0:
            continue
        low, high = np.searchsorted(sorted_first, [stacked[row, 0] - tolerance[0], stacked[row, 0] + tolerance[0]])
        near = order[low : high + 1]
        near = near[group[near] < 0]
        agree = near[(np.abs(stacked[near] - stacked[row]) <= tolerance).all(axis=1)]
        group[agree] = count
        group[row] = count
        count += 1
    return group


def estimate_noise(
    residual: Array,
    jacobian: Array,
    run: npt.NDArray[np.int64],
    given: Sequence[float | None],
    roles: Mapping[str, Array],
    shapes: Sequence[Array],
    least: Array,
) -> Noise:
    """Noise of the residuals of a fitted model: sd of each channel, correlation, and where the sd comes from.

    Parameters
    ----------
    residual : (channels, rows), measured minus predicted, in the channels' units.
    jacobian : (channels, rows, parameters), derivatives of the prediction, in the same units.
    run : (rows,), the run of each row.
    given : for each channel the sd that the case states, in the channel's unit, or None.
    roles : mapped roles (rows,), among which repeated settings are looked for; empty: there are none.
    shapes : for each channel (count, rows), functions of the data's columns, candidates for the smoothest model.
    least : (channels,), see `least_noise`; a smaller sd is that of rounding, and this one is taken as if it were given.
    """
    noise = _estimate(residual, jacobian, run, given, roles, shapes)
    exact = ~noise.known & (noise.sigma < least)
    if not exact.any():
        return noise
    stated = [float(low) if bare else g for low, bare, g in zip(least, exact, given, strict=True)]
    source = f"measurements without noise: an sd of {EXACT:g} of their spread is assumed"
    return replace(_estimate(residual, jacobian, run, stated, roles, shapes), source=source)


def least_noise(values: Array) -> Array:
    """The smallest noise sd (channels,) that is believed of measurements (channels, rows) without a stated one.

    What was computed, not measured, has no noise but its rounding, and errors in units of that mean nothing.
    """
    low, high = np.quantile(values, [0.05, 0.95], axis=1)
    spread = np.where(high > low, high - low, np.ptp(values, axis=1))
    largest = np.abs(values).max(axis=1)
    return np.asarray(EXACT * np.where(spread > 0.0, spread, np.where(largest > 0.0, largest, 1.0)))


def _estimate(
    residual: Array,
    jacobian: Array,
    run: npt.NDArray[np.int64],
    given: Sequence[float | None],
    roles: Mapping[str, Array],
    shapes: Sequence[Array],
) -> Noise:
    channels, rows, _ = jacobian.shape
    ar1 = Ar1(run)
    bases = [orthonormal(jacobian[c]) for c in range(channels)]
    residuals = [residual[c][:, None] for c in range(channels)]
    pools = [np.ascontiguousarray(shape.T) for shape in shapes]
    limit = min(SHAPES_LIMIT, max(0, (rows - bases[0].shape[1]) // 4))
    taken = 0
    while True:
        criterion, squares = restricted_likelihood(ar1, residuals, bases, given)
        best = int(np.argmin(criterion[:, 0]))
        rho = RHO_GRID[best]
        free = np.array([rows - basis.shape[1] for basis in bases], dtype=np.float64)
        estimated = np.sqrt(squares[best, :, 0] / np.maximum(free, 1.0))
        sigma = np.array([e if g is None else g for e, g in zip(estimated, given, strict=True)])
        if taken >= limit:
            break
        gain, channel, index = _strongest(ar1, residuals, bases, pools, given, squares[:, :, 0], best)
        if gain < ENTRY:
            break
        bases[channel] = orthonormal(np.column_stack([bases[channel], pools[channel][:, index]]))
        taken += 1
    known = np.array([g is not None for g in given], dtype=bool)
    if known.all():
        return Noise(sigma, known, rho, "noise sd as given", np.full(channels, np.inf), None)
    group: npt.NDArray[np.int64] | None = repeated_settings(roles, rows)
    assert group is not None
    repeats = rows - (int(group.max()) + 1)
    if repeats >= REPEATS_NEEDED:
        repeated, freedom = _from_repeats(ar1, residual, group, rho)
        agree = [_agree(sigma[c], free[c], repeated[c], freedom) for c in range(channels)]
        if freedom < FEW_REPEATS and all(agree):
            pooled = np.sqrt((free * sigma**2 + freedom * repeated**2) / (free + freedom))
            sigma, free, group = np.where(known, sigma, pooled), free + freedom, None
            source = f"noise sd from {repeats} repeats of settings and, agreeing with them, the smoothest model"
        else:
            sigma, free = np.where(known, sigma, repeated), np.full(channels, freedom)
            source = f"noise sd from repeated settings ({repeats} repeats)"
    else:
        group = None
        source = f"no repeated settings: noise sd from the smoothest model ({taken} shapes beside the model's own)"
    return Noise(sigma, known, rho, source, np.where(known, np.inf, free), group)


def _agree(smooth: float, smooth_freedom: float, repeated: float, freedom: float) -> bool:
    """Whether what the smoothest model leaves is no larger than the repeats' scatter, at 1 % (F test)."""
    ratio = (smooth / repeated) ** 2
    return bool(_f_tail(ratio, smooth_freedom, freedom) > 0.01)


def _f_tail(ratio: float, above: float, below: float) -> float:
    from scipy.special import betainc

    return float(betainc(below / 2.0, above / 2.0, below / (below + above * ratio)))


def _likelihood(squares: Array, rows: int, sigma: float | None) -> Array:
    """-2 log likelihood of whitened sums of squares, but for what depends on the correlation alone."""
    return squares / (sigma * sigma) if sigma is not None else rows * np.log(np.maximum(squares, 1e-300))


def _strongest(
    ar1: Ar1,
    residuals: Sequence[Array],
    bases: Sequence[Array],
    pools: Sequence[Array],
    sigma: Sequence[float | None],
    squares: Array,
    best: int,
) -> tuple[float, int, int]:
    """Largest gain of -2 log likelihood by one shape more, the correlation being free to change; channel and index.

    A misfit that drifts looks like strong correlation, under which its own shape would hardly count: so the shape is
    also tried at weaker ones.
    """
    own = np.array([[float(_likelihood(q, ar1.rows, sd)) for q, sd in zip(row, sigma, strict=True)] for row in squares])
    whole = own.sum(axis=1) + np.array([len(sigma) * ar1.log_determinant(rho) for rho in RHO_GRID])
    present = float(whole.min())
    found = (0.0, 0, 0)
    for trial in sorted({best, *TRIED}):
        rho = RHO_GRID[trial]
        for channel, pool in enumerate(pools):
            if pool.shape[1] == 0:
                continue
            white, columns = ar1.whiten(residuals[channel][:, 0], rho), ar1.whiten(pool, rho)
            before = (columns * columns).sum(axis=0)
            if bases[channel].shape[1]:
                q = np.linalg.qr(ar1.whiten(bases[channel], rho))[0]
                white = white - q @ (q.T @ white)
                columns = columns - q @ (q.T @ columns)
            norm = (columns * columns).sum(axis=0)
            usable = norm > 1e-8 * before
            taken = np.where(usable, (columns.T @ white) ** 2 / np.where(usable, norm, 1.0), 0.0)
            index = int(np.argmax(taken))
            left = np.asarray(max(float(white @ white) - float(taken[index]), 1e-300))
            new = whole[trial] - own[trial, channel] + float(_likelihood(left, ar1.rows, sigma[channel]))
            found = max(found, (present - float(new), channel, index), key=lambda entry: entry[0])
    return found


def within_scatter(ar1: Ar1, values: Array, group: npt.NDArray[np.int64], rho: float) -> Array:
    """Noise sd (sets,) from the scatter of values (rows, sets) within groups of repeated settings.

    Neighbouring rows of a run are alike when the noise is correlated: what is left of the variance within a group is
    that share of it which the correlation rho leaves.
    """
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    sizes = np.diff(np.append(starts, len(order)))
    sums = np.add.reduceat(values[order], starts, axis=0)
    scatter = (values * values).sum(axis=0) - (sums * sums / sizes[:, None]).sum(axis=0)
    share = 0.0
    for begin, size in zip(starts[sizes > 1], sizes[sizes > 1], strict=True):
        rows = order[begin : begin + size]
        same = ar1.run[rows][:, None] == ar1.run[rows][None, :]
        lag = np.abs(ar1.position[rows][:, None] - ar1.position[rows][None, :])
        share += size - float((same * (rho**lag if rho > 0 else lag == 0)).sum()) / size
    return np.asarray(np.sqrt(np.maximum(scatter, 1e-300) / max(share, 1e-12)))


def _from_repeats(ar1: Ar1, residual: Array, group: npt.NDArray[np.int64], rho: float) -> tuple[Array, float]:
    """Noise sd a channel from the scatter within groups, at the given correlation; and the degrees of freedom."""
    return within_scatter(ar1, residual.T, group, rho), float(len(group) - (int(group.max()) + 1))
