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
from terrapin_hil.robots import Robot

__all__ = ["scaled"]

RATIOS = {"slip"}  # of the truth, dimensionless
GENTLE = 0.25  # of sqrt(g R), for robots with a guard of the swing: as in their own scenarios
BELOW = 0.95  # of the limit of the voltage
_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9.]*")
_SLICE = re.compile(r"\[(\d*\.?\d*):(\d*\.?\d*)\]")
_OFF = re.compile(r"- \d")
_WORD = re.compile(r"'[^']*'")
FUNCTIONS = {"max", "min", "abs", "mean", "all", "any", "last", "first", "std", "sum", "rms", "count"}


@dataclass(frozen=True)
class _Scales:
    """What of the default robot's is so many times as large in the other."""

    speed: float
    time: float
    volts: float  # of the supply
    weight: float

    @property
    def length(self) -> float:
        return self.speed * self.time


def _scales(there: Robot, here: Robot) -> _Scales:
    speed = math.sqrt(here.plant["radius"] * here.plant["gravity"] / there.plant["radius"] / there.plant["gravity"])
    length = here.plant["radius"] / there.plant["radius"]
    time = max(1.0, length / speed, here.window / there.window)
    return _Scales(speed, time, here.supply / there.supply, here.weight / there.weight)


def _voltage(volts: float, there: Robot, here: Robot, terrain: str, speed: float) -> float:
    """Rolls `here` at `speed` times the speed at which `volts` roll `there`."""
    ground = TERRAINS[terrain]
    wanted = speed * there.plant["radius"] * rolling_steady_speed(Plant(**there.plant), ground, abs(volts))
    low, high = 0.0, BELOW * here.limits["voltage"]
    if wanted <= 0.0:  # it does not start there either
        return volts * here.limits["voltage"] / there.limits["voltage"]
    for _ in range(60):
        middle = 0.5 * (low + high)
        found = here.plant["radius"] * rolling_steady_speed(Plant(**here.plant), ground, middle)
        low, high = (middle, high) if found < wanted else (low, middle)
    return math.copysign(high, volts)


def _gentle(volts: float, there: Robot, here: Robot, terrain: str, speed: float) -> float:
    """The scaled speed [m/s] that `volts` give `there`, at most GENTLE of sqrt(g R)."""
    rolls = speed * there.plant["radius"] * rolling_steady_speed(Plant(**there.plant), TERRAINS[terrain], abs(volts))
    return math.copysign(min(rolls, GENTLE * math.sqrt(here.plant["gravity"] * here.plant["radius"])), volts)


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


def scaled(table: Mapping[str, Any], there: Robot, here: Robot) -> tuple[dict[str, Any], str]:
    """The fields of a scenario of `there` that `here` has otherwise, by name, and a note about it. ValueError for a
    quantity that is none: reading the file tells."""
    if "resistance" in table.get("supply", {}):
        raise ValueError(f"is for the {there.name}: how far its supply sags is a number of that robot")
    if own := sorted(table.get("firmware", {})):
        raise ValueError(f"is for the {there.name}: found {', '.join(own)} in [firmware], numbers of that robot")
    by, description = _scales(there, here), interface()
    if "fault" in table:
        by = replace(by, time=1.0)
    found: dict[str, Any] = {}

    def take(where: str, value: object, unit: str, factor: float) -> None:
        found[where] = parse_quantity(value, unit) * factor

    take("duration", table["duration"], "s", by.time)
    terrain = next((str(each["terrain"]) for each in table.get("path", ()) if "terrain" in each), "hard_floor")
    for where, order in _lists(table, "operator"):
        take(f"{where}.at", order["at"], "s", by.time)
        if "setpoint" in order and order.get("control") == "speed":
            take(f"{where}.setpoint", order["setpoint"], "m/s", by.speed)
        elif "setpoint" in order:
            volts = parse_quantity(order["setpoint"], "V")
            if "swing" in here.limits:  # whose bob a step of the voltage would throw over
                found[f"{where}.control"] = "speed"
                found[f"{where}.setpoint"] = round(_gentle(volts, there, here, terrain, by.speed), 3)
            else:
                found[f"{where}.setpoint"] = round(_voltage(volts, there, here, terrain, by.speed), 3)
    for where, segment in _lists(table, "path"):
        for name in ("from", "transition"):
            if name in segment:
                take(f"{where}.{name}", segment[name], "m", by.length)
    for where, fault in _lists(table, "fault"):
        for name in ("from", "to"):
            if name in fault:
                take(f"{where}.{name}", fault[name], "s", by.time)
        if fault.get("kind") == "supply":
            volts = parse_quantity(fault["value"], "V")
            limit = "supply_low" if volts < there.supply else "supply_high"
            found[f"{where}.value"] = volts * here.limits[limit] / there.limits[limit]
    if "provokes" in table:
        take("provokes.at", table["provokes"]["at"], "s", by.time)
    if "voltage" in table.get("supply", {}):
        take("supply.voltage", table["supply"]["voltage"], "V", by.volts)
    for name, value in table.get("robot", {}).items():
        if name in here.plant:
            take(f"robot.{name}", value, _unit(name), here.plant[name] / there.plant[name])
    for name, unit, factor in (("tow", "N", by.weight), ("carriage", "m/s", by.speed), ("profile", "degC", 1.0)):
        where = "winding.profile" if name == "profile" else name
        points = table.get("winding", {}).get(name) if name == "profile" else table.get(name)
        if points:
            found[where] = [[parse_quantity(t, "s") * by.time, parse_quantity(v, unit) * factor] for t, v in points]
    checks = [str(check) for check in table.get("checks", ())]
    short = "fault" in table and here.window > there.window  # a window may not be over at the end
    kept = [
        _later(check, by.time)
        for check in checks
        if _general(check, description) and not (short and "GROUND." in check)
    ]
    found["checks"] = kept
    left = len(checks) - len(kept)
    note = f"scaled from the {there.name} to the {here.name}: speeds x {by.speed:.3g}, times x {by.time:.3g}" + (
        f"; {left} of {len(checks)} checks have numbers of the {there.name} and are left out" if left else ""
    )
    return found, note


def _unit(name: str) -> str:
    """Of a constant of the robot."""
    return str(Plant.__dataclass_fields__[name].metadata["unit"])
