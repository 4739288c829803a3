"""The pendulum-driven sphere as a plant: against an independent integration, its balances, and what stops it."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from spheres import LAWS, SAND, SPHERE, SUPPLY, active, rolling

from terrapin_hil.library import ffi, library
from terrapin_hil.physics import soils, sphere, wheel
from terrapin_hil.robot.compiled_effects import EffectError
from terrapin_hil.robot.plant import TERRAINS, Ground, Segment, SoftGround, Terrain
from terrapin_hil.robot.soft_ground import affected, bulldozing_of
from terrapin_hil.scenario.scenario import Order, Scenario, load_scenario
from terrapin_hil.simulation import Simulation

ROWS = list(csv.DictReader((Path(__file__).parent / "data" / "sphere_robot.csv").open(encoding="utf-8")))
GEAR = SPHERE.radius / SPHERE.drive_radius

# Column of the reference -> column of the truth, what one of it is, and the note's tolerance on the transient, twice.
COLUMNS = {
    "v_m_s": ("speed", 1.0, 2 * 2.1e-3),
    "omega_rad_s": ("omega", 1.0, 2 * 0.012),
    "phi_rad": ("swing_angle", 1.0, 2 * 3e-3),
    "T_Nm": ("contact_torque", 1.0, 2 * 0.02),
    "slip": ("slip", 1.0, 2 * 6e-4),
}
STEADY = {"z_mm": ("sinkage", 1e-3), "dug_mm": ("dug", 1e-3), "I_A": ("current", 1.0)}


def ramped(law: str, voltage: float, slope: float, tow: float) -> Mapping[str, np.ndarray]:
    """From rest, the voltage in 20 s, then 30 s more: a step would swing the bob over the top."""
    run = rolling(law, 50.0, slope, tow)
    for k in range(1, 1001):
        run.drive(voltage * k / 1000, 20)
    run.drive(voltage, 30000)
    return run.truth()


@pytest.mark.parametrize("law", LAWS)
def test_steady_states_are_the_references(law: str) -> None:
    """23 rows a law, 1e-4 of each value."""
    rows = [row for row in ROWS if row["kind"] == "steady" and row["law"] == law]
    assert len(rows) == 23
    for row in rows:
        found = ramped(law, float(row["voltage_V"]), math.radians(float(row["slope_deg"])), float(row["tow_N"]))
        for name, (column, unit) in {**{n: c[:2] for n, c in COLUMNS.items()}, **STEADY}.items():
            assert found[column][-1] == pytest.approx(float(row[name]) * unit, rel=1e-4, abs=1e-9), (row, name)


@pytest.mark.parametrize("law", ["T2", "C"])
def test_a_step_of_the_voltage_is_the_references(law: str) -> None:
    run = rolling(law, 10.001)
    run.drive(8.0, 10001)
    found = run.truth()
    rows = [row for row in ROWS if row["kind"] == "step_8V" and row["law"] == law and float(row["t_s"]) >= 0.2]
    assert len(rows) == 12
    for row in rows:
        tick = round(float(row["t_s"]) * 1000)
        for name, (column, _, tolerance) in COLUMNS.items():
            assert abs(found[column][tick] - float(row[name])) <= tolerance, (row["t_s"], name)


@pytest.mark.parametrize("law", LAWS)
def test_turning_momentum_is_the_integral_of_the_torques(law: str) -> None:
    """(I1 + J_m N^2) theta' + J_m N (N - 1) phi' changes by the integral of T_j - T_c, to 1e-9 of what went through."""
    run = rolling(law, 4.0, 0.05, 5.0, substeps=(1, 1))
    for voltage in (6.0, 12.0, -4.0, 9.0):
        run.drive(voltage, 1000)
    found = run.truth()
    rate = found["alpha_rate"]
    middle = rate + 0.5 * np.diff(rate, prepend=0.0)  # where a step takes its smooth forces
    volts = np.round(np.repeat([6.0, 12.0, -4.0, 9.0], 1000) / 32.0 * 32768) / 32768 * 32.0
    current = (volts - GEAR * SPHERE.torque_constant * middle) / SPHERE.armature_resistance
    torque = (GEAR * SPHERE.torque_constant * current)[:-1] - found["internal_friction"][1:]
    torque -= found["contact_torque"][1:]
    inertia = SPHERE.shell_inertia + SPHERE.drive_inertia * GEAR**2
    momentum = inertia * found["omega"] + SPHERE.drive_inertia * GEAR * (GEAR - 1.0) * found["swing_rate"]
    through = 1e-3 * np.abs(torque).sum()
    assert abs(momentum[-1] - momentum[0] - 1e-3 * torque.sum()) <= 1e-9 * through


def energy(found: Mapping[str, np.ndarray], slope: float) -> np.ndarray:
    """Kinetic energy and that of height [J]."""
    m, k = SPHERE.weight / SPHERE.gravity, SPHERE.body_mass * SPHERE.arm
    swing = SPHERE.body_inertia + k * SPHERE.arm
    rotor = found["omega"] + (GEAR - 1.0) * found["alpha_rate"]
    kinetic = m * found["speed"] ** 2 + SPHERE.shell_inertia * found["omega"] ** 2 + swing * found["swing_rate"] ** 2
    kinetic += SPHERE.drive_inertia * rotor**2
    kinetic += 2.0 * k * found["speed"] * found["swing_rate"] * np.cos(found["swing_angle"] - slope)
    height = k * (1.0 - np.cos(found["swing_angle"])) + m * found["position"] * math.sin(slope)
    return 0.5 * kinetic + SPHERE.gravity * height


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("slope", [-0.15, 0.0, 0.15])
def test_energy_never_grows_without_work(law: str, slope: float) -> None:
    """Rolled up to speed, then the bridge opens: from there on nothing adds energy, also where the joint has no
    friction. 1e-5 of what there was covers the steps' rounding of a swing."""
    smooth = replace(SPHERE, coulomb=0.0, viscous=0.0)
    lossy = replace(SPHERE, gear_efficiency=0.7, driven_ratio=0.5, motor_coulomb=0.3, motor_viscous=0.02)
    for robot in (SPHERE, smooth, lossy):
        run = rolling(law, 8.0, slope, robot=robot)
        for k in range(1, 101):
            run.drive(8.0 * k / 100, 20)
        run.drive(None, 6000)
        stored = energy(run.truth(), slope)[2000:]
        assert stored.max() - stored.min() > 1.0  # there was something to lose
        assert (stored - np.minimum.accumulate(stored)).max() <= 1e-5 * np.ptp(stored)


