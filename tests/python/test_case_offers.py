"""`terrapin case table`: the base models that a log's columns suit, fitted briefly, the best first."""

from __future__ import annotations

import re
from pathlib import Path

import logs_of_papers
import pytest

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases import BASES
from terrapin_tools.workbench.new_case.from_tables import write_table_case
from terrapin_tools.workbench.new_case.offers import Offer, told


def _first(words: str) -> str:
    """The base that was offered first."""
    found = re.search(r"^\* (\w+):|these columns have: (\w+):", words, re.MULTILINE)
    assert found is not None, words
    return found[1] or found[2]


def test_the_right_base_comes_first(tmp_path: Path) -> None:
    """At least 11 of 12 logs of three systems; none becomes rolling_steady without a word."""
    wrong = []
    for number in range(len(logs_of_papers.LOGS)):
        path, base = logs_of_papers.write(tmp_path, number)
        words = write_table_case(tmp_path / f"case_{number}", [path], "a log", show=str)
        found = _first(words)
        document = (tmp_path / f"case_{number}" / "case.toml").read_text(encoding="utf-8")
        assert f'base = "{found}"' in document
        if found != base:
            wrong.append((path.read_text().partition("\n")[0], found, base))
    assert len(wrong) <= 1, wrong


def test_a_base_that_is_asked_for_is_taken(tmp_path: Path) -> None:
    path, _ = logs_of_papers.write(tmp_path, 0)
    words = write_table_case(tmp_path / "case", [path], "a log", show=str, chosen="rolling_steady")
    assert "* rolling_steady: leaves" in words
    assert 'base = "rolling_steady"' in (tmp_path / "case" / "case.toml").read_text(encoding="utf-8")


def test_what_is_left_is_told_of_each_channel() -> None:
    """One number for all channels stood beside them, by which the second would have come first."""
    wheel = Offer(BASES["wheel_contact"], {"traction": 1.3, "torque": 0.5, "sinkage": 0.16}, 2.5)
    sphere = Offer(BASES["sphere_contact"], {"traction": 0.64, "torque": 0.83}, 0.63)
    assert told([wheel, sphere], wheel.base)[1:] == [
        "* wheel_contact: leaves 1.3 of the scatter of traction, 0.5 of torque, 0.16 of sinkage",
        "  sphere_contact: leaves 0.64 of the scatter of traction, 0.83 of torque",
    ]


def test_a_table_that_fits_no_base(tmp_path: Path) -> None:
    path, _ = logs_of_papers.write(tmp_path, 0)
    with pytest.raises(
        UserError, match=r"--base vehicle: found columns for .*, expected time, drive_torque and omega_fl"
    ):
        write_table_case(tmp_path / "case", [path], "a log", show=str, chosen="vehicle")
    with pytest.raises(UserError, match=r"--base: found 'sphere', expected one of .*cmr"):
        write_table_case(tmp_path / "case", [path], "a log", show=str, chosen="sphere")
    with pytest.raises(UserError, match=r"found 'ode', whose equations are yours to write .*docs/ode\.md.; expected"):
        write_table_case(tmp_path / "case", [path], "a log", show=str, chosen="ode")
    assert not (tmp_path / "case").exists()


def test_a_run_shorter_than_a_swing(tmp_path: Path) -> None:
    path, _ = logs_of_papers.write(tmp_path, 0)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], *(line for line in lines[1:] if float(line.split(",")[1]) < 0.3)]) + "\n")
    words = write_table_case(tmp_path / "case", [path], "a log", show=str)
    assert re.search(r"cmr: .*run r0 lasts 0\.28 s, expected at least the 0\.5 s of a swing", words)
