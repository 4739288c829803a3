"""What the tests inside the sandbox share: interfaces, simulated lines, the controller, frames by hand."""

from __future__ import annotations

import contextlib
import os
import re
import select
import signal
import socket
import struct
import subprocess
import threading
import time
import tty
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from terrapin_hil import paths
from terrapin_hil.messages import Frame, Sender, interface

PROGRAM = paths.build() / "terrapin-controller"
CONFIGFS = Path("/sys/kernel/config/gpio-sim")
FRAME = struct.Struct("=IB3x8s")
ERROR_FLAG = 0x20000000
BOUND = 100.0  # s of the guest, after which something hangs


def shell(*command: str) -> str:
    """A command's output. AssertionError with its words when it fails."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}: {done.stderr}"
    return done.stdout


@contextlib.contextmanager
def vcan(name: str = "vcan0") -> Iterator[str]:
    """A virtual bus that is up."""
    shell("ip", "link", "add", "dev", name, "type", "vcan")
    shell("ip", "link", "set", name, "up")
    try:
        yield name
    finally:
        subprocess.run(["ip", "link", "del", name], check=False, capture_output=True)


class Lines:
    """A chip of gpio-sim with named lines: `pull` drives an input, `value` reads an output."""

    def __init__(self, *names: str, label: str = "terrapin") -> None:
        self._folder = CONFIGFS / label
        bank = self._folder / "bank0"
        bank.mkdir(parents=True)
        (bank / "num_lines").write_text(f"{len(names)}\n")
        self._offset = {name: i for i, name in enumerate(names)}
        for name, i in self._offset.items():
            (bank / f"line{i}").mkdir()
            (bank / f"line{i}" / "name").write_text(f"{name}\n")
        (self._folder / "live").write_text("1\n")
        device = (self._folder / "dev_name").read_text().strip()
        self.chip = (bank / "chip_name").read_text().strip()
        self._lines = Path("/sys/devices/platform") / device / self.chip

    def _path(self, name: str, attribute: str) -> Path:
        return self._lines / f"sim_gpio{self._offset[name]}" / attribute

    def pull(self, name: str, high: bool) -> None:
        self._path(name, "pull").write_text("pull-up" if high else "pull-down")

    def value(self, name: str) -> bool:
        return self._path(name, "value").read_text().strip() == "1"

    def close(self) -> None:
        (self._folder / "live").write_text("0\n")
        for i in self._offset.values():
            (self._folder / "bank0" / f"line{i}").rmdir()
        (self._folder / "bank0").rmdir()
        self._folder.rmdir()


@contextlib.contextmanager
def lines(*names: str) -> Iterator[Lines]:
    chip = Lines(*names)
    try:
        yield chip
    finally:
        chip.close()


@contextlib.contextmanager
def wired(pairs: Mapping[Callable[[], bool], Callable[[bool], None]]) -> Iterator[None]:
    """Wires between lines: what the first of a pair reads, the second drives, some hundred times a second."""
    stop = threading.Event()

    def run() -> None:
        last: dict[Callable[[], bool], bool] = {}
        while not stop.is_set():
            for read, drive in pairs.items():
                if (now := read()) is not last.get(read):
                    drive(now)
                    last[read] = now
            time.sleep(0.001)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


class Controller:
    """The controller's process; what it says is in `text` after `stop`."""

    def __init__(self, *options: str) -> None:
        self._words = os.memfd_create("words")
        self.process = subprocess.Popen([str(PROGRAM), *options], stderr=self._words, stdout=subprocess.PIPE, text=True)
        self.text = ""

    def said(self) -> str:
        return os.pread(self._words, 1 << 20, 0).decode()

    def send_signal(self, number: int) -> None:
        self.process.send_signal(number)

    def report(self) -> str:
        """Its counts now (SIGUSR1)."""
        before = self.said().count(" steps;")
        self.send_signal(signal.SIGUSR1)
        wait_for(lambda: self.said().count(" steps;") > before, "its report")
        return self.said()

    def stop(self, number: int = signal.SIGTERM) -> int:
        if self.process.poll() is None:
            self.process.send_signal(number)
        status = self.process.wait(10)
        self.text = self.said()
        return status

    def __enter__(self) -> Controller:
        wait_for(lambda: "ready on" in self.said() or self.process.poll() is not None, "its start")
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        if self.process.stdout is not None:
            self.process.stdout.close()
        self.text = self.said()
        os.close(self._words)


