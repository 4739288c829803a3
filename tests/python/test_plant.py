"""The plant against the reference dynamics, against itself in limits, and against its own step size."""

from __future__ import annotations

import csv
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from terrapin_hil.library import ffi, library
from terrapin_hil.robot.plant import TERRAINS, Ground, Robot, Segment, Terrain, Winding, rolling, rolling_steady_speed
from terrapin_hil.scenario.scenario import Order, Scenario
from terrapin_hil.simulation import Simulation

DATA = Path(__file__).parent / "data"
ROBOT = Robot()
SAND = TERRAINS["sand"]


def table(name: str) -> list[dict[str, str]]:
    with (DATA / name).open() as file:
        return list(csv.DictReader(file))


def scenario(*segments: Segment, duration: float = 10.0, **more: object) -> Scenario:
    return Scenario("test", duration, Ground(segments), (Order(0.0, "run"),), **more)  # type: ignore[arg-type]


def drive(voltage: float | None, what: Scenario, substeps: int = 1, fine_substeps: int = 8) -> dict[str, np.ndarray]:
    simulation = Simulation(what, substeps, fine_substeps)
    simulation.drive(voltage, what.ticks)
    return simulation.truth()


# ------------------------------------------------------------------ pure rolling, tanh friction: the reference rows


@pytest.mark.parametrize("row", table("rolling_steady.csv"), ids=lambda r: f"{r['terrain']}-{r['voltage_V']}V")
def test_steady_states(row: dict[str, str]) -> None:
    terrain, voltage = TERRAINS[row["terrain"]], float(row["voltage_V"])
    end = {k: v[0] for k, v in rolling(ROBOT, terrain, voltage, np.array([10.0])).items()}
    omega = rolling_steady_speed(ROBOT, terrain, voltage)
    assert omega == pytest.approx(float(row["omega_rad_s"]), rel=1e-6)
    assert end["beta_dot"] == pytest.approx(float(row["omega_after_10s_rad_s"]), rel=1e-6)
    assert end["C_r"] == pytest.approx(float(row["contact_torque_mNm"]) * 1e-3, rel=1e-6)
    assert end["C_m"] == pytest.approx(float(row["motor_torque_mNm"]) * 1e-3, rel=1e-6)
    assert end["C_o"] == pytest.approx(float(row["internal_friction_mNm"]) * 1e-3, rel=1e-6)
    assert math.degrees(end["alpha"] - end["beta"]) == pytest.approx(float(row["swing_deg"]), rel=1e-5)


def test_transient() -> None:
    rows = table("rolling_transient.csv")
    got = rolling(ROBOT, SAND, 5.0, np.array([float(r["time"]) for r in rows]))
    for column in ("beta", "alpha", "beta_dot", "alpha_dot", "C_m", "C_o", "C_r"):
        expected = np.array([float(r[column]) for r in rows])
        assert np.max(np.abs(got[column] - expected)) <= 1e-6 * np.max(np.abs(expected)), column


LOSSY = replace(ROBOT, gear_efficiency=0.8, driven_ratio=0.9, motor_coulomb=0.02, motor_viscous=2e-3)


@given(st.floats(-1.0, 1.0), st.floats(-20.0, 20.0))
def test_a_gear_passes_on_its_share(torque: float, rate: float) -> None:
    """Written once more: the friction before the gear, then its share by who drives."""
    passed = library().hil_gear_passes(ffi().new("hil_robot *", asdict(LOSSY)), torque, rate)
    for sign, found in ((1.0, passed.middle - passed.half), (-1.0, passed.middle + passed.half)):
        before = torque - 2e-3 * rate - sign * 0.02
        assert found == pytest.approx(before * 0.8 if before * sign > 0.0 else before / 0.72, rel=1e-12, abs=1e-15)
    assert passed.half >= 0.0
    whole = library().hil_gear_passes(ffi().new("hil_robot *", asdict(ROBOT)), torque, rate)
    assert (whole.middle, whole.half) == (torque, 0.0)


