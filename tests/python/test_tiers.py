"""The tiers of tests: each test is in one, what is listed is there, and `.ci/run` runs both."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.tools.tiers import above, pytest_collection_modifyitems, rest, tier

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/tools"))

from reach import Imports, changed_files, programs, reached  # noqa: E402
from suite import BUILDS  # noqa: E402


@cache
def imports() -> Imports:
    return Imports(ROOT)


def test_each_entry_names_what_is_there() -> None:
    for entry, reason in rest().items():
        assert reason
        file, _, test = entry.partition("::")
        path = ROOT / file
        assert any(path.glob("test_*.py")) if path.is_dir() else path.name.startswith("test_"), entry
        if test:
            functions = [node.name for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)]
            assert test.partition("[")[0] in functions, entry
        assert path.exists(), entry
        assert above(entry) & rest().keys() == {entry}, f"{entry} is listed twice"


def kept(asked: str | None, names: list[str]) -> list[str]:
    """What the plugin leaves of the tests that pytest collected; the others are told to pytest as deselected."""
    told: list[Any] = []
    hook = SimpleNamespace(pytest_deselected=lambda items: told.extend(items))
    config: Any = SimpleNamespace(getoption=lambda _: asked, hook=hook)
    items: list[Any] = [SimpleNamespace(nodeid=name) for name in names]
    pytest_collection_modifyitems(config, items)
    assert len(items) + len(told) == len(names)
    return [item.nodeid for item in items]


def test_no_test_is_lost_between_the_tiers() -> None:
    names = [f"{file.relative_to(ROOT)}::test_it" for file in sorted((ROOT / "tests").glob("*/test_*.py"))]
    names += [entry for entry in rest() if "::" in entry]
    first, second = kept("test", names), kept("rest", names)
    assert len(first) > 50
    assert len(second) > 20
    assert sorted([*first, *second]) == sorted(names)
    assert kept(None, names) == names


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("tests/package/test_wheel.py::test_new[a]", "rest"),
        ("tests/packages/test_wheel.py::test_new", "test"),
        ("tests/python/test_goal.py::test_told_the_same_everywhere", "rest"),
        ("tests/python/test_goal.py::test_told_the_same_everywhere_else", "test"),
        ("tests/python/test_that_nobody_has_listed.py::test_new", "test"),
    ],
)
def test_what_is_not_listed_is_run_by_make_test(name: str, expected: str) -> None:
    assert tier(name) == expected


def test_each_build_is_in_one_tier() -> None:
    presets = {preset["name"] for preset in json.loads((ROOT / "CMakePresets.json").read_text())["buildPresets"]}
    listed = [preset for builds in BUILDS.values() for preset in builds]
    assert sorted(listed) == sorted(presets - {"debug"})  # which is for the debugger


@pytest.mark.parametrize("failing", ["", "test", "test-all", "check"])
def test_ci_runs_all_and_says_which_failed(failing: str, tmp_path: Path) -> None:
    make = tmp_path / "make"
    make.write_text(f'#!/bin/sh\necho "made $1"\n[ "$1" != "{failing}" ] || exit 2\n')
    make.chmod(0o755)
    environment = {**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run([ROOT / ".ci/run"], env=environment, capture_output=True, text=True, check=False, timeout=60)
    targets = ("test", "test-all", "check")
    assert [line for line in done.stdout.splitlines() if line.startswith("made ")] == [
        f"made {name}" for name in targets
    ]
    for name in targets:
        assert f"\nmake {name}: exit {2 if name == failing else 0}, " in done.stdout
    assert done.returncode == (1 if failing else 0)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ("host_tools/terrapin_tools/commands/keys.py", "tests/boot/test_flash.py"),  # a test names the command
        ("host_tools/terrapin_tools/logs/decoding.py", "tests/python/test_logs.py"),  # a test imports it
        ("host_tools/terrapin_tools/workbench/noise/mishaps.py", "tests/python/test_mishaps.py"),  # through another
        ("tests/python/casekit.py", "tests/python/test_add.py"),  # a helper beside it
        ("tests/web/conftest.py", "tests/web/test_web_hostile.py"),  # fixtures
        ("hil/terrapin_hil/scenario/scenarios/slope_limiter.toml", "tests/python/test_run.py"),  # by its name
        ("firmware/core/slip.c", "tests/python/test_same_bits.py"),
        ("tests/python/test_units.py", "tests/python/test_units.py"),
    ],
)
def test_a_change_reaches_its_tests(changed: str, expected: str) -> None:
    found = reached([changed], imports(), {})
    assert expected in found.tests
    assert len(found.tests) < 80
    assert found.by_none == ()


def test_what_no_test_reaches_is_said() -> None:
    unnamed = "docs/no" + "where.svg"  # a file that a test names is reached by it, by this one too
    found = reached([unnamed, "tests/python/test_units.py"], imports(), {})
    assert (found.tests, found.by_none) == (("tests/python/test_units.py",), (unnamed,))


@pytest.mark.skipif(not (ROOT / "build/host/.ninja_deps").is_file(), reason="build/host is not built by Ninja")
def test_a_header_reaches_the_c_tests_that_are_built_of_it() -> None:
    built = programs(ROOT)
    of_boot = reached(["firmware/boot/boot.h"], imports(), built).programs
    assert "test_boot_loader_blackbox" in of_boot
    assert "test_core_drive_blackbox" not in of_boot
    assert "test_core_drive_blackbox" in reached(["firmware/core/drive.c"], imports(), built).programs
    of_host = reached(["firmware/ports/host/process.c"], imports(), built)  # no C test has it
    assert {"tests/links/test_slcan_process.py", "tests/links/test_nodes.py"} <= set(of_host.tests)
    assert "tests/boot/test_flash.py" in reached(["firmware/ports/host_boot/process.c"], imports(), built).tests


def test_what_changed_is_what_git_says(tmp_path: Path) -> None:
    def git(*words: str) -> None:
        who = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
        subprocess.run(["git", *who, *words], cwd=tmp_path, check=True, capture_output=True)

    git("init", "-q")
    for name in ("a.py", "b.py"):
        (tmp_path / name).write_text("")
        git("add", name)
        git("commit", "-q", "-m", name)
    assert changed_files("HEAD~5", tmp_path) == ["a.py", "b.py"]  # there is no such commit: all
    (tmp_path / "a.py").write_text("1")
    (tmp_path / "c.py").write_text("")
    assert changed_files("HEAD~1", tmp_path) == ["a.py", "b.py", "c.py"]
    assert changed_files("HEAD", tmp_path) == ["a.py", "c.py"]


def test_a_files_tests_run_in_one_process(tmp_path: Path) -> None:
    """pytest-xdist's own groups were lost once, without a word, when pytest changed; so this runs it."""
    for name in ("first", "second", "third"):
        text = "import os, pathlib, pytest\n@pytest.mark.parametrize('n', range(8))\ndef test_it(n):\n"
        text += f"    with open({str(tmp_path / name)!r}, 'a') as f: print(os.getpid(), file=f)\n"
        (tmp_path / f"test_{name}.py").write_text(text, encoding="utf-8")
    options = ["-q", "-n2", "-p", "tests.tools.tiers", "-p", "no:schemathesis", "-c", os.devnull]
    command = [sys.executable, "-m", "pytest", *options, str(tmp_path)]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stdout
    processes = [set((tmp_path / name).read_text(encoding="ascii").split()) for name in ("first", "second", "third")]
    assert [len(each) for each in processes] == [1, 1, 1]
    assert len(set.union(*processes)) == 2
