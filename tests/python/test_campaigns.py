"""The campaigns' own formulas against the engine's, what they call the truth, and a campaign of a few cases."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from terrapin_hil.physics.effects import catalogue
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.model.model import Model
from tests.campaigns import blind, calibration, dynamic, exhaustive
from tests.campaigns.drawn import CATALOGUE, FOREIGN, Drawn, draw, noise, write
from tests.campaigns.followup import after_experiment
from tests.campaigns.formulas import predict
from tests.campaigns.pools import POOLS, make, run
from tests.campaigns.statistics import quantile_limits, rate_limits
from tests.campaigns.table import ROWS, Line, show
from tests.campaigns.truth import distance, oracle_heldout, power, right_columns

ROOT = Path(__file__).resolve().parents[2]
EFFECTS = [(base, name) for base, effects in CATALOGUE.items() for name in effects]


def engine(drawn: Drawn, folder: Path) -> dict[str, np.ndarray]:  # type: ignore[type-arg]
    """What the engine's model predicts with the true parameters, from the case as it is written."""
    case = load_case(write(drawn, folder))
    model = Model.of(case, ())
    for name in drawn.hidden:
        model = model.having(case.library[name])
    theta = [
        drawn.design.fitted[f.name][0] if f.effect is None else drawn.hidden[f.effect][f.name] for f in model.fitted
    ]
    predicted = model.bind(case.inputs).predict(np.array(theta))
    return dict(zip(model.channels, predicted, strict=True))


@pytest.mark.parametrize(("base", "effect"), EFFECTS, ids=[f"{b}-{e}" for b, e in EFFECTS])
def test_the_engine_and_the_formulas_agree(base: str, effect: str, tmp_path: Path) -> None:
    """Units of the file, order of action, formula: to a hundredth of a noise sd (which is 1 % of the channel)."""
    drawn = draw(base, 9, 0.0, 2.0, np.random.default_rng([7, EFFECTS.index((base, effect))]), [effect])
    for channel, values in engine(drawn, tmp_path).items():
        assert np.max(np.abs(values - drawn.clean[channel])) < 0.01 * drawn.sigma[channel], channel


def test_what_is_hidden_lies_within_the_bounds_of_the_catalogue() -> None:
    """A fit could not reach it, were a bound too near."""
    hidden = [(name, values) for body in dynamic.BODIES.values() for name, values in body.effects.items()]
    for name, one in (entry for effects in CATALOGUE.values() for entry in effects.items()):
        hidden.append((name, one.shape or {}))
        if one.limit < 1.0e12:
            hidden.append((name, {one.size: (-one.limit if -1.0 in one.signs else 0.0, one.limit)}))
    for name, values in hidden:
        bounds = {p.name: p for p in catalogue()[name].parameters}
        for parameter, (least, most) in values.items():
            assert bounds[parameter].minimum <= least <= most <= bounds[parameter].maximum, (name, parameter)


@pytest.mark.parametrize("base", list(CATALOGUE))
def test_they_agree_with_several_effects_at_once(base: str, tmp_path: Path) -> None:
    chosen = {
        "rolling_steady": ["motor_heating", "current_offset", "slope"],
        "sphere_contact": ["torque_gain", "force_offset", "bulldozing", "moisture_cohesion"],
        "wheel_contact": ["torque_gain", "bearing_friction", "slip_sinkage", "multipass"],
    }[base]
    drawn = draw(base, 9, 0.0, 2.0, np.random.default_rng(11), chosen)
    for channel, values in engine(drawn, tmp_path).items():
        assert np.max(np.abs(values - drawn.clean[channel])) < 0.01 * drawn.sigma[channel], channel


@pytest.mark.parametrize("base", [b for b in FOREIGN if b.startswith("equation")])
def test_equations_of_the_user_agree(base: str, tmp_path: Path) -> None:
    drawn = draw(base, 8, 0.0, 0.0, np.random.default_rng(3))
    for channel, values in engine(drawn, tmp_path).items():
        assert np.allclose(values, drawn.clean[channel], rtol=1e-6)


