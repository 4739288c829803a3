"""The proposed experiment run in the simulator: whichever rival it is told to have is the one that is found."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from casekit import one_line, terrapin

R, DRIVE, K_T, A, B, W = 0.08, 0.018, 0.1, 0.012, 1e-3, 18.639
TEXT = """[case]
title = "One load"
[model]
base = "rolling_steady"
effects = []
[parameters]
radius = "80 mm"
drive_radius = "18 mm"
torque_constant = "0.1 N m/A"
coulomb = "12 mN m"
viscous = "1 mN m s/rad"
load = "18.639 N"
[fit]
f_o = { value = 0.05, min = 0.0, max = 0.5 }
[data]
files = ["m.csv"]
run = "run"
[data.columns]
omega = { column = "w", unit = "rad/s" }
current = { column = "i", unit = "mA", sigma = 1.5 }
"""


@pytest.fixture(scope="module")
def one_load(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case in which drag of the air and resistance that grows with the speed squared are the same: one load."""
    folder = tmp_path_factory.mktemp("carry") / "one_load"
    folder.mkdir()
    random = np.random.default_rng(3)
    lines = ["run,w,i"]
    for run in range(10):
        middle = random.uniform(2.5, 9.0)
        for _ in range(8):
            omega = middle * (1 + 0.02 * random.standard_normal())
            torque = 0.092 * R * W + A + B * omega + 0.28e-3 * omega**2 * R * W
            lines.append(f"r{run:02d},{omega:.5f},{1e3 * (torque * DRIVE / R / K_T + random.normal(0, 0.0015)):.3f}")
    (folder / "m.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "case.toml").write_text(TEXT, encoding="utf-8")
    return folder


@pytest.fixture
def discovered(one_load: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    if not (one_load / ".terrapin" / "discover.json").is_file():
        assert terrapin(capsys, "discover", one_load)[0] == 0
        capsys.readouterr()
    return one_load


@pytest.mark.parametrize("truth", ["speed_squared", "aerodynamic_drag"])
def test_simulated_runs_decide_for_what_the_robot_has(
    discovered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], truth: str
) -> None:
    before = {path.name: path.read_bytes() for path in discovered.iterdir() if path.is_file()}
    to = tmp_path / "more"
    status, out, err = terrapin(capsys, "experiment", "run", discovered, "--to", to, "--truth", truth, "--json", "-")
    assert (status, err.splitlines()[0]) == (0, "run 1 of 2")
    carried = json.loads(out)
    assert carried["truth"] == [truth]
    assert {tuple(setting) for setting in carried["settings"]} == {("load",)}
    status, out, err = terrapin(capsys, "discover", to, "--json", "-")
    answer = json.loads(out)
    assert answer["missing"] == [truth]
    # the area of this drag is 55 times what is usual: a formula of its curve is told beside it, and the other rival not
    told = [answer["missing"], *answer["rivals"]]
    assert all(one == [truth] or (truth == "aerodynamic_drag" and one == ["expression_1"]) for one in told), told
    text = (to / "case.toml").read_text(encoding="utf-8")
    assert "not measured" in text  # whoever opens the case is told
    assert 'load = "18.639 N"' not in text  # it varies now
    assert before == {path.name: path.read_bytes() for path in discovered.iterdir() if path.is_file()}


def test_without_an_answer_nothing_is_run(tmp_path: Path, one_load: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "plain"
    shutil.copytree(one_load, folder, ignore=shutil.ignore_patterns(".terrapin"))
    status, _, err = terrapin(capsys, "experiment", "run", folder, "--to", tmp_path / "more")
    assert status == 2
    one_line(err, ["no answer of discover", "expected terrapin discover first"])
    assert not (tmp_path / "more").exists()


def test_a_truth_that_is_no_rival_is_refused(
    discovered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = terrapin(capsys, "experiment", "run", discovered, "--to", tmp_path / "more", "--truth", "cogging")
    assert status == 2
    one_line(err, ["--truth: found cogging, expected one of the rivals:", "speed_squared", "aerodynamic_drag"])
    assert not (tmp_path / "more").exists()


def test_a_folder_that_is_there_is_kept(discovered: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = terrapin(capsys, "experiment", "run", discovered, "--to", discovered)
    assert status == 2
    one_line(err, ["exists, expected a new folder"])
