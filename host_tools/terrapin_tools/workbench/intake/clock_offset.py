"""How far the clocks of two recordings are apart: by correlation of one quantity that both have.

    found = clock_offset(slow_times, slow, fast_times, fast, within=10.0)
    fast clock = slow clock + found.offset + found.drift * (slow clock - found.middle)

Both series go onto a grid of the slow period (the fast one averaged) and through the same filter, the derivative of a
Gaussian: it takes levels and trends away, which would go together anywhere, and leaves offsets as they are. Of several
widths, that of the most significant correlation is taken. Its peak is the coarse offset; least squares on the filtered
series then give offset and drift. Their covariance allows for correlated residuals (Newey and West 1987).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from terrapin_hil.arrays import Array, Mask

__all__ = ["Offset", "averaged", "clock_offset"]

LEAST_ROWS = 30  # of overlap
OVERLAP = 0.3  # least share of the shorter recording that must overlap
WIDTHS = (1.5, 3.0, 6.0, 12.0, 25.0, 50.0)  # sd of the Gaussian [slow periods]
REACH = 4.0  # sd of the Gaussian that a row's filter reaches
REAL = 6.0  # standard errors of the correlation: over a thousand lags and all widths, none comes by chance
CLEAR, ALIKE = 15.0, 0.75  # -2 log L by which, and share of the correlation below which, any other offset must stay
TELLING = 2.0  # slow samples: a standard deviation above it tells no offset
DRIFTS, MOST_DRIFT = 4.0, 2e-3  # standard deviations from which a drift is taken for one; no clock is worse than this
BLOCKS = 10  # of the jackknife
STEPS, NEAR = 40, 1e-6  # iterations, and the change at which they end [slow periods]


@dataclass(frozen=True)
class Offset:
    """What was found. `refused`: why it cannot be told, else ""; then the numbers are the best guess."""

    offset: float = float("nan")  # s
    offset_sd: float = float("nan")
    drift: float = 0.0  # s/s; 0 where none is seen
    drift_sd: float = float("nan")
    middle: float = 0.0  # s of the slow clock, at which the offset holds
    correlation: float = float("nan")  # of the filtered series, at its greatest
    width: float = float("nan")  # s, of the filter (sd)
    rows: int = 0
    lags: Array = field(default_factory=lambda: np.zeros(0))  # s, of the coarse search
    correlations: Array = field(default_factory=lambda: np.zeros(0))  # at the lags; NaN where too little overlaps
    refused: str = ""

    def to_fast(self, times: Array) -> Array:
        """Times of the slow clock on the fast one."""
        return times + self.offset + self.drift * (times - self.middle)


def averaged(times: Array, values: Array, at: Array, width: float) -> tuple[Array, Array]:
    """Means (rows,) of values within half of `width` around each of `at`, and how many each has; NaN where none.

    A boxcar as long as the slow period: windows of neighbours share nothing, so that white noise stays white.
    """
    there = np.isfinite(values)
    t, v = times[there], values[there]
    first = np.searchsorted(t, at - width / 2, "left")
    last = np.searchsorted(t, at + width / 2, "left")
    middle = float(v.mean()) if v.size else 0.0
    total = np.concatenate([[0.0], np.cumsum(v - middle)])
    count = (last - first).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(count > 0, middle + (total[last] - total[first]) / count, np.nan), count


def _gridded(times: Array, values: Array, period: float, mean: bool) -> tuple[Array, Array]:
    """A grid of the period, and the series on it; NaN further than two periods from any number."""
    good = np.isfinite(values)
    t, v = times[good], values[good]
    grid: Array = np.arange(t[0], t[-1], period)
    if mean:
        v, middle = averaged(t, v, grid, period)[0], averaged(t, t, grid, period)[0]
        t, v = middle[np.isfinite(v)], v[np.isfinite(v)]  # the rows of a window need not lie around its middle
    found = np.interp(grid, t, v)
    place = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    far = np.minimum(np.abs(grid - t[place - 1]), np.abs(grid - t[place])) > 2 * period
    return grid, np.where(far, np.nan, found)


def _filtered(values: Array, width: float) -> Array:
    """Through the derivative of a Gaussian of `width` rows; NaN where it would reach beyond an end or over a gap."""
    from scipy.ndimage import binary_dilation, gaussian_filter1d

    reach = int(REACH * width + 0.5)
    bad = ~np.isfinite(values)
    spoilt = binary_dilation(bad, iterations=reach) if bad.any() else bad.copy()
    spoilt[:reach] = spoilt[len(values) - reach :] = True
    smooth = gaussian_filter1d(np.where(bad, np.nanmean(values), values), width, order=1, truncate=REACH)
    return np.where(spoilt, np.nan, smooth)


def _lagged(slow: Array, fast: Array, least: int, most: int, fewest: int) -> tuple[Array, Array]:
    """Pearson's correlation of slow[i] with fast[i + k] for k from `least` to `most`, and the rows of each; by FFT."""
    size = 1 << int(np.ceil(np.log2(len(slow) + len(fast) + most - least)))
    ok_s, ok_f = np.isfinite(slow).astype(float), np.isfinite(fast).astype(float)
    s, f = np.where(ok_s > 0, slow / np.nanstd(slow), 0.0), np.where(ok_f > 0, fast / np.nanstd(fast), 0.0)

    def cross(a: Array, b: Array) -> Array:
        both = np.fft.irfft(np.conj(np.fft.rfft(a, size)) * np.fft.rfft(b, size), size)
        return np.asarray(both[np.arange(least, most + 1) % size])

    n = np.round(cross(ok_s, ok_f))
    with np.errstate(invalid="ignore", divide="ignore"):
        ms, mf = cross(s, ok_f) / n, cross(ok_s, f) / n
        cov = cross(s, f) / n - ms * mf
        var = (cross(s * s, ok_f) / n - ms**2) * (cross(ok_s, f * f) / n - mf**2)
        r = np.where((n >= fewest) & (var > 1e-6), cov / np.sqrt(np.maximum(var, 1e-300)), np.nan)
    return np.clip(r, -1, 1), n


