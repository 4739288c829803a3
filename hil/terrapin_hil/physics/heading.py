"""Heading and path of a sphere whose inner device is steered (heading.h): no slip, no spin about the vertical.

>>> t = np.linspace(0.0, 10.0, 101)
>>> x, y = path(0.3 * t, 2.0 * np.pi * t / 10.0)  # a whole circle of 3 m at a constant rate
>>> print(f"{np.hypot(x[-1], y[-1]):.6f} m off the start, {np.ptp(y) * np.pi:.3f} m around")
0.000000 m off the start, 3.000 m around
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array
from terrapin_hil.physics.compiled import library, pointer
from terrapin_hil.physics.tyre import ContactError

__all__ = ["path", "sideways"]


def path(travelled: npt.ArrayLike, heading: npt.ArrayLike) -> tuple[Array, Array]:
    """x and y [m] from the way travelled so far [m] and the heading [rad] at the same instants; starts at the origin.

    Between two instants the heading turns evenly with the way: exact for arcs, of second order otherwise.
    """
    way, turned = np.asarray(travelled, dtype=np.float64), np.asarray(heading, dtype=np.float64)
    if way.shape != turned.shape or way.ndim != 1:
        raise ContactError(f"path: found shapes {way.shape} and {turned.shape}, expected two equal rows")
    place = np.zeros(2)
    found = np.zeros((way.size, 2))
    advance, at = library().hil_heading_advance, pointer(place)
    steps = zip(np.diff(way).tolist(), turned[:-1].tolist(), turned[1:].tolist(), strict=True)
    for row, (step, before, after) in enumerate(steps, 1):
        advance(step, before, after, at)
        found[row] = place
    return found[:, 0], found[:, 1]


def sideways(speed: npt.ArrayLike, heading: npt.ArrayLike, times: npt.ArrayLike) -> Array:
    """Sideways acceleration v psi' [m/s^2] that the contact must hold; the model is good while it is below mu g."""
    turning = np.gradient(np.asarray(heading, dtype=np.float64), np.asarray(times, dtype=np.float64))
    return np.asarray(np.asarray(speed, dtype=np.float64) * turning)
