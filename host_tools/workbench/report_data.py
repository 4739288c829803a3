"""The numbers behind the report's plots: rows, thinned where there are many; curves of candidates; who carries what."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from host_tools.errors import UserError
from host_tools.workbench.analysis import Analysis, fitted_on, predict
from host_tools.workbench.case import Case, parse_case
from host_tools.workbench.directions import numeric_columns
from host_tools.workbench.edit import OwnEffect, OwnParameter, add_effects
from host_tools.workbench.fit import Fit

__all__ = ["CARDS", "Drawn", "Preview", "drawn_data", "page_data", "previews", "refit"]

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
    def of(cls, analysis: Analysis) -> Drawn:
        base = predict(analysis.ladder[0].fit, analysis.rows) if analysis.case.effects else None
        sigma, prediction = analysis.noise.sigma, analysis.prediction
        return cls(
            analysis.case, analysis.rows, tuple(analysis.model.channels), sigma, prediction, analysis.residual, base
        )


def previews(analysis: Analysis, answer: dict[str, Any] | None) -> list[Preview]:
    """Refits with what is missing, with each rival, and with the likeliest candidates alone, in this order."""
    if answer is None:
        return []
    sets = [tuple(answer["missing"]), *(tuple(effects) for effects in answer["rivals"])]
    cards = CARDS if answer["verdict"] != "adequate" else CARDS // 2
    sets += [(candidate["effect"],) for candidate in answer["candidates"][:cards]]
    found: list[Preview] = []
    for effects in dict.fromkeys(one for one in sets if one):
        if len(found) == MAX_PREVIEWS:
            break
        fit = refit(analysis.case, analysis.noise.sigma, answer, effects)
        if fit is not None:
            found.append(Preview(effects, predict(fit, analysis.rows)))
    return found


def refit(case: Case, sigma: Array, answer: dict[str, Any], effects: tuple[str, ...]) -> Fit | None:
    """The case's model with further effects, fitted on its training runs; None when it gives no prediction.

    `sigma` (channels,) is the noise sd; `answer`, of discover, has the expressions among the effects.
    """
    own = {
        candidate["effect"]: OwnEffect(
            candidate["expression"],
            candidate["target"],
            {
                name: OwnParameter(float(p["value"]), p.get("min"), p.get("max"), p.get("unit", "1"))
                for name, p in candidate["parameters"].items()
            },
        )
        for candidate in answer["candidates"]
        if candidate["effect"] in effects and candidate["effect"] not in case.library
    }
    try:
        larger = parse_case(case.folder, add_effects(case.text, effects, own))
    except UserError:  # a proposal that case.toml cannot hold: its card stands without a curve
        return None
    fit = fitted_on(larger, larger.effects, larger.train, sigma)[-1]
    return fit if bool(np.isfinite(predict(fit, case.train | case.test)).all()) else None


def page_data(analysis: Analysis, answer: dict[str, Any], shown: list[Preview]) -> dict[str, Any]:
    """Everything that the page's script draws. `answer`: of discover, else of compare."""
    return drawn_data(Drawn.of(analysis), answer, shown)


def drawn_data(drawn: Drawn, answer: dict[str, Any], shown: list[Preview]) -> dict[str, Any]:
    """The same of a model that is fitted and not yet judged, with an answer that has `where` and `ladder` only."""
    case, rows, base = drawn.case, drawn.rows, drawn.base
    columns = numeric_columns(case)
    names = _order(drawn, answer, columns)
    order = list(drawn.channels)
    failing = answer["where"][0]["channel"] if answer["where"] else order[0]
    order.sort(key=lambda name: name != failing)
    arrays = len(names) + 2 + len(order) * (2 + (base is not None) + len(shown))
    scaled = drawn.residual / drawn.sigma[:, None]
    kept = _thin(scaled, min(MAX_ROWS, MAX_NUMBERS // arrays))

    def numbers(values: Array) -> list[float]:
        return [float(f"{v:.6g}") for v in values[kept]]

    run = case.run[rows]
    present = np.unique(run)
    channels = []
    for name in order:
        i = drawn.channels.index(name)
        channels.append(
            {
                "name": name,
                "unit": case.units[name],
                "noise_sd": float(drawn.sigma[i]),
                "measured": numbers(drawn.prediction[i] + drawn.residual[i]),
                "predicted": numbers(drawn.prediction[i]),
                "base": None if base is None else numbers(base[i]),
                "previews": [numbers(preview.prediction[i]) for preview in shown],
            }
        )
    held = case.test[rows]
    return {
        "variable": names[0] if names else "row",
        "columns": {
            **{n: {"values": numbers(columns[n][rows]), "unit": case.units.get(n, "")} for n in names},
            "row": {"values": [int(i) + 1 for i in kept], "unit": ""},
        },
        "channels": channels,
        "previews": [" + ".join(preview.effects) for preview in shown],
        "runs": [case.run_names[i] for i in present],
        "run": np.searchsorted(present, run[kept]).tolist(),
        "held": [bool(held[run == i].any()) for i in present],
        "where": answer["where"],
        "ladder": answer["ladder"],
        "heat": _heat(drawn, names[:HEAT_COLUMNS], columns, order, present),
        "rows": len(run),
        "kept": len(kept),
    }


def _order(drawn: Drawn, answer: dict[str, Any], columns: dict[str, Array]) -> list[str]:
    """Columns worth looking at, the one on which the residual depends most first; those that do not vary left out."""
    case = drawn.case
    wanted = [failure["variable"] for failure in answer["where"]]
    wanted += [role for role in (*case.base.needs, *case.roles, *case.extra) if role in columns]
    return [n for n in dict.fromkeys(wanted) if n in columns and np.ptp(columns[n][drawn.rows]) > 0][:MAX_COLUMNS]


def _thin(scaled: Array, limit: int) -> npt.NDArray[np.int64]:
    """Rows to draw: all, or of equal stretches the two with the lowest and highest residual, so that none hides."""
    count = scaled.shape[1]
    if count <= limit:
        return np.arange(count)
    edges = np.linspace(0, count, max(1, limit // (2 * len(scaled))) + 1).astype(int)
    kept = set()
    for channel in scaled:
        for low, high in pairwise(edges.tolist()):
            if high > low:
                kept |= {low + int(np.argmin(channel[low:high])), low + int(np.argmax(channel[low:high]))}
    return np.array(sorted(kept))


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
