"""How the pages' figures are drawn: one style, SVG with the same bytes every time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

from terrapin_tools.figure_style import STYLE
from terrapin_tools.papers.part import Figure

matplotlib.use("Agg")
from matplotlib import pyplot

__all__ = ["AMBER", "BLUE", "GREEN", "GREY", "RED", "save"]

BLUE, RED, GREY, GREEN, AMBER = "#2458b8", "#c0334d", "#6b7280", "#0d7a5f", "#b7791f"
SMALL: Any = {"font.size": 9, "axes.titlesize": 9, "legend.fontsize": 8}


def save(figure: Figure, folder: Path) -> Path:
    """Draw it into folder/NAME.svg."""
    with pyplot.rc_context(STYLE | SMALL):
        canvas: Any = pyplot.figure(figsize=figure.size, layout="constrained")
        figure.draw(canvas)
        file = folder / f"{figure.name}.svg"
        canvas.savefig(file, metadata={"Date": None})
        pyplot.close(canvas)
    return file