def test_the_formulas_give_published_and_converged_numbers() -> None:
    """Sphere on dry sand, 150 N, slip 0.5 and 0.9, with bulldozing and slip sinkage; a wheel at zero drawbar pull."""
    sand = {
        "n": 0.97,
        "cohesion": 0.0,
        "friction_angle": np.radians(42.2),
        "k_s": 1.945e6,
        "shear_modulus": 0.01778,
        "c1": 0.18,
        "c2": 0.32,
        "unit_weight": 19600.0,
        "n_c": 20.0,
        "n_gamma": 6.0,
        "radius": 0.22,
    }
    both = {"bulldozing": {"scale": 1.0}, "slip_sinkage": {"xi1": 2.0, "xi2": 0.45, "xi3": 2.0}}
    settings = {"slip": np.array([0.5, 0.9]), "load": np.full(2, 150.0)}
    full = predict("sphere_contact", sand, settings, both, None)
    assert np.allclose(full["traction"], [56.1424, 10.006], rtol=1e-5)
    assert np.allclose(full["torque"], [17.163, 7.46842], rtol=1e-5)
    assert np.allclose(full["sinkage"], [15.3844e-3, 16.4423e-3], rtol=1e-5)
    linear = predict("sphere_contact", {**sand, "stress_linear": 1.0}, settings, both, None)
    assert np.allclose(linear["traction"], [67.4189, 15.6704], rtol=1e-5)
    shell = {
        "radius": 0.08,
        "width": 0.15,
        "k_c": 24e3,
        "k_phi": 1528e3,
        "n": 1.1,
        "cohesion": 700.0,
        "friction_angle": np.radians(30),
        "shear_modulus": 0.025,
    }
    wheel = predict("wheel_contact", shell, {"slip": np.array([0.4687]), "load": np.array([18.639])}, {}, None)
    assert abs(wheel["traction"][0]) < 1e-3
    assert np.isclose(wheel["torque"][0], 0.321692, rtol=1e-4)
    assert np.isclose(wheel["sinkage"][0], 7.376e-3, rtol=1e-4)


def test_size_is_the_rms_in_noise_sd() -> None:
    drawn = draw("sphere_contact", 12, 0.5, 1.4, np.random.default_rng(2), ["rate_effect"])
    plain = predict("sphere_contact", drawn.design.true_constants(), drawn.design.inputs(), {}, None)
    each = [np.sqrt(np.mean(((drawn.clean[c] - plain[c]) / drawn.sigma[c]) ** 2)) for c in plain]
    assert np.isclose(max(each), 1.4, rtol=2e-3)


def test_noise_has_the_correlation_that_it_says() -> None:
    values = noise(np.repeat(np.arange(2000), 50), 0.9, np.random.default_rng(1)).reshape(2000, 50)
    assert abs(values.std() - 1.0) < 0.03
    assert abs(np.mean(values[:, 1:] * values[:, :-1]) - 0.9) < 0.05
    assert abs(np.mean(values[1:, 0] * values[:-1, -1])) < 0.1  # runs are independent


def test_distance_knows_what_these_data_cannot_tell() -> None:
    tied = draw("rolling_steady", 12, 0.5, 2.0, np.random.default_rng(5), ["speed_squared"], tied="speed")
    assert distance(tied, ["speed_squared"]) < 1e-6
    assert distance(tied, ["aerodynamic_drag"]) < 1e-6
    assert distance(tied, ["current_offset"]) > 10.0
    oneway = draw("rolling_steady", 12, 0.0, 2.0, np.random.default_rng(6), ["current_offset"], tied="direction")
    assert distance(oneway, ["coulomb_friction"]) < 1e-6
    still = draw("rolling_steady", 12, 0.0, 2.0, np.random.default_rng(7), ["speed_squared"])
    assert distance(still, ()) > 20.0
    ruts = draw("wheel_contact", 12, 0.0, 2.0, np.random.default_rng(8), ["rate_effect"], tied="pass")
    assert distance(ruts, ["multipass"]) < 0.1 < 4.0 < distance(ruts, ())


