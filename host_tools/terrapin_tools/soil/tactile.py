"""Cohesion and friction angle from a driven wheel: the equilibrium (13) to (15) of Reina et al. 2006, inverted.

At each operating point the rig measures load W, drawbar pull DP, torque T and slip i, all with noise. The true entry
angle and the true slip of each point are unknown too, so that nothing that was measured is taken as exact: 4 residuals
a point, 2 unknowns a point, and the soil's (cohesion, friction angle, as asked also the shear modulus and a factor of
the sinkage stiffness with a prior) in common. The sum of squares in units of the noise is minimised by Gauss-Newton
with Marquardt's damping; the points' own unknowns are eliminated exactly.

A single point cannot tell cohesion from friction: DP and T are nearly one equation (cos theta ~ 1), and both know the
soil only through the strength under the wheel. Several loads separate the two, several drawbar levels the modulus.

Regions (region.py) are sets of soils whose sum of squares lies less than a limit above the least: chi squared where the
noise was stated, an F distribution where only its proportions are known. Where the true soil is at a bound of what
physics allows they cover at least what they say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.physics import wheel
from terrapin_hil.physics.contact import THETA_MAX

__all__ = ["BOUNDS", "PARAMETERS", "Fit", "Noise", "Points", "Rig", "Unsolved", "fit", "predict", "strength"]


PARAMETERS = ("cohesion", "friction_angle", "shear_modulus", "stiffness_factor")
BOUNDS = np.array([[0.0, 200e3], [0.0, np.radians(60.0)], [1e-4, 1.0], [0.05, 20.0]])  # Pa, rad, m, 1
STEP = 1e-6  # relative, of the difference quotients


class Unsolved(ValueError):
    """No soil was found for the points. `str()` says what was tried."""


@dataclass(frozen=True)
class Rig:
    """The wheel, what is known of its ground, and the form of the stresses. SI units, angles in rad."""

    radius: float
    width: float
    k_c: float  # Reece form [Pa]
    k_phi: float  # [Pa/m]
    exponent: float
    linear: bool = False  # stresses in straight lines (the form that Reina et al. take from MIT)

    def soil(self, q: Array) -> wheel.Soil:
        """The ground with the parameters q (4,)."""
        return wheel.Soil(
            self.k_c * float(q[3]), self.k_phi * float(q[3]), self.exponent, float(q[0]), float(q[1]), float(q[2])
        )


@dataclass(frozen=True)
class Noise:
    """Standard deviations: load and torque relative, drawbar pull in parts of the load, slip absolute."""

    load: float = 0.002
    drawbar: float = 0.005
    torque: float = 0.01
    slip: float = 0.01


@dataclass(frozen=True)
class Points:
    """What was measured: arrays (points,) and their standard deviations (points, 4) in this order."""

    load: Array  # W [N]
    drawbar: Array  # DP [N]
    torque: Array  # T [N m]
    slip: Array
    sd: Array

    @classmethod
    def of(cls, load: Array, drawbar: Array, torque: Array, slip: Array, noise: Noise) -> Points:
        """With standard deviations from the values; a torque near 0 counts as a hundredth of load times 1 m."""
        sd = np.stack(
            [
                noise.load * load,
                noise.drawbar * load,
                noise.torque * np.maximum(np.abs(torque), 1e-3 * load),
                np.full(load.shape, noise.slip),
            ],
            axis=1,
        )
        return cls(load, drawbar, torque, slip, sd)

    @property
    def measured(self) -> Array:
        return np.stack([self.load, self.drawbar, self.torque, self.slip], axis=1)


@dataclass(frozen=True)
class Fit:
    """The optimum. `covariance` (4, 4) is zero in the rows of what was held."""

    q: Array  # (4,) as PARAMETERS
    theta: Array  # (points,) entry angle [rad]
    slip: Array  # (points,)
    squares: float  # in units of the noise, with the prior's part
    degrees: int
    covariance: Array
    free: Mask


def predict(rig: Rig, q: Array, theta: Array, slip: Array) -> Array:
    """W, DP, T and slip (points, 4) at entry angles [rad] and slips."""
    vertical, along, torque = wheel.forces(theta, slip, rig.radius, rig.width, rig.soil(q), rig.linear)
    return np.stack([vertical, along, torque, slip], axis=1)


def strength(rig: Rig, q: Array, theta: Array, slip: Array) -> tuple[Array, Array, Array]:
    """Where the normal stress is greatest: that stress, the shear stress there, and the strength of Eq. (11) [Pa]."""
    angle = 0.5 * theta
    fall = np.cos(angle) - np.cos(theta)
    stiffness = float(q[3]) * (rig.k_c + rig.k_phi * rig.width) * (rig.radius / rig.width) ** rig.exponent
    sigma = stiffness * np.maximum(fall, 0.0) ** rig.exponent
    travel = rig.radius * ((theta - angle) - (1.0 - slip) * (np.sin(theta) - np.sin(angle)))
    most = q[0] + sigma * np.tan(q[1])
    return sigma, most * -np.expm1(-np.abs(travel) / q[2]), most


@dataclass
class _State:
    """A trial: soil, points' own unknowns, residuals and their sum of squares."""

    q: Array
    u: Array  # (points, 2): ln theta_1, slip
    residuals: Array  # (points, 4)
    prior: float
    squares: float


