"""Many cases, one after the other in sorted order: on the cores of this machine, or on a Dask cluster.

    for result in answers(cases_in(folder), Question("discover", seed=0, level=0.05), jobs=4):
        result.name, result.story or result.error

Each case is read here and sent whole, so that workers need no files, only the same program; its answer is the same byte
for byte wherever it is computed (`seconds` apart): nothing in it depends on other cases, and linear algebra runs on one
thread, since several add up in another order. A case that is broken, or takes its worker down, is one result with an
error. Only a few cases for each worker are under way, so memory does not grow with their number.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.fleet.pool import POLL, Done, Future, Lost, Pool, pool
from terrapin_tools.workbench.story.story import Story

if TYPE_CHECKING:
    from terrapin_tools.workbench.compare.comparison import Analysis

__all__ = ["Question", "Result", "answer_one", "answers", "cases_in", "examine", "solve"]

BUSY = 2  # cases sent to each worker and not done: one in work, one waiting
HELD = 32  # cases sent for each worker and not given out: so many may overtake a slow one


@dataclass(frozen=True)
class Question:
    """What is asked of every case: "compare" or "discover"; `bootstrap`: resampled sets of runs, for discover;
    `intervals`: profile intervals too, for compare."""

    command: str
    seed: int
    level: float
    bootstrap: int = 0
    intervals: bool = False


@dataclass(frozen=True)
class Result:
    """The answer for one folder, or the one line that says what is wrong with it."""

    folder: Path
    story: Story | None
    error: str

    @property
    def name(self) -> str:
        return self.folder.name


def cases_in(folder: Path) -> list[Path] | None:
    """The cases of a folder of cases, sorted by name; None when it is none (it is a case itself, or holds no case).

    Every folder in it counts, so that one whose case.toml is missing is told of; hidden ones do not.
    """
    if (folder / "case.toml").exists() or not folder.is_dir():
        return None
    inside = sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))
    return inside if any((p / "case.toml").exists() for p in inside) else None


def examine(question: Question, case: Case, report: Callable[[str], None] = lambda _: None) -> tuple[Analysis, Story]:
    """The answer for one case, with the fits behind it. UserError when the case is wrong."""
    from threadpoolctl import threadpool_limits

    from terrapin_tools.workbench.compare.comparison import analyse
    from terrapin_tools.workbench.compare.intervals import intervals
    from terrapin_tools.workbench.discover.discovery import discover
    from terrapin_tools.workbench.story.told import told

    begin = time.monotonic()
    with threadpool_limits(limits=1):
        if question.command == "compare":
            analysis = analyse(case, question.seed, question.level)
            story = told(analysis)
            if question.intervals:
                story = replace(story, intervals=intervals(analysis, report))
        else:
            found = discover(case, question.seed, question.level, report, question.bootstrap)
            analysis, story = found.analysis, told(found.analysis, found)
    return analysis, replace(story, seconds=time.monotonic() - begin)


def solve(question: Question, case: Case, report: Callable[[str], None] = lambda _: None) -> Story:
    """The answer for one case. UserError when the case is wrong."""
    return examine(question, case, report)[1]


def answer_one(
    folder: Path, question: Question, cluster: str = "", report: Callable[[str], None] = lambda _: None
) -> Story:
    """The answer for one case, here or on a cluster. UserError when anything is wrong with it."""
    if not cluster:
        return solve(question, load_case(folder), report)
    (result,) = answers([folder], question, cluster=cluster)
    if result.story is None:
        raise UserError(result.error)
    return result.story


def answers(folders: Iterable[Path], question: Question, jobs: int = 1, cluster: str = "") -> Iterator[Result]:
    """A result for each folder, in the order given, as soon as those before it are done.

    Parameters
    ----------
    folders : case folders; read one after the other, so a generator will do.
    jobs : processes of this machine.
    cluster : address of a Dask scheduler; empty: this machine.

    Raises
    ------
    UserError : the cluster cannot be reached or is lost. A wrong case raises nothing; its result has the error.
    """
    with pool(jobs, cluster) as workers:
        line: deque[tuple[Path, Future]] = deque()
        for folder in folders:
            while line and (line[0][1].done() or _full(line, workers.workers())):
                if line[0][1].done():
                    yield _end(workers, *line.popleft(), question)
                else:
                    time.sleep(POLL)
            line.append((folder, _begin(workers, folder, question)))
        while line:
            yield _end(workers, *line.popleft(), question)


def _full(line: Collection[tuple[Path, Future]], workers: int) -> bool:
    return len(line) >= HELD * workers or sum(not future.done() for _, future in line) >= BUSY * workers


Outcome = tuple[Story | None, str]  # or what is wrong


def _begin(workers: Pool, folder: Path, question: Question) -> Future:
    try:
        case = load_case(folder)
    except UserError as error:
        return Done((None, str(error)))
    return workers.submit(attempt, question, case)


def _end(workers: Pool, folder: Path, future: Future, question: Question) -> Result:
    try:
        return Result(folder, *future.result())
    except workers.died:
        try:
            return Result(folder, *workers.again(attempt, question, load_case(folder)))
        except Lost as error:
            return Result(folder, None, f"{folder}: {error}")


def attempt(question: Question, case: Case) -> Outcome:
    """The outcome of a case on a worker: the answer of `solve`, or as text whatever went wrong."""
    try:
        return solve(question, case), ""
    except UserError as error:
        return None, str(error)
    except MemoryError:
        return None, f"{case.folder}: out of memory"
    except Exception as error:  # one case that shows a mistake of ours must not end a night's run
        return None, f"{case.folder}: {type(error).__name__}: {error} (a mistake of the program: please report it)"