def test_dry_friction_at_a_constant_load_is_one_with_nothing() -> None:
    for seed in range(50):
        drawn = draw("rolling_steady", 12, 0.0, 2.0, np.random.default_rng(seed), ["coulomb_friction"])
        if drawn.design.notes["constant_load"]:
            assert distance(drawn, ()) < 1e-6
            return
    raise AssertionError("no design of 50 has a constant load")


def test_power_is_that_of_a_simulated_test() -> None:
    random = np.random.default_rng(4)
    assert np.isclose(power(0.0), 0.05, atol=1e-6)
    scores = (random.standard_normal(200_000) + 2.0) ** 2
    assert np.isclose(power(4.0), np.mean(scores > chi2.ppf(0.95, 1)), atol=0.005)


def test_the_oracle_is_at_the_noise_floor_and_knows_the_columns() -> None:
    drawn = draw("rolling_steady", 30, 0.0, 2.0, np.random.default_rng(9), ["motor_heating"])
    assert 0.85 < oracle_heldout(drawn, drawn.sigma) < 1.15
    assert "temperature" in right_columns(drawn)
    assert not right_columns(drawn) & {"humidity", "gyro_z", "battery_voltage"}


def test_the_next_experiment_is_run_as_proposed(tmp_path: Path) -> None:
    drawn = draw("rolling_steady", 12, 0.5, 2.0, np.random.default_rng(5), ["speed_squared"], tied="speed")
    settings = [{"load": 10.0}, {"load": 40.0}]
    longer = after_experiment(drawn, {"vary": ["load"], "settings": settings, "runs": 8}, np.random.default_rng(1))
    assert longer.design.runs == 20
    assert set(np.unique(longer.design.columns["load"])) == {10.0, 40.0, drawn.design.constants["load"]}
    assert distance(longer, ["aerodynamic_drag"]) > 16.0
    case = load_case(write(longer, tmp_path))
    assert "load" in case.roles
    assert np.allclose(case.channels["current"], longer.measured["current"], rtol=1e-6)


def test_a_case_depends_on_seed_pool_and_number_only() -> None:
    for pool in POOLS:
        first, again, other = (make(pool, 1, n)[1] for n in (5, 5, 6))
        channel = first.channels[0]
        assert np.array_equal(first.measured[channel], again.measured[channel])
        assert not np.array_equal(first.measured[channel], other.measured.get(channel))


def test_limits() -> None:
    assert rate_limits(0, 75) == (0.0, pytest.approx(0.048, abs=5e-4))
    assert rate_limits(8, 10) == (pytest.approx(0.4439, abs=1e-4), pytest.approx(0.9748, abs=1e-4))
    low, high = quantile_limits(list(np.random.default_rng(1).standard_normal(2000)), 0.5)
    assert low < 0.0 < high
    assert high - low < 0.2


def test_a_missed_bound_is_said() -> None:
    record = {"pool": "nothing", "p_value": 0.01, "rho": 0.0, "runs": 9, "rows": 90, "base": "rolling_steady"}
    (line,) = ROWS["alarms"][1]([{**record, "known": True}] * 40)
    assert line.verdict == "NOT MET"
    assert "NOT MET" in show([line])
    assert Line("a", "", "", 5, "", True).verdict == "few"
    assert Line("a", "", "", 500, "", True, (), False).verdict == "few"
    (good,) = ROWS["alarms"][1]([{**record, "known": True, "p_value": 0.5}] * 40)
    assert good.verdict == "met"


def test_an_engine_that_falls_over_is_counted_as_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise AssertionError("a larger model fits worse")

    monkeypatch.setattr("tests.campaigns.pools.analyse", broken)
    record = run("nothing", 1, 0)
    assert "a larger model fits worse" in record["failed"]
    (line,) = ROWS["alarms"][1]([record] * 40)
    assert line.verdict == "NOT MET"


