"""What controller.toml says, as values: messages and their signals, parameters, faults, limits, constants, promises."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = [
    "INT32_MAX",
    "INT32_MIN",
    "Block",
    "Constant",
    "Description",
    "DescriptionError",
    "Fault",
    "Message",
    "Parameter",
    "Promise",
    "Signal",
    "ends",
]

INT32_MIN, INT32_MAX = -(2**31), 2**31 - 1


class DescriptionError(ValueError):
    """The description is wrong; the message says where and what was expected."""


def ends(length: int, signed: bool) -> tuple[int, int]:
    """Smallest and largest raw value of so many bits."""
    return (-(2 ** (length - 1)), 2 ** (length - 1) - 1) if signed else (0, 2**length - 1)


@dataclass(frozen=True)
class Signal:
    """Some bits of a message. Raw integers travel: physical value = raw * scale. Little-endian, `start` is the LSB.

    A signal with a scale names its `source`: the value in C, whose suffix gives the unit that it is counted in.
    """

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
    source: str = ""  # "" when the raw number itself is the value in C
    divisor: int = 1  # raw = source / divisor, cut towards zero
    ceiling: bool = False  # what is beyond maximum, or floor, is held there and is no saturation

    @property
    def floor(self) -> int:
        """Smallest raw value that a ceiling lets through: as far from 0 as the largest, where the range has that."""
        return max(self.minimum, -self.maximum)

    @property
    def highest(self) -> int:
        """Largest raw value that the bits can say."""
        return ends(self.length, self.signed)[1]


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
    authority: str = ""  # of an update's request: a name of enum.authority, what must come before it is taken

    @property
    def telemetry(self) -> bool:
        """True when the controller sends it by itself, again and again."""
        return self.sender == "controller" and self.cycle_ms > 0


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
    ceiling: str = ""  # the part whose rating narrowed minimum or maximum, "" when none did

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
    scenarios: tuple[str, ...]  # of terrapin_hil/scenario/scenarios, that provoke it


@dataclass(frozen=True)
class Constant:
    """A limit, or another number that parameters and inputs cannot change; `value` is in `unit`."""

    name: str
    value: float
    unit: str
    meaning: str


@dataclass(frozen=True)
class Promise(Constant):
    """A bound that no code needs and that a test holds: `test` is FILE::FUNCTION from the top of the sources."""

    test: str


@dataclass(frozen=True)
class Block:
    """Identifiers that stand together: `size` from `first` on at node 0, as many at each other node."""

    name: str
    sender: str
    first: int
    size: int
    node_1: int  # first of node 1; that of node 0 where all nodes share the block
    step: int  # from a node to the next; 0 where they share it

    def at(self, node: int) -> int:
        """First identifier of the block at a node.

        >>> Block("answers", "controller", 0x180, 64, 0x1C0, 0x40).at(2) == 0x200
        True
        """
        return self.node_1 + (node - 1) * self.step if node else self.first


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
    limits: tuple[Constant, ...]
    constants: tuple[Constant, ...]
    promises: tuple[Promise, ...]
    node_count: int = 1  # controllers that one bus may have
    blocks: tuple[Block, ...] = ()  # how their identifiers follow from the messages', which are those of node 0
