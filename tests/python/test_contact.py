"""The compiled contact: limits with closed forms, plain NumPy, derivatives, and what it refuses."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import beta

from terrapin_hil.physics import contact, soils, sphere, wheel
from terrapin_hil.physics.contact import FIELDS, ContactError
from tests.bench import contact_numpy

PHI = np.radians(42.2)
SAND = sphere.Soil(1.945e6, 0.97, 0.0, PHI, 0.01778)  # Li et al. 2024, Table 1
WHEEL = wheel.Soil(24e3, 1528e3, 1.1, 700.0, np.radians(30), 0.025)


def solved(
    load: float, slip: float, radius: float, soil: sphere.Soil, linear: bool = False
) -> tuple[contact.Contact | None, str]:
    """The contact, or why there is none."""
    try:
        return sphere.solve(load, slip, radius, soil, linear), ""
    except ContactError as error:
        return None, str(error)


# ------------------------------------------------------------------ limits


@pytest.mark.parametrize("n", [0.5, 0.97, 1.4])
@pytest.mark.parametrize("theta", [0.05, 0.4, 1.2])
def test_bekker_compaction(n: float, theta: float) -> None:
    """Without shear and with the peak at the bottom, the pull is minus the rut's work: 2 int K z^(n+1)/(n+1)."""
    radius, stiffness = 0.22, 1.945e6
    c = sphere.at(theta, 0.5, radius, sphere.Soil(stiffness, n, 0.0, 0.0, 0.02, c1=0.0, c2=0.0))

    def work(u: float) -> float:
        x = radius * np.sin(theta) * np.sin(u)
        z = np.sqrt(radius**2 - x**2) - radius * np.cos(theta)
        return float(stiffness * max(z, 0.0) ** (n + 1) / (n + 1) * radius * np.sin(theta) * np.cos(u))

    assert -c.traction[0] == pytest.approx(2.0 * quad(work, 0.0, np.pi / 2, epsrel=1e-12)[0], rel=1e-8)
    assert c.torque[0] == 0.0


def test_small_loads() -> None:
    """W -> 4 K R z^(n+1) I(m)/(1-m) B(1/2, n + 3/2)/2, first order in the load: 1.0069 at 1 N, 1.00001 at 1e-6 N."""
    n, m, radius = 0.97, 0.18 + 0.32 * 0.5, 0.22
    inner = quad(lambda u: (1 - u * u) ** n, m, 1.0)[0]
    ratios = []
    for load in (1.0, 1e-6):
        z = float(sphere.solve(load, 0.5, radius, SAND).sinkage[0])
        ratios.append(load / (4 * 1.945e6 * radius * z ** (n + 1) * inner / (1 - m) * beta(0.5, n + 1.5) / 2))
    np.testing.assert_allclose(ratios, [1.0069, 1.00001], atol=5e-5)


def test_linear_soil_carries_half_the_cap() -> None:
    """n = 1, m = 0, no shear: W -> (pi/2) K R z^2 as z -> 0; only the front half carries."""
    soil = sphere.Soil(1e6, 1.0, 0.0, 0.0, 0.02, c1=0.0, c2=0.0)
    ratios = []
    for theta in (1e-2, 1e-3):
        c = sphere.at(theta, 0.5, 0.22, soil)
        ratios.append(c.vertical[0] / (0.5 * np.pi * 1e6 * 0.22 * c.sinkage[0] ** 2) - 1.0)
    assert abs(ratios[1]) < 1e-6
    assert abs(ratios[1]) < abs(ratios[0]) / 50  # falls with theta^2


def test_cylinder_against_sphere() -> None:
    """A cylinder as wide as the sphere's contact, at its entry angle, carries 1.70 times as much."""
    ball = sphere.solve(150.0, 0.5, 0.22, SAND)
    fields = {"slip": 0.5, "radius": 0.22, "width": 2 * 0.22 * np.sin(ball.entry), **vars(SAND)}
    c = contact.contact("wheel", False, fields, False, entry=ball.entry)
    np.testing.assert_allclose([c.vertical[0], c.traction[0], c.torque[0]], [254.28, 105.904, 32.5816], rtol=2e-5)
    assert c.vertical[0] / 150.0 == pytest.approx(1.70, abs=0.005)


