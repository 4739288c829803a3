"""How Matplotlib draws every picture of the tools: few lines, and SVG with the same bytes each time."""

from __future__ import annotations

from typing import Any

__all__ = ["STYLE"]

STYLE: Any = {  # of the keys that Matplotlib knows
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "svg.hashsalt": "terrapin",
}
