"""Bodies that slip, as models over time: against the plant, the contact's equilibrium, pure rolling and differences."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from casekit import terrapin

from terrapin_hil.arrays import Array
from terrapin_hil.physics import sphere
from terrapin_hil.physics.bodies import bodies
from terrapin_hil.physics.dynamic import Plan, simulate
from terrapin_hil.physics.effects import catalogue
from terrapin_hil.physics.tyre import ContactError
from terrapin_hil.robot.plant import Ground, Robot, Segment, Terrain
from terrapin_hil.robots import constants_of
from terrapin_hil.scenario.scenario import Order, Scenario
from terrapin_hil.simulation import Simulation
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases import BASES
from terrapin_tools.workbench.bases.kinds.integrated import Integrated
from terrapin_tools.workbench.case.case import load_case

GROUND = {"f_o": 0.06, "mu": 0.45, "s_k": 0.15}
SAND = {"k_s": 8e6, "n": 0.97, "friction_angle": 0.7, "shear_modulus": 0.012}
TIME = np.arange(0.0, 3.0, 0.02)
VOLTAGE = np.interp(TIME, [0.0, 0.5, 1.5, 1.7, 3.0], [0.0, 5.0, 5.0, 2.5, 4.0])
JOINT = np.interp(TIME, [0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 1.5, 0.5])
HEAVY = {"bob_mass": 4.0}  # whose bob holds what sand resists


@pytest.mark.parametrize("robot", [Robot(), replace(Robot(), gear_efficiency=0.8, motor_coulomb=2e-3)])
def test_it_moves_as_the_simulators_plant(robot: Robot) -> None:
    """The plant steps 1 ms with friction that is set-valued at rest; here it is smooth within 0.05 rad/s."""
    terrain = Terrain(GROUND["f_o"], 0.0, GROUND["mu"], GROUND["s_k"], 0.0)
    hill = Ground((Segment(terrain, slope=0.1),))
    simulation = Simulation(Scenario("test", 3.0, hill, (Order(0.0, "run"),), robot=robot, supply_resistance=0.0))
    simulation.drive(5.0, 3000)
    truth = simulation.truth()
    time = np.arange(0.0, 3.0, 0.01)
    inputs = {"time": time, "voltage": np.full(len(time), 5.0), "slope": np.full(len(time), 0.1)}
    run = simulate("cmr_slip", {**asdict(robot), **GROUND, "smoothing": 0.01}, inputs)
    at = np.rint(time[1:] * 1000.0).astype(int) - 1
    for name, key in {"speed": "speed", "slip": "slip", "shell_rate": "omega", "swing_angle": "swing_angle"}.items():
        there, here = truth[key][at], run.motion[name][1:]
        later = time[1:] > 0.3  # the slip of what stands is a matter of its floor
        assert np.abs(here - there)[later].max() < 0.03 * np.abs(there[later]).max(), name
    assert np.abs(run.motion["slip"][-1] - truth["slip"][at[-1]]) < 2e-3


def test_without_slip_it_rolls() -> None:
    inputs = {"time": TIME, "voltage": VOLTAGE}
    rolls = simulate("cmr", {"f_o": 0.06}, inputs).channels
    grips = simulate("cmr_slip", {**GROUND, "s_k": 1e-4}, inputs)
    for name, channel in rolls.items():
        assert np.abs(grips.channels[name] - channel).max() < 1e-3 * channel.std(), name
    assert np.abs(grips.motion["slip"]).max() < 1e-3


@pytest.mark.parametrize("slope", [0.0, 0.08])
def test_a_sphere_that_rolls_steadily_is_at_the_contacts_equilibrium(slope: float) -> None:
    """Its pull is the weight's share along the slope, at the load that presses on it, and the joint's torque is that of
    the contact and of the joint's friction (Eqs. 4 to 6)."""
    time = np.arange(0.0, 4.0, 0.05)
    given = {**SAND, **HEAVY, "bob_mass": 6.0, "viscous": 2.0}
    inputs = {"time": time, "joint_rate": np.ones(len(time)), "slope": np.full(len(time), slope)}
    run = simulate("sphere_slip", given, inputs, start=1.0)
    assert np.ptp(run.channels["torque"]) < 1e-6 * run.channels["torque"].mean()
    slip, weight = float(run.motion["slip"][-1]), float(run.motion["load"][-1])
    soil = sphere.Soil(SAND["k_s"], SAND["n"], 0.0, SAND["friction_angle"], SAND["shear_modulus"])
    contact = sphere.solve(weight * np.cos(slope), slip, 0.22, soil)
    assert 0.01 < slip < 0.9
    assert abs(float(contact.traction[0]) - weight * np.sin(slope)) < 2e-4 * weight
    assert run.channels["torque"][-1] == pytest.approx(float(contact.torque[0]) + 2.0, rel=1e-3)
    swing = run.channels["swing_angle"][-1]
    assert 6.0 * 9.81 * 0.13 * np.sin(swing) == pytest.approx(float(contact.torque[0]), rel=1e-3)
    assert run.channels["speed"][-1] == pytest.approx(0.22 * (1.0 - slip), rel=1e-3)


