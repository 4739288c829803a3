"""Listening to a bus: what python-can or a serial adapter receives, as blocks of frames."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Protocol

import can

from host_tools.errors import UserError
from host_tools.logs.frames import Frames, frames
from host_tools.logs.reading import message_flags
from host_tools.logs.slcan import SlcanBus

__all__ = ["LISTENABLE", "ListenedBus", "PythonCanBus", "open_bus", "receive"]

LISTENABLE = "socketcan:CHANNEL, serial:DEVICE, can:INTERFACE:CHANNEL"
MOST = 100_000  # frames of a block


class ListenedBus(Protocol):
    """An open bus. Failures are UserError (status 1): one line that names the bus."""

    channel_info: str
    damaged: int  # lines or frames that could not be read

    def receive(self, seconds: float) -> Frames: ...
    def send(self, identifier: int, data: bytes) -> None: ...
    def shutdown(self) -> None: ...


class PythonCanBus:
    """A bus of any of python-can's interfaces."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self.channel_info = bus.channel_info
        self.damaged = 0

    def receive(self, seconds: float) -> Frames:
        """What comes within `seconds`; what came before the bus went away is not lost."""
        end = time.monotonic() + seconds
        times: list[float] = []
        names: list[int] = []
        payloads: list[bytes] = []
        flags: list[int] = []
        try:
            while (left := end - time.monotonic()) > 0 and len(times) < MOST:
                message = self._bus.recv(left)
                if message is None:
                    continue
                times.append(message.timestamp)
                names.append(message.arbitration_id)
                payloads.append(b"" if message.is_remote_frame else bytes(message.data))
                flags.append(message_flags(message))
        except (can.CanError, OSError, ValueError, TypeError) as error:
            if not times:  # else the next call finds it gone
                raise UserError(f"{self.channel_info}: the bus went away ({error})", status=1) from None
        return frames(Path("bus"), times, names, payloads, flags)

    def send(self, identifier: int, data: bytes) -> None:
        """One frame with an 11-bit identifier."""
        try:
            self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False), timeout=0.2)
        except (can.CanError, OSError) as error:
            raise UserError(f"{self.channel_info}: cannot send: {error}", status=1) from None

    def shutdown(self) -> None:
        """Lets go of the bus."""
        self._bus.shutdown()


def open_bus(link: str, bitrate: int = 500_000) -> ListenedBus:
    """A bus by its link name (see LISTENABLE). UserError when there is none, or it cannot be opened (status 1)."""
    kind, _, where = link.partition(":")
    interface, channel = (kind, where) if kind == "socketcan" else (where.partition(":")[0], where.partition(":")[2])
    if kind not in ("socketcan", "serial", "can") or not where or (kind == "can" and not (interface and channel)):
        raise UserError(f"--link: found {link!r}, expected one of {LISTENABLE}")
    if kind == "serial":
        return SlcanBus(where, bitrate)
    try:
        return PythonCanBus(can.Bus(interface=interface, channel=channel, bitrate=bitrate))
    except Exception as error:  # each adapter's driver has its own way of not being there
        reason = next(iter(str(error).splitlines()), "") or type(error).__name__
        raise UserError(f"{link}: cannot open the bus: {reason}", status=1) from None


def receive(bus: ListenedBus, seconds: float) -> Frames:
    """What comes within `seconds`. UserError (status 1) when the bus goes away."""
    return bus.receive(seconds)
