"""A folder of cases: one line each, in order, whatever the number of processes and whatever breaks on the way."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from casekit import ROLLING, one_line, rolling, terrapin

from terrapin_tools.workbench.case import case as case_module
from terrapin_tools.workbench.fleet import fleet
from tests.waiting import BOUND, wait_for

TERRAPIN = [sys.executable, "-c", "from terrapin_tools.cli import main; main()"]
MANY = 60  # cases: to be interrupted long before all are done, on a machine where half of the workers start late


def a_fleet(folder: Path, count: int) -> Path:
    for i in range(count):
        text = ROLLING.replace('"Rolling"', f'"Rolling {i}\\u2028\\U0001F422"')
        rolling(folder / f"case-{i:02d}", i, heating=0.004 * (i % 2), text=text)
    return folder


def without_seconds(text: str) -> str:
    return re.sub(r'"seconds": [0-9.e+-]+', '"seconds": 0', text)


def lines(text: str) -> list[dict[str, Any]]:
    assert text.endswith("\n")
    return [json.loads(line) for line in text.splitlines()]


def workers_of(parent: int) -> list[int]:
    """Processes of loky that the process has started."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and int((entry / "stat").read_text().rpartition(")")[2].split()[1]) == parent:
                found += [int(entry.name)] if "popen_loky" in (entry / "cmdline").read_text() else []
        except (OSError, ValueError):
            continue
    return found


def is_progress(line: str, count: int) -> bool:
    """Whether a line is one of those that a slow machine says on standard error now and then."""
    return re.match(rf"\d+ of {count} cases", line) is not None


def leaves_ctrl_c(worker: int) -> bool:
    """Whether a worker has come so far that it leaves Ctrl-C to its parent."""
    status = Path(f"/proc/{worker}/status").read_text()
    masks = (line.split()[1] for line in status.splitlines() if line.startswith(("SigIgn", "SigBlk")))
    return any(int(mask, 16) >> (signal.SIGINT - 1) & 1 for mask in masks)


@pytest.mark.parametrize("command", ["compare", "discover"])
def test_a_line_a_case_whatever_the_number_of_processes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    folder = a_fleet(tmp_path, 3)
    (folder / "case-00b").mkdir()
    (folder / "case-00b" / "case.toml").write_text("[model\n")
    (folder / "case-01b").mkdir()
    (folder / ".hidden").mkdir()
    (folder / "notes.txt").write_text("no case")
    status, out, err = terrapin(capsys, command, folder, "--json", "-")
    assert status == 0
    assert "5 cases in" in err
    assert "2 failed" in err
    found = lines(out)
    assert [line["folder"] for line in found] == ["case-00", "case-00b", "case-01", "case-01b", "case-02"]
    assert found[1].keys() == found[3].keys() == {"case", "folder", "error"}
    assert "case.toml:1: not TOML" in found[1]["error"]
    assert "no such file" in found[3]["error"]
    _, alone, _ = terrapin(capsys, command, folder / "case-02", "--json", "-")
    single = json.loads(without_seconds(alone))
    assert {key: value for key, value in found[4].items() if key not in ("folder", "seconds")} == {
        key: value for key, value in single.items() if key != "seconds"
    }
    file = tmp_path / "answers.jsonl"
    status, words, _ = terrapin(capsys, command, folder, "--json", file, "--jobs", 2)
    assert status == 0
    assert without_seconds(file.read_text()) == without_seconds(out)
    assert [line.partition(":")[0] for line in words.splitlines()] == [line["folder"] for line in found]


def test_a_folder_without_cases_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "sub").mkdir()
    target = tmp_path / "answers.jsonl"
    status, out, err = terrapin(capsys, "discover", tmp_path, "--json", target)
    assert (status, out) == (2, "")
    one_line(err, ["case.toml", "folder of such"])
    assert not target.exists()


