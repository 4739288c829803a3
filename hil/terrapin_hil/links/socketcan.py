"""SocketCAN by raw sockets of our own: one call of the system to send the frames of a tick, one to receive them.

The kernel passes on only what the controller sends (filters), and error frames, which end a run in one line.
"""

from __future__ import annotations

import contextlib
import errno
import select
import socket
import struct
import time
from collections.abc import Sequence

from terrapin_hil.links.bus import BusLink
from terrapin_hil.links.frame_batch import MOST, FrameBatch
from terrapin_hil.links.link import LinkError, not_there
from terrapin_hil.links.names import LinkName
from terrapin_hil.messages import Frame
from terrapin_hil.nodes import Node

__all__ = ["SocketCan", "open_link"]

_TIME = struct.Struct("@ll")  # struct timeval
# linux/can.h, linux/can/error.h
ERROR, EXTENDED, REMOTE = 0x20000000, 0x80000000, 0x40000000
BUS_OFF = 0x40
RAW_ERROR_FILTER = 2  # linux/can/raw.h; the socket module has no name for it
STANDARD = 0x7FF


class SocketCan:
    """An open raw socket (see terrapin_hil.links.bus.Bus). LinkError when the interface is not there or not up."""

    def __init__(self, link: LinkName, timeout: float = 2.0) -> None:
        self.name = str(link)
        self._timeout = timeout
        if not hasattr(socket, "AF_CAN"):
            raise LinkError(f"{self.name}: cannot open the link: this system has no SocketCAN")
        try:
            self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        except OSError as error:
            raise LinkError(f"{self.name}: cannot open the link: {not_there(error)}") from None
        self._node = Node(link.node)
        mask = STANDARD | EXTENDED | REMOTE
        filters = b"".join(struct.pack("=II", name, mask) for name in self._node.answers)
        seconds = _TIME.pack(int(timeout), int(timeout % 1 * 1e6))
        try:
            self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
            self._socket.setsockopt(socket.SOL_CAN_RAW, RAW_ERROR_FILTER, BUS_OFF)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, seconds)
            self._socket.bind((link.channel,))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{self.name}: cannot open the link: {not_there(error)}") from None
        self._out, self._in = FrameBatch(), FrameBatch()
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def send(self, frames: Sequence[Frame]) -> None:
        for first in range(0, len(frames), MOST):
            piece = [self._node.to_bus(frame) for frame in frames[first : first + MOST]]
            self._out.pack(piece)
            self._send_packed(len(piece))

    def _send_packed(self, count: int) -> None:
        done, end = 0, 0.0
        while True:
            try:
                done += self._out.send(self._socket.fileno(), done, count - done)
            except OSError as error:
                # The queue is full: nobody acknowledges, or others keep the bus busy. There is no event to wait for.
                if error.errno not in (errno.ENOBUFS, errno.EAGAIN, errno.EINTR):
                    raise self._lost(error) from None
            if done == count:
                return
            now = time.monotonic()
            end = end or now + self._timeout
            if now > end:
                raise LinkError(f"{self.name}: the bus takes no frame for {self._timeout:g} s (nobody acknowledges?)")
            time.sleep(0.0002)

    def receive(self, wait: float) -> list[Frame]:
        # The socket's own time limit serves the usual wait; any other needs poll.
        if wait != self._timeout and not self._poll.poll(max(0, round(wait * 1000 + 0.499))):
            return []
        try:
            frames = self._in.receive(self._socket.fileno())
        except BlockingIOError:
            return []
        except OSError as error:
            raise self._lost(error) from None
        if any(identifier & ERROR for identifier, _ in frames):
            raise LinkError(f"{self.name}: bus-off")
        return [own for frame in frames if (own := self._node.from_bus(frame)) is not None]

    def _lost(self, error: OSError) -> LinkError:
        reason = error.strerror or str(error)
        if error.errno in (errno.ENODEV, errno.ENXIO, errno.ENETDOWN, errno.EBADF):
            return LinkError(f"{self.name}: the link disappeared ({reason})")
        return LinkError(f"{self.name}: {reason}")

    def close(self) -> None:
        with contextlib.suppress(KeyError):
            self._poll.unregister(self._socket)
        self._socket.close()


def open_link(name: LinkName, timeout: float) -> BusLink:
    """Link over an interface that is up. LinkError when it does not open."""
    return BusLink(SocketCan(name, timeout), timeout)
