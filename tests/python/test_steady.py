"""The tool that repeats tests sees one that fails now and then, and goes on where it was interrupted."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

from tests.waiting import BOUND

ROOT = Path(__file__).resolve().parents[2]
TOOL = ROOT / "tests" / "tools" / "steady.py"

FLAKY = """from pathlib import Path

def test_every_third_time_it_fails():
    count = Path(__file__).with_suffix(".count")
    number = int(count.read_text()) if count.exists() else 0
    count.write_text(str(number + 1))
    assert number != 2
"""


def steady(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, TOOL, *arguments]
    return subprocess.run(map(str, command), capture_output=True, text=True, check=False, timeout=300)


def test_a_test_that_fails_now_and_then_is_seen_and_nothing_runs_twice(tmp_path: Path) -> None:
    flaky, count, out = tmp_path / "test_flaky.py", tmp_path / "test_flaky.count", tmp_path / "out"
    flaky.write_text(FLAKY)
    options = ("--load", 1, "--jobs", 1, "--out", out, flaky)
    done = steady("--times", 2, *options)
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "2 passed, 0 failed")
    done = steady("--times", 4, *options)  # as after an interruption: two are left
    assert (done.returncode, done.stdout.splitlines()[-1]) == (1, "3 passed, 1 failed")
    assert count.read_text() == "4"
    assert len(done.stdout.splitlines()) == 3
    (log,) = out.glob("*.log")
    assert "assert 2 != 2" in log.read_text()


def test_ctrl_c_ends_it_after_what_runs(tmp_path: Path) -> None:
    flaky, count = tmp_path / "test_flaky.py", tmp_path / "test_flaky.count"
    flaky.write_text(FLAKY)
    options = ("--times", 50, "--load", 0, "--jobs", 1, "--out", tmp_path / "out", flaky)
    command = [sys.executable, TOOL, *map(str, options)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as running:
        assert running.stdout is not None
        running.stdout.readline()
        running.send_signal(signal.SIGINT)
        running.communicate(timeout=BOUND)
    assert running.returncode == 130
    assert int(count.read_text()) < 50


WAITING = """import subprocess
import sys

import pytest

@pytest.fixture
def child():
    return subprocess.run([sys.executable, "-c", ""], check=True)

def test_in_the_test():
    subprocess.run([sys.executable, "-c", ""], check=True)

def test_in_its_fixture(child):
    assert child.returncode == 0

@pytest.mark.parametrize("number", [1, 2])
def test_that_computes(number):
    assert number

def test_that_sleeps():
    __import__("time").sleep(0.001)
"""


def test_the_tests_that_wait_are_known_by_what_they_do(tmp_path: Path) -> None:
    (tmp_path / "test_any.py").write_text(WAITING)
    (tmp_path / "test_imports.py").write_text("import threading\n\ndef test_any():\n    assert threading\n")
    notes = tmp_path / "notes"

    def pytest(*options: object) -> str:
        command = [sys.executable, "-m", "pytest", "-v", "--rootdir", tmp_path, "-p", "tests.tools.waits", *options]
        return subprocess.run(
            [*map(str, command), str(tmp_path)], cwd=ROOT, capture_output=True, text=True, check=True, timeout=BOUND
        ).stdout

    assert "6 passed" in pytest("--waits-to", notes)
    again = pytest("--waits-of", notes)
    assert "4 passed" in again
    assert "test_that_computes" not in again
