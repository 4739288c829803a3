"""The cylindrical robot on ground that slips, driven by a voltage (slipping.h): the simulator's own plant, smoothed."""

from terrapin_hil.arrays import Array
from terrapin_hil.physics.bodies import Body, Drive
from terrapin_hil.physics.bodies.cmr import BODY as ROLLING
from terrapin_hil.physics.slipping import follow_slipping, motion_of_slipping

MASSES = ("shell_mass", "body_mass", "drive_mass")


def _motion(drive: Drive, table: Array, record: Array) -> dict[str, Array]:
    return motion_of_slipping(drive, table, record, MASSES)


def _channels(drive: Drive, table: Array, record: Array) -> dict[str, Array]:
    swing = record[:, 0] - record[:, 1]
    return {"omega": record[:, 3], "current": record[:, 9], "swing_angle": swing, "speed": record[:, 5]}


BODY = Body(
    name="cmr_slip",
    parameters={**ROLLING.parameters, "mu": ("1", None), "s_k": ("1", None)},
    inputs=("voltage",),
    channels={"omega": "rad/s", "current": "A", "swing_angle": "rad", "speed": "m/s"},
    follow=follow_slipping("HIL_SLIPPING_CYLINDER"),
    motion=_motion,
    read=_channels,
    swings="arm",
    states=(*Body.states, "swing_angle"),
    kin="cmr",
    holds=("slope",),
    encoder=("omega",),
)
