"""How a batch that fills is shown: progress on standard error, and progress.json in its folder for the page."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from terrapin_hil.scenario.checks import CheckError, parse_check
from terrapin_tools.batch.design import Row, Varied
from terrapin_tools.batch.one_run import Answer
from terrapin_tools.progress import progress_lines
from terrapin_tools.workbench.files.json_text import finite
from terrapin_tools.workbench.files.writing import write_whole

__all__ = ["PROGRESS", "Shown"]

PROGRESS = "progress.json"
EVERY = 1.0  # s between states of the file
LINES_EVERY = 10.0  # s between lines where standard error is no terminal
MOST_POINTS = 2000  # runs that the file has one by one: the latest
MOST_RESULTS = 16  # numbers of each


def missed(text: str, numbers: Mapping[str, float]) -> str:
    """Why a check failed: what was found and by how much it is off, its text alone where that is not known.

    >>> missed("max(slip) < 0.5", {"max(slip)": 0.75})
    'max(slip) is 0.75, expected < 0.5: 0.25 too much'
    """
    try:
        return parse_check(text).missed(numbers) or text
    except CheckError:  # not a check of the file, but of a fault's reaction
        return text


class Shown:
    """Counts what is done; the number of runs, of failed ones, and where in the inputs they lie."""

    def __init__(self, folder: Path, rows: Sequence[Row], varied: Sequence[Varied]) -> None:
        self._path, self._rows, self._inputs = folder / PROGRESS, rows, [one.name for one in varied]
        self._done = self._failed = self._before = 0
        self._points: list[list[Any]] = []
        self._results: list[str] = []
        self._outcomes: list[list[Any]] = []
        self._begin = time.monotonic()
        self._written = self._told = -1e9
        self._first_told = False
        self._terminal = sys.stderr.isatty()

    def seen(self, answers: Sequence[Answer]) -> None:
        """These are done."""
        if not self._first_told:  # what the folder held
            self._first_told, self._before = True, len(answers)
        self._done += len(answers)
        self._failed += sum(not answer.passed for answer in answers)
        for answer in answers[-MOST_POINTS:]:
            row = self._rows[answer.number]
            self._points.append([answer.passed, row.seed, *(value for _, value in row.values)])
            self._results = self._results or list(answer.numbers)[:MOST_RESULTS]
            why = answer.error or "; ".join(
                missed(text, answer.numbers) for text, held in answer.checks.items() if not held
            )
            self._outcomes.append([answer.number, " ".join(why.split()), dict(answer.numbers)])
        del self._points[:-MOST_POINTS], self._outcomes[:-MOST_POINTS]
        now = time.monotonic()
        if now - self._written >= EVERY:
            self._written = now
            self._write(complete=False)
        every = EVERY if progress_lines() else 0.1 if self._terminal else LINES_EVERY
        if now - self._told >= every:
            self._told = now
            self._tell(now)

    def say(self, text: str) -> None:
        """A line of its own."""
        print(f"{self._clear()}terrapin: {text}", file=sys.stderr, flush=True)

    def end(self, complete: bool) -> None:
        """The last state, and a line with the time that it took; `complete`: nothing is left to do."""
        self._write(complete)
        seconds = time.monotonic() - self._begin
        done = self._done - self._before
        text = f"{done} runs in {seconds:.3g} s, {self._failed} of all {self._done} failed"
        print(f"{self._clear()}{text}", file=sys.stderr, flush=True)

    def _clear(self) -> str:
        return "\r\x1b[K" if self._terminal else ""

    def _tell(self, now: float) -> None:
        done = self._done - self._before
        left = f", {(now - self._begin) / done * (len(self._rows) - self._done):.0f} s left" if done else ""
        text = f"{self._done} of {len(self._rows)} runs, {self._failed} failed{left}"
        if progress_lines():
            text += f", {100 * self._done // len(self._rows)} %"
        print(f"{self._clear()}{text}", end="" if self._terminal else "\n", file=sys.stderr, flush=True)

    def _write(self, complete: bool) -> None:
        state = {
            "done": self._done,
            "failed": self._failed,
            "runs": len(self._rows),
            "complete": complete,
            "inputs": ["passed", "seed", *self._inputs],
            "points": self._points,
            "results": self._results,
            "outcomes": [
                [number, why, *(numbers.get(name) for name in self._results)] for number, why, numbers in self._outcomes
            ],
        }
        try:
            write_whole(self._path, json.dumps(finite(state)) + "\n")
        except OSError:  # a full disk: the runs themselves say so
            return
