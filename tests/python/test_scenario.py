"""Scenario files: what is read, and what is said about a wrong one."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrapin_hil.effect_files import read_effect_file
from terrapin_hil.physics.effects import catalogue
from terrapin_hil.physics.expression import parse
from terrapin_hil.reading import ReadingError, parse_quantity
from terrapin_hil.robot.compiled_effects import ActiveEffect, EffectError, compile_effects
from terrapin_hil.robot.plant import TERRAINS
from terrapin_hil.run.run import run
from terrapin_hil.scenario.checks import CheckError, parse_check
from terrapin_hil.scenario.scenario import Scenario, find_scenario, load_scenario

GOOD = """\
title = "All that can stand in a scenario"
duration = "2.5 s"
seed = 9
carriage = [["0 s", "0 m/s"], ["1 s", "360 mm/s"]]
checks = ["max(slip) < 2"]

[robot]
radius = "80 mm"

[sensors]
kit = "real"
current.offset = 3

[sensors.swing_rate]
delay = "5 ms"

[[path]]
terrain = "hard_floor"

[[path]]
from = "1 m"
terrain = "sand"
slope = "14 deg"
f_o = 0.1

[winding]
profile = [["0 s", "25 degC"], ["2 s", "338.15 K"]]

[supply]
voltage = "11 V"

[effect.viscous_friction]
b = "0.2 mN m s/rad"

[[operator]]
at = "0 s"
request = "run"
control = "speed"
setpoint = "0.5 m/s"

[[fault]]
kind = "supply"
value = "5 V"
from = "1 s"
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "wrong.toml"
    path.write_text(text)
    return path


def read(folder: Path, text: str = GOOD) -> Scenario:
    return load_scenario(write(folder, text))


def test_units_and_defaults(tmp_path: Path) -> None:
    scenario = read(tmp_path)
    assert scenario.ticks == 2500
    assert scenario.robot.radius == pytest.approx(0.08)
    assert scenario.sensors.current.offset == 3.0
    assert scenario.sensors.current.gain_error == 0.005
    assert scenario.sensors.swing_rate.delay == pytest.approx(0.005)
    assert scenario.ground.segments[1].slope == pytest.approx(math.radians(14))
    assert scenario.ground.segments[1].terrain.f_o == 0.1
    assert scenario.ground.segments[1].terrain.mu == TERRAINS["sand"].mu
    assert scenario.winding.profile == ((0.0, 25.0), (2.0, pytest.approx(65.0)))
    assert scenario.effects[0].values == {"b": pytest.approx(2e-4)}
    assert scenario.carriage[1] == (1.0, pytest.approx(0.36))


