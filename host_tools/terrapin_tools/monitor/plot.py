"""A line plot in braille dots: two columns and four rows of dots a character."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

__all__ = ["braille", "sparkline"]

BLOCKS = "▁▂▃▄▅▆▇█"
_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.int64)


def braille(
    times: Sequence[float], values: Sequence[float], width: int, height: int, seconds: float
) -> tuple[list[str], float, float]:
    """Rows of text for the last `seconds`, and the lowest and highest value shown (NaN: nothing to show).

    Each column of dots spans from the lowest to the highest value in it, so that no spike is lost.
    """
    t, v = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
    keep = np.isfinite(v) & (t > (t[-1] - seconds if len(t) else 0.0))
    t, v = t[keep], v[keep]
    if not len(t) or width < 1 or height < 1:
        return [" " * max(0, width)] * max(0, height), float("nan"), float("nan")
    low, high = float(v.min()), float(v.max())
    span = (high - low) or 1.0
    column = np.clip(((t - t[-1]) / seconds + 1.0) * (2 * width - 1), 0, 2 * width - 1).astype(np.int64)
    dot = np.clip(np.round((high - v) / span * (4 * height - 1)), 0, 4 * height - 1).astype(np.int64)
    if high == low:
        dot[:] = 2 * height
    top = np.full(2 * width, 4 * height)
    bottom = np.full(2 * width, -1)
    np.minimum.at(top, column, dot)
    np.maximum.at(bottom, column, dot)
    rows = np.arange(4 * height)[:, None]
    dots = (rows >= top) & (rows <= bottom)
    cells = (dots.reshape(height, 4, width, 2) * _DOTS[None, :, None, :]).sum(axis=(1, 3))
    return ["".join(chr(0x2800 + cell) for cell in line) for line in cells.tolist()], low, high


def sparkline(values: Iterable[float]) -> str:
    """One character a value, from the lowest to the highest; what is not finite leaves a gap.

    >>> sparkline([0.0, 1.0, 2.0, float("nan"), 2.0])
    '▁▅█ █'
    """
    found = list(values)
    there = [value for value in found if value - value == 0.0]
    low, span = (min(there), max(there) - min(there)) if there else (0.0, 0.0)
    return "".join(
        " " if value - value != 0.0 else BLOCKS[round((value - low) / span * 7) if span else 0] for value in found
    )
