"""The controller's messages in Python: raw integers to CAN data and back, from the build's interface.json.

No DBC library in the way: a tick of lockstep encodes two messages and decodes one, thousands of times a second.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from terrapin_hil import paths
from terrapin_hil.errors import UserError
from terrapin_interface import entries
from terrapin_interface.entries import Signal

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = [
    "AnswerError",
    "Frame",
    "Interface",
    "Message",
    "Parameter",
    "Sender",
    "Signal",
    "crc8",
    "interface",
    "protect",
    "raw_value",
]

Frame = tuple[int, bytes]  # (11-bit identifier, 0 to 8 bytes)

E2E_COUNTERS = 15  # the counter runs 0 to 14


def _crc_table() -> bytes:
    table = []
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = (value << 1) ^ 0x11D if value & 0x80 else value << 1
        table.append(value)
    return bytes(table)


_CRC = _crc_table()


def crc8(data: bytes) -> int:
    """CRC-8 SAE J1850: polynomial 0x1D, start 0xFF, final XOR 0xFF.

    >>> hex(crc8(b"123456789"))
    '0x4b'
    """
    value = 0xFF
    for byte in data:
        value = _CRC[value ^ byte]
    return value ^ 0xFF


def protect(identifier: int, data: bytes, counter: int) -> bytes:
    """The 8 bytes `data` with E2E counter (modulo 15) and CRC set, for the message `identifier`."""
    body = data[:6] + bytes([data[6] & 0xF0 | counter % E2E_COUNTERS])
    return body + bytes([crc8(identifier.to_bytes(2, "little") + body)])


class ParameterError(UserError, ValueError):
    """A parameter could not be set or read; the message says which and why."""


class AnswerError(RuntimeError):
    """The controller's answer to a tick is missing or damaged."""


Raw = TypeVar("Raw", int, "npt.NDArray[np.int64]")


def raw_value(signal: Signal, data: Raw) -> Raw:
    """Raw value of a signal in the data of a frame, read as a little-endian number; or in those of many at once."""
    value = data >> signal.start & ((1 << signal.length) - 1)
    sign = 1 << (signal.length - 1) if signal.signed else 0
    return (value ^ sign) - sign


@dataclass(frozen=True)
class Message(entries.Message):
    """One CAN frame of the interface, with its codec."""

    def encode(self, values: Mapping[str, int]) -> tuple[bytes, bool]:
        """Data of the raw `values` (absent signals are 0), and whether all fitted: what does not fit is clamped.

        KeyError when a name is no signal of this message.
        """
        bits = 0
        exact = True
        used = 0
        for signal in self.signals:
            value = values.get(signal.name)
            if value is None:
                continue
            used += 1
            if value < signal.minimum:
                value, exact = signal.minimum, False
            elif value > signal.maximum:
                value, exact = signal.maximum, False
            bits |= (value & ((1 << signal.length) - 1)) << signal.start
        if used != len(values):
            unknown = sorted(set(values) - {signal.name for signal in self.signals})
            raise KeyError(f"message {self.name} has no signal {', '.join(unknown)}")
        return bits.to_bytes(self.length, "little"), exact

    def decode(self, data: bytes) -> dict[str, int]:
        """Raw values of `data`. ValueError when it has the wrong length."""
        if len(data) != self.length:
            raise ValueError(f"message {self.name} has {self.length} bytes, found {len(data)}")
        bits = int.from_bytes(data, "little")
        return {signal.name: raw_value(signal, bits) for signal in self.signals}

    def physical(self, data: bytes) -> dict[str, float]:
        """Values of `data` in their units. ValueError when it has the wrong length."""
        raw = self.decode(data)
        return {signal.name: raw[signal.name] * signal.scale for signal in self.signals}


