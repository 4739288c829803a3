"""Progress of long work: what is done now, told anew each second, and nothing where nobody reads it."""

from __future__ import annotations

import itertools
import re

import pytest

from terrapin_tools.progress import steps
from tests.waiting import wait_for


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