WRONG = {
    "no TOML": (GOOD.replace("seed = 9", "seed = "), r":3: not TOML"),
    "unknown field": (GOOD.replace("seed = 9", "sead = 9"), r":3: sead: no such field; is `seed` meant"),
    "unknown table": (GOOD + "[robott]\n", r"robott: no such field; is `robot` meant"),
    "unit": (GOOD.replace("80 mm", "80 mA"), r":8: robot\.radius: found '80 mA', expected .* in m "),
    "no number": (GOOD.replace('"80 mm"', '"wide"'), r":8: robot\.radius: found 'wide'"),
    "infinite": (GOOD.replace('"80 mm"', "inf"), r"robot\.radius: found inf, expected a finite number"),
    "not a number": (GOOD.replace('"80 mm"', "nan"), r"robot\.radius: found nan, expected a finite number"),
    "range": (GOOD.replace("80 mm", "-80 mm"), r"robot\.radius: found '-80 mm', expected 1e-09 to 1e\+06 m"),
    "terrain": (
        GOOD.replace('"sand"', '"swamp"'),
        r":22: path\[2\]\.terrain: found 'swamp', expected one of hard_floor",
    ),
    "order of segments": (GOOD.replace('from = "1 m"', 'from = "-1 m"'), r"path\[2\]\.from: found -1 m, expected more"),
    "no path": (GOOD.replace("[[path]]", "[[effect.x]]"), r"path: found 0 tables"),
    "no duration": (GOOD.replace('duration = "2.5 s"\n', ""), r"duration: missing"),
    "long": (GOOD.replace("2.5 s", "2 h"), r":2: duration: found '2 h', expected 0\.001 to 3600 s"),
    "rising times": (GOOD.replace('["1 s", "360', '["0 s", "360'), r":4: carriage: .*expected rising times"),
    "pairs": (GOOD.replace('["1 s", "360 mm/s"]', '"1 s"'), r"carriage: .*expected a list of \[time, value\] pairs"),
    "setpoint": (GOOD.replace("0.5 m/s", "0.5 V"), r"operator\[1\]\.setpoint: found '0\.5 V', expected .* m/s"),
    "request": (GOOD.replace('"run"', '"fly"'), r"operator\[1\]\.request: found 'fly', expected one of idle"),
    "flag": (GOOD.replace("seed = 9", "real_time = 1"), r"real_time: found 1, expected true or false"),
    "whole": (GOOD.replace("seed = 9", "seed = 1.5"), r"seed: found 1\.5, expected a whole number"),
    "negative seed": (GOOD.replace("seed = 9", "seed = -1"), r"seed: found -1, expected a whole number from 0"),
    "fault": (GOOD.replace('kind = "supply"', 'kind = "gremlin"'), r"fault\[1\]\.kind: found 'gremlin'"),
    "fault's value": (GOOD.replace('value = "5 V"', ""), r"fault\[1\]\.value: missing"),
    "channel": (GOOD.replace("current.offset", "currant.offset"), r"sensors\.currant: no such field; is `current` me"),
    "fault kind": (GOOD.replace('kind = "supply"', 'kind = "suply"'), r"kind: found 'suply', .*; is `supply` meant\?"),
    "kit": (GOOD.replace('"real"', '"best"'), r":11: sensors\.kit: found 'best', expected one of exact, ideal, real"),
    "effect": (GOOD.replace("viscous_friction", "stickiness"), r"effect\.stickiness: no effect that the plant can"),
    "effect's size": (GOOD.replace('b = "0.2 mN m s/rad"', ""), r"effect\.viscous_friction\.b: missing"),
    "check": (GOOD.replace("max(slip) < 2", "max(slip <"), r":5: checks: 'max\(slip <': cannot be read"),
    "checks": (GOOD.replace('["max(slip) < 2"]', "3"), r"checks: found 3, expected a list of texts"),
    "ground": (GOOD.replace("seed = 9", 'ground = "deep"'), r"ground: found 'deep', expected one of default, contact"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_files_are_told_with_file_line_and_field(tmp_path: Path, case: str) -> None:
    text, message = WRONG[case]
    with pytest.raises(ReadingError, match=message) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "wrong.toml"))
    assert "\n" not in str(caught.value)


def test_no_such_scenario() -> None:
    with pytest.raises(ReadingError, match=r"nowhere\.toml: no such file.*steady_sand"):
        find_scenario("nowhere.toml")
    assert find_scenario("steady_sand").is_file()


@settings(deadline=None)
@given(st.text(max_size=30))
def test_any_text_as_a_quantity_is_read_or_refused(text: str) -> None:
    try:
        value = parse_quantity(text, "m")
    except ValueError as error:
        value = 0.0 if "expected" in str(error) else math.nan
    assert math.isfinite(value)


# ------------------------------------------------------------------ checks

TIME = np.array([0.0, 1.0, 2.0, 3.0])
SIGNALS = {
    "slip": np.array([0.0, 0.2, 0.9, 0.5]),
    "A.state": np.array([np.nan, 1.0, 2.0, 2.0]),
}
ENUMS = {"A.state": {"idle": 1, "stuck": 2}}


