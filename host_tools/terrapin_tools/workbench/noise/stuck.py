"""A sensor that sticks or clips: the same number again and again, in a channel that otherwise hardly repeats one."""

from __future__ import annotations

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask

__all__ = ["clipped_rows", "full_ends", "stuck_rows"]

LONG = 8  # rows of one value; chosen by hand
CLIPPED, OFTENER = 3, 3  # rows at an end of the range, and times any other number's; chosen by hand
REPEATS = 0.05  # share of equal neighbours elsewhere, above which a channel is coarse rather than stuck; by hand
MOST = 0.1  # of the rows that may be stuck: more are no exception; chosen by hand


def stuck_rows(values: Array, run: Index) -> Mask:
    """Rows (rows,) of one channel at which its sensor sticks, but for the first of each stretch, which may be right.

    Values at either end of the range are those of a limit, and zeros those of rest: they are left.

    Parameters
    ----------
    values : (rows,), as measured.
    run : (rows,), the run of each row; rows of a run in their order.
    """
    order = np.argsort(run, kind="stable")
    ordered, sorted_run = values[order], run[order]
    same = np.zeros(len(values), dtype=bool)  # as the row before
    same[1:] = (ordered[1:] == ordered[:-1]) & (sorted_run[1:] == sorted_run[:-1])
    stretch = np.cumsum(~same) - 1
    inside = (ordered > ordered.min()) & (ordered < ordered.max()) & (ordered != 0.0)
    found = same & (np.bincount(stretch)[stretch] >= LONG) & inside
    mask = np.zeros(len(values), dtype=bool)
    if found.mean() <= MOST and (same & ~found).sum() <= REPEATS * (~found).sum():
        mask[order[found]] = True
    return mask


def clipped_rows(values: Array) -> Mask:
    """Rows (rows,) of one channel that its sensor clips, where they are few: more are no exception."""
    mask = np.isin(values, full_ends(values))
    return mask if mask.mean() <= MOST else np.zeros_like(mask)


def full_ends(values: Array) -> Array:
    """Ends of the range at which a channel's sensor may clip: the largest or least number, exactly and far more often
    than any other. What saturates by itself has noise and does not repeat."""
    known, count = np.unique(values, return_counts=True)
    if len(known) < 3:
        return np.zeros(0)
    ends, least = [0, -1], max(CLIPPED, OFTENER * int(count[1:-1].max()))
    return np.asarray(known[ends][(count[ends] >= least) & (known[ends] != 0.0)])
