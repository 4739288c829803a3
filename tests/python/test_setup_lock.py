"""Two runs of make in one tree: the second waits, says so, and gives up in one line."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from terrapin_hil import paths

SCRIPT = ". tests/setup/system.sh; one_at_a_time {wait} set-up; echo in; {then}"

pytestmark = pytest.mark.skipif(shutil.which("flock") is None, reason="flock is not installed: nothing is locked")


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    shutil.copytree(paths.ROOT / "tests" / "setup", tmp_path / "tests" / "setup")
    return tmp_path


def start(tree: Path, wait: float, then: str) -> subprocess.Popen[str]:
    command = ["bash", "-euc", SCRIPT.format(wait=wait, then=then)]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=tree, stdin=pipe, stdout=pipe, stderr=pipe, text=True)


def wait_until_in(process: subprocess.Popen[str]) -> None:
    assert process.stdout is not None
    assert process.stdout.readline() == "in\n"


def test_the_second_run_waits_for_the_first(tree: Path) -> None:
    first = start(tree, 5, "read -r _; echo done")  # until it is told to end
    wait_until_in(first)
    second = start(tree, 300, "true")
    assert second.stderr is not None
    assert "another run is busy with set-up" in second.stderr.readline()
    assert second.poll() is None
    out, _ = first.communicate("\n", timeout=300)
    assert (first.returncode, out) == (0, "done\n")
    out, _ = second.communicate(timeout=300)
    assert (second.returncode, out) == (0, "in\n")


def test_it_gives_up_after_a_time(tree: Path) -> None:
    first = start(tree, 5, "exec sleep 60")  # the lock lives as long as the process
    wait_until_in(first)
    second = start(tree, 0.3, "true")
    out, err = second.communicate(timeout=300)
    assert second.returncode == 1
    assert out == ""
    assert "after 0.3 s" in err.splitlines()[-1]
    first.kill()
    first.wait()
    third = start(tree, 60, "true")
    assert third.communicate(timeout=300) == ("in\n", "")


def test_what_a_command_leaves_running_does_not_keep_the_lock(tree: Path) -> None:
    """A daemon that a package starts: only its own end, or the machine's, would free the tree."""
    first = start(tree, 5, 'quietly daemon bash -c "sleep 30 & echo \\$! >pid"')
    _, err = first.communicate(timeout=300)
    assert first.returncode == 0, err
    daemon = int((tree / "pid").read_text())
    try:
        second = start(tree, 0.3, "true")
        assert second.communicate(timeout=300) == ("in\n", "")
    finally:
        os.kill(daemon, 9)
