"""Sums of numbers whose logarithms are given."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from terrapin_hil.arrays import Array

__all__ = ["logsumexp"]


def logsumexp(logs: Array | Sequence[float], axis: int | tuple[int, ...] | None = None) -> Array:
    """log(sum(exp(logs))) over axes, of the shape that is left; -inf where all are.

    That of scipy.special is ten times slower on tables as small as ours, and a tenth of a discovery's time.

    >>> bool(np.isclose(logsumexp(np.log([1.0, 2.0, 5.0]) - 1000.0), np.log(8.0) - 1000.0))
    True
    """
    given = np.asarray(logs, dtype=float)
    top = given.max(axis=axis, keepdims=True)
    top = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(np.exp(given - top).sum(axis=axis)) + top.squeeze(axis))
