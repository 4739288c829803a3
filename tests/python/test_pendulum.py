"""The pendulum sphere: Lagrange's equations, what is conserved, steady rolling, the printed numbers, refusals."""

from __future__ import annotations

import doctest
from dataclasses import asdict, replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

from terrapin_hil.physics import pendulum, signals
from terrapin_hil.physics.compiled import ffi, library
from terrapin_hil.physics.pendulum import PendulumSphere, on_sand, ramp, roll, steady_swing, steady_torque
from terrapin_hil.physics.tyre import ContactError

TURN = 2.0 * np.pi
BOARD = PendulumSphere()
Array = npt.NDArray[np.float64]


def energy(sphere: PendulumSphere, swing: Array, swing_rate: Array, shell_rate: Array) -> Array:
    """Mechanical energy [J] on level ground, zero at rest with the bob below."""
    s = sphere
    arm = s.radius * s.bob_mass * s.length
    shell = s.mass * s.radius**2 + s.shell_inertia
    bob = s.bob_mass * s.length**2 + s.frame_inertia + s.bob_inertia
    kinetic = 0.5 * shell * shell_rate**2 + arm * np.cos(swing) * shell_rate * swing_rate + 0.5 * bob * swing_rate**2
    return np.asarray(kinetic + s.largest_torque * (1.0 - np.cos(swing)))


def free(
    sphere: PendulumSphere, times: npt.ArrayLike, swing: float, torque: float = 0.0, step: float = 1e-3
) -> tuple[Array, Array, Array, Array]:
    """Motion under a constant joint torque [N m] from rest, bob at `swing` [rad]: phi, theta and their rates."""
    body = ffi().new("hil_pendulum *", tuple(asdict(sphere).values()))
    around = ffi().new("hil_pendulum_around *", (0.0, 0.0))
    found = ffi().new("double[2]")

    def rates(y: Array) -> Array:
        library().hil_pendulum_free(body, around, ffi().new("hil_pendulum_state *", tuple(y)), torque, found)
        return np.array([y[2], y[3], found[0], found[1]])

    y, now, rows = np.array([swing, 0.0, 0.0, 0.0]), 0.0, []
    for time in np.asarray(times, dtype=np.float64):
        count = max(0, round((time - now) / step))
        for _ in range(count):
            k1 = rates(y)
            k2 = rates(y + 0.5 * step * k1)
            k3 = rates(y + 0.5 * step * k2)
            y = y + step / 6.0 * (k1 + 2.0 * (k2 + k3) + rates(y + step * k3))
        now += count * step
        rows.append(y)
    phi, theta, phi_rate, theta_rate = np.array(rows).T
    return phi, theta, phi_rate, theta_rate


def test_examples() -> None:
    assert doctest.testmod(pendulum).failed == 0
    assert doctest.testmod(signals).failed == 0


def test_energy_is_kept_without_friction() -> None:
    quiet = replace(BOARD, viscous=0.0, f_o=0.0)
    drift = []
    for step in (4e-3, 2e-3):
        phi, _, phi_rate, theta_rate = free(quiet, np.arange(0.0, 8.0, 0.04), 1.0, step=step)
        e = energy(quiet, phi, phi_rate, theta_rate)
        drift.append(float(np.abs(e / e[0] - 1.0).max()))
    assert drift[0] < 1e-5
    assert drift[1] < drift[0] / 12.0, "order 4 or better"


def test_momentum_about_the_contact_is_kept_without_gravity() -> None:
    """Without gravity nothing holds the joint's angle back: T does work on psi = theta + phi alone."""
    s = replace(BOARD, viscous=0.0, f_o=0.0, gravity=0.0)
    torque = 0.3
    phi, theta, phi_rate, theta_rate = free(s, np.arange(0.0, 1.0, 0.1), 0.4, torque)
    work = torque * (phi - 0.4 + theta)
    np.testing.assert_allclose(energy(s, phi, phi_rate, theta_rate), work, atol=1e-9)