def _evaluate(rig: Rig, points: Points, q: Array, u: Array, stiffness_sd: float) -> _State:
    theta = np.minimum(np.exp(u[:, 0]), THETA_MAX)
    residuals = (predict(rig, q, theta, u[:, 1]) - points.measured) / points.sd
    prior = float(np.log(q[3]) / stiffness_sd) if stiffness_sd > 0.0 else 0.0
    return _State(q, u, residuals, prior, float((residuals**2).sum()) + prior**2)


def _derivatives(rig: Rig, points: Points, state: _State, free: Mask) -> tuple[Array, Array]:
    """Of the residuals: by the points' own unknowns (points, 4, 2), by the free parameters (points, 4, free)."""
    theta, slip = np.exp(state.u[:, 0]), state.u[:, 1]
    base = state.residuals * points.sd + points.measured
    h = STEP
    own = np.stack(
        [
            (predict(rig, state.q, theta * np.exp(h), slip) - base) / h,
            (predict(rig, state.q, theta, slip + h) - base) / h,
        ],
        axis=2,
    )
    shared = []
    for index in np.flatnonzero(free):
        step = h * max(abs(float(state.q[index])), (1e3, 0.5, 0.01, 1.0)[index])
        moved = state.q.copy()
        moved[index] += step
        shared.append((predict(rig, moved, theta, slip) - base) / step)
    common = np.stack(shared, axis=2) if shared else np.zeros((*base.shape, 0))
    return own / points.sd[:, :, None], common / points.sd[:, :, None]


def _normal(own: Array, shared: Array, state: _State, free: Mask, stiffness_sd: float) -> tuple[Array, Array]:
    """Normal matrix and gradient of the shared parameters, with the prior of the stiffness."""
    matrix = np.einsum("nia,nib->ab", shared, shared)
    gradient = np.einsum("nia,ni->a", shared, state.residuals)
    if stiffness_sd > 0.0 and free[3]:
        rate = 1.0 / (stiffness_sd * state.q[3])
        matrix[-1, -1] += rate**2
        gradient[-1] += rate * state.prior
    return matrix, gradient


