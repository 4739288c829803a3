"""What the ground does to a shell at load equilibrium, by the plant's slip: the values that tables of grip.h hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics import contact
from terrapin_hil.physics.contact import FIELDS, ContactError, Rows, Shape

__all__ = ["VALUES", "Fields", "exact", "grid"]

VALUES = ("thrust", "compaction", "lever", "sinkage")
Fields = Callable[[Rows], Mapping[str, Rows]]  # hil_contact_point by its names at slips of the integrals


def grid(shape: Shape, fields: Fields, radius: float, loads: Array, slips: Array) -> Array:
    """(loads, slips, VALUES, 2): values [N, N, N m, m] and their derivatives by the plant's slip.

    ContactError where no sinkage carries a load [N].
    """
    load, slip = (a.ravel() for a in np.meshgrid(loads, slips, indexing="ij"))
    values, by = exact(shape, fields, radius, load, slip)
    # A locked shell shears without end: its slope is that of one that hardly turns
    by[slip <= -1.0] = exact(shape, fields, radius, load, np.maximum(slip, -0.999))[1][slip <= -1.0]
    return np.stack([values, by], axis=-1).reshape(len(loads), len(slips), len(VALUES), 2)


def exact(shape: Shape, fields: Fields, radius: float, load: Array, slip: Array) -> tuple[Array, Array]:
    """VALUES (points, 4) and their derivatives by the plant's slip. ContactError where no sinkage carries a load."""
    share = np.maximum(1.0 + np.minimum(slip, 0.0), 1e-9)  # slip and R omega / v - 1 agree when driving only
    inner = np.where(slip < 0.0, np.minimum(slip, 0.0) / share, slip)
    packed = contact.points(fields(inner), len(load))
    entry, value, slopes, status = contact.equilibrium(shape, False, packed, load, None, derivatives=True)
    assert slopes is not None
    if status.any():
        at = int(np.flatnonzero(status)[0])
        one = fields(float(np.clip(slip[at], -1.0, 1.0)))
        contact.contact(shape, False, dict(one), False, load=load[at])  # says why
        raise ContactError(f"load: found {load[at]:.6g} N at slip {slip[at]:.3g}: no sinkage carries it")
    bare = packed.copy()
    bare[:, FIELDS.index("cohesion")] = bare[:, FIELDS.index("friction_angle")] = 0.0
    pressed, by_pressed = contact.evaluate(shape, False, bare, entry, derivatives=True)
    assert by_pressed is not None
    inward = np.where(slip < 0.0, 1.0 / share**2, 1.0)
    follow = -slopes[:, 0, 1] / slopes[:, 0, 0]  # of the entry angle, the load held
    total = (slopes[:, :, 1] + slopes[:, :, 0] * follow[:, None]) * inward[:, None]
    compaction, compaction_by = -pressed[:, 1], -(by_pressed[:, 1, 1] + by_pressed[:, 1, 0] * follow) * inward
    thrust, thrust_by = value[:, 1] + compaction, total[:, 1] + compaction_by
    depth, depth_by = 2.0 * radius * np.sin(0.5 * entry) ** 2, radius * np.sin(entry) * follow * inward
    values = np.stack([thrust, compaction, value[:, 2] - radius * thrust, depth], axis=1)
    by = np.stack([thrust_by, compaction_by, total[:, 2] - radius * thrust_by, depth_by], axis=1)
    return values, by
