"""The soil under a car, from simulated measurements with known truth: fit, limits, case files, command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from terrapin_hil.physics.soils import Footing, library
from terrapin_hil.physics.tyre import ContactError, Tyre
from terrapin_hil.physics.vehicle import PERIOD, Vehicle, profile_torque, simulate
from terrapin_tools import cli
from terrapin_tools.soil.vehicle import PARAMETERS, Drive, Fit, Objective, bounds_of, estimate, synthetic
from terrapin_tools.soil.vehicle_case import load_vehicle_case
from terrapin_tools.soil.vehicle_limits import analyse

NOMINAL = library()["lete_sand"].footing(0.235)
TRUTH = library()["sand_vella"].footing(0.235)
SEED = 1


@pytest.fixture(scope="module")
def drives() -> list[Drive]:
    return [synthetic(profile, TRUTH, SEED) for profile in range(3)]


@pytest.fixture(scope="module")
def train(drives: list[Drive]) -> Objective:
    return Objective(Vehicle(), Tyre(), drives[:2])


@pytest.fixture(scope="module")
def test(drives: list[Drive]) -> Objective:
    return Objective(Vehicle(), Tyre(), drives[2:])


def noise_free(profile: int, footing: Footing, duration: float = 8.0) -> Drive:
    torque = profile_torque(profile, duration)
    omega = simulate(Vehicle(), Tyre(), footing, torque).omega[:, (0, 0, 1, 1)]
    return Drive(f"clean_{profile}", PERIOD, torque, omega)


def test_cost_of_eq_5_is_the_sum_over_the_wheels(train: Objective, drives: list[Drive]) -> None:
    total = 0.0
    for drive in drives[:2]:
        model = simulate(Vehicle(), Tyre(), TRUTH, drive.torque).omega
        for wheel, axle in enumerate((0, 0, 1, 1)):
            measured = drive.omega[:, wheel]
            keep = measured > 2.0
            ratio = (model[keep, axle] - measured[keep]) / measured[keep]
            total += 100 / 2 * np.sqrt(np.mean(ratio**2))
    assert train.cost(np.array(TRUTH)) == pytest.approx(total, rel=1e-12)
    assert train.cost(np.array(NOMINAL)) == pytest.approx(106.1, abs=1.5)
    assert 5.0 < total < 9.0  # the noise floor; it depends on the draw


@pytest.fixture(scope="module")
def fit(train: Objective) -> Fit:
    return estimate(train, NOMINAL, starts=2)


def test_five_parameters_to_the_noise_floor(train: Objective, test: Objective, fit: Fit) -> None:
    truth = np.array(TRUTH)
    assert fit.squares <= train.squares(truth)
    assert fit.cost < train.cost(truth) + 0.1
    assert abs(test.cost(np.array(fit.footing)) - test.cost(truth)) < 1.0
    for value, low, high in zip(fit.footing, *bounds_of(NOMINAL), strict=True):
        assert low <= value <= high
    assert len(fit.starts) == 2  # both ended at the same optimum
    assert fit.starts[1][1] == pytest.approx(fit.starts[0][1], rel=1e-4)


def test_cost_of_eq_5_reaches_the_noise_floor(train: Objective, test: Objective, fit: Fit) -> None:
    least = estimate(train, NOMINAL, cost="eq5", starts=1)
    truth = np.array(TRUTH)
    assert least.cost <= train.cost(truth)
    assert least.cost < fit.cost
    assert abs(test.cost(np.array(least.footing)) - test.cost(truth)) < 1.0


def test_without_noise_the_truth_comes_back() -> None:
    truth = Footing(420e3, 0.73, 1000.0, 0.57, 0.031)
    objective = Objective(Vehicle(), Tyre(), [noise_free(0, truth), noise_free(1, truth)])
    fit = estimate(objective, NOMINAL, starts=1)
    assert fit.footing == pytest.approx(truth, rel=2e-3)
    assert fit.cost < 0.01


def test_a_known_parameter_is_held(train: Objective) -> None:
    low, high = bounds_of(NOMINAL)
    held = {"exponent": 0.71, "cohesion": 1150.0}
    fit = estimate(train, NOMINAL, (low._replace(**held), high._replace(**held)), starts=1)
    assert (fit.footing.exponent, fit.footing.cohesion) == (0.71, 1150.0)
    assert fit.footing.stiffness == pytest.approx(357.6e3, rel=5e-3)  # with n known, k_s is too
    assert fit.footing.friction_angle == pytest.approx(np.radians(31.5), rel=5e-3)


def test_limits_name_what_the_data_fix(train: Objective, fit: Fit) -> None:
    limits = analyse(train, fit, bounds_of(NOMINAL), profiles=False)
    assert limits.correlation["k_s"]["n"] > 0.999
    assert limits.correlation["cohesion"]["friction_angle"] < -0.99
    pressure, strength = limits.combinations
    assert pressure.at == pytest.approx(0.06, abs=0.002)  # the depth at which the data fix the pressure
    true_pressure = TRUTH.stiffness * pressure.at**TRUTH.exponent
    assert pressure.value == pytest.approx(true_pressure, abs=4 * pressure.sd)
    assert (
        pressure.sd < 0.002 * pressure.value < 0.1 * limits.intervals["k_s"].sd / fit.footing.stiffness * pressure.value
    )
    true_strength = TRUTH.cohesion + strength.at * np.tan(TRUTH.friction_angle)
    assert strength.value == pytest.approx(true_strength, abs=4 * strength.sd)
    assert set(limits.fixed) >= {"shear_modulus"}
    assert {"n", "cohesion"} <= set(limits.not_fixed)
    assert 0.1 < limits.noise < 0.16


def test_profile_ends_where_the_deviance_says(train: Objective) -> None:
    low, high = bounds_of(NOMINAL)
    held = {"exponent": 0.71, "cohesion": 1150.0, "friction_angle": NOMINAL.friction_angle}
    bounds = (low._replace(**held), high._replace(**held))
    fit = estimate(train, NOMINAL, bounds, starts=1)
    interval = analyse(train, fit, bounds).intervals["shear_modulus"]
    assert interval.low < 0.036 < interval.high
    # two parameters that hardly correlate: the profile is nearly the normal interval
    assert interval.high - interval.low == pytest.approx(2 * 1.96 * interval.sd, rel=0.05)
    assert not interval.low_open
    assert not interval.high_open


def test_a_torque_gain_moves_the_stiffness_more_than_its_sd(drives: list[Drive]) -> None:
    wrong = [replace(drive, torque=1.03 * drive.torque) for drive in drives[:2]]
    objective = Objective(Vehicle(), Tyre(), wrong)
    low, high = bounds_of(NOMINAL)
    held = NOMINAL._replace(stiffness=0.0)._asdict()
    held.pop("stiffness")
    fit = estimate(objective, NOMINAL, (low._replace(**held), high._replace(**held)), cost="eq5", starts=1)
    assert fit.footing.stiffness == pytest.approx(332.2e3, rel=0.02)  # 7 % below the truth
    assert fit.cost > 1.5 * Objective(Vehicle(), Tyre(), drives[:2]).cost(np.array(TRUTH))


def test_what_cannot_be_estimated_is_refused(train: Objective, drives: list[Drive]) -> None:
    low, high = bounds_of(NOMINAL)
    with pytest.raises(ContactError, match=r"n: found start 0\.71, expected between 0\.8 and 0\.9"):
        estimate(train, NOMINAL, (low._replace(exponent=0.8), high._replace(exponent=0.9)))
    with pytest.raises(ContactError, match="every parameter is held"):
        estimate(train, NOMINAL, (NOMINAL, NOMINAL))
    with pytest.raises(ContactError, match="run profile_0, wheel fl: found no speed above 1000 rad/s"):
        Objective(Vehicle(), Tyre(), drives[:1], mask=1000.0)
    with pytest.raises(ContactError, match="found none, expected at least one run"):
        Objective(Vehicle(), Tyre(), [])


CASE = """
[case]
title = "Car on sand, simulated"
[model]
base = "vehicle"
[parameters]
mass = "1797 kg"
n = 0.71
cohesion = "1.15 kPa"
[fit]
k_s = { value = "535.3 kN/m^2.71", min = "289 kN/m^2.71", max = "782 kN/m^2.71" }
friction_angle = { value = "31.5 deg", min = "24.6 deg", max = "38.4 deg" }
shear_modulus = { value = "36 mm", min = "21 mm", max = "51 mm" }
[data]
files = ["runs.csv"]
run = "run"
train = ["0"]
test = ["2"]
[data.columns]
time = { column = "t", unit = "s" }
drive_torque = { column = "torque", unit = "N m" }
omega_fl = { column = "fl", unit = "rpm" }
omega_rr = { column = "rr", unit = "rad/s" }
"""


@pytest.fixture
def case(tmp_path: Path, drives: list[Drive]) -> Path:
    rows = ["run,t,torque,fl,rr"]
    for number, drive in enumerate(drives):
        for k in range(401):
            w = drive.omega[k]
            rows.append(f"{number},{k * PERIOD:.2f},{drive.torque[k]:.3f},{w[0] * 30 / np.pi:.5f},{w[3]:.5f}")
    (tmp_path / "runs.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "case.toml").write_text(CASE)
    return tmp_path


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["terrapin", "soil", "vehicle", *arguments])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return int(stop.value.code or 0)


def test_command_estimates_a_case(
    case: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, str(case), "--starts", "1", "--no-profiles", "--json", str(case / "answer.json")) == 0
    words = capsys.readouterr().out
    answer = json.loads((case / "answer.json").read_text())
    assert answer["schema"] == "terrapin.soil_vehicle/1"
    assert tuple(answer["parameters"]) == PARAMETERS
    k_s = answer["parameters"]["k_s"]
    assert (k_s["unit"], k_s["known"]) == ("Pa/m^0.71", False)
    assert k_s["value"] == pytest.approx(357.6e3, rel=0.02)
    assert answer["parameters"]["n"]["known"]
    read = load_vehicle_case(case)
    floor = Objective(read.vehicle, read.tyre, read.test).cost(np.array(TRUTH))
    assert abs(answer["eq5_percent"]["validation"]["fit"] - floor) < 1.0
    assert "relaxation_length" in answer["assumed"]
    assert "kPa/m^0.71" in words
    shown = {line.split()[0]: line.split()[1:3] for line in words.splitlines()[1:] if line.split()[0] in PARAMETERS}
    for name, factor, unit in (
        ("cohesion", 1e-3, "kPa"),
        ("friction_angle", 180.0 / np.pi, "deg"),
        ("shear_modulus", 1e3, "mm"),
    ):
        assert shown[name] == [f"{answer['parameters'][name]['value'] * factor:.4g}", unit]
    assert "validation runs" in words


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('base = "vehicle"', 'base = "cmr"', "case.toml:5: model.base: found 'cmr', expected vehicle"),
        ("535.3 kN/m^2.71", "535.3 kN/m", "case.toml:11: fit.k_s.value: 'kN/m' does not convert to 'Pa/m^0.71'"),
        ('"289 kN/m^2.71"', '"-1 kN/m^2.71"', "case.toml:11: fit.k_s.min: found -1000, expected more than 0"),
        (', max = "51 mm"', "", "case.toml:13: fit.shear_modulus.max: missing, expected a bound"),
        ("n = 0.71\n", "", "case.toml:9: fit: n is missing, expected it here or in [parameters]"),
        ('mass = "1797 kg"', 'mass = "-1 kg"', "parameters: vehicle mass: found -1, expected more than 0"),
        ('mass = "1797 kg"', 'weight = "1797 kg"', "case.toml:7: parameters.weight: unknown name"),
        ('train = ["0"]', 'train = ["9"]', "case.toml:17: data.train: run '9' is not in the data"),
        ('"torque"', '"T"', "case.toml:21: data.columns.drive_torque: column 'T' is not in runs.csv"),
        ('unit = "rpm"', 'unit = "m"', "case.toml:22: data.columns.omega_fl.unit: 'm' does not convert to 'rad/s'"),
    ],
)
def test_a_wrong_case_is_one_line(
    case: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    old: str,
    new: str,
    message: str,
) -> None:
    assert old in CASE
    (case / "case.toml").write_text(CASE.replace(old, new))
    assert run(monkeypatch, str(case)) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error


def test_wrong_rows_are_named(case: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    lines = (case / "runs.csv").read_text().splitlines()
    for row, text, message in (
        (5, "0,0.09,0,0,0", "runs.csv:6: time: found a step of 0.06 s in run 0"),
        (7, "0,0.06,nan,0,0", "runs.csv:8: column torque: found NaN"),
        (1, "0,0.00,0,0,9.5", "runs.csv:2: run 0 starts at 9.5 rad/s, expected standstill"),
    ):
        (case / "runs.csv").write_text("\n".join([*lines[:row], text, *lines[row + 1 :]]) + "\n")
        assert run(monkeypatch, str(case)) == 2
        assert message in capsys.readouterr().err