@given(
    load=st.floats(0.5, 300.0),
    slip=st.floats(-1.0, 1.0),
    radius=st.floats(0.05, 0.5),
    stiffness=st.floats(3e5, 1e7),
    n=st.floats(0.5, 1.5),
    phi=st.floats(0.1, 0.9),
    cohesion=st.floats(0.0, 3e3),
    linear=st.booleans(),
)
@settings(max_examples=120, deadline=None)
def test_balance_and_energy(
    load: float, slip: float, radius: float, stiffness: float, n: float, phi: float, cohesion: float, linear: bool
) -> None:
    """The load is carried; driving, the drive's work covers the pull's: T/R >= DP (1 - s)."""
    c, refused = solved(load, slip, radius, sphere.Soil(stiffness, n, cohesion, phi, 0.02), linear)
    if c is None:
        assert refused.startswith("load: found")
        return
    assert c.vertical[0] == pytest.approx(load, rel=1e-9)
    assert 0.0 < c.entry[0] <= contact.THETA_MAX
    assert c.sinkage[0] == pytest.approx(radius * (1 - np.cos(c.entry[0])), rel=1e-9, abs=1e-15)
    if slip >= 0.0:
        assert c.torque[0] / radius >= c.traction[0] * (1 - slip) - 1e-9 * load


# ------------------------------------------------------------------ quadrature


def test_against_plain_numpy_with_many_nodes() -> None:
    """Where no disc's shear reverses: 1e-8 for usual soils, 5e-6 for n of 0.4 to 1.8 and k down to 1 mm."""
    rng = np.random.default_rng(5)
    count = 60
    for ordinary, bound in ((True, 1e-8), (False, 5e-6)):
        theta = rng.uniform(0.02, 0.6 if ordinary else 1.3, count)
        slip = 1 - np.cos(theta) * (1 - rng.uniform(0.01, 1.0, count))
        radius = rng.uniform(0.05, 0.4, count)
        soil = sphere.Soil(
            1e6,
            rng.uniform(0.7, 1.3, count) if ordinary else rng.uniform(0.4, 1.8, count),
            rng.choice([0.0, 500.0, 5e3], count),
            0.6,
            10 ** rng.uniform(-2.0 if ordinary else -3.0, -1.0, count),
            0.2,
            0.3,
            rng.choice([0.0, 0.3, 0.9], count),
        )
        found = np.array(sphere.forces(theta, slip, radius, soil))
        exact = contact_numpy.forces(theta, slip, radius, soil, across=40, along=120)
        scale = np.abs(exact[0]) + np.abs(exact[1])
        assert (np.abs(found - exact) / np.stack([scale, scale, scale * radius])).max() < bound


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("recovery", [0.0, 0.3, 0.9])
def test_skidding_rim(linear: bool, recovery: float) -> None:
    """Slip below sinkage/R: kinks inside, at which the compiled quadrature is split, met to 1e-7."""
    rng = np.random.default_rng(7)
    theta = rng.uniform(0.1, 0.8, 12)
    slip = (1 - np.cos(theta)) * rng.uniform(-0.9, 1.0, 12)
    soil = sphere.Soil(1e6, 0.9, 500.0, 0.6, 0.02, recovery=recovery)
    found = np.array(sphere.forces(theta, slip, 0.2, soil, linear))
    exact = contact_numpy.forces(theta, slip, np.full(12, 0.2), soil, linear, 200, 200)
    scale = np.abs(exact[0]) + np.abs(exact[1])
    scale = np.stack([scale, scale, 0.2 * scale])
    plain = contact_numpy.forces(theta, slip, np.full(12, 0.2), soil, linear, 12, 12)
    errors = [(np.abs(found - exact) / scale).max(), (np.abs(plain - exact) / scale).max()]
    assert errors[0] < 1e-7
    assert errors[1] > 2e-6  # why the parts are split


