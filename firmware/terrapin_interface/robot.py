"""One file a robot: body, motor, friction, sensors, limits and full scales, and the board that it rolls with.

    robot = load_robot(Path("cylinder.toml"))
    robot.plant["radius"], robot.quantity("window"), robot.ratio("torque")

The simulator takes `plant`. The controller's description takes `quantity` for defaults that follow from the robot, and
`ratio` for ranges and scales that grow with its full scales (description.py). Two values of a file that contradict each
other are refused with the places of both. Standard library only: the build reads these files.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from terrapin_interface.board import Board, can_reaches, find_board
from terrapin_interface.robot_table import RobotError, RobotTable

__all__ = [
    "DEFAULT",
    "KINDS",
    "ORIGINS",
    "ROBOTS",
    "Robot",
    "RobotError",
    "find_robot",
    "identity_of",
    "load_robot",
    "read_robot",
    "robots",
]

ROBOTS = Path(__file__).with_name("robots")  # the shipped ones
DEFAULT = "cylinder"
MASSLESS = 1e-9  # kg, of a part that the body does not have

CODES = 4096  # of the converters; 0 A in the middle
RAILS = 3  # codes at either end that are a fault
TORQUE_UNIT, CURRENT_UNIT, VOLTAGE_UNIT, SPEED_UNIT = 1.0, 2.0, 16.0, 160.0  # of ratio 1: N m, A, V, rad/s
RECORDS = 60  # of the estimator's history in one window,
SLOT = 0.01  # s: each a whole number of these apart
FAST_TICKS = 128  # ticks over which counts are kept in 16 bits
LEAST_JUMP = 200  # counts a tick
LEAST_EFFICIENCY = 0.1  # of a gear, that the controller's formats hold
FEWEST, MOST = 1171, 65536  # counts a turn of the drive wheel that the controller's formats hold


@dataclass(frozen=True)
class Robot:
    """A robot's file, SI. Torque constant and counts are those at the drive wheel (of a sphere: at the motor)."""

    name: str
    title: str
    kind: str  # of the body: a name in KINDS
    board: Board
    plant: Mapping[str, float]  # constants of hil_robot (physics/robot.h)
    supply: float  # [V]
    swing: bool  # what the controller is told by sensors
    pitch: bool
    ground_speed: bool
    current_code: float  # [A] of one code
    supply_code: float  # [V]
    shunt_code: float  # [A] of one code by shunt and amplifier, and
    divider_code: float  # [V] by the divider: what an image for a chip measures with
    counts: int  # a turn of the drive wheel, as the controller is given them:
    encoder_divider: int  # one for so many of the encoder's own
    ground_wheel_radius: float  # [m], of a wheel with as many counts a turn as the drive wheel
    wheel_radius: float  # [m], as it is,
    wheel_counts: int  # and its own counts
    limits: Mapping[str, float]
    full_scale: Mapping[str, float]  # torque [N m], current [A], voltage [V], speed [rad/s] of the drive wheel
    window: float  # [s]
    gate: float  # [N m]
    off: str
    bit_rate: float  # [bit/s]
    nodes: int
    firmware: Mapping[str, Any]  # further parameters of the controller, as they stand in the file
    table: RobotTable = field(repr=False, compare=False)

    @property
    def text(self) -> str:
        """The file."""
        return self.table.text

    @property
    def wheel_gear(self) -> float:
        """R/r, turns of the drive wheel for one of the shell."""
        return self.plant["radius"] / self.plant["drive_radius"]

    @property
    def weight(self) -> float:
        """W [N]."""
        return _mass(self.plant) * self.plant["gravity"]

    @property
    def free_speed(self) -> float:
        """Of the drive wheel at the supply's voltage, without load and friction: its bound [rad/s]."""
        return self.supply / self.plant["torque_constant"]

    @property
    def idle_speed(self) -> float:
        """Of the drive wheel at the supply's voltage, the shell turning free with the robot's friction: as a data sheet
        says the speed without load [rad/s]."""
        plant, gear = self.plant, self.wheel_gear
        eta, ampere = plant["gear_efficiency"], gear * plant["torque_constant"]  # [N m/A] at the shell
        dry = plant["coulomb"] / eta + plant["motor_coulomb"]
        viscous = plant["viscous"] / eta + plant["motor_viscous"]
        volts = self.supply - plant["armature_resistance"] / ampere * dry
        return max(0.0, gear * volts / (ampere + plant["armature_resistance"] / ampere * viscous))

    @property
    def jump(self) -> int:
        """More counts than this in one tick are no motion: half as much again as without load."""
        return max(LEAST_JUMP, math.ceil(1.5 * _counts_a_tick(self.free_speed, self.counts)))

    @property
    def record_slots(self) -> int:
        """Interval of the estimator's records in slots of 10 ms, so that a window is at most 60 of them."""
        return max(1, math.ceil(self.window / (RECORDS * SLOT) - 1e-9))

    @property
    def identity(self) -> int:
        """Of the name: which robot an image is made for."""
        return identity_of(self.name)

    def misfit(self, name: str, found: str, expected: str) -> RobotError:
        """The error to raise where a quantity is beyond what the controller's formats hold."""
        key = ORIGINS[name]
        return self.table.error(key, f"makes the controller's {name} {found}, expected {expected}")

    def refuse_second(self, parameter: str) -> None:
        """RobotError when a parameter in the table [firmware] follows from another field already."""
        if parameter in ORIGINS:
            raise self.table.contradiction(
                f"firmware.{parameter}", "a value", "none beside the one", self.table.place(ORIGINS[parameter])
            )

    def ratio(self, scale: str) -> int:
        """A full scale over that of controller.toml's numbers: torque, current, voltage, speed, records."""
        ratios = {
            "torque": round(self.full_scale["torque"] / TORQUE_UNIT),
            "current": round(self.full_scale["current"] / CURRENT_UNIT),
            "voltage": round(self.full_scale["voltage"] / VOLTAGE_UNIT),
            "speed": max(1, math.ceil(self.free_speed * 1.25 / SPEED_UNIT)),
            "records": self.record_slots,
        }
        return ratios[scale]

    def quantity(self, name: str) -> float:
        """A value that a default, limit or constant of the controller follows from, SI. KeyError for another name."""
        p = self.plant
        gear, radius = self.wheel_gear, p["radius"]
        bulk = radius**2 * _mass(p) + p["shell_inertia"]
        found: dict[str, float] = {
            **{key: p[key] for key in ("radius", "drive_radius", "torque_constant", "armature_resistance")},
            # where the controller sees it: behind the gear
            "coulomb": p["coulomb"] + p["gear_efficiency"] * p["motor_coulomb"],
            "viscous": p["viscous"] + p["gear_efficiency"] * p["motor_viscous"],
            "gear_efficiency": p["gear_efficiency"],
            "driven_efficiency": p["gear_efficiency"] * p["driven_ratio"],
            "weight": self.weight,
            "inertia": bulk + p["drive_inertia"] * gear**2,
            "inertia_shell": bulk + p["drive_inertia"] * gear,
            "inertia_swing": radius * _imbalance(p),
            "ground_wheel_radius": self.ground_wheel_radius,
            "current_scale": self.current_code,
            "supply_scale": self.supply_code,
            "window": self.window * 1e3,
            "gate": self.gate,
            "encoder_counts": self.counts,
            "encoder_jump": self.jump,
            "encoder_divider": self.encoder_divider,
            "record_interval": 10 * self.record_slots,
            "robot_identity": self.identity,
            "robot_board": self.board.number,
            "voltage_limit": self.limits["voltage"],
            "current_limit": self.limits["current"],
            "over_current": self.limits["over_current"],
            "supply_low": self.limits["supply_low"],
            "supply_high": self.limits["supply_high"],
            "temperature_high": self.limits["temperature"],
            "slip_limit": self.limits["slip"],
            "swing_limit": self.limits.get("swing", 0.0),
        }
        return found[name]


