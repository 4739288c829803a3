"""A sphere driven by a pendulum on sand that slips: Li et al. (2024), Eq. 11 with the contact of Eqs. 1 to 6."""

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.bodies import Body, Drive
from terrapin_hil.physics.bodies.pendulum_sphere import BODY as ROLLING
from terrapin_hil.physics.contact import FIELDS, ContactError, Rows
from terrapin_hil.physics.grip import grid
from terrapin_hil.physics.slipping import follow_slipping, motion_of_slipping
from terrapin_hil.physics.swinging import weight_of

SLIPS = 129  # nodes of a table: its error is some 1e-5 of the load
SOIL = ("k_s", "n", "cohesion", "friction_angle", "shear_modulus", "c1", "c2")
MASSES = ("shell_mass", "frame_mass", "bob_mass")
FLATTEST = 0.1  # cosine of the steepest slope that a table is made for
_KEPT = 10  # of the pendulum's parameters, up to the joint's friction


def _grip(drive: Drive, table: Array) -> tuple[Array, Array] | None:
    """Between the load on the steepest slope of the run and the whole weight."""
    radius, soil = float(table[drive.slots["radius"]]), [float(table[drive.slots[name]]) for name in SOIL]
    slope = np.abs(drive.columns.get("slope", table[drive.slots["slope"]])).max()
    weight = weight_of(drive, table, MASSES)
    loads = np.array([weight]) if slope == 0.0 else weight * np.linspace(max(np.cos(slope), FLATTEST), 1.0, 3)

    def fields(slip: Rows) -> dict[str, Rows]:
        return dict(zip(FIELDS, (slip, radius, 0.0, *soil, 0.0), strict=True))

    try:
        return loads, np.ascontiguousarray(grid("sphere", fields, radius, loads, np.linspace(-1.0, 1.0, SLIPS)))
    except ContactError:
        return None


def _motion(drive: Drive, table: Array, record: Array) -> dict[str, Array]:
    return motion_of_slipping(drive, table, record, MASSES)


def _channels(drive: Drive, table: Array, record: Array) -> dict[str, Array]:
    swing = record[:, 0] - record[:, 1]
    return {"torque": record[:, 9], "rolling_angle": record[:, 1], "swing_angle": swing, "speed": record[:, 5]}


BODY = Body(
    name="sphere_slip",
    parameters={
        **dict(list(ROLLING.parameters.items())[:_KEPT]),
        "smoothing": ROLLING.parameters["smoothing"],
        "k_s": ("Pa/m^n", None),
        "n": ("1", None),
        "cohesion": ("Pa", 0.0),
        "friction_angle": ("rad", None),
        "shear_modulus": ("m", None),
        "c1": ("1", 0.18),
        "c2": ("1", 0.32),
    },
    inputs=("joint_rate",),
    channels={"torque": "N m", "rolling_angle": "rad", "swing_angle": "rad", "speed": "m/s"},
    follow=follow_slipping("HIL_SLIPPING_SPHERE", _grip),
    motion=_motion,
    read=_channels,
    swings="length",
    states=(*Body.states, "swing_angle"),
    kin="pendulum_sphere",
    holds=("slope",),
    encoder=("rolling_angle",),
    tabulated=(*SOIL, *MASSES, "radius", "gravity"),
)
