"""The sphere under its controller: shipped scenarios, guard, slip limiter where it matters, the L9 experiment."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from terrapin_hil import paths
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import Order, find_scenario, load_scenario
from terrapin_tools import cli
from terrapin_tools.errors import UserError
from terrapin_tools.experiments import l9_runs, slip_limit
from tests.campaigns import sphere as campaign
from tests.own_robot import taken

SHIPPED = sorted(path.stem for path in (paths.SCENARIOS / "sphere").glob("*.toml"))


@pytest.fixture(scope="module", autouse=True)
def sphere() -> Iterator[None]:
    with taken("sphere"):
        yield


@pytest.mark.parametrize("name", SHIPPED)
def test_scenario(name: str) -> None:
    scenario = load_scenario(find_scenario(name))
    assert scenario.title
    assert scenario.checks
    result = run(scenario)
    assert [f"{o.text}: {o.found}" for o in result.outcomes if not o.passed] == []


@pytest.mark.parametrize("slope", [-9.0, 0.0, 9.0])
@pytest.mark.parametrize("tow", [0.0, 20.0, 1000.0])
def test_the_bob_never_goes_over_the_top(slope: float, tow: float) -> None:
    """Steps of 0 to 24 V from rest, and reversals of a rolling robot, by the motor's voltage as the duty allows it."""
    scenario = load_scenario(find_scenario("guard"))
    ground = replace(
        scenario.ground, segments=tuple(replace(s, slope=math.radians(slope)) for s in scenario.ground.segments)
    )
    stopped = 0
    for volts in (2.0, 6.0, 10.0, 14.0, 18.0, 20.0, 24.0):
        for orders in (
            (Order(0.5, "run", "voltage", volts, False),),
            (Order(0.5, "run", "voltage", 5.0, False), Order(4.0, "run", "voltage", -volts, False)),
        ):
            limits = {"voltage_limit": volts} if volts > 20.0 else {}
            result = run(
                replace(
                    scenario,
                    duration=7.0,
                    ground=ground,
                    operator=orders,
                    tow=((0.0, tow),) if tow else (),
                    firmware={**scenario.firmware, **limits},
                    checks=(),
                )
            )
            assert np.abs(result.truth["swing_angle"]).max() < math.radians(150.0)
            stopped += result.held("ACTUATE", "enable")[-1] == 0
    assert stopped > 0


@pytest.mark.parametrize(("law", "best"), [("none", 0.9), ("paper", 0.5), ("rut 3 mm", 0.7)])
def test_the_rig_holds_the_limit_and_the_ground_says_which_is_best(law: str, best: float) -> None:
    """Of 0.3, 0.5, 0.7 and 0.9; shares of the best are those of the note's ideal limiter within 0.03."""
    expected = {
        "none": (0.57, 0.80, 0.93, 1.00),
        "paper": (0.70, 0.99, 0.83, 0.18),
        "rut 3 mm": (0.64, 0.90, 1.00, 0.55),
    }[law]
    peaks = {"none": 75.80, "paper": 56.79, "rut 3 mm": 61.15}  # N, of the integrals over all slips
    found = [slip_limit.pull("printed sand", law, limit) for limit in (0.3, 0.5, 0.7, 0.9)]
    assert max(p.farthest for p in found) <= 0.03
    assert max(found, key=lambda p: p.pull).limit == best
    for p, share in zip(found, expected, strict=True):
        assert abs(p.pull / peaks[law] - share) <= 0.03


def test_the_printed_robot_is_told_that_it_cannot_roll_on() -> None:
    """1.91 N m against 1.97 without bulldozing, and 2.24 with it and the paper's law; 9 kg can."""
    assert "gravity holds 1.91 N m" in load_scenario(find_scenario("printed")).notes[-1]
    for scale, xi1, needed in ((0, 0, "1.97"), (1, 2, "2.24")):
        values = {"effect.bulldozing.scale": scale, "effect.slip_sinkage.xi1": xi1}
        (line,) = [n for n in load_scenario(find_scenario("printed"), values).notes if "gravity" in n]
        assert f"rolling on takes {needed} N m" in line
    assert not [n for n in load_scenario(find_scenario("level")).notes if "gravity" in n]


def test_contact_torque_of_a_calibrated_robot() -> None:
    """The bounds of tests/campaigns/sphere.py, whole, in a short form: three steady states, parts that err."""
    rows, guarded = campaign.contact_torque(3, True)
    assert guarded == []
    assert [str(row) for row in rows if not row.met] == []


