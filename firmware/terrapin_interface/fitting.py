"""controller.toml fitted to a robot: what follows from the robot's file is put in as numbers, before it is read.

In controller.toml a `default` or `value` in quotes names a quantity of the robot (Robot.quantity). `full_scale` names
what the numbers grow with (Robot.ratio): of a parameter range and default, of a signal its scale, of a limit its
value; `most` is the largest raw number of a parameter that the core's formats hold.
"""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Iterator, Mapping
from decimal import Decimal
from typing import Any

from terrapin_interface.quantity import QuantityError, parse_quantity
from terrapin_interface.robot import DEFAULT, Robot, RobotError, find_robot, load_robot

__all__ = ["fitted", "interface_identity"]

INTERFACE = "interface_identity"  # a constant that follows from all the rest
FULLEST_BUS = 0.7  # share of the bit rate


def fitted(document: Mapping[str, Any], robot: Robot | None = None) -> dict[str, Any]:
    """The document of controller.toml for a robot (the cylinder by default), without a word about robots in it.

    RobotError when the robot does not fit the controller, or the document asks for what no robot has. A document that
    says nothing of robots stays as it is, unless a robot is given.
    """
    if robot is None and not any("full_scale" in e or isinstance(_value(e), str) for _, _, e in _entries(document)):
        return dict(document)
    cylinder = load_robot(find_robot(DEFAULT))
    found = _with_robot(document, robot or cylinder)
    if robot is not None and found.get("ceiling"):
        cylinders = _with_robot(document, cylinder)["parameter"]
        _fit_ceilings(found["ceiling"], found.get("parameter", {}), cylinders, robot)
    for _, _, entry in _entries(found):
        if _value(entry) == INTERFACE:
            entry["value"] = interface_identity(found)
    return found


def interface_identity(document: Mapping[str, Any]) -> int:
    """First 24 bits of the SHA-256 of what a host must know to read the messages; of no word that explains it."""

    def bare(table: Any) -> Any:
        if isinstance(table, dict):
            return {key: bare(value) for key, value in table.items() if key not in ("comment", "meaning")}
        return [bare(value) for value in table] if isinstance(table, list) else table

    parts = {name: bare(document.get(name, {})) for name in ("message", "enum", "parameter")}
    text = json.dumps(parts, sort_keys=True, default=str)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:3], "big")


