"""The plant's ground = "contact": its table against the integrals, motion against them, and what is refused."""

from __future__ import annotations

import doctest
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import terrapin_hil.robot.soft_ground
import terrapin_hil.run.contact_runs
from terrapin_hil.library import ffi, library
from terrapin_hil.physics import soils, wheel
from terrapin_hil.physics.contact import ContactError
from terrapin_hil.physics.effects import catalogue
from terrapin_hil.robot.compiled_effects import ActiveEffect, EffectError
from terrapin_hil.robot.plant import Ground, Robot, Segment, SoftGround, Terrain
from terrapin_hil.robot.soft_ground import ACCURACY, _exact, affected, check_step, contact_steady, grip_tables
from terrapin_hil.run.contact_runs import time_response
from terrapin_hil.scenario.scenario import Order, Scenario, load_scenario
from terrapin_hil.simulation import Simulation

ROBOT = Robot()
SAND = SoftGround(replace(soils.library()["sand_reina"], shear_modulus=0.025))
LLL = SoftGround(replace(soils.library()["dry_sand_lll"], shear_modulus=0.010))


def path(slope: float = 0.0, ground: SoftGround = SAND) -> Ground:
    return Ground((Segment(Terrain(), slope=slope),), contact=ground)


def drive(voltage: float | None, duration: float, slope: float = 0.0, **more: object) -> dict[str, np.ndarray]:
    scenario = Scenario("test", duration, path(slope), (Order(0.0, "idle"),), **more)  # type: ignore[arg-type]
    simulation = Simulation(scenario)
    simulation.drive(voltage, scenario.ticks)
    return simulation.truth()


def test_docstring_examples() -> None:
    assert doctest.testmod(terrapin_hil.robot.soft_ground).failed == 0
    assert doctest.testmod(terrapin_hil.run.contact_runs).failed == 0


@pytest.mark.parametrize("ground", [SAND, LLL], ids=["reina", "lll"])
@pytest.mark.parametrize("slope", [0.0, 0.25])
def test_table_is_within_its_accuracy(ground: SoftGround, slope: float) -> None:
    """The compiled interpolation at points of its own choosing: 1e-4 of each value, or of 1 % of its scale."""
    table = grip_tables(path(slope, ground), ROBOT)[0]
    assert table is not None
    native = table.native()
    rng = np.random.default_rng(3)
    count = 1500
    slip = np.concatenate([rng.uniform(-1.0, 1.0, count - 4), [-1.0, 1.0, 0.0, -0.9999]])
    load = ROBOT.weight * rng.uniform(np.cos(slope), 1.0, count)
    exact, by = _exact(ground, ROBOT.radius, load, slip)
    derivative = ffi().new("double *")
    found, slopes = np.empty_like(exact), np.empty_like(exact)
    for i in range(count):
        grip = ffi().new("hil_grip *", (native, load[i], 1.0, 2.0))
        for value in range(4):
            found[i, value] = library().hil_grip_value(grip, value, 2.0 * slip[i], derivative)
            slopes[i, value] = 2.0 * derivative[0]
    scale = ROBOT.weight * np.array([1.0, 1.0, ROBOT.radius, np.abs(exact[:, 3]).max() / ROBOT.weight])
    assert (np.abs(found - exact) / np.maximum(np.abs(exact), 0.01 * scale)).max() <= ACCURACY
    inside = np.abs(slip) < 0.99
    assert (np.abs(slopes - by)[inside] / scale).max() <= 2e-2  # of a cubic, one order less


