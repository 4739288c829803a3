"""Zero points of the columns of an equation: which there are, and one that is found, added and right."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from casekit import terrapin

from terrapin_hil.physics.expression import parse
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.case.instruments import zero_points
from terrapin_tools.workbench.discover.discovery import discover

CASE = """[case]
title = "Count rate over distance"

[model]
base = "equation"

[model.equation]
rate = "a/d**2 + b"

[fit]
a = { value = 1.0, unit = "1/s m^2" }
b = { value = 0.1, unit = "1/s" }

[data]
files = ["runs.csv"]
run = "run"

[data.columns]
d = { column = "distance", unit = "mm" }
rate = { column = "rate", unit = "1/s" }
"""


def count_rates(folder: Path, zero: float, seed: int) -> Path:
    """A source `zero` mm behind the face that the distance is counted from."""
    random, lines = np.random.default_rng(seed), ["run,distance,rate"]
    for run in range(10):
        for distance in np.linspace(40.0, 250.0, 14):
            rate = 3.0 / (1e-3 * (distance + zero)) ** 2 + 12.0
            lines.append(f"r{run},{distance:g},{rate + 4.0 * random.standard_normal():.6g}")
    folder.mkdir()
    (folder / "case.toml").write_text(CASE)
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    return folder


def test_columns_in_which_a_formula_is_not_linear_have_one() -> None:
    x = np.linspace(0.1, 2.0, 20)
    columns = {"x": x, "v": x[::-1], "z": x**2, "d": x}
    found = zero_points({"f": parse("k*x + c*v*abs(v) + m*sqrt(z)*d")}, columns, dict.fromkeys(columns, "m"))
    assert sorted(found) == ["zero_of_d", "zero_of_v", "zero_of_z"]
    assert found["zero_of_v"].parameters[0].name == "d_"  # d is a column
    assert found["zero_of_z"].parameters[0].maximum == pytest.approx(0.5 * np.ptp(x**2))


def test_a_source_that_lies_deeper_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = count_rates(tmp_path / "case", zero=12.0, seed=3)
    found = discover(load_case(folder))
    assert found.verdict == "missing"
    assert found.missing == ("zero_of_d",)
    status, out, _ = terrapin(capsys, "add", folder, "zero_of_d", "--json", tmp_path / "a.json")
    assert status == 0
    assert "[no alarm]" in out
    size = json.loads((tmp_path / "a.json").read_text())["parameters"]["zero_of_d.d_"]
    assert size["unit"] == "mm"
    assert size["value"] == pytest.approx(12.0, abs=4 * size["sd"])


def test_a_source_that_lies_where_it_should_has_no_zero_point(tmp_path: Path) -> None:
    assert discover(load_case(count_rates(tmp_path / "case", zero=0.0, seed=4))).verdict == "adequate"