def _with_robot(document: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    found: dict[str, Any] = copy.deepcopy(dict(document))
    for where, name, entry in list(_entries(found)):
        if _value(entry) == INTERFACE:
            continue
        _fit(where, name, entry, robot)
    _set_firmware(found.get("parameter", {}), robot)
    _name_board(found.get("enum", {}), robot)
    _check_bus(found.get("message", {}), robot)
    return found


def _entries(document: Mapping[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """(kind, name, table) of whatever may follow from a robot; what is no table is left for the reader to refuse."""
    for kind in ("parameter", "limit", "constant"):
        tables = document.get(kind)
        for name, entry in tables.items() if isinstance(tables, dict) else ():
            if isinstance(entry, dict):
                yield kind, name, entry
    messages = document.get("message")
    for message in messages.values() if isinstance(messages, dict) else ():
        signals = message.get("signals") if isinstance(message, dict) else None
        for entry in signals if isinstance(signals, list) else ():
            if isinstance(entry, dict):
                yield "signal", str(entry.get("name")), entry


def _value(entry: Mapping[str, Any]) -> Any:
    return entry.get("default", entry.get("value"))


def _fit(kind: str, name: str, entry: dict[str, Any], robot: Robot) -> None:
    try:
        ratio = robot.ratio(entry.pop("full_scale")) if "full_scale" in entry else 1
        quantity = robot.quantity(_value(entry)) if isinstance(_value(entry), str) else None
    except KeyError as error:
        raise RobotError(f"{kind} {name}: {error} is no quantity or full scale of a robot") from None
    if kind == "signal":
        if ratio != 1:
            entry["scale"] = float(Decimal(repr(entry["scale"])) * ratio)
    elif kind != "parameter":
        entry["value"] = entry["value"] * ratio if quantity is None else quantity
    else:
        most = entry.pop("most", None)
        for end in ("min", "max") if ratio != 1 else ():
            entry[end] *= ratio
            if most is not None:
                entry[end] = max(-most, min(most, entry[end]))
        if quantity is None:
            entry["default"] = entry["default"] * ratio if ratio != 1 else entry.get("default")
        else:
            entry["default"] = round(quantity / entry["scale"])
            if not entry["min"] <= entry["default"] <= entry["max"]:
                raise robot.misfit(name, f"{quantity:.6g} {entry['unit']}", _range(entry))


def _range(entry: Mapping[str, Any]) -> str:
    unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
    return f"{entry['min'] * entry['scale']:.6g} to {entry['max'] * entry['scale']:.6g}{unit}"


def _set_firmware(parameters: Mapping[str, Any], robot: Robot) -> None:
    """Puts in the defaults that the table [firmware] of a robot's file gives."""
    for name, value in robot.firmware.items():
        key = f"firmware.{name}"
        if name not in parameters:
            raise robot.table.error(key, "found no parameter of the controller of that name")
        robot.refuse_second(name)
        entry = parameters[name]
        try:
            raw = round(parse_quantity(value, entry["unit"]) / entry["scale"])
        except QuantityError as error:
            raise robot.table.error(key, str(error)) from None
        if not entry["min"] <= raw <= entry["max"]:
            raise robot.table.error(key, f"found {value!r}, expected {_range(entry)}")
        entry["default"] = raw


def _name_board(enums: Mapping[str, Any], robot: Robot) -> None:
    """Puts the robot's board among those that are known by number. RobotError when its number is another's."""
    known: dict[str, int] | None = enums.get("board", {}).get("values")
    if known is None:
        return
    name, number = robot.board.name, robot.board.number
    others = {value: word for word, value in known.items() if word != name}
    if number in others or known.get(name, number) != number:
        raise robot.table.contradiction(
            "board",
            f"{name} with the number {number}",
            "a number that is no other board's",
            f"number of {robot.board.file}" if number in others else "enum.board of controller.toml",
        )
    known[name] = number


def _fit_ceilings(
    ceilings: Mapping[str, Any], parameters: Mapping[str, Any], cylinders: Mapping[str, Any], robot: Robot
) -> None:
    """Ratings of the cylinder's parts in proportion: as far from the robot's own values as from the cylinder's.

    One that is beyond the parameter's range, which follows from the full scales, narrows nothing.
    """
    for name, ceiling in ceilings.items():
        own, cylinder = parameters[name]["default"], cylinders[name]["default"]
        if own != cylinder:
            for end, nearer in (("min", max), ("max", min)):
                if end in ceiling:
                    ceiling[end] = nearer(round(ceiling[end] * own / cylinder), parameters[name][end])
            ceiling["part"] = f"{robot.name}: in proportion to the cylinder's ({ceiling['part']})"


def _check_bus(messages: Mapping[str, Any], robot: Robot) -> None:
    """RobotError when what the controllers send by themselves, and COMMAND, fill the robot's bus too far."""
    bits = 0.0
    for name, message in messages.items():
        if message.get("cycle_ms") and (message.get("sender") == "controller" or name == "COMMAND"):
            # ISO 11898-1: a frame of 8 bytes, three bits between frames, and as many stuffed ones as can be
            bits += 1e3 / message["cycle_ms"] * (47 + 64 + (33 + 64) // 4)
    load = robot.nodes * bits / robot.bit_rate
    if load > FULLEST_BUS:
        raise robot.table.contradiction(
            "can.bit_rate",
            f"{robot.bit_rate:g} bit/s, a load of {load:.0%}",
            f"at most {FULLEST_BUS:.0%}",
            robot.table.place("can.nodes"),
        )
