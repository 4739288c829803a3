"""A shipped scenario, written for the default robot, for any other: speeds, times, lengths, voltages from its file.

Speeds go with sqrt(g R), as Froude's number says; times with R over that, or with the robot's window where that grows
more; lengths with both. A setpoint in volts becomes what rolls at the scaled speed on the first ground, at most what
the robot's limit allows; in a robot with a guard of the swing it becomes a gentle speed. Volts of the supply, newtons
and constants of the table [robot] keep their ratio to the robot's. What happens when a part fails is a matter of the
controller's times: a scenario with a fault keeps its times.

Checks stay where they hold for any robot: on states, faults, words and ratios. Those with a number of the default robot
are left out. A scenario that is all about such numbers is refused, with the reason.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from terrapin_hil.messages import Interface, interface
from terrapin_hil.reading import parse_quantity
from terrapin_hil.robot.plant import TERRAINS, rolling_steady_speed
from terrapin_hil.robot.plant import Robot as Plant
from terrapin_hil.robot.sensors import kit
from terrapin_hil.robots import Robot
from terrapin_hil.scenario.suits import (
    Unsuited,
    check_encoder,
    check_gate,
    check_jump,
    check_slip,
    check_wheel_jump,
    climbing,
    over_current_first,
    settling,
    told_apart,
)

__all__ = ["scaled"]

RATIOS = {"slip"}  # of the truth, dimensionless
GENTLE = 0.25  # of sqrt(g R), for robots with a guard of the swing: as in their own scenarios
BELOW = 0.95  # of the limit of the voltage
SPINS = 0.3  # slip, for which the ground has to give nearly all of its grip
SETTLED = (
    2.0  # times that of the default robot, a swing has to die away: that one's checks wait for five time constants
)
CALIBRATION, LONGEST_CALIBRATION = 8.0, 30.0  # s, calibrate_timeout of the default robot, and at most
_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9.]*")
_SLICE = re.compile(r"\[(\d*\.?\d*):(\d*\.?\d*)\]")
_OFF = re.compile(r"- \d")
_SLIPS = re.compile(r"limiting\S* == 1|'stuck'|'extricat")
_MORE = re.compile(r"slip\S* > ([\d.]+)")
_WORD = re.compile(r"'[^']*'")
_QUANTITY = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)? (?:V|A|m/s)(?![\w/])")  # in a title
FUNCTIONS = {"max", "min", "abs", "mean", "all", "any", "last", "first", "std", "sum", "rms", "count"}


@dataclass(frozen=True)
class _Scales:
    """What of the default robot's is so many times as large in the other."""

    speed: float  # that is asked for
    rolls: float  # that it has: a robot may be slower than is asked
    time: float
    volts: float  # of the supply
    weight: float

    @property
    def length(self) -> float:
        return self.rolls * self.time


def _scales(there: Robot, here: Robot) -> _Scales:
    speed = math.sqrt(here.plant["radius"] * here.plant["gravity"] / there.plant["radius"] / there.plant["gravity"])
    length = here.plant["radius"] / there.plant["radius"]
    time = max(1.0, length / speed, here.window / there.window, SETTLED * settling(here) / settling(there))
    return _Scales(speed, speed, time, here.supply / there.supply, here.weight / there.weight)


def _rolling(robot: Robot, terrain: str, volts: float) -> float:
    """Shell speed [rad/s] at which it rolls."""
    return rolling_steady_speed(Plant(**robot.plant), TERRAINS[terrain], abs(volts))


def _voltage(volts: float, there: Robot, here: Robot, terrain: str, speed: float) -> float:
    """Rolls `here` at `speed` times the speed at which `volts` roll `there`."""
    wanted = speed * there.plant["radius"] * _rolling(there, terrain, volts)
    low, high = 0.0, BELOW * here.limits["voltage"]
    if wanted <= 0.0:  # it does not start there either
        return volts * here.limits["voltage"] / there.limits["voltage"]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if here.plant["radius"] * _rolling(here, terrain, middle) < wanted else (low, middle)
    return math.copysign(high, volts)


def _gentle(volts: float, there: Robot, here: Robot, terrain: str, speed: float) -> float:
    """The scaled speed [m/s] that `volts` give `there`, at most GENTLE of sqrt(g R)."""
    rolls = speed * there.plant["radius"] * _rolling(there, terrain, volts)
    return math.copysign(min(rolls, GENTLE * math.sqrt(here.plant["gravity"] * here.plant["radius"])), volts)


