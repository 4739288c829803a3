"""Limits of rates and quantiles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import beta

__all__ = ["quantile_limits", "rate_limits"]


def rate_limits(hits: int, count: int, level: float = 0.95) -> tuple[float, float]:
    """Clopper and Pearson's two-sided limits of a rate.

    >>> print("{:.3f} {:.3f}".format(*rate_limits(0, 75)))
    0.000 0.048
    """
    if count == 0:
        return 0.0, 1.0
    tail = 0.5 * (1.0 - level)
    low = float(beta.ppf(tail, hits, count - hits + 1)) if hits > 0 else 0.0
    high = float(beta.ppf(1.0 - tail, hits + 1, count - hits)) if hits < count else 1.0
    return low, high


def quantile_limits(values: Sequence[float], share: float, level: float = 0.95) -> tuple[float, float]:
    """Bootstrap limits of a quantile (2,000 resamples, percentile method, fixed seed)."""
    data = np.asarray(values, dtype=float)
    random = np.random.default_rng(0)
    drawn = np.quantile(data[random.integers(0, len(data), (2000, len(data)))], share, axis=1)
    tail = 0.5 * (1.0 - level)
    return float(np.quantile(drawn, tail)), float(np.quantile(drawn, 1.0 - tail))