# Field of the file that a quantity mostly follows from.
ORIGINS: Mapping[str, str] = {
    "radius": "body.radius",
    "drive_radius": "motor.gear",
    "ground_wheel_radius": "sensors.ground_wheel.radius",
    "weight": "body.shell_mass",
    "inertia": "body.radius",
    "inertia_shell": "body.radius",
    "inertia_swing": "body.arm",
    "torque_constant": "motor.torque_constant",
    "armature_resistance": "motor.armature_resistance",
    "coulomb": "friction.coulomb",
    "viscous": "friction.viscous",
    "gear_efficiency": "motor.gear_efficiency",
    "driven_efficiency": "motor.driven_efficiency",
    "current_scale": "sensors.current.code",
    "supply_scale": "sensors.supply.code",
    "window": "estimator.window",
    "gate": "estimator.gate",
    "voltage_limit": "limits.voltage",
    "current_limit": "limits.current",
    "over_current": "limits.over_current",
    "supply_low": "limits.supply_low",
    "supply_high": "limits.supply_high",
    "temperature_high": "limits.temperature",
    "slip_limit": "limits.slip",
}


def _mass(plant: Mapping[str, float]) -> float:
    return plant["shell_mass"] + plant["body_mass"] + plant["drive_mass"]


def _imbalance(plant: Mapping[str, float]) -> float:
    """m* = (R - r) m_r + h m_a [kg m]."""
    return (plant["radius"] - plant["drive_radius"]) * plant["drive_mass"] + plant["arm"] * plant["body_mass"]