def test_a_worker_that_dies_is_replaced_and_changes_nothing(tmp_path: Path) -> None:
    folder = a_fleet(tmp_path, 6)
    expected, killed = tmp_path / "expected.jsonl", tmp_path / "killed.jsonl"
    subprocess.run([*TERRAPIN, "compare", folder, "--json", expected], check=True, capture_output=True)
    running = subprocess.Popen(
        [*TERRAPIN, "compare", folder, "--json", killed, "--jobs", "2"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    victim = wait_for(lambda: workers_of(running.pid))[0]
    os.kill(victim, signal.SIGSTOP)  # so that it cannot be done before
    assert running.poll() is None
    os.kill(victim, signal.SIGKILL)
    _, err = running.communicate(timeout=BOUND)
    assert running.returncode == 0, err
    assert b"6 cases in" in err
    assert b" 0 failed" in err
    assert without_seconds(killed.read_text()) == without_seconds(expected.read_text())


def discovering(folder: Path, target: Path) -> subprocess.Popen[bytes]:
    """A folder on two processes, all in a group of their own."""
    command = [*TERRAPIN, "discover", folder, "--json", target, "--jobs", "2"]
    return subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background jobs ignore it
    )


def interrupted(running: subprocess.Popen[bytes]) -> list[str]:
    """Ctrl-C as a terminal sends it, to the whole group; the lines that were said until it ended, none of them lost."""
    os.killpg(running.pid, signal.SIGINT)
    _, err = running.communicate(timeout=BOUND)
    assert running.returncode == 130
    assert b"Traceback" not in err
    return err.decode().splitlines()


def test_ctrl_c_ends_at_once_and_leaves_whole_lines(tmp_path: Path) -> None:
    folder, target = a_fleet(tmp_path, MANY), tmp_path / "answers.jsonl"
    running = discovering(folder, target)
    wait_for(lambda: target.exists() and target.stat().st_size)
    wait_for(lambda: all(map(leaves_ctrl_c, workers_of(running.pid))))  # on a busy machine the second may be late
    workers = workers_of(running.pid)
    assert interrupted(running)[-1] == "terrapin: interrupted"
    assert 1 <= len(lines(target.read_text())) < MANY  # at once: what was not begun is not done
    wait_for(lambda: not [pid for pid in workers if Path(f"/proc/{pid}").exists()])  # who adopts them may be slow


def test_ctrl_c_while_workers_start_says_one_line(tmp_path: Path) -> None:
    """It reaches them too, before they have been told what to do with it."""
    folder, target = a_fleet(tmp_path, MANY), tmp_path / "answers.jsonl"
    running = discovering(folder, target)
    wait_for(lambda: workers_of(running.pid))  # at once: they import for a second
    *progress, last = interrupted(running)
    assert last == "terrapin: interrupted"
    assert all(is_progress(line, MANY) for line in progress)


def test_a_reader_that_leaves_is_no_error(tmp_path: Path) -> None:
    folder = a_fleet(tmp_path, MANY)
    running = subprocess.Popen(
        [*TERRAPIN, "compare", folder, "--json", "-"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert running.stdout is not None
    json.loads(running.stdout.readline())
    running.stdout.close()
    assert running.stderr is not None
    err = running.stderr.read().decode()
    assert running.wait(BOUND) == 141
    assert all(is_progress(line, MANY) for line in err.splitlines())


def test_cases_are_read_as_they_are_needed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Memory does not grow with the number of cases: only so many are under way."""
    case = case_module.load_case(rolling(tmp_path, 1))
    read: list[Path] = []

    def load(folder: Path) -> case_module.Case:
        read.append(folder)
        return case

    monkeypatch.setattr(fleet, "load_case", load)
    monkeypatch.setattr(fleet, "solve", lambda question, case: None)
    results = fleet.answers((tmp_path / str(i) for i in range(10_000)), fleet.Question("compare", 0, 0.05))
    for count in range(1, 20):
        assert next(results).name == str(count - 1)
        assert len(read) <= count + 1
    results.close()  # type: ignore[attr-defined]


def test_a_mistake_of_the_program_is_one_line_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(question: fleet.Question, case: case_module.Case) -> Any:
        raise ZeroDivisionError("float division by zero")

    monkeypatch.setattr(fleet, "solve", wrong)
    (result,) = fleet.answers([rolling(tmp_path, 1)], fleet.Question("compare", 0, 0.05))
    assert result.story is None
    assert "ZeroDivisionError: float division by zero" in result.error
