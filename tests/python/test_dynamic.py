"""The dynamic models and the effects on them: each does what its equation says, and nothing where its size is 0."""

from __future__ import annotations

import doctest
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from terrapin_hil.physics import dynamic, program, vehicle
from terrapin_hil.physics.bodies import bodies
from terrapin_hil.physics.dynamic import Run, simulate
from terrapin_hil.physics.effects import catalogue
from terrapin_hil.physics.expression import parse
from terrapin_hil.physics.program import TORQUE, Additions
from terrapin_hil.physics.soils import library
from terrapin_hil.physics.tyre import ContactError, Tyre
from terrapin_hil.physics.vehicle import Vehicle, profile_torque
from terrapin_hil.robot import plant
from terrapin_hil.scenario.scenario import load_scenario
from terrapin_hil.simulation import Simulation
from tests.campaigns import own_bodies

Array = npt.NDArray[np.float64]
T = np.arange(0.0, 4.0, 0.01)
SAND = library()["sand_vella"].footing(0.235)
SOIL = {
    "k_s": SAND.stiffness,
    "n": SAND.exponent,
    "cohesion": SAND.cohesion,
    "friction_angle": SAND.friction_angle,
    "shear_modulus": SAND.shear_modulus,
}
DRIVE = profile_torque(0)[: len(T)]
PAIRS = [(base, name) for base in bodies() for name, e in catalogue().items() if base in e.bases]
VOLTAGE = np.where(T < 2.0, 5.0, 3.0)
JOINT = np.clip(T, 0.0, 1.5)


def run(base: str, effects: dict[str, dict[str, float]] | None = None, **parameters: float) -> Run:
    inputs = {"time": T, "slope": np.full(T.size, 0.04), "temperature": 25.0 + 10.0 * T}
    inputs |= {"moisture": np.full(T.size, 0.1)}
    inputs |= {
        "cmr": {"voltage": VOLTAGE},
        "pendulum_sphere": {"joint_rate": JOINT},
        "vehicle": {"drive_torque": DRIVE},
    }[base]
    soil = SOIL if base == "vehicle" else {"f_o": 0.05}
    return simulate(base, {**soil, **parameters}, inputs, effects)


def test_examples() -> None:
    assert doctest.testmod(dynamic).failed == 0
    assert doctest.testmod(program).failed == 0


@pytest.mark.parametrize(
    "text",
    [
        *("a*b + 2", "-a/(b - 3)", "max(a, b)*min(a, b)", "abs(a)**1.5 + b**2", "(a > b) + (a <= b)*2 + (a != b)"),
        *("exp(-a)*log(b) - sqrt(abs(a))", "sin(a)*cos(b)*tan(a) - tanh(b)", "a - b - (a - (b - a))"),
        "(a == b) + (a >= b)",
    ],
)
def test_programs_compute_what_formulas_say(text: str) -> None:
    from terrapin_hil.physics.compiled import ffi, library, pointer

    terms = Additions({"a": 0, "b": 1}, 0.05)
    terms.add(text, TORQUE, ground=False)
    _, kept = terms.native()
    for a, b in ((0.7, 2.0), (-1.3, 0.4), (0.5, 0.5)):
        table = np.array([a, b])
        found = library().hil_program_run(kept[0], len(terms.code), 0.05, pointer(table))
        assert found == pytest.approx(float(parse(text).evaluate({"a": a, "b": b})), rel=1e-15)
    assert ffi().sizeof("hil_instruction") == 16


def test_cmr_is_the_rolling_robot_of_the_simulator() -> None:
    """Same equations as the plant's reference, at a step that leaves no error; and Table 1's end states on sand."""
    times = np.arange(0.0, 3.0, 0.1)
    reference = plant.rolling(plant.Robot(), plant.TERRAINS["sand"], 5.0, times, dt=1e-4)
    fine = np.arange(0.0, 3.0, 0.001)
    found = simulate(
        "cmr", {"f_o": 0.092}, {"time": fine, "voltage": np.full(fine.size, 5.0)}, {"speed_squared": {"f_s": 0.28e-3}}
    )
    np.testing.assert_allclose(
        found.channels["omega"][::100][: len(times)], reference["alpha_dot"], rtol=1e-8, atol=1e-9
    )
    np.testing.assert_allclose(
        found.motion["shell_rate"][::100][: len(times)], reference["beta_dot"], rtol=1e-8, atol=1e-9
    )
    coarse = simulate(
        "cmr", {"f_o": 0.092}, {"time": times, "voltage": np.full(times.size, 5.0)}, {"speed_squared": {"f_s": 0.28e-3}}
    )
    np.testing.assert_allclose(coarse.channels["omega"][2:], reference["alpha_dot"][2:], rtol=2e-5)


