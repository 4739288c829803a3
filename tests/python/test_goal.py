"""[goal] of a case: the error in the channel's unit, whether it is good enough, and bad input in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from casekit import one_line, shaft, terrapin

from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.story.sentences import goal
from terrapin_tools.workbench.story.story import Goal


def asking(folder: Path, asked: str) -> Path:
    """A shaft with dry friction, and a user who wants so small an error."""
    return shaft(folder, 12, dry=0.1, more=f"[goal]\ntorque = {asked}\n")


def test_told_the_same_everywhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = asking(tmp_path / "case", '"20 mN m"')
    status, out, _ = terrapin(capsys, "discover", folder)
    assert status == 0
    said = next(line.strip() for line in out.splitlines() if "asked for" in line)
    assert said.startswith("Error of torque: 0.0")
    assert "0.02 N m asked for: not good enough; with what is missing 0.0" in out.replace("\n  ", " ")
    status, out, _ = terrapin(capsys, "discover", folder, "--json", "-")
    one = json.loads(out)["goal"]["torque"]
    assert (one["wanted"], one["unit"], one["met"], one["then_met"]) == (pytest.approx(0.02), "N m", False, True)
    assert one["reached"] == pytest.approx(json.loads(out)["channels"]["torque"]["heldout_rmse"])
    assert 0.008 < one["then"] < 0.013
    assert terrapin(capsys, "report", folder, "-o", tmp_path / "page.html")[0] == 0  # of the kept answer
    assert f"with what is missing {one['then']:.3g} N m, which is" in (tmp_path / "page.html").read_text()
    status, out, _ = terrapin(capsys, "compare", folder, "--json", "-")
    assert json.loads(out)["goal"]["torque"]["then"] is None
    status, out, _ = terrapin(capsys, "add", folder, "coulomb_friction", "--json", "-")
    assert json.loads(out)["goal"]["torque"]["met"]


def test_good_enough_although_something_is_missing() -> None:
    enough = Goal("torque", 0.2, 0.1, 0.01, "N m", True)
    assert goal(enough) == (
        "Error of torque: 0.1 N m (held-out runs), 0.2 N m asked for: good enough as it is; "
        "with what is missing 0.01 N m."
    )
    neither = Goal("x", 0.1, 0.3, 0.2, "1", False)
    assert goal(neither) == (
        "Error of x: 0.3 (training runs, for none is held out), 0.1 asked for: not good enough; "
        "with what is missing 0.2, which is not enough either."
    )


def test_a_case_without_a_goal_says_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = asking(tmp_path / "case", '"1 N m"')
    text = (folder / "case.toml").read_text()
    (folder / "case.toml").write_text(text.replace('[goal]\ntorque = "1 N m"\n', ""))
    status, out, _ = terrapin(capsys, "compare", folder, "--json", "-")
    assert status == 0
    assert "goal" not in json.loads(out)
    assert load_case(folder).goal == {}


def test_a_plain_number_and_a_share(tmp_path: Path) -> None:
    plain = load_case(asking(tmp_path / "plain", "0.05"))
    assert plain.goal == {"torque": 0.05}
    share = load_case(asking(tmp_path / "share", '"2 %"'))
    assert share.goal["torque"] == pytest.approx(0.02 * float(np.sqrt(np.mean(share.channels["torque"] ** 2))))
    assert load_case(asking(tmp_path / "close", '"2%"')).goal == share.goal


BAD = {
    "unit": ('"0.05 A"', ["case.toml:2: goal.torque:", "N m"]),
    "number": ('"small"', ["goal.torque: found", "expected a number above 0 and its unit"]),
    "zero": ('"0 N m"', ["goal.torque: found", "expected a number above 0 and its unit"]),
    "infinite": ('"inf N m"', ["goal.torque: found", "expected a number above 0 and its unit"]),
    "truth": ("true", ["goal.torque: found True, expected a number above 0 and its unit"]),
    "unknown unit": ('"1 flurb"', ["goal.torque:", "flurb"]),
    "other name": ('"1 N m"\nspeed = 3', ["goal.speed: unknown channel, expected one of torque"]),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    asked, told = BAD[name]
    status, _, err = terrapin(capsys, "compare", asking(tmp_path / "case", asked))
    assert status == 2
    one_line(err, told)
