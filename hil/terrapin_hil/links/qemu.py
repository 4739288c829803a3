"""The controller on an emulated Cortex-M4 (firmware/ports/qemu): its ARM image in QEMU, SLCAN over two named pipes."""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from terrapin_hil import paths
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.names import LinkName
from terrapin_hil.links.slcan import SlcanPort
from terrapin_hil.links.wire import SlcanLink

__all__ = ["Instructions", "QemuMachine", "image", "last_words", "open_link", "open_qemu"]

MACHINE = "netduinoplus2"  # an STM32F405
START_LIMIT = 20.0  # s until the image has opened its pipes
ANSWER_LIMIT = 10.0  # s for an answer: an emulator on a busy machine


def image() -> Path:
    """The image that `make firmware` builds."""
    return paths.images() / "terrapin-qemu.elf"


@dataclass(frozen=True)
class Instructions:
    """Of the steps of a run, on the emulated Cortex-M4."""

    steps: int
    minimum: int
    median: int
    maximum: int


def last_words(process: subprocess.Popen[bytes]) -> str:
    """What QEMU said last, when it has ended; nothing while it runs."""
    if process.poll() is None or process.stderr is None:
        return ""
    words = process.stderr.read().decode(errors="replace").strip().splitlines()
    return f" (status {process.returncode}{': ' + words[-1] if words else ''})"


class QemuMachine:
    """QEMU with an image, and its pipes. LinkError when it does not start.

    Known after `stop`: `stack`, bytes of stack that the run took; with `count` (about a third as fast) also
    `instructions`, of `step`, `step-without-telemetry` and `frame` (taking in one frame).
    """

    def __init__(self, program: Path | None = None, count: bool = False, node: int = 0) -> None:
        self._node = node
        self._program = program or image()
        self._count = count
        self.stack: int | None = None
        self.instructions: dict[str, Instructions] = {}
        if not self._program.is_file():
            raise LinkError(f"qemu: no image {self._program}; run {paths.make('firmware')}")
        self._folder = tempfile.TemporaryDirectory(prefix="terrapin-qemu-")
        self._process: subprocess.Popen[bytes] | None = None
        self._rest = -1  # of the image's last words

    @property
    def folder(self) -> Path:
        """Where its pipes are, until it has ended."""
        return Path(self._folder.name)

    @property
    def pid(self) -> int | None:
        """Of the emulator, while it runs."""
        return self._process.pid if self._process is not None else None

    def start(self) -> SlcanPort:
        """Boot it; the open port."""
        source, sink = (str(self.folder / name) for name in ("in", "out"))
        for pipe in (source, sink):
            os.mkfifo(pipe, 0o600)
        arguments = f"enable=on,target=native,arg=terrapin,arg={source},arg={sink},arg=node,arg={self._node}"
        arguments += ",arg=count" if self._count else ""
        command = ["qemu-system-arm", "-M", MACHINE, "-nodefaults", "-display", "none", "-serial", "none"]
        command += ["-monitor", "none", "-semihosting-config", arguments, "-kernel", str(self._program)]
        if self._count:
            command += ["-icount", "shift=7,sleep=off"]
        # Held open for writing as well, so that the pipe has no end before the image has opened it.
        reading = os.open(sink, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        keeper = os.open(sink, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        writing = -1
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, process_group=0
            )
            writing = self._writing(source)
            self._rest = os.dup(reading)
            port = SlcanPort("qemu", ANSWER_LIMIT, (reading, writing))
            port.begin()
        except FileNotFoundError:
            self._abandon(reading, writing)
            raise LinkError("qemu: qemu-system-arm is not installed") from None
        except LinkError:
            self.stop()
            raise
        finally:
            os.close(keeper)
        return port

    def _writing(self, source: str) -> int:
        """The pipe to the image, once that has opened its end."""
        assert self._process is not None
        end = time.monotonic() + START_LIMIT
        while time.monotonic() < end and self._process.poll() is None:
            try:
                return os.open(source, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            except OSError:  # nobody reads yet
                time.sleep(0.01)
        raise LinkError(f"qemu: the image did not start{last_words(self._process)}")

    def _abandon(self, *descriptors: int) -> None:
        for descriptor in descriptors:
            if descriptor >= 0:
                os.close(descriptor)
        self._folder.cleanup()

    def stop(self) -> int:
        """Wait until the image has ended, which it does when its port is closed; its exit status."""
        status = 0
        if self._process is not None:
            try:
                status = self._process.wait(5)
            except subprocess.TimeoutExpired:
                self._process.kill()
                status = self._process.wait()
            if self._process.stderr is not None:
                self._process.stderr.close()
            self._process = None
        if self._rest >= 0:
            words = b""
            os.set_blocking(self._rest, False)
            try:
                while piece := os.read(self._rest, 65536):
                    words = (words + piece)[-512:]
            except BlockingIOError:
                pass
            os.close(self._rest)
            self._rest = -1
            self._note(words.decode("ascii", "replace"))
        self._folder.cleanup()
        return status

    def _note(self, words: str) -> None:
        """The image's last lines."""
        found = re.search(r"stack (\d+)\n", words)
        self.stack = int(found[1]) if found else None
        if self._count:
            for name, *numbers in re.findall(r"(step\S*|frame) (\d+) (\d+) (\d+) (\d+)\n", words):
                self.instructions[name] = Instructions(*map(int, numbers))


def open_qemu(program: Path | None = None, count: bool = False, node: int = 0) -> SlcanLink:
    """The link, whose `machine` is a QemuMachine. LinkError when it cannot be opened."""
    machine = QemuMachine(program, count, node)
    return SlcanLink("qemu", machine.start(), machine, node)


def open_link(name: LinkName, timeout: float) -> SlcanLink:
    """The link, which waits as long as an emulator needs. LinkError when it cannot be opened."""
    return open_qemu(node=name.node)