def test_thrust_less_compaction_is_drawbar_pull() -> None:
    slip = np.linspace(-0.4, 1.0, 8)
    values, _ = _exact(SAND, ROBOT.radius, np.full(8, ROBOT.weight), slip)
    inner = np.where(slip < 0, slip / (1 + slip), slip)
    c = wheel.solve(ROBOT.weight, inner, ROBOT.radius, SAND.width, wheel.soil_of(SAND.soil, SAND.width))
    np.testing.assert_allclose(values[:, 0] - values[:, 1], c.traction, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(values[:, 2] + ROBOT.radius * values[:, 0], c.torque, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(values[:, 3], c.sinkage, rtol=1e-9)


def test_steady_rolling_is_that_of_the_integrals() -> None:
    """Slip 0.46867, 7.3765 mm and 0.32169 N m at zero pull are the independent reference's; the plant arrives there."""
    steady = contact_steady(ROBOT, SAND, [2.0, 6.0, 8.0])
    np.testing.assert_allclose(steady["slip"], 0.4686655738, rtol=1e-6)
    np.testing.assert_allclose(steady["torque"], 0.3216918512, rtol=1e-6)
    np.testing.assert_allclose(steady["sinkage"], 7.376478078e-3, rtol=1e-6)
    assert steady["omega"][0] == steady["speed"][0] == 0.0  # 2 V do not start it
    for i, voltage in ((1, 6.0), (2, 8.0)):
        end = {name: column[-1] for name, column in drive(voltage, 20.0).items()}
        for name, column in (("slip", "slip"), ("omega", "omega"), ("speed", "speed"), ("sinkage", "sinkage")):
            assert end[column] == pytest.approx(steady[name][i], rel=1e-4)
        assert end["contact_torque"] == pytest.approx(steady["torque"][i], rel=1e-4)
        assert end["current"] == pytest.approx(steady["current"][i], rel=1e-4)
        assert abs(end["traction"]) < 1e-4  # net: nothing pulls
        assert end["resistance"] == pytest.approx(steady["torque"][i], rel=1e-4)


def test_backwards_is_the_mirror() -> None:
    there, back = drive(6.0, 3.0), drive(-6.0, 3.0)
    for name in ("position", "omega", "contact_torque", "traction", "swing_angle"):
        np.testing.assert_allclose(back[name], -there[name], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(back["sinkage"], there["sinkage"], rtol=1e-7)
    assert there["speed"][-1] > 0.1


def test_energy() -> None:
    """The contact takes power from shell and axle together at every moment: T omega >= H v."""
    for voltage, slope in ((8.0, 0.0), (5.0, -0.2), (8.0, 0.05)):
        run = drive(voltage, 6.0, slope)
        given = 0.5 * (run["contact_torque"][1:] * (run["omega"][1:] + run["omega"][:-1]))
        taken = 0.5 * (run["traction"][1:] * (run["speed"][1:] + run["speed"][:-1]))
        assert (given - taken).min() > -1e-3


def test_steps_converge() -> None:
    ends = []
    for substeps in (1, 4, 16):
        simulation = Simulation(Scenario("t", 1.0, path(), (Order(0.0, "idle"),)), substeps, 8 * substeps)
        simulation.drive(7.0, 1000)
        ends.append(simulation.truth()["position"][-1])
    assert abs(ends[1] - ends[2]) < 0.5 * abs(ends[0] - ends[2])
    assert abs(ends[0] - ends[2]) < 2e-3 * abs(ends[2])


def test_at_rest_it_stays_and_keeps_its_sinkage() -> None:
    scenario = Scenario("t", 6.0, path(), (Order(0.0, "idle"),))
    simulation = Simulation(scenario)
    simulation.drive(8.0, 3000)
    simulation.drive(None, 3000)
    run = simulation.truth()
    assert run["speed"][2999] > 0.2
    assert abs(run["position"][-1] - run["position"][5000]) < 1e-4
    assert run["sinkage"][-1] == run["sinkage"][5500] > 6e-3
    assert drive(None, 0.5)["sinkage"][-1] == pytest.approx(  # a robot put down sinks in by its weight
        wheel.solve(ROBOT.weight, 0.0, ROBOT.radius, 0.15, wheel.soil_of(SAND.soil, 0.15)).sinkage[0], rel=1e-4
    )


def test_a_slope_above_the_drawbar_limit_is_not_climbed() -> None:
    """Pull at full slip over load is the tangent of the steepest slope; compaction holds a robot on gentle ones."""
    c = wheel.solve(ROBOT.weight, 1.0, ROBOT.radius, 0.15, wheel.soil_of(SAND.soil, 0.15))
    limit = float(np.arctan(c.traction[0] / ROBOT.weight))
    assert 0.0 < limit < 0.3
    strong = replace(ROBOT, body_mass=0.5, torque_constant=0.14)
    for slope, climbs in ((0.6 * limit, True), (1.6 * limit, False)):
        simulation = Simulation(Scenario("t", 12.0, path(slope), (Order(0.0, "idle"),), robot=strong, supply=24.0))
        simulation.drive(20.0, 12000)
        assert (simulation.truth()["speed"][-1] > 0.01) == climbs
    idle = drive(None, 3.0, slope=0.05)
    assert abs(idle["position"][-1] - idle["position"][1000]) < 1e-3


def test_carriage_measures_the_pull() -> None:
    """A carriage that imposes the axle's speed feels minus the drawbar pull of that slip."""
    run = drive(8.0, 16.0, carriage=((0.0, 0.2), (16.0, 0.2)))
    slip = run["slip"][-1]
    c = wheel.solve(ROBOT.weight, slip, ROBOT.radius, 0.15, wheel.soil_of(SAND.soil, 0.15))
    assert run["traction"][-1] == pytest.approx(c.traction[0], rel=2e-4)
    assert run["contact_torque"][-1] == pytest.approx(c.torque[0], rel=2e-4)
    assert run["carriage_force"][-1] == pytest.approx(-c.traction[0], rel=2e-4)


def test_time_response_is_the_simulation() -> None:
    run = time_response(ROBOT, SAND, 5.0, 2.0)
    assert set(run) >= {"time", "speed", "omega", "swing_angle", "slip", "sinkage", "contact_torque", "current"}
    assert len(run["time"]) == 2000
    np.testing.assert_array_equal(run["speed"], drive(5.0, 2.0)["speed"])


@given(
    volts=st.lists(st.floats(-24.0, 24.0), min_size=1, max_size=6),
    slope=st.sampled_from([-0.25, 0.0, 0.25]),
    carried=st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_whatever_drives_it_motion_stays_bounded(volts: list[float], slope: float, carried: bool) -> None:
    """Jumps of voltage, reversals, slopes, a carriage: finite, no faster than motor and hill can make it."""
    carriage = ((0.05, 0.0), (0.2, -0.5), (0.3, 0.5)) if carried else ()
    scenario = Scenario("t", 0.1 * len(volts), path(slope), (Order(0.0, "idle"),), supply=24.0, carriage=carriage)
    simulation = Simulation(scenario)
    for voltage in volts:
        simulation.drive(voltage, 100)
    run = simulation.truth()
    assert all(np.isfinite(column).all() for column in run.values())
    assert np.abs(run["slip"]).max() <= 2.0
    assert np.abs(run["speed"]).max() < 6.0
    assert run["sinkage"].min() > 0.0
    limit = max(
        float(wheel.solve(ROBOT.weight, s, ROBOT.radius, 0.15, wheel.soil_of(SAND.soil, 0.15)).torque[0])
        for s in (0, 1)
    )
    assert np.abs(run["contact_torque"]).max() < 4.0 * limit + ROBOT.radius * ROBOT.weight


def active(name: str, **values: float) -> ActiveEffect:
    return ActiveEffect(catalogue()[name], values)


def test_effects_on_the_soil_are_those_of_the_workbench() -> None:
    """A second pass, water and a rut that springs back change the soil by the catalogue's expressions."""
    effects = (active("multipass", kappa=0.4), active("moisture_cohesion", c_w=5e3), active("rut_recovery", lam=0.2))
    run = drive(8.0, 15.0, effects=(*effects, active("stribeck", a_s=1e-3, omega_s=2.0)), pass_number=3.0, moisture=0.1)
    firm = 3.0**0.4
    soil = wheel.Soil(24e3 * firm, 1528e3 * firm, 1.1, 700.0 + 500.0, np.radians(30), 0.025, recovery=0.2)
    found = wheel.solve(ROBOT.weight, run["slip"][-1], ROBOT.radius, 0.15, soil)
    assert run["sinkage"][-1] == pytest.approx(found.sinkage[0], rel=1e-4)
    assert found.traction[0] == pytest.approx(0.0, abs=2e-3)
    assert run["slip"][-1] < 0.9 * contact_steady(ROBOT, SAND, 8.0)["slip"][0]
    ground, rest = affected(path(), (*effects, active("stribeck")), 3.0, 0.1)
    assert [a.effect.name for a in rest] == ["stribeck"]
    assert affected(replace(path(), contact=None), effects, 3.0, 0.1)[1] == effects
    assert ground.contact is not None
    assert ground.contact.soil.cohesion == 1200.0
    own = replace(catalogue()["stribeck"], name="own", target="f_o")
    with pytest.raises(EffectError, match="own: acts on f_o"):
        affected(path(), (ActiveEffect(own, {}),), 1.0, 0.0)


# ------------------------------------------------------------------ what is refused


def test_too_heavy_and_too_fast() -> None:
    soft = SoftGround(soils.Soil("mud", "test", "bekker", 1.0, 0.0, 5e3, 100.0, 0.2, 0.02))
    with pytest.raises(ContactError, match=r"load: found 18.639 N.*expected at most"):
        grip_tables(path(ground=soft), ROBOT)
    with pytest.raises(ContactError, match=r"load: found 18.639 N"):
        contact_steady(ROBOT, soft, 5.0)
    with pytest.raises(ContactError, match=r"step: found 0.001 s, expected more than 0 s and at most"):
        check_step(SAND, ROBOT, 1e-3, 50.0)
    check_step(SAND, ROBOT, 1e-3, 2.0)
    slippery = SoftGround(replace(SAND.soil, cohesion=0.0, friction_angle=0.05))
    with pytest.raises(ContactError, match=r"drawbar pull: found -.* N at slip 1, expected more than 0 N"):
        contact_steady(ROBOT, slippery, 5.0)


GOOD = """duration = "1 s"
moisture = 0.1
ground = "contact"
checks = ["max(slip) < 2"]
[soil]
name = "sand_reina"
shear_modulus = "25 mm"
[[path]]
from = "0 m"
[[operator]]
at = "0 s"
request = "run"
"""
VALUES = """form = "bekker"
exponent = 1.1
k_c = "0.99 kN/m^2.1"
k_phi = "1528.43 kN/m^3.1"
cohesion = "1.04 kPa"
friction_angle = "28 deg"
shear_modulus = "10 mm"
width = "15 cm"
"""
NAMED = 'name = "sand_reina"\nshear_modulus = "25 mm"\n'

WRONG = {
    "name": (GOOD.replace("sand_reina", "sand_rain"), "6: soil.name: found 'sand_rain', expected one of lete_sand, "),
    "no modulus": (GOOD.replace('shear_modulus = "25 mm"\n', ""), "soil: shear_modulus: Reina et al. (2006)"),
    "negative": (GOOD.replace("[[path]]", 'k_phi = "-3 kPa/m"\n[[path]]'), "soil: k_phi: found -3000 Pa/m, expected"),
    "unit": (
        GOOD.replace("[[path]]", 'k_phi = "3 kPa"\n[[path]]'),
        "8: soil.k_phi: found '3 kPa', expected a quantity",
    ),
    "number": (
        GOOD.replace("[[path]]", "cohesion = true\n[[path]]"),
        "8: soil.cohesion: found True, expected a number",
    ),
    "missing": (GOOD.replace(NAMED, VALUES.replace('k_c = "0.99 kN/m^2.1"\n', "")), "soil.k_c: missing"),
    "terrain": (GOOD.replace('from = "0 m"', 'terrain = "sand"'), "3: ground: found a terrain in each segment"),
    "both": (
        GOOD.replace('from = "0 m"', 'terrain = "sand"\nsoil = { name = "sand_reina" }'),
        "path[1].soil: a segment has a terrain or a soil",
    ),
    "too soft": (GOOD.replace("[[path]]", 'k_phi = "1 kPa/m"\nk_c = 0\n[[path]]'), "soil: load: found 18.639 N"),
    "no contact": (GOOD.replace('ground = "contact"\n', "").replace("from", 'terrain = "sand"\nfrom'), "soil: no such"),
    "rate": (GOOD + "[effect.rate_effect]\nm = 0.2\n", "effect.rate_effect: no effect that the plant can take"),
    "recovery": (GOOD + "[effect.rut_recovery]\nlam = 1.2\n", "effect.rut_recovery.lam: found 1.2, expected 0 to 0.9"),
    "dry": (GOOD + "[effect.moisture_cohesion]\nc_w = -1e6\n", "soil: cohesion: found -"),
    "too fast": (GOOD + '[robot]\ntorque_constant = "1 uN m/A"\n', "soil: step: found 0.001 s, expected more than 0 s"),
}


@pytest.mark.parametrize(("text", "message"), WRONG.values(), ids=WRONG.keys())
def test_wrong_scenarios(refused_scenario: Callable[[str], str], text: str, message: str) -> None:
    assert message in refused_scenario(text)


def test_soil_by_name_or_by_values(tmp_path: Path) -> None:
    file = tmp_path / "good.toml"
    file.write_text(GOOD)
    assert load_scenario(file).ground.contact == SAND
    file.write_text(GOOD.replace(NAMED, VALUES))
    found = load_scenario(file).ground.contact
    assert found is not None
    for name in ("form", "exponent", "k_c", "k_phi", "cohesion", "friction_angle", "shear_modulus"):
        expected = getattr(LLL.soil, name)
        assert getattr(found.soil, name) == (expected if name == "form" else pytest.approx(expected, rel=1e-12))
