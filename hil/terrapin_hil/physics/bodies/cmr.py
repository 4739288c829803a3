"""The cylindrical robot in pure rolling, driven by a voltage (rolling.h; Reina et al. 2006)."""

from terrapin_hil.arrays import Array
from terrapin_hil.physics.bodies import Body, Drive
from terrapin_hil.physics.swinging import SMOOTHING, follow_swinging, motion_of_swinging


def _motion(drive: Drive, table: Array, record: Array) -> dict[str, Array]:
    return motion_of_swinging(drive, table, record, ("shell_mass", "body_mass", "drive_mass"), 0.0)


def _channels(drive: Drive, table: Array, record: Array) -> dict[str, Array]:
    return {"omega": record[:, 2], "current": record[:, 6], "swing_angle": record[:, 0] - record[:, 1]}


BODY = Body(
    name="cmr",
    parameters={
        "radius": ("m", 0.080),
        "drive_radius": ("m", 0.018),
        "arm": ("m", 0.062),
        "shell_mass": ("kg", 0.3),
        "body_mass": ("kg", 0.5),
        "drive_mass": ("kg", 1.1),
        "shell_inertia": ("kg m^2", 1.92e-3),
        "body_inertia": ("kg m^2", 2.0e-4),
        "drive_inertia": ("kg m^2", 1.8e-4),
        "gravity": ("m/s^2", 9.81),
        "torque_constant": ("N m/A", 0.10),
        "armature_resistance": ("ohm", 5.0),
        "resistance_slope": ("1/K", 0.0),
        "coulomb": ("N m", 0.012),
        "viscous": ("N m s/rad", 1.0e-3),
        "gear_efficiency": ("1", 1.0),
        "driven_ratio": ("1", 1.0),
        "motor_coulomb": ("N m", 0.0),
        "motor_viscous": ("N m s/rad", 0.0),
        "f_o": ("1", None),
        "smoothing": SMOOTHING,
    },
    inputs=("voltage",),
    channels={"omega": "rad/s", "current": "A", "swing_angle": "rad"},
    follow=follow_swinging("HIL_DYNAMIC_CMR"),
    motion=_motion,
    read=_channels,
    swings="arm",
    states=(*Body.states, "swing_angle"),
    encoder=("omega",),
)
