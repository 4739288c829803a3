"""The two panels of a picture of the soil's commands, in a file whose bytes are the same each time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from terrapin_tools.figure_style import STYLE

__all__ = ["panels"]


@contextmanager
def panels(file: Path, size: tuple[float, float], widths: Sequence[float] = (1, 1)) -> Iterator[tuple[Any, Any]]:
    """Left and right axes to draw on; `file` (.png or .svg) is written at the end. `size` in inches."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    with pyplot.rc_context(STYLE | {"legend.fontsize": 8}):
        figure, (left, right) = pyplot.subplots(1, 2, figsize=size, layout="constrained", width_ratios=widths)
        yield left, right
        figure.savefig(file, metadata={"Date": None} if file.suffix.lower() == ".svg" else {"Software": None}, dpi=110)
        pyplot.close(figure)
