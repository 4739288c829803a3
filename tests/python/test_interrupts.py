"""A signal on the way into a lock leaves it free: in a fit's threads, as in test_fleet.py in the pool's processes."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from terrapin_tools.interrupts import later
from tests.waiting import BOUND

HELD_LOCK = """
import signal, sys, threading, time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from terrapin_tools.soil import vehicle

take, interrupts, number = threading.Condition.__enter__, 0, int(sys.argv[1])

class Stopped(BaseException):
    pass

def stop(number, frame):
    raise Stopped

def interrupted(lock):
    global interrupts
    taken = take(lock)
    if threading.get_ident() == threading.main_thread().ident and interrupts < 1:
        interrupts += 1
        signal.raise_signal(number)
    return taken

signal.signal(number, stop)
objective = object.__new__(vehicle.Objective)
objective.vehicle = objective.tyre = None
objective.drives = [SimpleNamespace(torque=None, period=vehicle.PERIOD)] * 2
objective._pool = ThreadPoolExecutor(2)
list(objective._pool.map(time.sleep, [0.1, 0.1]))  # its threads have started
vehicle.simulate = lambda *_, **__: time.sleep(1.0)
threading.Condition.__enter__ = interrupted
try:
    objective._simulate([0.0] * 5)
except Stopped:
    print("stopped", interrupts)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_a_fit_leaves_its_threads_free_to_end(tmp_path: Path, number: signal.Signals) -> None:
    script = tmp_path / "held_lock.py"
    script.write_text(HELD_LOCK)
    ended = subprocess.run([sys.executable, script, str(number.value)], capture_output=True, text=True, timeout=BOUND)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "stopped 1\n", "")


def test_signals_wait_and_handlers_come_back() -> None:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    done = []

    def interrupted() -> None:
        with later():
            signal.raise_signal(signal.SIGINT)
            done.append("all of it")

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert done == ["all of it"]
    assert {number: signal.getsignal(number) for number in before} == before
