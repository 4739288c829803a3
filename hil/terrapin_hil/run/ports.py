"""Ports of a simulated bus that tools attach to: SLCAN on a pseudo-terminal, and buses of python-can."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import socket
import sys
import termios
import time
import tty
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import can

from terrapin_hil.errors import UserError
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.names import LinkName
from terrapin_hil.links.pythoncan import opened
from terrapin_hil.links.slcan import slcan_line, slcan_parse
from terrapin_hil.messages import Frame

__all__ = ["BusPort", "Port", "PtyPort", "open_port"]

DEAF = 2.0  # s without reading after which nothing is kept for who attached to a pseudo-terminal: stopped, or gone
OURS = "/dev/./"  # how the text of our links begins; others write /dev/
WAITING = 1 << 16  # bytes that wait for a client that is slow
Heard = Callable[["Port", Sequence[Frame]], None]


class Port(Protocol):
    """One place where tools attach. `attach`: what a command line says to do so. `lost`: frames that nobody took."""

    name: str
    attach: str
    lost: int

    def fileno(self) -> int: ...
    def send(self, frames: Sequence[Frame]) -> None:
        """Frames to who is attached; never waits for it."""

    def read(self, heard: Heard) -> None:
        """Gives what has come to `heard`, which may send to this port before it returns."""

    def close(self) -> None: ...


class _Link:
    """A fixed name for a pseudo-terminal. Whoever was killed leaves it behind, and the number of its terminal is soon
    another program's: that a terminal is there says nothing. So the living hold a socket that ends with them, and the
    link says by OURS that one of them made it. UserError where the name is another's; nothing of it is touched."""

    def __init__(self, path: Path, terminal: str) -> None:
        self._path = path
        self._text = terminal.replace("/dev/", OURS, 1)
        place = str(path.parent.resolve() / path.name)
        self._living = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._living.bind(b"\0terrapin-pty-" + hashlib.sha256(place.encode()).hexdigest().encode())
        except OSError:
            self._living.close()
            raise UserError(f"pty:{path}: a robot lives there already, expected a name that is free") from None
        try:
            if path.is_symlink() and (not path.exists() or os.readlink(path).startswith(OURS)):
                path.unlink()  # of one that was killed
            path.symlink_to(self._text)
        except OSError as error:
            self._living.close()
            raise UserError(f"pty:{path}: {error.strerror}, expected a name that is free") from None

    def close(self) -> None:
        with contextlib.suppress(OSError):
            if os.readlink(self._path) == self._text:
                self._path.unlink()
        self._living.close()