# V_n [V], omega [rad/s], current [A] of steady rolling on sand, f_o 0.092, f_s 0.28e-3 s^2/rad^2
STEADY_SAND = [
    (2.0, 0.700872091, 0.337700259),
    (3.0, 2.81850641, 0.349466097),
    (4.0, 4.85216832, 0.368696150),
    (5.0, 6.81111954, 0.394567152),
    (6.0, 8.70303493, 0.426396895),
    (7.0, 10.5343589, 0.463612540),
    (8.0, 12.3105651, 0.505727543),
]


@pytest.mark.parametrize(("volts", "omega", "current"), STEADY_SAND)
def test_cmr_reaches_the_steady_speeds_of_eq_12(volts: float, omega: float, current: float) -> None:
    t = np.arange(0.0, 12.0, 0.01)
    inputs = {"time": t, "voltage": np.full(t.size, volts)}
    end = simulate("cmr", {"f_o": 0.092, "smoothing": 1e-3}, inputs, {"speed_squared": {"f_s": 0.28e-3}}).channels
    assert end["omega"][-1] == pytest.approx(omega, rel=1e-6)
    assert end["current"][-1] == pytest.approx(current, rel=1e-6)


def test_friction_that_follows_the_swing_is_dry_friction_of_that_swing(tmp_path: Path) -> None:
    """In steady rolling, of the model over time and of the plant."""
    t = np.arange(0.0, 12.0, 0.01)
    inputs = {"time": t, "voltage": np.full(t.size, 6.0)}
    run = simulate("cmr", {"f_o": 0.092}, inputs, {"swing_friction": {"k": 0.1}})
    friction = 0.1 * abs(np.sin(run.channels["swing_angle"][-1]))
    assert friction > 0.01
    same = simulate("cmr", {"f_o": 0.092, "coulomb": 0.012 + friction}, inputs)
    for name in ("omega", "current", "swing_angle"):
        assert run.channels[name][-1] == pytest.approx(same.channels[name][-1], rel=1e-7)
    sand = '[[path]]\nterrain = "sand"\n[[operator]]\nat = 0\nrequest = "idle"\n'
    ends, dry, effect = [], 0.012, "[effect.swing_friction]\nk = 0.1"
    for name in ("own", "dry"):
        file = tmp_path / f"{name}.toml"
        file.write_text(f"duration = 12.0\n[robot]\ncoulomb = {dry}\n{effect}\n{sand}")
        simulation = Simulation(load_scenario(file))
        simulation.drive(6.0, 12_000)
        truth = simulation.truth()
        ends.append(float(truth["omega"][-1]))
        dry, effect = 0.012 + 0.1 * abs(np.sin(truth["swing_angle"][-1])), ""
    assert dry > 0.022
    assert ends[0] == pytest.approx(ends[1], rel=1e-4)


def test_car_is_the_limit_of_the_car_of_the_estimator() -> None:
    """That one holds its wheels at rest only after each step, so it is off by the first power of the step at launch."""
    found = simulate("vehicle", SOIL, {"time": T, "drive_torque": DRIVE})
    off = []
    for substeps in (8, 16, 32):
        car = vehicle.simulate(Vehicle(), Tyre(), SAND, DRIVE, substeps=substeps)
        gaps = found.channels["omega_fl"] - car.omega[:, 0], found.channels["omega_rr"] - car.omega[:, 1]
        off.append(max(float(np.abs(gap).max()) for gap in (*gaps, found.channels["speed"] - car.speed)))
    assert off[2] < 0.1  # rad/s, of some 60
    np.testing.assert_allclose([off[1] / off[0], off[2] / off[1]], 0.5, atol=0.1)


