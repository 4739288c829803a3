"""The answers of many cases as they come: JSON Lines for programs, a line a case for people, progress beside them."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from host_tools.workbench.answer import finite
from host_tools.workbench.fleet import Question, Result, answers

__all__ = ["answer_all", "json_line"]

EVERY = 10.0  # s between lines of progress where standard error is no terminal


def json_line(result: Result) -> str:
    """One line of plain ASCII: the answer with its folder's name, or {"case", "folder", "error"}."""
    if result.answer is None:
        line: dict[str, Any] = {"case": result.name, "folder": result.name, "error": result.error}
    else:
        line = {}
        for key, value in result.answer.items():
            line[key] = value
            if key == "case":
                line["folder"] = result.name
    return json.dumps(finite(line), allow_nan=False) + "\n"


def answer_all(
    folders: Sequence[Path],
    question: Question,
    target: str,
    jobs: int,
    cluster: str,
    keep: Callable[[Path, dict[str, Any]], None],
) -> None:
    """Ask every case and write each answer as soon as those before it are written; `keep` gets each answer too."""
    progress = _Progress(len(folders))
    results = answers(folders, question, jobs, cluster)
    try:
        first = next(results, None)  # a cluster that cannot be reached is told before anything is written
        with _lines(target) as write:
            while first is not None:
                result, first = first, None
                if result.answer is not None:
                    keep(result.folder, result.answer)
                write(json_line(result))
                if target != "-":
                    print(_in_words(result), flush=True)
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


def _in_words(result: Result) -> str:
    if result.answer is None:
        return f"{result.name}: error: {result.error}"
    answer = result.answer
    ladder = answer["ladder"]
    errors = " -> ".join("-" if r["heldout_error"] is None else f"{r['heldout_error']:.3g}" for r in ladder)
    said = answer["verdict"]
    if "missing" in answer:
        sets = answer["rivals"] or [answer["missing"]]
        named = " or ".join(" + ".join(names) for names in sets if names)
        said += f" {named}" if named else ""
        said += f" (probability {answer['answer_probability']:.2f})"
    else:
        said += f" (p = {answer['adequacy']['p_value']:.2g})"
    return f"{result.name}: {said}; held-out error {errors}"


class _Progress:
    """How many are done and how many failed, on standard error."""

    def __init__(self, count: int) -> None:
        self.count, self.number, self.failed = count, 0, 0
        self.terminal = sys.stderr.isatty()
        self.begin = self.last = time.monotonic()

    def done(self, result: Result) -> None:
        self.number += 1
        self.failed += result.answer is None
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
