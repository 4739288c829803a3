"""The file of a robot around a drive: constants from its sheet, and proposals for what the sheet leaves open.

    print(robot_text("mine", read(given)))

Each line of the file says in a comment from what its value follows, or that it is assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from terrapin_tools.errors import UserError
from terrapin_tools.sheet.figures import Figures, option
from terrapin_tools.sheet.motor import Motor, motor_of

__all__ = ["Misfit", "robot_text"]

G = 9.81  # m/s^2
SAND = 0.092  # f_o of the heaviest ground that the controller knows: what a robot has to roll on
FLOOR = 0.01  # f_o of the hard floor
GRIP = 1.4 * 0.444 / 5.0 / (18.64 * 0.08)  # s, of the cylinder: slip_kp K / R_e over its weight and radius
INTEGRAL = 2.5 / 1.4  # 1/s, its slip_ki over slip_kp
SLIP_UNITS = {"kp": "V s/rad", "ki": "V/rad"}
DRY = 0.75  # of the torque without load: the rest grows with the speed
SPARE = 1.5  # of the current that rolling on sand takes
TUMBLE = math.radians(60.0)  # swing of the inner body that the current limit allows
ERROR = 2e-3  # rad, once a turn of the drive wheel, of an ordinary encoder
SLOWEST = 0.01  # s, of the inner body against the motor: the controller knows the motor's speed over 20 ms
TRIP = 1.25  # over_current over the limit of the current, at least
HEADROOM = 1.5  # of the full scale of C_t over the limit of the current: a swing comes on top
MOST_CURRENT = 16.0  # A, limit: over_current and the full scale end at 20 A
DIVIDERS = ((47e3, 10e3), (100e3, 10e3), (200e3, 10e3))  # of the supply; the first is the shipped boards'
GAINS = (200.0, 100.0, 50.0, 40.0, 25.0, 20.0, 10.0, 5.0, 2.0, 1.0)  # of current-sense amplifiers
SHUNTS = (0.01, 0.005, 0.003)  # ohm
MOST_CODE = 0.015  # A of one code that the controller holds
REFERENCE, CODES, RAILS = 3.3, 4096, 4  # V and codes of the converter
COULOMB, VISCOUS = 0.2, 0.1  # N m and N m s/rad that the controller holds, of 1 N m full scale
MAGNETS = 0.05  # relative sd of a sheet's K_t at hand: makers of small motors hold 10 %
GEARS = 0.03  # the same of an efficiency, which is printed for the greatest load
TURNS = 1171, 65536  # counts a turn of the drive wheel that the controller holds


class Misfit(UserError):
    """The drive does not suit the robot: which figure is wrong, its value and what was expected; other `figures` of
    which another number may help; and what else would."""

    def __init__(self, name: str, value: float, expected: str, figures: tuple[str, ...], *instead: str) -> None:
        self.name, self.figures, self.instead = name, figures, instead
        self.found = f"{option(name)}: found {value:g}, {expected}"
        super().__init__(f"{self.found} {' or '.join(instead)}")


@dataclass
class _File:
    """Lines of a file, in order."""

    lines: list[str] = field(default_factory=list)

    def table(self, name: str) -> None:
        self.lines += ["", f"[{name}]"]

    def put(self, key: str, value: str, source: str) -> None:
        self.lines.append(f"{f'{key} = {value}':<40} # {source}")


def _quantity(value: float, unit: str) -> str:
    return f'"{value:.6g} {unit}"'


@dataclass(frozen=True)
class _Robot:
    """What the tables need of each other, SI."""

    sphere: bool
    radius: float
    drive_radius: float  # of a sphere R/gear
    arm: float
    masses: tuple[float, float, float]  # shell with frame, body or bob, drive
    gear: float  # of the file: motor for one turn of the drive wheel, or of the joint
    torque: float  # at the shell, of one ampere, by a gear without loss [N m/A]
    efficiency: float  # of the gear: share of that which comes through
    counts: float  # a turn of what the controller counts
    imbalance: float  # m* [kg m]
    swing: float  # S, inertia of the inner body with all that turns with it [kg m^2]
    period: float  # of the swing [s]
    inertia: float  # J of the gate: all that turns with the shell [kg m^2]

    @property
    def weight(self) -> float:
        return sum(self.masses) * G

    @property
    def driving(self) -> float:
        """Torque at the shell, of one ampere, that comes through the gear [N m/A]."""
        return self.efficiency * self.torque

    @property
    def sand(self) -> float:
        """Torque at the shell that rolling on sand takes [N m]."""
        return SAND * self.weight * self.radius


def _value(figures: Figures, name: str, default: float = 0.0) -> float:
    return float(figures.get(name, default))


def _robot(figures: Figures, motor: Motor) -> _Robot:
    sphere = figures["kind"] == "sphere"
    folded = figures["encoder_at"] == "output"  # the motor with its gear counts as one motor
    ratio = _value(figures, "gear", 1.0)
    gear = 1.0 if folded else ratio
    radius = _value(figures, "radius")
    drive_radius = radius / gear if sphere else _value(figures, "drive_radius", round(0.25 * radius, 4))
    arm = _value(figures, "arm", round((0.6 if sphere else 0.7) * radius, 4))
    for name, length in (("drive_radius", drive_radius), ("arm", arm)):
        if name in figures and length >= radius:
            raise UserError(
                f"{option(name)}: found {length:g} m, expected less than the {radius:g} m of {option('radius')}"
            )
    shell, body = _value(figures, "shell_mass"), _value(figures, "body_mass")
    drive = 0.0 if sphere else _value(figures, "drive_mass")
    shell += _value(figures, "frame_mass") if sphere else 0.0
    imbalance = arm * body + (0.0 if sphere else (radius - drive_radius) * drive)
    swing = body * arm**2 + (0.0 if sphere else drive * (radius - drive_radius) ** 2)
    joint = ratio if sphere else ratio * radius / drive_radius
    rotor = _value(figures, "rotor_inertia") * joint**2
    return _Robot(
        sphere=sphere,
        radius=radius,
        drive_radius=drive_radius,
        arm=arm,
        masses=(shell, body, drive),
        gear=gear,
        torque=joint * motor.torque_constant,
        efficiency=motor.efficiency,
        counts=_value(figures, "encoder_counts") * (1.0 if sphere else gear),
        imbalance=imbalance,
        swing=swing + rotor,
        inertia=radius**2 * (2.0 * shell + body + drive) + rotor,
        period=2.0 * math.pi * math.sqrt(swing / (imbalance * G)),
    )


def _friction(figures: Figures, motor: Motor, robot: _Robot) -> tuple[float, str, float, str]:
    """A [N m] and B [N m s/rad] at the shell, behind the gear: with them the motor takes its current without load."""
    supply = _value(figures, "supply")
    idle = robot.driving * motor.no_load_current
    speed = (supply - motor.resistance * motor.no_load_current) / robot.torque  # of the shell, without load
    words = f"no-load current {motor.no_load_current:.3g} A ({motor.no_load_current_from})"
    return (
        DRY * idle,
        f"assumed: {DRY:.0%} of the torque of the {words}; a calibration replaces it",
        (1.0 - DRY) * idle / speed,
        "assumed: the rest of it, at the speed without load",
    )


def _current(figures: Figures, motor: Motor, robot: _Robot, coulomb: float) -> tuple[float, str]:
    """Limit of the current [A]."""
    stall = _value(figures, "supply") / motor.resistance
    needed = (robot.sand + coulomb) / robot.driving
    driver = _value(figures, "driver_current", math.inf)
    bounds = [
        (0.9 * stall, "nine tenths of the stall current at the supply"),
        (driver / TRIP, f"the driver's {driver:g} A, less {TRIP - 1.0:.0%} for over_current"),
        ((robot.imbalance * G * math.sin(TUMBLE) + coulomb) / robot.driving, "more swings the inner body past 60 deg"),
        (MOST_CURRENT, "the controller's formats end there"),
    ]  # fmt: skip
    if "rated_current" in figures:
        wanted, words = _value(figures, "rated_current"), "the sheet's continuous current"
    else:
        wanted, words = 0.25 * stall, "a quarter of the stall current, as makers of small motors advise"
    if wanted < SPARE * needed:
        wanted, words = SPARE * needed, f"{SPARE:g} times what rolling on sand takes"
    bound, bound_words = min(bounds)
    limit, words = (wanted, words) if wanted <= bound else (bound, bound_words)
    if limit < needed:
        raise Misfit(
            "gear",
            _value(figures, "gear", 1.0),
            f"with which rolling on sand takes {needed:.3g} A of the {limit:.3g} A it may have ({words}), expected",
            _geared(figures),
            "a stronger motor",
            "a lighter robot",
        )
    return limit, words


def _check_stiffness(figures: Figures, motor: Motor, robot: _Robot) -> None:
    """S R / K^2 at the shell: a body that follows its motor sooner than the drive looks cannot be kept below a
    current."""
    constant = robot.swing * motor.resistance / robot.torque**2
    if constant < SLOWEST:
        raise Misfit(
            "gear",
            _value(figures, "gear", 1.0),
            f"with which the inner body follows its motor within {1e3 * constant:.2g} ms, expected {1e3 * SLOWEST:g} "
            "ms, for which the controller's current limit is made:",
            _geared(figures),
            "a heavier body on a longer arm",
        )


def _geared(figures: Figures) -> tuple[str, ...]:
    """Figures that gear the shell higher or lower. A sheet that speaks of the output of its gear has the gear in it."""
    gear = () if figures["at"] == "output" else ("gear",)
    return gear if figures["kind"] == "sphere" else (*gear, "drive_radius")


def _check_counts(figures: Figures, robot: _Robot) -> None:
    if robot.counts < TURNS[0]:
        given = _value(figures, "encoder_counts")
        geared = not robot.sphere and figures["encoder_at"] == "motor"  # the gear multiplies them
        raise Misfit(
            "encoder_counts",
            given,
            (f"which are {robot.counts:g} a turn of the drive wheel, " if geared else "")
            + f"expected {TURNS[0]} or more:",
            ("gear",) if geared else (),
            f"an encoder of {math.ceil(TURNS[0] * given / robot.counts - 1e-9)} counts",
        )


def _trip(figures: Figures, motor: Motor, limit: float) -> tuple[float, str]:
    """over_current [A]: it protects motor and driver, so a swing's current may pass the limit without tripping it."""
    driver = _value(figures, "driver_current", math.inf)
    stall = _value(figures, "supply") / motor.resistance
    stands, words = 0.5 * stall, "half of the stall current at the supply"
    if "rated_current" in figures:
        stands, words = 2.0 * _value(figures, "rated_current"), "twice the sheet's continuous current"
    if stands < TRIP * limit:
        stands, words = TRIP * limit, f"{TRIP - 1.0:.0%} above the limit"
    bound, bound_words = min((driver, "the driver's"), (1.02 * 20.0, "the controller's formats end there"))
    trip, words = (stands, words) if stands <= bound else (bound, bound_words)
    return max(_down(trip), limit * 1.05), words