def _counts_a_tick(speed: float, counts: int) -> float:
    return speed / (2.0 * math.pi) * counts * 1e-3


def identity_of(name: str) -> int:
    """FNV-1a of a robot's name, its 32 bits folded to 24; never 0.

    >>> hex(identity_of("cylinder"))
    '0x1ebf42'
    """
    value = 0x811C9DC5
    for byte in name.encode():
        value = ((value ^ byte) * 0x01000193) & 0xFFFFFFFF
    return (value >> 24) ^ (value & 0xFFFFFF) or 1


def robots(folder: Path = ROBOTS) -> list[str]:
    """Names of the shipped robots."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def find_robot(name: str, folder: Path = ROBOTS, around: Iterable[Path] = ()) -> Path:
    """The file of a shipped robot, or a file: by its path, or with or without `.toml` in one of the folders `around`.
    RobotError when it is none."""
    if name in robots(folder):
        return folder / f"{name}.toml"
    try:
        for path in (Path(name), *(place / f"{name}{end}" for place in around for end in ("", ".toml"))):
            if path.is_file():
                return path
    except OSError as error:
        raise RobotError(f"{name[:60]!r}: {error.strerror}, expected the file of a robot") from None
    raise RobotError(f"{name[:60]!r}: found no such file, expected one, or a robot of {', '.join(robots(folder))}")


def load_robot(path: Path) -> Robot:
    """The robot of a file. RobotError: one line with file, line, field, what was found and what was expected."""
    return _read(RobotTable.load(path), path.stem)


def read_robot(text: str, path: Path) -> Robot:
    """The robot of a text that may be written to `path`. RobotError as `load_robot`."""
    return _read(RobotTable(text, str(path)), path.stem)


def _read(table: RobotTable, name: str) -> Robot:
    title = table.word("title")
    table.word("board")
    board = find_board(str(table.values["board"]), ROBOTS, table)
    kind = table.choice("body.kind", KINDS)
    gear = table.number("motor.gear", "1", 1e-2, 1e4)
    motor = {
        "torque_constant": table.number("motor.torque_constant", "N m/A", 0.0, 100.0, above=True),
        "armature_resistance": table.number("motor.armature_resistance", "ohm", 1e-3, 100.0),
        "resistance_slope": table.number("motor.resistance_slope", "1/K", 0.0, 0.1, 0.0),
        "coulomb": table.number("friction.coulomb", "N m", 0.0, 1000.0),
        "viscous": table.number("friction.viscous", "N m s/rad", 0.0, 1000.0),
        **_gear_losses(table),
        "gravity": table.number("body.gravity", "m/s^2", 0.1, 100.0, 9.81),
    }
    rotor = table.number("motor.rotor_inertia", "kg m^2", 0.0, 10.0, 0.0)
    body = KINDS[kind](table, gear, rotor)
    joint = kind == "sphere"  # its motor drives the shell, the cylinder's a wheel inside it
    plant = {**body, **motor, "torque_constant": motor["torque_constant"] * (1.0 if joint else gear)}
    turns = plant["radius"] / plant["drive_radius"] * (1.0 if joint else gear)  # of the motor for one of alpha
    plant["motor_coulomb"] *= turns
    plant["motor_viscous"] *= turns**2
    voltage = table.number("supply.voltage", "V", 1.0, 60.0)
    counts, divider = _encoder(table, None if joint else gear, voltage / plant["torque_constant"])
    wheel_radius = table.number("sensors.ground_wheel.radius", "m", 5e-3, 0.2)
    wheel_counts = table.whole("sensors.ground_wheel.counts", 1, 65536)
    current_code, supply_code, shunt_code, divider_code = _converters(table, board)
    robot = Robot(
        name=name,
        title=title,
        kind=kind,
        board=board,
        plant={key: plant[key] for key in PLANT},
        supply=voltage,
        swing=table.flag("sensors.swing"),
        pitch=table.flag("sensors.pitch"),
        ground_speed=table.flag("sensors.ground_speed", False),
        current_code=current_code,
        supply_code=supply_code,
        shunt_code=shunt_code,
        divider_code=divider_code,
        counts=counts,
        encoder_divider=divider,
        ground_wheel_radius=wheel_radius * counts / wheel_counts,
        wheel_radius=wheel_radius,
        wheel_counts=wheel_counts,
        limits=_limits(table),
        full_scale={
            "torque": table.number("full_scale.torque", "N m", 1.0, 100.0),
            "current": table.number("full_scale.current", "A", 2.0, 20.0),
            "voltage": table.number("full_scale.voltage", "V", 16.0, 32.0),
        },
        window=table.number("estimator.window", "s", 0.1, 3.6),
        gate=table.number("estimator.gate", "N m", 0.0, 100.0, above=True),
        off=table.choice("bridge.off", ["coast", "brake"], "coast"),
        bit_rate=table.number("can.bit_rate", "bit/s", 1e4, 1e6),
        nodes=table.whole("can.nodes", 1, 8, 1),
        firmware=table.below("firmware"),
        table=table,
    )
    inductance = table.number("motor.inductance", "H", 0.0, 1.0, 0.0)
    table.done()
    _check_body(robot)
    _check_drive(robot, inductance)
    _check_sensors(robot)
    _check_scales(robot)
    return robot


def _gear_losses(table: RobotTable) -> dict[str, float]:
    """What a gear takes of what it passes on, either way, and the friction before it, at the motor's shaft."""
    driving = table.number("motor.gear_efficiency", "1", 0.0, 1.0, 1.0, above=True)
    driven = table.number("motor.driven_efficiency", "1", 0.0, 1.0, driving, above=True)
    for key, value in (("motor.gear_efficiency", driving), ("motor.driven_efficiency", driven)):
        if value < LEAST_EFFICIENCY:
            raise table.error(
                key, f"found {value:g}, expected at least {LEAST_EFFICIENCY:g}: the drive would lock itself"
            )
    return {
        "gear_efficiency": driving,
        "driven_ratio": driven / driving,
        "motor_coulomb": table.number("friction.motor_coulomb", "N m", 0.0, 1000.0, 0.0),
        "motor_viscous": table.number("friction.motor_viscous", "N m s/rad", 0.0, 1000.0, 0.0),
    }


