"""Sphere and wheel on soft soil over arrays of points: what sphere.py and wheel.py have in common.

The equations stand in disc.h (stress under one disc) and contact.h (sphere, wheel, load equilibrium). Here are the
calls into the compiled library, the checks of what goes in, and derivatives at equilibrium.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array
from terrapin_hil.physics.compiled import ffi, library, pointer
from terrapin_hil.physics.tyre import ContactError

__all__ = ["COLUMNS", "OUTPUTS", "THETA_MAX", "Array", "Contact", "ContactError", "Rows", "Shape"]

Rows = Array | float
Shape = Literal["sphere", "wheel"]

THETA_MAX = 1.55  # rad; beyond it the axle would be below the ground

OUTPUTS = ("vertical", "traction", "torque")
FIELDS = (
    "slip",
    "radius",
    "width",
    "stiffness",
    "exponent",
    "cohesion",
    "friction_angle",
    "shear_modulus",
    "c1",
    "c2",
    "recovery",
)
COLUMNS = ("entry", *FIELDS)  # of the derivatives

# (low, high, unit), both ends allowed; the smallest positive number where 0 is not
TINY = np.nextafter(0.0, 1.0)
RANGES: Mapping[str, tuple[float, float, str]] = {
    "load": (TINY, np.inf, "N"),
    "entry": (TINY, THETA_MAX, "rad"),
    "slip": (-1.0, 1.0, ""),
    "radius": (TINY, np.inf, "m"),
    "width": (TINY, np.inf, "m"),
    "stiffness": (TINY, np.inf, "Pa/m^n"),
    "exponent": (TINY, 3.0, ""),
    "cohesion": (0.0, np.inf, "Pa"),
    "friction_angle": (0.0, 1.5, "rad"),
    "shear_modulus": (TINY, np.inf, "m"),
    "c1": (-1.0, 2.0, ""),
    "c2": (-2.0, 2.0, ""),
    "recovery": (0.0, 0.99, ""),
}


@dataclass(frozen=True)
class Contact:
    """Contacts of points; arrays (points,).

    derivative[output] is (points, COLUMNS): at given entry angle the plain partial derivatives; at equilibrium the
    column "entry" is that by the load, all others hold the load, and the output "entry" is there too.
    """

    entry: Array  # theta_1 of the middle [rad]
    sinkage: Array  # [m]
    vertical: Array  # [N]
    traction: Array  # drawbar pull [N]
    torque: Array  # [N m]
    derivative: Mapping[str, Array] | None = None


def rows(*values: Rows) -> tuple[Array, ...]:
    """The values as arrays of one shape (rows,)."""
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, dtype=np.float64)) for v in values))
    return tuple(np.ascontiguousarray(a) for a in arrays)


def points(fields: Mapping[str, Rows], count: int) -> Array:
    """hil_contact_point of each row: (count, 11)."""
    packed = np.empty((count, len(FIELDS)))
    for column, name in enumerate(FIELDS):
        packed[:, column] = fields[name]
    return packed


def check(name: str, values: Array) -> None:
    """ContactError unless every value is finite and within its range; it names quantity, value, place and range."""
    low, high, unit = RANGES[name]
    bad = np.flatnonzero(~((values >= low) & (values <= high) & np.isfinite(values)))
    if not bad.size:
        return
    tail = f" {unit}" if unit else ""
    least = "more than 0" if low == TINY else f"at least {low:g}"
    expected = f"{least}{tail}" if high == np.inf else f"{least} and at most {high:g}{tail}"
    where = f" (point {int(bad[0])})" if values.size > 1 else ""
    raise ContactError(f"{name}: found {values[bad[0]]:g}{tail}{where}, expected {expected}")


def evaluate(
    shape: Shape, linear: bool, packed: Array, entry: Array, derivatives: bool = False
) -> tuple[Array, Array | None]:
    """Forces (count, 3) at the entry angles, and their derivatives (count, 3, 12) or None. Nothing is checked."""
    value, slopes, _ = _call(shape, linear, packed, None, entry, derivatives)
    return value, slopes


def equilibrium(
    shape: Shape, linear: bool, packed: Array, load: Array, start: Array | None, derivatives: bool = False
) -> tuple[Array, Array, Array | None, npt.NDArray[np.int32]]:
    """Entry angle, forces, derivatives at given angle, and HIL_CONTACT_... of each row. Nothing is checked.

    A load that no angle carries leaves THETA_MAX, any other failure NaN.
    """
    entry = np.zeros(len(load)) if start is None else np.array(start, dtype=np.float64)
    value, slopes, status = _call(shape, linear, packed, load, entry, derivatives)
    return entry, value, slopes, status


def _call(
    shape: Shape, linear: bool, packed: Array, load: Array | None, entry: Array, derivatives: bool
) -> tuple[Array, Array | None, npt.NDArray[np.int32]]:
    count = len(packed)
    value = np.empty((count, 3))
    slopes = np.empty((count, 3, len(COLUMNS))) if derivatives else None
    status = np.zeros(count, dtype=np.int32)
    lib = library()
    lib.hil_contact_points(
        lib.HIL_WHEEL if shape == "wheel" else lib.HIL_SPHERE,
        lib.HIL_LINEAR if linear else lib.HIL_FULL,
        count,
        ffi().cast("hil_contact_point *", packed.ctypes.data),
        pointer(load),
        pointer(entry),
        pointer(value),
        pointer(slopes),
        ffi().cast("int *", status.ctypes.data),
    )
    return value, slopes, status


def contact(
    shape: Shape,
    linear: bool,
    fields: Mapping[str, Rows],
    derivatives: bool,
    *,
    load: Rows | None = None,
    entry: Rows | None = None,
    start: Rows | None = None,
) -> Contact:
    """Contacts that carry the loads, or at the entry angles. ContactError where there is none or a value is wrong."""
    given = {name: np.asarray(value, dtype=np.float64) for name, value in fields.items()}
    goal = np.asarray(entry if load is None else load, dtype=np.float64)
    hint = np.asarray(0.0 if start is None else start, dtype=np.float64)
    shapes = np.broadcast_shapes((1,), goal.shape, hint.shape, *(value.shape for value in given.values()))
    if len(shapes) != 1:
        raise ContactError(f"points: found shape {shapes}, expected one dimension")
    for name, value in given.items():
        if name != "width" or shape == "wheel":
            check(name, np.atleast_1d(value))
    check("entry" if load is None else "load", np.atleast_1d(goal))
    count = shapes[0]
    packed = points(given, count)
    goal = np.array(np.broadcast_to(goal, count))
    if load is None:
        found = goal
        value, slopes = evaluate(shape, linear, packed, found, derivatives)
    else:
        found, value, slopes, status = equilibrium(
            shape, linear, packed, goal, np.broadcast_to(hint, count), derivatives
        )
        if status.any():
            raise _failure(shape, linear, packed, goal, int(np.flatnonzero(status)[0]), status)
    if not np.isfinite(value).all():
        at = int(np.flatnonzero(~np.isfinite(value).all(axis=1))[0])
        raise ContactError(f"forces: found {value[at]} at point {at}, expected finite numbers")
    radius = packed[:, FIELDS.index("radius")]
    by = None if slopes is None else _derivative(slopes, load is not None)
    vertical, traction, torque = (column.copy() for column in value.T)
    return Contact(found, 2.0 * radius * np.sin(0.5 * found) ** 2, vertical, traction, torque, by)


def _derivative(slopes: Array, balanced: bool) -> Mapping[str, Array]:
    named = {name: slopes[:, i] for i, name in enumerate(OUTPUTS)}
    if not balanced:
        return named
    rise = named["vertical"][:, :1]
    follow = -named["vertical"] / rise  # of the entry angle, the load held
    follow[:, 0] = 1.0 / rise[:, 0]
    found = {"entry": follow}
    for name in ("traction", "torque"):
        along = named[name][:, :1]
        found[name] = named[name] + along * follow
        found[name][:, 0] = along[:, 0] * follow[:, 0]
    found["vertical"] = np.zeros_like(follow)
    found["vertical"][:, 0] = 1.0
    return found


def _failure(
    shape: Shape, linear: bool, packed: Array, load: Array, at: int, status: npt.NDArray[np.int32]
) -> ContactError:
    where = f" (point {at})" if len(load) > 1 else ""
    slip = packed[at, FIELDS.index("slip")]
    if status[at] == library().HIL_CONTACT_TOO_HEAVY:
        most = evaluate(shape, linear, packed[at : at + 1], np.array([THETA_MAX]))[0][0, 0]
        return ContactError(
            f"load: found {load[at]:.6g} N{where}, expected at most {most:.6g} N: this soil carries no more, even with "
            f"the {shape} sunk to its axle, at slip {slip:.3g}"
        )
    return ContactError(f"load: found {load[at]:.6g} N{where} at slip {slip:.3g}: no entry angle found within 1e-9")
