"""A car that drives straight on soft soil: measured torque in, wheel speeds out (Vella et al. 2024, Eqs. 1-4).

The equations stand in vehicle.h. Eq. 3 is taken with the 1/2 that its print lacks (its four loads sum to 2 m g); drag,
inertias, lengths and the torque's course are not printed in the paper and assumed here.

>>> from terrapin_hil.physics.soils import library
>>> run = simulate(Vehicle(), Tyre(), library()["sand_vella"].footing(0.235), profile_torque(0))
>>> f"{run.speed[400]:.6f} m/s, {run.omega[400, 0]:.5f} and {run.omega[400, 1]:.5f} rad/s after {run.time[400]:g} s"
'8.959628 m/s, 29.86439 and 30.10314 rad/s after 4 s'
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array
from terrapin_hil.physics.compiled import ffi, library, pointer
from terrapin_hil.physics.soils import Footing
from terrapin_hil.physics.tyre import ContactError, Tyre, check_footing

__all__ = ["PERIOD", "PROFILES", "SUBSTEPS", "Run", "Vehicle", "profile_torque", "simulate"]


PERIOD = 0.01  # of the measurements [s]
SUBSTEPS = 4  # RK4 steps in it: 2.5 ms

# Torque of one rear half shaft [N m] at times [s], linear between them. Two to estimate with, one to validate.
PROFILES = (
    ((0.0, 0.1, 0.6, 2.6, 2.8, 3.0, 5.8, 6.0, 6.2, 8.01), (0, 0, 720, 740, 300, 670, 650, 300, 620, 600)),
    ((0.0, 0.1, 1.0, 3.2, 3.4, 3.6, 7.0, 8.01), (0, 0, 680, 715, 350, 660, 640, 630)),
    ((0.0, 0.1, 0.8, 2.2, 2.4, 2.6, 4.6, 4.8, 5.0, 8.01), (0, 0, 740, 755, 300, 680, 660, 300, 630, 615)),
)


@dataclass(frozen=True)
class Vehicle:
    """The car; mass and tyre are printed in the paper, the rest is assumed. SI units."""

    mass: float = 1797.0
    gravity: float = 9.81
    drag: float = 0.55  # B [N s^2/m^2]
    front_distance: float = 1.10  # front axle to the centre of gravity [m]
    rear_distance: float = 1.47
    height: float = 0.65  # of the centre of gravity [m]
    wheel_inertia: float = 1.2  # [kg m^2]
    relaxation_length: float = 0.30  # [m]
    speed_floor: float = 0.3  # [m/s], regularises the slip at standstill
    load_floor: float = 300.0  # [N], least wheel load

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            lowest = "at least 0" if name in ("drag", "height") else "more than 0"
            if not np.isfinite(value) or value < 0.0 or (value == 0.0 and lowest == "more than 0"):
                raise ContactError(f"vehicle {name}: found {value:g}, expected {lowest}")


@dataclass(frozen=True)
class Run:
    """A simulated run; arrays over time, axles in the order front, rear (left and right wheels are equal)."""

    time: Array  # (samples,) [s]
    speed: Array  # (samples,) [m/s]
    omega: Array  # (samples, 2) [rad/s]
    force: Array  # (samples, 2) F_x of one wheel [N]
    torque: Array  # (samples, 2) M_y of one wheel [N m]
    sinkage: Array  # (samples, 2) [m]
    omega_by_soil: Array | None  # (samples, 2, 5) derivatives by the five numbers of the footing


def profile_torque(profile: int, duration: float = 8.0) -> Array:
    """An assumed torque [N m], sampled at PERIOD from 0 to `duration` [s]."""
    times, torques = PROFILES[profile]
    return np.asarray(np.interp(np.arange(round(duration / PERIOD) + 1) * PERIOD, times, torques), dtype=np.float64)


def simulate(
    vehicle: Vehicle,
    tyre: Tyre,
    footing: Footing,
    torque: npt.ArrayLike,
    period: float = PERIOD,
    substeps: int = SUBSTEPS,
    sensitivities: bool = False,
) -> Run:
    """Motion of a car that drives from standstill, by RK4 with steps of period / substeps.

    At 2.5 ms wheel speeds differ from those of far shorter steps by up to 0.3 rad/s at the start (the clamp at
    standstill is first order) and by 0.02 rad/s after 2 s.

    Parameters
    ----------
    torque : (samples,), N m of one rear half shaft, linear between samples.
    period : s between samples.
    sensitivities : derivatives by the soil's parameters, too.

    Raises
    ------
    ContactError : a wheel load that no sinkage carries, a step too long for the contact; it says when and where.
    """
    driven = np.ascontiguousarray(torque, dtype=np.float64)
    if driven.ndim != 1 or driven.size < 2:
        raise ContactError(f"torque: found shape {driven.shape}, expected at least 2 samples")
    if not np.isfinite(driven).all():
        at = int(np.flatnonzero(~np.isfinite(driven))[0])
        raise ContactError(f"torque: found {driven[at]} at sample {at}, expected a finite number of N m")
    if not (np.isfinite(period) and period > 0.0):
        raise ContactError(f"period: found {period:g} s, expected more than 0 s")
    if substeps < 1:
        raise ContactError(f"substeps: found {substeps}, expected at least 1")
    soil = check_footing(footing)
    if soil.shape[0] != 1:
        raise ContactError(f"soil: found {soil.shape[0]} soils, expected 1")
    record = np.empty((driven.size, 9))
    by_soil = np.empty((driven.size, 9, 5)) if sensitivities else None
    native = ffi().new("hil_vehicle *", list(astuple(vehicle)))
    failure = ffi().new("hil_vehicle_failure *")
    status = library().hil_vehicle_run(
        native,
        tyre.native(),
        ffi().cast("hil_tyre_soil *", soil.ctypes.data),
        driven.size,
        period,
        substeps,
        pointer(driven),
        0.0,
        ffi().NULL,
        pointer(record),
        pointer(by_soil),
        failure,
    )
    if status != library().HIL_TYRE_OK:
        where = f"{('front', 'rear')[failure.axle]} wheel at {failure.time:.4g} s, slip {failure.slip:.3g}"
        if status == library().HIL_TYRE_STEP_TOO_LONG:
            raise ContactError(
                f"step: found {period / substeps:.4g} s, expected at most {failure.longest_step:.4g} s ({where})"
            )
        if status == library().HIL_TYRE_TOO_HEAVY:
            raise ContactError(
                f"load: found {failure.load:.6g} N, more than tyre or soil carries at any sinkage ({where})"
            )
        raise ContactError(f"load: found {failure.load:.6g} N, no sinkage found that carries it ({where})")
    return Run(
        time=np.arange(driven.size, dtype=np.float64) * period,
        speed=record[:, 0],
        omega=record[:, 1:3],
        force=record[:, 3:5],
        torque=record[:, 5:7],
        sinkage=record[:, 7:9],
        omega_by_soil=None if by_soil is None else by_soil[:, 1:3],
    )