def test_rows_are_independent() -> None:
    slip, load = np.array([0.0, 0.2, 0.5, 0.9]), np.array([20.0, 50.0, 150.0, 300.0])
    together = sphere.solve(load, slip, 0.22, SAND)
    for i in range(4):
        alone = sphere.solve(load[i], slip[i], 0.22, SAND)
        assert alone.entry[0] == together.entry[i]
        assert alone.torque[0] == together.torque[i]


def test_a_near_start_gives_the_same() -> None:
    slip = np.linspace(0.0, 1.0, 9)
    cold = sphere.solve(150.0, slip, 0.22, SAND).entry
    for start in (0.37, 1e-3, 1.5):
        np.testing.assert_allclose(sphere.solve(150.0, slip, 0.22, SAND, start=start).entry, cold, rtol=1e-11)


# ------------------------------------------------------------------ derivatives


def _quotients(at: Mapping[str, float], evaluate: object, name: str) -> np.ndarray:
    """Central differences of fourth order of (vertical, traction, torque) by one field."""
    step = 1e-3 * max(abs(at[name]), 1e-2)
    total = 0.0
    for k, weight in ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12)):
        total = total + weight * evaluate({**at, name: at[name] + k * step})  # type: ignore[operator]
    return np.asarray(total / step)


@pytest.mark.parametrize("shape", ["sphere", "wheel"])
@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("slip", [-0.4, 0.35])
def test_derivatives_against_differences(shape: contact.Shape, linear: bool, slip: float) -> None:
    at = {
        "entry": 0.45,
        "slip": slip,
        "radius": 0.2,
        "width": 0.15,
        "stiffness": 8e5,
        "exponent": 0.9,
        "cohesion": 400.0,
        "friction_angle": 0.55,
        "shear_modulus": 0.02,
        "c1": 0.35,
        "c2": 0.25,
        "recovery": 0.3,
    }

    def run(values: Mapping[str, float], derivatives: bool = False) -> contact.Contact:
        fields = {name: values[name] for name in FIELDS}
        return contact.contact(shape, linear, fields, derivatives, entry=values["entry"])

    def forces(values: Mapping[str, float]) -> np.ndarray:
        c = run(values)
        return np.array([c.vertical[0], c.traction[0], c.torque[0]])

    found = run(at, derivatives=True).derivative
    assert found is not None
    for i, name in enumerate(contact.COLUMNS):
        if name == "width" and shape == "sphere":
            continue
        exact = _quotients(at, forces, name)
        got = np.array([found[o][0, i] for o in ("vertical", "traction", "torque")])
        size = np.abs(forces(at)) / max(abs(at[name]), 1e-2)
        np.testing.assert_allclose(got, exact, rtol=1e-6, atol=2e-8 * size.max(), err_msg=name)


def test_derivatives_where_the_rim_skids() -> None:
    at = {"entry": 0.45, "slip": 0.03, "radius": 0.2, "width": 0.0, **vars(SAND), "recovery": 0.2}

    def forces(values: Mapping[str, float]) -> np.ndarray:
        c = contact.contact("sphere", False, {n: values[n] for n in FIELDS}, False, entry=values["entry"])
        return np.array([c.vertical[0], c.traction[0], c.torque[0]])

    found = contact.contact("sphere", False, {n: at[n] for n in FIELDS}, True, entry=0.45).derivative
    assert found is not None
    for name in ("entry", "slip", "stiffness", "exponent", "friction_angle", "shear_modulus", "c1", "c2"):
        got = np.array([found[o][0, contact.COLUMNS.index(name)] for o in ("vertical", "traction", "torque")])
        size = np.abs(forces(at)).max() / max(abs(at[name]), 1e-2)
        np.testing.assert_allclose(got, _quotients(at, forces, name), rtol=1e-6, atol=1e-6 * size, err_msg=name)


