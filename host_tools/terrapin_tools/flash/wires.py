"""What the frames of an update travel over: SLCAN on a serial port, or a bus (terrapin_tools.flash.can_wire)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from terrapin_hil.links.link import not_there
from terrapin_hil.links.names import BIT_RATE, LinkName
from terrapin_hil.links.slcan import slcan_line, slcan_parse
from terrapin_hil.messages import Frame
from terrapin_hil.nodes import Node
from terrapin_tools.errors import UserError
from terrapin_tools.flash.wire import Wire, heard

__all__ = ["SerialWire", "open_serial", "open_wire"]

BAUD = 1_000_000  # of the F405's USART1
POLL = 0.01  # s of one read of a serial port


def open_serial(port: str, baud: int, **more: Any) -> Any:
    """A serial port (serial.Serial) for nobody else. UserError, status 1, when it cannot be had."""
    import serial

    try:
        return serial.Serial(port, baud, write_timeout=5, exclusive=True, **more)
    except (OSError, ValueError) as error:  # serial.SerialException is an OSError
        raise UserError(f"{port}: cannot open the serial port: {not_there(error)}", status=1) from None


class SerialWire(Wire):
    """SLCAN. Its acknowledgements are not waited for: the update has its own."""

    def __init__(self, port: str, baud: int = BAUD, node: int = 0) -> None:
        self.name = port
        self._node = Node(node)
        self._heard = heard()
        self._rest = b""
        self._port = open_serial(port, baud, timeout=POLL)
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

    def send_plain(self, frames: Sequence[Frame]) -> None:
        self._write(b"".join(slcan_line(self._node.to_bus(frame)) for frame in frames))

    def receive(self, wait: float) -> list[Frame]:
        end = time.monotonic() + wait
        found: list[Frame] = []
        while not found and time.monotonic() < end:
            try:
                data = self._port.read(1)
                data += self._port.read(self._port.in_waiting) if data else b""
            except OSError as error:
                raise self._lost(error) from None
            *lines, rest = (self._rest + data).replace(b"\a", b"\r").split(b"\r")
            self._rest = rest[-64:]  # what is longer is no SLCAN
            for line in lines:
                with suppress(ValueError):
                    own = self._node.from_bus(slcan_parse(line))
                    if own is not None and own[0] in self._heard:
                        found.append(own)
        return found

    def close(self) -> None:
        self._port.close()


def open_wire(link: LinkName, bit_rate: int = BIT_RATE) -> Wire:
    """What an update over the link travels on; `bit_rate` [bit/s] where the link's name has none."""
    if not link.interface:
        return SerialWire(link.channel, link.baud or BAUD, link.node)
    from terrapin_tools.flash.can_wire import CanWire  # python-can takes seconds

    return CanWire(link, bit_rate)
