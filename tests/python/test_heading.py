"""Heading of a steered sphere: arcs are exact, the simulator's path is the kinematics', slip shortens it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from terrapin_hil.physics.compiled import library, pointer
from terrapin_hil.reading import ReadingError
from terrapin_hil.run.run import Result, run
from terrapin_hil.scenario.scenario import load_scenario
from terrapin_hil.simulation import Simulation

Array = npt.NDArray[np.float64]


def drive(folder: Path, text: str, voltage: float = 5.0, seconds: float = 4.0) -> dict[str, Array]:
    file = folder / "steered.toml"
    file.write_text(
        f'duration = {seconds}\n{text}\n[[path]]\nterrain = "hard_floor"\n[[operator]]\nat = 0\nrequest = "idle"\n'
    )
    simulation = Simulation(load_scenario(file))
    simulation.drive(voltage, round(seconds * 1000))
    return simulation.truth()


def path(way: Array, turned: Array) -> tuple[Array, Array]:
    """x and y [m] from the way travelled so far [m] and the heading [rad] at the same instants, as the plant steps."""
    place = np.zeros(2)
    found = [place.copy()]
    for step, before, after in zip(np.diff(way).tolist(), turned[:-1].tolist(), turned[1:].tolist(), strict=True):
        library().hil_heading_advance(step, before, after, pointer(place))
        found.append(place.copy())
    x, y = np.array(found).T
    return x, y


def test_a_whole_circle_ends_where_it_began() -> None:
    t = np.linspace(0.0, 10.0, 101)
    x, y = path(0.3 * t, 2.0 * np.pi * t / 10.0)
    assert np.hypot(x[-1], y[-1]) < 1e-12
    assert np.ptp(y) * np.pi == pytest.approx(3.0, abs=5e-4)


def test_arcs_are_exact_whatever_the_step() -> None:
    for steps in (1, 7, 1000):
        share = np.linspace(0.0, 1.0, steps + 1)
        x, y = path(2.0 * share, 1.5 * share)
        radius = 2.0 / 1.5
        np.testing.assert_allclose([x[-1], y[-1]], [radius * np.sin(1.5), radius * (1.0 - np.cos(1.5))], atol=1e-12)


def test_a_wavy_path_converges_in_second_order() -> None:
    def end(steps: int) -> Array:
        t = np.linspace(0.0, 1.0, steps + 1)
        x, y = path(t + 0.3 * t**2, np.sin(3.0 * t))
        return np.array([x[-1], y[-1]])

    exact = end(100_000)
    errors = [float(np.abs(end(n) - exact).max()) for n in (20, 40, 80)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)


def test_without_steering_the_path_is_the_position(tmp_path: Path) -> None:
    truth = drive(tmp_path, "start_position = 0.5")
    np.testing.assert_allclose(truth["path_x"], truth["position"] - 0.5, atol=1e-12)
    assert not truth["path_y"].any()
    assert not truth["heading"].any()


def test_the_simulated_path_is_that_of_the_steering(tmp_path: Path) -> None:
    truth = drive(tmp_path, 'steering = [[0, "0 deg"], [1, "0 deg"], [3, "180 deg"], [4, "180 deg"]]')
    wanted = np.interp(truth["time"], [1.0, 3.0], [0.0, np.pi])
    np.testing.assert_allclose(truth["heading"], wanted, atol=1e-12)
    x, y = path(truth["position"] - truth["position"][0], wanted)
    np.testing.assert_allclose(truth["path_x"], x, atol=1e-9)
    np.testing.assert_allclose(truth["path_y"], y, atol=1e-9)
    assert truth["path_y"][-1] > 0.3, "it has turned to the left and back"
    assert np.hypot(np.diff(truth["path_x"]), np.diff(truth["path_y"])).sum() == pytest.approx(
        np.abs(np.diff(truth["position"])).sum(), rel=1e-6
    )


def test_it_turns_on_the_spot_and_rolls_back_along_its_line(tmp_path: Path) -> None:
    truth = drive(tmp_path, 'steering = [[0, "90 deg"]]', -5.0)
    assert truth["position"][-1] < -1.0
    np.testing.assert_allclose(truth["path_y"], truth["position"], atol=1e-9)
    np.testing.assert_allclose(truth["path_x"], 0.0, atol=1e-9)


def effects(folder: Path, text: str) -> Simulation:
    """The robot alone at 5 V for 3 s, after which it rolls back, with effects of the catalogue switched on."""
    file = folder / "effects.toml"
    file.write_text(
        f'duration = 6\n{text}\n[[path]]\nterrain = "hard_floor"\n[[operator]]\nat = 0\nrequest = "idle"\n'
        "[winding]\nprofile = [[0, 75]]\n"
    )
    simulation = Simulation(load_scenario(file))
    simulation.drive(5.0, 3000)
    simulation.drive(-5.0, 3000)
    return simulation


def test_effects_of_the_dynamic_models_switch_on_in_the_simulator(tmp_path: Path) -> None:
    plain = effects(tmp_path, "").truth()
    hot = effects(tmp_path, "[effect.winding_temperature]\na_r = 0.0039").truth()
    stiff = effects(tmp_path, f"[robot]\narmature_resistance = {5.0 * (1.0 + 0.0039 * 50.0)}").truth()
    np.testing.assert_allclose(hot["omega"], stiff["omega"], atol=1e-9)
    assert np.abs(hot["omega"] - plain["omega"]).max() > 0.1
    ripple = effects(tmp_path, "[effect.torque_ripple]\na = 0.2\nk = 2\nphase = 0").truth()
    share = ripple["motor_torque"][1000:3000] / ripple["current"][1000:3000] / 0.1
    assert share.max() == pytest.approx(1.2, abs=1e-3)
    assert share.min() == pytest.approx(0.8, abs=1e-3)


def test_effects_on_sensors_are_settings_of_the_simulators(tmp_path: Path) -> None:
    text = "[effect.sensor_delay]\ndelay = '5 ms'\n[effect.backlash]\ngap = 0.1\n"
    text += "[effect.encoder_misalignment]\nmisalignment = 0.02\nphase = 0.3"
    loose = effects(tmp_path, text)
    sensors = loose.scenario.sensors
    assert sensors.motor.delay == sensors.current.delay == 0.005
    assert sensors.motor.play == pytest.approx(0.1 * 0.08 / 0.018)
    assert (sensors.motor.misalignment, sensors.motor.phase) == (0.02, 0.3)
    np.testing.assert_array_equal(loose.truth()["omega"], effects(tmp_path, "").truth()["omega"])
    with pytest.raises(ReadingError, match=r"effect: sensor_delay: found 0.1 s for motor, expected at most 0.063 s"):
        effects(tmp_path, "[effect.sensor_delay]\ndelay = '100 ms'")


def steered(folder: Path, ticks: float = 6.0) -> Result:
    """The controller drives at 5 V while the device is steered through three quarters of a turn."""
    file = folder / "led.toml"
    file.write_text(
        f'duration = {ticks}\nsteering = [[0, "0 deg"], [2, "0 deg"], [5, "270 deg"], [6, "270 deg"]]\n'
        '[[path]]\nterrain = "agricultural"\n'
        '[[operator]]\nat = 0.2\nrequest = "run"\nsetpoint = "5 V"\n'
    )
    return run(load_scenario(file))


def test_the_controller_tells_heading_and_path(tmp_path: Path) -> None:
    result = steered(tmp_path)
    table, truth = result.telemetry["HEADING"], result.truth
    age = next(c["value"] for c in result.interface.json["constants"] if c["name"] == "heading_age") * 1e-3
    at = np.searchsorted(truth["time"], table["time"] - age - 1e-9)
    error = np.angle(np.exp(1j * (table["heading"] - truth["heading"][at])))
    assert np.abs(error).max() < 1.0 * 2.0 * np.pi / 65536, "one step of the steering encoder"
    assert np.ptp(truth["path_x"]) > 0.5
    for axis in ("path_x", "path_y"):
        assert np.abs(table[axis] - truth[axis][at]).max() < 2e-3  # one count of the wheel is 0.09 mm, the signal 1 mm


def test_a_robot_that_is_not_steered_says_nothing_of_a_heading(tmp_path: Path) -> None:
    file = tmp_path / "straight.toml"
    file.write_text(
        'duration = 1\n[[path]]\nterrain = "sand"\n[[operator]]\nat = 0.2\nrequest = "run"\nsetpoint = "5 V"\n'
    )
    assert not len(run(load_scenario(file)).telemetry.get("HEADING", {}).get("time", ()))
