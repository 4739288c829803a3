"""Long recordings of correlated rows: what is looked at, and what is surely part of what is not explained."""

from __future__ import annotations

import doctest
import json
from pathlib import Path

import numpy as np
import pytest
from casekit import ar1, terrapin

from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare import thinned
from terrapin_tools.workbench.compare.comparison import analyse

CASE = """[model]
base = "equation"
[model.equation]
torque = "j*a"
[fit]
j = { value = 0.1, unit = "N m s^2/rad" }
[data]
files = ["d.csv"]
run = "run"
[data.columns]
v = { column = "v", unit = "rad/s", is = "speed" }
a = { column = "a", unit = "rad/s^2" }
torque = { column = "torque", unit = "N m" }
"""


def recording(folder: Path, rho: float, rows: int, dry: float = 0.0) -> Path:
    """Six runs of a swinging shaft, 100 rows a second, with noise that is alike from row to row."""
    random = np.random.default_rng(7)
    lines = ["run,v,a,torque"]
    for run in range(6):
        t = 0.01 * np.arange(rows)
        rates = random.uniform(1.0, 4.0, 3)
        v = sum(np.sin(w * t + p) for w, p in zip(rates, random.uniform(0.0, 6.0, 3), strict=True))
        a = np.gradient(v, 0.01)
        torque = 0.1 * a + dry * np.tanh(v / 0.1) + 0.05 * ar1(random, rows, rho)
        lines += [f"r{run},{x:.6g},{y:.6g},{z:.6g}" for x, y, z in zip(v, a, torque, strict=True)]
    folder.mkdir()
    (folder / "d.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(CASE)
    return folder


def test_examples() -> None:
    assert doctest.testmod(thinned).failed == 0


@pytest.mark.parametrize(("rho", "rows", "most"), [(0.9, 600, 10), (0.9, 100, 1), (0.0, 600, 1)])
def test_rows_a_correlation_length_apart_are_looked_at(tmp_path: Path, rho: float, rows: int, most: int) -> None:
    case = load_case(recording(tmp_path / "case", rho, rows))
    found = analyse(case)
    assert found.step == 1 if most == 1 else 4 <= found.step <= most
    kept = found.case.train | found.case.test | found.odd
    assert kept.sum() == 6 * -(-rows // found.step)
    for run in range(6):
        assert kept[case.run == run][0]  # a run begins with its first row
    assert found.adequacy.p_value > 0.01  # nothing is missing: below 0.05 it is once in twenty seeds


def test_friction_is_named_in_a_long_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = recording(tmp_path / "case", 0.9, 600, 0.1)
    status, out, _ = terrapin(capsys, "discover", folder, "--json", "-")
    assert status == 0
    answer = json.loads(out)
    named = {name for one in (answer["missing"], answer["part"], *answer["rivals"]) for name in one}
    assert named & {"coulomb_friction", "smooth_friction", "stiction"}
    status, out, _ = terrapin(capsys, "compare", folder)
    assert "One row of " in out


def test_of_a_long_table_some_rows_are_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thinned, "ENOUGH", 600)
    case = load_case(recording(tmp_path / "case", 0.0, 500, 0.1))  # 3,000 rows, white noise
    found = analyse(case)
    assert found.step == 5
    assert (found.case.train | found.case.test | found.odd).sum() == 600
    assert found.missing