def test_derivatives_at_equilibrium_hold_the_load() -> None:
    slip = np.array([0.2, 0.6])
    c = wheel.solve(20.0, slip, 0.08, 0.15, WHEEL, derivatives=True)
    assert c.derivative is not None

    def outputs(load: float, radius: float, width: float, **changed: float) -> np.ndarray:
        d = wheel.solve(load, slip, radius, width, replace(WHEEL, **changed))
        return np.stack([d.entry, d.vertical, d.traction, d.torque])

    base = {"load": 20.0, "radius": 0.08, "width": 0.15, **vars(WHEEL), "recovery": 0.0}
    for column, name in enumerate(wheel.COLUMNS):
        if name in ("slip", "recovery"):
            continue
        key = "load" if name == "entry" else name
        step = 1e-3 * abs(base[key])
        exact = np.zeros((4, 2))
        for k, weight in ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12)):
            exact += weight * outputs(**{**base, key: base[key] + k * step}) / step
        got = np.stack([c.derivative[o][:, column] for o in ("entry", "vertical", "traction", "torque")])
        np.testing.assert_allclose(got, exact, rtol=1e-6, atol=3e-7 * np.abs(exact).max(), err_msg=name)


def test_unchecked_slopes_are_the_checked_ones() -> None:
    theta, slip = np.array([0.2, 0.5]), np.array([0.1, 0.7])
    value, by = wheel.slopes(theta, slip, 0.08, 0.15, WHEEL)
    c = wheel.at(theta, slip, 0.08, 0.15, WHEEL, derivatives=True)
    assert c.derivative is not None
    np.testing.assert_array_equal(value[1], c.traction)
    np.testing.assert_array_equal(by[2], c.derivative["torque"])
    assert by.shape == (3, 2, len(wheel.COLUMNS))
    value, by = sphere.slopes(theta, slip, 0.2, SAND)
    d = sphere.at(theta, slip, 0.2, SAND, derivatives=True)
    assert d.derivative is not None
    np.testing.assert_array_equal(value, np.array(sphere.forces(theta, slip, 0.2, SAND)))
    np.testing.assert_array_equal(by[0], d.derivative["vertical"])


# ------------------------------------------------------------------ soils


def test_wheel_of_either_form() -> None:
    """The same soil in Bekker's and in Reece's form gives one contact; a number moved unconverted does not."""
    sand = replace(soils.library()["dry_sand_lll"], shear_modulus=0.025)
    one = wheel.solve(18.639, 0.3, 0.08, 0.15, wheel.soil_of(sand, 0.15))
    two = wheel.solve(18.639, 0.3, 0.08, 0.15, wheel.soil_of(sand.converted("reece", 0.15), 0.15))
    assert one.sinkage[0] == pytest.approx(two.sinkage[0], rel=1e-12)
    moved = replace(WHEEL, k_c=sand.k_c, k_phi=sand.k_phi, cohesion=sand.cohesion, friction_angle=sand.friction_angle)
    assert wheel.solve(18.639, 0.3, 0.08, 0.15, moved).sinkage[0] < 0.95 * one.sinkage[0]


def test_library_has_the_papers_soils() -> None:
    found = soils.library()
    for name, paper, form, unit in (
        ("lete_sand", "Vella", "bekker", "Pa/m^0.71"),
        ("dry_sand_li", "Li et al.", "bekker", "Pa/m^0.97"),
        ("sand_reina", "Reina", "reece", "Pa/m"),
    ):
        assert paper in found[name].source
        assert found[name].form == form
        assert found[name].unit("k_phi") == unit
    li = found["dry_sand_li"]
    assert li.footing(0.1) == (SAND.stiffness, SAND.exponent, SAND.cohesion, SAND.friction_angle, SAND.shear_modulus)


# ------------------------------------------------------------------ bad input