def _independent(s: PendulumSphere, times: np.ndarray, acceleration: float, speed: float) -> np.ndarray:
    """Eq. 11 with the joint commanded, solved as a linear system for x'', phi'' and T; an adaptive integrator."""
    m = s.shell_mass + s.frame_mass + s.bob_mass
    g, arm = s.gravity, s.bob_mass * s.length

    def solve(t: float, y: np.ndarray) -> np.ndarray:
        phi, _, phi_rate, x_rate = y
        joint = acceleration if t < speed / acceleration else 0.0
        damping = s.viscous * (x_rate / s.radius + phi_rate)
        resist = s.f_o * m * g * np.cos(s.incline) * np.tanh(x_rate / s.radius / s.smoothing)
        lean = phi - s.incline
        matrix = [
            [(m + s.shell_inertia / s.radius**2) * s.radius, arm * np.cos(lean) * s.radius, -1.0],
            [arm * np.cos(lean), s.bob_mass * s.length**2 + s.frame_inertia + s.bob_inertia, -1.0],
            [1.0 / s.radius, 1.0, 0.0],
        ]
        right = [
            arm * np.sin(lean) * phi_rate**2 * s.radius
            - m * g * np.sin(s.incline) * s.radius
            - resist * s.radius
            - s.shell_share * damping,
            -arm * g * np.sin(phi) - damping,
            joint,
        ]
        return np.linalg.solve(matrix, right)

    found = solve_ivp(
        lambda t, y: [y[2], y[3], solve(t, y)[1], solve(t, y)[0]],
        (0.0, times[-1]),
        [0.0, 0.0, 0.0, 0.0],
        t_eval=times,
        rtol=1e-10,
        atol=1e-12,
        max_step=0.01,
    ).y
    torque = [solve(t, y)[2] for t, y in zip(times, found.T, strict=True)]
    return np.array([found[0], found[1], torque])


@pytest.mark.parametrize(
    "sphere",
    [BOARD, replace(BOARD, shell_share=0.0, viscous=0.1), replace(BOARD, incline=0.05, f_o=0.03, shell_inertia=0.133)],
    ids=["board", "printed", "uphill"],
)
def test_agrees_with_an_independent_solution(sphere: PendulumSphere) -> None:
    times = np.arange(0.0, 4.0, 0.01)
    run = roll(sphere, *ramp(times, 1.5, 1.8))
    swing, distance, torque = _independent(sphere, times, 1.5, 1.8)
    np.testing.assert_allclose(run.swing, swing, atol=1e-6)
    np.testing.assert_allclose(run.distance, distance, atol=1e-6)
    inside = np.abs(times - 1.2) > 0.011  # the torque jumps with the joint's acceleration
    np.testing.assert_allclose(run.torque[inside][:-1], torque[inside][:-1], atol=1e-5)


def test_steady_rolling_at_one_turn_a_second() -> None:
    """With the viscous term in both lines T = 4.41 N m and sin(phi) = 0.004; as printed sin(phi) would be -2.3."""
    assert steady_torque(BOARD, TURN) == pytest.approx(4.41, abs=0.005)
    assert np.sin(steady_swing(BOARD, TURN)) == pytest.approx(0.0044, abs=1e-4)
    printed = replace(BOARD, shell_share=0.0)
    with pytest.raises(ContactError, match=r"found a sine of -2\.29"):
        steady_swing(printed, TURN)
    steady_swing(printed, 0.43 * TURN)
    with pytest.raises(ContactError):
        steady_swing(printed, 0.44 * TURN)
    assert BOARD.largest_torque == pytest.approx(1.913, abs=1e-3)


def test_steady_start_stays_steady() -> None:
    sphere = replace(BOARD, f_o=0.05)
    t = np.arange(0.0, 3.0, 0.01)
    run = roll(sphere, t, np.full(t.size, 2.0))
    np.testing.assert_allclose(run.torque, steady_torque(sphere, 2.0), rtol=1e-9)
    np.testing.assert_allclose(run.swing, steady_swing(sphere, 2.0), rtol=1e-9)
    np.testing.assert_allclose(run.distance, 0.22 * 2.0 * t, atol=1e-9)


