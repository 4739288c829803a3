"""What the frames of an update travel over: SLCAN on a serial port, or any bus that python-can knows."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from typing import Any, Protocol

from hil.messages import Frame
from host_tools.errors import UserError

__all__ = ["BAUD", "BIT_RATE", "CanWire", "SerialWire", "Wire"]

BAUD = 1_000_000  # of the F405's USART1
BIT_RATE = 500_000  # of its CAN
POLL = 0.01  # s of one read of a serial port
_ANSWERS = range(0x1A0, 0x1A8)
_LINE = re.compile(rb"t([0-9A-Fa-f]{3})([0-8])((?:[0-9A-Fa-f]{2})*)")


class Wire(Protocol):
    """An open link. Failures are UserError with status 1: one line that names the link."""

    name: str

    def send(self, frames: Sequence[Frame]) -> None:
        """Sends frames in order."""

    def receive(self, wait: float) -> Frame | None:
        """The next frame of an update; None when none comes within `wait` seconds."""

    def wake(self) -> None:
        """Opens the other side's channel again: a reset closes it."""

    def close(self) -> None: ...


class SerialWire:
    """SLCAN. Its acknowledgements are not waited for: the update has its own."""

    def __init__(self, port: str, baud: int = BAUD) -> None:
        import serial

        self.name = port
        self._rest = b""
        self._frames: list[Frame] = []
        try:
            self._port: Any = serial.Serial(port, baud, timeout=POLL, write_timeout=5, exclusive=True)
        except (OSError, ValueError) as error:  # serial.SerialException is an OSError
            reason = getattr(error, "strerror", None) or str(error)
            raise UserError(f"{port}: cannot open the serial port: {reason}", status=1) from None
        self.wake()

    def _lost(self, error: OSError) -> UserError:
        return UserError(f"{self.name}: the serial port disappeared ({error.strerror or error})", status=1)

    def wake(self) -> None:
        self._write(b"\rO\r")

    def _write(self, text: bytes) -> None:
        try:
            self._port.write(text)
        except OSError as error:
            raise self._lost(error) from None

    def send(self, frames: Sequence[Frame]) -> None:
        self._write(b"".join(f"t{i:03X}{len(d)}{d.hex().upper()}\r".encode() for i, d in frames))

    def receive(self, wait: float) -> Frame | None:
        end = time.monotonic() + wait
        while not self._frames:
            if time.monotonic() >= end:
                return None
            try:
                data = self._port.read(1)
                data += self._port.read(self._port.in_waiting) if data else b""
            except OSError as error:
                raise self._lost(error) from None
            *lines, rest = (self._rest + data).replace(b"\a", b"\r").split(b"\r")
            self._rest = rest[-64:]  # what is longer is no SLCAN
            for line in lines:
                found = _LINE.fullmatch(line)
                if found and int(found[1], 16) in _ANSWERS and len(found[3]) == 2 * int(found[2]):
                    self._frames.append((int(found[1], 16), bytes.fromhex(found[3].decode())))
        return self._frames.pop(0)

    def close(self) -> None:
        self._port.close()


class CanWire:
    """A bus of python-can."""

    def __init__(self, interface: str, channel: str, bit_rate: int = BIT_RATE, **options: Any) -> None:
        import can

        self.name = f"{interface}:{channel}"
        filters = [{"can_id": _ANSWERS.start, "can_mask": 0x7F8, "extended": False}]
        try:
            self._bus: Any = can.Bus(
                interface=interface, channel=channel, bitrate=bit_rate, can_filters=filters, **options
            )
        except Exception as error:  # each adapter's driver has its own way of not being there
            reason = next(iter(str(error).splitlines()), "") or type(error).__name__
            raise UserError(f"{self.name}: cannot open the bus: {reason}", status=1) from None

    def wake(self) -> None:
        pass  # a bus is always open

    def send(self, frames: Sequence[Frame]) -> None:
        import can

        for identifier, data in frames:
            message = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
            try:
                self._bus.send(message, timeout=2.0)
            except (can.CanError, OSError) as error:
                raise UserError(f"{self.name}: cannot send: {error}", status=1) from None

    def receive(self, wait: float) -> Frame | None:
        import can

        end = time.monotonic() + wait
        while True:
            try:
                message = self._bus.recv(max(0.0, end - time.monotonic()))
            except (can.CanError, OSError) as error:
                raise UserError(f"{self.name}: the bus disappeared ({error})", status=1) from None
            if message is None:
                return None
            if message.arbitration_id in _ANSWERS and not message.is_extended_id and not message.is_error_frame:
                return message.arbitration_id, bytes(message.data)

    def close(self) -> None:
        self._bus.shutdown()
