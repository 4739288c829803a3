"""The tyre's contact: numbers of an independent implementation, quadrature, derivatives, and what is refused."""

from __future__ import annotations

import doctest
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from terrapin_hil.physics import tyre
from terrapin_hil.physics.compiled import library as compiled
from terrapin_hil.physics.compiled import pointer
from terrapin_hil.physics.soils import Footing, library
from terrapin_hil.physics.tyre import INPUTS, OUTPUTS, ContactError, Tyre, evaluate, solve

NOMINAL = library()["lete_sand"].footing(0.235)
FITTED = library()["sand_vella"].footing(0.235)

# soil, load, slip, sinkage, F_x, M_y, R*, th_f [deg], R_e: at equilibrium
EQUILIBRIUM = [
    (FITTED, 3000.0, 0.0, 0.0745219518, 66.7784377, 206.640619, 0.435190321, 34.0284209, 0.350094444),
    (FITTED, 3000.0, 0.8, 0.0745472491, 1135.10899, 592.823709, 0.43516333, 34.0354598, 0.350094444),
    (FITTED, 4407.1425, 0.05, 0.0997535268, 669.166691, 537.86016, 0.442942944, 39.2136645, 0.347488625),
    (FITTED, 4407.1425, 0.2, 0.0989240869, 1202.31789, 725.273797, 0.443674862, 39.0101262, 0.347488625),
    (FITTED, 4407.1425, 0.5, 0.0990106262, 1508.37997, 839.124075, 0.443597924, 39.0313987, 0.347488625),
    (FITTED, 6000.0, 0.3, 0.125068984, 1840.52896, 1098.95948, 0.45043769, 43.752069, 0.344538889),
    (NOMINAL, 3000.0, 0.1, 0.0494371658, 486.931405, 299.542449, 0.475549673, 26.357406, 0.350094444),
    (NOMINAL, 4407.1425, 0.0, 0.0667813018, 114.956902, 249.346949, 0.486042473, 30.3900061, 0.347488625),
    (NOMINAL, 6000.0, 0.8, 0.0854640985, 2422.5424, 1178.29735, 0.494363216, 34.1956893, 0.344538889),
]
# soil, slip, sinkage, F_x, F_z, M_y with the tyre deflected by 4407.1425 N
AT_SINKAGE = [
    (FITTED, 0.0, 0.03, -13.0875019, 1418.28906, 24.8957797),
    (FITTED, 0.5, 0.09, 1428.85839, 3995.00749, 759.609883),
    (NOMINAL, 0.2, 0.06, 1168.0797, 3996.33691, 583.055404),
    (NOMINAL, 0.5, 0.03, 964.800406, 2080.20823, 382.688202),
]


def test_examples() -> None:
    assert doctest.testmod(tyre).failed == 0


@pytest.mark.parametrize("row", EQUILIBRIUM)
def test_equilibrium_meets_the_reference(row: tuple) -> None:
    footing, load, slip, *expected = row
    c = solve(Tyre(), footing, [load], [slip])
    found = (c.sinkage, c.force, c.torque, c.circle_radius, np.degrees(c.entry_angle), c.effective_radius)
    assert [float(v[0]) for v in found] == pytest.approx(expected, rel=1e-6)
    assert c.load[0] == pytest.approx(load, rel=1e-9)


@pytest.mark.parametrize("row", AT_SINKAGE)
def test_given_sinkage_meets_the_reference(row: tuple) -> None:
    footing, slip, sinkage, *expected = row
    c = evaluate(Tyre(), footing, [4407.1425], [slip], [sinkage])
    assert [c.force[0], c.load[0], c.torque[0]] == pytest.approx(expected, rel=1e-6)