class Cable:
    """Two masters of ptys back to back; with one alone what comes is thrown away."""

    def __init__(self, one: int, other: int | None) -> None:
        self._stop = threading.Event()
        self._ends = {one: other} | ({other: one} if other is not None else {})
        for end in self._ends:
            os.set_blocking(end, False)
            tty.setraw(end)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        poll = select.poll()
        for end in self._ends:
            poll.register(end, select.POLLIN)
        while not self._stop.is_set():
            for end, _ in poll.poll(50):
                with contextlib.suppress(OSError):
                    data = os.read(end, 4096)
                    other = self._ends[end]
                    while data and other is not None:
                        data = data[os.write(other, data) :]

    def close(self) -> None:
        self._stop.set()
        self._thread.join()


def count(text: str, words: str) -> int:
    """The number before `words` in the last line of a report that has them.

    >>> count("a: 3 sent, 4 not sent", "not sent")
    4
    """
    return int(re.findall(rf"(\d+) {re.escape(words)}", text)[-1])


def wait_for(condition: Callable[[], bool], what: str, seconds: float = BOUND) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds:g} s: {what}"
        time.sleep(0.002)


class Peer:
    """The other side of a bus, with a raw socket: sends commands, hears what the controller says."""

    def __init__(self, channel: str = "vcan0") -> None:
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._socket.bind((channel,))
        self._socket.settimeout(0.0)
        self.interface = interface()
        self.sender = Sender(self.interface)
        self.last: dict[str, dict[str, int]] = {}
        self.heard = 0

    def send(self, *frames: Frame) -> None:
        for identifier, data in frames:
            self._socket.send(FRAME.pack(identifier, len(data), data))

    def error(self, kind: int, controller: int = 0) -> None:
        """An error frame of class `kind` (linux/can/error.h), data[1] = `controller`."""
        self._socket.send(FRAME.pack(ERROR_FLAG | kind, 8, bytes([0, controller, 0, 0, 0, 0, 0, 0])))

    def listen(self) -> None:
        """Take in what has come."""
        with contextlib.suppress(BlockingIOError):
            while True:
                identifier, length, data = FRAME.unpack(self._socket.recv(FRAME.size))
                message = self.interface.by_id.get(identifier)
                if message is not None and message.sender == "controller":
                    self.heard += 1
                    self.last[message.name] = message.decode(data[:length])

    def command(self, request: str, setpoint: int = 0) -> None:
        values = {"request": self.interface.enums["request"][request], "control": 0, "setpoint": setpoint}
        self.send(self.sender.frame("COMMAND", values))

    def keep(self, request: str, condition: Callable[[], bool], what: str, seconds: float = BOUND) -> None:
        """Commands every 20 ms until the condition holds."""
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, f"not within {seconds:g} s: {what}; it says {self.last.get('STATUS')}"
            self.command(request)
            time.sleep(0.02)
            self.listen()

    def close(self) -> None:
        self._socket.close()

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def codes(folder: Path) -> list[str]:
    """Converter files of a robot at rest, and the options that name them: 0 A, 12 V, 25 degC."""
    parameters = interface().parameters
    supply = round(12.0 / (parameters["supply_scale"].default * parameters["supply_scale"].scale))
    zero, scale = parameters["temperature_zero"], parameters["temperature_scale"]
    warm = round((25.0 - zero.default * zero.scale) / (scale.default * scale.scale))
    options = []
    for name, code in (("current", 2048), ("supply", supply), ("temperature", warm)):
        (folder / name).write_text(f"{code}\n")
        options += [f"--adc-{name}", str(folder / name)]
    return options


def environment() -> dict[str, str]:
    return {**os.environ, "COLUMNS": "200"}


def run_shell(command: Sequence[str], seconds: float = BOUND) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        list(command), capture_output=True, text=True, check=False, timeout=seconds, env=environment()
    )