def test_what_the_motor_gives_is_stored_or_lost() -> None:
    """Of 160 J in 10 s of rolling (reference: E_in, E_lost) as much is lost as there."""
    run = rolling("T2", 10.001)
    run.drive(8.0, 10001)
    found = run.truth()
    power = GEAR * found["motor_torque"] * found["alpha_rate"]
    given = 5e-4 * (power[1:] + power[:-1]).sum()
    last = next(row for row in ROWS if row["kind"] == "step_8V" and row["law"] == "T2" and row["t_s"] == "10")
    assert given == pytest.approx(float(last["E_in_J"]), rel=2e-3)
    assert given - energy(found, 0.0)[-1] == pytest.approx(float(last["E_lost_J"]), rel=2e-3)


def test_the_printed_robot_cannot_roll_on() -> None:
    """Its bob of 1.5 kg holds 1.91 N m, its own sand takes 1.97 (T1) and 2.24 (T2): it rolls off and stops."""
    printed = replace(SPHERE, body_mass=1.5)
    for law, needed in (("T1", 1.97), ("T2", 2.24)):
        run = rolling(law, 12.0, robot=printed)
        for k in range(1, 101):
            run.drive(6.0 * k / 100, 100)
        run.drive(None, 2000)  # before the bob goes round
        found = run.truth()
        assert printed.body_mass * printed.gravity * printed.arm < needed
        assert found["position"].max() < 1.0
        assert abs(found["speed"][-1]) < 1e-3


def test_bulldozing_is_the_closed_form_of_the_workbench() -> None:
    soil = replace(SAND.soil, cohesion=800.0)
    fields = (soil.cohesion, soil.friction_angle, soil.unit_weight, soil.n_c, soil.n_gamma)
    theta = np.linspace(0.05, 1.4, 12)
    for shape, of in (("sphere", sphere.bulldozing), ("wheel", wheel.bulldozing)):
        ground = SoftGround(soil, 0.15, shape=shape)  # type: ignore[arg-type]
        sand = ffi().new("hil_bulldozing *", bulldozing_of(ground, 0.22))
        depth = sphere.sinkage(theta, 0.22)
        found = [library().hil_bulldozing_resistance(sand, z) for z in depth]
        size = (0.22,) if shape == "sphere" else (0.22, 0.15)
        np.testing.assert_allclose(found, of(theta, *size, *fields), rtol=1e-9)  # type: ignore[operator]
        assert library().hil_bulldozing_resistance(sand, -1.0) == 0.0
        assert library().hil_bulldozing_resistance(sand, 1.0) == library().hil_bulldozing_resistance(sand, 0.22)