@pytest.mark.parametrize(
    ("text", "passed"),
    [
        ("max(slip) < 0.95", True),
        ("max(slip) < 0.9", False),
        ("max(slip[:1]) <= 0.2", True),
        ("min(slip[1:2]) > 0.1 and max(slip[3:]) == 0.5", True),
        ("abs(last(slip) - 0.5) < 0.02", True),
        ("max(abs(slip[2:] - 0.7)) < 0.21", True),
        ("0.3 < mean(slip) < 0.5", True),
        ("any(A.state == 'stuck')", True),
        ("all(A.state == 'stuck')", False),
        ("all(A.state[2:] == 'stuck')", True),
        ("count(A.state == 'idle') == 1", True),
        ("not any(slip > 1)", True),
        ("first(slip) == 0 or last(slip) == 0", True),
        ("max(slip[7:]) < 1", False),  # an empty window holds no value and proves nothing
        ("not (max(slip[7:]) < 1)", False),
        ("any(slip[7:] > 1)", False),
        ("all(slip[7:] < 1)", False),
        ("not any(slip[7:] > 1)", False),
        ("all(slip[7:] < 1) and last(slip) == 0.5", False),
        ("all(slip[7:] < 1) or last(slip) == 0.5", True),
        ("not (any(slip[7:] > 1) or last(slip) == 0)", False),
        ("not (any(slip[7:] > 1) and last(slip) == 0)", True),
        ("count(not (A.state == 'idle')) == 2", True),  # of the three ticks that have a state
        ("max(slip * (slip > 0.3)) < 0.95", True),
        ("sqrt(max(slip)) < 1 and std(slip) > 0.1 and rms(slip) > 0.1", True),
        ("1 / first(slip) < 5", False),
    ],
)
def test_checks(text: str, passed: bool) -> None:
    outcome = parse_check(text).evaluate(TIME, SIGNALS, ENUMS)
    assert outcome.passed is passed
    assert outcome.found


def test_a_window_behind_the_runs_end_is_said_to_be_empty() -> None:
    """It read `no value`, as if the signal had none."""
    assert TIME[-1] < 30.0
    missed = parse_check("max(slip[30:40]) < 1").evaluate(TIME, SIGNALS, ENUMS).missed
    assert missed == f"max(slip[30:40]) < 1: no value; slip[30:40] is empty: the run ends at {TIME[-1]:.4g} s"
    assert "empty" not in parse_check("max(slip[1:]) < 0").evaluate(TIME, SIGNALS, ENUMS).missed


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("max(slip", "cannot be read"),
        ("max(slope) < 5 deg", "cannot be read: .*; expected text such as max.slip. < 0.55, in SI, no unit"),
        ("slip + 1", "expected a comparison"),
        ("__import__('os').system('x') == 0", "unknown function"),
        ("open('x') == 1", "unknown function"),
        ("max(slip, 2) < 1", "takes one argument"),
        ("slip[1] < 1", "time window"),
        ("(lambda: 1)() < 2", "unknown function"),
        ("max([1, 2]) < 1", "cannot be used here"),
        ("a.b.c < 1", "is no signal"),
        ("x" * 600, "longer than"),
        ("max(True) < 1", "neither a number nor a word"),
        ("max(slip)", r"'max\(slip\)' is a number, not yes or no"),
        ("any(slip > 1) and not (max(slip) < 1 or mean(slip))", r"'mean\(slip\)' is a number"),
    ],
)
def test_wrong_checks_are_refused(text: str, message: str) -> None:
    with pytest.raises(CheckError, match=message):
        parse_check(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("max(slop) < 1", "no signal 'slop'; is `slip` meant\\? it has slip, and MESSAGE.signal of A$"),
        ("any(A.stat == 1)", "no signal 'A.stat'; is `A.state` meant\\? A has A.state$"),
        ("any(A.state == 'flying')", "'flying' is no value of A.state; known: idle, stuck"),
        ("slip < 1", "put any"),
    ],
)
def test_checks_that_do_not_fit_the_run(text: str, message: str) -> None:
    with pytest.raises(CheckError, match=message):
        parse_check(text).evaluate(TIME, SIGNALS, ENUMS)


