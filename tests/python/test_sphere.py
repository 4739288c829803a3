"""The contact integrals of sphere and wheel: limits, closed forms, and numbers of an independent implementation."""

from __future__ import annotations

import doctest
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import dblquad
from scipy.special import beta

from terrapin_hil.physics import sphere, wheel
from terrapin_hil.physics.contact import THETA_MAX

PHI = np.radians(42.2)
SAND = sphere.Soil(1.945e6, 0.97, 0.0, PHI, 0.01778)  # Li et al. 2024, Table 1

# stress, R, W, slip, theta_1, sinkage, traction, torque, R_c: quadrature converged below 1e-9 elsewhere
REFERENCE = [
    ("full", 0.22, 150, 0.2, 0.37062717, 0.0149379191, 29.3236247, 11.0707663, 2.86673138),
    ("full", 0.22, 150, 0.295454545, 0.372004808, 0.0150478893, 42.2467703, 13.9571236, 2.91962491),
    ("full", 0.22, 150, 0.5, 0.376190278, 0.0153843807, 59.9774623, 18.0067003, 3.08507503),
    ("full", 0.22, 150, 0.9, 0.389069387, 0.0164422571, 74.3971612, 21.6344788, 3.64117425),
    ("full", 0.22, 150, 1.0, 0.393374849, 0.0168034423, 75.8060303, 22.0886153, 3.84375483),
    ("full", 0.30, 300, 0.4, 0.351921953, 0.0183864165, 127.679715, 50.3677961, 5.63075191),
    ("linear", 0.22, 150, 0.2, 0.387390075, 0.0163024022, 42.9311075, 14.0395247, 3.56448684),
    ("linear", 0.22, 150, 0.5, 0.389589717, 0.0164857073, 71.8340621, 20.6313819, 3.66519828),
    ("linear", 0.22, 150, 0.659090909, 0.392675344, 0.0167445044, 77.400092, 22.0415184, 3.81025008),
    ("linear", 0.22, 150, 1.0, 0.40322567, 0.0176439848, 80.7659932, 23.2757513, 4.34080659),
]


def test_docstring_examples() -> None:
    assert doctest.testmod(sphere).failed == 0
    assert doctest.testmod(wheel).failed == 0


@pytest.mark.parametrize(
    ("stress", "radius", "load", "slip", "theta", "depth", "traction", "torque", "bulldozing"), REFERENCE
)
def test_reference_numbers(
    stress: str,
    radius: float,
    load: float,
    slip: float,
    theta: float,
    depth: float,
    traction: float,
    torque: float,
    bulldozing: float,
) -> None:
    linear = stress == "linear"
    found = sphere.entry_angle(load, slip, radius, SAND, linear)
    vertical, along, moment = sphere.forces(found, slip, radius, SAND, linear)
    resistance = sphere.bulldozing(found, radius, 0.0, PHI, 19600.0, 20.0, 6.0)
    got = [found[0], sphere.sinkage(found, radius)[0], vertical[0], along[0], moment[0], resistance[0]]
    np.testing.assert_allclose(got, [theta, depth, load, traction, torque, bulldozing], rtol=2e-8)


@pytest.mark.parametrize(
    ("stress", "slip", "traction", "torque"),
    [
        ("full", 0.0, -14.8845264, 1.33331002),
        ("full", 0.1, 10.8451751, 6.98392608),
        ("linear", 0.0, -13.6864575, 1.61204989),
    ],
)
def test_skidding_rim(stress: str, slip: float, traction: float, torque: float) -> None:
    """Below slip = z/R the rim skids: a kink inside the integral, which the quadrature must split."""
    theta = sphere.entry_angle(150.0, slip, 0.22, SAND, stress == "linear")
    _, along, moment = sphere.forces(theta, slip, 0.22, SAND, stress == "linear")
    np.testing.assert_allclose([along[0], moment[0]], [traction, torque], rtol=5e-7)


def test_given_entry_angle() -> None:
    for linear, expected in (
        (False, (191.282571, 77.4163594, 23.5228967)),
        (True, (166.623995, 80.0467884, 23.1031452)),
    ):
        got = [float(v[0]) for v in sphere.forces(0.4, 0.5, 0.22, SAND, linear)]
        np.testing.assert_allclose(got, expected, rtol=2e-8)
    cohesive = [float(v[0]) for v in sphere.forces(0.4, 0.5, 0.22, replace(SAND, cohesion=500.0))]
    np.testing.assert_allclose(cohesive, (191.743469, 80.7675499, 24.2579922), rtol=2e-8)
    resistance = [float(sphere.bulldozing(0.4, 0.22, c, PHI, 19600.0, 20.0, 6.0)[0]) for c in (0.0, 500.0)]
    np.testing.assert_allclose(resistance, (4.17276987, 13.6899244), rtol=2e-9)