def _down(value: float) -> float:
    """Two significant digits, never more than the value."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.floor(value / step + 1e-9) * step


def robot_text(title: str, figures: Figures) -> str:
    """The file. UserError where the sheet contradicts itself, Misfit where the drive does not suit the robot."""
    motor = motor_of(figures)
    robot = _robot(figures, motor)
    coulomb, coulomb_from, viscous, viscous_from = _friction(figures, motor, robot)
    limit, limit_from = _current(figures, motor, robot, coulomb)
    limit = _down(limit)
    _check_stiffness(figures, motor, robot)
    _check_counts(figures, robot)
    file = _File([f"# From a data sheet, by `terrapin robot new --from-sheet`. {title}"])
    board = str(figures.get("board", "f405_imu" if robot.sphere else "f405_h_bridge"))
    file.lines += [f'title = "{title}"', f'board = "{board}"']
    _body(file, figures, robot)
    _motor(file, figures, motor, robot)
    file.table("friction")
    file.put("coulomb", _quantity(coulomb, "N m"), coulomb_from)
    file.put("viscous", _quantity(viscous, "N m s/rad"), viscous_from)
    file.table("supply")
    file.put("voltage", _quantity(_value(figures, "supply"), "V"), "given")
    trip, trip_from = _trip(figures, motor, limit)
    voltage = min(round(0.85 * _value(figures, "supply"), 1), 32.0)
    _sensors(file, figures, robot, trip)
    _limits(file, figures, robot, [(limit, limit_from), (trip, trip_from)], voltage)
    torque = max(
        1, *(math.ceil(each - 1e-9) for each in (HEADROOM * robot.torque * limit, coulomb / COULOMB, viscous / VISCOUS))
    )
    _scales(file, robot, torque, trip, voltage, limit)
    file.table("bridge")
    file.put("off", f'"{figures["driver"]}"', "the driver")
    file.table("can")
    file.put("bit_rate", '"500 kbit/s"', "assumed")
    file.put("nodes", "1", "assumed")
    file.table("firmware")
    file.put("sd_coulomb", _quantity(min(0.3 * coulomb, 0.2 * torque), "N m"), "of coulomb, which is a guess: 30 %")
    file.put("sd_viscous", _quantity(min(0.5 * viscous, 0.1 * torque), "N m s/rad"), "of viscous: 50 %")
    lossy = robot.efficiency < 1.0
    file.put(
        "sd_torque_constant",
        f"{math.hypot(MAGNETS, GEARS if lossy else 0.0):.3f}",
        f"assumed: K_t of a sheet, {MAGNETS:.0%}{f', and its gear, {GEARS:.0%}' if lossy else ''}; measure it",
    )
    file.put("calibrate_timeout", '"30 s"', "the swing dies away slowly on a hard floor")
    start = motor.resistance * (coulomb + FLOOR / SAND * robot.sand) / robot.driving
    for name, share in (("low", 0.2), ("high", 0.6)):
        volts = start + share * (voltage - start)
        file.put(f"calibrate_{name}", _quantity(volts, "V"), f"it starts to roll on a floor at {start:.3g} V")
    gain = GRIP * motor.resistance * robot.weight * robot.radius / robot.driving
    for name, part in (("kp", 1.0), ("ki", INTEGRAL)):
        file.put(
            f"slip_{name}", _quantity(gain * part, SLIP_UNITS[name]), "the torque that the cylinder's has, over R W"
        )
    reach = motor.resistance * limit
    tolerance = max(min(0.5 * reach, 0.2 * _value(figures, "supply")), 0.02 * _value(figures, "supply"))
    file.put(
        "encoder_tolerance",
        _quantity(tolerance, "V"),
        f"at most half of the {reach:.3g} V of R_e at the current limit: a "
        f"wrong encoder then shows; K_t has to be right within {tolerance / voltage:.0%}",
    )
    return "\n".join(file.lines) + "\n"


def _body(file: _File, figures: Figures, robot: _Robot) -> None:
    shell, body, drive = robot.masses
    file.table("body")
    file.put("kind", f'"{figures["kind"]}"', "given")
    file.put("radius", _quantity(robot.radius, "m"), "given")
    if not robot.sphere:
        source = "given" if "drive_radius" in figures else "assumed: a quarter of the shell's radius"
        file.put("drive_radius", _quantity(robot.drive_radius, "m"), source)
    file.put("arm", _quantity(robot.arm, "m"), "given" if "arm" in figures else "assumed, of the shell's radius")
    if robot.sphere:
        frame = _value(figures, "frame_mass")
        file.put("shell_mass", _quantity(shell - frame, "kg"), "given")
        file.put("frame_mass", _quantity(frame, "kg"), "given")
        file.put("bob_mass", _quantity(body, "kg"), "given")
        file.put("frame_inertia", _quantity(0.25 * frame * robot.radius**2, "kg m^2"), "assumed: its mass at R/2")
        file.put("bob_inertia", _quantity(0.004 * body * robot.radius**2, "kg m^2"), "assumed: a ball of R/10")
        return
    file.put("shell_mass", _quantity(shell, "kg"), "given; its inertia is that of a thin shell")
    file.put("body_mass", _quantity(body, "kg"), "given; a point at its arm")
    file.put("drive_mass", _quantity(drive, "kg"), "given")
    inertia = 0.05 * drive * robot.drive_radius**2
    file.put(
        "drive_inertia",
        _quantity(inertia, "kg m^2"),
        "assumed: a disc of a tenth of drive_mass; the rotor comes on top",
    )


def _motor(file: _File, figures: Figures, motor: Motor, robot: _Robot) -> None:
    ratio = _value(figures, "gear", 1.0)
    folded = ratio / robot.gear
    through = f"; through the gear of {folded:g}, as the encoder is behind it" if folded != 1.0 else ""
    file.table("motor")
    file.put(
        "torque_constant", _quantity(folded * motor.torque_constant, "N m/A"), motor.torque_constant_from + through
    )
    file.put("armature_resistance", _quantity(motor.resistance, "ohm"), motor.resistance_from)
    if "inductance" in figures:
        file.put("inductance", _quantity(_value(figures, "inductance"), "H"), "the sheet's")
    if "rotor_inertia" in figures:
        rotor = _quantity(folded**2 * _value(figures, "rotor_inertia"), "kg m^2")
        file.put("rotor_inertia", rotor, "the sheet's" + through)
    file.put(
        "gear", f"{robot.gear:.8g}", "given" if folded == 1.0 else f"1: that of {folded:g} is in the torque constant"
    )
    if motor.efficiency < 1.0:
        file.put("gear_efficiency", f"{motor.efficiency:.3g}", motor.efficiency_from)


def _sensors(file: _File, figures: Figures, robot: _Robot, trip: float) -> None:
    file.table("sensors")
    for name in ("swing", "pitch"):
        file.put(name, "true", "assumed: an IMU")
    file.put("ground_speed", "false", "assumed: the trailing wheel alone")
    file.table("sensors.current")
    source = "given" if "shunt" in figures else "proposed"
    for shunt in [_value(figures, "shunt")] if "shunt" in figures else SHUNTS:
        reach = (CODES // 2 - 1) * REFERENCE / CODES / shunt  # A, with an amplification of 1
        gain = next((gain for gain in GAINS if reach / gain >= 1.02 * trip), 1.0)
        if reach / gain <= MOST_CODE * (CODES // 2 - 1):
            break
    file.put("shunt", _quantity(shunt, "ohm"), source)
    if "amplification" in figures:
        gain, source = _value(figures, "amplification"), "given"
    else:
        source = f"proposed: {reach / gain:.3g} A at the end of the converter, over_current is {trip:g} A"
    file.put("amplification", f"{gain:g}", source)
    file.table("sensors.supply")
    high = 1.25 * _value(figures, "supply")
    upper, lower = next(
        (pair for pair in DIVIDERS if (CODES - RAILS) * REFERENCE / CODES * (1.0 + pair[0] / pair[1]) >= high),
        DIVIDERS[-1],
    )
    end = REFERENCE * (1.0 + upper / lower)
    file.put("upper", _quantity(upper, "ohm"), f"proposed: {end:.3g} V at the end of the converter")
    file.put("lower", _quantity(lower, "ohm"), "proposed")
    file.table("sensors.motor_encoder")
    file.put("counts", f"{round(_value(figures, 'encoder_counts'))}", "given, a turn of the motor")
    _wheel(file, figures, robot)


def _wheel(file: _File, figures: Figures, robot: _Robot) -> None:
    radius = _value(figures, "wheel_radius")
    given = min(
        max(robot.counts, TURNS[0]), TURNS[1]
    )  # a turn, that the controller gets of the motor's encoder at most
    if "wheel_counts" in figures:
        counts, source = _value(figures, "wheel_counts"), "given"
    else:
        low, high = (
            radius * given / 0.15,
            radius * given / 0.01,
        )  # what the controller takes for a wheel of as many counts
        counts = 4096.0 if low <= 4096.0 <= high else given
        source = "proposed"
    file.table("sensors.ground_wheel")
    file.put("radius", _quantity(radius, "m"), "given" if radius != 0.03 else "assumed")
    file.put("counts", f"{round(counts)}", source)


def _limits(file: _File, figures: Figures, robot: _Robot, currents: list[tuple[float, str]], voltage: float) -> None:
    supply = _value(figures, "supply")
    file.table("limits")
    file.put("voltage", _quantity(voltage, "V"), "85 % of the supply, so that the drive keeps control when it sags")
    for name, (value, source) in zip(("current", "over_current"), currents, strict=True):
        file.put(name, _quantity(value, "A"), source)
    file.put("supply_low", _quantity(max(0.5 * supply, min(5.5, 0.9 * supply)), "V"), "half of the supply")
    file.put("supply_high", _quantity(1.25 * supply, "V"), "a quarter above the supply")
    file.put("temperature", '"110 degC"', "assumed: below the 125 degC of most windings")
    file.put("slip", "0.5", "assumed")
    if robot.sphere:
        file.put("swing", '"65 deg"', "assumed: the guard of the bob")


def _scales(file: _File, robot: _Robot, torque: int, trip: float, voltage: float, limit: float) -> None:
    file.table("full_scale")
    file.put(
        "torque",
        f'"{torque} N m"',
        f"at the shell: {robot.torque:.4g} N m/A at {limit:g} A, half as much for a swing; the friction's range",
    )
    file.put("current", f'"{max(2, 2 * math.ceil(trip / 1.02 / 2.0 - 1e-9))} A"', "over_current")
    file.put("voltage", f'"{16 if voltage <= 16.0 else 32} V"', "limits.voltage")
    file.table("estimator")
    window = min(max(round(robot.period, 2), 0.1), 3.6)
    shaken = 5.0 * robot.inertia * ERROR * robot.drive_radius / robot.radius / window**2
    gate, source = 4e-4 * torque, "0.4 permille of the full scale of C_t, as the shipped robots have it"
    if shaken > gate:
        gate, source = shaken, f"an encoder that is {1e3 * ERROR:g} mrad off once a turn shakes the estimate by as much"
    file.put("window", _quantity(window, "s"), "the swing's period, from arm and masses")
    file.put("gate", _quantity(gate, "N m"), source)
