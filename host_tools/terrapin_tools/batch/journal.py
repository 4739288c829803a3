"""The folder of a batch while it fills: a file of JSON lines for each process that works, one line a run.

A line is written with one call as soon as its run is done, so whatever kills a process costs it the run in work and no
other. What was cut off or damaged is left out when it is read; its run is done again.
"""

from __future__ import annotations

import fcntl
import json
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.writing import write_whole

__all__ = ["Journal", "claimed", "read_journals"]

RUNS = "runs"
DESCRIPTION = "batch.json"


class Journal:
    """One process's file. UserError (status 1) when it cannot be written, and then it ends with a whole line."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / RUNS / f"{os.getpid()}-{secrets.token_hex(4)}.jsonl"
        try:
            self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise _refused(folder, error) from None
        self._length = 0

    @staticmethod
    def mine(folder: Path) -> Journal:
        """This process's, opened when it is first asked for."""
        return _journal(folder, os.getpid())

    def write(self, entry: Mapping[str, Any]) -> None:
        """Appends a line."""
        line = json.dumps(entry).encode("ascii") + b"\n"
        try:
            written = 0
            while written < len(line):  # a full disk may take a part
                written += os.write(self._file, line[written:])
        except OSError as error:
            os.ftruncate(self._file, self._length)
            os.lseek(self._file, self._length, os.SEEK_SET)
            raise _refused(self._path.parent.parent, error) from None
        self._length += len(line)


@cache
def _journal(folder: Path, process: int) -> Journal:
    return Journal(folder)


def _refused(folder: Path, error: OSError) -> UserError:
    return UserError(f"{folder}: cannot write: {error.strerror or error}; what was finished stays", status=1)


def read_journals(folder: Path) -> dict[int, dict[str, Any]]:
    """Number of a run -> its entry, of all files in the folder."""
    found: dict[int, dict[str, Any]] = {}
    for path in sorted((folder / RUNS).glob("*.jsonl")):
        for line in path.read_bytes().splitlines(keepends=True):
            if line.endswith(b"\n") and (entry := _entry(line)) is not None:
                found[entry["number"]] = entry
    return found


def _entry(line: bytes) -> dict[str, Any] | None:
    """A line as it was written: its beginning and its end are there, and it is JSON; None for any other."""
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return entry if isinstance(entry, dict) and {"number", "passed"} <= entry.keys() else None


@contextmanager
def claimed(folder: Path, description: Mapping[str, Any]) -> Iterator[None]:
    """The folder for this batch alone while it is worked on; made if it is not there.

    UserError when it holds something else, another batch, or one that another process works on.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        strange = [p for p in folder.iterdir() if p.name != RUNS and not p.name.startswith(".")]
        if strange and not (folder / DESCRIPTION).is_file():
            raise UserError(f"{folder}: holds files that are no batch, expected a new folder or that of this batch")
        (folder / RUNS).mkdir(exist_ok=True)
        lock = os.open(folder / RUNS / "lock", os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise _refused(folder, error) from None
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(f"{folder}: another process works on this batch", status=1) from None
        _describe(folder, description)
        yield
    finally:
        os.close(lock)


def _describe(folder: Path, description: Mapping[str, Any]) -> None:
    """Writes what the batch is, or holds it against what stands there."""
    path = folder / DESCRIPTION
    text = json.dumps(description, indent=1) + "\n"
    try:
        if not path.is_file():
            write_whole(path, text)
            return
        there = path.read_text(encoding="utf-8")
    except OSError as error:
        raise _refused(folder, error) from None
    if there == text:
        return
    try:
        other = json.loads(there)
        differ = [key for key in {**other, **description} if other.get(key) != json.loads(text).get(key)]
    except (ValueError, AttributeError):
        differ = ["batch.json"]
    raise UserError(f"{folder}: holds another batch ({', '.join(differ)}), expected the same command or a new folder")
