"""`terrapin batch`: the same bytes however it is worked on, stopped and gone on with; runs repeated; bad input."""

from __future__ import annotations

import errno
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from casekit import one_line, terrapin

from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from terrapin_tools.batch import filling, journal, told
from terrapin_tools.batch.design import Row, design, read_seeds, read_varied
from terrapin_tools.batch.one_run import Plan, work
from terrapin_tools.batch.summary import classes, summarise
from terrapin_tools.batch.table import Table
from terrapin_tools.commands.batch import batch
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.fleet.pool import IDLE
from tests.waiting import BOUND, wait_for

TERRAPIN = [sys.executable, "-c", "from terrapin_tools.cli import main; main()"]
FILES = ("runs.parquet", "summary.json", "report.html", "failed.sh")
SCENARIO = """title = "Up a slope"
duration = "1 s"
checks = ["max(slip[0.5:]) < 0.3", "last(position) > 0.05"]
[[path]]
terrain = "sand"
[[operator]]
at = "0 s"
request = "run"
setpoint = "6 V"
"""
VARIED = ("--vary", "path.1.slope=0deg:12deg", "--vary", "path.1.terrain=sand,dry_peat")


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "climb.toml"
    path.write_text(SCENARIO)
    return path


def contents(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in FILES}


def table(folder: Path) -> dict[str, Any]:
    return dict(pq.read_table(folder / "runs.parquet").to_pydict())


def started(*words: str | Path) -> subprocess.Popen[bytes]:
    """A batch on its own, in a process group of its own."""
    return subprocess.Popen(
        [*TERRAPIN, "batch", *map(str, words)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def test_one_row_a_run_and_every_failed_one_repeatable(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path
) -> None:
    out = tmp_path / "batch"
    command = ["batch", scenario, "--seeds", "1:24", *VARIED, "--metric", "max(slip) - min(slip)", "--out", out]
    status, words, err = terrapin(capsys, *command, "--jobs", 1, "--json")
    told = json.loads(words)
    found = table(out)
    assert found["run"] == list(range(24))
    assert found["seed"] == list(range(1, 25))
    assert "24 runs in" in err
    assert set(found["path.1.terrain"]) == {"sand", "dry_peat"}
    assert 0.0 <= min(found["path.1.slope"]) < 2.0 < 10.0 < max(found["path.1.slope"]) <= 12.0
    failed = [i for i, passed in enumerate(found["passed"]) if not passed]
    assert 0 < len(failed) < 24
    assert (status, told["runs"], told["failed"]) == (1, 24, len(failed))
    assert (len(told["commands"]), told["errors"]) == (len(failed), 0)
    for i in range(24):
        assert found["passed"][i] == (
            found["check max(slip[0.5:]) < 0.3"][i] and found["check last(position) > 0.05"][i]
        )
        assert (found["max(slip[0.5:])"][i] < 0.3) == found["check max(slip[0.5:]) < 0.3"][i]
    for number, line in zip(failed[:3], told["commands"], strict=False):
        status, words, _ = terrapin(capsys, *shlex.split(line)[1:], "--json")
        assert status == 1
        assert json.loads(words)["output_sha256"] == found["output_sha256"][number]
    assert (out / "failed.sh").read_text().count("terrapin run") == len(failed)
    units = {
        "last(position)": "m",
        "max(abs(current))": "A",
        "max(winding_temperature)": "degC",
        "contact_error": "N m",
    }
    assert told["units"] == units  # slip has none, nor has the difference of two
    schema = pq.read_schema(out / "runs.parquet")
    assert all(schema.field(name).metadata == {b"unit": unit.encode()} for name, unit in units.items())
    assert "\n  max(abs(current)) [A] " in terrapin(capsys, *command)[1]


def test_the_same_bytes_for_any_number_of_jobs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path
) -> None:
    one, three = tmp_path / "one", tmp_path / "three"
    command = ["batch", scenario, "--seeds", "1:40", *VARIED]
    assert terrapin(capsys, *command, "--out", one, "--jobs", 1)[0] == 1
    assert terrapin(capsys, *command, "--out", three, "--jobs", 3)[0] == 1
    assert contents(one) == contents(three)
    status, _, err = terrapin(capsys, *command, "--out", one)
    assert status == 1
    assert "0 runs in" in err  # all were there


def test_kill_9_loses_at_most_one_run_a_worker(tmp_path: Path, scenario: Path) -> None:
    out, whole = tmp_path / "killed", tmp_path / "whole"
    command = [str(scenario), "--seeds", "1:600", *VARIED, "--jobs", "2"]
    running = started(*command, "--out", out)

    def begun() -> list[Path]:
        files = list((out / "runs").glob("*.jsonl"))
        return files if len(files) == 2 and all(file.stat().st_size > 5000 for file in files) else []

    files = wait_for(begun)
    os.killpg(running.pid, signal.SIGKILL)
    running.communicate()
    lines = [line for file in files for line in file.read_bytes().splitlines(keepends=True)]
    assert sum(not line.endswith(b"\n") for line in lines) <= 2
    before = journal.read_journals(out)
    assert 0 < len(before) < 600
    again = started(*command, "--out", out)
    _, err = again.communicate(timeout=BOUND)
    assert again.returncode == 1, err
    assert f"{600 - len(before)} runs in".encode() in err
    other = started(*command, "--out", whole)
    other.communicate(timeout=BOUND)
    assert contents(out) == contents(whole)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the workers end when they find no more work")
def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path, scenario: Path) -> None:
    """Alone, not with its group: nobody is left to end them."""
    out = tmp_path / "batch"
    running = started(str(scenario), "--seeds", "1:2000", "--out", out, "--jobs", "2")
    files = wait_for(lambda: files if len(files := list((out / "runs").glob("*.jsonl"))) == 2 else [])
    running.kill()
    running.wait()
    killed = time.monotonic()
    wait_for(lambda: not any(Path("/proc", file.name.partition("-")[0]).exists() for file in files))
    assert time.monotonic() - killed < IDLE  # sooner than they end by themselves
    running.communicate()