@pytest.mark.parametrize("text", ["1if", "max(slip) < 1and 1 < 2", r"any(A.state == '\d')"])
def test_python_says_nothing_of_a_text_of_the_user(text: str, tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    """Its parser takes the text for code of ours, and would tell on the terminal what is odd in it."""
    (tmp_path / "effect.py").write_text(text)
    with suppress(CheckError):
        parse_check(text)
    with suppress(ValueError):
        parse(text)
    with suppress(ReadingError):
        read_effect_file(tmp_path / "effect.py")
    assert [str(one.message) for one in recwarn] == []


@settings(deadline=None)
@given(st.text(alphabet="maxslip()[]<>=.0123456789 +-*/'andort", max_size=40))
def test_any_text_as_a_check_is_read_or_refused(text: str) -> None:
    try:
        check = parse_check(text)
    except CheckError:
        return
    try:
        check.evaluate(TIME, SIGNALS, ENUMS)
    except CheckError:
        return


# ------------------------------------------------------------------ effects in the plant


def steady_torque(tmp_path: Path, extra: str, seconds: float = 6.0) -> dict[str, float]:
    text = f'duration = "{seconds} s"\n[[path]]\nterrain = "agricultural"\n[[operator]]\nat = 0\nrequest = "run"\n'
    result = run(read(tmp_path, text + 'setpoint = "6 V"\n' + extra))
    return {name: float(np.mean(values[-600:])) for name, values in result.truth.items()}


def test_effects_act_where_they_say(tmp_path: Path) -> None:
    """Robot-side friction adds to C_o and leaves C_t to the ground; ground-side resistance is part of C_t."""
    plain = steady_torque(tmp_path, "")
    robot = steady_torque(tmp_path, '[effect.viscous_friction]\nb = "1 mN m s/rad"\n')
    assert robot["internal_friction"] == pytest.approx(0.012 + 2e-3 * robot["omega"], rel=1e-4)
    dry = steady_torque(tmp_path, '[effect.coulomb_friction]\nda = "5 mN m"\n')
    assert dry["internal_friction"] == pytest.approx(0.017 + 1e-3 * dry["omega"], rel=1e-4)
    ground = steady_torque(tmp_path, "[effect.speed_squared]\nf_s = 1e-3\n")
    expected = (0.028 + 1.098e-3 * ground["omega"] ** 2) * 0.08 * 18.639
    assert ground["contact_torque"] == pytest.approx(expected, rel=1e-4)
    assert ground["internal_friction"] == pytest.approx(0.012 + 1e-3 * ground["omega"], rel=1e-4)
    hot = steady_torque(tmp_path, "[effect.motor_heating]\na_t = 0.002\n[winding]\nprofile = [[0, 65]]\n")
    assert hot["motor_torque"] / hot["current"] == pytest.approx(0.1 * 0.92, rel=1e-6)
    assert plain["motor_torque"] / plain["current"] == pytest.approx(0.1, rel=1e-9)


def test_passive_effects_hold_at_standstill(tmp_path: Path) -> None:
    """Coulomb friction of 0.5 N m is more than the motor has at 6 V: nothing moves, nothing creeps."""
    end = steady_torque(tmp_path, '[effect.coulomb_friction]\nda = "0.7 N m"\n', 3.0)
    assert end["omega"] == 0.0
    assert end["alpha_rate"] == 0.0


def test_effects_that_the_plant_cannot_take() -> None:
    effects = catalogue()
    with pytest.raises(EffectError, match="inertia: the plant cannot take"):
        compile_effects([ActiveEffect(effects["inertia"], {"j": 1.0})], {})
    with pytest.raises(EffectError, match="the plant has no 'radius'"):
        compile_effects([ActiveEffect(effects["speed_squared"], {"f_s": 1.0})], {})
    usable = [e for e in effects.values() if e.plant and "rolling_steady" in e.bases]
    assert len(usable) >= 7
    constants = {"radius": 0.08, "drive_radius": 0.018, "torque_constant": 0.1, "coulomb": 0.012, "viscous": 1e-3}
    everything = [ActiveEffect(e, {p.name: p.start for p in e.parameters}) for e in usable]
    assert compile_effects(everything, constants).native.count == len(everything)


def test_what_was_set_is_told_beside_a_title_with_other_numbers() -> None:
    """A run at 5 V on a hard floor had the title: on dry sand at 8 V, and said nothing."""
    path = find_scenario("steady_sand")
    (note,) = load_scenario(path, {"operator.1.setpoint": "5 V", "path.1.terrain": "hard_floor"}).notes
    assert note == "set: operator.1.setpoint = 5 V, path.1.terrain = hard_floor; the title is as it was"
    assert load_scenario(path).notes == ()
    assert load_scenario(path, {"operator.1.setpoint": "5 V", "title": "At 5 V"}).notes == ()
