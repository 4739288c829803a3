"""Progress of long work: what is done now, told anew each second, and nothing where nobody reads it."""

from __future__ import annotations

import itertools
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from terrapin_tools.progress import steps
from tests.waiting import wait_for

ROOT = Path(__file__).resolve().parents[2]


def test_the_time_is_told_while_a_step_takes_long(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TERRAPIN_PROGRESS", "lines")
    said = ""

    def again() -> bool:
        nonlocal said
        said += capsys.readouterr().err
        return said.count("reading") >= 3

    with steps() as report:
        report("reading")
        wait_for(again)
        report("fit")
    said += capsys.readouterr().err
    lines = said.splitlines()
    assert all(re.fullmatch(r" *\d+\.\d s  (reading|fit) \.\.\.", line) for line in lines), lines
    assert lines[-1].endswith("fit ...")
    times = [float(line.split()[0]) for line in lines]
    assert times == sorted(times)
    assert max(b - a for a, b in itertools.pairwise(times)) > 0.5


def test_nothing_is_said_where_nobody_reads(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("TERRAPIN_PROGRESS", raising=False)
    with steps() as report:
        report("reading")
    assert capsys.readouterr().err == ""


def test_discover_says_what_it_does_before_it_imports_what_takes_seconds(tmp_path: Path) -> None:
    case = shutil.copytree(ROOT / "cases/plates_in_soil", tmp_path / "case")
    watched = (
        "import sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name in ('scipy', 'terrapin_tools.workbench.fleet.fleet'):\n"
        "            print('imports', name, file=sys.stderr, flush=True)\n"
        "sys.meta_path.insert(0, Finder())\n"
        f"sys.argv = ['terrapin', 'discover', {str(case)!r}]\n"
        "from terrapin_tools.cli import main\n"
        "main()\n"
    )
    environment = {**os.environ, "TERRAPIN_PROGRESS": "lines"}
    run = subprocess.run([sys.executable, "-c", watched], env=environment, capture_output=True, text=True)
    lines = run.stderr.splitlines()
    assert run.returncode == 0, run.stderr
    assert "reading the case" in lines[0]
    assert {"imports scipy", "imports terrapin_tools.workbench.fleet.fleet"} <= set(lines[1:])
