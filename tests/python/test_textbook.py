"""A formula that imitates a catalogued effect and a small rest gives way to the effect's name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.discover.discovery import discover

CASE = """[model]
base = "equation"
[model.equation]
voltage = "v0"
[fit]
v0 = { value = 10.0, unit = "V" }
[data]
files = ["d.csv"]
run = "run"
[data.columns]
current = { column = "i", unit = "A", is = "current" }
speed = { column = "n", unit = "rpm" }
voltage = { column = "u", unit = "V", sigma = 0.0005 }
"""


def supply(folder: Path, rest: float) -> Path:
    """A supply of 30 mohm whose runs differ by 1 mV; `rest` [ohm] more at low speed."""
    random = np.random.default_rng(6)
    lines = ["run,i,n,u"]
    for run in range(20):
        offset, slow = 0.001 * random.standard_normal(), random.uniform(1000.0, 6000.0)
        for step in range(11):
            current = 0.4 + (0.4 + 0.03 * run) * step
            speed = slow * np.sqrt(current)
            resistance = 0.03 + rest * np.exp(-speed / 4000.0)
            voltage = 7.4 + offset - resistance * current + 0.0005 * random.standard_normal()
            lines.append(f"m{run:02d},{current:.6g},{speed:.6g},{voltage:.7g}")
    folder.mkdir()
    (folder / "d.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(CASE)
    return folder


@pytest.mark.parametrize("rest", [0.0, 0.0003])
def test_a_small_rest_does_not_hide_a_resistance(tmp_path: Path, rest: float) -> None:
    found = discover(load_case(supply(tmp_path / "case", rest)))
    assert (found.verdict, found.missing) == ("missing", ("resistance",))
    assert found.ladder[-1].fit.theta[-1] == pytest.approx(-0.03, rel=0.05)


def test_what_is_no_small_rest_is_not_left_out(tmp_path: Path) -> None:
    found = discover(load_case(supply(tmp_path / "case", 0.06)))
    assert "resistance" in found.missing
    assert len(found.missing) > 1