def test_a_lossy_drive_rolls_steadily_as_its_equation_says() -> None:
    """eta ((R/r) C_m - A_m - B_m w) = C_r + A + B w: the closed form against the integration to its end."""
    sand = TERRAINS["sand"]
    found = rolling(LOSSY, sand, 6.0, np.array([20.0]))
    assert found["alpha_dot"][-1] == pytest.approx(rolling_steady_speed(LOSSY, sand, 6.0), rel=1e-6)
    gear, w = LOSSY.radius / LOSSY.drive_radius, float(found["alpha_dot"][-1])
    left = 0.8 * (gear * found["C_m"][-1] - 0.02 - 2e-3 * w)
    resistance = (sand.f_o + sand.f_s * w * w) * LOSSY.radius * LOSSY.weight
    assert left == pytest.approx(resistance + LOSSY.coulomb + LOSSY.viscous * w, rel=1e-6)


def test_energy_is_kept_without_losses() -> None:
    free = replace(ROBOT, torque_constant=0.0, coulomb=0.0, viscous=0.0)
    energy = rolling(free, Terrain(), 0.0, np.arange(0.0, 10.0005, 0.01), start=(0.0, 1.0, 0.0, 0.0))["energy"]
    drift = np.max(np.abs(energy / energy[0] - 1.0))
    assert 1e-9 < drift <= 2e-7  # RK4 at 1 ms has a drift: none at all would mean that nothing moved
    coarse = rolling(free, Terrain(), 0.0, np.arange(0.0, 10.001, 0.01), start=(0.0, 1.0, 0.0, 0.0), dt=2e-3)
    ratio = np.max(np.abs(coarse["energy"] / energy[0] - 1.0)) / drift
    assert 20 < ratio < 45  # fifth order: 32


ANGLE, RATE = st.floats(-3.0, 3.0), st.floats(-15.0, 15.0)


@given(ANGLE, ANGLE, RATE, RATE, st.floats(-10.0, 10.0))
def test_impulse_identity(beta: float, alpha: float, beta_rate: float, alpha_rate: float, voltage: float) -> None:
    """dP/dt = (R/r) C_m - C_o - C_r at any state: energies depend on alpha - beta only."""
    f, lib = ffi(), library()
    robot = f.new("hil_robot *", asdict(ROBOT))
    load = f.new("hil_rolling_load *", (voltage, SAND.f_o, SAND.f_s, 0.05))
    state = f.new("hil_rolling_state *", (beta, alpha, beta_rate, alpha_rate))
    accelerations = f.new("double[2]")
    lib.hil_rolling_accelerations(robot, load, state, accelerations)
    torque = lib.hil_rolling_evaluate(robot, load, state)
    gear = ROBOT.radius / ROBOT.drive_radius
    expected = gear * torque.motor - torque.internal_friction - torque.resistance
    assert abs(lib.hil_rolling_momentum_rate(robot, state, accelerations) - expected) <= 1e-12


# ------------------------------------------------------------------ the ground that slips: limits and identities


