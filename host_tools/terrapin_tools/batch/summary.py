"""What a batch says: how many runs failed and of which check, quantiles of each number, what made them fail.

How much an input decides is the correlation ratio: the share of a value's variance that lies between classes of the
input (Pearson 1905), less what chance puts there (epsilon squared, Kelley 1935). Classes are the levels, or up to ten
parts of a range with equally many runs. 1: it alone decides; 0: it says nothing on its own.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array, Index
from terrapin_hil.scenario.checks import parse_number
from terrapin_tools.batch.one_run import CONTACT_ERROR
from terrapin_tools.batch.table import Table

__all__ = ["QUANTILES", "Class", "Summary", "classes", "share_limits", "summarise"]

QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
PARTS = 10
FEWEST = 5  # runs in a part of a range
Z95 = 1.959963984540054
End = tuple[str, float | None, float | None]  # name of a class, its lower and upper end


@dataclass(frozen=True)
class Class:
    """Runs of like value of an input: its `name`, ends of the part (of a range), how many runs, how many failed."""

    name: str
    low: float | None
    high: float | None
    runs: int
    failed: int


@dataclass(frozen=True)
class Summary:
    """`decides`: what ("failed" or a number's text) -> input -> correlation ratio, by importance for failing."""

    runs: int
    failed: int
    errors: int
    reasons: Mapping[str, int]  # of those, by how many have it; two that differ in numbers alone are one
    limits: tuple[float, float]  # 95 % of the share that fails
    checks: Mapping[str, int]  # text -> runs in which it did not hold
    quantiles: Mapping[str, list[float | None]]
    units: Mapping[str, str]  # of those, where it is known
    missing: Mapping[str, int]  # runs in which the number had no value
    why_missing: Mapping[str, str]  # of those, in words
    decides: Mapping[str, Mapping[str, float]]
    classes: Mapping[str, list[Class]]

    def as_json(self) -> dict[str, Any]:
        """Plain values; None for what has none."""
        return asdict(self)


def share_limits(failed: int, runs: int) -> tuple[float, float]:
    """95 % limits of a share (Wilson 1927).

    >>> [round(limit, 4) for limit in share_limits(0, 100)]
    [0.0, 0.037]
    """
    if runs == 0:
        return 0.0, 1.0
    share, z = failed / runs, Z95**2 / runs
    middle = (share + z / 2) / (1 + z)
    half = math.sqrt(z * share * (1 - share) + z * z / 4) / (1 + z)
    return max(0.0, middle - half), min(1.0, middle + half)


def classes(values: Array | list[str]) -> tuple[Index, list[End]]:
    """The class of each run (runs,), and name, lower and upper end of each class.

    >>> classes(["a", "b", "a"])[0].tolist()
    [0, 1, 0]
    """
    if isinstance(values, list):
        names = list(dict.fromkeys(values))
        place = {name: i for i, name in enumerate(names)}
        return np.array([place[value] for value in values], dtype=np.int64), [(name, None, None) for name in names]
    levels = np.unique(values)
    if len(levels) <= PARTS:
        shown: list[End] = [(f"{level:g}", float(level), float(level)) for level in levels]
        return np.searchsorted(levels, values).astype(np.int64), shown
    parts = max(1, min(PARTS, len(values) // FEWEST))
    edges = np.quantile(values, np.linspace(0.0, 1.0, parts + 1))
    index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, parts - 1).astype(np.int64)
    ends: list[End] = [(f"{low:.3g} to {high:.3g}", float(low), float(high)) for low, high in pairwise(edges)]
    return index, ends


def _ratio(index: Index, values: Array) -> float:
    """Epsilon squared of `values` by class, both (runs,); 0 where nothing varies or chance explains it."""
    there = np.isfinite(values)
    index, values = index[there], values[there]
    total = float(np.sum((values - values.mean()) ** 2)) if len(values) else 0.0
    used, index = np.unique(index, return_inverse=True)
    if total <= 1e-24 * float(np.sum(values * values)) or len(values) <= len(used):
        return 0.0
    count = np.bincount(index)
    mean = np.bincount(index, weights=values) / count
    within = float(np.sum((values - mean[index]) ** 2))
    free = (len(values) - 1) / (len(values) - len(used))
    return max(0.0, 1.0 - within / total * free)


def _reasons(errors: Iterable[str]) -> dict[str, int]:
    """Each reason by its first text, and in how many runs it stands; the commonest first.

    >>> _reasons(["no value at 0.1 s", "", "killed", "no value at 0.2 s"])
    {'no value at 0.1 s': 2, 'killed': 1}
    """
    found: dict[str, list[str]] = {}
    for error in filter(None, errors):
        found.setdefault(re.sub(r"\d+(\.\d+)?(e[-+]?\d+)?", "#", error), []).append(error)
    return {same[0]: len(same) for same in sorted(found.values(), key=len, reverse=True)}


def _why_missing(text: str, values: Array, table: Table, duration: float | None) -> str:
    """Why a number has no value in some runs, "" where all have one."""
    gone = np.isnan(values)
    if not gone.any():
        return ""
    if all(error for error, none in zip(table.error, gone, strict=True) if none):
        return "they could not be run to the end"
    if text == CONTACT_ERROR:
        return "the controller called no C_t valid"
    late = parse_number(text).beyond(duration) if duration is not None else ""
    if late:
        return f"{late} begins after their end at {duration:g} s"
    return "what it is of did not come, or not within its time window"


def summarise(table: Table, duration: float | None = None) -> Summary:
    """The summary of a table with at least one run; `duration` [s] of the runs, where all last as long."""
    failed = ~table.passed
    why = {text: _why_missing(text, values, table, duration) for text, values in table.numbers.items()}
    found = {name: classes(values) for name, values in table.inputs.items()}
    outcomes: dict[str, Array] = {"failed": failed.astype(np.float64), **table.numbers}
    ratios = {
        what: {name: _ratio(index, values) for name, (index, _) in found.items()} for what, values in outcomes.items()
    }
    order = sorted(table.inputs, key=lambda name: -ratios["failed"][name])
    split = {}
    for name in order:
        index, ends = found[name]
        runs, bad = np.bincount(index, minlength=len(ends)), np.bincount(index, weights=failed, minlength=len(ends))
        split[name] = [Class(*end, int(n), int(k)) for end, n, k in zip(ends, runs, bad, strict=True)]
    return Summary(
        len(table),
        int(failed.sum()),
        sum(error != "" for error in table.error),
        _reasons(table.error),
        share_limits(int(failed.sum()), len(table)),
        {text: sum(value is False for value in held) for text, held in table.checks.items()},
        {text: _quantiles(values) for text, values in table.numbers.items()},
        {text: unit for text in table.numbers if (unit := table.units.get(text))},
        {text: int(np.isnan(values).sum()) for text, values in table.numbers.items()},
        {text: said for text, said in why.items() if said},
        {what: {name: of[name] for name in order} for what, of in ratios.items()},
        split,
    )


def _quantiles(values: Array) -> list[float | None]:
    there = values[~np.isnan(values)]
    if not len(there):
        return [None] * len(QUANTILES)
    return [float(value) if math.isfinite(value) else None for value in np.quantile(there, QUANTILES)]
