"""A Linux controller that hangs with its bridge on: what its unit says puts the line off within 1 s.

systemd is not in the sandbox: a stand-in listens for the signs of life and does what the unit says when they stop.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from kit import Controller, Lines, Peer, codes, lines, run_shell, vcan, wait_for

from terrapin_hil import paths

PROGRAM = str(paths.build() / "terrapin-controller")
UNIT = dict(
    line.split("=", 1)
    for line in (paths.ROOT / "firmware/ports/linux/terrapin-controller.service").read_text().splitlines()
    if line[:1].isalpha() and "=" in line
)
WATCHDOG = float(UNIT["WatchdogSec"].removesuffix("ms")) / 1000
WITHIN = 1.0  # s
TICK = 0.005  # s, of the clock that tells how late this machine is itself
LOOP = bytes.fromhex("ebfe")  # jmp to itself
STORM = bytes.fromhex(
    "b898000000 0f05"  # munlockall()
    "4889e7 4881e700f0ffff be00100000 ba04000000 b81c000000 0f05"  # madvise(page of the stack, 4096, MADV_DONTNEED)
    "4889e7 4881e700f0ffff c60701"  # a byte into that page: a fault
    "ebd6"  # and again
)
ATTACH, DETACH, REGISTERS, PEEK, POKE = 16, 17, 12, 2, 5
RIP = 16
ON_X86 = pytest.mark.skipif(platform.machine() != "x86_64", reason="instructions of x86-64")
version = run_shell([PROGRAM, "--version"]).stdout
pytestmark = pytest.mark.skipif("without libgpiod" in version, reason="terrapin-controller was built without libgpiod")


@pytest.fixture
def chip() -> Iterator[Lines]:
    with vcan(), lines("ESTOP", "ENABLE") as made:
        made.pull("ESTOP", True)
        made.pull("ENABLE", False)  # the hardware pull that docs/linux.md asks for
        yield made


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    with tempfile.TemporaryDirectory() as folder, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as place:
        place.bind(f"{folder}/notify")
        monkeypatch.setenv("NOTIFY_SOCKET", f"{folder}/notify")
        yield place


class Late(threading.Thread):
    """How much of the time this machine did not give to somebody who wanted a moment each TICK."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.seconds, self._done = 0.0, threading.Event()

    def run(self) -> None:
        while not self._done.is_set():
            begin = time.monotonic()
            time.sleep(TICK)
            self.seconds += max(0.0, time.monotonic() - begin - 4 * TICK)  # the kernel's tick is 10 ms

    def stop(self) -> float:
        self._done.set()
        self.join()
        return self.seconds


def inject(pid: int, code: bytes) -> None:
    """The next instructions of a process are others."""
    ptrace = ctypes.CDLL(None, use_errno=True).ptrace
    ptrace.argtypes, ptrace.restype = (ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p), ctypes.c_long
    if ptrace(ATTACH, pid, None, None):
        pytest.skip(f"no ptrace here: {os.strerror(ctypes.get_errno())}")
    os.waitpid(pid, 0)
    registers = (ctypes.c_ulonglong * 27)()
    assert ptrace(REGISTERS, pid, None, ctypes.addressof(registers)) == 0
    for at in range(0, len(code), 8):
        place = registers[RIP] + at
        old = (ptrace(PEEK, pid, place, None) & 0xFFFF_FFFF_FFFF_FFFF).to_bytes(8, "little")
        piece = code[at : at + 8]
        assert ptrace(POKE, pid, place, int.from_bytes(piece + old[len(piece) :], "little")) == 0
    assert ptrace(DETACH, pid, None, None) == 0


def until_silent(told: socket.socket) -> None:
    with contextlib.suppress(BlockingIOError, TimeoutError):
        while True:
            told.recv(100)


def faults(pid: int) -> int:
    """Page faults of a process since it began."""
    return int(Path(f"/proc/{pid}/stat").read_text().rsplit(") ", 1)[1].split()[7])


@pytest.mark.parametrize("how", ["stopped", pytest.param("loop", marks=ON_X86), pytest.param("faults", marks=ON_X86)])
def test_a_controller_that_hangs_lets_go_within_a_second(chip: Lines, told: socket.socket, how: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        options = ["--can", "vcan0", "--estop", "ESTOP", "--enable", "ENABLE", "--priority", "0", *codes(Path(folder))]
        with Controller(*options) as controller, Peer() as peer:
            peer.keep("clear", lambda: peer.last.get("STATUS", {}).get("ready") == 1, "ready")
            peer.command("idle")  # a clear starts nothing: this permits it
            peer.keep("run", lambda: chip.value("ENABLE"), "the enable line on")
            pid, late = controller.process.pid, Late()
            before = faults(pid)
            late.start()
            begin = time.monotonic()
            if how == "stopped":
                controller.send_signal(signal.SIGSTOP)
            else:
                inject(pid, LOOP if how == "loop" else STORM)
            told.setblocking(False)
            until_silent(told)  # what it told before
            told.settimeout(WATCHDOG)
            until_silent(told)
            assert chip.value("ENABLE")  # nobody else puts it off
            assert (faults(pid) - before > 1000) == (how == "faults")
            controller.send_signal(getattr(signal, UNIT["WatchdogSignal"]))
            assert controller.process.wait(float(UNIT["TimeoutAbortSec"])) == -signal.SIGKILL
            wait_for(lambda: not chip.value("ENABLE"), "the line off by its pull")
            killed = time.monotonic() - begin
            assert run_shell([PROGRAM, *UNIT["ExecStopPost"].split()[1:-1], "ENABLE"]).returncode == 0
            took, lost = time.monotonic() - begin, late.stop()
            assert not chip.value("ENABLE")
    print(f"hung ({how}): line off after {1000 * killed:.0f} ms, ExecStopPost done after {1000 * took:.0f} ms", end="")
    print(f", of which this machine was late {1000 * lost:.0f} ms")
    assert took - lost <= WITHIN