@dataclass(frozen=True)
class _Motion:
    """What an order that moves the default robot becomes."""

    control: str
    setpoint: float
    speed: float  # of the shell [rad/s]
    ratio: float  # of the speeds on the ground [1]


def _motion(
    order: Mapping[str, Any], there: Robot, here: Robot, terrain: str, slope: float, speed: float
) -> _Motion | None:
    """None for an order without a setpoint. Speeds are such as it reaches, on the slope if it can climb it."""
    if "setpoint" not in order:
        return None
    if order.get("control") == "speed":
        wanted = parse_quantity(order["setpoint"], "m/s")
        most = BELOW * climbing(here, terrain, slope, BELOW * here.limits["voltage"]) * here.plant["radius"]
        found = round(math.copysign(min(abs(wanted) * speed, most), wanted), 3)
        return _Motion("speed", found, abs(found) / here.plant["radius"], abs(found / wanted) if wanted else speed)
    volts = parse_quantity(order["setpoint"], "V")
    before = there.plant["radius"] * _rolling(there, terrain, volts)
    if "swing" in here.limits:  # whose bob a step of the voltage would throw over
        found = round(_gentle(volts, there, here, terrain, speed), 3)
        after = abs(found)
    else:
        found = round(_voltage(volts, there, here, terrain, speed), 3)
        after = here.plant["radius"] * _rolling(here, terrain, found)
    control = "speed" if "swing" in here.limits else "voltage"
    return _Motion(control, found, after / here.plant["radius"], after / before if before > 0.0 else speed)


def _general(check: str, description: Interface) -> bool:
    """It names no signal with a unit and subtracts no number: it holds for any robot."""
    units = {
        f"{message.name}.{signal.name}": signal.unit
        for message in description.messages.values()
        if message.sender == "controller"
        for signal in message.signals
    }
    named = _NAME.findall(_WORD.sub("", check))
    return not _OFF.search(check) and all(
        name in FUNCTIONS or name in RATIOS or units.get(name, "m") in ("", "1") for name in named
    )


def _later(check: str, time: float) -> str:
    """Its slices of time, `time` times as late."""

    def slower(found: re.Match[str]) -> str:
        ends = (f"{float(end) * time:.6g}" if end else "" for end in found.groups())
        return "[" + ":".join(ends) + "]"

    return _SLICE.sub(slower, check)