def adaptive(footing: Footing, load: float, slip: float, z: float) -> tuple[float, float, float]:
    """The same integrals as printed in tyre.h, by adaptive quadrature."""
    t = Tyre()
    d = load / t.stiffness
    circle = t.radius * (1 + d / z)
    front = np.arccos(1 - z / circle)
    rear = -np.arcsin(min(0.9, np.sqrt(2 * t.radius * d) / circle))
    middle = min(0.95, t.angle_share + t.angle_slip * abs(slip)) * front

    def stresses(theta: float) -> tuple[float, float]:
        mirrored = theta if theta >= middle else front - (theta - rear) / (middle - rear) * (front - middle)
        sigma = footing.stiffness * (circle * max(0.0, np.cos(mirrored) - np.cos(front))) ** footing.exponent
        j = circle * ((front - theta) - (1 - slip) * (np.sin(front) - np.sin(theta)))
        tau = footing.cohesion + sigma * np.tan(footing.friction_angle)
        return sigma, np.sign(j) * tau * (1 - np.exp(-abs(j) / footing.shear_modulus))

    def integral(of: object) -> float:
        parts = ((rear, middle), (middle, front))
        return sum(quad(of, *part, epsabs=0, epsrel=1e-10, limit=400)[0] for part in parts)

    scale = t.width * circle
    force = integral(lambda a: stresses(a)[1] * np.cos(a) - stresses(a)[0] * np.sin(a))
    carried = integral(lambda a: stresses(a)[0] * np.cos(a) + stresses(a)[1] * np.sin(a))
    torque = integral(lambda a: stresses(a)[1])
    return scale * force, scale * carried, scale * (t.radius - d / 3) * torque


@pytest.mark.parametrize("slip", [-0.3, 0.0, 0.2, 0.8])
def test_quadrature_error_is_as_stated(slip: float) -> None:
    found = evaluate(Tyre(), FITTED, 4000.0, slip, 0.08)
    expected = adaptive(FITTED, 4000.0, slip, 0.08)
    error = np.abs(np.array([found.force[0], found.load[0], found.torque[0]]) - expected)
    assert (error < 1.1e-5 * np.array([expected[1], expected[1], abs(expected[2])])).all()
    assert error[1] > 1e-6 * expected[1]  # better than stated would mean that this compares like with like


def test_derivatives_are_those_of_the_values() -> None:
    point = {"sinkage": 0.08, "load": 4400.0, "slip": 0.3, **FITTED._asdict()}

    def at(solving: bool, **changed: float) -> np.ndarray:
        p = {**point, **changed}
        footing = Footing(*(p[name] for name in Footing._fields))
        if solving:
            c = solve(Tyre(), footing, p["load"], p["slip"])
        else:
            c = evaluate(Tyre(), footing, p["load"], p["slip"], p["sinkage"])
        return np.array([c.force[0], c.load[0], c.torque[0], c.sinkage[0]])

    for solving in (False, True):
        if solving:
            derivative = solve(Tyre(), FITTED, 4400.0, 0.3, derivatives=True).derivative
        else:
            derivative = evaluate(Tyre(), FITTED, 4400.0, 0.3, 0.08, derivatives=True).derivative
        assert derivative is not None
        assert derivative.shape == (1, len(OUTPUTS), len(INPUTS))
        for column, name in enumerate(INPUTS):
            if solving and name == "sinkage":
                assert not derivative[0, :, column].any()
                continue
            h = 1e-4 * point[name]
            difference = (at(solving, **{name: point[name] + h}) - at(solving, **{name: point[name] - h})) / (2 * h)
            np.testing.assert_allclose(
                derivative[0, :, column], difference, rtol=3e-6, atol=1e-7 * np.abs(difference).max()
            )


@settings(max_examples=100, deadline=None)
@given(
    st.floats(1.0, 12000.0), st.floats(-1.0, 1.0), st.floats(2e5, 5e6), st.floats(0.3, 1.4), st.floats(0.0, 5e3),
    st.floats(0.0, 0.8), st.floats(0.005, 0.1),
)  # fmt: skip
def test_what_is_returned_carries_the_load(
    load: float, slip: float, k_s: float, n: float, cohesion: float, angle: float, shear: float
) -> None:
    footing = Footing(k_s, n, cohesion, angle, shear)
    try:
        c = solve(Tyre(), footing, load, slip)
    except ContactError:
        return  # refused, never unconverged
    again = evaluate(Tyre(), footing, load, slip, c.sinkage)
    assert again.load[0] == pytest.approx(load, rel=2e-9)
    assert c.force[0] == pytest.approx(again.force[0], rel=1e-7, abs=1e-7 * load)


