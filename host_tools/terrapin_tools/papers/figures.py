"""How the pages' figures are drawn: one style, SVG with the same bytes every time."""

from __future__ import annotations

from pathlib import Path

from terrapin_tools.figure_style import picture
from terrapin_tools.papers.part import Figure

__all__ = ["AMBER", "BLUE", "GREEN", "GREY", "RED", "save"]

BLUE, RED, GREY, GREEN, AMBER = "#2458b8", "#c0334d", "#6b7280", "#0d7a5f", "#b7791f"
SMALL = {"font.size": 9, "axes.titlesize": 9, "legend.fontsize": 8}


def save(figure: Figure, folder: Path) -> Path:
    """Draw it into folder/NAME.svg."""
    file = folder / f"{figure.name}.svg"
    with picture(file, figure.size, SMALL) as canvas:
        figure.draw(canvas)
    return file
