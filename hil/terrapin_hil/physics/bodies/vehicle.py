"""A car on soft soil, driven by the torque of its rear half shafts (vehicle.h; Vella et al.)."""

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.bodies import Body, Drive, wheel_slip
from terrapin_hil.physics.compiled import ffi, library, pointer
from terrapin_hil.physics.signals import derivative, integral

WHEELS = {"omega_fl": 1, "omega_fr": 1, "omega_rl": 2, "omega_rr": 2}  # columns of the record: left and right are equal


def _follow(drive: Drive) -> tuple[Array, Array]:
    f, lib, time = ffi(), library(), np.ascontiguousarray(drive.time, dtype=np.float64)
    torque = np.ascontiguousarray(drive.columns["drive_torque"], dtype=np.float64)
    stacked, slots = drive.inputs("drive_torque")
    numbers = f.new("int[]", slots or [0])
    record = np.full((len(time), lib.HIL_VEHICLE_RECORD), np.nan)
    change, shapes = drive.changes(record.shape[1])
    given = (drive.effects, drive.tables.shape[1], pointer(drive.tables), len(slots), numbers, pointer(stacked))
    effects = f.new("hil_vehicle_effects *", given)
    common = (len(time), pointer(time), pointer(torque), drive.start, len(change), shapes)
    if lib.hil_vehicle_follow(effects, *common, pointer(record), pointer(change)) != lib.HIL_TYRE_OK:
        record[:] = np.nan
    return record, change


def _motion(drive: Drive, table: Array, record: Array) -> dict[str, Array]:
    def value(name: str) -> float:
        return float(table[drive.slots[name]])

    time, speed, rear = drive.time, record[:, 0], record[:, 2]
    return {
        "omega": rear,
        "angle": integral(time, rear),
        "acceleration": derivative(time, rear),
        "speed": speed,
        "omega_front": record[:, 1],
        "load": np.full(len(time), value("mass") * value("gravity")),
        "slip": wheel_slip(speed, rear, value("tyre_radius")),
        "sinkage": record[:, 7],
    }


def _read(drive: Drive, table: Array, record: Array) -> dict[str, Array]:
    return {name: record[:, column] for name, column in WHEELS.items()} | {"speed": record[:, 0]}


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
    follow=_follow,
    motion=_motion,
    read=_read,
    aliases={"radius": "tyre_radius"},
    encoder=tuple(WHEELS),
)
