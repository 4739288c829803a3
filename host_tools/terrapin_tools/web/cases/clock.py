"""Whether a column of time runs as a clock does: duplicates, steps back, jumps. A new run may begin anywhere."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_tools.workbench.files.tables import Table

__all__ = ["Clock"]

JUMP = 20.0  # times the usual step
FEW = 10  # steps from which there is a usual one


class Clock:
    """Takes a column piece by piece.

    >>> clock = Clock("s")
    >>> clock.take(np.array([0.0, 1.0, 1.0, 2.0]), None, None)
    >>> clock.warnings("t")
    ['column t: 1 time stamp stands twice in a run (first at row 3)']
    """

    def __init__(self, unit: str) -> None:
        self.unit = unit
        self._last: tuple[float, str] | None = None
        self._rows = 0
        self._found: Counter[str] = Counter()
        self._places: dict[str, str] = {}
        self._usual: float | None = None
        self._widest = 0.0

    def take(self, times: npt.NDArray[np.float64], runs: npt.NDArray[Any] | None, table: Table | None) -> None:
        """The next rows. `runs`: the run of each; without it all are of one. `table` knows where a row stands."""
        if not times.size:
            return
        names = runs.astype(str) if runs is not None else np.full(len(times), "")
        before = [self._last] if self._last is not None else []
        steps = np.diff(np.concatenate([[t for t, _ in before], times]))
        alike = np.concatenate([[n for _, n in before], names])
        inside = alike[1:] == alike[:-1]
        offset = 1 - len(before)
        self._count("same", inside & (steps == 0.0), offset, table)
        self._count("back", inside & (steps < 0.0), offset, table)
        forward = steps[inside & (steps > 0.0)]
        if self._usual is None and forward.size >= FEW:
            self._usual = float(np.median(forward))
        if self._usual is not None:
            self._count("jumps", inside & (steps > JUMP * self._usual), offset, table)
            if forward.size:
                self._widest = max(self._widest, float(forward.max()))
        self._last = (float(times[-1]), str(names[-1]))
        self._rows += len(times)

    def _count(self, kind: str, found: npt.NDArray[np.bool_], offset: int, table: Table | None) -> None:
        if not found.any():
            return
        self._found[kind] += int(found.sum())
        row = int(np.argmax(found)) + offset
        place = table.place(row) if table is not None else f"row {self._rows + row + 1}"
        self._places.setdefault(kind, place)

    def warnings(self, column: str) -> list[str]:
        """What is odd, a line each."""
        found = []
        same, back, jumps = (self._found[kind] for kind in ("same", "back", "jumps"))
        if same:
            stamps = "time stamp stands" if same == 1 else "time stamps stand"
            found.append(f"column {column}: {same} {stamps} twice in a run (first at {self._places['same']})")
        if back:
            found.append(
                f"column {column}: the clock steps back {back} times in a run (first at {self._places['back']})"
            )
        if jumps:
            found.append(
                f"column {column}: the clock jumps {jumps} times in a run, by {self._widest:.4g} {self.unit}, "
                f"and {self._usual:.4g} is usual (first at {self._places['jumps']})"
            )
        return found