@dataclass(frozen=True)
class Parameter(entries.Parameter):
    """A parameter of the controller: physical value = raw * scale, in `unit`. Default and bounds are raw."""

    def number(self, value: float | str) -> float:
        """A number in the parameter's unit; a text, "500 ms", is converted. ParameterError when it does not convert."""
        from terrapin_hil.reading import parse_quantity

        try:
            return parse_quantity(value, self.unit)
        except ValueError as error:
            raise ParameterError(f"parameter {self.name}: {error}") from None

    def raw(self, physical: float) -> int:
        """Nearest raw value. ParameterError when it is outside the parameter's range (or not a number)."""
        low, high = self.minimum * self.scale, self.maximum * self.scale
        if self.scale == 1 and self.unit in ("", "1") and math.isfinite(physical) and physical != round(physical):
            raise ParameterError(
                f"parameter {self.name}: found {physical:g}, expected a whole number, {low:g} to {high:g}"
            )
        slack = self.scale / 2  # so that a bound written as a decimal is inside
        if not low - slack <= physical <= high + slack:
            unit = f" {self.unit}" if self.unit else ""
            raise ParameterError(f"parameter {self.name}: {physical:g}{unit} is outside {low:g} to {high:g}{unit}")
        return min(max(round(physical / self.scale), self.minimum), self.maximum)


@dataclass(frozen=True)
class Interface:
    """The controller's interface, as the firmware of this build speaks it."""

    version: int
    messages: Mapping[str, Message]
    by_id: Mapping[int, Message]
    parameters: Mapping[str, Parameter]
    enums: Mapping[str, Mapping[str, int]]
    faults: Mapping[str, int]  # name -> bit number
    constants: Mapping[str, float]  # in the units of controller.toml
    json: Mapping[str, Any]  # everything, as it stands in interface.json

    def parameter(self, name: str) -> Parameter:
        """The parameter `name`. ParameterError that names the nearest ones otherwise."""
        found = self.parameters.get(name)
        if found is None:
            import difflib

            near = difflib.get_close_matches(name, self.parameters, n=3) or sorted(self.parameters)[:3]
            raise ParameterError(f"no parameter '{name}' (perhaps {', '.join(near)})")
        return found


def interface(folder: Path | None = None) -> Interface:
    """Interface in `folder`/generated (that of the robot of this process by default).

    OSError, naming the file, when it is not built.
    """
    return _interface(folder or paths.build())


@cache
def _interface(folder: Path) -> Interface:
    path = paths.need(folder / "generated" / "interface.json")
    table = json.loads(path.read_text(encoding="utf-8"))
    messages = {}
    for entry in table["messages"]:
        signals = tuple(Signal(**signal) for signal in entry["signals"])
        messages[entry["name"]] = Message(**{**entry, "signals": signals})
    return Interface(
        version=table["version"],
        messages=messages,
        by_id={message.id: message for message in messages.values()},
        parameters={entry["name"]: Parameter(**entry) for entry in table["parameters"]},
        enums=table["enums"],
        faults={entry["name"]: entry["number"] for entry in table["faults"]},
        constants={entry["name"]: entry["value"] for entry in table["constants"]},
        json=table,
    )


class Sender:
    """Makes the host's frames and keeps the E2E counters of protected messages."""

    def __init__(self, description: Interface | None = None) -> None:
        self.interface = description or interface()
        self._counters: dict[str, int] = {}

    def frame(self, name: str, values: Mapping[str, int]) -> Frame:
        """Frame of message `name` with raw `values`; what does not fit is clamped, as in the firmware."""
        message = self.interface.messages[name]
        data, _ = message.encode(values)
        if message.e2e:
            counter = self._counters.get(name, 0)
            self._counters[name] = (counter + 1) % E2E_COUNTERS
            data = protect(message.id, data, counter)
        return message.id, data

    def test_mode(self, arm: bool = True) -> list[Frame]:
        """Frames that arm (or leave) test mode. Two, because a controller that served another host before may take the
        first for a repetition of that host's last one."""
        key = int(self.interface.constants["test_mode_key"]) if arm else 0
        return [self.frame("TEST_MODE", {"key": 0}), self.frame("TEST_MODE", {"key": key})]
