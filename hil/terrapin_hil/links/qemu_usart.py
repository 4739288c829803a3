"""The STM32F405's image (firmware/ports/stm32f405) on QEMU's netduinoplus2, driven over its emulated USART1.

Unlike `qemu` (semihosting) the image runs on by its own clock, as on a board: bytes reach it at any moment. What it
answers in test mode is the same all the same.
"""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import socket
import subprocess
import time
from pathlib import Path

from terrapin_hil import paths
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.names import LinkName
from terrapin_hil.links.qemu import ANSWER_LIMIT, MACHINE, last_words
from terrapin_hil.links.slcan import SlcanPort
from terrapin_hil.links.wire import SlcanLink

__all__ = ["QemuUsart", "image", "open_link", "open_qemu_usart"]

BOOT_LIMIT = 20.0  # s until the image answers
ASK_EVERY = 0.05  # s: what comes before the image has opened its receiver is lost


def image(board: str = "emulated", place: str = "alone") -> Path:
    """An image of `make firmware`: board `emulated` or `f405-h-bridge`, place `alone`, `slot-a` or `slot-b`."""
    return paths.images() / f"terrapin-{board}-{place}.elf"


def _not_longer_than_us() -> list[str]:
    """What to put before a command that never ends by itself: a kill -9 of this program then ends it, too."""
    program = shutil.which("setpriv")
    return [program, "--pdeathsig", "KILL", "--"] if program else []  # of util-linux


class QemuUsart:
    """QEMU with an image whose USART1 is a socket of ours. LinkError when it does not start."""

    def __init__(self, program: Path | None = None) -> None:
        self._program = program or image()
        self._process: subprocess.Popen[bytes] | None = None
        if not self._program.is_file():
            raise LinkError(f"qemu-usart: no image {self._program}; run {paths.make('firmware')}")

    @property
    def pid(self) -> int | None:
        """Of the emulator, while it runs."""
        return self._process.pid if self._process is not None else None

    def start(self) -> SlcanPort:
        """Boot it; the open port."""
        if shutil.which("qemu-system-arm") is None:
            raise LinkError("qemu-usart: qemu-system-arm is not installed")
        ours, theirs = socket.socketpair()
        command = [*_not_longer_than_us(), "qemu-system-arm", "-M", MACHINE]
        command += ["-nodefaults", "-display", "none", "-monitor", "none"]
        command += ["-chardev", f"socket,id=usart1,fd={theirs.fileno()}", "-serial", "chardev:usart1"]
        command += ["-kernel", str(self._program)]
        try:
            with theirs:
                self._process = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.PIPE,
                    process_group=0,
                    pass_fds=(theirs.fileno(),),
                )
            ours.setblocking(False)
            self._await_boot(ours)
            descriptor = os.dup(ours.fileno())
            port = SlcanPort("qemu-usart", ANSWER_LIMIT, (descriptor, descriptor))
            port.begin()
        except BaseException:
            self.stop()
            raise
        finally:
            ours.close()
        return port

    def _await_boot(self, line: socket.socket) -> None:
        """Send empty lines until one is answered."""
        assert self._process is not None
        end = time.monotonic() + BOOT_LIMIT
        while time.monotonic() < end and self._process.poll() is None:
            with contextlib.suppress(OSError):  # not there yet, or no longer: told below
                line.send(b"\r")
                if select.select([line], [], [], ASK_EVERY)[0] and line.recv(64):
                    return
        raise LinkError(f"qemu-usart: the image does not answer{last_words(self._process)}")

    def stop(self) -> None:
        """End the emulator; the image itself never ends. Stopping twice is allowed."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            if self._process.stderr is not None:
                self._process.stderr.close()
            self._process = None


def open_qemu_usart(program: Path | None = None) -> SlcanLink:
    """The link, whose `machine` is a QemuUsart. LinkError when it cannot be opened."""
    machine = QemuUsart(program)
    return SlcanLink("qemu-usart", machine.start(), machine)


def open_link(name: LinkName, timeout: float) -> SlcanLink:
    """The link, which waits as long as an emulator needs. LinkError when it cannot be opened."""
    if name.node:
        raise LinkError(
            f"{name}: the image stands alone, without the records that would hold another node number than 0"
        )
    return open_qemu_usart()
