"""All rows behind a plot that is thinned, in a file beside the answer, so that a zoom is refined without a new fit.

keep(path, drawn, plot)           in the process that has fitted the model
within(path, plot, box)           in the server: the rows in a box of the plot, thinned where they are many
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from terrapin_hil.arrays import Array, thin
from terrapin_tools.errors import UserError

if TYPE_CHECKING:
    from terrapin_tools.workbench.story.plot_data import Drawn

__all__ = ["Box", "keep", "within"]

MOST_ROWS = 10_000  # of one answer
MOST_FILES = 4  # each some 8 bytes a row and column; the oldest make way
LINE = 400  # rows more, evenly over the width, so that a prediction is drawn where no measurement lies


@dataclass(frozen=True)
class Box:
    """What of a plot is looked at: a column (times another), a channel; `residual`: its residual in noise sd."""

    variable: str
    times: str
    channel: str
    residual: bool
    x: tuple[float, float]
    y: tuple[float, float]


def keep(path: Path, drawn: Drawn, plot: Mapping[str, Any]) -> None:
    """Writes what `plot` is thinned from, float64, a line for each of `_names(plot)`; nothing where nothing is."""
    if plot["kept"] == plot["rows"]:
        return
    from terrapin_tools.workbench.model.data_columns import numeric_columns  # the workbench, which a server has not

    columns, run = numeric_columns(drawn.case), drawn.case.run[drawn.rows]
    found = {f"column {name}": columns[name][drawn.rows] for name in plot["columns"] if name != "row"}
    found["run"] = np.searchsorted(np.unique(run), run).astype(np.float64)
    for name in (channel["name"] for channel in plot["channels"]):
        i = drawn.channels.index(name)
        found[f"predicted {name}"] = drawn.prediction[i]
        found[f"measured {name}"] = drawn.prediction[i] + drawn.residual[i]
        if drawn.base is not None:
            found[f"base {name}"] = drawn.base[i]
    part = path.with_suffix(f".{os.getpid()}.part")
    with part.open("wb") as file:
        np.save(file, np.array([found[name] for name in _names(plot)]))
    os.replace(part, path)
    files = sorted(path.parent.glob("*.npy"), key=lambda one: one.stat().st_mtime_ns)
    for old in files[:-MOST_FILES]:
        old.unlink(missing_ok=True)


def _names(plot: Mapping[str, Any]) -> list[str]:
    names = [f"column {name}" for name in plot["columns"] if name != "row"] + ["run"]
    for channel in plot["channels"]:
        kinds = ("predicted", "measured", *(("base",) if channel["base"] is not None else ()))
        names += [f"{kind} {channel['name']}" for kind in kinds]
    return names


def within(path: Path, plot: Mapping[str, Any], box: Box) -> dict[str, Any]:
    """The rows in a box as `plot_data.drawn_data` has them, of one channel: `columns` (those of the box, and `row`),
    `channel`, `run`; `rows` in the box, of which `kept` are told, and some beside them for the curve.

    UserError for a column or channel that the plot has not. OSError when the file has gone.
    """
    for name in (box.variable, *([box.times] if box.times else ())):
        if name not in plot["columns"]:
            raise UserError(f"rows: found no column {name[:60]!r}, expected one of {', '.join(plot['columns'])}")
    channel = next((one for one in plot["channels"] if one["name"] == box.channel), None)
    if channel is None:
        raise UserError(f"rows: found no channel {box.channel[:60]!r}")
    with suppress(OSError):
        os.utime(path)  # looked at: it goes last
    everything = np.load(path, mmap_mode="r")
    place = {name: number for number, name in enumerate(_names(plot))}

    def column(name: str) -> Array:
        if name == "row":
            return np.arange(1.0, everything.shape[1] + 1.0)
        return np.asarray(everything[place[f"column {name}"]])

    x = column(box.variable) * (column(box.times) if box.times else 1.0)
    wide = np.flatnonzero((x >= box.x[0]) & (x <= box.x[1]))
    measured = np.asarray(everything[place[f"measured {box.channel}"]])[wide]
    left = (measured - np.asarray(everything[place[f"predicted {box.channel}"]])[wide]) / (channel["noise_sd"] or 1.0)
    y = left if box.residual else measured
    inside = np.flatnonzero((y >= box.y[0]) & (y <= box.y[1]))
    some = inside
    if len(inside) > MOST_ROWS:  # the extremes of each stretch, and as many evenly: else a middle looks empty
        half = MOST_ROWS // 2
        worst = thin(left[None, inside], half)
        some = inside[np.union1d(worst, np.linspace(0, len(inside) - 1, half).astype(int))]
    told = np.union1d(some, np.argsort(x[wide])[np.linspace(0, len(wide) - 1, LINE).astype(int)] if len(wide) else some)
    rows = wide[told.astype(int)]

    def numbers(values: Array) -> list[float]:
        return [float(f"{v:.9g}") for v in values]

    shown = dict.fromkeys((box.variable, *([box.times] if box.times else ()), "row"))
    kinds = [kind for kind in ("measured", "predicted", "base") if f"{kind} {box.channel}" in place]
    return {
        "columns": {name: {**plot["columns"][name], "values": numbers(column(name)[rows])} for name in shown},
        "channel": {"base": None}
        | {kind: numbers(np.asarray(everything[place[f"{kind} {box.channel}"]])[rows]) for kind in kinds},
        "run": np.asarray(everything[place["run"]])[rows].astype(int).tolist(),
        "rows": len(inside),
        "kept": len(some),
    }
