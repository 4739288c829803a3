"""What may be changed while a robot lives, one line a change: `ground = sand`, `slope = 5deg`, `drive = 8 V`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

from terrapin_hil.errors import UserError
from terrapin_hil.reading import ReadingError, Section, parse_quantity, parse_toml
from terrapin_hil.robot.plant import TERRAINS
from terrapin_hil.run.living import Living
from terrapin_hil.scenario.faults import read_fault
from terrapin_hil.scenario.scenario import CONTROLS, LIMITS, REQUESTS

__all__ = ["CHANGES", "change"]


def _number(name: str, text: str, unit: str, low: float, high: float) -> float:
    try:
        value = parse_quantity(_plain(text), unit)
    except ValueError as error:
        raise UserError(f"{name}: {error}") from None
    if not low <= value <= high:
        raise UserError(f"{name}: found {text}, expected {low:g} to {high:g} {unit}")
    return value


def _plain(text: str) -> str:
    return text.strip().strip("\"'")


def _choice(name: str, text: str, known: Mapping[str, object]) -> str:
    if _plain(text) not in known:
        raise UserError(f"{name}: found {_plain(text)!r}, expected one of {', '.join(known)}")
    return _plain(text)


def _ground(robot: Living, text: str) -> str:
    terrain = TERRAINS[_choice("ground", text, TERRAINS)]
    path = robot.simulation.config.path
    for i in range(path.count):
        if robot.scenario.ground.contact is not None:
            raise UserError("ground: the scenario's ground is a contact model, expected one of terrains")
        path.segment[i].terrain = asdict(terrain)
    return f"ground is {_plain(text)}"


def _slope(robot: Living, text: str) -> str:
    slope = _number("slope", text, "rad", -1.2, 1.2)
    path = robot.simulation.config.path
    for i in range(path.count):
        path.segment[i].slope = slope
    return f"slope is {slope:.4g} rad"


def _supply(robot: Living, text: str) -> str:
    robot.simulation.config.supply = _number("supply", text, "V", 0.0, 60.0)
    return f"supply is {robot.simulation.config.supply:g} V"


def _tow(robot: Living, text: str) -> str:
    amount, _, lasting = text.partition(" for ")
    load = _number("tow", amount, "N", 0.0, 1e4)
    tow, now = robot.simulation.config.tow, robot.simulation.time
    points = [(now, load)]
    if lasting:
        end = now + _number("tow", lasting, "s", 1e-3, 3600.0)
        points += [(end, load), (end + 1e-3, 0.0)]
    tow.count = len(points)
    for i, (time, value) in enumerate(points):
        tow.time[i], tow.value[i] = time, value
    return f"it tows {load:g} N{f' for {_plain(lasting)}' if lasting else ''}"


def _ordered(robot: Living, request: str, control: str, setpoint: float) -> None:
    robot.simulation.order(request, control, setpoint)


def _drive(control: str) -> Callable[[Living, str], str]:
    def act(robot: Living, text: str) -> str:
        unit, limit = LIMITS[control]
        setpoint = _number(control, text, unit, -limit, limit)
        _ordered(robot, "run", control, setpoint)
        return f"the operator asks for run at {setpoint:g} {unit}"

    return act


def _request(robot: Living, text: str) -> str:
    request = _choice("request", text, REQUESTS)
    config = robot.simulation.config
    there = config.order[max(0, config.order_count - 1)]
    control = next(name for name, number in CONTROLS.items() if number == there.control)
    _ordered(robot, request, control, there.setpoint * 1e-3)
    return f"the operator asks for {request}"


def _limiter(robot: Living, text: str) -> str:
    on = _choice("limiter", text, {"on": 1, "off": 0}) == "on"
    config = robot.simulation.config
    for i in range(config.order_count):
        config.order[i].limiter = on
    return f"slip limiter {_plain(text)}"


def _fault(robot: Living, text: str) -> str:
    """`fault = none`, or a table as in a scenario: `fault = {kind = "stuck", channel = "wheel"}`, one more."""
    if _plain(text) == "none":
        robot.faults = []
        robot.simulation.set_faults(())
        return "no fault"
    line = f"fault = {text}" if text.lstrip().startswith("{") else f"fault = {{kind = '{_plain(text)}'}}"
    fault = read_fault(Section(parse_toml(line, Path("--do")), "--do", line).section("fault"))
    try:
        robot.simulation.set_faults([*robot.faults, fault])
    except ValueError as error:
        raise UserError(f"fault: {error}") from None
    robot.faults.append(fault)
    return f"fault {fault.kind}{f' of {fault.channel}' if fault.channel else ''}"


def _estop(robot: Living, text: str) -> str:
    pressed = _choice("estop", text, {"pressed": 1, "released": 0}) == "pressed"
    kept = [fault for fault in robot.faults if fault.kind != "estop_pressed"]
    table = Section({"kind": "estop_pressed"}, "--do", "")
    robot.faults = [*kept, read_fault(table)] if pressed else kept
    robot.simulation.set_faults(robot.faults)
    return f"e-stop {_plain(text)}"


def _reset(robot: Living, text: str) -> str:
    _choice("reset", text, {"now": 0})
    robot.restart()
    if robot.alive:
        return "the controller was reset"
    return (
        "the controller was reset; no image is in its flash, so the boot loader stays: expected `terrapin flash`, "
        "or reset = now again, which starts it as a probe would"
    )


CHANGES: dict[str, tuple[Callable[[Living, str], str], str]] = {
    "ground": (_ground, ", ".join(TERRAINS)),
    "slope": (_slope, "5deg"),
    "supply": (_supply, "10 V"),
    "tow": (_tow, "5 N, 5 N for 0.5 s"),
    "voltage": (_drive("voltage"), "8 V, and run"),
    "speed": (_drive("speed"), "0.3 m/s, and run"),
    "request": (_request, ", ".join(REQUESTS)),
    "limiter": (_limiter, "on, off"),
    "estop": (_estop, "pressed, released"),
    "fault": (_fault, 'none, or as in a scenario: {kind = "stuck", channel = "wheel"}'),
    "reset": (_reset, "now"),
}


def change(robot: Living, text: str) -> str:
    """Carries out one change and says what was done. UserError, one line, when it is none."""
    name, equals, value = text.partition("=")
    name = name.strip()
    if name not in CHANGES or not equals or not value.strip():
        raise UserError(f"--do {text[:80]!r}: expected NAME = VALUE with one of {', '.join(CHANGES)}")
    try:
        return CHANGES[name][0](robot, value.strip())
    except ReadingError as error:
        raise UserError(str(error)) from None