def _encoder(table: RobotTable, gear: float | None, free_speed: float) -> tuple[int, int]:
    """Counts a turn of the drive wheel that the controller is given, and how many of the encoder's make one of them.

    A turn that is no whole number of counts is rounded: at the fewest counts that is 0.04 % of a speed. Counts are
    divided by as little as the controller's formats allow: MOST a turn, and less than 2^15 in FAST_TICKS without load.
    """
    key = "sensors.motor_encoder.counts"
    turns = 1.0 if gear is None else gear
    exact = table.whole(key, 1, 1_000_000) * turns
    fastest = 32768 / FAST_TICKS / _counts_a_tick(free_speed, 1)  # counts a turn
    divider = max(1, math.ceil(exact / MOST), math.floor(exact / fastest) + 1)
    counts = round(exact / divider)
    if counts >= FEWEST:
        return counts, divider
    if exact < FEWEST:
        found = f"{exact:g} counts a turn"
        expected = f"{FEWEST} or more: an encoder of {math.ceil(FEWEST / turns)} counts"
        if gear is None:  # no gear multiplies a sphere's
            raise table.contradiction(key, f"{found} of the joint", expected, table.place("body.kind"))
        higher = FEWEST / exact * gear
        step = 10.0 ** (math.floor(math.log10(higher)) - 3)  # rounded up: it is typed as it stands here
        expected += f", or a gear of {math.ceil(higher / step) * step:.4g}"
        raise table.contradiction(key, f"{found} of the drive wheel", expected, table.place("motor.gear"))
    most = max(1, math.floor(exact / (FEWEST - 0.5)))  # that these counts may be divided by
    speed = 2e3 * math.pi * 32768 / FAST_TICKS * most / exact
    step = 10.0 ** (math.floor(math.log10(speed)) - 3)  # rounded down: it is typed as it stands here
    ways = ["a higher gear", "a lower supply.voltage"]
    least, largest = math.ceil(FEWEST / turns), math.ceil(fastest / turns) - 1
    if least <= largest:
        ways.append(f"an encoder of {least} to {largest} counts")
    raise table.contradiction(
        key,
        f"a drive wheel that turns at {free_speed:.4g} rad/s without load",
        f"at most {math.floor(speed / step) * step:.4g} rad/s with these counts: {', or '.join(ways)}",
        table.place("motor.gear"),
        table.place("motor.torque_constant"),
    )


