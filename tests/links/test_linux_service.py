"""The unit of the Linux controller against one that hangs, with a stand-in for systemd that does what the unit says.

The lines themselves are in tests/sandbox: here it is the program that must end, so that ExecStopPost can follow.
"""

from __future__ import annotations

import ctypes
import os
import platform
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from terrapin_hil import paths
from terrapin_hil.links.seal import LinkKey
from tests.links.test_linux_controller import PROGRAM, Adapter
from tests.waiting import BOUND, wait_for

UNIT = dict(
    line.split("=", 1)
    for line in (paths.ROOT / "firmware/ports/linux/terrapin-controller.service").read_text().splitlines()
    if line[:1].isalpha() and "=" in line
)
SPAN = {"ms": 1e-3, "s": 1.0}
WITHIN = 1.0  # s: a hung controller's lines are off
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the Linux controller is built on Linux")


def seconds(name: str) -> float:
    text = UNIT[name]
    unit = text.lstrip("0123456789.") or "s"
    return float(text.removesuffix(unit)) * SPAN[unit] if text != text.removesuffix(unit) else float(text)


@pytest.fixture
def hung(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[bytes], socket.socket]]:
    """A controller that has told that it is ready, and where its signs of life arrive."""
    told = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    told.bind(str(tmp_path / "notify"))
    told.settimeout(BOUND)
    adapter = Adapter()
    environment = {**os.environ, "NOTIFY_SOCKET": str(tmp_path / "notify")}
    process = subprocess.Popen(
        [PROGRAM, "--adapter", adapter.path, "--priority", "0"], env=environment, stderr=subprocess.DEVNULL
    )
    assert b"READY=1" in told.recv(100)
    assert told.recv(100) == b"WATCHDOG=1"
    yield process, told
    process.kill()
    process.wait()
    adapter.close()
    told.close()


def _spin(pid: int) -> None:
    """The next instruction of a process becomes a jump to itself."""
    attach, detach, read_registers, peek, poke = 16, 17, 12, 2, 5
    ptrace = ctypes.CDLL(None, use_errno=True).ptrace
    ptrace.argtypes = (ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p)
    ptrace.restype = ctypes.c_long
    if ptrace(attach, pid, None, None):
        pytest.skip(f"no ptrace here: {os.strerror(ctypes.get_errno())}")
    os.waitpid(pid, 0)
    registers = (ctypes.c_ulonglong * 27)()
    assert ptrace(read_registers, pid, None, ctypes.addressof(registers)) == 0
    place = registers[16]  # rip
    word = ptrace(peek, pid, place, None) & 0xFFFF_FFFF_FFFF_0000 | 0xFEEB  # jmp to itself
    assert ptrace(poke, pid, place, word) == 0
    assert ptrace(detach, pid, None, None) == 0


def _hang(process: subprocess.Popen[bytes], told: socket.socket, how: str) -> None:
    if how == "stopped":
        process.send_signal(signal.SIGSTOP)
        wait_for(lambda: Path(f"/proc/{process.pid}/stat").read_text().rsplit(") ", 1)[1][0] == "T", "it to stop")
    else:
        _spin(process.pid)
    told.settimeout(0.0)
    while True:  # what it told before
        try:
            told.recv(100)
        except BlockingIOError:
            break
    told.settimeout(seconds("WatchdogSec"))
    with pytest.raises(TimeoutError):  # no sign of life: the watchdog's time has come
        told.recv(100)


HANGS = [
    "stopped",
    pytest.param("loop", marks=pytest.mark.skipif(platform.machine() != "x86_64", reason="an instruction of x86-64")),
]


@pytest.mark.parametrize("how", HANGS)
def test_what_hangs_is_ended_by_the_units_signal(hung: tuple[subprocess.Popen[bytes], socket.socket], how: str) -> None:
    process, told = hung
    _hang(process, told, how)
    begin = time.monotonic()
    process.send_signal(getattr(signal, UNIT["WatchdogSignal"]))
    assert process.wait(BOUND) == -signal.SIGKILL
    print(f"{how}: ended {1000 * (time.monotonic() - begin):.1f} ms after the watchdog's {UNIT['WatchdogSec']}")


def test_the_signal_of_systemds_own_choice_does_not_end_what_is_stopped(
    hung: tuple[subprocess.Popen[bytes], socket.socket],
) -> None:
    process, told = hung
    _hang(process, told, "stopped")
    process.send_signal(signal.SIGABRT)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.3)


def test_the_units_times() -> None:
    """Signs of life come each 100 ms, five times within the watchdog's time; half of what is stated is left for the end
    and for ExecStopPost, which puts the line off that ExecStart drives."""
    assert 5 * 0.1 <= seconds("WatchdogSec") <= WITHIN / 2
    assert UNIT["WatchdogSignal"] == "SIGKILL"
    assert seconds("TimeoutAbortSec") <= 1.0
    assert seconds("TimeoutStopSec") <= 2.0
    line = UNIT["ExecStopPost"].rpartition("--enable ")[2]
    assert UNIT["ExecStopPost"].endswith(f"--off --enable {line}")
    assert f"--enable {line} " in UNIT["Environment"]


def test_a_start_without_a_file_says_what_it_forgets(tmp_path: Path) -> None:
    for words, said in (((), True), (("--flash", str(tmp_path / "flash")), False)):
        adapter = Adapter()
        command = [str(PROGRAM), "--adapter", adapter.path, "--priority", "0", *words]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        assert adapter.receive(BOUND)
        process.terminate()
        _, error = process.communicate(timeout=BOUND)
        adapter.close()
        assert ("no --flash FILE: a restart forgets a STOP_ALL" in error) == said


def test_a_key_that_others_may_read_is_refused(tmp_path: Path) -> None:
    key = tmp_path / "robot.key"
    key.touch(0o600)
    key.write_text(LinkKey.new().text())
    for mode in (0o640, 0o604, 0o620, 0o602):
        key.chmod(mode)
        done = subprocess.run([PROGRAM, "--link-key", key, "--pty"], capture_output=True, text=True, timeout=BOUND)
        assert done.returncode == 1
        assert done.stderr == (
            f"terrapin-controller: {key}: a secret that others may read or write (mode {mode:04o}): chmod 600 {key}\n"
        )