@given(ANGLE, ANGLE, RATE, RATE, st.floats(-5.0, 5.0))
def test_constrained_to_rolling_it_is_pure_rolling(
    beta: float, alpha: float, beta_rate: float, alpha_rate: float, voltage: float
) -> None:
    """With x = R beta put into the three degrees of freedom on level ground, the two of pure rolling come out."""
    f, lib = ffi(), library()
    robot = f.new("hil_robot *", asdict(ROBOT))
    ground = f.new("hil_ground *")
    mass, force = f.new("double[9]"), f.new("double[3]")
    position = [ROBOT.radius * beta, beta, alpha]
    rate = [ROBOT.radius * beta_rate, beta_rate, alpha_rate]
    lib.hil_body_matrices(robot, ground, position, rate, mass, force)
    load = f.new("hil_rolling_load *", (voltage, 0.0, 0.0, 0.05))
    state = f.new("hil_rolling_state *", (beta, alpha, beta_rate, alpha_rate))
    torque = lib.hil_rolling_evaluate(robot, load, state)
    drive_torque = ROBOT.radius / ROBOT.drive_radius * torque.motor - torque.internal_friction
    constraint = np.array([[ROBOT.radius, 0.0], [1.0, 0.0], [0.0, 1.0]])
    m = constraint.T @ np.array(list(mass)).reshape(3, 3) @ constraint
    q = constraint.T @ (np.array(list(force)) + np.array([0.0, 0.0, drive_torque]))
    accelerations = f.new("double[2]")
    lib.hil_rolling_accelerations(robot, load, state, accelerations)
    assert np.allclose(m @ np.array(list(accelerations)), q, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", sorted(TERRAINS))
@pytest.mark.parametrize("voltage", [3.0, 8.0])
def test_level_ground_has_no_slip_and_the_steady_speed_of_pure_rolling(name: str, voltage: float) -> None:
    truth = drive(voltage, scenario(Segment(TERRAINS[name]), duration=12.0))
    expected = rolling_steady_speed(ROBOT, TERRAINS[name], round(voltage / 12 * 32768) / 32768 * 12)
    assert truth["omega"][-1] == pytest.approx(expected, rel=1e-6)
    assert abs(truth["slip"][-1]) < 1e-6
    gear = ROBOT.radius / ROBOT.drive_radius
    felt = gear * truth["motor_torque"][-1] - truth["internal_friction"][-1]
    assert truth["contact_torque"][-1] == pytest.approx(felt, abs=1e-7)


def imposed_slip(speed: float, voltage: float) -> float:
    """Slip at which drive and ground balance on sand, from the steady equation alone."""
    gear = ROBOT.radius / ROBOT.drive_radius
    damping = gear**2 * ROBOT.torque_constant**2 / ROBOT.armature_resistance + ROBOT.viscous
    stall = gear * ROBOT.torque_constant / ROBOT.armature_resistance * voltage - ROBOT.coulomb
    load = ROBOT.weight * ROBOT.radius

    def excess(slip: float) -> float:
        omega = speed / (ROBOT.radius * (1 - slip))
        ground = (SAND.f_o + SAND.f_s * omega**2) * load + SAND.mu * load * (1 - math.exp(-slip / SAND.s_k))
        return damping * omega + ground - stall

    return float(brentq(excess, 0.0, 0.999, xtol=1e-12))


@pytest.mark.parametrize(("speed", "published"), [(0.36, 0.3700), (0.272, 0.4911), (0.20, 0.6112), (0.04, 0.9192)])
def test_slip_with_imposed_axle_speed(speed: float, published: float) -> None:
    assert imposed_slip(speed, 8.0) == pytest.approx(published, abs=1e-4)
    truth = drive(8.0, scenario(Segment(SAND), duration=40.0, carriage=((0.0, speed), (100.0, speed))))
    exact = imposed_slip(speed, round(8 / 12 * 32768) / 32768 * 12)
    assert np.mean(truth["slip"][-600:]) == pytest.approx(exact, abs=2e-5)
    assert np.max(np.abs(truth["slip"][-600:] - published)) < 1e-3


def test_carriage_force_balances_traction() -> None:
    truth = drive(8.0, scenario(Segment(SAND), duration=40.0, carriage=((0.0, 0.2), (100.0, 0.2))))
    assert np.mean(truth["carriage_force"][-600:]) == pytest.approx(-np.mean(truth["traction"][-600:]), rel=1e-3)


@pytest.mark.parametrize("celsius", [-10.0, 25.0, 65.0])
def test_resistance_of_a_warm_winding(celsius: float) -> None:
    """A stalled motor draws V / R, R = R_25 (1 + slope (T - 25 degC)); huge friction holds it."""
    robot = replace(ROBOT, coulomb=100.0, resistance_slope=0.004)
    winding = Winding(profile=((0.0, celsius), (1.0, celsius)))
    truth = drive(6.0, scenario(Segment(SAND), duration=0.1, robot=robot, winding=winding))
    assert truth["omega"][-1] == 0.0
    expected = 6.0 / (ROBOT.armature_resistance * (1.0 + 0.004 * (celsius - 25.0)))
    assert truth["current"][-1] == pytest.approx(expected, rel=1e-6)


def test_climbing_a_slope_balances_weight() -> None:
    gamma = math.radians(6.0)
    truth = drive(8.0, scenario(Segment(SAND, slope=gamma), duration=30.0))
    expected = -SAND.s_k * math.log(1 - math.tan(gamma) / SAND.mu)
    assert truth["traction"][-1] == pytest.approx(ROBOT.weight * math.sin(gamma), rel=1e-6)
    assert truth["slip"][-1] == pytest.approx(expected, rel=1e-5)


# ------------------------------------------------------------------ standstill: dry friction is set-valued


def test_a_robot_at_rest_stays_at_rest() -> None:
    truth = drive(None, scenario(Segment(SAND), duration=5.0))
    for column in ("position", "omega", "alpha_rate", "swing_angle"):
        assert np.all(truth[column] == 0.0), column


def test_below_the_starting_voltage_nothing_creeps() -> None:
    """1.5 V on sand is less than the starting voltage of 1.678 V: the swing settles, then all stand still."""
    truth = drive(1.5, scenario(Segment(SAND), duration=20.0))
    late = truth["time"] > 10.0
    assert np.max(np.abs(truth["omega"][late])) < 1e-9
    assert np.ptp(truth["position"][late]) < 1e-9
    assert truth["resistance"][-1] < SAND.f_o * ROBOT.weight * ROBOT.radius  # friction takes what it needs, no more
    moving = drive(1.8, scenario(Segment(SAND), duration=20.0))
    assert moving["omega"][-1] > 0.05


def test_dry_friction_holds_on_a_slope_and_gives_way_beyond() -> None:
    """Sand's resistance holds the shell up to about atan(f_o) = 5.3 deg, the hard floor's up to 0.6 deg."""
    held = drive(None, scenario(Segment(SAND, slope=math.radians(4.0)), duration=10.0))
    late = held["time"] > 8.0
    assert np.ptp(held["position"][late]) < 1e-4  # creep of the contact, bounded by its slip floor of 0.1 mm/s
    rolls = drive(None, scenario(Segment(SAND, slope=math.radians(8.0)), duration=3.0))
    assert rolls["position"][-1] < -0.1
    floor = drive(None, scenario(Segment(TERRAINS["hard_floor"], slope=math.radians(2.0)), duration=3.0))
    assert floor["position"][-1] < -0.1


def test_friction_only_takes_energy() -> None:
    """Rolling out on sand with the bridge open: kinetic and potential energy never rises."""
    simulation = Simulation(scenario(Segment(SAND), duration=8.0))
    simulation.drive(8.0, 4000)
    simulation.drive(None, 4000)
    t = {name: values[4001:] for name, values in simulation.truth().items()}
    swing_inertia = ROBOT.body_inertia + ROBOT.body_mass * ROBOT.arm**2 + ROBOT.drive_mass * 0.062**2
    imbalance = 0.062 * ROBOT.drive_mass + ROBOT.arm * ROBOT.body_mass
    turn = t["omega"] + 0.062 / 0.018 * t["alpha_rate"]
    energy = (
        0.5 * 1.9 * t["speed"] ** 2
        + 0.5 * ROBOT.shell_inertia * t["omega"] ** 2
        + 0.5 * swing_inertia * t["swing_rate"] ** 2
        + imbalance * t["speed"] * t["swing_rate"] * np.cos(t["swing_angle"])
        + 0.5 * ROBOT.drive_inertia * turn**2
        + ROBOT.gravity * imbalance * (1 - np.cos(t["swing_angle"]))
    )
    assert energy[0] > 0.9
    assert np.max(np.diff(energy)) < 1e-7 * energy[0]
    assert energy[-1] < 0.5 * ROBOT.coulomb**2 / (ROBOT.gravity * imbalance)  # what dry friction can hold


# ------------------------------------------------------------------ digging in


def test_a_slope_too_steep_digs_the_robot_in_and_its_rut_holds_it() -> None:
    steep = scenario(Segment(SAND), Segment(SAND, 1.0, math.radians(14.0), 0.3), duration=14.0)
    simulation = Simulation(steep)
    simulation.drive(8.0, 8000)
    simulation.drive(-8.0, 3000)
    simulation.drive(None, 3000)
    truth = simulation.truth()
    spinning = (truth["time"] > 5.0) & (truth["time"] < 8.0)
    assert np.min(truth["slip"][spinning]) > 0.9
    assert np.ptp(truth["position"][truth["time"] > 5.0]) < 1e-3  # neither reverse nor gravity gets it out
    assert truth["rut"][-1] > 0.95


def test_level_runs_and_the_floor_do_not_dig() -> None:
    sand = drive(8.0, scenario(Segment(SAND), duration=6.0))
    assert sand["rut"][-1] == 0.0
    floor = drive(12.0, scenario(Segment(TERRAINS["hard_floor"], slope=0.3), duration=6.0))
    assert np.max(floor["rut"]) == 0.0


# ------------------------------------------------------------------ convergence


@pytest.mark.parametrize(
    ("voltage", "segments"),
    [
        (5.0, (Segment(SAND),)),
        (8.0, (Segment(TERRAINS["agricultural"]),)),
        (5.0, (Segment(TERRAINS["hard_floor"]), Segment(SAND, 0.5, 0.0, 0.1))),
        (8.0, (Segment(SAND), Segment(SAND, 0.5, math.radians(14.0), 0.3))),
    ],
    ids=["sand", "agricultural", "floor_to_sand", "steep"],
)
def test_halving_the_step_converges(voltage: float, segments: tuple[Segment, ...]) -> None:
    """Start from rest, through stiction: errors against a step many times finer fall with the step, and are small."""
    what = scenario(*segments, duration=1.5)

    def speeds(substeps: int, fine: int) -> np.ndarray:
        truth = drive(voltage, what, substeps, fine)
        return np.stack([truth["speed"], truth["omega"] * ROBOT.radius, truth["alpha_rate"] * ROBOT.radius])

    finest = speeds(32, 128)

    def error(substeps: int, fine: int) -> float:
        return float(np.max(np.abs(speeds(substeps, fine) - finest)))

    errors = [error(n, 8 * n) for n in (1, 2, 4, 8)]
    assert errors[0] < 5e-4  # m/s, of 0.5 to 1.2 m/s: the steps that runs are made with
    assert errors[2] < 0.7 * errors[0]
    assert errors[3] < 0.4 * errors[0]


@settings(max_examples=15, deadline=None)
@given(st.floats(-10.0, 10.0), st.floats(-0.3, 0.3), st.sampled_from(sorted(TERRAINS)), st.floats(0.0, 10.0))
def test_nothing_blows_up(voltage: float, slope: float, name: str, second: float) -> None:
    simulation = Simulation(scenario(Segment(TERRAINS[name], slope=slope), duration=2.0))
    simulation.drive(voltage, 1000)
    simulation.drive(-second, 500)
    simulation.drive(None, 500)
    truth = simulation.truth()
    assert all(np.all(np.isfinite(values)) for values in truth.values())
    assert np.max(np.abs(truth["speed"])) < 20.0
    assert np.all(np.abs(truth["slip"]) <= 2.0)
