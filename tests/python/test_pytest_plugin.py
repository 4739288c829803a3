"""The pytest plugin, in projects of others: what it loads, its fixtures, and what a failure leaves behind."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import terrapin_tools as terrapin
from terrapin_hil import paths
from tests.docs.scratch import copy_tree
from tests.entry_points import environment

ROOT = Path(__file__).resolve().parents[2]
SUITE = ROOT / "docs" / "robot_tests" / "test_robot.py"
# Plugins that are installed here for other tests, and take longer to import than these suites to run.
OTHERS = [word for name in ("schemathesis", "hypothesispytest", "anyio") for word in ("-p", f"no:{name}")]


def suite(folder: Path, *words: str, **more: str) -> subprocess.CompletedProcess[str]:
    """pytest in a folder of its own, where nothing is known but what is installed."""
    given = {k: v for k, v in environment(folder / ".env", **more).items() if not k.startswith(("PYTEST_", "COV_"))}
    options = ["-q", "-p", "no:cacheprovider", *OTHERS, "-c", "/dev/null", "--rootdir=."]
    command = [sys.executable, "-m", "pytest", *options, *words]
    return subprocess.run(command, cwd=folder, env=given, capture_output=True, text=True, timeout=600, check=False)


@pytest.mark.parametrize("link", ["inprocess", "pty"])
def test_the_example_suite_passes(tmp_path: Path, link: str) -> None:
    shutil.copy(SUITE, tmp_path)
    done = suite(tmp_path, "--terrapin-link", link)
    assert done.returncode == 0, done.stdout
    assert "5 passed, 1 skipped" in done.stdout
    assert not (tmp_path / "terrapin-failed").exists()


def test_it_fails_with_a_bug_in_the_firmware_and_says_when(tmp_path: Path) -> None:
    """The emergency stop is planted to be ignored: its test fails, alone, and what it leaves names the tick."""
    tree = copy_tree(tmp_path / "tree")
    source = tree / "firmware" / "core" / "supervisor.c"
    text = source.read_text()
    assert text.count("if (inputs->estop) {") == 1
    source.write_text(text.replace("if (inputs->estop) {", "if (inputs->estop && (inputs->tick == 0U)) {"))
    built = tmp_path / "built" / "host"
    shutil.copytree(paths.simulator(), built, ignore=shutil.ignore_patterns("CMake*", "*.ninja", "*.o", "*.a"))
    for command in (
        ("cmake", "--preset", "host", "-B", str(tmp_path / "made"), f"-DPython3_EXECUTABLE={sys.executable}",
         "-DTERRAPIN_HIL=OFF"),
        ("cmake", "--build", str(tmp_path / "made"), "--target", "terrapin"),
    ):  # fmt: skip
        done = subprocess.run(command, cwd=tree, capture_output=True, text=True, timeout=600, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    shutil.copy(tmp_path / "made" / "libterrapin.so", built / "libterrapin.so")
    project = tmp_path / "project"
    project.mkdir()
    shutil.copy(SUITE, project)
    done = suite(project, "--terrapin-out", "failed", TERRAPIN_BUILD=str(built))
    assert done.returncode == 1
    assert "1 failed, 4 passed, 1 skipped" in done.stdout, done.stdout
    (place,) = (project / "failed").iterdir()
    assert place.name == "test_robot.py_test_the_emergency_stop_stops_it_at_once"
    kept = (place / "repeat.txt").read_text()
    assert re.search(r"end       tick 3100 \(3\.100 s\), state run, faults none", kept)
    assert "tick 3100 (3.100 s)" in done.stdout
    repeat = re.search(r"repeat    pytest (.*)", kept)
    assert repeat
    again = suite(project, *repeat[1].split(), "--terrapin-out", "failed", TERRAPIN_BUILD=str(built))
    assert "1 failed" in again.stdout
    assert suite(project, *repeat[1].split()).returncode == 0  # without the bug
    assert (place / "plot.svg").read_text().startswith("<?xml")
    log = terrapin.Log(place)
    assert log["STATUS.state"].num_rows > 10


def test_nothing_is_loaded_before_it_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "test_own.py").write_text(
        "import sys\n\n\ndef test_own():\n"
        "    ours = sorted(name for name in sys.modules if name.startswith('terrapin'))\n"
        "    assert ours == ['terrapin_tools', 'terrapin_tools.pytest_plugin']\n"
        "    assert 'numpy' not in sys.modules\n"
    )
    done = suite(tmp_path)
    assert done.returncode == 0, done.stdout


def test_one_line_for_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "test_own.py").write_text(
        "def test_link(terrapin_link):\n    pass\n\n\n"
        "def test_session(terrapin_session):\n    terrapin_session('no_such')\n\n\n"
        "def test_twice(terrapin_session):\n    terrapin_session(link='pty')\n"
    )
    done = suite(tmp_path, "--terrapin-link", "telepathy")
    assert done.returncode == 1
    assert re.search(r"InputError: .*telepathy", done.stdout)
    done = suite(tmp_path, "-k", "session or twice")
    assert re.search(r"InputError: .*no_such", done.stdout)
    assert "found link, expected it on pytest's command line" in done.stdout


def test_a_wrong_link_is_one_line_where_tests_are_marked(tmp_path: Path) -> None:
    """Whether they are skipped depends on it: pytest ends before any test, the others too."""
    (tmp_path / "test_own.py").write_text(
        "import pytest\n\n\n@pytest.mark.terrapin_hardware\ndef test_board(terrapin_session):\n    pass\n\n\n"
        "def test_any():\n    pass\n"
    )
    done = suite(tmp_path, "--terrapin-link", "telepathy")
    assert done.returncode == pytest.ExitCode.USAGE_ERROR
    assert re.fullmatch(r"ERROR: --terrapin-link: link 'telepathy': expected one of inprocess, .*", done.stderr.strip())
    assert "no tests ran" in done.stdout
    assert "Traceback" not in done.stdout
    done = suite(tmp_path)
    assert "1 passed, 1 skipped" in done.stdout


def test_sessions_are_closed_whatever_a_test_does(tmp_path: Path) -> None:
    (tmp_path / "test_own.py").write_text(
        "import os\n\n\ndef test_first(terrapin_session):\n"
        "    one, other = terrapin_session(seed=1), terrapin_session(seed=2)\n"
        "    one.step(0.1)\n    assert False\n\n\n"
        "def test_nothing_is_left():\n"
        "    children = open('/proc/self/task/%d/children' % os.getpid()).read().split()\n"
        "    assert children == []\n"
    )
    done = suite(tmp_path, "--terrapin-link", "pty")
    assert "1 failed, 1 passed" in done.stdout, done.stdout
    left = sorted(path.name for path in (tmp_path / "terrapin-failed").iterdir())
    assert left == ["test_own.py_test_first", "test_own.py_test_first-2"]
    assert (
        "repeat    pytest test_own.py::test_first --terrapin-link=pty"
        in (tmp_path / "terrapin-failed" / left[0] / "repeat.txt").read_text()
    )
