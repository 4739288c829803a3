"""A flexible tyre on soft soil (Vella et al. 2024, section 2), over arrays of operating points, with derivatives.

The equations stand in tyre.h. The paper prints none of the contact's formulas and no tyre data: these are assumed.

>>> from terrapin_hil.physics.soils import library
>>> contact = solve(Tyre(), library()["sand_vella"].footing(0.235), load=[4407.1425], slip=[0.2])
>>> f"{contact.sinkage[0]:.7f} {contact.force[0]:.2f} {contact.torque[0]:.3f}"
'0.0989241 1202.32 725.274'
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array
from terrapin_hil.physics.compiled import ffi, library, pointer
from terrapin_hil.physics.soils import Footing

__all__ = ["INPUTS", "OUTPUTS", "Contact", "ContactError", "Tyre", "check_footing", "evaluate", "solve"]


OUTPUTS = ("force", "load", "torque", "sinkage")
INPUTS = ("sinkage", "load", "slip", "stiffness", "exponent", "cohesion", "friction_angle", "shear_modulus")


class ContactError(ValueError):
    """No contact exists for what was asked, or none was found. `str()` names quantity, value and allowed range."""


@dataclass(frozen=True)
class Tyre:
    """A tyre; the default is the 215/65 R17 of the paper, with stiffness and theta_m assumed. SI units."""

    radius: float = 0.35565
    width: float = 0.235
    stiffness: float = 180e3  # [N/m], vertical
    angle_share: float = 0.30  # theta_m / theta_f = angle_share + angle_slip |slip|, at most 0.95
    angle_slip: float = 0.10

    def __post_init__(self) -> None:
        for name in ("radius", "width", "stiffness", "angle_share"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ContactError(f"tyre {name}: found {value:g}, expected more than 0")
        if not (np.isfinite(self.angle_slip) and self.angle_slip >= 0.0):
            raise ContactError(f"tyre angle_slip: found {self.angle_slip:g}, expected at least 0")

    def native(self) -> Any:
        """hil_tyre *"""
        return ffi().new("hil_tyre *", list(astuple(self)))


@dataclass(frozen=True)
class Contact:
    """Contact of each point; arrays (points,). derivative: (points, OUTPUTS, INPUTS), None unless asked for.

    `load` as an input is the wheel's load by which the tyre deflects; as an output it is what the soil carries. At
    equilibrium both are one, sinkage is no input (its column is 0), and the other columns hold it in equilibrium.
    """

    sinkage: Array  # [m]
    force: Array  # F_x [N]
    load: Array  # F_z [N]
    torque: Array  # M_y [N m]
    circle_radius: Array  # R* [m]
    entry_angle: Array  # th_f [rad]
    effective_radius: Array  # R_e [m]
    derivative: Array | None


def check_footing(footing: Footing) -> Array:
    """The footing as an array (points or 1, 5). ContactError names a value out of range."""
    parts = np.broadcast_arrays(*(np.atleast_1d(np.asarray(part, dtype=np.float64)) for part in footing))
    soil = np.ascontiguousarray(np.stack(parts, axis=1))
    ranges = {
        "stiffness": (0.0, np.inf, "Pa/m^n"),
        "exponent": (0.0, 3.0, ""),
        "cohesion": (-1e-300, np.inf, "Pa"),
        "friction_angle": (-1e-300, 1.5, "rad"),
        "shear_modulus": (0.0, np.inf, "m"),
    }
    for column, (name, (low, high, unit)) in enumerate(ranges.items()):
        values = soil[:, column]
        _range(f"soil {name}", values, low, high, unit)
    return soil


def solve(
    tyre: Tyre,
    footing: Footing,
    load: npt.ArrayLike,
    slip: npt.ArrayLike,
    derivatives: bool = False,
    start: npt.ArrayLike = 0.05,
) -> Contact:
    """Contacts that carry the loads [N] within 1e-9, at slips in [-1, 1], searched from the sinkage `start` [m].

    ContactError where no sinkage carries a load, or a value is out of range.
    """
    return _points(tyre, footing, load, slip, start, derivatives, solving=True)


def evaluate(
    tyre: Tyre,
    footing: Footing,
    load: npt.ArrayLike,
    slip: npt.ArrayLike,
    sinkage: npt.ArrayLike,
    derivatives: bool = False,
) -> Contact:
    """Contacts at given sinkages [m]; the loads [N] only deflect the tyre. ContactError for a value out of range."""
    return _points(tyre, footing, load, slip, sinkage, derivatives, solving=False)


def _points(
    tyre: Tyre,
    footing: Footing,
    load: npt.ArrayLike,
    slip: npt.ArrayLike,
    sinkage: npt.ArrayLike,
    derivatives: bool,
    solving: bool,
) -> Contact:
    soil = check_footing(footing)
    shape = np.broadcast_shapes((soil.shape[0],), *(np.atleast_1d(np.asarray(a)).shape for a in (load, slip, sinkage)))
    if len(shape) != 1:
        raise ContactError(f"load, slip, sinkage: found shape {shape}, expected one dimension")
    w, s, z = (np.array(np.broadcast_to(np.asarray(a, dtype=np.float64), shape)) for a in (load, slip, sinkage))
    _range("load", w, 0.0, tyre.stiffness * tyre.radius, "N")  # flattened to the axle
    _range("slip", s, -1.0 - 1e-15, 1.0 + 1e-15, "")
    native = tyre.native()
    deepest = 0.5 * (tyre.radius + np.sqrt(tyre.radius * (tyre.radius + 4.0 * w / tyre.stiffness)))
    if not solving:
        _range("sinkage", z, 0.0, float(deepest.min()), "m")
    count = shape[0]
    values, geometry = np.empty((count, 3)), np.empty((count, 3))
    raw = np.empty((count, 3, 8)) if derivatives else None
    status = ffi().new("int *")
    rows = ffi().cast("hil_tyre_soil *", soil.ctypes.data)
    stride = 0 if soil.shape[0] == 1 else 1
    arrays = [pointer(a) for a in (w, s, z, values, geometry, raw)]
    done = library().hil_tyre_points(native, rows, stride, count, int(solving), *arrays, status)
    if done < count:
        here = Footing(*soil[done * stride])
        raise _failure(status[0], tyre, here, w[done], s[done], float(deepest[done]))
    derivative = None if raw is None else _derivative(raw, tyre.stiffness, solving)
    force, carried, torque = values.T
    circle, entry, effective = geometry.T
    return Contact(z, force, carried, torque, circle, entry, effective, derivative)


def _derivative(raw: Array, stiffness: float, solving: bool) -> Array:
    """From columns at fixed sinkage and deflection to those of Contact.derivative."""
    found = np.zeros((raw.shape[0], len(OUTPUTS), len(INPUTS)))
    found[:, :3] = raw
    found[:, :3, 1] /= stiffness
    found[:, 3, 0] = 1.0
    if not solving:
        return found
    by_sinkage = found[:, :, :1].copy()
    found[:, :, 0] = 0.0
    held = -found[:, 1].copy()  # dF_z = dF_z/dz dz + ... must be the change of the load
    held[:, 1] += 1.0
    return np.asarray(found + by_sinkage * (held / by_sinkage[:, 1])[:, None, :])


def _failure(status: int, tyre: Tyre, footing: Footing, load: float, slip: float, deepest: float) -> ContactError:
    names = {getattr(library(), f"HIL_TYRE_{name}"): name for name in ("TOO_HEAVY", "NOT_CONVERGED", "BAD_INPUT")}
    if names.get(status) == "TOO_HEAVY":
        most = evaluate(tyre, footing, load, slip, 0.999999 * deepest).load[0]
        return ContactError(
            f"load: found {load:.6g} N, expected at most {most:.6g} N: this soil carries no more, "
            f"even with the tyre sunk to {deepest:.3g} m, at slip {slip:.3g}"
        )
    reason = "no sinkage found within 1e-9" if names.get(status) == "NOT_CONVERGED" else "the contact is not finite"
    return ContactError(f"load: found {load:.6g} N at slip {slip:.3g}: {reason} between 0 and {deepest:.3g} m")


def _range(name: str, values: Array, low: float, high: float, unit: str) -> None:
    """Every value strictly between the limits."""
    bad = np.flatnonzero(~((values > low) & (values < high)))
    if not bad.size:
        return
    tail = f" {unit}" if unit else ""
    if high == np.inf:
        expected = f"at least 0{tail}" if low < 0.0 else f"more than 0{tail}"
    else:
        expected = f"between {0.0 if -1e-9 < low < 0 else low:.4g} and {high:.4g}{tail}"
    where = f" (point {int(bad[0])})" if values.size > 1 else ""
    raise ContactError(f"{name}: found {values[bad[0]]:g}{tail}{where}, expected {expected}")
