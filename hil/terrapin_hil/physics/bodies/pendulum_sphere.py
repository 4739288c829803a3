"""A sphere driven by a pendulum whose joint is commanded (pendulum.h; Li et al. 2024)."""

from terrapin_hil.arrays import Array
from terrapin_hil.physics.bodies import Body, Drive
from terrapin_hil.physics.swinging import SMOOTHING, integrate_swinging


def _integrate(drive: Drive) -> tuple[dict[str, Array], dict[str, Array]]:
    masses, slip = ("shell_mass", "frame_mass", "bob_mass"), drive.value("rolling_slip")
    motion, torque = integrate_swinging(drive, "HIL_DYNAMIC_PENDULUM", masses, slip)
    return motion, {"torque": torque, "rolling_angle": motion["shell_angle"], "swing_angle": motion["swing_angle"]}


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
    integrate=_integrate,
    encoder=("rolling_angle",),
)
