"""`make attack` in its short form, and that it would see what it looks for."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.attack.__main__ import attacks
from tests.attack.failing_writes import OTHERS, WRITES, command_names
from tests.attack.forked import Outcome, together

ROOT = Path(__file__).resolve().parents[2]


def attack(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tests.attack", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=3000)


@pytest.mark.parametrize("name", attacks())
def test_nothing_is_taken(name: str) -> None:
    done = attack("--short", "--only", name)
    assert done.returncode == 0, done.stdout + done.stderr
    counts = [int(tried) for tried in re.findall(r"^held  0 of (\d+)", done.stdout, re.MULTILINE)]
    assert counts, done.stdout
    assert min(counts) > 0


def test_every_command_is_tried_or_says_why_not() -> None:
    assert set(WRITES) | set(OTHERS) == command_names()
    assert not set(WRITES) & set(OTHERS)
    assert all(" ".join(write.arguments).startswith(name) for name, write in WRITES.items())


def test_what_it_is_to_be_without_a_disk_a_life_or_a_right(tmp_path: Path) -> None:
    """The three failures are real: the same command writes its file without them."""
    tmp_path.chmod(0o755)
    command = ("log", "dbc", "new.dbc")
    for failure in ({"file_size": 100}, {"kill_after": 0.0}, {"only_reads": True}):
        place = tmp_path / next(iter(failure))
        place.mkdir()
        assert together([command], place, **failure)[0].status != 0, failure  # type: ignore[arg-type]
        assert not (place / "new.dbc").exists(), failure
        place.chmod(0o755)
    assert together([command], tmp_path)[0].status == 0
    assert (tmp_path / "new.dbc").stat().st_size > 100


def test_what_is_taken_is_told(tmp_path: Path) -> None:
    """A module that takes something, one that fails: status 1, each by its name."""
    shutil.copytree(ROOT / "tests" / "attack", tmp_path / "tests" / "attack")
    (tmp_path / "tests" / "__init__.py").touch()
    for path in (tmp_path / "tests" / "attack").glob("*.py"):
        if path.name not in ("__init__.py", "__main__.py"):
            path.unlink()
    head = "from tests.attack import Result\n\n\ndef attack(count, seed):\n    "
    (tmp_path / "tests" / "attack" / "open_door.py").write_text(f'{head}return Result("door", count, seed)\n')
    (tmp_path / "tests" / "attack" / "broken.py").write_text(f"{head}raise OSError\n")
    command = [sys.executable, "-m", "tests.attack", "--count", "7", "--seed", "3"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 1
    assert "TAKEN 3 of 7       door" in done.stdout
    assert "TAKEN 1 of 0       broken: failed with status 1" in done.stdout


@pytest.mark.parametrize(
    ("outcome", "expected"),
    [
        (Outcome(0, "", "", 0.1, 1), ""),
        (Outcome(2, "", "terrapin: x: no log\n", 0.1, 1), ""),
        (Outcome(2, "", "terrapin: x\nand more\n", 0.1, 1), "2 lines"),
        (Outcome(2, "", "", 0.1, 1), "0 lines"),
        (Outcome(1, "", "Traceback (most recent call last):\nValueError\n", 0.1, 1), "a traceback"),
        (Outcome(-9, "", "", 0.1, 1), "status -9"),
        (Outcome(0, "", "", 11.0, 1), "11.0 s"),
        (Outcome(0, "", "", 0.1, 2 << 30), "2048 MiB"),
    ],
)
def test_what_is_wrong_with_a_command(outcome: Outcome, expected: str) -> None:
    assert outcome.wrong() == expected
