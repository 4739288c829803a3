"""The pool of MuJoCo rigs: its cases hold what they say, and one of them is answered."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed: no rigs to draw")

from terrapin_tools.workbench.case.case import load_case
from tests.campaigns.mujoco_rigs import FEATURES, RUNS, SEEN, draw, one, table


def columns(folder: Path) -> dict[str, np.ndarray]:
    with (folder / "rows.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name != "run"}


@pytest.mark.parametrize("name", FEATURES)
def test_a_rig_holds_what_its_model_lacks(tmp_path: Path, name: str) -> None:
    drawn = draw(name, 0, 5, tmp_path / "case")
    case = load_case(drawn.folder)
    assert len(case.run_names) == RUNS
    assert set(FEATURES[name].fit) == set(case.fit)
    assert SEEN[0] <= drawn.left <= SEEN[1]
    again = draw(name, 0, 5, tmp_path / "again")
    assert (again.folder / "rows.csv").read_bytes() == (drawn.folder / "rows.csv").read_bytes()


def test_friction_and_inertia_are_those_of_the_rig(tmp_path: Path) -> None:
    """Away from standstill, where MuJoCo's friction is soft, the torque is that of the books."""
    drawn = draw("friction loss", 1, 5, tmp_path / "case")
    c = columns(drawn.folder)
    fast = np.abs(c["v"]) > 1.0
    basis = np.column_stack([c["a"], c["v"], np.sign(c["v"])])[fast]
    inertia, viscous, dry = np.linalg.lstsq(basis, c["torque"][fast], rcond=None)[0]
    assert inertia == pytest.approx(drawn.values["mass"] * (0.4**2 + 0.04**2) / 12.0, rel=0.1)
    assert viscous == pytest.approx(drawn.values["b"], abs=0.02)
    assert dry == pytest.approx(drawn.values["dry"], rel=0.1)


def test_a_gain_is_all_that_its_model_lacks(tmp_path: Path) -> None:
    """What is stated there of inertia and friction is true: the recorded torque is off by one factor."""
    drawn = draw("gain", 0, 5, tmp_path / "case")
    case, c = load_case(drawn.folder), columns(drawn.folder)
    known = case.parameters["j"] * c["a"] + case.parameters["b"] * c["v"]
    factor = float(known @ c["torque"] / (known @ known))
    assert factor == pytest.approx(1.0 / drawn.values["gain"], rel=0.01)
    left = c["torque"] - factor * known
    noise = abs(1.0 - factor) * np.sqrt(np.mean((known * 1.0) ** 2)) / drawn.left
    assert np.sqrt(np.mean(left**2)) == pytest.approx(noise, rel=0.1)


def test_a_case_is_answered_and_counted() -> None:
    record = {"family": "damping", "number": 0, **one("damping", 0, 5)}
    assert record["right"], record
    told = table([record, {**record, "family": "gain", "right": False, "wrong and sure": True, "said": [["a", "b"]]}])
    lines = told.splitlines()
    assert lines[1].startswith("gain")  # the worst first
    assert "0.0 % (0.0 to 97.5)" in lines[1]
    assert "a + b" in lines[2]
    assert lines[-1].startswith("all")