def _converters(table: RobotTable, board: Board) -> tuple[float, float, float, float]:
    """What one code is [A], [V]: as the file says, and as it follows from shunt, amplifier and divider."""
    shunt = table.number("sensors.current.shunt", "ohm", 1e-4, 1.0, board.shunt)
    amplification = table.number("sensors.current.amplification", "1", 1.0, 1000.0, board.amplification)
    upper = table.number("sensors.supply.upper", "ohm", 0.0, 1e7, board.upper)
    lower = table.number("sensors.supply.lower", "ohm", 1.0, 1e7, board.lower)
    ampere = board.reference / (CODES * shunt * amplification)
    volt = board.reference * (upper + lower) / (CODES * lower)
    code = table.number("sensors.current.code", "A", 1e-6, 1.0, ampere)
    supply = table.number("sensors.supply.code", "V", 1e-6, 1.0, volt)
    own = "sensors.current.shunt" in table or "sensors.current.amplification" in table
    origin = table.place("sensors.current.shunt") if own else f"analog.shunt of board {board.name}"
    if abs(code / ampere - 1.0) > 0.02:
        raise table.contradiction(
            "sensors.current.code", f"{code:g} A", f"{ampere:.4g} A within 2 % for one code", origin
        )
    divided = "sensors.supply.upper" in table or "sensors.supply.lower" in table
    if divided and abs(supply / volt - 1.0) > 0.02:
        raise table.contradiction(
            "sensors.supply.code",
            f"{supply:g} V",
            f"{volt:.4g} V within 2 % for one code",
            table.place("sensors.supply.upper"),
        )
    return code, supply, ampere, volt


