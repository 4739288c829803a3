"""Plots of a case's fit on axes of Matplotlib: what a program asks for, with nothing global touched."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from terrapin_tools.errors import UserError
from terrapin_tools.figure_style import STYLE, need_pictures
from terrapin_tools.workbench.compare.comparison import Analysis
from terrapin_tools.workbench.model.data_columns import numeric_columns
from terrapin_tools.workbench.story.story import Story

__all__ = ["KINDS", "drawn"]

BLUE, TEAL, RED, MUTE = "#2a66d1", "#0d7a70", "#c73650", "#5b6573"  # of the page
BAND = 1.96  # noise sd on either side: 95 %


def drawn(analysis: Analysis, story: Story, kind: str, against: str, channel: str, ax: Any) -> Any:
    """The figure, or `ax` where one is given. UserError for a kind, a column or a channel that is none."""
    if kind not in KINDS:
        raise UserError(f"plot: found {kind!r}, expected one of {', '.join(KINDS)}")
    need_pictures("a plot")
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    channel = channel or analysis.model.channels[0]
    if channel not in analysis.model.channels:
        raise UserError(f"channel: found {channel!r}, expected one of {', '.join(analysis.model.channels)}")
    if ax is not None:
        KINDS[kind](analysis, story, against, channel, ax)
        return ax
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.0), layout="constrained")
        axes = figure.subplots()
        KINDS[kind](analysis, story, against, channel, axes)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)  # above: it hides no point
    return figure


def _column(analysis: Analysis, against: str) -> tuple[str, Any]:
    """A column by its name, with its axis' label: that in which the model fails most where none is named."""
    columns: dict[str, Any] = {name: values[analysis.rows] for name, values in numeric_columns(analysis.case).items()}
    columns["row"] = np.flatnonzero(analysis.rows) + 1.0
    varying = [name for name, values in columns.items() if np.ptp(values) > 0]
    name = against or next((one.variable for one in analysis.where if one.variable in columns), varying[0])
    if name not in columns:
        raise UserError(f"against: found {name!r}, expected one of {', '.join(columns)}")
    return _label(name, analysis.case.units.get(name, "")), columns[name]


def _label(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit not in ("", "1") else name


def _points(analysis: Analysis, x: Any, y: Any, ax: Any) -> None:
    held = analysis.case.test[analysis.rows]
    ax.plot(x[~held], y[~held], "o", color=MUTE, ms=3, mew=0, label="training")
    ax.plot(x[held], y[held], "D", color=MUTE, ms=4, mfc="none", label="held out")


def _residual(analysis: Analysis, story: Story, against: str, channel: str, ax: Any) -> None:
    """Measured - predicted; the band holds 95 % of the noise."""
    label, x = _column(analysis, against)
    row, unit = analysis.model.channels.index(channel), analysis.case.units[channel]
    sigma = float(analysis.told.sigma[row])
    ax.axhspan(-BAND * sigma, BAND * sigma, color=TEAL, alpha=0.14, lw=0, label="noise, 95 %")
    ax.axhline(0.0, color=BLUE, lw=1)
    _points(analysis, x, analysis.residual[row], ax)
    ax.set_xlabel(label)
    ax.set_ylabel(_label(f"measured - predicted {channel}", unit))
    ax.legend()


def _prediction(analysis: Analysis, story: Story, against: str, channel: str, ax: Any) -> None:
    """Measured and predicted values."""
    label, x = _column(analysis, against)
    row, unit = analysis.model.channels.index(channel), analysis.case.units[channel]
    # wide and pale, below the measurements: neither hides the other
    ax.plot(x, analysis.prediction[row], "o", color=BLUE, alpha=0.35, ms=6, mew=0, label="model")
    _points(analysis, x, analysis.prediction[row] + analysis.residual[row], ax)
    ax.set_xlabel(label)
    ax.set_ylabel(_label(channel, unit))
    ax.legend()


def _ladder(analysis: Analysis, story: Story, against: str, channel: str, ax: Any) -> None:
    """Errors in noise sd, step by step."""
    names = [rung.added or "(base model)" for rung in story.ladder]
    ax.plot(names, [rung.train_error for rung in story.ladder], "o-", color=MUTE, label="training")
    held = [np.nan if rung.heldout_error is None else rung.heldout_error for rung in story.ladder]
    ax.plot(names, held, "D-", color=BLUE, label="held out")
    ax.axhline(1.0, color=TEAL, lw=1, label="noise floor" if story.noise.floor else "noise sd")
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("error [noise sd]")
    ax.legend()


KINDS: dict[str, Callable[[Analysis, Story, str, str, Any], None]] = {
    "residual": _residual,
    "prediction": _prediction,
    "ladder": _ladder,
}