def _lists(table: Mapping[str, Any], name: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    for number, each in enumerate(table.get(name, ()), 1):
        yield f"{name}.{number}", each


def _calibration(table: Mapping[str, Any], here: Robot) -> float:
    """Where a calibration is asked for, what its speeds may each take [s]; else 0."""
    if all(order.get("request") != "calibrate" for order in table.get("operator", ())):
        return 0.0
    return parse_quantity(here.firmware.get("calibrate_timeout", LONGEST_CALIBRATION), "s")


def _calibration_way(here: Robot, timeout: float) -> float:
    """The longest way that a calibration takes [m]."""
    low, high, steps = (
        interface().parameter(f"calibrate_{name}").default * interface().parameter(f"calibrate_{name}").scale
        for name in ("low", "high", "steps")
    )
    slowest, fastest = (_rolling(here, "hard_floor", volts) for volts in (low, high))
    if slowest <= 0.0:
        raise Unsuited(
            here,
            f"at calibrate_low, {low:g} V, it does not roll on the hard floor; a higher one in [firmware] of its file",
        )
    return 0.5 * (slowest + fastest) * here.plant["radius"] * steps * timeout


def _fault_checks(table: Mapping[str, Any], here: Robot, motion: _Motion | None, terrain: str) -> tuple[str, bool]:
    """What the scenario's own fault makes of its checks: another that comes first, and whether it is the only one.

    Unsuited where the controller cannot tell it.
    """
    fault = str(table.get("provokes", {}).get("fault", ""))
    if motion is None or not fault:
        return "", True
    if fault == "ground_wheel":
        check_wheel_jump(here, motion.speed * here.plant["radius"])
    if fault == "motor_encoder":
        first = table["fault"][0]
        times = 2.0 if first["kind"] == "reversed" else 1.0
        if "to" in first:
            check_jump(
                here, terrain, motion.speed, parse_quantity(first["to"], "s") - parse_quantity(first["from"], "s")
            )
        else:
            check_encoder(here, terrain, motion.speed, times)
        if over_current_first(here, motion.speed, times):
            return "over_current", False
    # without a supply to divide by, the duty rises, and with it the current
    return "", fault != "supply_sensor"


def _needs_slip(checks: list[str]) -> bool:
    most = max((float(found) for check in checks for found in _MORE.findall(check)), default=0.0)
    return most > SPINS or any(_SLIPS.search(check) for check in checks)


def _check_carriage(table: Mapping[str, Any], here: Robot, motion: _Motion, by: _Scales, checks: list[str]) -> None:
    """Unsuited where the shell's speed, less the carriage's, is no slip as great as the checks ask for."""
    wanted = max((float(found) for check in checks for found in _MORE.findall(check)), default=0.0)
    factor = by.speed if "swing" in here.limits else by.rolls
    slowest = min(
        parse_quantity(point[1], "m/s") for point in table["carriage"] if parse_quantity(point[1], "m/s") > 0.0
    )
    reached = 1.0 - factor * slowest / max(motion.speed * here.plant["radius"], 1e-9)
    if reached <= wanted:
        raise Unsuited(
            here,
            f"at the {motion.speed * here.plant['radius']:.3g} m/s that its bob takes, the "
            f"carriage makes a slip of {reached:.2g}, and more than {wanted:g} is asked for",
        )


def _title(table: Mapping[str, Any], found: Mapping[str, Any], there: Robot, here: Robot) -> str:
    """The title, where it says a setpoint, a supply or a current of `there`, with that of `here`."""
    told: dict[str, str] = {}

    def take(before: float, unit: str, after: float, unit_after: str) -> None:
        told.setdefault(f"{before:.3g} {unit}", f"{after:.3g} {unit_after}")

    for where, order in _lists(table, "operator"):
        if f"{where}.setpoint" in found:
            before, after = (
                "m/s" if control == "speed" else "V" for control in (order.get("control"), found[f"{where}.control"])
            )
            take(parse_quantity(order["setpoint"], before), before, found[f"{where}.setpoint"], after)
    for where, fault in _lists(table, "fault"):
        if fault.get("kind") == "supply":
            take(parse_quantity(fault["value"], "V"), "V", found[f"{where}.value"], "V")
        if (fault.get("kind"), fault.get("channel")) == ("forced", "current"):
            codes = parse_quantity(fault["value"], "1") - kit("exact").current.zero
            take(codes * there.current_code, "A", codes * here.current_code, "A")

    def said_here(said: re.Match[str]) -> str:
        number, unit = said[0].split()
        return told.get(f"{float(number):.3g} {unit}", said[0])

    return _QUANTITY.sub(said_here, str(table.get("title", "")))


def _kept(check: str, by: _Scales) -> str:
    """A check with its times, as it is true of any robot."""
    check = _later(check, by.time)
    # saturated is a flag alone: the fit of f_o and f_s ends at its range where the speeds of two slopes lie close
    return check.replace("last(STATUS.faults) == 0", "last(STATUS.faults * (STATUS.faults != 4096)) == 0")


def scaled(table: Mapping[str, Any], there: Robot, here: Robot) -> tuple[dict[str, Any], str]:
    """The fields of a scenario of `there` that `here` has otherwise, by name (None: not at all), and a note about it.
    ValueError where it does not suit, with the reason, and for a quantity that is none: reading the file tells."""
    if "resistance" in table.get("supply", {}):
        raise ValueError(f"is for the {there.name}: how far its supply sags is a number of that robot")
    if own := sorted(table.get("firmware", {})):
        raise ValueError(f"is for the {there.name}: found {', '.join(own)} in [firmware], numbers of that robot")
    by, description = _scales(there, here), interface()
    found: dict[str, Any] = {}

    def take(where: str, value: object, unit: str, factor: float) -> None:
        found[where] = parse_quantity(value, unit) * factor

    terrains = [str(each["terrain"]) for each in table.get("path", ()) if "terrain" in each] or ["hard_floor"]
    slope = max((parse_quantity(each.get("slope", 0.0), "rad") for each in table.get("path", ())), default=0.0)
    motions = [_motion(order, there, here, terrains[0], slope, by.speed) for order in table.get("operator", ())]
    motion = next((each for each in reversed(motions) if each is not None), None)
    if motion is not None:
        by = replace(by, rolls=motion.ratio)
    if "fault" in table:
        by = replace(by, time=1.0)
    timeout = _calibration(table, here)
    if timeout:
        by = replace(by, time=max(by.time, timeout / CALIBRATION))
        found["firmware.calibrate_timeout"] = timeout
        if table.get("sensors", {}).get("kit") == "real":
            check_gate(here, kit("real").motor.misalignment)
    checks = [str(check) for check in table.get("checks", ())]
    if _needs_slip(checks):
        if "carriage" in table and motion is not None:
            _check_carriage(table, here, motion, by, checks)
        check_slip(here, terrains[-1], slope)
    first, alone = _fault_checks(table, here, motion, terrains[0])

    take("duration", table["duration"], "s", by.time)
    for (where, order), moves in zip(_lists(table, "operator"), motions, strict=True):
        take(f"{where}.at", order["at"], "s", by.time)
        if moves is not None:
            found[f"{where}.control"] = moves.control
            found[f"{where}.setpoint"] = moves.setpoint
    border = _calibration_way(here, timeout) if timeout else 0.0
    for where, segment in _lists(table, "path"):
        for name in ("from", "transition"):
            if name in segment:
                take(f"{where}.{name}", segment[name], "m", by.length)
        if border and motion is not None and "from" in segment:  # beyond the longest way that the calibration may take
            found[f"{where}.from"] += border
            found["duration"] += found[f"{where}.from"] / (motion.speed * here.plant["radius"])
    finer = here.wheel_counts / here.wheel_radius / (there.wheel_counts / there.wheel_radius)
    for where, fault in _lists(table, "fault"):
        for name in ("from", "to"):
            if name in fault:
                take(f"{where}.{name}", fault[name], "s", by.time)
        if fault.get("kind") == "supply":
            volts = parse_quantity(fault["value"], "V")
            limit = "supply_low" if volts < there.supply else "supply_high"
            found[f"{where}.value"] = volts * here.limits[limit] / there.limits[limit]
        if fault.get("kind") == "noisy" and fault.get("channel") == "wheel":
            take(f"{where}.value", fault["value"], "1", finer)
    if first:
        found["provokes"] = None
    elif "provokes" in table:
        take("provokes.at", table["provokes"]["at"], "s", by.time)
    if "voltage" in table.get("supply", {}):
        take("supply.voltage", table["supply"]["voltage"], "V", by.volts)
    for name, value in table.get("robot", {}).items():
        if name in here.plant:
            take(f"robot.{name}", value, _unit(name), here.plant[name] / there.plant[name])
    for name, unit, factor in (
        ("tow", "N", by.weight),
        ("carriage", "m/s", by.speed if "swing" in here.limits else by.rolls),
        ("profile", "degC", 1.0),
    ):
        where = "winding.profile" if name == "profile" else name
        points = table.get("winding", {}).get(name) if name == "profile" else table.get(name)
        if points:
            found[where] = [[parse_quantity(t, "s") * by.time, parse_quantity(v, unit) * factor] for t, v in points]
    short = "fault" in table and here.window > there.window  # a window may not be over at the end
    apart = motion is None or told_apart(terrains[-1], motion.speed)
    kept = [
        _kept(check, by)
        for check in checks
        if _general(check, description)
        and not (short and "GROUND." in check)
        and (alone or "STATUS.faults" not in check)
        and (apart or "GROUND.terrain" not in check)
    ]
    if first:
        kept.append("last(ACTUATE.state == 'safe') == 1")
    found["checks"] = kept
    if "title" in table:
        found["title"] = _title(table, found, there, here)
    left = len(checks) - len(kept) + bool(first)
    note = f"scaled from the {there.name} to the {here.name}: speeds x {by.speed:.3g}, times x {by.time:.3g}" + (
        f"; {left} of {len(checks)} checks have numbers of the {there.name} and are left out" if left else ""
    )
    if first:
        note += (
            f"; {first} comes before the fault that it is for: the winding is {here.plant['armature_resistance']:g} ohm"
        )
    if not apart:
        note += f"; at {motion.speed if motion else 0.0:.3g} rad/s {terrains[-1]} is not told from its neighbour"
    return found, note


def _unit(name: str) -> str:
    """Of a constant of the robot."""
    return str(Plant.__dataclass_fields__[name].metadata["unit"])