def fit(
    rig: Rig,
    points: Points,
    start: Sequence[float] | Array,
    free: Sequence[bool] = (True, True, False, False),
    stiffness_sd: float = 0.0,
    warm: Fit | None = None,
    bounds: Array = BOUNDS,
) -> Fit:
    """The soil that explains the points best, within `bounds` (4, 2); what is not free keeps its start value.

    `warm` is a fit nearby. Unsolved where the search does not converge (gradient 1e-6 of a standard deviation).
    """
    q = np.clip(np.array(start, dtype=np.float64), bounds[:, 0], bounds[:, 1])
    loose = np.array(free, dtype=bool)
    if warm is None:
        theta = wheel.entry_angle(points.load, points.slip, rig.radius, rig.width, rig.soil(q), rig.linear)
        if not (theta < THETA_MAX).all():
            at = int(np.argmin(theta < THETA_MAX))
            raise Unsolved(f"load: found {points.load[at]:g} N, more than this ground carries at any sinkage")
        u = np.stack([np.log(theta), points.slip], axis=1)
    else:
        u = np.stack([np.log(warm.theta), warm.slip], axis=1)
    state = _evaluate(rig, points, q, u, stiffness_sd)
    damping, settled = 1e-4, False
    own, shared = _derivatives(rig, points, state, loose)
    for _ in range(200):
        matrix, gradient = _normal(own, shared, state, loose, stiffness_sd)
        # A parameter at a bound that wants to leave through it is held in this step.
        at_low = (state.q <= bounds[:, 0]) & loose
        at_high = (state.q >= bounds[:, 1]) & loose
        full = np.zeros(4)
        full[loose] = _reduced(own, shared, state, matrix, gradient)[1]
        held = (at_low & (full > 0.0)) | (at_high & (full < 0.0))
        active = ~held[loose]
        step_q, step_u = _step(own, shared, state, matrix, gradient, active, damping)
        moved = state.q.copy()
        moved[loose] += step_q
        moved = np.clip(moved, bounds[:, 0], bounds[:, 1])
        reach = np.clip(step_u, [-0.5, -0.2], [0.5, 0.2])
        trial = _evaluate(rig, points, moved, state.u + reach, stiffness_sd)
        gain = state.squares - trial.squares
        if np.isfinite(trial.squares) and gain >= -1e-12 * state.squares:
            state, damping = trial, max(damping * 0.1, 1e-12)
            own, shared = _derivatives(rig, points, state, loose)
            if 0.0 <= gain < 1e-8 and np.abs(reach).max() < 1e-3:
                settled = True
                break
        else:
            damping = max(damping, 1e-8) * 10.0
            if damping > 1e14:
                settled = True  # no step gains anything any more
                break
    if not settled:
        raise Unsolved("cohesion and friction angle: the search did not converge in 200 steps")
    matrix, gradient = _normal(own, shared, state, loose, stiffness_sd)
    reduced, slope, *_ = _reduced(own, shared, state, matrix, gradient)
    covariance = np.zeros((4, 4))
    if loose.any():
        inverse = np.linalg.pinv(reduced, hermitian=True)
        covariance[np.ix_(loose, loose)] = inverse
        inside = (state.q > bounds[:, 0]) & (state.q < bounds[:, 1])
        wanted = np.abs(slope * np.sqrt(np.diag(inverse)))[inside[loose]]
        if wanted.size and wanted.max() > 1e-2:  # in sd: what a further step would still move
            raise Unsolved("cohesion and friction angle: the search ended where the sum of squares still falls")
    degrees = 2 * points.load.size - int(loose.sum()) + int(stiffness_sd > 0.0 and bool(loose[3]))
    return Fit(state.q, np.exp(state.u[:, 0]), state.u[:, 1], state.squares, degrees, covariance, loose)


def _reduced(
    own: Array, shared: Array, state: _State, matrix: Array, gradient: Array, damping: float = 0.0
) -> tuple[Array, Array, Array, Array, Array]:
    """Normal matrix and gradient of the shared parameters after the points' own are eliminated.

    Behind them what the elimination took, of each point: (A^T A + damping diag)^-1, A^T of the shared, A^T residuals.
    """
    square = np.einsum("nia,nib->nab", own, own)
    diagonal = np.einsum("naa->na", square)
    inverse = np.linalg.inv(square + damping * diagonal[:, :, None] * np.eye(2))
    cross = np.einsum("nia,nib->nab", own, shared)
    local = np.einsum("nia,ni->na", own, state.residuals)
    lifted = np.einsum("nab,nbc->nac", inverse, cross)
    reduced = matrix + damping * np.diag(np.diag(matrix)) - np.einsum("nab,nac->bc", cross, lifted)
    return reduced, gradient - np.einsum("nac,na->c", lifted, local), inverse, cross, local


def _step(
    own: Array, shared: Array, state: _State, matrix: Array, gradient: Array, active: Mask, damping: float
) -> tuple[Array, Array]:
    """Marquardt's step of the shared parameters and of the points' own."""
    reduced, slope, inverse, cross, local = _reduced(own, shared, state, matrix, gradient, damping)
    step = np.zeros(gradient.size)
    if active.any():
        some = reduced[np.ix_(active, active)]
        # A parameter that nothing depends on here (no friction without normal stress) is left where it is.
        diagonal = np.diag(some)
        scale = np.sqrt(np.where(diagonal > 1e-12 * np.diag(matrix)[active], diagonal, np.inf))
        step[active] = -np.linalg.lstsq(some / np.outer(scale, scale), slope[active] / scale, rcond=1e-14)[0] / scale
    rest = local + np.einsum("nab,b->na", cross, step)
    return step, -np.einsum("nab,nb->na", inverse, rest)