def campaign(out: Path, *arguments: str) -> list[str]:
    shared = ["--out", str(out), "--name", "x", "--jobs", "1", "--brief"]
    return [sys.executable, "-m", "tests.campaigns", *shared, *arguments]


def test_a_short_campaign_goes_on_after_a_kill(tmp_path: Path) -> None:
    """Killed after its first records; the rerun keeps them, ends the rest and gives the table."""
    command = campaign(tmp_path, "--rows", "alarms", "--cases", "10")
    file = tmp_path / "x" / "nothing-1.jsonl"
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL, start_new_session=True) as process:
        while process.poll() is None and not (file.exists() and file.read_text().count("\n") >= 2):
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGKILL)
    before = file.read_text()
    file.write_text(before + '{"pool": "noth')  # what a kill in the middle of a line leaves
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert "false alarms" in done.stdout, done.stderr
    records = []
    for line in file.read_text().splitlines():
        try:
            records.append(json.loads(line))
        except ValueError:
            continue
    assert file.read_text().startswith(before)
    assert sorted(r["number"] for r in records) == list(range(10))
    assert not [r for r in records if "failed" in r]


def test_unknown_rows_are_refused(tmp_path: Path) -> None:
    done = subprocess.run(campaign(tmp_path, "--rows", "luck"), cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "luck" in done.stderr


def test_the_blind_set_is_what_its_seal_says(tmp_path: Path) -> None:
    """The same seed gives the same answers, every kind among them; answers that were not sealed are refused."""
    drawn = blind.answers(len(blind.KINDS), seed=3)
    assert drawn == blind.answers(len(blind.KINDS), seed=3) != blind.answers(len(blind.KINDS), seed=4)
    assert [one["kind"] for one in drawn["cases"]] == list(blind.KINDS)
    assert all(bool(one["truth"]) == (one["kind"] != "nothing") for one in drawn["cases"])
    path = tmp_path / "answers.json"
    path.write_text(json.dumps(drawn), encoding="utf-8")
    words = [sys.executable, "-m", "tests.campaigns.blind", "run", "--answers", str(path)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "its seal does not stand in" in done.stderr


def test_a_map_of_probability_mends_what_it_is_fitted_to() -> None:
    """Claims that are right more often than they say: the error is seen, and the map's slope and shift undo it."""
    random = np.random.default_rng(5)
    stated = random.uniform(0.3, 0.9, 2000)
    odds = 1.5 * np.log(stated / (1.0 - stated)) + 0.8
    right = random.random(2000) < 1.0 / (1.0 + np.exp(-odds))
    drawn = [
        {"verdict": "missing", "probability": float(p), "right": bool(r)} for p, r in zip(stated, right, strict=True)
    ]
    error, perfect = calibration.expected_error(drawn)
    assert error > 0.1 > 3.0 * perfect
    slope, shift = calibration.fitted(drawn)["missing"]
    assert abs(slope - 1.5) < 0.2
    assert abs(shift - 0.8) < 0.15
    mended = [
        {**d, "probability": 1.0 / (1.0 + (1.0 / d["probability"] - 1.0) ** slope * np.exp(-shift))} for d in drawn
    ]
    assert calibration.expected_error(mended)[0] < 1.5 * perfect


def test_a_case_of_the_calibration_is_judged_by_what_is_hidden() -> None:
    nothing, formula = (calibration.one("independent", number, seed=99) for number in (0, 2 + 3))
    assert (nothing["truth"], nothing["hidden"]) == ([], 0.0)
    assert formula["hidden"] > 16.0
    assert formula["kind"] == "formula"
    assert nothing["right"] == (nothing["verdict"] == "adequate")


def test_exhaustive_bic_names_what_is_hidden_and_nothing_where_nothing_is() -> None:
    """A case of each kind; number 0 of a group lacks nothing, 1 an effect, 2 a pair."""
    for number in (0, 1, 2):
        found = exhaustive.one("independent", number, seed=6)
        assert found["right"] == (set(found["named"]) == set(found["truth"]))
        assert len(found["truth"]) == number
        assert found["right"], found