def _limits(table: RobotTable) -> dict[str, float]:
    limits = {
        "voltage": table.number("limits.voltage", "V", 0.0, 32.0, above=True),
        "current": table.number("limits.current", "A", 0.01, 20.0),
        "over_current": table.number("limits.over_current", "A", 0.01, 21.0),
        "supply_low": table.number("limits.supply_low", "V", 0.0, 60.0),
        "supply_high": table.number("limits.supply_high", "V", 1.0, 60.0),
        "temperature": table.number("limits.temperature", "degC", 20.0, 200.0),
        "slip": table.number("limits.slip", "1", 0.05, 0.9),
    }
    if "limits.swing" in table:
        limits["swing"] = table.number("limits.swing", "rad", 0.1, math.radians(85.0))
    return limits


def _check_body(robot: Robot) -> None:
    table, plant = robot.table, robot.plant
    radius = plant["radius"]
    pairs = [("drive_radius", "body.drive_radius"), ("arm", "body.arm")]
    for name, key in pairs:
        if key in table and plant[name] >= radius:
            raise table.contradiction(
                key, f"{plant[name]:g} m", f"less than {radius:g} m, inside the shell", table.place("body.radius")
            )
    bodies = [("shell", radius), ("frame", radius), ("bob", radius), ("body", radius)]
    if robot.kind == "cylinder":
        bodies.append(("drive", radius))
    for part, most in bodies:
        key, mass = f"body.{part}_inertia", f"body.{part}_mass"
        if key in table and mass in table:
            inertia = table.number(key, "kg m^2", 0.0, 1e6)
            largest = table.number(mass, "kg", 0.0, 1e6) * most**2
            if inertia > largest:
                raise table.contradiction(
                    key,
                    f"{inertia:g} kg m^2",
                    f"at most {largest:.4g} kg m^2, all its mass at the shell",
                    table.place(mass),
                    table.place("body.radius"),
                )
    swing = plant["body_inertia"] + plant["body_mass"] * plant["arm"] ** 2
    swing += plant["drive_mass"] * (radius - plant["drive_radius"]) ** 2
    period = 2.0 * math.pi * math.sqrt(swing / (_imbalance(plant) * plant["gravity"]))
    if not 0.4 * period <= robot.window <= 2.5 * period:
        raise table.contradiction(
            "estimator.window",
            f"{robot.window:g} s",
            f"{0.4 * period:.3g} to {2.5 * period:.3g} s about the {period:.3g} s of the free pendulum",
            table.place("body.arm"),
        )