class PtyPort:
    """SLCAN on a pseudo-terminal that outlives its clients, one at a time."""

    def __init__(self, link: Path | None = None) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave, termios.TCSANOW)  # held open here: the terminal stays when a client goes
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self._link: _Link | None = None
        if link is not None:
            try:
                self._link = _Link(link, self.path)
            except UserError:
                self.close()
                raise
            self.path = str(link)
        self.name = f"pty:{self.path}"
        self.attach = f"serial:{self.path}"
        self.lost = 0
        self._open = False
        self._rest = b""
        self._waiting = bytearray()
        self._moved = time.monotonic()
        self._untaken = 0  # frames for which there was no room since then
        self._unread: int | None = None  # bytes that one who is deaf has before it

    def fileno(self) -> int:
        return self._master

    def _write(self, text: bytes = b"") -> bool:
        """Takes all of a text or, where too much waits already, nothing of it; writes what goes without waiting."""
        taken = len(self._waiting) + len(text) <= WAITING
        if taken:
            self._waiting += text
        try:
            done = os.write(self._master, self._waiting) if self._waiting else 0
        except BlockingIOError:
            done = 0
        if done:
            del self._waiting[:done]
        if done or not self._waiting:
            self._moved = time.monotonic()
            self.lost, self._untaken = self.lost + self._untaken, 0
        return taken

    def send(self, frames: Sequence[Frame]) -> None:
        if not self._open:
            return
        if self._unread is not None and self._before_it() >= max(self._unread, 1):
            # who has nothing before it has read: the kernel counts what was written some time after
            self._untaken += len(frames)
            return
        self._unread = None
        for frame in frames:
            if not self._write(slcan_line(frame)):
                self._untaken += 1
        if time.monotonic() - self._moved > DEAF:
            whole = self._waiting.find(b"\r") + 1  # part of it may be written
            self._untaken += self._waiting.count(b"\r", whole)
            del self._waiting[whole:]
            self._unread = self._before_it()

    def _before_it(self) -> int:
        """Bytes that nobody has read yet."""
        count = fcntl.ioctl(self._slave, termios.FIONREAD, bytes(4))
        return int.from_bytes(count, sys.byteorder)

    def _forget(self, closing: bool) -> None:
        """What was for somebody who is gone: nothing was lost to them, and nothing is the next one's. Who closes what
        is open is leaving, or is the next one, whose first word that is: who was killed did not close. A tool that
        opens again (an update, after each reset) keeps what is on its way to it."""
        if self._unread is not None or (closing and self._open):
            self._unread, self._untaken = None, 0
            self._waiting.clear()
            termios.tcflush(self._master, termios.TCOFLUSH)  # what the kernel has not brought yet
            termios.tcflush(self._slave, termios.TCIFLUSH)

    def read(self, heard: Heard) -> None:
        try:
            data = os.read(self._master, 65536)
        except BlockingIOError:
            return
        *lines, self._rest = (self._rest + data).split(b"\r")
        self._rest = self._rest[-64:]
        for line in lines:
            self._write(self._answer(line, heard))

    def _answer(self, line: bytes, heard: Heard) -> bytes:
        kind = line[:1]
        if kind == b"t":
            try:
                frame = slcan_parse(line)
            except ValueError:
                return b"\a"
            if not self._open:
                return b"\a"
            heard(self, [frame])
            return b"z\r"
        if kind in (b"O", b"C"):
            self._forget(kind == b"C")
            self._open = kind == b"O"
            self._moved = time.monotonic()
        answers = {b"V": b"V1013\r", b"N": b"NTSIM\r", b"F": b"F00\r"}
        return answers.get(kind, b"\r" if kind in (b"", b"O", b"C", b"S", b"s", b"Z", b"M", b"m", b"T") else b"\a")

    def close(self) -> None:
        for descriptor in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(descriptor)
        if self._link is not None:
            self._link.close()


class BusPort:
    """A bus of python-can, which any number of tools share."""

    def __init__(self, link: LinkName) -> None:
        self.name = self.attach = str(link)
        self._bus = opened(link, receive_own_messages=False)
        self.lost = 0

    def fileno(self) -> int:
        try:
            return int(self._bus.fileno())
        except (NotImplementedError, can.CanError):
            return -1

    def send(self, frames: Sequence[Frame]) -> None:
        for identifier, data in frames:
            try:
                self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False), timeout=0.0)
            except can.CanOperationError as error:
                if "buffer" in str(error).lower():  # full: nobody acknowledges, or all are slow
                    self.lost += 1
                    continue
                raise LinkError(f"{self.name}: the bus is gone: {_first(error)}") from None
            except (can.CanError, OSError) as error:
                raise LinkError(f"{self.name}: the bus is gone: {_first(error)}") from None

    def read(self, heard: Heard) -> None:
        try:
            while (message := self._bus.recv(0)) is not None:
                if not message.is_extended_id and not message.is_remote_frame and not message.is_error_frame:
                    heard(self, [(message.arbitration_id, bytes(message.data))])
        except (can.CanError, OSError) as error:
            raise LinkError(f"{self.name}: the bus is gone: {_first(error)}") from None

    def close(self) -> None:
        self._bus.shutdown()


def _first(error: Exception) -> str:
    return next(iter(str(error).splitlines()), "") or type(error).__name__


def open_port(name: str) -> Port:
    """`pty`, `pty:PATH` (a link to it), `socketcan:CHANNEL` or `can:INTERFACE:CHANNEL`. UserError or LinkError,
    one line, where it is none of these or does not open."""
    kind, _, rest = name.partition(":")
    if kind == "pty":
        return PtyPort(Path(rest) if rest else None)
    if kind not in ("socketcan", "can"):
        raise UserError(f"--on {name!r}: expected pty, pty:PATH, socketcan:CHANNEL or can:INTERFACE:CHANNEL")
    return BusPort(LinkName.parse(name, "listen"))
