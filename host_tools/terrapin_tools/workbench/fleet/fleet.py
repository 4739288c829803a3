"""Many cases, one after the other in sorted order: on the cores of this machine, or on a Dask cluster.

    for result in answers(cases_in(folder), Question("discover", seed=0, level=0.05), jobs=4):
        result.name, result.story or result.error

Each case is read here and sent whole, so that workers need no files, only the same program; its answer is the same byte
for byte wherever it is computed (`seconds` apart): nothing in it depends on other cases, and linear algebra runs on one
thread, since several add up in another order. A case that is broken, or takes its worker down, is one result with an
error. Only a few cases for each worker are under way, so memory does not grow with their number.
"""

from __future__ import annotations

import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from terrapin_hil import paths
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.story.story import Story

__all__ = ["Question", "Result", "answer_one", "answers", "cases_in", "solve"]

BUSY = 2  # cases sent to each worker and not done: one in work, one waiting
HELD = 32  # cases sent for each worker and not given out: so many may overtake a slow one
POLL = 0.005  # s between looks at what is done
IDLE = 60.0  # s after which a worker without work ends, so that none outlives a killed parent for long
CONNECT = 10.0  # s for a cluster to answer


@dataclass(frozen=True)
class Question:
    """What is asked of every case: "compare" or "discover"; `bootstrap`: resampled sets of runs, for discover."""

    command: str
    seed: int
    level: float
    bootstrap: int = 0


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


def solve(question: Question, case: Case, report: Callable[[str], None] = lambda _: None) -> Story:
    """The answer for one case. UserError when the case is wrong."""
    from threadpoolctl import threadpool_limits

    from terrapin_tools.workbench.compare.comparison import analyse
    from terrapin_tools.workbench.discover.discovery import discover
    from terrapin_tools.workbench.story.told import told

    begin = time.monotonic()
    with threadpool_limits(limits=1):
        if question.command == "compare":
            story = told(analyse(case, question.seed, question.level))
        else:
            found = discover(case, question.seed, question.level, report, question.bootstrap)
            story = told(found.analysis, found)
    return replace(story, seconds=time.monotonic() - begin)


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
    with _pool(jobs, cluster) as pool:
        line: deque[tuple[Path, Future]] = deque()
        for folder in folders:
            while line and (line[0][1].done() or _full(line, pool.workers())):
                if line[0][1].done():
                    yield _end(pool, *line.popleft(), question)
                else:
                    time.sleep(POLL)
            line.append((folder, _begin(pool, folder, question)))
        while line:
            yield _end(pool, *line.popleft(), question)


def _full(line: Collection[tuple[Path, Future]], workers: int) -> bool:
    return len(line) >= HELD * workers or sum(not future.done() for _, future in line) >= BUSY * workers


Outcome = tuple[Story | None, str]  # or what is wrong


class Future(Protocol):
    def done(self) -> bool: ...
    def result(self) -> Outcome: ...


class Pool(Protocol):
    """Where cases are worked on. `died` is what a lost worker raises."""

    @property
    def died(self) -> type[Exception]: ...
    def workers(self) -> int: ...
    def submit(self, question: Question, case: Case) -> Future: ...
    def again(self, question: Question, case: Case) -> Outcome: ...


def _begin(pool: Pool, folder: Path, question: Question) -> Future:
    try:
        case = load_case(folder)
    except UserError as error:
        return _Done((None, str(error)))
    return pool.submit(question, case)


def _end(pool: Pool, folder: Path, future: Future, question: Question) -> Result:
    try:
        return Result(folder, *future.result())
    except pool.died:
        return Result(folder, *pool.again(question, load_case(folder)))


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


@contextmanager
def _pool(jobs: int, cluster: str) -> Iterator[Pool]:
    if cluster:
        with _cluster(cluster) as remote:
            yield remote
    elif jobs == 1:
        yield _Here()
    else:
        local = _Processes(jobs)
        try:
            yield local
        finally:
            local.close()


class _Here:
    """In this process, one at a time."""

    died: type[Exception] = BrokenExecutor

    def workers(self) -> int:
        return 1

    def submit(self, question: Question, case: Case) -> Future:
        return _Done(attempt(question, case))

    def again(self, question: Question, case: Case) -> Outcome:
        raise AssertionError("nothing dies here but all of us")


@dataclass(frozen=True)
class _Done:
    outcome: Outcome

    def done(self) -> bool:
        return True

    def result(self) -> Outcome:
        return self.outcome


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent ends its workers


@contextmanager
def _deaf_children() -> Iterator[None]:
    """What is started here ignores Ctrl-C from its first instruction on. One that comes meanwhile waits for the end:
    loky does not survive it between the start of its processes and that of its thread."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may say so
        return
    from multiprocessing import resource_tracker as standard_tracker

    from joblib.externals.loky.backend import resource_tracker

    resource_tracker.ensure_running()  # loky starts both with its first process, and each lifts the mask when it starts
    standard_tracker.ensure_running()
    came: list[int] = []
    usual = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, usual)
    if came:
        signal.raise_signal(signal.SIGINT)


@contextmanager
def _quiet_end() -> Iterator[None]:
    """loky's own thread may still look for work that the end has taken away: its KeyError is no news."""
    before = threading.excepthook

    def hook(failed: threading.ExceptHookArgs) -> None:
        if "ExecutorManager" not in type(failed.thread).__name__:
            before(failed)

    threading.excepthook = hook
    try:
        yield
    finally:
        threading.excepthook = before