def _check_drive(robot: Robot, inductance: float) -> None:
    table, limits = robot.table, robot.limits
    stall = robot.supply / robot.plant["armature_resistance"]
    ampere = robot.wheel_gear * robot.plant["torque_constant"] * robot.plant["gear_efficiency"]
    friction = robot.quantity("coulomb") / ampere
    rows: list[tuple[bool, str, str, str, str]] = [
        (limits["current"] < limits["over_current"], "limits.current", f"{limits['current']:g} A",
         f"less than {limits['over_current']:g} A", "limits.over_current"),
        (limits["supply_low"] < robot.supply, "limits.supply_low", f"{limits['supply_low']:g} V",
         f"less than {robot.supply:g} V", "supply.voltage"),
        (robot.supply < limits["supply_high"], "limits.supply_high", f"{limits['supply_high']:g} V",
         f"more than {robot.supply:g} V", "supply.voltage"),
        (limits["voltage"] <= robot.supply, "limits.voltage", f"{limits['voltage']:g} V",
         f"at most {robot.supply:g} V", "supply.voltage"),
        (friction < min(stall, limits["current"]), "friction.coulomb", f"{robot.quantity('coulomb'):g} N m",
         f"less than {min(stall, limits['current']) * ampere:.3g} N m, "
         "what the motor has", "limits.current"),
    ]  # fmt: skip
    for good, key, found, expected, other in rows:
        if not good:
            raise table.contradiction(key, found, expected, table.place(other))
    if robot.off not in robot.board.off:
        raise table.contradiction(
            "bridge.off", robot.off, " or ".join(robot.board.off), f"bridge.off of board {robot.board.name}"
        )
    if robot.bit_rate > robot.board.can:
        raise table.contradiction(
            "can.bit_rate",
            f"{robot.bit_rate:g} bit/s",
            f"at most {robot.board.can:g} bit/s",
            f"links.can of board {robot.board.name}",
        )
    if not can_reaches(robot.bit_rate):
        raise table.error(
            "can.bit_rate", f"found {robot.bit_rate:g} bit/s, expected one whose 8- to 18-fold divides 42 MHz"
        )
    if inductance > 0.0:
        ripple = robot.supply / (4.0 * robot.board.pwm * inductance)
        if ripple > limits["over_current"]:
            raise table.contradiction(
                "motor.inductance",
                f"{inductance:g} H, a ripple of {ripple:.3g} A",
                f"a ripple of at most {limits['over_current']:g} A",
                table.place("limits.over_current"),
                f"bridge.pwm of board {robot.board.name}",
            )
        constant = inductance / robot.plant["armature_resistance"]
        if constant > 5e-3:
            raise table.contradiction(
                "motor.inductance",
                f"a time constant of {constant * 1e3:.3g} ms",
                "at most 5 ms: the simulated motor has none",
                table.place("motor.armature_resistance"),
            )


def _check_sensors(robot: Robot) -> None:
    table, limits = robot.table, robot.limits
    half, whole = CODES // 2 - 1, CODES - RAILS - 1
    for limit, reach, unit, key in (
        ("over_current", half * robot.current_code, "A", "sensors.current.code"),
        ("over_current", half * robot.shunt_code, "A", "sensors.current.shunt"),
        ("supply_high", whole * robot.supply_code, "V", "sensors.supply.code"),
        ("supply_high", whole * robot.divider_code, "V", "sensors.supply.upper"),
    ):
        if reach < limits[limit] and (key in table or not key.endswith("code")):
            part = f"analog.{key.rpartition('.')[2]} of board {robot.board.name}"
            raise table.contradiction(
                f"limits.{limit}",
                f"{limits[limit]:g} {unit}",
                f"at most {reach:.4g} {unit}, where the converter ends",
                table.place(key) if key in table else part,
            )
    if "swing" in limits and not robot.swing:
        raise table.contradiction("limits.swing", "a limit", "none without a sensor", table.place("sensors.swing"))
    if not 5e-3 <= robot.ground_wheel_radius <= 0.2:
        raise table.contradiction(
            "sensors.ground_wheel.counts",
            f"{robot.wheel_counts}",
            f"{robot.wheel_radius * robot.counts / 0.2:.0f} to {robot.wheel_radius * robot.counts / 5e-3:.0f}",
            table.place("sensors.ground_wheel.radius"),
            table.place("sensors.motor_encoder.counts"),
        )