NEIGHBOURS = {  # parameters, and what drives the run
    "cmr": (("f_o", "viscous", "torque_constant", "body_mass"), {"voltage": VOLTAGE}),
    "pendulum_sphere": (("f_o", "viscous", "bob_mass"), {"joint_rate": JOINT}),
    "vehicle": (("k_s", "friction_angle", "mass", "wheel_inertia"), {"drive_torque": DRIVE}),
}


@pytest.mark.parametrize("base", NEIGHBOURS)
def test_neighbours_are_what_runs_of_their_own_differ_by(base: str) -> None:
    names, inputs = NEIGHBOURS[base]
    plan = dynamic.Plan(bodies()[base], [])
    values = plan.values()
    for name, value in (SOIL if base == "vehicle" else {"f_o": 0.05}).items():
        values[plan.slots[name]] = value
    tables = np.tile(values, (1 + len(names), 1))
    for table, name in zip(tables[1:], names, strict=True):
        table[plan.slots[name]] *= 1.0 + 1e-5
    first, *others = plan.near(tables, T, inputs)
    for other, name in zip(others, names, strict=True):
        up = values.copy()
        up[plan.slots[name]] *= 1.0 + 1e-3
        own, down = plan.channels(up, T, inputs), 2.0 * values - up
        back = plan.channels(down, T, inputs)
        for channel, start in first.items():
            slope = (other[channel] - start) / 1e-5
            central = (own[channel] - back[channel]) / 2e-3
            size = max(
                float(np.abs(central).max()), 1e-9
            )  # the joint's friction moves nothing where its rate is imposed
            np.testing.assert_allclose(slope, central, atol=0.02 * size, err_msg=f"{name} {channel}")


@pytest.mark.parametrize(("base", "name"), PAIRS, ids=[f"{b}-{n}" for b, n in PAIRS])
def test_an_effect_of_size_zero_is_absent_and_another_is_felt(base: str, name: str) -> None:
    plain, absent = run(base), run(base, {name: {}})
    for channel, values in plain.channels.items():
        np.testing.assert_allclose(absent.channels[channel], values, rtol=1e-12, atol=1e-12)
    first = catalogue()[name].parameters[0]
    size = min(0.02, 0.5 * first.maximum)
    felt = run(base, {name: {first.name: size}})
    if name == "backlash" or (name == "inertia" and base == "vehicle"):
        return  # needs a reversal: see below
    assert any(np.abs(felt.channels[c] - v).max() > 1e-9 * np.abs(v).max() for c, v in plain.channels.items())


# an effect on the car, and the parameter of the model that says the same
SAME_CAR = [
    ("aerodynamic_drag", {"cda": 0.8}, {"drag": 0.55 + 0.5 * 1.225 * 0.8}),
    ("load_transfer", {"rise": 0.2}, {"height": 0.85}),
    ("relaxation_length", {"longer": 0.25}, {"relaxation_length": 0.55}),
    ("tyre_flexibility", {"e": 1e-6}, {"tyre_stiffness": 1.0 / (1.0 / 180e3 + 1e-6)}),
    ("moisture_cohesion", {"c_w": 5000.0}, {"cohesion": SAND.cohesion + 500.0}),
    ("torque_ripple", {"a": 0.05, "k": 1.0, "phase": 0.0}, None),
]


@pytest.mark.parametrize(("name", "values", "same"), SAME_CAR, ids=[row[0] for row in SAME_CAR])
def test_effects_on_the_car_are_the_parameters_that_they_change(
    name: str, values: dict[str, float], same: dict[str, float] | None
) -> None:
    with_it = run("vehicle", {name: values})
    if same is None:  # no parameter says it; on average over turns the torque is what it was
        assert with_it.motion["speed"][-1] == pytest.approx(run("vehicle").motion["speed"][-1], rel=0.05)
        return
    wanted = run("vehicle", **same)
    for channel, expected in wanted.channels.items():
        np.testing.assert_allclose(with_it.channels[channel], expected, rtol=1e-6, atol=1e-6)