def test_slipping_digs_without_a_threshold() -> None:
    """Held by a carriage at one slip the rut comes to slip_depth s / (1 - s), also well below a slip of 0.5."""
    for share in (0.8, 0.4):
        speed = 0.3
        strong = replace(SPHERE, arm=1.0)  # gravity does not end it
        run = Simulation(replace(rolling("C", 40.0, robot=strong).scenario, carriage=((0.0, speed), (40.0, speed))))
        voltage = GEAR * SPHERE.torque_constant * speed / share / SPHERE.radius + 2.0
        for k in range(1, 101):
            run.drive(voltage * k / 100, 50)
        run.drive(voltage, 35000)
        found = run.truth()
        slip = found["slip"][-1]
        assert slip > 0.1
        assert found["dug"][-1] == pytest.approx(7e-3 * slip / (1.0 - slip), rel=1e-3)


def test_a_standing_rut_stays() -> None:
    run = rolling("C", 5.0, 0.1)
    for k in range(1, 11):
        run.drive(0.8 * k, 200)
    run.drive(None, 3000)
    dug = run.truth()["dug"]
    assert dug[-1] > 0.0
    assert abs(dug[-1] - dug[-500]) < 1e-3 * dug[-1]


def test_tow_holds_and_is_no_traction() -> None:
    """A load more than the ground gives holds the robot; rolling steadily the drawbar pull is the load, level."""
    found = ramped("T1", 8.0, 0.0, 10.0)
    assert found["traction"][-1] == pytest.approx(10.0, rel=1e-4)
    run = rolling("T1", 3.0, tow=1e3)
    run.drive(4.0, 3000)
    assert abs(run.truth()["position"]).max() < 1e-3