def _check_scales(robot: Robot) -> None:
    table, full, limits = robot.table, robot.full_scale, robot.limits
    for name, unit, symbol in (("torque", TORQUE_UNIT, "N m"), ("current", CURRENT_UNIT, "A"),
                               ("voltage", VOLTAGE_UNIT, "V")):  # fmt: skip
        if abs(full[name] / unit - round(full[name] / unit)) > 1e-9:
            raise table.error(
                f"full_scale.{name}", f"found {full[name]:g} {symbol}, expected a multiple of {unit:g} {symbol}"
            )
    torque = robot.wheel_gear * robot.plant["torque_constant"] * limits["current"]
    rows = (
        ("torque", torque, "N m", "limits.current"),
        ("current", limits["over_current"] / 1.02, "A", "limits.over_current"),
        ("voltage", limits["voltage"], "V", "limits.voltage"),
    )
    for name, needed, symbol, other in rows:
        if full[name] < needed * (1.0 - 1e-9):
            raise table.contradiction(
                f"full_scale.{name}",
                f"{full[name]:g} {symbol}",
                f"at least {needed:.4g} {symbol}",
                table.place(other),
            )


def _number(table: RobotTable, name: str, unit: str, low: float, high: float, default: float | None = None) -> float:
    return table.number(f"body.{name}", unit, low, high, default)


def _cylinder(table: RobotTable, gear: float, rotor: float) -> dict[str, float]:
    radius = _number(table, "radius", "m", 0.01, 0.5)
    shell = _number(table, "shell_mass", "kg", 1e-3, 500.0)
    return {
        "radius": radius,
        "drive_radius": _number(table, "drive_radius", "m", 2e-3, 0.5),
        "arm": _number(table, "arm", "m", 1e-4, 0.5),
        "shell_mass": shell,
        "body_mass": _number(table, "body_mass", "kg", 1e-3, 500.0),
        "drive_mass": _number(table, "drive_mass", "kg", 1e-3, 500.0),
        "shell_inertia": _number(table, "shell_inertia", "kg m^2", 1e-9, 100.0, shell * radius**2),
        "body_inertia": _number(table, "body_inertia", "kg m^2", 1e-9, 100.0, 1e-9),
        "drive_inertia": _number(table, "drive_inertia", "kg m^2", 1e-9, 100.0) + rotor * gear**2,
    }


def _sphere(table: RobotTable, gear: float, rotor: float) -> dict[str, float]:
    """In the cylinder's equations, whose mass matrix is the same: the rotor is a drive wheel of radius R/gear."""
    radius = _number(table, "radius", "m", 0.01, 0.5)
    shell = _number(table, "shell_mass", "kg", 1e-3, 500.0)
    if rotor <= 0.0:
        raise table.error("motor.rotor_inertia", "found 0 kg m^2, expected more than 0 in a sphere")
    return {
        "radius": radius,
        "drive_radius": radius / gear,
        "arm": _number(table, "arm", "m", 1e-4, 0.5),
        "shell_mass": shell + _number(table, "frame_mass", "kg", 0.0, 500.0),
        "body_mass": _number(table, "bob_mass", "kg", 1e-3, 500.0),
        "drive_mass": MASSLESS,
        "shell_inertia": _number(table, "shell_inertia", "kg m^2", 1e-9, 100.0, 2.0 / 3.0 * shell * radius**2),
        "body_inertia": _number(table, "frame_inertia", "kg m^2", 0.0, 100.0)
        + _number(table, "bob_inertia", "kg m^2", 0.0, 100.0),
        "drive_inertia": rotor,
    }


# Kinds of body: what a file's [body] makes of the plant's constants.
KINDS: Mapping[str, Callable[[RobotTable, float, float], dict[str, float]]] = {
    "cylinder": _cylinder,
    "sphere": _sphere,
}
PLANT = (
    *("radius", "drive_radius", "arm", "shell_mass", "body_mass", "drive_mass", "shell_inertia", "body_inertia"),
    *("drive_inertia", "gravity", "torque_constant", "armature_resistance", "resistance_slope", "coulomb", "viscous"),
    *("gear_efficiency", "driven_ratio", "motor_coulomb", "motor_viscous"),
)