def test_a_line_that_is_damaged_is_done_again(tmp_path: Path) -> None:
    first, again = tmp_path / "first", tmp_path / "again"
    for folder in (first, again):
        (folder / "runs").mkdir(parents=True)
    plan, rows = Plan("climb.toml", SCENARIO), [Row(i, i) for i in range(3)]
    whole = filling.fill(plan, rows, first, 1.0)
    (file,) = (first / "runs").glob("*.jsonl")
    lines = file.read_bytes().splitlines(keepends=True)
    damaged = [lines[0], b"\0" * 40 + lines[1][40:], b"[1]\n", lines[2]]
    (again / "runs" / "1-2.jsonl").write_bytes(b"".join(damaged))
    assert set(journal.read_journals(again)) == {0, 2}
    assert [answer.output for answer in filling.fill(plan, rows, again, 1.0)] == [answer.output for answer in whole]


def test_each_run_is_written_before_the_next_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that whatever kills a worker costs it one run: the journal has all those before the one in work."""
    from terrapin_tools.batch import one_run

    (tmp_path / "runs").mkdir()
    plan = Plan("climb.toml", SCENARIO)
    answer = one_run._answer
    before: list[int] = []

    def counting(plan: Plan, row: Row) -> Any:
        before.append(len(journal.read_journals(tmp_path)))
        return answer(plan, row)

    monkeypatch.setattr(one_run, "_answer", counting)
    one_run.work(plan, [Row(i, i) for i in range(5)], tmp_path)
    assert before == [0, 1, 2, 3, 4]


def test_ctrl_c_says_one_line_and_the_same_command_goes_on(tmp_path: Path, scenario: Path) -> None:
    out = tmp_path / "batch"
    command = [str(scenario), "--seeds", "1:2000", "--out", out, "--jobs", "2"]
    running = started(*command)
    wait_for(lambda: out.is_dir() and len(journal.read_journals(out)) > 20 if (out / "runs").is_dir() else False)
    os.killpg(running.pid, signal.SIGINT)
    _, err = running.communicate(timeout=BOUND)
    assert running.returncode == 130
    last = err.decode().splitlines()[-1]
    assert re.fullmatch(r"terrapin: interrupted: \d+ of 2000 runs are in .*; the same command goes on", last), err
    assert b"Traceback" not in err
    done = len(journal.read_journals(out))
    assert 20 < done < 2000
    progress = json.loads((out / "progress.json").read_text())
    assert (progress["runs"], progress["complete"]) == (2000, False)


def test_a_worker_that_dies_changes_nothing(tmp_path: Path, scenario: Path) -> None:
    out, whole = tmp_path / "killed", tmp_path / "whole"
    command = [str(scenario), "--seeds", "1:300", "--jobs", "2"]
    running = started(*command, "--out", out)
    victim = wait_for(lambda: [file for file in (out / "runs").glob("*.jsonl") if file.stat().st_size])[0]
    os.kill(int(victim.name.partition("-")[0]), signal.SIGKILL)
    _, err = running.communicate(timeout=BOUND)
    assert running.returncode in (0, 1), err
    assert b"terrapin: a worker died; run" in err
    other = started(*command, "--out", whole)
    other.communicate(timeout=BOUND)
    assert contents(out) == contents(whole)


def test_a_run_that_kills_its_worker_is_one_failed_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pool's part is played here: the task with run 2 breaks its worker each time."""
    from terrapin_tools.workbench.fleet.pool import Done, Lost

    class Broken:
        def done(self) -> bool:
            return True

        def result(self) -> Any:
            raise KeyError

    class Fragile:
        died = KeyError

        def workers(self) -> int:
            return 1

        def submit(self, function: Any, plan: Plan, rows: list[Row], folder: Path) -> Any:
            if any(row.number == 2 for row in rows):
                function(plan, [row for row in rows if row.number < 2], folder)
                return Broken()
            return Done(function(plan, rows, folder))

        def again(self, function: Any, plan: Plan, rows: list[Row], folder: Path) -> Any:
            raise Lost("killed twice")

    from contextlib import contextmanager

    @contextmanager
    def fragile(jobs: int, cluster: str) -> Any:
        yield Fragile()

    monkeypatch.setattr(filling, "pool", fragile)
    (tmp_path / "runs").mkdir()
    said: list[str] = []
    answers = filling.fill(Plan("climb.toml", SCENARIO), [Row(i, i) for i in range(5)], tmp_path, 1.0, say=said.append)
    assert [answer.number for answer in answers] == [0, 1, 2, 3, 4]
    assert [answer.error for answer in answers] == ["", "", "killed twice", "", ""]
    assert said == ["a worker died; run 2 is done again"]
    assert set(journal.read_journals(tmp_path)) == set(range(5))