def test_backwards_is_the_mirror() -> None:
    for law in LAWS:
        there, back = rolling(law, 3.0), rolling(law, 3.0)
        there.drive(6.0, 3000)
        back.drive(-6.0, 3000)
        for name in ("position", "omega", "contact_torque", "traction", "swing_angle"):
            np.testing.assert_allclose(back.truth()[name], -there.truth()[name], rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(back.truth()["dug"], there.truth()["dug"], rtol=1e-6, atol=1e-12)


def test_a_patch_of_another_soil() -> None:
    """On the patch slip and sinkage are those of a path that is all such soil, beyond it again those of the first."""
    soft = replace(SAND, soil=replace(SAND.soil, k_phi=0.5e6))

    def run(*segments: Segment, contact: SoftGround = SAND) -> Mapping[str, np.ndarray]:
        ground = Ground(segments, contact=contact)
        simulation = Simulation(Scenario("t", 30.0, ground, (Order(0.0, "idle"),), robot=SPHERE, supply=24.0))
        for k in range(1, 101):
            simulation.drive(6.0 * k / 100, 20)
        simulation.drive(6.0, 28000)
        return simulation.truth()

    patch = run(Segment(Terrain()), Segment(Terrain(), 4.0, contact=soft), Segment(Terrain(), 7.0))
    firm, weak = run(Segment(Terrain())), run(Segment(Terrain()), contact=soft)
    on, beyond = np.searchsorted(patch["position"], [6.9, 9.9])
    for name in ("sinkage", "slip"):
        assert patch[name][on] == pytest.approx(weak[name][-1], rel=0.05)
        assert patch[name][beyond] == pytest.approx(firm[name][-1], rel=0.05)
    assert weak["sinkage"][-1] > 1.5 * firm["sinkage"][-1]


def test_a_board_and_then_sand() -> None:
    """On the firm part the ground is the terrain's, off it the soil's: torque of the one, then of the other."""
    board = Terrain(f_o=0.01, mu=0.7, s_k=0.02)
    ground = Ground((Segment(board, firm=True), Segment(Terrain(), 5.0, transition=0.02)), contact=SAND)
    run = Simulation(Scenario("t", 30.0, ground, (Order(0.0, "idle"),), robot=SPHERE, supply=SUPPLY))
    for k in range(1, 101):
        run.drive(6.0 * k / 100, 20)
    run.drive(6.0, 28000)
    found = run.truth()
    on, beyond = np.searchsorted(found["position"], [4.9, found["position"].max() - 0.1])
    assert found["contact_torque"][on - 1000 : on].mean() == pytest.approx(0.01 * 0.22 * SPHERE.weight, rel=0.05)
    assert found["contact_torque"][beyond] == pytest.approx(4.597988, rel=0.02)
    assert found["sinkage"][on] == 0.0
    assert found["sinkage"][beyond] > 0.01


def test_the_default_grounds_threshold_is_a_number_of_the_scenario() -> None:
    """A robot that slips at 0.4 digs in where dig_slip is less, not where it is 0.5."""
    dug = []
    for dig_slip in (0.5, 0.2):
        ground = Ground((Segment(TERRAINS["sand"]),), dig_slip=dig_slip)
        carriage = ((0.0, 0.2), (5.0, 0.2))
        simulation = Simulation(Scenario("t", 5.0, ground, (Order(0.0, "idle"),), carriage=carriage))
        simulation.drive(6.0, 5000)
        found = simulation.truth()
        assert 0.25 < found["slip"][-1] < 0.5
        dug.append(found["rut"][-1])
    assert dug[0] == 0.0
    assert dug[1] > 0.01


# ------------------------------------------------------------------ what is refused

GOOD = """duration = "1 s"
ground = "contact"
[soil]
name = "dry_sand_li"
shape = "sphere"
[rut]
slip_depth = "7 mm"
[[path]]
from = "0 m"
[[operator]]
at = "0 s"
request = "run"
[effect.bulldozing]
scale = 1
"""
WRONG = {
    "c1": (GOOD.replace("dry_sand_li", "lete_sand"), "soil: c1, c2: Vella et al. (2024)"),
    "shape": (GOOD.replace('"sphere"', '"cube"'), "5: soil.shape: found 'cube', expected one of wheel, sphere"),
    "rut": (GOOD.replace("slip_depth", "dig_length"), "7: rut.dig_length: no such field"),
    "deep": (GOOD.replace('"7 mm"', '"7 m"'), "7: rut.slip_depth: found '7 m', expected 0 to 1 m"),
    "tow": (GOOD.replace("[soil]", 'tow = [["0 s", "-3 N"]]\n[soil]', 1), "3: tow: found -3, expected 0 to 1e+06 N"),
    "patch": (
        GOOD.replace('from = "0 m"', 'from = "0 m"\nsoil = { name = "dry_sand_li" }'),
        "path[1].soil: found shape wheel, expected sphere as in [soil]",
    ),
    "no weight": (
        GOOD.replace('name = "dry_sand_li"', 'name = "lete_sand"\nc1 = 0.18\nc2 = 0.32'),
        "bulldozing: expected unit_weight, n_c, n_gamma in [soil]",
    ),
    "table": (
        GOOD.replace('ground = "contact"\n', "").replace("from", 'terrain = "sand"\nfrom').split("[soil]")[0]
        + '[[path]]\nterrain = "sand"\n[[operator]]\nat = 0\nrequest = "run"\n[effect.bulldozing]\nscale = 1\n',
        "effect.bulldozing: no effect that the plant can take",
    ),
}


@pytest.mark.parametrize(("text", "message"), WRONG.values(), ids=WRONG.keys())
def test_wrong_scenarios(refused_scenario: Callable[[str], str], text: str, message: str) -> None:
    assert message in refused_scenario(text)


def test_a_good_scenario(tmp_path: Path) -> None:
    file = tmp_path / "good.toml"
    file.write_text(GOOD)
    found = load_scenario(file).ground
    assert found.contact == SAND
    assert found.slip_depth == pytest.approx(7e-3)


def test_an_effect_of_the_other_shape_is_refused() -> None:
    own = replace(active("bulldozing", scale=1.0).effect, name="own", bases=("wheel_contact",))
    with pytest.raises(EffectError, match="own: found a sphere, expected wheel_contact"):
        affected(Ground((Segment(Terrain()),), contact=SAND), (replace(active("bulldozing"), effect=own),), 1.0, 0.0)
    assert soils.library()["dry_sand_li"] == SAND.soil