def test_torque_oscillates_about_the_steady_one_at_the_frequency_of_small_swings() -> None:
    """At constant joint speed the driving torque is a sinusoid (text on Fig. 4) about friction and damping."""
    sphere = replace(BOARD, f_o=0.003)
    run = roll(sphere, *ramp(np.arange(0.0, 40.0, 0.01), 0.1, 1.0))
    late = run.time > 10.0
    torque, time = run.torque[late], run.time[late]
    arm = sphere.bob_mass * sphere.length
    inertia = sphere.mass * 0.22**2 + sphere.shell_inertia - 2 * 0.22 * arm
    inertia += arm * sphere.length + sphere.frame_inertia + sphere.bob_inertia
    period = TURN / np.sqrt(arm * sphere.gravity / inertia)
    rising = np.flatnonzero(np.diff(np.sign(torque - torque.mean())) > 0)
    assert np.diff(time[rising]).mean() == pytest.approx(period, rel=0.02)
    whole = time < time[rising[-1]]
    assert torque[whole & (time > time[rising[0]])].mean() == pytest.approx(steady_torque(sphere, 1.0), rel=0.01)


def test_sand_takes_the_contacts_torque_and_slip() -> None:
    sand = on_sand(BOARD, 0.7, 0.04)
    assert steady_torque(replace(sand, viscous=0.0), 1.0) == pytest.approx(0.7)
    t = np.arange(0.0, 4.0, 0.01)
    on_board, run = roll(BOARD, *ramp(t, 1.0, 2.0)), roll(sand, *ramp(t, 1.0, 2.0))
    assert run.torque[1:].mean() - on_board.torque[1:].mean() == pytest.approx(0.7, abs=0.1)
    np.testing.assert_allclose(run.distance, 0.22 * 0.96 * run.shell_angle, rtol=1e-12)
    assert run.distance[-1] < on_board.distance[-1]


def test_ground_that_takes_more_than_the_bob_can_give_is_not_rolled_over() -> None:
    """The soil of Table 1 takes 1.94 N m of a free sphere, the bob gives 1.91: it goes over the top."""
    run = roll(on_sand(BOARD, 1.94, 0.037), *ramp(np.arange(0.0, 20.0, 0.01), 0.3, 1.0))
    assert run.swing.max() > np.pi
    with pytest.raises(ContactError):
        steady_swing(on_sand(BOARD, 1.94, 0.037), 1.0)


def test_trajectory_has_a_ramp_a_plateau_and_a_stop() -> None:
    _, rate = ramp([0.0, 1.0, 2.0, 4.0, 5.0, 6.0, 9.0], 0.5, 1.0, stop=4.0)
    np.testing.assert_allclose(rate, [0.0, 0.5, 1.0, 1.0, 0.5, 0.0, 0.0])
    run = roll(BOARD, *ramp(np.arange(0.0, 3.0, 0.01), 0.5, 1.0))
    np.testing.assert_allclose(run.joint_angle[-1], 1.0 + 0.99, atol=1e-9)
    np.testing.assert_allclose(run.joint_angle, run.shell_angle + run.swing, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius": 0.0}, "pendulum sphere radius: found 0, expected more than 0"),
        ({"viscous": -0.1}, "pendulum sphere viscous: found -0.1, expected at least 0"),
        ({"f_o": float("nan")}, "pendulum sphere f_o: found nan"),
    ],
)
def test_bad_spheres(change: dict[str, float], message: str) -> None:
    with pytest.raises(ContactError, match=message):
        PendulumSphere(**change)


def test_bad_trajectories() -> None:
    with pytest.raises(ContactError, match="joint acceleration: found 0"):
        ramp([0.0, 1.0], 0.0, 1.0)
    with pytest.raises(ContactError, match="times that do not rise"):
        roll(BOARD, [0.0, 0.0, 1.0], [0.0, 0.0, 1.0])
    with pytest.raises(ContactError, match="slip: found 1"):
        on_sand(BOARD, 1.0, 1.0)
