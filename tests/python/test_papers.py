"""`terrapin papers`: verdicts follow from the numbers by the stated rules, and the numbers are those of the models."""

from __future__ import annotations

import doctest
import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from terrapin_tools import cli
from terrapin_tools.papers import build as build_module
from terrapin_tools.papers import li_forced, li_rolling, page, printed, reina, reina_soil, table4, verdict
from terrapin_tools.papers.part import Part
from terrapin_tools.papers.verdict import (
    ASSUMED,
    FAILED,
    REPRODUCED,
    Check,
    digits,
    near,
    ranged,
    states,
    unchecked,
    worst,
)

# Everything but the car's estimates, which take most of the time: test_papers_car.py.
QUICK = (reina.parts, reina_soil.parts, li_rolling.parts, li_forced.parts)


@pytest.fixture(scope="module")
def parts() -> dict[str, Part]:
    return {f"{part.paper} {part.title}": part for source in QUICK for part in source()}


def check(part: Part, beginning: str) -> Check:
    (found,) = (c for c in part.checks if c.what.startswith(beginning))
    return found


def test_figures_stand_before_tables_by_their_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    def some(*titles: str) -> list[Part]:
        return [Part("one", title, "", ()) for title in titles]

    for module, found in ((reina, some("Table 2", "Fig. 10")), (reina_soil, some("Fig. 9", "Table 1"))):
        monkeypatch.setattr(module, "parts", lambda found=found: found)
    for module in (li_rolling, li_forced, build_module.vella):
        monkeypatch.setattr(module, "parts", list)
    assert [part.title for part in build_module.collect()] == ["Fig. 9", "Fig. 10", "Table 1", "Table 2"]


def test_a_number_is_reproduced_to_half_a_unit_of_its_last_digit() -> None:
    assert digits("x", ["0.85"], [0.8549]).outcome == REPRODUCED
    assert digits("x", ["0.85"], [0.8551]).outcome == FAILED
    assert digits("x", ["0.850"], [0.8506]).outcome == FAILED  # a printed 0 counts
    assert digits("x", ["0.28e-3"], [2.851e-4]).outcome == FAILED
    assert digits("x", ["1150"], [1150.4]).outcome == REPRODUCED
    assert digits("x", ["1.0", "2.0"], [1.0, 2.2]).outcome == FAILED  # all of them
    assert digits("x", ["1.0"], [1.12], extra=[0.1]).outcome == REPRODUCED  # what rounded inputs explain
    assert digits("x", ["1.0"], [1.0], missing=["mass"]).outcome == ASSUMED  # right by our assumption only
    assert digits("x", ["2.0"], [3.0]).near == "off by up to 50 %"


def test_statements_hold_at_every_setting_or_not_at_any() -> None:
    assert states("s", True, "").outcome == REPRODUCED
    assert states("s", False, "").outcome == FAILED
    assert states("s", True, "", missing=["mass"]).outcome == ASSUMED
    assert states("s", [True, True], "").outcome == REPRODUCED
    assert states("s", [True, False], "").outcome == ASSUMED
    assert states("s", [False, False], "").outcome == FAILED
    assert near("x", "2.0", 2.1, 0.1).outcome == REPRODUCED
    assert near("x", "2.0", 2.3, 0.1).outcome == FAILED
    assert ranged("x", 1.0, 2.0, 1.9, 3.0, "").outcome == ASSUMED
    assert ranged("x", 1.0, 2.0, 3.0, 4.0, "").outcome == FAILED
    assert "1.50" in ranged("x", 1.0, 2.0, 3.0, 4.0, "").near
    assert unchecked("x", "", ["a curve"]).outcome == ASSUMED
    mixed = [states("s", False, ""), digits("x", ["1"], [1.0])]
    assert (worst(mixed, statements=False), worst(mixed, statements=True)) == (REPRODUCED, FAILED)
    assert worst(mixed[:1], statements=False) is None
    for module in (verdict, printed, page):
        assert doctest.testmod(module).failed == 0


def test_errors_of_every_reading_of_table_4(parts: dict[str, Part]) -> None:
    """Reference: an independent implementation, converged quadrature."""
    expected = {
        ("full (Eq. 3)", "nominal", "as printed"): (9.1, 19.1, 26.2, 35.5),
        ("full (Eq. 3)", "nominal", "clipped below 0.45"): (9.1, 15.6, 26.2, 33.8),
        ("full (Eq. 3)", "1 - r/R", "as printed"): (9.1, 18.7, 27.1, 35.4),
        ("full (Eq. 3)", "1 - r/R", "clipped below 0.45"): (9.1, 14.8, 27.1, 33.4),
        ("linear (Eq. 7)", "nominal", "as printed"): (18.9, 5.1, 15.1, 25.0),
        ("linear (Eq. 7)", "nominal", "clipped below 0.45"): (18.9, 8.6, 15.1, 23.2),
        ("linear (Eq. 7)", "1 - r/R", "as printed"): (17.7, 3.0, 15.8, 24.6),
        ("linear (Eq. 7)", "1 - r/R", "clipped below 0.45"): (17.7, 6.8, 15.8, 22.7),
    }
    found = {(r.stress, r.slip, r.extra): (*r.drawbar, *r.torque) for r in table4.readings()}
    assert found.keys() == expected.keys()
    for reading, errors in expected.items():
        assert found[reading] == pytest.approx(errors, abs=0.051), reading
    shown = parts["li Table 4"].tables[0]
    assert shown.head == ("stress", "slip", "R_f", "DP, Th. 1", "DP, Th. 2", "T, Th. 1", "T, Th. 2")
    assert {row[:3]: tuple(map(float, row[3:])) for row in shown.rows[1:]} == {
        reading: pytest.approx(errors, abs=0.051) for reading, errors in expected.items()
    }


