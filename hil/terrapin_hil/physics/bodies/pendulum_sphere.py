"""A sphere driven by a pendulum whose joint is commanded (pendulum.h; Li et al. 2024)."""

from terrapin_hil.arrays import Array
from terrapin_hil.physics.bodies import Body, Drive
from terrapin_hil.physics.swinging import SMOOTHING, follow_swinging, motion_of_swinging


def _motion(drive: Drive, table: Array, record: Array) -> dict[str, Array]:
    masses, slip = ("shell_mass", "frame_mass", "bob_mass"), float(table[drive.slots["rolling_slip"]])
    return motion_of_swinging(drive, table, record, masses, slip)


def _channels(drive: Drive, table: Array, record: Array) -> dict[str, Array]:
    return {"torque": record[:, 6], "rolling_angle": record[:, 1], "swing_angle": record[:, 0] - record[:, 1]}


BODY = Body(
    name="pendulum_sphere",
    parameters={
        "radius": ("m", 0.220),
        "shell_mass": ("kg", 4.29),
        "frame_mass": ("kg", 2.0),
        "bob_mass": ("kg", 1.5),
        "length": ("m", 0.130),
        "shell_inertia": ("kg m^2", 2.0 / 3.0 * 4.29 * 0.22**2),
        "frame_inertia": ("kg m^2", 0.012),
        "bob_inertia": ("kg m^2", 0.001),
        "gravity": ("m/s^2", 9.81),
        "viscous": ("N m s/rad", 0.7),
        "shell_share": ("1", 1.0),
        "f_o": ("1", None),
        "rolling_slip": ("1", 0.0),
        "incline": ("rad", 0.0),
        "smoothing": SMOOTHING,
    },
    inputs=("joint_rate",),
    channels={"torque": "N m", "rolling_angle": "rad", "swing_angle": "rad"},
    follow=follow_swinging("HIL_DYNAMIC_PENDULUM"),
    motion=_motion,
    read=_channels,
    swings="length",
    states=(*Body.states, "swing_angle"),
    encoder=("rolling_angle",),
)
