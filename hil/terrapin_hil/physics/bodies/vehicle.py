"""A car on soft soil, driven by the torque of its rear half shafts (vehicle.h; Vella et al.)."""

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.bodies import Body, Drive
from terrapin_hil.physics.compiled import ffi, library, pointer
from terrapin_hil.physics.program import FIRST
from terrapin_hil.physics.signals import derivative, integral

WHEELS = {"omega_fl": 1, "omega_fr": 1, "omega_rl": 2, "omega_rr": 2}  # columns of the record: left and right are equal
STRUCTS = (0, 10, 15)  # parameters before those of hil_vehicle, hil_tyre and hil_tyre_soil


def _integrate(drive: Drive) -> tuple[dict[str, Array], dict[str, Array]]:
    f, lib, time = ffi(), library(), drive.time
    period = float(time[-1] - time[0]) / max(len(time) - 1, 1)  # the samples are evenly spaced
    substeps = max(1, int(np.ceil(period / drive.body.longest_step - 1e-9)))
    torque = np.ascontiguousarray(drive.columns["drive_torque"], dtype=np.float64)
    stacked, slots = drive.inputs("drive_torque")
    numbers = f.new("int[]", slots or [0])
    record = np.full((len(time), 9), np.nan)
    table = pointer(drive.table)
    effects = f.NULL
    if drive.effects.count:
        given = (drive.effects, len(drive.table), table, len(slots), numbers, pointer(stacked))
        effects = f.new("hil_vehicle_effects *", given)
    vehicle, tyre, soil = (table + FIRST + skip for skip in STRUCTS)
    status = lib.hil_vehicle_run(
        f.cast("hil_vehicle *", vehicle),
        f.cast("hil_tyre *", tyre),
        f.cast("hil_tyre_soil *", soil),
        len(time),
        period,
        substeps,
        pointer(torque),
        drive.start,
        effects,
        pointer(record),
        f.NULL,
        f.new("hil_vehicle_failure *"),
    )
    if status != lib.HIL_TYRE_OK:
        record[:] = np.nan
    speed, rear = record[:, 0], record[:, 2]
    motion = {
        "omega": rear,
        "angle": integral(time, rear),
        "acceleration": derivative(time, rear),
        "speed": speed,
        "omega_front": record[:, 1],
        "load": np.full(len(time), drive.value("mass") * drive.value("gravity")),
        "slip": 1.0 - speed / np.maximum(rear * drive.value("tyre_radius"), 0.3),
        "sinkage": record[:, 7],
    }
    return motion, {name: record[:, column] for name, column in WHEELS.items()} | {"speed": speed}


BODY = Body(
    name="vehicle",
    parameters={
        "mass": ("kg", 1797.0),
        "gravity": ("m/s^2", 9.81),
        "drag": ("N s^2/m^2", 0.55),
        "front_distance": ("m", 1.10),
        "rear_distance": ("m", 1.47),
        "height": ("m", 0.65),
        "wheel_inertia": ("kg m^2", 1.2),
        "relaxation_length": ("m", 0.30),
        "speed_floor": ("m/s", 0.3),
        "load_floor": ("N", 300.0),
        "tyre_radius": ("m", 0.35565),
        "tyre_width": ("m", 0.235),
        "tyre_stiffness": ("N/m", 180e3),
        "tyre_angle_share": ("1", 0.30),
        "tyre_angle_slip": ("1", 0.10),
        "k_s": ("Pa/m^n", None),
        "n": ("1", None),
        "cohesion": ("Pa", None),
        "friction_angle": ("rad", None),
        "shear_modulus": ("m", None),
    },
    inputs=("drive_torque",),
    channels={**dict.fromkeys(WHEELS, "rad/s"), "speed": "m/s"},
    integrate=_integrate,
    longest_step=2.5e-3,
    aliases={"radius": "tyre_radius"},
    encoder=tuple(WHEELS),
)
