"""A picture of how two recordings were brought together: the matched columns, and the correlation over offsets."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from terrapin_tools.figure_style import PANELS, picture
from terrapin_tools.workbench.intake.merging import Merged

__all__ = ["draw"]


def draw(merged: Merged, file: Path) -> None:
    """Write `file` (.png or .svg)."""
    found, (times, slow, fast) = merged.offset, merged.overlay
    with picture(file, (8.0, 6.5), PANELS) as figure:
        above, middle, below = figure.subplots(3, 1)
        scaled = np.full(len(fast), np.nan)
        good = np.isfinite(slow) & np.isfinite(fast)
        if good.sum() > 2:
            gain, level = np.polyfit(fast[good], slow[good], 1)
            scaled = level + gain * fast
        above.plot(times, slow, linewidth=0.8, label=merged.answer["match"][0])
        above.plot(times, scaled, linewidth=0.8, label=f"{merged.answer['match'][1]}, scaled")
        above.legend(loc="upper right")
        above.set_xlabel("time since the grid's first row [s]")
        middle.plot(times, slow - scaled, linewidth=0.6, color="tab:gray")
        middle.set_ylabel("difference")
        middle.set_xlabel("time since the grid's first row [s]")
        below.plot(found.lags, found.correlations, linewidth=0.8)
        below.axvline(found.offset, color="tab:red", linewidth=0.8)
        below.axvspan(
            found.offset - 2 * found.offset_sd,
            found.offset + 2 * found.offset_sd,
            color="tab:red",
            alpha=0.2,
            linewidth=0,
        )
        below.set_xlabel("offset of the clocks, each from its own first row on [s]; red: the one taken, 2 sd")
        below.set_ylabel("correlation")
        words = merged.told
        above.set_title("\n".join(words[i : i + 110] for i in range(0, min(len(words), 330), 110)), fontsize=7)