def test_left_and_right_wheels_part_as_those_of_a_car_with_four() -> None:
    """One of our own (tests/campaigns/own_bodies.py), whose left soil is a tenth softer and whose right one firmer."""
    t = np.arange(0.0, 2.5, 0.02)
    torque = np.interp(t, [0.0, 0.1, 0.6, 1.6, 1.8, 2.5], [0.0, 0.0, 720.0, 740.0, 400.0, 670.0])
    soil = {"k_s": SAND.stiffness, "n": SAND.exponent, "cohesion": SAND.cohesion}
    soil |= {"angle": SAND.friction_angle, "shear": SAND.shear_modulus}
    own, equal = (own_bodies.car(own_bodies.Car(soil, left=left), t, torque[None]) for left in (0.9, 1.0))
    plain = simulate("vehicle", SOIL, {"time": t, "drive_torque": torque})
    parted = simulate("vehicle", SOIL, {"time": t, "drive_torque": torque}, {"split_ground": {"split": -0.18}})
    wanted, found = [], []
    for axle in "fr":
        left, right = f"omega_{axle}l", f"omega_{axle}r"
        np.testing.assert_allclose(plain.channels[left][10:], equal[left][0][10:], atol=0.01)
        middle = 0.5 * (parted.channels[left] + parted.channels[right])
        np.testing.assert_allclose(middle, plain.channels[left], atol=1e-9)
        wanted.append(own[left][0] - own[right][0])
        found.append(parted.channels[left] - parted.channels[right])
    whole = np.array(wanted)[:, 20:]  # how the wheels start is their inertia, which the effect does not know
    rest = np.array(found)[:, 20:] - whole
    assert (rest**2).mean() < 0.5 * (whole**2).mean()
    np.testing.assert_allclose(found[0][-1], wanted[0][-1], rtol=0.1)
    np.testing.assert_allclose(found[1][-1], wanted[1][-1], rtol=0.1)


def test_rear_wheels_of_a_car_roll_in_ruts() -> None:
    """multipass with kappa: the rear axle's soil is 2^kappa stiffer, the front's is not; on a second pass 3 and 4."""
    plain, firm = run("vehicle"), run("vehicle", {"multipass": {"kappa": 0.4}})
    stiff = run("vehicle", k_s=SAND.stiffness * 2**0.4)
    assert firm.motion["sinkage"][0] == plain.motion["sinkage"][0]  # not solved yet
    np.testing.assert_allclose(firm.motion["sinkage"][5:20], plain.motion["sinkage"][5:20], rtol=2e-3)
    rear = np.abs(firm.channels["omega_rl"] - plain.channels["omega_rl"]).max()
    assert rear > 0.05
    both = simulate(
        "vehicle",
        SOIL,
        {"time": T, "drive_torque": DRIVE, "pass_": np.full(T.size, 2.0)},
        {"multipass": {"kappa": 0.4}},
    )
    third = run("vehicle", k_s=SAND.stiffness * 3**0.4)
    np.testing.assert_allclose(both.motion["sinkage"][5:20], third.motion["sinkage"][5:20], rtol=2e-3)
    assert np.abs(stiff.channels["omega_rl"] - firm.channels["omega_rl"]).max() > 0.05


def test_slope_holds_back_by_the_weights_share() -> None:
    """Without torque on a downhill slope the robot runs away with g sin(slope) less what resists and turns."""
    t = np.arange(0.0, 0.05, 0.001)
    inputs = {"time": t, "drive_torque": np.full(t.size, 0.0), "slope": np.full(t.size, -0.05)}
    down = simulate("vehicle", {**SOIL, "drag": 0.0}, inputs, {"slope": {"gain": 1.0}}, start=10.0)
    level = simulate("vehicle", {**SOIL, "drag": 0.0}, inputs, start=10.0)
    gained = np.gradient(down.channels["speed"] - level.channels["speed"], t)[3]
    assert gained == pytest.approx(9.81 * np.sin(0.05), rel=0.05)
    sphere = run("pendulum_sphere", {"slope": {"gain": 1.0}})
    exact = run("pendulum_sphere", incline=0.04)
    np.testing.assert_allclose(sphere.channels["torque"], exact.channels["torque"], atol=0.06)


