"""How Matplotlib draws every picture of the tools: few lines, and the same bytes each time."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from terrapin_tools.extras import need

__all__ = ["PANELS", "STYLE", "need_pictures", "picture"]

STYLE: Any = {  # of the keys that Matplotlib knows
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "svg.hashsalt": "terrapin",
}
PANELS = {"legend.fontsize": 8, "figure.dpi": 110}  # of panels side by side


def need_pictures(what: str) -> None:
    """UserError where nothing can be drawn; asked before long work whose end is a picture."""
    need(what, "matplotlib", "pictures")


@contextmanager
def picture(file: Path, size: tuple[float, float], style: Any) -> Iterator[Any]:
    """A figure to draw on, `size` in inches; `file` (.png or .svg) is written at the end. `style`: more than STYLE.

    UserError: Matplotlib is not there.
    """
    need_pictures(str(file))
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(STYLE | style):
        figure = Figure(figsize=size, layout="constrained")
        yield figure
        kind, page = file.suffix.lower().removeprefix("."), io.BytesIO()
        figure.savefig(page, format=kind, metadata={"Date": None} if kind == "svg" else {"Software": None})
    try:
        file.write_bytes(page.getvalue())
    except OSError as error:  # a full disk's does not say which file
        raise type(error)(error.errno, error.strerror, str(file)) from None
