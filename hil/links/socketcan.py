"""SocketCAN by raw sockets of our own: one call of the system to send the two frames of a tick, two to receive.

The kernel passes on only what the controller sends (filters), and error frames, which end a run in one line.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import select
import socket
import struct
import time
from collections.abc import Sequence

from hil.links.bus import BusLink
from hil.links.slcan import LinkError
from hil.messages import Frame, interface

__all__ = ["SocketCan", "open_socketcan"]

_FRAME = struct.Struct("=IB3x8s")  # struct can_frame: identifier and flags, length, data
_TIME = struct.Struct("@ll")  # struct timeval
# linux/can.h, linux/can/error.h
ERROR, EXTENDED, REMOTE = 0x20000000, 0x80000000, 0x40000000
BUS_OFF = 0x40
RAW_ERROR_FILTER = 2  # linux/can/raw.h; the socket module has no name for it
STANDARD = 0x7FF
MOST = 16  # frames sent in one call


class _Place(ctypes.Structure):
    """struct iovec"""

    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


class _Header(ctypes.Structure):
    """struct mmsghdr"""

    _fields_ = (
        *(("name", ctypes.c_void_p), ("name_length", ctypes.c_uint32)),
        *(("place", ctypes.POINTER(_Place)), ("places", ctypes.c_size_t)),
        *(("control", ctypes.c_void_p), ("control_length", ctypes.c_size_t)),
        *(("flags", ctypes.c_int), ("sent", ctypes.c_uint)),
    )


class SocketCan:
    """An open raw socket (see hil.links.bus.Bus). LinkError when the interface is not there or not up."""

    def __init__(self, channel: str, timeout: float = 2.0) -> None:
        self.name = f"socketcan:{channel}"
        self._timeout = timeout
        if not hasattr(socket, "AF_CAN"):
            raise LinkError(f"{self.name}: cannot open the link: this system has no SocketCAN")
        try:
            self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        except OSError as error:
            raise LinkError(f"{self.name}: cannot open the link: {error.strerror}") from None
        own = sorted(m.id for m in interface().messages.values() if m.sender == "controller")
        filters = b"".join(struct.pack("=II", name, STANDARD | EXTENDED | REMOTE) for name in own)
        seconds = _TIME.pack(int(timeout), int(timeout % 1 * 1e6))
        try:
            self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
            self._socket.setsockopt(socket.SOL_CAN_RAW, RAW_ERROR_FILTER, BUS_OFF)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, seconds)
            self._socket.bind((channel,))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{self.name}: cannot open the link: {error.strerror or error}") from None
        self._prepare()
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def _prepare(self) -> None:
        """Memory for sendmmsg, which Python's socket module lacks: the frames of a tick go out in one call, and the
        other side wakes up once."""
        self._sendmmsg = ctypes.CDLL(None, use_errno=True).sendmmsg
        self._sendmmsg.argtypes = [ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int]
        self._bytes = ctypes.create_string_buffer(MOST * _FRAME.size)
        self._places = (_Place * MOST)()
        self._headers = (_Header * MOST)()
        for i in range(MOST):
            self._places[i] = _Place(ctypes.addressof(self._bytes) + i * _FRAME.size, _FRAME.size)
            self._headers[i].place = ctypes.pointer(self._places[i])
            self._headers[i].places = 1

    def send(self, frames: Sequence[Frame]) -> None:
        for first in range(0, len(frames), MOST):
            piece = frames[first : first + MOST]
            for i, (identifier, data) in enumerate(piece):
                _FRAME.pack_into(self._bytes, i * _FRAME.size, identifier, len(data), data)
            self._send_packed(len(piece))

    def _send_packed(self, count: int) -> None:
        done, end = 0, 0.0
        while True:
            sent = self._sendmmsg(
                self._socket.fileno(), ctypes.byref(self._headers[done]), count - done, socket.MSG_DONTWAIT
            )
            done += max(sent, 0)
            if done == count:
                return
            error = ctypes.get_errno()
            # The queue is full: nobody acknowledges, or others keep the bus busy. There is no event to wait for.
            if sent < 0 and error not in (errno.ENOBUFS, errno.EAGAIN):
                raise self._lost(OSError(error, os.strerror(error)))
            now = time.monotonic()
            end = end or now + self._timeout
            if now > end:
                raise LinkError(f"{self.name}: the bus takes no frame for {self._timeout:g} s (nobody acknowledges?)")
            time.sleep(0.0002)

    def receive(self, wait: float) -> Frame | None:
        # The socket's own time limit serves the usual wait; any other needs poll.
        if wait != self._timeout and not self._poll.poll(max(0, round(wait * 1000 + 0.499))):
            return None
        try:
            identifier, length, data = _FRAME.unpack(self._socket.recv(_FRAME.size))
        except BlockingIOError:
            return None
        except OSError as error:
            raise self._lost(error) from None
        if identifier & ERROR:
            raise LinkError(f"{self.name}: bus-off")
        return identifier, data[:length]

    def _lost(self, error: OSError) -> LinkError:
        if error.errno in (errno.ENODEV, errno.ENXIO, errno.ENETDOWN, errno.EBADF):
            return LinkError(f"{self.name}: the link disappeared ({error.strerror})")
        return LinkError(f"{self.name}: {error.strerror or error}")

    def close(self) -> None:
        with contextlib.suppress(KeyError):
            self._poll.unregister(self._socket)
        self._socket.close()


def open_socketcan(channel: str, timeout: float = 2.0) -> BusLink:
    """Link over an interface that is up. LinkError when it does not open."""
    return BusLink(SocketCan(channel, timeout), timeout)
