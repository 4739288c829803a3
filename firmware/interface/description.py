"""The controller's interface description: controller.toml, loaded and checked.

Standard library only, so that the build can run it with any Python from 3.11 on. What is wrong in the file ends in one
`DescriptionError` that names the message and the signal (or the parameter, fault, limit) and what was expected.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = [
    "CONTROLLER_TOML",
    "Description",
    "DescriptionError",
    "Fault",
    "Limit",
    "Message",
    "Parameter",
    "Signal",
    "load",
    "parse",
]

CONTROLLER_TOML = Path(__file__).with_name("controller.toml")

INT32_MIN, INT32_MAX = -(2**31), 2**31 - 1
FAULT_BITS = 32
E2E_COUNTER = (48, 4)  # (start, length): one place for all messages, so that protecting a frame needs no table
E2E_CRC = (56, 8)
RESERVED_PARAMETERS = {"count", "ok", "unknown", "range", "locked", "protected"}  # taken by terrapin.h
C_KEYWORDS = re.compile(
    "auto|bool|break|case|char|const|continue|default|do|double|else|enum|extern|false|float|for|goto|if|inline|int|long|"
    "register|restrict|return|short|signed|sizeof|static|struct|switch|true|typedef|union|unsigned|void|volatile|while"
)


class DescriptionError(ValueError):
    """The description is wrong; the message says where and what was expected."""


@dataclass(frozen=True)
class Signal:
    """Some bits of a message. Raw integers travel: physical value = raw * scale. Little-endian, `start` is the LSB."""

    name: str
    start: int
    length: int
    signed: bool
    scale: float
    unit: str  # pint's spelling, "" when the raw number is all there is
    minimum: int  # raw
    maximum: int  # raw
    enum: str | None
    comment: str

    @property
    def lowest(self) -> int:
        """Smallest raw value that the bits can say."""
        return -(1 << (self.length - 1)) if self.signed else 0

    @property
    def highest(self) -> int:
        """Largest raw value that the bits can say."""
        return (1 << (self.length - 1 if self.signed else self.length)) - 1


@dataclass(frozen=True)
class Message:
    """One CAN frame with an 11-bit identifier. `length` in bytes, `cycle_ms` 0 when it is not periodic."""

    name: str
    id: int
    sender: str
    length: int
    cycle_ms: int
    e2e: bool
    comment: str
    signals: tuple[Signal, ...]


@dataclass(frozen=True)
class Parameter:
    """A number that the user may set: raw integers, physical value = raw * scale, in `unit`."""

    name: str
    index: int
    default: int
    minimum: int
    maximum: int
    unit: str
    scale: float
    meaning: str
    protects: str  # what a wrong value would endanger, "" when nothing

    @property
    def hash(self) -> int:
        """32-bit FNV-1a of name, unit and scale: which stored value is this parameter's, in whatever order they stand.

        A value that was stored in another unit or scale is another parameter's.
        """
        value = 0x811C9DC5
        for byte in f"{self.name}|{self.unit}|{self.scale!r}".encode():
            value = ((value ^ byte) * 0x01000193) & 0xFFFFFFFF
        return value


@dataclass(frozen=True)
class Fault:
    """One bit of the fault mask."""

    name: str
    number: int
    cause: str
    reaction: str
    latched: bool
    within_ms: int  # from the tick in which the cause first shows to the one that reacts, both counted
    scenarios: tuple[str, ...]  # of hil/scenarios, that provoke it


@dataclass(frozen=True)
class Limit:
    """A constant that parameters and inputs cannot change; `value` is in `unit`."""

    name: str
    value: float
    unit: str
    meaning: str


@dataclass(frozen=True)
class Description:
    """Everything that controller.toml says."""

    name: str
    version: int
    tick_hz: int
    nodes: Mapping[str, str]  # role ("controller", "host") -> node name on the bus
    enums: Mapping[str, Mapping[str, int]]
    messages: tuple[Message, ...]
    parameters: tuple[Parameter, ...]
    faults: tuple[Fault, ...]
    limits: tuple[Limit, ...]


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


def load(path: Path = CONTROLLER_TOML) -> Description:
    """Description in the file `path`. DescriptionError (names the file) when it is wrong, OSError when unreadable."""
    try:
        return parse(path.read_text(encoding="utf-8"))
    except DescriptionError as error:
        raise DescriptionError(f"{path.name}: {error}") from None


def parse(text: str) -> Description:
    """Description in the TOML `text`.

    >>> parse('[controller]\\nname = "toy"\\nversion = 1\\ntick_hz = 1000\\n[node]\\nhost = "PC"').nodes
    {'host': 'PC'}
    """
    try:
        root = _Table("top level", tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise DescriptionError(f"not TOML: {error}") from None
    head = _Table("[controller]", root.take("controller", dict))
    nodes = root.take("node", dict)
    enums = {name: _enum(name, table) for name, table in root.take("enum", dict, {}).items()}
    description = Description(
        name=head.take("name", str),
        version=head.integer("version", 0, 255),
        tick_hz=head.integer("tick_hz", 1, 1_000_000),
        nodes={_name(f"node {role}", role): str(node) for role, node in nodes.items()},
        enums=enums,
        messages=tuple(_message(n, t, nodes, enums) for n, t in root.take("message", dict, {}).items()),
        parameters=tuple(_parameter(n, i, t) for i, (n, t) in enumerate(root.take("parameter", dict, {}).items())),
        faults=tuple(_fault(n, t) for n, t in root.take("fault", dict, {}).items()),
        limits=tuple(_limit(n, t) for n, t in root.take("limit", dict, {}).items()),
    )
    head.done()
    root.done()
    _unique("id", ((m.id, f"message {m.name}") for m in description.messages), "0x{:03X}")
    _unique("hash", ((p.hash, f"parameter {p.name}") for p in description.parameters), "0x{:08X}")
    _unique("number", ((f.number, f"fault {f.name}") for f in description.faults), "{}")
    for what in (description.messages, description.parameters, description.faults, description.limits):
        _unique("name", ((entry.name.lower(), f"{type(entry).__name__.lower()} {entry.name}") for entry in what), "{}")
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


def _message(name: str, table: Any, nodes: Mapping[str, str], enums: Mapping[str, Mapping[str, int]]) -> Message:
    reader = _Table(f"message {_name(f'message {name}', name)}", table)
    entries = reader.take("signals", list)
    signals = tuple(_signal(name, i, entry, enums) for i, entry in enumerate(entries))
    if not signals:
        raise reader.fail("has no signals")
    needed = max((s.start + s.length + 7) // 8 for s in signals)
    message = Message(
        name=name,
        id=reader.integer("id", 0, 0x7FF),
        sender=reader.take("sender", str),
        length=reader.integer("length", needed, 8, needed),
        cycle_ms=reader.integer("cycle_ms", 0, 60_000, 0),
        e2e=reader.take("e2e", bool, False),
        comment=reader.take("comment", str, ""),
        signals=signals,
    )
    reader.done()
    if message.sender not in nodes:
        raise reader.fail(f"sender '{message.sender}' is no node (known: {', '.join(nodes)})")
    owner: dict[int, str] = {}
    for signal in signals:
        for bit in range(signal.start, signal.start + signal.length):
            if bit in owner:
                raise DescriptionError(f"message {name}, signal {signal.name}: bit {bit} overlaps signal {owner[bit]}")
            owner[bit] = signal.name
    _unique("name", ((s.name.lower(), f"message {name}, signal {s.name}") for s in signals), "{}")
    if message.e2e:
        found = {s.name: (s.start, s.length) for s in signals if not s.signed}
        for part, place in (("counter", E2E_COUNTER), ("crc", E2E_CRC)):
            if found.get(part) != place:
                raise reader.fail(f"e2e needs an unsigned signal '{part}' with start {place[0]} and length {place[1]}")
    return message


def _signal(message: str, index: int, table: Any, enums: Mapping[str, Mapping[str, int]]) -> Signal:
    reader = _Table(f"message {message}, signal number {index + 1}", table)
    name = _name(reader.where, reader.take("name", str))
    reader.where = f"message {message}, signal {name}"
    start = reader.integer("start", 0, 63)
    length = reader.integer("length", 1, 32)
    signed = reader.take("signed", bool, False)
    if start + length > 64:
        raise reader.fail(f"bits {start} to {start + length - 1} do not fit into 8 bytes")
    if signed and length < 2:
        raise reader.fail("a signed signal needs at least 2 bits")
    lowest, highest = (-(2 ** (length - 1)), 2 ** (length - 1) - 1) if signed else (0, 2**length - 1)
    minimum = reader.integer("min", lowest, highest, lowest)
    maximum = reader.integer("max", minimum, highest, highest)
    enum = reader.take("enum", str, None)
    if enum is not None:
        if enum not in enums:
            raise reader.fail(f"unknown enum '{enum}' (known: {', '.join(enums) or 'none'})")
        worst = max(enums[enum].values())
        if signed or worst > highest:
            raise reader.fail(f"enum '{enum}' needs an unsigned signal that holds {worst}")
    signal = Signal(
        name=name,
        start=start,
        length=length,
        signed=signed,
        scale=reader.scale(),
        unit=reader.take("unit", str, ""),
        minimum=minimum,
        maximum=maximum,
        enum=enum,
        comment=reader.take("comment", str, ""),
    )
    reader.done()
    return signal


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


def _limit(name: str, table: Any) -> Limit:
    reader = _Table(f"limit {_name(f'limit {name}', name)}", table)
    limit = Limit(
        name=name,
        value=reader.take("value", float),
        unit=reader.take("unit", str, ""),
        meaning=reader.take("meaning", str),
    )
    reader.done()
    if not math.isfinite(limit.value):
        raise reader.fail(f"'value' must be a finite number, found {limit.value}")
    return limit
