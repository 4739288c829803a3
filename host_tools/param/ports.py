"""Ways to a controller that is not driven in lockstep: frames go out, the answers to them come back.

Nothing here arms test mode or resets the controller: it may be running.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from hil.firmware import Firmware
from hil.links import LINKS, check_link_name
from hil.links.slcan import ControllerProcess, SlcanPort, slcan_line
from hil.messages import Frame
from host_tools.errors import UserError

if TYPE_CHECKING:
    from hil.links.pythoncan import PythonCan

__all__ = ["FLASH_LINKS", "CanPort", "HostFirmware", "Port", "SerialPort", "open_port"]

FLASH_LINKS = ("inprocess", "pty")  # those whose flash is a file of ours
FLASH_SIZE = 32768  # bytes, of ports/host/flash_file.h


class Port(Protocol):
    """One controller. `name` is that of the link."""

    name: str

    def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        """Sends `frame`; the first answer that is `wanted`, None when none comes in time. LinkError."""


def _no_flash(path: Path) -> UserError:
    return UserError(f"{path}: not a file of flash: expected one of {FLASH_SIZE} bytes, or none yet")


class HostFirmware:
    """The firmware of this build, in this process, as it stands after a reset; its flash is a file."""

    name = "inprocess"

    def __init__(self, flash: Path | None, firmware: Firmware | None = None) -> None:
        self._firmware = firmware or Firmware.open()
        self._lib, self._ffi = self._firmware.lib, self._firmware.ffi
        self._state = self._firmware.new_state()
        self._link = self._ffi.new("terrapin_link *")
        self._inputs = self._ffi.new("terrapin_inputs *")
        self._reply = self._ffi.new("terrapin_frame *")
        self._lib.terrapin_link_init(self._link, self._state, self._inputs)
        self._file: Any = None
        if flash is not None:
            self._open_flash(flash)

    def _open_flash(self, path: Path) -> None:
        import errno
        import os

        file = self._ffi.new("terrapin_flash_file *")
        error = self._lib.terrapin_flash_file_open(file, os.fsencode(path))
        if error == errno.EINVAL:
            raise _no_flash(path)
        if error == errno.EWOULDBLOCK:
            raise UserError(f"{path}: another controller uses it")
        if error:
            raise UserError(f"{path}: {os.strerror(error)}")
        self._file = file
        self._store = self._ffi.new("terrapin_store *")
        self._lib.terrapin_store_open(self._store, self._ffi.addressof(file, "flash"), file.pages)
        self._lib.terrapin_link_use_store(self._link, self._state, self._store)

    def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        sent = self._ffi.new("terrapin_frame *", {"id": frame[0], "length": len(frame[1]), "data": frame[1]})
        result = self._lib.terrapin_accept(self._link, self._state, sent, self._inputs, self._reply)
        self._lib.terrapin_link_store_work(self._link, self._state)
        if result != self._lib.TERRAPIN_ACCEPT_REPLY:
            return None
        reply = self._reply
        answer = (int(reply.id), bytes(reply.data[0 : reply.length]))
        return answer if wanted(answer) else None

    def close(self) -> None:
        """Lets go of the file."""
        if self._file is not None:
            self._lib.terrapin_flash_file_close(self._file)


class SerialPort:
    """A controller that speaks SLCAN."""

    def __init__(self, name: str, port: SlcanPort) -> None:
        self.name = name
        self._port = port

    def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        answers = [answer for answer in self._port.exchange(slcan_line(frame)) if wanted(answer)]
        return answers[-1] if answers else None


class CanPort:
    """A controller on a bus that python-can knows."""

    def __init__(self, bus: PythonCan, timeout: float) -> None:
        self.name = bus.name
        self._bus = bus
        self._timeout = timeout

    def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        end = time.monotonic() + self._timeout
        self._bus.send([frame])
        while (left := end - time.monotonic()) > 0:
            for answer in self._bus.receive(left):
                if wanted(answer):
                    return answer
        return None


@contextlib.contextmanager
def open_port(name: str, flash: Path | None, timeout: float) -> Iterator[Port]:
    """The controller at the link `name` (see hil.links). LinkNameError, LinkError, UserError."""
    kind, where = check_link_name(name)
    if flash is not None and kind not in FLASH_LINKS:
        raise UserError(f"--flash: {name} keeps its parameters itself; a file is for {' and '.join(FLASH_LINKS)}")
    with contextlib.ExitStack() as stack:
        if kind == "inprocess":
            host = HostFirmware(flash)
            stack.callback(host.close)
            yield host
        elif kind in ("pty", "serial"):
            if kind == "pty":
                if flash is not None and flash.exists() and flash.stat().st_size not in (0, FLASH_SIZE):
                    raise _no_flash(flash)
                arguments = ["--flash", str(flash)] if flash is not None else []
                where = stack.enter_context(ControllerProcess(arguments=arguments))
            port = SlcanPort.open(where, timeout)
            stack.callback(port.close)
            yield SerialPort(name, port)
        elif kind in ("can", "socketcan"):
            interface, channel = ("socketcan", where) if kind == "socketcan" else where.split(":", 1)
            from hil.links.pythoncan import PythonCan

            bus = PythonCan(interface, channel, timeout)
            stack.callback(bus.close)
            yield CanPort(bus, timeout)
        else:
            raise UserError(f"--link: {name} keeps no parameters; expected one of {LINKS} but {kind}")
