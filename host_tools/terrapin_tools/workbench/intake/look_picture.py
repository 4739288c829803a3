"""A picture of what a file holds: each column over time, with its gaps and stretches that may be steady."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from terrapin_tools.errors import UserError
from terrapin_tools.figure_style import PANELS, picture
from terrapin_tools.workbench.files.tables import Table

__all__ = ["draw"]

MOST = 12  # columns
POINTS = 4000  # of a line: more are thinned to the least and greatest of each stretch


def draw(table: Table, answer: dict[str, Any], file: Path) -> None:
    """Write `file` (.png or .svg). UserError for a table without a column of numbers."""
    time = answer["time"]
    shown = [c for c in answer["columns"] if not c["text"] and not (time and c["column"] == time["column"])]
    shown = sorted(shown, key=lambda column: column["constant"])[:MOST]
    if not shown:
        raise UserError(f"{table.path.name}: found no column of numbers, expected one to draw")
    at = table.numbers(time["column"], gaps=True) if time else np.arange(1.0, table.rows + 1)
    with picture(file, (8.0, 1.0 + 1.1 * len(shown)), PANELS) as figure:
        panels = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for panel, column in zip(panels, shown, strict=True):
            values = table.numbers(column["column"], gaps=True)
            rows = _thinned(values)
            panel.plot(at[rows], values[rows], linewidth=0.7)
            for stretch in answer["steady"]:
                first, last = stretch["rows"]
                panel.axvspan(at[first], at[last - 1], color="tab:green", alpha=0.12, linewidth=0)
            for gap in time["gaps"] if time else []:
                panel.axvspan(gap["begin"], gap["begin"] + gap["lasts"], color="tab:red", alpha=0.15, linewidth=0)
            unit = answer["units"].get(column["column"], column["unit"])
            panel.set_ylabel(f"{column['name'].rpartition('.')[2][:14]}\n{f'[{unit}]' if unit else ''}", fontsize=7)
            panel.tick_params(labelsize=7)
        panels[-1].set_xlabel(f"{time['column']} [{time['unit']}]" if time else "row")
        panels[0].set_title(f"{table.path.name}: green may be steady, red is a gap in time", fontsize=8)


def _thinned(values: Any) -> Any:
    """Rows that a line of POINTS shows: the least and the greatest of each stretch."""
    if len(values) <= POINTS:
        return np.arange(len(values))
    width = -(-len(values) // (POINTS // 2))
    padded = np.pad(np.nan_to_num(values), (0, -len(values) % width), mode="edge").reshape(-1, width)
    begin = np.arange(len(padded)) * width
    ends = np.stack([begin + padded.argmin(1), begin + padded.argmax(1)], 1)
    return np.unique(np.minimum(ends, len(values) - 1))