def test_what_no_reading_of_table_4_can_change() -> None:
    table = table4.measured()
    rest = table.torque / table.radius - table.drawbar
    assert rest == pytest.approx([42.5, 48.7, 55.9, 51.2, 48.7], abs=0.06)
    for linear in (False, True):
        for clip in (False, True):
            t = table4.theory(table.actual, table.radius, table.load, linear, clip)
            one, two = t.torque / table.radius - t.drawbar, t.torque_2 / table.radius - t.drawbar_2
            assert two == pytest.approx(one, abs=1e-9)  # R_c and R_f cancel
            assert (rest > 1.9 * one).all()
    assert np.degrees(table4.needed_friction()) == pytest.approx([32.8, 42.2, 48.7, 46.4, 42.2], abs=0.05)
    assert table4.ceiling(np.radians(22.0)) == pytest.approx([94.9, 109.0, 111.8, 111.9, 109.0], abs=0.1)
    assert table4.ceiling(np.radians(45.0)) == pytest.approx([112.9, 117.3, 119.3, 119.3, 117.3], abs=0.1)


def test_the_radius_that_would_fit_is_a_diagnosis() -> None:
    table = table4.measured()
    radius, rms, theory = table4.best_radius(table.nominal)
    assert (radius, rms) == (pytest.approx(0.3189, abs=2e-4), pytest.approx(1.73, abs=0.01))
    assert theory.torque_2 == pytest.approx(table.torque, rel=0.04)
    radius, rms, _ = table4.best_radius(table.actual)
    assert (radius, rms) == (pytest.approx(0.3180, abs=2e-4), pytest.approx(3.19, abs=0.01))
    assert table4.self_propelled(75.5)[1] == pytest.approx(1.944, abs=2e-3)


def test_verdicts_on_li(parts: dict[str, Part]) -> None:
    four = parts["li Table 4"]
    assert worst(four.checks, statements=False) == REPRODUCED
    assert all(c.outcome == FAILED for c in four.checks if c.statement)
    assert "factor of 2.26" in check(four, "Theory 2 explains").why
    assert "at most 5.8 points, 12.4 are claimed" in check(four, "errors fall").found
    assert "Diagnosis only" in four.text[0]
    assert all(c.outcome == REPRODUCED for c in parts["li Table 3"].checks)
    assert [c.outcome for c in parts["li Table 2"].checks] == [REPRODUCED] * 4 + [FAILED]
    six = parts["li Fig. 6"]
    assert [c.outcome for c in six.checks] == [REPRODUCED] * 4 + [FAILED]
    nine = parts["li Fig. 9"]
    assert [c.outcome for c in nine.checks] == [FAILED, FAILED, REPRODUCED]
    assert check(parts["li Fig. 4"], "on sand it is symmetric").outcome == ASSUMED  # its unit is not printed
    assert check(parts["li Fig. 4"], "the robot rolls on the sand").outcome == FAILED


def test_verdicts_on_reina(parts: dict[str, Part]) -> None:
    two = parts["reina Table 2"]
    assert check(two, "T/(R W)").near == "never nearer than a factor of 1.58"
    assert "1.18 kPa and 24.0 deg" in check(two, "(13) to (15) yield").found
    assert "0.357 to 0.005" in check(two, "by Eq. (10) as printed").found
    one = parts["reina Table 1"].checks
    assert [c.outcome for c in one] == [REPRODUCED] * 4 + [ASSUMED]
    three = parts["reina Fig. 3"].checks
    assert [c.outcome for c in three] == [ASSUMED] + [REPRODUCED] * 3
    assert parts["reina Fig. 7"].checks[0].outcome == ASSUMED


def test_a_wrong_print_would_be_found(parts: dict[str, Part], monkeypatch: pytest.MonkeyPatch) -> None:
    """Verdicts come from the numbers: another print, another verdict."""
    table = printed.printed()["li"]["table_3"]
    monkeypatch.setitem(table, "f", ["506.835", "243.687", "0.851"])
    (found,) = (part for part in li_rolling.parts() if part.title == "Table 3")
    assert check(found, "F").outcome == FAILED
    assert check(parts["li Table 3"], "F").outcome == REPRODUCED


def test_the_command_writes_one_page_with_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], parts: dict[str, Part]
) -> None:
    monkeypatch.setattr(build_module, "collect", lambda progress: list(parts.values()))
    hashes = []
    for name in ("a", "b"):
        monkeypatch.setattr("sys.argv", ["terrapin", "papers", "-o", str(tmp_path / name)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert not ended.value.code
        files = sorted((tmp_path / name).iterdir())
        hashes.append([(f.name, hashlib.sha256(f.read_bytes()).hexdigest()) for f in files])
    assert hashes[0] == hashes[1]
    assert "li     Table 4" in capsys.readouterr().out
    text = (tmp_path / "a" / "papers.html").read_text()
    assert text.count("<img ") == sum(len(part.figures) for part in parts.values())
    assert 'src="http' not in text  # self-contained
    assert 'href="http' not in text
    answer = json.loads((tmp_path / "a" / "papers.json").read_text())
    assert [p["part"] for p in answer["parts"]] == [part.title for part in parts.values()]


def test_a_file_in_the_way_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x").write_text("")
    monkeypatch.setattr("sys.argv", ["terrapin", "papers", "-o", str(tmp_path / "x")])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert "expected a folder" in capsys.readouterr().err
