"""The controller's interface description: controller.toml, loaded and checked.

Standard library only, so that the build can run it with any Python from 3.11 on. What is wrong in the file ends in one
`DescriptionError` that names the message and the signal (or the parameter, fault, limit) and what was expected.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from terrapin_interface.entries import (
    INT32_MAX,
    INT32_MIN,
    Block,
    Constant,
    Description,
    DescriptionError,
    Fault,
    Message,
    Parameter,
    Promise,
    Signal,
    ends,
)
from terrapin_interface.fitting import fitted
from terrapin_interface.robot import Robot

__all__ = ["CONTROLLER_TOML", "load", "parse"]

CONTROLLER_TOML = Path(__file__).with_name("controller.toml")

LAST = 0x7FF  # identifier of 11 bits
FAULT_BITS = 32
E2E_COUNTER = (48, 4)  # (start, length): one place for all messages, so that protecting a frame needs no table
E2E_CRC = (56, 8)
RESERVED_PARAMETERS = {"count", "ok", "unknown", "range", "locked", "protected"}  # taken by terrapin.h
C_KEYWORDS = re.compile(
    "auto|bool|break|case|char|const|continue|default|do|double|else|enum|extern|false|float|for|goto|if|inline|int|long|"
    "register|restrict|return|short|signed|sizeof|static|struct|switch|true|typedef|union|unsigned|void|volatile|while"
)


class _Table:
    """A TOML table that is read key by key; what was not asked for is an error."""

    def __init__(self, where: str, table: Any) -> None:
        if not isinstance(table, dict):
            raise DescriptionError(f"{where}: expected a table, found {table!r}")
        self.where = where
        self.table = dict(table)

    def fail(self, text: str) -> DescriptionError:
        return DescriptionError(f"{self.where}: {text}")

    def take(self, key: str, kind: type, *default: Any) -> Any:
        if key not in self.table:
            if default:
                return default[0]
            raise self.fail(f"'{key}' is missing")
        value = self.table.pop(key)
        good = isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
        if not good and not (kind is float and isinstance(value, int) and not isinstance(value, bool)):
            raise self.fail(f"'{key}' must be {_KINDS[kind]}, found {value!r}")
        return float(value) if kind is float else value

    def integer(self, key: str, low: int, high: int, *default: int) -> int:
        value: int = self.take(key, int, *default)
        if not low <= value <= high:
            raise self.fail(f"'{key}' must be {low} to {high}, found {value}")
        return value

    def scale(self) -> float:
        value: float = self.take("scale", float, 1.0)
        if not (math.isfinite(value) and value > 0):
            raise self.fail(f"'scale' must be a positive number, found {value}")
        return value

    def done(self) -> None:
        if self.table:
            raise self.fail(f"unknown key '{next(iter(self.table))}'")


_KINDS: dict[type, str] = {
    int: "an integer",
    float: "a number",
    str: "a text",
    bool: "true or false",
    dict: "a table",
    list: "a list",
}


def load(path: Path = CONTROLLER_TOML, robot: Robot | None = None) -> Description:
    """Description in the file `path`, for a robot: the cylinder where it says nothing else and one is needed.

    DescriptionError (names the file) when it is wrong, RobotError when the robot does not fit, OSError when unreadable.
    """
    try:
        return parse(path.read_text(encoding="utf-8"), robot)
    except DescriptionError as error:
        raise DescriptionError(f"{path.name}: {error}") from None


def parse(text: str, robot: Robot | None = None) -> Description:
    """Description in the TOML `text`, for a robot as `load`.

    >>> parse('[controller]\\nname = "toy"\\nversion = 1\\ntick_hz = 1000\\n[node]\\nhost = "PC"').nodes
    {'host': 'PC'}
    """
    try:
        root = _Table("top level", fitted(tomllib.loads(text), robot))
    except tomllib.TOMLDecodeError as error:
        raise DescriptionError(f"not TOML: {error}") from None
    head = _Table("[controller]", root.take("controller", dict))
    nodes = root.take("node", dict)
    enums = {name: _enum(name, table) for name, table in root.take("enum", dict, {}).items()}
    node_count, blocks = _blocks(root.take("identifiers", dict, None), nodes)
    suffixes = {name: _suffix(name, entry) for name, entry in root.take("suffix", dict, {}).items()}
    description = Description(
        name=head.take("name", str),
        version=head.integer("version", 0, 255),
        tick_hz=head.integer("tick_hz", 1, 1_000_000),
        nodes={_name(f"node {role}", role): str(node) for role, node in nodes.items()},
        enums=enums,
        messages=tuple(_message(n, t, nodes, enums, suffixes) for n, t in root.take("message", dict, {}).items()),
        parameters=_within(
            root.take("ceiling", dict, {}),
            tuple(_parameter(n, i, t) for i, (n, t) in enumerate(root.take("parameter", dict, {}).items())),
        ),
        faults=tuple(_fault(n, t) for n, t in root.take("fault", dict, {}).items()),
        limits=tuple(_constant("limit", n, t) for n, t in root.take("limit", dict, {}).items()),
        constants=tuple(_constant("constant", n, t) for n, t in root.take("constant", dict, {}).items()),
        promises=tuple(_promise(n, t) for n, t in root.take("promise", dict, {}).items()),
        node_count=node_count,
        blocks=blocks,
    )
    head.done()
    root.done()
    _unique("id", ((m.id, f"message {m.name}") for m in description.messages), "0x{:03X}")
    _with_authority(description)
    _in_blocks(description)
    _unique("hash", ((p.hash, f"parameter {p.name}") for p in description.parameters), "0x{:08X}")
    _unique("number", ((f.number, f"fault {f.name}") for f in description.faults), "{}")
    for kind in ("message", "parameter", "fault", "limit", "constant", "promise"):
        entries = getattr(description, f"{kind}s")
        _unique("name", ((entry.name.lower(), f"{kind} {entry.name}") for entry in entries), "{}")
    return description


def _unique(what: str, keys: Iterable[tuple[Any, str]], form: str) -> None:
    seen: dict[Any, str] = {}
    for key, owner in keys:
        if key in seen:
            raise DescriptionError(f"{owner}: {what} {form.format(key)} is already taken by {seen[key]}")
        seen[key] = owner


def _name(where: str, name: str) -> str:
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,39}", name) or C_KEYWORDS.fullmatch(name.lower()):
        raise DescriptionError(f"{where}: '{name}' cannot be a name in C (letters, digits, _; 40 at most; no keyword)")
    return name


def _enum(name: str, table: Any) -> dict[str, int]:
    reader = _Table(f"enum {_name(f'enum {name}', name)}", table)
    values: dict[str, int] = reader.take("values", dict)
    reader.done()
    for key, value in values.items():
        _name(f"enum {name}", key)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= INT32_MAX:
            raise reader.fail(f"value '{key}' must be an integer from 0, found {value!r}")
    _unique("value", ((value, f"enum {name}, {key}") for key, value in values.items()), "{}")
    if not values:
        raise reader.fail("has no values")
    return values


def _blocks(table: Any, nodes: Mapping[str, str]) -> tuple[int, tuple[Block, ...]]:
    """[identifiers]: how many nodes a bus may have, and their blocks of identifiers; one node where it is absent."""
    if table is None:
        return 1, ()
    reader = _Table("[identifiers]", table)
    count = reader.integer("nodes", 1, 16)
    blocks = tuple(_block(i, entry, nodes) for i, entry in enumerate(reader.take("blocks", list)))
    reader.done()
    owner: dict[int, str] = {}
    for block in blocks:
        for node in range(count if block.step else 1):
            for identifier in range(block.at(node), block.at(node) + block.size):
                if identifier > LAST:
                    raise DescriptionError(
                        f"block {block.name}: node {node} goes beyond 0x{LAST:X}, the last identifier"
                    )
                if identifier in owner:
                    where = f"block {block.name}, node {node}"
                    raise DescriptionError(f"{where}: id 0x{identifier:03X} is already taken by {owner[identifier]}")
                owner[identifier] = f"block {block.name}, node {node}"
    return count, blocks


def _block(index: int, table: Any, nodes: Mapping[str, str]) -> Block:
    reader = _Table(f"[identifiers], block number {index + 1}", table)
    name = _name(reader.where, reader.take("name", str))
    reader.where = f"block {name}"
    sender = reader.take("sender", str)
    if sender not in nodes:
        raise reader.fail(f"sender '{sender}' is no node (known: {', '.join(nodes)})")
    first, size = reader.integer("first", 0, LAST), reader.integer("size", 1, 64)
    node_1, step = reader.integer("node_1", 0, LAST, first), reader.integer("step", 0, LAST, 0)
    reader.done()
    if size.bit_count() != 1 or any(value % size for value in (first, node_1, step)):
        raise reader.fail(f"'size' {size} must be a power of 2, and 'first', 'node_1' and 'step' multiples of it")
    if (node_1 == first) != (step == 0):
        raise reader.fail("'node_1' and 'step' must be given together")
    return Block(name, sender, first, size, node_1, step)


def _with_authority(d: Description) -> None:
    """Each request of an update says what must have come before it; none can be forgotten."""
    known = d.enums.get("authority", {})
    updates = [b for b in d.blocks if b.name == "updates"]
    for m in d.messages:
        if any(b.first <= m.id < b.first + b.size for b in updates):
            if m.authority not in known:
                raise DescriptionError(
                    f"message {m.name}: 'authority' is {m.authority!r}, expected one of enum.authority: "
                    f"{', '.join(known) or 'none'}"
                )
        elif m.authority:
            raise DescriptionError(f"message {m.name}: 'authority' is for the requests of block updates alone")


def _in_blocks(d: Description) -> None:
    for m in d.messages if d.blocks else ():
        if not any(b.first <= m.id < b.first + b.size and b.sender == m.sender for b in d.blocks):
            raise DescriptionError(f"message {m.name}: id 0x{m.id:03X} is in no block of [identifiers] of its sender's")


def _suffix(name: str, entry: Any) -> tuple[float, str]:
    """How a name in C ends -> what one of it is, in a unit."""
    good = isinstance(entry, list) and [type(part) for part in entry] == [float, str]
    if not (good and math.isfinite(entry[0]) and entry[0] > 0 and re.fullmatch("[a-z0-9_]+", name)):
        raise DescriptionError(
            f'suffix {name}: expected a positive number and its unit, as [1e-3, "A"], found {entry!r}'
        )
    return entry[0], entry[1]


def _message(
    name: str,
    table: Any,
    nodes: Mapping[str, str],
    enums: Mapping[str, Mapping[str, int]],
    suffixes: Mapping[str, tuple[float, str]],
) -> Message:
    reader = _Table(f"message {_name(f'message {name}', name)}", table)
    entries = reader.take("signals", list)
    signals = tuple(_signal(name, i, entry, enums, suffixes) for i, entry in enumerate(entries))
    if not signals:
        raise reader.fail("has no signals")
    needed = max((s.start + s.length + 7) // 8 for s in signals)
    message = Message(
        name=name,
        id=reader.integer("id", 0, LAST),
        sender=reader.take("sender", str),
        length=reader.integer("length", needed, 8, needed),
        cycle_ms=reader.integer("cycle_ms", 0, 60_000, 0),
        e2e=reader.take("e2e", bool, False),
        comment=reader.take("comment", str, ""),
        signals=signals,
        authority=reader.take("authority", str, ""),
    )
    reader.done()
    if message.sender not in nodes:
        raise reader.fail(f"sender '{message.sender}' is no node (known: {', '.join(nodes)})")
    owner: dict[int, str] = {}
    for signal in signals:
        where = f"message {name}, signal {signal.name}"
        for bit in range(signal.start, signal.start + signal.length):
            if bit in owner:
                place = f"'start' {signal.start}, 'length' {signal.length}"
                raise DescriptionError(f"{where}: {place}: bit {bit} overlaps signal {owner[bit]}")
            owner[bit] = signal.name
        if not message.telemetry and signal.divisor != 1:
            raise DescriptionError(f"{where}: 'scale' must be that of source '{signal.source}', which travels as it is")
        if not message.telemetry and signal.ceiling:
            raise DescriptionError(f"{where}: 'ceiling' is for what the controller sends in a cycle")
    _unique("name", ((s.name.lower(), f"message {name}, signal {s.name}") for s in signals), "{}")
    _unique("source", ((s.source or s.name, f"message {name}, signal {s.name}") for s in signals), "'{}'")
    if message.e2e:
        found = {s.name: s for s in signals}
        for part, (start, length) in (("counter", E2E_COUNTER), ("crc", E2E_CRC)):
            if part not in found:
                raise reader.fail(f"e2e needs a signal '{part}'")
            if (found[part].start, found[part].length, found[part].signed) != (start, length, False):
                raise DescriptionError(
                    f"message {name}, signal {part}: e2e needs 'start' {start}, 'length' {length}, unsigned"
                )
    return message


def _signal(
    message: str,
    index: int,
    table: Any,
    enums: Mapping[str, Mapping[str, int]],
    suffixes: Mapping[str, tuple[float, str]],
) -> Signal:
    reader = _Table(f"message {message}, signal number {index + 1}", table)
    name = _name(reader.where, reader.take("name", str))
    reader.where = f"message {message}, signal {name}"
    start = reader.integer("start", 0, 63)
    length = reader.integer("length", 1, 32)
    signed = reader.take("signed", bool, False)
    if start + length > 64:
        raise reader.fail(f"'start' {start}, 'length' {length}: bits {start} to {start + length - 1} exceed 8 bytes")
    if signed and length < 2:
        raise reader.fail(f"'length' must be at least 2 of a signed signal, found {length}")
    if length == 31 and not signed:  # 2^31 - 1 is also the end of the field in C: what is beyond would seem to fit
        raise reader.fail("'length' must be at most 30, or 32, of an unsigned signal, found 31")
    lowest, highest = ends(length, signed)
    minimum = reader.integer("min", lowest, highest, lowest)
    maximum = reader.integer("max", minimum, highest, highest)
    enum = reader.take("enum", str, None)
    if enum is not None:
        if enum not in enums:
            raise reader.fail(f"unknown enum '{enum}' (known: {', '.join(enums) or 'none'})")
        worst = max(enums[enum].values())
        if signed or worst > highest:
            raise reader.fail(f"'length' {length}: enum '{enum}' needs an unsigned signal that holds {worst}")
    scaled = "scale" in reader.table
    scale = reader.scale()
    unit = reader.take("unit", str, "")
    source = reader.take("source", str, "")
    if scaled and not source:
        raise reader.fail("'scale' needs a 'source': the value in C, whose suffix says its unit")
    signal = Signal(
        name=name,
        start=start,
        length=length,
        signed=signed,
        scale=scale,
        unit=unit,
        minimum=minimum,
        maximum=maximum,
        enum=enum,
        comment=reader.take("comment", str, ""),
        source=source,
        divisor=_divisor(reader, source, scale, unit, suffixes) if source else 1,
        ceiling=reader.take("ceiling", bool, False),
    )
    reader.done()
    return signal


def _divisor(reader: _Table, source: str, scale: float, unit: str, suffixes: Mapping[str, tuple[float, str]]) -> int:
    """How many of the source's units make one step of the signal."""
    _name(f"{reader.where}, source", source)
    known = [suffix for suffix in suffixes if source.endswith(f"_{suffix}")]
    if not known:
        raise reader.fail(f"'source' {source}: its suffix is not in [suffix] (known: {', '.join(suffixes) or 'none'})")
    one, source_unit = suffixes[max(known, key=len)]
    if unit != source_unit:
        raise reader.fail(f"'unit' must be '{source_unit}', which source '{source}' is counted in, found '{unit}'")
    divisor = round(min(scale / one, INT32_MAX))
    if divisor < 1 or not math.isclose(divisor * one, scale, rel_tol=1e-12):
        raise reader.fail(f"'scale' {scale} is not a whole multiple of {one} {unit}, one of source '{source}'")
    return divisor