def test_arrays_of_soils_and_points() -> None:
    soils = Footing(*(np.array([a, b]) for a, b in zip(NOMINAL, FITTED, strict=True)))
    both = solve(Tyre(), soils, 4407.1425, [0.2, 0.2])
    assert both.force == pytest.approx([1270.9676, 1202.31789], rel=1e-6)
    many = solve(Tyre(), FITTED, np.linspace(1000, 6000, 50), 0.1)
    assert (np.diff(many.sinkage) > 0).all()


SOFT = FITTED._replace(stiffness=2e3, cohesion=0.0)


@pytest.mark.parametrize(
    ("footing", "load", "slip", "message"),
    [
        (FITTED, 4000, 1.2, "slip: found 1.2, expected between -1 and 1"),
        (FITTED, 4000, -1.1, "slip: found -1.1, expected between -1 and 1"),
        (FITTED, [4000, -1], 0.2, r"load: found -1 N \(point 1\), expected between 0 and 6.402e\+04 N"),
        (FITTED, 1e5, 0.2, r"load: found 100000 N, expected between 0 and 6.402e\+04 N"),
        (FITTED, float("nan"), 0.2, "load: found nan N"),
        (SOFT, 5e3, 0.2, r"load: found 5000 N, expected at most \d+\.?\d* N: this soil carries no more"),
        (FITTED._replace(stiffness=-3.0), 4000, 0.2, r"soil stiffness: found -3 Pa/m\^n, expected more than 0"),
        (FITTED._replace(cohesion=-1.0), 4000, 0.2, "soil cohesion: found -1 Pa, expected at least 0"),
        (
            FITTED._replace(friction_angle=31.5),
            4000,
            0.2,
            "soil friction_angle: found 31.5 rad, expected between 0 and",
        ),
    ],
)
def test_a_value_out_of_range_is_named(footing: Footing, load: object, slip: float, message: str) -> None:
    with pytest.raises(ContactError, match=message):
        solve(Tyre(), footing, load, slip)


def test_sinkage_and_tyre_out_of_range_are_named() -> None:
    with pytest.raises(ContactError, match=r"sinkage: found 0.9 m, expected between 0 and 0.37\d* m"):
        evaluate(Tyre(), FITTED, 4000, 0.2, 0.9)
    with pytest.raises(ContactError, match="tyre width: found 0, expected more than 0"):
        Tyre(width=0.0)


def test_elementary_functions_are_good_to_1e_15() -> None:
    rng = np.random.default_rng(1)
    native, out, other = compiled(), np.empty(16), np.empty(16)
    for _ in range(300):
        x = rng.uniform(-700, 700, 16)
        native.hil_exp16(pointer(x), pointer(out))
        assert np.abs(out / np.exp(x) - 1).max() < 1e-15 * (1 + 0.01 * np.abs(x).max())
        y = np.exp(rng.uniform(-300, 300, 16))
        native.hil_log16(pointer(y), pointer(out))
        assert (np.abs(out - np.log(y)) < 1e-15 * np.maximum(1.0, np.abs(np.log(y)))).all()
        a = rng.uniform(-1.4, 1.4, 8)
        native.hil_sincos8(pointer(a), pointer(out), pointer(other))
        assert np.abs(out[:8] - np.sin(a)).max() < 5e-16
        assert np.abs(other[:8] - np.cos(a)).max() < 5e-16


def test_ten_thousand_equilibria_are_fast() -> None:
    rng = np.random.default_rng(2)
    load, slip = rng.uniform(2000, 6000, 10_000), rng.uniform(-0.5, 0.9, 10_000)
    spent = []
    for _ in range(3):
        begin = time.thread_time()
        solve(Tyre(), FITTED, load, slip)
        spent.append(time.thread_time() - begin)
    assert min(spent) / 10_000 < 20e-6