def test_bulldozing_is_the_integral_of_eq_8() -> None:
    radius, theta, cohesion, weight = 0.22, 0.4, 500.0, 19600.0
    k_l, k_g = sphere.bulldozing_factors(PHI, 20.0, 6.0)
    np.testing.assert_allclose([k_l, k_g], [14.2048, 15.2710], rtol=1e-5)
    x = np.linspace(0.0, radius * np.sin(theta), 200_001)
    z = np.sqrt(radius**2 - x**2) - radius * np.cos(theta)
    direct = 2.0 * np.trapezoid(0.67 * cohesion * z * k_l + 0.5 * z * z * weight * k_g, x)
    np.testing.assert_allclose(sphere.bulldozing(theta, radius, cohesion, PHI, weight, 20.0, 6.0), direct, rtol=1e-8)


def test_compaction_resistance_of_bekker() -> None:
    """Without shear and with the peak at the bottom, -traction is the work of pressing the rut down."""
    radius, theta, n = 0.22, 0.4, 0.97
    soil = sphere.Soil(1.945e6, n, 0.0, 0.0, 0.01778, c1=0.0, c2=0.0)
    _, traction, torque = sphere.forces(theta, 0.5, radius, soil)
    u, w = np.polynomial.legendre.leggauss(400)
    angle = np.pi / 4 * (u + 1)
    x = radius * np.sin(theta) * np.sin(angle)
    z = np.sqrt(radius**2 - x**2) - radius * np.cos(theta)
    work = 2.0 * np.sum(1.945e6 * z ** (n + 1) / (n + 1) * radius * np.sin(theta) * np.cos(angle) * w * np.pi / 4)
    np.testing.assert_allclose(-traction, work, rtol=1e-8)
    assert torque[0] == 0.0


def test_small_loads_follow_the_power_law() -> None:
    n, m, radius = 0.97, 0.18 + 0.32 * 0.5, 0.22
    share, weight = np.polynomial.legendre.leggauss(60)
    u = m + (1 - m) * 0.5 * (share + 1)
    inner = np.sum((1 - u * u) ** n * weight) * 0.5 * (1 - m)
    ratios = []
    for load in (1.0, 1e-6):
        z = float(sphere.sinkage(sphere.entry_angle(load, 0.5, radius, SAND), radius)[0])
        ratios.append(load / (4 * 1.945e6 * radius * z ** (n + 1) * inner / (1 - m) * beta(0.5, n + 1.5) / 2))
    np.testing.assert_allclose(ratios, [1.0069, 1.00001], atol=1e-4)


def test_linear_stress_closed_form_against_quadrature() -> None:
    """One wheel is one disc: the closed form against the triangular stress integrated numerically, rut recovery too."""
    soil = wheel.Soil(24e3, 1528e3, 1.1, 700.0, np.radians(30), 0.025, recovery=0.3)
    theta, slip, radius, width = 0.5, 0.4, 0.08, 0.15
    vertical, traction, torque = (float(v[0]) for v in wheel.forces(theta, slip, radius, width, soil, True))
    peak, back = 0.25, -0.15
    sigma = (24e3 + 1528e3 * width) * (radius / width * (np.cos(peak) - np.cos(theta))) ** 1.1
    travel = radius * ((theta - peak) - (1 - slip) * (np.sin(theta) - np.sin(peak)))
    tau = (700.0 + sigma * np.tan(np.radians(30))) * (1 - np.exp(-travel / 0.025))
    t = np.linspace(back, theta, 400_001)
    f = np.where(t > peak, (theta - t) / (theta - peak), (t - back) / (peak - back))
    direct = [
        np.trapezoid(radius * width * f * (sigma * np.cos(t) + tau * np.sin(t)), t),
        np.trapezoid(radius * width * f * (tau * np.cos(t) - sigma * np.sin(t)), t),
        np.trapezoid(radius * radius * width * f * tau, t),
    ]
    np.testing.assert_allclose([vertical, traction, torque], direct, rtol=1e-8)