def _autocorrelation(x: Array) -> Array:
    x = x[np.isfinite(x)] - np.nanmean(x)
    size = 1 << int(np.ceil(np.log2(2 * len(x))))
    power = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: max(2, len(x) // 2)]
    return np.asarray(power / power[0])


def _kurtosis(x: Array) -> float:
    x = x[np.isfinite(x)] - np.nanmean(x)
    return float(np.mean(x**4) / np.mean(x * x) ** 2)


@dataclass(frozen=True)
class _Coarse:
    width: float  # rows
    slow: Array  # filtered
    fast: Array
    lags: Array  # s
    r: Array
    peak: int
    strength: float  # standard errors of the correlation at the peak
    independent: float  # pairs that tell something new, at the peak
    lobe: int  # rows within which a lag is the peak's own


def _coarse(slow: Array, fast: Array, base: int, most: int, shift: float, period: float) -> _Coarse | None:
    """The search over all lags with the filter of the most significant correlation."""
    best: _Coarse | None = None
    for width in WIDTHS:
        if min(len(slow), len(fast)) < 3 * REACH * width + LEAST_ROWS:
            continue
        s, f = _filtered(slow, width), _filtered(fast, width)
        if min(np.isfinite(s).sum(), np.isfinite(f).sum()) < LEAST_ROWS or not (np.nanstd(s) > 0 and np.nanstd(f) > 0):
            continue
        fewest = max(LEAST_ROWS, int(OVERLAP * min(np.isfinite(s).sum(), np.isfinite(f).sum())))
        r, n = _lagged(s, f, base - most, base + most, fewest)
        if not np.isfinite(r).any():
            continue
        peak = int(np.nanargmax(np.abs(r)))
        own = [_autocorrelation(x) for x in (s, f)]
        rows = min(len(x) for x in own)
        # Bartlett 1946: rows for one pair that is independent, of series that have nothing to do with each other
        pairs = float(n[peak]) / max(1.0, 1 + 2 * float(np.sum(own[0][1:rows] * own[1][1:rows])))
        # chance gives series of few strong events more than their count of rows says: as their kurtosis
        pairs *= float(np.sqrt(3.0 / np.sqrt(max(3.0, _kurtosis(s)) * max(3.0, _kurtosis(f)))))
        strength = float(np.arctanh(min(abs(float(r[peak])), 1 - 1e-9)) * np.sqrt(max(0.0, pairs - 3)))
        lobe = max(2, *(int(np.argmax(x < 0)) if (x < 0).any() else len(x) for x in own))
        lags: Array = (np.arange(-most, most + 1) + base + shift) * np.float64(period)
        if best is None or strength > best.strength:
            best = _Coarse(width, s, f, lags, r, peak, strength, pairs, lobe)
    return best


def clock_offset(
    slow_times: Array,
    slow: Array,
    fast_times: Array,
    fast: Array,
    within: float,
    told: Callable[[float], float] = lambda offset: offset,
) -> Offset:
    """The offset of the fast recording's clock, -within to within [s].

    Parameters
    ----------
    slow_times, fast_times : (rows,), s, rising; slow has the longer period.
    slow, fast : (rows,), the quantity, in units and with a level of their own; NaN for a gap.
    told : of an offset, as a refusal tells it: between clocks that begin elsewhere.
    """
    if min(np.isfinite(slow).sum(), np.isfinite(fast).sum()) < LEAST_ROWS:
        return Offset(refused=f"a column has fewer than {LEAST_ROWS} numbers")
    period = float(np.median(np.diff(slow_times)))
    grid_s, on_s = _gridded(slow_times, slow, period, mean=False)
    grid_f, on_f = _gridded(fast_times, fast, period, mean=True)
    shift = float(grid_f[0] - grid_s[0]) / period  # of index 0, in slow periods
    found = _coarse(on_s, on_f, -round(shift), int(within / period) + 1, shift, period)
    if found is None:
        return Offset(refused="a column is constant, or the recordings overlap too little")
    rough = Offset(
        offset=float(found.lags[found.peak]), correlation=float(found.r[found.peak]), width=found.width * period,
        middle=float(grid_s.mean()), lags=found.lags, correlations=found.r,
    )  # fmt: skip
    steady = _refined(grid_s, grid_f, found, rough, False)
    if steady is None:
        return replace(rough, refused="no offset fits both recordings")
    fine, left = steady
    sd = _jackknife(grid_s, grid_f, found, fine)
    drifting = _refined(grid_s, grid_f, found, rough, True)
    if drifting is not None and abs(drifting[0].drift) <= MOST_DRIFT:
        better = found.independent * np.log(max(left, 1e-300) / max(drifting[1], 1e-300))
        if better > DRIFTS**2 / 2 and abs(drifting[0].drift) >= DRIFTS * drifting[0].drift_sd:
            fine = drifting[0]
    fine = replace(fine, offset_sd=max(fine.offset_sd, sd))
    return replace(fine, refused=_doubt(fine, found, period, abs(fine.drift) * float(np.ptp(grid_s)), told))


def _jackknife(grid_s: Array, grid_f: Array, found: _Coarse, fine: Offset) -> float:
    """Standard deviation of the offset, from what leaving out each of BLOCKS stretches changes: it knows when a few
    strong events tell all. Infinite where one of them does."""
    offsets = []
    for rows in np.array_split(np.arange(len(found.slow)), BLOCKS):
        slow = found.slow.copy()
        slow[rows] = np.nan
        without = _refined(grid_s, grid_f, replace(found, slow=slow), fine, False)
        if without is None:
            return float("inf")
        offsets.append(without[0].offset)
    return float(np.sqrt((BLOCKS - 1) * np.var(offsets)))


def _refined(grid_s: Array, grid_f: Array, found: _Coarse, told: Offset, drifts: bool) -> tuple[Offset, float] | None:
    """Least squares from the coarse offset: slow' = gain * fast'(t + offset + drift (t - middle)), by Gauss-Newton.
    And the mean square that is left."""
    from scipy.interpolate import CubicSpline

    there = np.isfinite(found.fast)
    curve = CubicSpline(grid_f, np.where(there, found.fast, 0.0))
    rate, known = curve.derivative(), there.astype(float)
    period = float(grid_s[1] - grid_s[0])
    away = grid_s - told.middle
    offset, drift = told.offset, 0.0
    for _ in range(STEPS):
        at = grid_s + offset + drift * away
        inside: Mask = (np.interp(at, grid_f, known, 0.0, 0.0) == 1.0) & np.isfinite(found.slow)
        if inside.sum() < LEAST_ROWS:
            return None
        value, slope, y = curve(at[inside]), rate(at[inside]), found.slow[inside]
        gain = float(value @ y) / max(float(value @ value), 1e-300)
        residual = y - gain * value
        jacobian = np.stack([value, gain * slope, gain * slope * away[inside]][: 3 if drifts else 2], 1)
        step, _, rank, _ = np.linalg.lstsq(jacobian, residual, rcond=1e-12)
        if rank < jacobian.shape[1]:
            return None
        move = float(np.clip(step[1], -found.width * period, found.width * period))
        offset += move
        if drifts:
            drift += float(np.clip(step[2], *(np.array([-1, 1]) * found.width * period / np.abs(away).max())))
        if abs(move) < NEAR * period:
            break
    cov = _covariance(jacobian, residual, int(2 * REACH * found.width))
    sd = np.sqrt(np.maximum(np.diag(cov), 0.0))
    fine = replace(
        told,
        offset=offset,
        offset_sd=float(sd[1]),
        drift=drift,
        drift_sd=float(sd[2]) if drifts else float("nan"),
        rows=int(inside.sum()),
    )
    return fine, float(np.mean(residual**2))


def _covariance(jacobian: Array, residual: Array, lags: int) -> Array:
    """Of a least-squares estimate with residuals that are correlated over `lags` rows; not below what residuals of the
    same size everywhere would give: few strong events leave small residuals beside them."""
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    own = np.correlate(residual, residual, "full")[len(residual) - 1 :][: lags + 1]
    long_run = max(float(own[0]), float(own[0] + 2 * (own[1:] * (1 - np.arange(1, len(own)) / (lags + 1))).sum()))
    plain = inverse * long_run / max(1, len(residual) - 3)
    score = jacobian * residual[:, None]
    middle = score.T @ score
    for k in range(1, min(lags, len(residual) - 1) + 1):
        part = score[k:].T @ score[:-k]
        middle = middle + (1 - k / (lags + 1)) * (part + part.T)
    robust = np.asarray(inverse @ middle @ inverse)
    return plain if np.trace(plain) > np.trace(robust) else robust


def _doubt(fine: Offset, found: _Coarse, period: float, drifted: float, told: Callable[[float], float]) -> str:
    """Why the offset cannot be told, or ""."""

    def said(offset: float) -> str:  # one clock may count from 1970: decimals, to a tenth of a period
        return f"{told(float(offset)):.{max(0, int(np.ceil(1 - np.log10(period))))}f} s"

    best = abs(float(found.r[found.peak]))
    if found.strength < REAL:
        return f"the columns hardly go together (correlation {fine.correlation:.2f} once trends are out)"
    apart: Mask = np.abs(np.arange(len(found.r)) - found.peak) > found.lobe
    other = np.where(apart & np.isfinite(found.r), np.abs(found.r), 0.0)
    second = int(np.argmax(other))
    behind = found.independent * np.log(max(1e-12, 1 - other[second] ** 2) / max(1e-12, 1 - best**2))
    if behind < CLEAR or other[second] > ALIKE * best:
        two = f"{said(found.lags[second])} fits almost as well as {said(fine.offset)}"
        return f"{two}: the columns repeat themselves (--within looks less far)"
    if found.peak in (0, len(found.r) - 1):
        return f"the best offset is at the end of what was searched ({said(fine.offset)}): look further (--within)"
    if not fine.offset_sd < TELLING * period:
        return f"the offset is known to {fine.offset_sd:.2g} s only, and a sample lasts {period:.2g} s"
    if abs(fine.offset - float(found.lags[found.peak])) > found.lobe * period + drifted:
        return f"correlation says {said(found.lags[found.peak])}, least squares say {said(fine.offset)}"
    return ""
