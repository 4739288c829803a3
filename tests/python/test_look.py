"""`terrapin look`: faults that were put into a table are found where they are, and what has none says none."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from casekit import terrapin

from terrapin_tools.workbench.intake.look import describe, look
from terrapin_tools.workbench.intake.look_columns import clock, quantum, saturation, steady

ROWS = 2000


def columns(seed: int = 1) -> dict[str, np.ndarray]:
    """A rig at three speeds of 600 rows with ramps between: 100 Hz."""
    random = np.random.default_rng(seed)
    time = np.arange(ROWS) * 0.01
    speed = np.interp(time, [0, 6, 7, 13, 14, 20], [1, 1, 2, 2, 3, 3.0])
    return {
        "time [s]": time,
        "speed [rad/s]": speed + random.normal(0, 0.01, ROWS),
        "torque [N m]": 2 * speed + random.normal(0, 0.05, ROWS),
    }


def write(path: Path, table: dict[str, np.ndarray]) -> Path:
    np.savetxt(path, np.stack(list(table.values()), 1), "%.12g", ",", header=",".join(table), comments="")
    return path


def column(answer: dict[str, object], name: str) -> dict[str, object]:
    (found,) = (c for c in answer["columns"] if c["column"] == name)  # type: ignore[attr-defined]
    return dict(found)


def test_a_sound_table(tmp_path: Path) -> None:
    path = write(tmp_path / "x.csv", columns())
    before = hashlib.sha256(path.read_bytes()).digest()
    answer = look(path)
    assert (answer["rows"], answer["time"]["period"]) == (ROWS, pytest.approx(0.01))
    assert [c["unit"] for c in answer["columns"]] == ["s", "rad/s", "N m"]
    assert (answer["time"]["gap_count"], answer["time"]["steps_back"], answer["same"]) == (0, 0, [])
    for c in answer["columns"][1:]:
        assert (c["constant"], c["saturated"], c["stuck"], c["missing"]) == (False, [], None, 0)
    assert column(answer, "speed [rad/s]")["noise"] == pytest.approx(0.01, rel=0.15)
    assert answer["runs"]["count"] == 1
    assert [pytest.approx((a, b), abs=0.5) for a, b in ((0, 6), (7, 13), (14, 20))] == [
        (s["begin"], s["end"]) for s in answer["steady"] if s["end"] - s["begin"] > 2
    ]
    assert hashlib.sha256(path.read_bytes()).digest() == before
    assert {entry.name for entry in tmp_path.iterdir()} == {"x.csv"}


def test_each_fault_is_told(tmp_path: Path) -> None:
    table = columns()
    table["limited [A]"] = np.minimum(table["torque [N m]"], 5.0)
    table["again [rad/s]"] = table["speed [rad/s]"]
    table["steps [V]"] = np.round(table["torque [N m]"] / 0.05) * 0.05
    table["constant [K]"] = np.full(ROWS, 293.0)
    table["stuck [N]"] = table["torque [N m]"].copy()
    table["stuck [N]"][700:760] = table["stuck [N]"][700]
    table["time [s]"][1200:] += 3.0
    table["time [s]"][300] = table["time [s]"][298]
    answer = look(write(tmp_path / "x.csv", table))
    assert column(answer, "limited [A]")["saturated"] == [{"at": 5.0, "rows": int((table["limited [A]"] == 5).sum())}]
    assert answer["same"] == [["speed [rad/s]", "again [rad/s]"]]
    assert column(answer, "steps [V]")["step"] == pytest.approx(0.05)
    assert column(answer, "constant [K]")["constant"]
    assert column(answer, "stuck [N]")["stuck"] == {"rows": 59, "first": 701}
    assert column(answer, "torque [N m]")["stuck"] is None
    clock_ = answer["time"]
    assert (clock_["gap_count"], clock_["gaps"][0]["row"], clock_["steps_back"]) == (1, 1199, 1)
    assert clock_["gaps"][0]["lasts"] == pytest.approx(3.01)
    words = describe(answer)
    clock_words = ("1 gap, the first of 3.01 s", "the clock steps back 1 time")
    column_words = ("saturates at 5 ", "steps of 0.05", "constant", "sticks in 59 rows, from row 702")
    for said in (*clock_words, *column_words, "the same numbers: speed"):
        assert said in words
    assert len(words.splitlines()) < 25


def test_one_steady_state_is_told_as_one(tmp_path: Path) -> None:
    """One setting held for six of twenty seconds, the rest a sine: "1 stretches" was told of it."""
    table = columns()
    answer = look(write(tmp_path / "x.csv", table))
    assert f"{answer['steady_count']} stretches may be steady states, the first: " in describe(answer)
    one = {**answer, "steady_count": 1}
    assert "\n  1 stretch may be a steady state: " in describe(one)


def test_nothing_is_found_in_noise() -> None:
    """Of 100 columns of noise and of a slow sine none saturates or has steps."""
    random = np.random.default_rng(5)
    for _ in range(100):
        values = random.normal(size=500) + 3 * np.sin(np.arange(500) / 40)
        assert saturation(values) == []
        assert quantum(values) is None


@pytest.mark.parametrize("step", [0.001, 0.25, 3.0])
def test_steps_though_the_least_difference_is_a_multiple(step: float) -> None:
    values = np.array([0, 2, 5, 9, 13, 20] * 5) * step + 7
    assert quantum(values) == pytest.approx(step)


def test_runs_begin_where_the_clock_does() -> None:
    times = np.concatenate([np.arange(50) * 0.1, np.arange(50) * 0.1])
    found = clock(times, np.repeat([0, 1], 50))
    assert (found["steps_back"], found["gap_count"]) == (0, 0)
    assert steady([np.arange(100.0)], np.repeat([0, 1], 50)) == []


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = columns()
    table["time [s]"][1000:] -= 10.0
    path = write(tmp_path / "x.csv", table)
    for kind, begin in (("png", b"\x89PNG"), ("svg", b"<?xml")):
        status, out, _ = terrapin(capsys, "look", path, "--plot", tmp_path / f"p.{kind}")
        assert status == 0
        assert "2 runs, by a clock that begins again" in out
        assert (tmp_path / f"p.{kind}").read_bytes().startswith(begin)
    (tmp_path / "empty").mkdir()
    status, out, _ = terrapin(capsys, "look", path, path, "--json", "-")
    assert [one["rows"] for one in json.loads(out)["files"]] == [ROWS, ROWS]
    for words, expected in (
        (["look", tmp_path / "no.csv"], "no.csv: no such file\n"),
        (["look", tmp_path / "empty"], "empty: found no table in the folder, expected files that end in "),
        (["look", path, path, "--plot", tmp_path / "q.png"], "expected one"),
    ):
        status, out, err = terrapin(capsys, *words)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert expected in err


def test_a_folder_is_the_tables_in_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As it is to `terrapin case table`; it was `is a folder, expected a file`."""
    for name in ("b.csv", "a.csv"):
        write(tmp_path / name, columns())
    (tmp_path / "notes.md").write_text("of the day")
    status, out, _ = terrapin(capsys, "look", tmp_path)
    assert status == 0
    assert [line.split(":")[0] for line in out.splitlines() if " rows, " in line] == ["a.csv", "b.csv"]


def test_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "x.dbc").write_text('VERSION ""\nBU_: A\nBO_ 272 M: 8 A\n SG_ a : 0|16@1+ (0.5,0) [0|65] "N" A\n')
    rows = [f"({0.02 * i:.6f}) can0 110#{(i * 7) % 200:02X}00\n" for i in range(300)]
    (tmp_path / "x.log").write_text("".join(rows))
    status, out, _ = terrapin(capsys, "look", tmp_path / "x.log", "--dbc", tmp_path / "x.dbc")
    assert status == 0
    assert "300 frames of 1 messages on 1 bus" in out
    assert "M.a" in out
    assert "steps of 0.5" in out
    assert "every 0.02 s, 50 Hz" in out
    status, out, _ = terrapin(capsys, "look", tmp_path / "x.log")
    assert status == 0
    assert "no frame with a time that the description of the bus knows" in out