def test_full_stress_with_recovery_against_adaptive_quadrature() -> None:
    soil = replace(SAND, recovery=0.4, cohesion=300.0)
    theta, slip, radius = 0.35, 0.3, 0.22
    a = radius * np.cos(theta)

    def torque_density(angle: float, share: float) -> float:
        x = radius * np.sin(theta) * np.sin(share)
        r = np.sqrt(radius**2 - x**2)
        one = np.arccos(min(a / r, 1.0))
        rolled = radius * (1 - slip) / r
        peak, back = (0.18 + 0.32 * (1 - rolled)) * one, -0.4 * one
        t = back + angle * (one - back)
        front = t if t > peak else one - (t - back) * (one - peak) / (peak - back)
        sigma = 1.945e6 * (r * max(np.cos(front) - np.cos(one), 0.0)) ** 0.97
        j = r * ((one - t) - rolled * (np.sin(one) - np.sin(t)))
        tau = (300.0 + sigma * np.tan(PHI)) * (1 - np.exp(-j / 0.01778))
        return float(2 * tau * r * r * (one - back) * radius * np.sin(theta) * np.cos(share))

    direct, _ = dblquad(torque_density, 0.0, np.pi / 2, 0.0, 1.0, epsabs=1e-7, epsrel=1e-7)
    assert float(sphere.forces(theta, slip, radius, soil)[2][0]) == pytest.approx(direct, rel=2e-6)


@given(
    load=st.floats(0.5, 600.0),
    slip=st.floats(0.1, 1.0),
    radius=st.floats(0.05, 0.5),
    stiffness=st.floats(1e5, 1e7),
    n=st.floats(0.6, 1.3),
    phi=st.floats(0.3, 0.8),
    recovery=st.floats(0.0, 0.9),
    linear=st.booleans(),
)
@settings(max_examples=80, deadline=None)
def test_balance_and_energy(
    load: float, slip: float, radius: float, stiffness: float, n: float, phi: float, recovery: float, linear: bool
) -> None:
    """The entry angle carries the load; the drive's work covers the pull's: T/R >= DP (1 - s)."""
    soil = sphere.Soil(stiffness, n, 500.0, phi, 0.02, recovery=recovery)
    theta = sphere.entry_angle(load, slip, radius, soil, linear)
    vertical, traction, torque = sphere.forces(theta, slip, radius, soil, linear)
    if theta[0] >= 0.999 * THETA_MAX:
        assert vertical[0] <= load * (1 + 1e-9)
        return
    assert vertical[0] == pytest.approx(load, rel=1e-10)
    if recovery == 0.0:
        assert torque[0] / radius >= traction[0] * (1 - slip) - 1e-9 * load


def test_load_beyond_the_soil_is_marked() -> None:
    assert sphere.entry_angle(1e9, 0.5, 0.22, SAND)[0] == pytest.approx(THETA_MAX)


def test_rows_are_independent() -> None:
    slip, load = np.array([0.2, 0.5, 0.9]), np.array([50.0, 150.0, 300.0])
    together = sphere.entry_angle(load, slip, 0.22, SAND)
    alone = [sphere.entry_angle(w, s, 0.22, SAND)[0] for w, s in zip(load, slip, strict=True)]
    np.testing.assert_allclose(together, alone, rtol=1e-12)


# theta_1 [deg], slip, W, DP, T for c = 700, phi = 30 deg, k_c = 24e3, k_phi = 1528e3, n = 1.1, b = 0.15, k = 0.025, R
WHEEL = [
    (False, 10.0, 0.0, 1.025400275, -0.08522650975, 0.0003577230437),
    (True, 10.0, 0.0, 0.9625715011, -0.08100998701, 0.00025551528),
    (False, 10.0, 0.3, 1.035582877, 0.07638168406, 0.01332217251),
    (True, 10.0, 0.3, 0.9715096301, 0.0211532944, 0.008465006146),
    (False, 24.79773984, 0.4686655738, 18.639, 0.0, 0.3216918512),
    (True, 28.60877699, 0.5885097112, 27.9585, 0.0, 0.5555031202),
]


@pytest.mark.parametrize(("linear", "degrees", "slip", "load", "traction", "torque"), WHEEL)
def test_wheel_reference(
    linear: bool, degrees: float, slip: float, load: float, traction: float, torque: float
) -> None:
    soil = wheel.Soil(24e3, 1528e3, 1.1, 700.0, np.radians(30), 0.025)
    got = wheel.forces(np.radians(degrees), slip, 0.08, 0.15, soil, linear)
    np.testing.assert_allclose([float(v[0]) for v in got], [load, traction, torque], rtol=1e-7, atol=2e-8)
    found = wheel.entry_angle(load, slip, 0.08, 0.15, soil, linear)
    np.testing.assert_allclose(np.degrees(found), degrees, rtol=1e-7)
