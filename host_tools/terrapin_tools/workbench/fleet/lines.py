"""The answers of many cases as they come: JSON Lines for programs, a line a case for people, progress beside them."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from terrapin_tools.workbench.fleet.fleet import Question, Result, answers
from terrapin_tools.workbench.story.answer import answer
from terrapin_tools.workbench.story.story import Story
from terrapin_tools.workbench.story.terminal import tell_shortly

__all__ = ["answer_all", "json_line"]

EVERY = 10.0  # s between lines of progress where standard error is no terminal


def json_line(result: Result) -> str:
    """One line of plain ASCII: the answer with its folder's name, or {"case", "folder", "error"}."""
    head: dict[str, Any] = {"case": result.name, "folder": result.name, "error": result.error}
    if result.story is not None:
        told = answer(result.story)
        head = {"schema": told["schema"], "case": told["case"], "folder": result.name} | told
    return json.dumps(head, allow_nan=False) + "\n"


def answer_all(
    folders: Sequence[Path],
    question: Question,
    target: str,
    jobs: int,
    cluster: str,
    keep: Callable[[Path, Story], None],
) -> None:
    """Ask every case and write each answer as soon as those before it are written; `keep` gets each answer too."""
    progress = _Progress(len(folders))
    results = answers(folders, question, jobs, cluster)
    try:
        first = next(results, None)  # a cluster that cannot be reached is told before anything is written
        with _lines(target) as write:
            while first is not None:
                result, first = first, None
                if result.story is not None:
                    keep(result.folder, result.story)
                write(json_line(result))
                if target != "-":
                    print(
                        f"{result.name}: {tell_shortly(result.story) if result.story else f'error: {result.error}'}",
                        flush=True,
                    )
                progress.done(result)
                first = next(results, None)
    finally:
        results.close()  # type: ignore[attr-defined]
    progress.end()


@contextmanager
def _lines(target: str) -> Iterator[Callable[[str], None]]:
    """Writes whole lines, each at once: what is written stays readable whatever ends the program."""
    if target == "":
        yield lambda line: None
    elif target == "-":

        def to_output(line: str) -> None:
            sys.stdout.write(line)
            sys.stdout.flush()

        yield to_output
    else:
        file: BinaryIO
        with open(target, "wb", buffering=0) as file:
            yield lambda line: _write(file, line.encode("ascii"))


def _write(file: BinaryIO, content: bytes) -> None:
    while content:  # a pipe or a full disk may take a part
        content = content[file.write(content) :]


class _Progress:
    """How many are done and how many failed, on standard error."""

    def __init__(self, count: int) -> None:
        self.count, self.number, self.failed = count, 0, 0
        self.terminal = sys.stderr.isatty()
        self.begin = self.last = time.monotonic()

    def done(self, result: Result) -> None:
        self.number += 1
        self.failed += result.story is None
        now = time.monotonic()
        if self.terminal or now - self.last >= EVERY:
            self.last = now
            left = (now - self.begin) / self.number * (self.count - self.number)
            text = f"{self.number} of {self.count} cases, {self.failed} failed, {left:.0f} s left"
            print(f"\r{text}\x1b[K" if self.terminal else text, end="" if self.terminal else "\n", file=sys.stderr)
            sys.stderr.flush()

    def end(self) -> None:
        clear = "\r\x1b[K" if self.terminal else ""
        seconds = time.monotonic() - self.begin
        print(f"{clear}{self.number} cases in {seconds:.0f} s, {self.failed} failed", file=sys.stderr)