class _Processes:
    """Processes of this machine, through joblib's loky. One that dies takes its case down, not the others."""

    died: type[Exception] = BrokenExecutor

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs
        self.executor: Any = None

    def workers(self) -> int:
        return self.jobs

    def submit(self, question: Question, case: Case) -> Future:
        try:
            if self.executor is not None:
                future: Future = self.executor.submit(attempt, question, case)
                return future
        except BrokenExecutor:
            self.close()
        self.executor = _executor(self.jobs)
        with _deaf_children():  # the first call starts the workers
            first: Future = self.executor.submit(attempt, question, case)
        return first

    def again(self, question: Question, case: Case) -> Outcome:
        """Alone, since it is not known which of the cases under way brought the workers down."""
        alone = _executor(1)
        try:
            outcome: Outcome = alone.submit(attempt, question, case).result()
            return outcome
        except BrokenExecutor:
            return None, f"{case.folder}: the process that worked on it was killed twice (out of memory?)"
        finally:
            alone.shutdown(wait=True, kill_workers=True)

    def close(self) -> None:
        if self.executor is not None:
            with _quiet_end():
                self.executor.shutdown(wait=True, kill_workers=True)


def _executor(jobs: int) -> Any:
    from joblib.externals.loky import ProcessPoolExecutor

    return ProcessPoolExecutor(jobs, timeout=IDLE, initializer=_start_worker, env={"OPENBLAS_NUM_THREADS": "1"})


@contextmanager
def _cluster(address: str) -> Iterator[Pool]:
    try:
        import distributed
    except ImportError:
        raise UserError("--cluster: Dask is not installed: pip install 'terrapin-robot[cluster]'") from None
    import logging
    import warnings

    _check_address(address)
    logging.disable(logging.CRITICAL)  # what goes wrong is told here, in one line
    connect: Any = distributed.Client  # untyped
    try:
        client = connect(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        logging.disable(logging.NOTSET)
        reason = str(error).splitlines()[0]
        raise UserError(f"--cluster: {reason}, expected the address of a Dask scheduler") from None
    try:
        try:
            client.wait_for_workers(1, timeout=CONNECT)
        except TimeoutError:
            raise UserError(f"--cluster: {address}: found no worker, expected at least one") from None
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sending large graph", UserWarning)  # a case is sent whole, on purpose
            yield _Cluster(client, address)
    finally:
        client.close(timeout=2.0)
        logging.disable(logging.NOTSET)


def _check_address(address: str) -> None:
    """UserError unless it is one that Dask could connect to. Its client would leave threads behind."""
    from distributed.comm import addressing, registry

    try:
        scheme, place = addressing.parse_address(address)
        registry.get_backend(scheme)
        _, port = addressing.parse_host_port(place)
        if not 0 < port < 65536:
            raise ValueError(f"found port {port}, expected 1 to 65535")
    except ValueError as error:
        raise UserError(f"--cluster: {address}: {error}; expected an address such as tcp://host:8786") from None


def fingerprint() -> str:
    """What must be the same on all machines for the same bytes: this program's sources and build, NumPy and SciPy."""
    import numpy
    import scipy

    import terrapin_tools

    program = paths.program_hash(paths.PACKAGE, Path(terrapin_tools.__path__[0]))
    return f"terrapin {program[:12]}, numpy {numpy.__version__}, scipy {scipy.__version__}"


def attempt_elsewhere(program: str, question: Question, case: Case) -> Outcome:
    """`attempt` on a worker of a cluster, which has to run the same program."""
    if fingerprint() != program:
        raise UserError(f"--cluster: a worker has {fingerprint()}, expected {program}, as here")
    return attempt(question, case)


class _Cluster:
    """A Dask cluster. Dask gives the cases of a lost worker to another one, a few times."""

    def __init__(self, client: Any, address: str) -> None:
        from distributed.scheduler import KilledWorker

        self.died: type[Exception] = KilledWorker
        self.client, self.address = client, address
        self.counted, self.threads = -1e9, 1

    def workers(self) -> int:
        if time.monotonic() - self.counted > 5.0:  # workers come and go
            self.counted, self.threads = time.monotonic(), max(1, sum(self.client.nthreads().values()))
        return self.threads

    def submit(self, question: Question, case: Case) -> Future:
        future = self.client.submit(attempt_elsewhere, fingerprint(), question, case, pure=False)
        return _Remote(future, self.address, self.died)

    def again(self, question: Question, case: Case) -> Outcome:
        return None, f"{case.folder}: every worker that worked on it was lost (out of memory?)"


@dataclass(frozen=True)
class _Remote:
    future: Any
    address: str
    died: type[Exception]

    def done(self) -> bool:
        return bool(self.future.done())

    def result(self) -> Outcome:
        from concurrent.futures import CancelledError

        try:
            outcome: Outcome = self.future.result()
        except (UserError, self.died):
            raise
        except (CancelledError, OSError) as error:
            raise UserError(f"--cluster: {self.address}: lost ({type(error).__name__})", status=1) from None
        except Exception as error:  # whatever a Python raises that lacks the program
            text = f"{type(error).__name__}: {error}".splitlines()[0]
            raise UserError(f"--cluster: {self.address}: a worker cannot run terrapin: {text}") from None
        return outcome
