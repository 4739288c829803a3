"""Several CAN frames in one call of the system: recvmmsg and sendmmsg of Linux, which Python's socket module lacks."""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Sequence
from functools import cache
from typing import Any

from terrapin_hil.messages import Frame

__all__ = ["MOST", "FrameBatch"]

MOST = 16  # frames in one call
_FRAME = struct.Struct("=IB3x8s")  # linux/can.h, struct can_frame: identifier and flags, length, data
DO_NOT_WAIT, WAIT_FOR_ONE = 0x40, 0x10000  # sys/socket.h: MSG_DONTWAIT, MSG_WAITFORONE


class _Place(ctypes.Structure):
    """struct iovec"""

    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


class _Message(ctypes.Structure):
    """struct msghdr"""

    _fields_ = (
        *(("name", ctypes.c_void_p), ("name_length", ctypes.c_uint32)),
        *(("place", ctypes.POINTER(_Place)), ("places", ctypes.c_size_t)),
        *(("control", ctypes.c_void_p), ("control_length", ctypes.c_size_t)),
        ("flags", ctypes.c_int),
    )


class _Header(ctypes.Structure):
    """struct mmsghdr: the message keeps its padding, which fields in one row would use up."""

    _fields_ = (("message", _Message), ("length", ctypes.c_uint))


@cache
def _system() -> Any:
    system = ctypes.CDLL(None, use_errno=True)
    system.sendmmsg.argtypes = [ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int]
    system.recvmmsg.argtypes = [*system.sendmmsg.argtypes, ctypes.c_void_p]
    return system


def _failure() -> OSError:
    number = ctypes.get_errno()
    return OSError(number, os.strerror(number))


class FrameBatch:
    """Memory for the frames of one call, and the calls. OSError as the system gives it; a frame is 16 bytes there."""

    def __init__(self) -> None:
        self._bytes = ctypes.create_string_buffer(MOST * _FRAME.size)
        self._places = (_Place * MOST)()
        self._headers = (_Header * MOST)()
        for i in range(MOST):
            self._places[i] = _Place(ctypes.addressof(self._bytes) + i * _FRAME.size, _FRAME.size)
            self._headers[i].message.place = ctypes.pointer(self._places[i])
            self._headers[i].message.places = 1

    def pack(self, frames: Sequence[Frame]) -> None:
        """At most MOST frames, for `send`."""
        for i, (identifier, data) in enumerate(frames):
            _FRAME.pack_into(self._bytes, i * _FRAME.size, identifier, len(data), data)

    def send(self, descriptor: int, first: int, count: int) -> int:
        """How many of the `count` packed frames from `first` on the system took; it does not wait."""
        sent: int = _system().sendmmsg(descriptor, ctypes.byref(self._headers[first]), count, DO_NOT_WAIT)
        if sent < 0:
            raise _failure()
        return sent

    def receive(self, descriptor: int) -> list[Frame]:
        """The frames that are there, at most MOST, identifiers with their flags; it waits for the first only."""
        while (count := _system().recvmmsg(descriptor, self._headers, MOST, WAIT_FOR_ONE, None)) < 0:
            error = _failure()
            if not isinstance(error, InterruptedError):
                raise error
        taken = memoryview(self._bytes)[: count * _FRAME.size]
        return [(identifier, data[:length]) for identifier, length, data in _FRAME.iter_unpack(taken)]