CASES: list[tuple[str, dict[str, float], dict[str, Array], tuple[str, ...]]] = [
    ("cmr_slip", GROUND, {"voltage": VOLTAGE, "slope": np.full(len(TIME), 0.08)}, ("f_o", "mu", "s_k", "viscous")),
    ("sphere_slip", {**SAND, **HEAVY}, {"joint_rate": JOINT}, ("k_s", "shear_modulus", "viscous", "bob_mass")),
]


@pytest.mark.parametrize(("name", "given", "inputs", "moved"), CASES, ids=["cylinder", "sphere"])
def test_neighbours_are_differences(
    name: str, given: dict[str, float], inputs: dict[str, Array], moved: tuple[str, ...]
) -> None:
    plan = Plan(bodies()[name], [], list(inputs))
    values = plan.values()
    for key, value in given.items():
        values[plan.slots[key]] = value
    tables = np.repeat(values[None], 1 + 2 * len(moved), axis=0)
    for i, key in enumerate(moved):
        at = plan.slots[key]
        tables[1 + i, at] += 1e-6 * values[at]
        tables[1 + len(moved) + i, at] += 1e-3 * values[at]
    near = plan.near(tables[: 1 + len(moved)], TIME, inputs)
    for i, key in enumerate(moved):
        far = plan.channels(tables[1 + len(moved) + i], TIME, inputs)
        for channel, value in far.items():
            wanted = (value - near[0][channel]) / 1e-3
            found = (near[1 + i][channel] - near[0][channel]) / 1e-6
            assert np.abs(found - wanted).max() <= 0.02 * np.abs(wanted).max(), (key, channel)


def test_what_cannot_be_is_no_number_or_is_refused() -> None:
    inputs = {"time": TIME, "joint_rate": JOINT}
    nothing = simulate("sphere_slip", {**SAND, "k_s": 1.0}, inputs)  # no sinkage carries it
    assert not np.isfinite(nothing.channels["torque"]).any()
    with pytest.raises(ContactError, match=r"slope: acts on .*found base cmr_slip"):
        simulate("cmr_slip", GROUND, {"time": TIME, "voltage": VOLTAGE}, {"slope": {"gain": 1.0}})
    warm = {"time": TIME, "voltage": VOLTAGE, "temperature": np.full(len(TIME), 75.0)}
    weak = simulate("cmr_slip", GROUND, warm, {"motor_heating": {"a_t": 0.002}})
    same = simulate("cmr_slip", {**GROUND, "torque_constant": 0.09}, warm)
    assert weak.channels["omega"] == pytest.approx(same.channels["omega"], rel=1e-9)


@pytest.mark.parametrize("name", [name for name, base in BASES.items() if isinstance(base, Integrated)])
def test_a_case_knows_what_acts_on_its_body(name: str) -> None:
    """Whatever the body takes in a simulation, of its kin too, may be missing in a case of it."""
    of_case = {effect.name for effect in catalogue().values() if BASES[name].takes(effect)}
    assert of_case == {effect.name for effect in catalogue().values() if bodies()[name].takes(effect)}
    assert of_case