WRONG = {
    "slip": [-1.01, 1.2, np.nan, np.inf],
    "radius": [0.0, -0.1, np.inf],
    "stiffness": [-1e6, 0.0, np.nan],
    "exponent": [0.0, -1.0, 3.5],
    "cohesion": [-1.0],
    "friction_angle": [-0.1, 1.6],
    "shear_modulus": [0.0, -0.01],
    "recovery": [-0.1, 1.0],
    "load": [0.0, -5.0, np.nan, np.inf],
}


@pytest.mark.parametrize(("name", "value"), [(n, v) for n, values in WRONG.items() for v in values])
def test_values_out_of_range_are_named(name: str, value: float) -> None:
    given = {"load": 150.0, "slip": 0.5, "radius": 0.22} | ({name: value} if name in ("load", "slip", "radius") else {})
    soil = replace(SAND, **({} if name in given else {name: value}))
    with pytest.raises(
        ContactError, match="^" + re.escape(f"{name}: found {value:g}") + ".*expected (more than|at least) "
    ):
        sphere.solve(given["load"], given["slip"], given["radius"], soil)


def test_one_bad_point_among_many_is_named() -> None:
    slip = np.linspace(0.0, 1.0, 5)
    slip[3] = 1.5
    with pytest.raises(ContactError, match=r"slip: found 1.5 \(point 3\), expected at least -1 and at most 1"):
        sphere.solve(150.0, slip, 0.22, SAND)


def test_too_heavy() -> None:
    with pytest.raises(ContactError, match=r"load: found 1e\+09 N \(point 1\), expected at most \d.*carries no more"):
        sphere.solve(np.array([100.0, 1e9]), 0.5, 0.22, SAND)
    assert sphere.entry_angle(1e9, 0.5, 0.22, SAND)[0] == contact.THETA_MAX  # for fits: marked, not raised
    most = wheel.at(contact.THETA_MAX, 0.3, 0.08, 0.15, WHEEL).vertical[0]
    assert wheel.solve(most * 0.999, 0.3, 0.08, 0.15, WHEEL).entry[0] < contact.THETA_MAX
    with pytest.raises(ContactError, match="load: found"):
        wheel.solve(most * 1.001, 0.3, 0.08, 0.15, WHEEL)


NUMBERS = st.floats(allow_nan=True, allow_infinity=True, width=64)


@given(load=NUMBERS, slip=NUMBERS, radius=NUMBERS, stiffness=NUMBERS, n=NUMBERS, k=NUMBERS, linear=st.booleans())
@settings(max_examples=200, deadline=None)
def test_never_an_unconverged_value(
    load: float, slip: float, radius: float, stiffness: float, n: float, k: float, linear: bool
) -> None:
    """Whatever goes in: an equilibrium within 1e-9, or an error that names a quantity and what it was."""
    soil = replace(SAND, stiffness=stiffness, exponent=n, shear_modulus=k)
    c, refused = solved(load, slip, radius, soil, linear)
    if c is None:
        assert ": found " in refused
        return
    assert c.vertical[0] == pytest.approx(load, rel=1e-9)
    assert np.isfinite([c.entry[0], c.sinkage[0], c.traction[0], c.torque[0]]).all()


@given(
    load=st.floats(1e-6, 1e6),
    slip=st.floats(-1.0, 1.0),
    radius=st.floats(1e-2, 2.0),
    stiffness=st.floats(1e2, 1e9),
    n=st.floats(0.2, 2.5),
    k=st.floats(1e-4, 1.0),
    c1=st.floats(0.0, 0.9),
    recovery=st.floats(0.0, 0.99),
)
@settings(max_examples=200, deadline=None)
def test_converges_wherever_a_sinkage_exists(
    load: float, slip: float, radius: float, stiffness: float, n: float, k: float, c1: float, recovery: float
) -> None:
    soil = sphere.Soil(stiffness, n, 0.0, 0.5, k, c1, 0.2, recovery)
    most = sphere.forces(contact.THETA_MAX, slip, radius, soil)[0][0]
    c, refused = solved(load, slip, radius, soil)
    if c is None:
        assert "carries no more" in refused
        assert most < load
        return
    assert c.vertical[0] == pytest.approx(load, rel=1e-9)
