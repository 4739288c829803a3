"""The numbers behind the report's plots: rows, thinned where there are many; curves of candidates; who carries what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import thin
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.compare.comparison import Analysis, predict
from terrapin_tools.workbench.compare.refit import refit
from terrapin_tools.workbench.model.data_columns import numeric_columns
from terrapin_tools.workbench.story.answer import places
from terrapin_tools.workbench.story.story import Place, Rung, Story

__all__ = ["CARDS", "MAX_ROWS", "Drawn", "Preview", "drawn_data", "page_data", "previews"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

MAX_ROWS = 20_000
MAX_NUMBERS = 220_000  # of all arrays together: some 1.8 MB of text
MAX_COLUMNS = 40
MAX_PREVIEWS = 8
CARDS = 4  # candidates shown in full
HEAT_COLUMNS, HEAT_BINS, HEAT_RUNS = 8, 12, 60


@dataclass(frozen=True)
class Preview:
    """What the model would predict with a set of effects added, on all rows (channels, rows)."""

    effects: tuple[str, ...]
    prediction: Array


@dataclass(frozen=True)
class Drawn:
    """What of a fitted model is drawn; arrays (channels, rows) over all rows that are trained on or held out."""

    case: Case
    rows: Mask
    channels: tuple[str, ...]
    sigma: Array  # (channels,)
    prediction: Array
    residual: Array
    base: Array | None  # prediction of the base model, where effects have been added to it

    @classmethod
    def of(cls, analysis: Analysis, story: Story) -> Drawn:
        base = predict(analysis.ladder[0].fit, analysis.rows) if analysis.case.effects else None
        sigma = np.array([story.noise.sds[name] for name in analysis.model.channels])
        prediction = analysis.prediction
        return cls(
            analysis.case, analysis.rows, tuple(analysis.model.channels), sigma, prediction, analysis.residual, base
        )


def previews(analysis: Analysis, story: Story) -> list[Preview]:
    """Refits with what is missing, with each rival, and with the likeliest candidates alone, in this order."""
    found = story.found
    if found is None:
        return []
    cards = CARDS if found.verdict != "adequate" else CARDS // 2
    sets = [found.missing, *found.rivals, *((one.effect,) for one in found.candidates[:cards])]
    own = {one.effect: one.own for one in found.candidates}
    different = [one for one in dict.fromkeys(sets) if one][:MAX_PREVIEWS]
    fits = [(one, refit(analysis.case, analysis.noise.sigma, own, one)) for one in different]
    return [Preview(one, predict(fit, analysis.rows)) for one, fit in fits if fit is not None]


def page_data(analysis: Analysis, story: Story, shown: Sequence[Preview]) -> dict[str, Any]:
    """Everything that the page's script draws."""
    return drawn_data(Drawn.of(analysis, story), story.where, story.ladder, shown)


def drawn_data(
    drawn: Drawn, where: Sequence[Place], ladder: Sequence[Rung], shown: Sequence[Preview]
) -> dict[str, Any]:
    """The same of a model that is fitted and perhaps not yet judged, with `where` it fails and its errors."""
    case, rows, base = drawn.case, drawn.rows, drawn.base
    columns = numeric_columns(case)
    names = _order(drawn, where, columns)
    order = list(drawn.channels)
    failing = where[0].channel if where else order[0]
    order.sort(key=lambda name: name != failing)
    arrays = len(names) + 2 + len(order) * (2 + (base is not None) + len(shown))
    scaled = drawn.residual / drawn.sigma[:, None]
    kept = thin(scaled, min(MAX_ROWS, MAX_NUMBERS // arrays))

    def numbers(values: Array) -> list[float]:
        return [float(f"{v:.6g}") for v in values[kept]]

    def channel(name: str) -> dict[str, Any]:
        i = drawn.channels.index(name)
        return {
            "name": name,
            "unit": case.units[name],
            "noise_sd": float(drawn.sigma[i]),
            "measured": numbers(drawn.prediction[i] + drawn.residual[i]),
            "predicted": numbers(drawn.prediction[i]),
            "base": None if base is None else numbers(base[i]),
            "previews": [numbers(preview.prediction[i]) for preview in shown],
        }

    run, held = case.run[rows], case.test[rows]
    present = np.unique(run)
    return {
        "variable": names[0] if names else "row",
        "columns": {
            **{n: {"values": numbers(columns[n][rows]), "unit": case.units.get(n, "")} for n in names},
            "row": {"values": [int(i) + 1 for i in kept], "unit": ""},
        },
        "channels": [channel(name) for name in order],
        "previews": [" + ".join(preview.effects) for preview in shown],
        "sets": [preview.effects for preview in shown],
        "runs": [case.run_names[i] for i in present],
        "run": np.searchsorted(present, run[kept]).tolist(),
        "held": [bool(held[run == i].any()) for i in present],
        "where": places(where),
        "ladder": [vars(rung) for rung in ladder],
        "heat": _heat(drawn, names[:HEAT_COLUMNS], columns, order, present),
        "rows": len(run),
        "kept": len(kept),
    }


def _order(drawn: Drawn, where: Sequence[Place], columns: dict[str, Array]) -> list[str]:
    """Columns worth looking at, the one on which the residual depends most first; those that do not vary left out."""
    case = drawn.case
    wanted = [place.variable for place in where]
    wanted += [role for role in (*case.base.needs, *case.roles, *case.extra) if role in columns]
    return [n for n in dict.fromkeys(wanted) if n in columns and np.ptp(columns[n][drawn.rows]) > 0][:MAX_COLUMNS]


def _heat(
    drawn: Drawn, names: list[str], columns: dict[str, Array], channels: list[str], present: npt.NDArray[np.int64]
) -> dict[str, Any]:
    """Mean residual in noise sd by run and range of a column, over all rows; the worst runs where there are many."""
    case, rows = drawn.case, drawn.rows
    scaled = drawn.residual / drawn.sigma[:, None]
    run = np.searchsorted(present, case.run[rows])
    square = np.bincount(run, (scaled**2).mean(axis=0), len(present)) / np.bincount(run, minlength=len(present))
    worst = np.sort(np.argsort(-square)[:HEAT_RUNS])
    found: dict[str, Any] = {"runs": worst.tolist(), "rms": [float(f"{v:.3g}") for v in np.sqrt(square[worst])]}
    for name in names:
        values = columns[name][rows]
        distinct = np.unique(values)
        if len(distinct) <= HEAT_BINS:
            edges = np.concatenate([distinct, [distinct[-1]]])
            place = np.searchsorted(distinct, values)
        else:
            edges = np.unique(np.quantile(values, np.linspace(0, 1, HEAT_BINS + 1)))
            place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        bins = len(edges) - 1
        cell = run * bins + place
        count = np.bincount(cell, minlength=bins * len(present))
        with np.errstate(invalid="ignore"):
            means = {
                c: np.bincount(cell, scaled[drawn.channels.index(c)], bins * len(present)) / count for c in channels
            }
        found[name] = {
            "edges": [float(f"{v:.5g}") for v in edges],
            "single": len(distinct) <= HEAT_BINS,
            "mean": {c: _rows(v.reshape(-1, bins)[worst]) for c, v in means.items()},
            "count": count.reshape(-1, bins)[worst].tolist(),
        }
    return {"runs": found.pop("runs"), "rms": found.pop("rms"), "columns": found}


def _rows(values: Array) -> list[list[float | None]]:
    return [[float(f"{v:.3g}") if np.isfinite(v) else None for v in row] for row in values]