def log(folder: Path) -> Path:
    """Four runs of the cylinder on slopes, with the axle's speed measured."""
    random = np.random.default_rng(3)
    rows = ["run,t [s],U [V],slope [deg],omega [rad/s],i [A],swing [rad],speed [m/s]"]
    for run, slope in enumerate((-4.0, 2.0, 6.0, 9.0)):
        inputs = {"time": TIME, "voltage": VOLTAGE * (1.0 + 0.1 * run), "slope": np.full(len(TIME), np.radians(slope))}
        c = simulate("cmr_slip", GROUND, inputs).channels
        told = (c["omega"], 0.03), (c["current"], 4e-3), (c["swing_angle"], 4e-3), (c["speed"], 3e-3)
        noisy = [value + sd * random.standard_normal(len(TIME)) for value, sd in told]
        for each in zip(TIME, inputs["voltage"], *noisy, strict=True):
            t, u, *measured = each
            rows.append(f"r{run},{t:.2f},{u:.4f},{slope},{','.join(f'{v:.5f}' for v in measured)}")
    (folder / "log.csv").write_text("\n".join(rows) + "\n")
    return folder / "log.csv"


def test_a_log_with_the_axles_speed_becomes_such_a_case(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = terrapin(capsys, "case", "table", log(tmp_path), "--to", tmp_path / "case")
    assert status == 0
    assert "* cmr_slip: leaves" in out
    assert "  cmr: leaves" in out
    status, out, _ = terrapin(capsys, "compare", tmp_path / "case", "--json", "-")
    answer = json.loads(out)
    assert 0.9 < answer["ladder"][0]["heldout_error"] < 1.15
    for name, value in GROUND.items():
        found = answer["parameters"][name]
        assert abs(found["value"] - value) < 4.0 * found["sd"]


def test_a_robots_file_states_its_constants(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = log(tmp_path)
    status, *_ = terrapin(capsys, "case", "table", table, "--to", tmp_path / "case", "--robot", "roller")
    assert status == 0
    case, roller = load_case(tmp_path / "case"), constants_of("roller")
    assert {name: case.parameters[name] for name in roller} == pytest.approx(roller)
    assert case.guessed == ("parameters.smoothing",)
    assert set(case.fit) == set(GROUND)
    assert {"stribeck", "cogging", "motor_heating"} <= case.library.keys()  # of its kin, and
    assert "slope" not in case.library  # not what its own equations hold
    status, _, err = terrapin(capsys, "case", "table", table, "--to", tmp_path / "no", "--robot", "roler")
    assert (status, "roller" in err) == (2, True)
    (tmp_path / "own.csv").write_text("run,a,b\n1,1,1\n1,2,2\n2,3,3\n")
    words = ("case", "table", tmp_path / "own.csv", "--to", tmp_path / "no", "--robot", "roller")
    status, _, err = terrapin(capsys, *words)
    assert (status, "--robot: none of a robot's constants is one of equation" in err) == (2, True)


def test_an_effect_on_what_the_tables_hold_is_refused(tmp_path: Path) -> None:
    columns = "".join(f'{n} = {{ column = "{n}", unit = "{u}" }}\n' for n, u in (
        ("time", "s"), ("joint_rate", "rad/s"), ("torque", "N m"), ("speed", "m/s")))  # fmt: skip
    soil = 'k_s = 2e6\nn = 1\nfriction_angle = "40 deg"\nshear_modulus = "10 mm"\n'
    (tmp_path / "case.toml").write_text(
        '[model]\nbase = "sphere_slip"\neffects = ["mine"]\n[effect.mine]\nexpression = "a*slip"\ntarget = "k_s"\n'
        f'a = {{ value = 0.1 }}\n[parameters]\n{soil}[data]\nfiles = ["runs.csv"]\n[data.columns]\n{columns}'
    )
    (tmp_path / "runs.csv").write_text("time,joint_rate,torque,speed\n" + "".join(f"{i},1,1,1\n" for i in range(4)))
    with pytest.raises(UserError, match="found 'k_s', expected one of"):
        load_case(tmp_path)
