"""Listening to a bus: what python-can or a serial adapter receives, as blocks of frames."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from socket import SO_RCVBUF, SOL_SOCKET
from socket import socket as Socket
from typing import Protocol

import can

from terrapin_hil.links.names import BIT_RATE, LinkName
from terrapin_hil.links.pythoncan import opened
from terrapin_tools.errors import UserError
from terrapin_tools.logs.formats.source import message_flags
from terrapin_tools.logs.frames import Frames, frames
from terrapin_tools.logs.slcan import SlcanBus

__all__ = ["ListenedBus", "PythonCanBus", "open_bus"]

MOST = 100_000  # frames of a block
QUEUE = 8 << 20  # bytes
RECEIVE_BUFFER_FORCE, MEMORY = 33, 55  # asm-generic/socket.h: SO_RCVBUFFORCE, SO_MEMINFO
DROPS = 8  # linux/sock_diag.h, SK_MEMINFO_DROPS


def enlarge(socket: Socket) -> None:
    """A queue for a second of a full bus, as far as the system lets us."""
    try:
        socket.setsockopt(SOL_SOCKET, RECEIVE_BUFFER_FORCE, QUEUE)
    except PermissionError:
        socket.setsockopt(SOL_SOCKET, SO_RCVBUF, QUEUE)  # held within net.core.rmem_max


def socket_drops(socket: Socket) -> int:
    """Messages that a socket's queue had no place for."""
    try:
        memory = socket.getsockopt(SOL_SOCKET, MEMORY, 64)
    except OSError:
        return 0
    return int.from_bytes(memory[4 * DROPS : 4 * DROPS + 4], sys.byteorder)


class ListenedBus(Protocol):
    """An open bus. Failures are UserError (status 1): one line that names the bus."""

    channel_info: str
    damaged: int  # lines or frames that could not be read

    @property
    def lost(self) -> int:
        """Frames that the system had no place for until they were asked for; 0 where it does not say."""

    def receive(self, seconds: float) -> Frames: ...
    def send(self, identifier: int, data: bytes) -> None: ...
    def shutdown(self) -> None: ...


class PythonCanBus:
    """A bus of any of python-can's interfaces."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self.channel_info = bus.channel_info
        self.damaged = 0
        self._gone: Exception | None = None
        found = getattr(bus, "socket", None)  # SocketCAN's
        self._socket = found if isinstance(found, Socket) else None
        if self._socket is not None:
            enlarge(self._socket)

    @property
    def lost(self) -> int:
        """Of SocketCAN only: other interfaces of python-can do not say."""
        return 0 if self._socket is None else socket_drops(self._socket)

    def receive(self, seconds: float) -> Frames:
        """What comes within `seconds`; what came before the bus went away is not lost."""
        end = time.monotonic() + seconds
        came: list[can.Message] = []
        while (left := end - time.monotonic()) > 0 and len(came) < MOST:
            try:
                message = self._bus.recv(0.0 if self._gone else left)
            except (can.CanError, OSError, ValueError, TypeError) as error:
                if self._gone is not None:
                    break
                self._gone = error  # SocketCAN says it once, and before the frames that still wait
                continue
            if message is not None:
                came.append(message)
            elif self._gone is not None:
                break
        if self._gone is not None and not came:
            raise UserError(f"{self.channel_info}: the bus went away ({self._gone})", status=1)
        payloads = [b"" if message.is_remote_frame else bytes(message.data) for message in came]
        names = [message.arbitration_id for message in came]
        return frames(Path("bus"), [m.timestamp for m in came], names, payloads, [message_flags(m) for m in came])

    def send(self, identifier: int, data: bytes) -> None:
        """One frame with an 11-bit identifier."""
        try:
            self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False), timeout=0.2)
        except (can.CanError, OSError) as error:
            raise UserError(f"{self.channel_info}: cannot send: {error}", status=1) from None

    def shutdown(self) -> None:
        """Lets go of the bus."""
        self._bus.shutdown()


def open_bus(link: LinkName, bitrate: int = BIT_RATE) -> ListenedBus:
    """A bus that can be listened to, by its name. LinkError or UserError (status 1) when it cannot be opened."""
    return PythonCanBus(opened(link, bitrate)) if link.interface else SlcanBus(link, bitrate)