def test_what_ends_a_free_run_is_named() -> None:
    """The guard where the limit lets the bob rise, the limiter where it is low; digging by a rut of its own."""
    low, high = (slip_limit.free_run("rut 3 mm", limit) for limit in (0.3, 0.9))
    assert low.ended == "limiter"
    assert high.ended == "guard"
    assert high.swing < math.radians(150.0)
    assert 0.0 < low.dug < high.dug
    assert low.way < high.way


def test_the_study_says_all_of_it(capsys: pytest.CaptureFixture[str], tmp_path: object) -> None:
    said: list[tuple[int, int]] = []
    found = slip_limit.study((0.3, 0.5), ("printed sand",), lambda done, of: said.append((done, of)))
    every = len(found.pulls) + len(found.free)
    assert said == [(done, every) for done in range(every)]
    words = slip_limit.describe(found)
    for part in ("printed sand", "rut 20 mm", "worst of these", "what ended it", "energy [J/m], paper"):
        assert part in words
    assert slip_limit.best(found, ("printed sand", "paper")) == {
        "pull": 0.5,
        "dug": 0.3,
        "energy": 0.3,
        "efficiency": 0.3,
    }
    assert slip_limit.as_json(found)["rows"][1]["shares"]["0.5"] == 1.0


def test_heavier_rolls_less_far_where_the_guard_ends_no_run() -> None:
    """The paper's nine runs, the mass on the pendulum. Ways and signs: an own integration of the same nine settings."""
    found = l9_runs.nine(1.4, 1.4)
    mass, ramp, speed = found.analysis.factors
    ways = [rolled.way for rolled in found.runs]
    assert ways == pytest.approx([1.183, 1.142, 1.112, 1.337, 1.335, 1.321, 1.391, 1.405, 1.410], abs=2e-3)
    assert {rolled.ended for rolled in found.runs} == {"stood"}
    assert mass.means[0] < mass.means[1] < mass.means[2]
    assert ramp.means[0] > ramp.means[2]
    assert max(speed.range_of_means, ramp.range_of_means) < 0.1 * mass.range_of_means
    words = l9_runs.describe([found])
    assert "1.4 N m 1.4 m" in words
    assert words.count("strongest first") == 2


def test_runs_that_the_guard_ends_are_no_part_of_effects_and_order() -> None:
    """Half the paper's accelerations: the ramp's sign is the paper's. The same source."""
    found = l9_runs.nine(1.4, 1.0, 0.5)
    mass, ramp, speed = found.analysis.factors
    ways = [rolled.way for rolled in found.runs]
    assert ways == pytest.approx([0.364, 0.565, 0.807, 0.376, 0.640, 0.839, 0.359, 0.673, 0.928], abs=2e-3)
    assert [rolled.ended == "guard" for rolled in found.runs] == [*[False] * 6, True, True, False]
    assert ramp.means[0] < ramp.means[1] < ramp.means[2]
    assert speed.range_of_means < mass.range_of_means < ramp.range_of_means
    assert mass.means[0] < mass.means[2]
    assert np.isnan([f.f_ratio for f in found.analysis.factors]).all()  # seven runs, seven parameters
    slow, fast = (sum(found.runs[i].entered for i in rows) / 3 for rows in ((0, 3, 6), (2, 5, 8)))
    assert fast > 1.1 * slow  # at the edge of the sand
    words = l9_runs.describe([found])
    assert "1.4 N m 1 m x0.5" in words
    assert words.count(" g\n") == 2


def test_bad_input_of_the_commands(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, message in (
        (["slip_limit", "--limit", "1.5"], "--limit: found 1.5, expected 0.05 to 0.9"),
        (["slip_limit", "--ground", "mud"], "--ground: found 'mud', expected one of printed sand"),
        (["slip_limit", "--plot", "x.gif"], "--plot: found 'x.gif', expected a name that ends in .png or .svg"),
        (["l9", "--torque", "2"], "--torque, --run-up and --ramp: expected together with --simulate"),
        (["l9", "--simulate", "--ramp", "-1"], "--ramp: found -1, expected more than 0"),
        (["l9", "--simulate", "--run-up", "0"], "--run-up: found 0, expected more than 0"),
        (["l9", "--simulate", "runs.csv"], "--simulate rolls the paper's runs"),
    ):
        monkeypatch.setattr("sys.argv", ["terrapin", "experiment", *arguments])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        assert stop.value.code == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1


def test_its_own_scenario_comes_before_the_cylinders() -> None:
    assert find_scenario("level").parent.name == "sphere"
    assert find_scenario("steady_sand").parent.name == "scenarios"  # which is scaled (test_scaled_scenarios.py)
    with pytest.raises(UserError, match=r"nowhere: no such file, and no scenario of that name; shipped: .*level"):
        find_scenario("nowhere")