def test_until_fail_ends_with_the_first_that_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path
) -> None:
    found = {}
    for jobs in (1, 3):
        out = tmp_path / f"hunt-{jobs}"
        hunt = ["batch", scenario, "--until", "FAIL", *VARIED, "--seeds", "1:5000", "--out", out, "--jobs", jobs]
        assert terrapin(capsys, *hunt)[0] == 1
        found[jobs] = contents(out)
        passed = table(out)["passed"]
        assert passed[-1] is False
        assert all(passed[:-1])
    assert found[1] == found[3]


def test_the_examples_of_the_help_say_something(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Values around those of the scenario: some runs hold its checks and some do not, so that something decides."""
    many, hunt = re.findall(r"terrapin batch (.+? --out) out/", " ".join(str(batch.__doc__).split()))
    assert "--seeds 1:1000 " in many
    assert terrapin(capsys, "batch", *many.replace("1:1000", "1:40").split(), tmp_path / "many")[0] == 1
    assert 8 <= sum(table(tmp_path / "many")["passed"]) <= 32
    assert terrapin(capsys, "batch", *hunt.split(), tmp_path / "hunt")[0] == 1
    assert len(table(tmp_path / "hunt")["passed"]) > 1


def test_a_number_without_value_says_why(tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path) -> None:
    out = tmp_path / "batch"
    metrics = ["max(slip[0.2:]) - max(slip[3:])", "max(NODE_STATUS.node)", "max(slip[0.2:0.5])"]
    options = [word for text in metrics for word in ("--metric", text)]
    _, words, _ = terrapin(capsys, "batch", scenario, "--seeds", "1:3", *options, "--out", out, "--jobs", 1)
    late, silent = "slip[3:] begins after their end at 1 s", "what it is of did not come, or not within its time window"
    assert f"  no value in 3 runs: {metrics[0]}: {late}\n" in words
    assert f"  no value in 3 runs: {metrics[1]}: {silent}\n" in words
    summary = json.loads((out / "summary.json").read_text())
    assert summary["why_missing"] == {metrics[0]: late, metrics[1]: silent} | (
        {"contact_error": "the controller called no C_t valid"} if summary["missing"]["contact_error"] else {}
    )
    assert late in (out / "report.html").read_text()
    some = a_table({}, np.array([True, False]), {"max(slip)": np.array([1.0, np.nan])})
    assert summarise(replace(some, error=["", "it runs away"])).why_missing == {
        "max(slip)": "they could not be run to the end"
    }


def test_a_batch_of_which_no_run_ended_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path
) -> None:
    """It said that what was varied decides 0.00 of it, under a table of no numbers."""
    scenario.write_text(scenario.read_text() + "[robot]\nviscous = 1e6\n")
    out = tmp_path / "batch"
    command = ["batch", scenario, "--seeds", "1:2", "--vary", "path.1.slope=0deg:12deg:4", "--out", out, "--jobs", 1]
    status, words, _ = terrapin(capsys, *command)
    assert status == 1
    assert "  none of them could be run to the end\n  ended       8 x  climb: the simulated motion has no" in words
    assert "  all failed: nothing that was varied decides it\n" in words
    assert "what decides" not in words
    assert "100 %\n" not in words.partition("limits")[2]  # the head of a table
    ((reason, count),) = json.loads((out / "summary.json").read_text())["reasons"].items()
    assert (reason in (out / "report.html").read_text(), count) == (True, 8)


def test_what_is_varied_decides_nothing_where_every_run_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path
) -> None:
    scenario.write_text(scenario.read_text().replace("last(position) > 0.05", "last(position) > 50"))
    command = ["batch", scenario, "--seeds", "1:12", *VARIED, "--out", tmp_path / "batch", "--jobs", 1]
    words = terrapin(capsys, *command)[1]
    assert "  all failed: nothing that was varied decides it\n" in words
    assert "what decides" not in words
    assert "All failed: " in (tmp_path / "batch" / "report.html").read_text()


def test_the_file_as_it_stands_is_a_batch_of_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path
) -> None:
    assert terrapin(capsys, "batch", scenario, "--out", tmp_path / "one", "--jobs", 1)[0] == 0
    _, words, _ = terrapin(capsys, "run", scenario, "--json")
    assert table(tmp_path / "one")["output_sha256"] == [json.loads(words)["output_sha256"]]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--vary", "robot.coulomb=-1:1"], ["--vary robot.coulomb", "found -1", "expected 0"]),
        (["--vary", "path.1.slope=0deg:200deg"], ["--vary path.1.slope", "200.0 deg"]),
        (["--vary", "firmware.window=1:1e9:2"], ["--vary firmware.window"]),
        (["--vary", "robot.colour=1:2"], ["--vary robot.colour", "no such field"]),
        (["--vary", "path.3.slope=0:0.1"], ["path.3.slope", "found 3, expected 1 to 1"]),
        (["--vary", "path.1.terrain=sand,lava"], ["lava", "expected one of"]),
        (["--vary", "supply.voltage=9V:9A"], ["units V and A"]),
        (["--vary", "supply.voltage=14:9"], ["lower end first"]),
        (["--vary", "supply.voltage=9:14:1"], ["LOW:HIGH:STEPS"]),
        (["--vary", "supply.voltage"], ["NAME=LOW:HIGH"]),
        (["--vary", "seed=1:5"], ["--seeds"]),
        (["--vary", "supply.voltage=9:10", "--vary", "supply.voltage=1:2"], ["twice"]),
        (["--vary", "supply.voltage=9:10", "--design", "grid"], ["STEPS"]),
        (["--vary", "supply.voltage=9:10", "--design", "sobel"], ["sobel", "grid, random, lhs, sobol"]),
        (["--points", "5"], ["--points"]),
        (["--seeds", "5:1"], ["--seeds", "5:1"]),
        (["--seeds", "one"], ["--seeds", "'one'"]),
        (["--metric", "max(wheels)"], ["--metric", "wheels"]),
        (["--metric", "slip"], ["--metric", "max()"]),
        (["--until", "DAWN"], ["--until", "FAIL"]),
        (["--cluster", "tcp://127.0.0.1:99999"], ["--cluster", "99999"]),
    ],
)
def test_bad_input_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path, options: list[str], said: list[str]
) -> None:
    out = tmp_path / "batch"
    status, words, err = terrapin(capsys, "batch", scenario, *options, "--out", out)
    assert (status, words) == (2, "")
    one_line(err.splitlines()[-1] + "\n", said)
    assert not (out / "runs.parquet").exists()


def test_a_folder_of_another_batch_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path
) -> None:
    out = tmp_path / "batch"
    assert terrapin(capsys, "batch", scenario, "--seeds", "1:3", "--out", out, "--jobs", 1)[0] == 0
    before = contents(out)
    status, _, err = terrapin(capsys, "batch", scenario, "--seeds", "1:4", "--out", out)
    assert status == 2
    one_line(err, [str(out), "another batch (seeds)", "expected"])
    scenario.write_text(SCENARIO.replace("6 V", "7 V"))
    status, _, err = terrapin(capsys, "batch", scenario, "--seeds", "1:3", "--out", out)
    one_line(err, ["another batch (source)"])
    assert contents(out) == before
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    status, _, err = terrapin(capsys, "batch", scenario, "--out", tmp_path / "mine")
    assert status == 2
    one_line(err, ["no batch", "new folder"])


def test_two_at_once_on_one_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path) -> None:
    import fcntl

    out = tmp_path / "batch"
    (out / "runs").mkdir(parents=True)
    with (out / "runs" / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        status, _, err = terrapin(capsys, "batch", scenario, "--out", out)
    assert status == 1
    one_line(err, [str(out), "another process"])


def test_a_full_disk_is_one_line_and_what_was_finished_stays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, scenario: Path
) -> None:
    out, write, room = tmp_path / "batch", os.write, [4000]

    def full(file: int, data: bytes) -> int:
        if not os.readlink(f"/proc/self/fd/{file}").endswith(".jsonl"):
            return write(file, data)
        if room[0] <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        part = data[: room[0]]
        room[0] -= len(part)
        return write(file, part)

    command = ["batch", scenario, "--seeds", "1:30", "--out", out, "--jobs", 1]
    monkeypatch.setattr(os, "write", full)
    status, _, err = terrapin(capsys, *command)
    assert status == 1
    one_line(err.splitlines()[-1] + "\n", [str(out), "No space left", "what was finished stays"])
    kept = journal.read_journals(out)
    assert 0 < len(kept) < 30
    assert all(file.read_bytes().endswith(b"\n") for file in (out / "runs").glob("*.jsonl"))
    monkeypatch.undo()
    journal._journal.cache_clear()
    assert terrapin(capsys, *command)[0] == 0
    assert table(out)["run"] == list(range(30))


def test_values_that_do_not_go_together_are_a_failed_row() -> None:
    """Each end is right on its own; together the second segment begins inside the first one's transition."""
    text = (
        SCENARIO
        + '[[path]]\nfrom = "0.5 m"\nterrain = "sand"\ntransition = "10 cm"\n[[path]]\nfrom = "2 m"\nterrain = "sand"\n'
    )
    row = Row(0, 1, (("path.2.transition", "1.2 m"), ("path.3.from", "1 m")))
    (answer,) = work(Plan("climb.toml", text), [row])
    assert not answer.passed
    assert "reaches into the next" in answer.error


def test_designs() -> None:
    """A grid has every combination; the others fill their ranges evenly, the same for the same draw."""
    slope, ground = read_varied("path.1.slope=0:1"), read_varied("path.1.terrain=sand,dry_peat")
    grid = list(design([1, 2], [read_varied("a.b=0:1:3"), ground]))
    assert len(grid) == 12
    assert [row.number for row in grid] == list(range(12))
    assert len({(row.seed, row.values) for row in grid}) == 12
    for kind in ("random", "lhs", "sobol"):
        rows = list(design(range(1, 65), [slope, ground], kind))
        assert rows == list(design(range(1, 65), [slope, ground], kind))
        assert rows != list(design(range(1, 65), [slope, ground], kind, draw=1))
        values = np.array([dict(row.values)["path.1.slope"] for row in rows])
        if kind != "random":
            assert (np.histogram(values, 16, (0.0, 1.0))[0] == 4).all()
            assert [dict(row.values)["path.1.terrain"] for row in rows].count("sand") == 32
        crossed = list(design([7, 8], [slope], kind, points=5))
        assert [row.seed for row in crossed] == [7, 8] * 5
        assert len({row.values for row in crossed}) == 5


def test_more_points_go_on_with_a_sobol_sequence() -> None:
    slope = read_varied("path.1.slope=0:1")
    few, many = (list(design(range(count), [slope], "sobol")) for count in (20, 50))
    assert many[:20] == few


def test_seeds_and_values_as_they_are_written() -> None:
    assert list(read_seeds("1:3,7")) == [1, 2, 3, 7]
    assert read_varied("a=1,2.5,true,word,4 V").levels == (1, 2.5, True, "word", "4.0 V")
    assert read_varied("a=-1e-3V:2V").ends == ("-0.001 V", "2.0 V")
    with pytest.raises(UserError, match="twice"):
        read_seeds("1:3,2")


def test_set_changes_what_the_file_says(tmp_path: Path, scenario: Path) -> None:
    """Whatever the table, comments stay; the changed text alone says the same."""
    values = {"path.1.slope": "3 deg", "robot.coulomb": 0.02, "operator.1.limiter": False, "firmware.window": "0.3 s"}
    changed = load_scenario(scenario, values)
    assert changed.robot.coulomb == 0.02
    assert changed.ground.segments[0].slope == pytest.approx(np.radians(3.0))
    assert changed.operator[0].limiter is False
    (tmp_path / "again.toml").write_text(changed.source)
    again = load_scenario(tmp_path / "again.toml")
    assert (again.robot, again.ground, again.firmware) == (changed.robot, changed.ground, changed.firmware)
    assert load_scenario(find_scenario("steady_sand"), {"supply.voltage": "11 V"}).supply == 11.0


def test_bad_set_is_one_line(capsys: pytest.CaptureFixture[str], scenario: Path) -> None:
    for words, said in (
        (["--set", "robot.coulomb"], ["--set", "NAME=VALUE"]),
        (["--set", "path.2.slope=0"], ["path.2.slope: found 2, expected 1 to 1: the scenario's file has to have it"]),
        (["--set", "fault.2.from=3"], ["fault.2.from: found 2, expected none: the scenario's file has to have it"]),
        (["--set", "path.slope=0"], ["path.slope", "expected a table"]),
        (["--set", "robot.coulomb=-3"], ["climb.toml", "robot.coulomb", "found -3"]),
        (["--set", "../x=3"], ["'../x'", "name of a field"]),
    ):
        status, _, err = terrapin(capsys, "run", scenario, *words)
        assert status == 2
        one_line(err, said)


def a_table(inputs: dict[str, Any], passed: Any, numbers: dict[str, Any]) -> Table:
    count = len(passed)
    return Table(
        np.arange(count), np.arange(count), np.asarray(passed), [""] * count, [""] * count, inputs, {}, {}, numbers
    )


def test_what_decides_is_found() -> None:
    """One input alone decides over failing; another over a number; a third over nothing."""
    random = np.random.default_rng(1)
    first, second, third = random.random((3, 2000))
    word = [("a", "b")[i] for i in random.integers(0, 2, 2000)]
    found = summarise(
        a_table(
            {"third": third, "word": word, "second": second, "first": first},
            first < 0.7,
            {
                "y": second**2 + 1e-3 * random.standard_normal(2000),
                "flat": np.ones(2000),
                "none": np.full(2000, np.nan),
            },
        )
    )
    decides = found.decides["failed"]
    assert next(iter(decides)) == "first"
    assert decides["first"] > 0.8
    assert max(decides["second"], decides["third"], decides["word"]) < 0.02
    assert found.decides["y"]["second"] > 0.95
    assert set(found.decides["flat"].values()) == set(found.decides["none"].values()) == {0.0}
    assert found.quantiles["none"] == [None] * 7
    assert found.missing["none"] == 2000
    parts = found.classes["first"]
    assert sum(part.runs for part in parts) == 2000
    assert [part.failed for part in parts[:6]] == [0] * 6
    assert parts[-1].failed == parts[-1].runs


@pytest.mark.parametrize(
    ("runs", "said"), [(10, "too few runs to say what decides"), (200, "what decides whether it fails (share")]
)
def test_few_runs_do_not_say_what_decides(runs: int, said: str) -> None:
    x = np.linspace(0.0, 1.0, runs)
    assert said in told.words(summarise(a_table({"x": x}, x < 0.65, {})), "head", [], "folder")


def test_correlation_ratio_against_a_closed_form() -> None:
    """Two levels with means 0 and 1, noise of sd 1: the share between them is 0.25 / 1.25."""
    random = np.random.default_rng(2)
    level = np.repeat([0.0, 1.0], 20_000)
    found = summarise(a_table({"x": level}, level < 2.0, {"y": level + random.standard_normal(40_000)}))
    assert found.decides["y"]["x"] == pytest.approx(0.2, abs=0.01)
    assert classes(level)[1] == [("0", 0.0, 0.0), ("1", 1.0, 1.0)]


def test_the_report_escapes_what_it_shows(tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path) -> None:
    evil = tmp_path / "<img src=x>.toml"
    evil.write_text(SCENARIO)
    out = tmp_path / "batch"
    terrapin(capsys, "batch", evil, "--seeds", "1:12", *VARIED, "--out", out, "--jobs", 1)
    page = (out / "report.html").read_text()
    assert "<img" not in page
    assert "<script" not in page
    assert page.count("<svg") >= 3
    assert (
        '<th colspan="9"\nscope="rowgroup"><code>last(position)</code>' in page
    )  # a row of its own: no name is broken