def test_delay_misalignment_and_backlash_act_on_what_is_measured() -> None:
    plain = run("cmr")
    late = run("cmr", {"sensor_delay": {"delay": 0.05}})
    np.testing.assert_allclose(late.channels["omega"][5:], plain.channels["omega"][:-5], atol=1e-12)
    np.testing.assert_allclose(late.channels["current"][5:], plain.channels["current"][:-5], atol=1e-12)
    bent = run("cmr", {"encoder_misalignment": {"misalignment": 0.05, "phase": 0.3}})
    gear, angle = 0.08 / 0.018, plain.motion["angle"]
    expected = plain.channels["omega"] * (1.0 + 0.05 * np.cos(gear * angle + 0.3))
    np.testing.assert_allclose(bent.channels["omega"][1:-1], expected[1:-1], atol=0.03)
    assert np.abs(bent.channels["omega"] - plain.channels["omega"]).max() > 0.1
    np.testing.assert_array_equal(bent.channels["current"], plain.channels["current"])
    t = np.arange(0.0, 6.0, 0.01)
    there_and_back = np.where(t < 3.0, 4.0, -4.0)
    inputs = {"time": t, "voltage": there_and_back}
    plain = simulate("cmr", {"f_o": 0.05}, inputs)
    loose = simulate("cmr", {"f_o": 0.05}, inputs, {"backlash": {"gap": 0.2}})
    lost = np.cumsum(plain.channels["omega"] - loose.channels["omega"]) * 0.01
    turn = int(np.argmax(plain.motion["angle"]))
    assert lost[turn] == pytest.approx(0.1, abs=0.01)  # half of the gap from its middle, and the whole at the reversal
    assert lost[-1] == pytest.approx(-0.1, abs=0.01)


def test_heat_changes_the_motor() -> None:
    t = np.arange(0.0, 10.0, 0.01)
    inputs = {"time": t, "voltage": np.full(t.size, 5.0), "temperature": np.full(t.size, 75.0)}
    warm = simulate("cmr", {"f_o": 0.05}, inputs, {"winding_temperature": {"a_r": 0.0039}})
    same = simulate("cmr", {"f_o": 0.05, "armature_resistance": 5.0 * (1.0 + 0.0039 * 50.0)}, inputs)
    np.testing.assert_allclose(warm.channels["omega"], same.channels["omega"], rtol=1e-12)
    weak = simulate("cmr", {"f_o": 0.05}, inputs, {"motor_heating": {"a_t": 0.002}})
    same = simulate("cmr", {"f_o": 0.05, "torque_constant": 0.09}, inputs)
    np.testing.assert_allclose(weak.channels["omega"], same.channels["omega"], rtol=1e-12)


def test_inertia_joins_the_mass_matrix() -> None:
    """J alpha'' on the drive is the same as a heavier inner body there: Ia counts in M22 only with the swing's part."""
    plain = run("cmr")
    heavy = run("cmr", {"inertia": {"j": 0.02}})
    gained = heavy.motion["acceleration"][1], plain.motion["acceleration"][1]
    assert 0.0 < gained[0] < gained[1]
    sphere = run("pendulum_sphere", {"inertia": {"j": 0.5}})
    extra = sphere.channels["torque"] - run("pendulum_sphere").channels["torque"]
    np.testing.assert_allclose(extra[1:90], 0.5, rtol=1e-9)  # the joint speeds up by 1 rad/s^2


def test_refusals() -> None:
    with pytest.raises(ContactError, match="cmr: parameter f_o is missing"):
        simulate("cmr", {}, {"time": T, "voltage": VOLTAGE})
    with pytest.raises(ContactError, match="cmr: input voltage is missing"):
        simulate("cmr", {"f_o": 0.1}, {"time": T})
    with pytest.raises(ContactError, match="load_transfer: acts on vehicle, found base cmr"):
        run("cmr", {"load_transfer": {"rise": 0.1}})
    broken = simulate("vehicle", {**SOIL, "k_s": 10.0}, {"time": T, "drive_torque": DRIVE})
    assert np.isnan(broken.channels["speed"]).all()
