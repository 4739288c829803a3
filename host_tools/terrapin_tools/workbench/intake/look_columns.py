"""What columns show by themselves: constant, saturated, stuck, in steps; a clock's gaps; stretches that are steady."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_tools.workbench.noise.stuck import stuck_rows

__all__ = ["clock", "facts", "noise_of", "quantum", "saturation", "steady"]

LEAST = 10  # rows below which nothing is said of steps, saturation, sticking
MOST_DISTINCT = 200_000  # numbers of which steps are looked for
HELD, OFTENER = 5, 3  # rows on end at a limit, and times any other number's; chosen by hand
GAP = 10.0  # times the usual step
WINDOW, WINDOWS = 16, 200  # least rows of a window that may be steady; windows of a run at most
DRIFT, SHARE = 4.0, 0.01  # standard errors, and share of the range, that halves of a steady window may differ by


def noise_of(values: Array) -> float:
    """Standard deviation of white noise on a slow signal: of second differences, by their median absolute value."""
    steps = np.diff(values[np.isfinite(values)], 2)
    return float(np.median(np.abs(steps)) / 0.6745 / np.sqrt(6.0)) if steps.size >= LEAST else 0.0


def quantum(values: Array) -> float | None:
    """The step that all differences are multiples of; None for a column without one, or of two numbers only."""
    distinct = np.unique(values[np.isfinite(values)])
    if not 3 <= len(distinct) <= MOST_DISTINCT:
        return None
    differences = np.diff(distinct)
    rounding = 8 * float(np.finfo(np.float64).eps * np.abs(distinct).max())
    least = float(differences.min())
    if least <= 100 * rounding:
        return None
    for part in (1, 2, 3, 4, 6):  # the least difference may be a multiple itself
        step = least / part
        counts = differences / step
        if np.all(np.abs(counts - np.round(counts)) < 1e-3 + rounding / step):
            size = float(np.mean(differences / np.round(counts)))
            return float(f"{size:.6g}")
    return None


def _longest(mask: Array) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max()) if edges.size else 0


def saturation(values: Array) -> list[tuple[float, int]]:
    """Ends of the range at which the column stays: (value, rows). What saturates does not repeat inside as often."""
    known, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    if len(known) < LEAST:
        return []
    inner = int(counts[1:-1].max())
    ends = [(float(known[i]), int(counts[i])) for i in (0, -1)]
    return [(v, n) for v, n in ends if v != 0.0 and n >= OFTENER * inner and _longest(values == v) >= HELD]


def facts(values: Array, run: Index) -> dict[str, Any]:
    """Of a column (rows,), NaN where a number is missing; `run`: of each row."""
    there = values[np.isfinite(values)]
    found: dict[str, Any] = {"missing": int(len(values) - there.size), "min": None, "max": None, "mean": None}
    found |= {"constant": False, "step": None, "noise": None, "saturated": [], "stuck": None}
    if not there.size:
        return found
    found |= {"min": float(there.min()), "max": float(there.max()), "mean": float(there.mean())}
    found["constant"] = bool(there.size > 1 and there.min() == there.max())
    if found["constant"] or there.size < LEAST:
        return found
    found["step"] = quantum(there)
    found["noise"] = noise_of(values)
    found["saturated"] = [{"at": value, "rows": rows} for value, rows in saturation(values)]
    stuck = stuck_rows(np.nan_to_num(values), run)
    if stuck.any():
        found["stuck"] = {"rows": int(stuck.sum()), "first": int(np.argmax(stuck))}
    return found


def clock(times: Array, run: Index) -> dict[str, Any]:
    """Rate, gaps and steps back of a column of time [its unit]; a new run may begin anywhere."""
    steps = np.diff(times)
    inside = (run[1:] == run[:-1]) & np.isfinite(steps)
    forward = steps[inside & (steps > 0)]
    period = float(np.median(forward)) if forward.size else None
    wide = inside & (steps > GAP * period) if period else np.zeros(len(steps), bool)
    back = np.flatnonzero(inside & (steps < 0))
    return {
        "begin": float(np.nanmin(times)),
        "end": float(np.nanmax(times)),
        "period": period,
        "jitter": float(np.std(forward[forward <= GAP * period])) if period else None,
        "gaps": [
            {"row": int(i), "begin": float(times[i]), "lasts": float(steps[i])} for i in np.flatnonzero(wide)[:20]
        ],
        "gap_count": int(wide.sum()),
        "steps_back": int(back.size),
        "first_back": int(back[0]) + 1 if back.size else None,
        "repeated": int((inside & (steps == 0)).sum()),
    }


def steady(columns: list[Array], run: Index) -> list[tuple[int, int]]:
    """Stretches of rows [first, last) in which no column drifts: windows whose halves have means alike within their
    noise or a small share of the range, joined where they do not differ."""
    rows = len(run)
    found: list[tuple[int, int]] = []
    usable = [c for c in columns if np.isfinite(c).all() and c.size and np.ptp(c) > 0]
    if not usable:
        return []
    scale = [(noise_of(c), float(np.ptp(c))) for c in usable]
    borders = [0, *(np.flatnonzero(np.diff(run)) + 1).tolist(), rows]
    for begin, end in pairwise(borders):
        width = max(WINDOW, (end - begin) // WINDOWS)
        for first in range(begin, end - width + 1, width):
            half = width // 2
            means = [(c[first : first + half].mean(), c[first + half : first + width].mean()) for c in usable]
            limits = [max(DRIFT * n * np.sqrt(2.0 / half), SHARE * r) for n, r in scale]
            if any(abs(a - b) > limit for (a, b), limit in zip(means, limits, strict=True)):
                continue
            last = found[-1] if found else (-1, -1)
            joined = last[1] == first and last[0] >= begin and all(
                abs(c[last[0] : last[1]].mean() - c[first : first + width].mean()) <= limit
                for c, limit in zip(usable, limits, strict=True)
            )  # fmt: skip
            if joined:
                found[-1] = (last[0], first + width)
            else:
                found.append((first, first + width))
    return found