def _parameter(name: str, index: int, table: Any) -> Parameter:
    reader = _Table(f"parameter {_name(f'parameter {name}', name)}", table)
    if name.lower() in RESERVED_PARAMETERS:
        raise reader.fail("the name is reserved")
    minimum = reader.integer("min", INT32_MIN, INT32_MAX)
    maximum = reader.integer("max", minimum, INT32_MAX)
    default = reader.take("default", int)
    if not minimum <= default <= maximum:
        raise reader.fail(f"default {default} is outside {minimum} to {maximum}")
    parameter = Parameter(
        name=name,
        index=index,
        default=default,
        minimum=minimum,
        maximum=maximum,
        unit=reader.take("unit", str, ""),
        scale=reader.scale(),
        meaning=reader.take("meaning", str),
        protects=reader.take("protects", str, ""),
    )
    reader.done()
    return parameter


def _within(ceilings: Mapping[str, Any], parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
    """The parameters with their ranges narrowed to the board's ceilings."""
    known = {parameter.name: parameter for parameter in parameters}
    for name, table in ceilings.items():
        reader = _Table(f"ceiling {name}", table)
        if name not in known:
            raise reader.fail("there is no such parameter")
        if "min" not in reader.table and "max" not in reader.table:
            raise reader.fail("expected 'min', 'max' or both")
        parameter = known[name]
        minimum = reader.integer("min", parameter.minimum, parameter.default, parameter.minimum)
        maximum = reader.integer("max", parameter.default, parameter.maximum, parameter.maximum)
        known[name] = replace(parameter, minimum=minimum, maximum=maximum, ceiling=reader.take("part", str))
        reader.done()
        if not known[name].ceiling:
            raise reader.fail("'part' must name the part whose rating this is")
    return tuple(known.values())


def _fault(name: str, table: Any) -> Fault:
    reader = _Table(f"fault {_name(f'fault {name}', name)}", table)
    fault = Fault(
        name=name,
        number=reader.integer("number", 0, FAULT_BITS - 1),
        cause=reader.take("cause", str),
        reaction=reader.take("reaction", str),
        latched=reader.take("latched", bool),
        within_ms=reader.integer("within_ms", 1, 60_000),
        scenarios=tuple(_name(f"{reader.where}, scenarios", str(s)) for s in reader.take("scenarios", list, [])),
    )
    reader.done()
    return fault


def _constant(kind: str, name: str, table: Any) -> Constant:
    return Constant(**_constant_fields(kind, name, table))


def _promise(name: str, table: Any) -> Promise:
    fields = _constant_fields("promise", name, table, "test")
    if not re.fullmatch(r"[\w./-]+::\w+", fields["test"]):
        raise DescriptionError(f"promise {name}: 'test' must be FILE::FUNCTION, found {fields['test']!r}")
    return Promise(**fields)


def _constant_fields(kind: str, name: str, table: Any, *more: str) -> dict[str, Any]:
    reader = _Table(f"{kind} {_name(f'{kind} {name}', name)}", table)
    value = reader.take("value", float)
    fields = {"name": name, "value": value, "unit": reader.take("unit", str, "")}
    fields |= {key: reader.take(key, str) for key in ("meaning", *more)}
    reader.done()
    if not math.isfinite(value):
        raise reader.fail(f"'value' must be a finite number, found {value}")
    return fields
