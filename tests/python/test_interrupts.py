"""Signals wait at the doors of pools: Ctrl-C and its like leave no lock taken."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from terrapin_tools.interrupts import later
from tests.waiting import BOUND

# A signal of this number comes when a lock is taken and its block not yet entered.
INTERRUPTED = """
import signal, sys, threading, time

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
"""
POOL = """
from terrapin_tools.workbench.fleet.pool import pool

if __name__ == "__main__":
    signal.signal(number, stop)
    try:
        with pool(2, "") as workers:
            future = workers.submit(time.sleep, 0.2)
            threading.Condition.__enter__ = interrupted
            future.result()
    except Stopped:
        print("stopped", interrupts)
"""
# A thread that ends with the program has given a lock back, and has not yet said so to what keeps count of them.
UNSAID = """
from joblib.externals.loky.backend import resource_tracker
from terrapin_tools.workbench.fleet.pool import pool

if __name__ == "__main__":
    with pool(2, "") as workers:
        workers.submit(time.sleep, 0.0).result()
        resource_tracker.register("/loky-given-back", "semlock")
"""
FIT = """
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from terrapin_tools.soil import vehicle

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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("work", [POOL, FIT], ids=["processes of a pool", "threads of a fit"])
def test_a_signal_on_the_way_into_a_lock_leaves_it_free(tmp_path: Path, work: str, number: signal.Signals) -> None:
    """What waits for the lock then ends all the same, and the program with it."""
    script = tmp_path / "held_lock.py"
    script.write_text(INTERRUPTED + work)
    ended = subprocess.run([sys.executable, script, str(number.value)], capture_output=True, text=True, timeout=BOUND)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "stopped 1\n", "")


def test_a_lock_that_is_given_back_and_not_told_is_no_news(tmp_path: Path) -> None:
    script = tmp_path / "unsaid.py"
    script.write_text("import time\n" + UNSAID)
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=BOUND)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")


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
