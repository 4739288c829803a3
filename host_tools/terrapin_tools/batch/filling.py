"""Works off the runs of a batch that are not in its folder yet, on all cores or a cluster.

Local workers write their own journals; what a cluster answers is written here, as soon as it comes.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from terrapin_tools.batch.design import Row
from terrapin_tools.batch.journal import Journal, read_journals
from terrapin_tools.batch.one_run import Answer, Plan, work
from terrapin_tools.workbench.fleet.pool import POLL, Future, Lost, Pool, pool

__all__ = ["fill"]

PER_TASK = 300.0  # s simulated: about half a second of work
MOST_PER_TASK = 32
BUSY, BUSY_THERE = 2, 8  # tasks sent to each worker here and there; a cluster's are one run each, and travel


def fill(
    plan: Plan,
    rows: Iterable[Row],
    folder: Path,
    duration: float,
    *,
    jobs: int = 1,
    cluster: str = "",
    until_failed: bool = False,
    seen: Callable[[Sequence[Answer]], None] = lambda _: None,
    say: Callable[[str], None] = lambda _: None,
) -> list[Answer]:
    """The answer to every row, in order; with `until_failed` up to the first that failed.

    Parameters
    ----------
    duration : of a run [s simulated], which decides how many are one task.
    seen : gets what the folder held already, then new answers as they come, in any order.
    say : gets a line when a worker died.

    Raises
    ------
    UserError : the folder cannot be written, the cluster cannot be reached or is lost. What was finished stays.
    """
    found = {number: Answer(**entry) for number, entry in read_journals(folder).items()}
    seen(list(found.values()))
    filling = _Filling(plan, folder, None if cluster else folder, until_failed, found, seen, say)
    filling.per_task = 1 if cluster else max(1, min(MOST_PER_TASK, int(PER_TASK / duration)))
    filling.run(rows, jobs, cluster)
    return filling.in_order()


class _Filling:
    def __init__(
        self,
        plan: Plan,
        folder: Path,
        journal: Path | None,  # the folder, where workers keep what they do themselves: on this machine
        until_failed: bool,
        found: dict[int, Answer],
        seen: Callable[[Sequence[Answer]], None],
        say: Callable[[str], None],
    ) -> None:
        self.plan, self.folder, self.journal, self.until_failed = plan, folder, journal, until_failed
        self.found, self.seen, self.say = found, seen, say
        self.per_task = 1
        self.again: deque[list[Row]] = deque()  # of tasks whose worker died
        self.first_failed = min((n for n, answer in found.items() if not answer.passed), default=None)

    def run(self, rows: Iterable[Row], jobs: int, cluster: str) -> None:
        missing = (row for row in rows if row.number not in self.found)
        first = self._next(missing)
        if not first:
            return
        self.again.append(first)
        under_way: list[tuple[Future, list[Row]]] = []
        with pool(jobs, cluster) as workers:
            while True:
                room = (BUSY_THERE if cluster else BUSY) * workers.workers() - len(under_way)
                while room > 0 and (task := self.again.popleft() if self.again else self._next(missing)):
                    under_way.append((workers.submit(work, self.plan, task, self.journal), task))
                    room -= 1
                if not under_way:
                    return
                done = [pair for pair in under_way if pair[0].done()]
                under_way = [pair for pair in under_way if not pair[0].done()] if done else under_way
                for future, task in done:
                    self._take(workers, future, task)
                if self._enough(under_way):
                    return
                if not done:
                    time.sleep(POLL)

    def _next(self, missing: Iterable[Row]) -> list[Row]:
        """The next task; none when all are given out, or all up to the first failed one."""
        task: list[Row] = []
        for row in missing:
            if self._needless(row.number):
                break
            task.append(row)
            if len(task) == self.per_task:
                break
        return task

    def _needless(self, number: int) -> bool:
        return self.until_failed and self.first_failed is not None and number > self.first_failed

    def _enough(self, under_way: Iterable[tuple[Future, list[Row]]]) -> bool:
        """Whether all that is under way comes after the first failed run, which is all that was asked for."""
        waiting = [*self.again, *(task for _, task in under_way)]
        return bool(waiting) and all(self._needless(row.number) for task in waiting for row in task)

    def _take(self, workers: Pool, future: Future, task: list[Row]) -> None:
        try:
            answers = future.result()
        except workers.died:
            self._repeat(workers, task)
            return
        self._keep(answers, self.journal is None)

    def _repeat(self, workers: Pool, task: list[Row]) -> None:
        """What a lost worker left: the run that it may have died of alone, the others as before."""
        kept = read_journals(self.folder)
        self._keep([Answer(**kept[row.number]) for row in task if row.number in kept])
        left = [row for row in task if row.number not in kept]
        if not left:
            return
        self.say(f"a worker died; run {left[0].number} is done again")
        if left[1:]:
            self.again.append(left[1:])
        try:
            answers, new = workers.again(work, self.plan, left[:1], self.journal), self.journal is None
        except Lost as error:
            answers, new = [Answer(left[0].number, False, str(error))], True
        self._keep(answers, new)

    def _keep(self, answers: Sequence[Answer], new: bool = False) -> None:
        """Takes answers; new ones are in no journal yet."""
        for answer in answers:
            if new:
                Journal.mine(self.folder).write(vars(answer))
            self.found[answer.number] = answer
            if not answer.passed and (self.first_failed is None or answer.number < self.first_failed):
                self.first_failed = answer.number
        self.seen(answers)

    def in_order(self) -> list[Answer]:
        """Every answer up to the last that was asked for."""
        return [self.found[number] for number in sorted(self.found) if not self._needless(number)]
