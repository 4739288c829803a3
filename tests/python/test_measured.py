"""The campaign on real measurements, with made-up tables in their place: the data are no part of the project."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from tests.campaigns import measured
from tests.campaigns.measured_sets import SETS


def stand(folder: Path) -> Path:
    """A table as that of the thrust stand at 7.4 V: 30 mohm, runs that differ by 5 mV."""
    random = np.random.default_rng(4)
    (folder / "thrust_stand").mkdir(parents=True)
    names = ("run", "motor", "supply [V]", "time [s]", "thrust [gf]", "voltage [V]", "current [A]", "speed [rpm]")
    with (folder / "thrust_stand" / "stand_7v4.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for run in range(15):
            offset = 0.005 * random.standard_normal()
            for step in range(11):
                current = 0.4 + (0.5 + 0.03 * run) * step
                voltage = 7.4 + offset - 0.03 * current + 0.003 * random.standard_normal()
                speed, thrust = 3000.0 * np.sqrt(current), 40.0 * current + 5.0 * random.standard_normal()
                row = (2.0 * step, thrust, voltage, current, speed)
                writer.writerow([f"m{run:02d}", "any", 7.4, *(f"{value:.6g}" for value in row)])
    return folder


def test_a_set_is_answered_round_after_round(tmp_path: Path) -> None:
    found = measured.outcome(SETS["thrust-7v4"], stand(tmp_path / "data"), tmp_path / "out")
    assert found.named == {"resistance": "name"}
    assert found.error < 0.01
    assert not found.problems
    assert 2 <= len(found.rounds) <= measured.ROUNDS
    assert "resistance (name)" in measured.table([found])
    assert found.met


def dynamometer(folder: Path) -> Path:
    """A table as that of the dynamometer: speeds of one sign, so that dry friction and an offset are one."""
    random = np.random.default_rng(5)
    (folder / "odrive_dyno").mkdir(parents=True)
    names = ("run", "torque [N mm]", "speed [rad/s]", "motor_temperature [degC]", "current_q [A]")
    with (folder / "odrive_dyno" / "dyno.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for run in range(12):
            speed = -20.0 * (1 + run)
            for step in range(9):
                torque = -80.0 * step - 40.0
                current = 0.03 * torque - 1.6 + 1.5e-5 * torque * abs(torque) + 0.00005 * torque * speed
                row = (torque, speed, 25.0 + run + random.uniform(0.0, 3.0), current + 0.25 * random.standard_normal())
                writer.writerow([f"rpm{run:02d}", *(f"{value:.6g}" for value in row)])
    return folder


def test_what_is_one_on_the_data_is_told_together_beside_a_formula(tmp_path: Path) -> None:
    found = measured.outcome(SETS["odrive-current"], dynamometer(tmp_path / "data"), tmp_path / "out")
    answer = measured.answers(tmp_path / "out" / "odrive-current")[0]
    told = [answer["missing"], *answer["rivals"]]
    assert any("coulomb_friction" in names for names in told), told
    assert any("offset" in names for names in told), told
    assert found.named["dry friction"] in ("tied", "name")


def test_a_set_that_misses_its_bound_is_not_met(tmp_path: Path) -> None:
    found = measured.Outcome("any", {"dry friction": "name"}, error=0.3, bound=0.2, unit="A")
    assert not found.met
    found.bound = 0.4
    assert found.met
    found.named["saturation"] = "formula"
    assert not found.met
    assert "NO" in measured.table([found])


@pytest.mark.parametrize(
    ("words", "told"),
    [(["--set", "nothing"], "--set: found 'nothing', expected one of odrive"), ([], "--data: found ")],
)
def test_bad_options_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], told: str
) -> None:
    monkeypatch.setattr("sys.argv", ["measured", "--data", str(tmp_path / "absent"), *words])
    with pytest.raises(SystemExit) as ended:
        measured.main()
    assert ended.value.code == 2
    assert told in capsys.readouterr().err
