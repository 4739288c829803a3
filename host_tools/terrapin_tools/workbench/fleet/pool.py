"""Where work is done: in this process, in processes of this machine, or on a Dask cluster.

    with pool(jobs=4, cluster="") as workers:
        future = workers.submit(function, argument)     # function: at the top of a module, arguments that can be sent

Linear algebra in the processes runs on one thread. Whoever submits keeps no more under way than `workers()` can do.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from terrapin_hil import paths
from terrapin_tools.errors import UserError
from terrapin_tools.extras import need
from terrapin_tools.interrupts import later

__all__ = ["POLL", "Done", "Future", "Lost", "Pool", "fingerprint", "pool"]

POLL = 0.005  # s between looks at what is done
IDLE = 60.0  # s after which a worker without work ends: elsewhere than on Linux it outlives a killed parent for so long
PR_SET_PDEATHSIG = 1  # linux/prctl.h
# A thread that ends with the program has given a lock back and not yet told who keeps count: no news.
TRACKED = "ignore:resource_tracker"
CONNECT = 10.0  # s for a cluster to answer


class Lost(Exception):
    """What was asked for once more took its worker down again. `str()` says so."""


class Future(Protocol):
    def done(self) -> bool: ...
    def result(self) -> Any: ...


class Pool(Protocol):
    """Where work is done. `died` is what the result of a lost worker raises; `again` then raises Lost if it must."""

    @property
    def died(self) -> type[Exception]: ...
    def workers(self) -> int: ...
    def submit(self, work: Callable[..., Any], *given: Any) -> Future: ...
    def again(self, work: Callable[..., Any], *given: Any) -> Any: ...


@contextmanager
def pool(jobs: int, cluster: str) -> Iterator[Pool]:
    """`jobs` processes of this machine, this process alone for one, or the Dask cluster at an address.

    UserError when the cluster cannot be reached.
    """
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

    def submit(self, work: Callable[..., Any], *given: Any) -> Future:
        return Done(work(*given))

    def again(self, work: Callable[..., Any], *given: Any) -> Any:
        raise AssertionError("nothing dies here but all of us")


@dataclass(frozen=True)
class Done:
    """A result that is there."""

    outcome: Any

    def done(self) -> bool:
        return True

    def result(self) -> Any:
        return self.outcome


@dataclass(frozen=True)
class _Local:
    """Work of a process of this machine."""

    future: Any

    def done(self) -> bool:
        with later():
            return bool(self.future.done())

    def result(self) -> Any:
        while not self.done():
            time.sleep(POLL)
        with later():
            return self.future.result()


def _start_worker(parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent ends its workers
    if sys.platform == "linux":  # one that is killed cannot
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os.kill(os.getpid(), signal.SIGKILL)


@contextmanager
def _deaf_children() -> Iterator[None]:
    """What is started here ignores Ctrl-C from its first instruction on."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may say so
        return
    with later():
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


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
    """Processes of this machine, through joblib's loky. One that dies takes its work down, not the others'."""

    died: type[Exception] = BrokenExecutor

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs
        self.executor: Any = None

    def workers(self) -> int:
        return self.jobs

    def submit(self, work: Callable[..., Any], *given: Any) -> Future:
        try:
            if self.executor is not None:
                with later():
                    return _Local(self.executor.submit(work, *given))
        except BrokenExecutor:
            self.close()
        self.executor = _executor(self.jobs)
        with _deaf_children():  # the first call starts the workers
            return _Local(self.executor.submit(work, *given))

    def again(self, work: Callable[..., Any], *given: Any) -> Any:
        """Alone, since it is not known which of the calls under way brought the workers down."""
        alone = _executor(1)
        try:
            with _deaf_children():
                future = _Local(alone.submit(work, *given))
            return future.result()
        except BrokenExecutor:
            raise Lost("the process that worked on it was killed twice (out of memory?)") from None
        finally:
            with later():
                alone.shutdown(wait=True, kill_workers=True)

    def close(self) -> None:
        if self.executor is not None:
            with _quiet_end(), later():
                self.executor.shutdown(wait=True, kill_workers=True)


def _keep_count() -> None:
    """Start who keeps count of locks, quiet: each lifts the mask of signals at its start, so before any worker."""
    from multiprocessing import resource_tracker as standard_tracker

    from joblib.externals.loky.backend import resource_tracker

    before = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = TRACKED
    try:
        resource_tracker.ensure_running()
        standard_tracker.ensure_running()
    finally:
        if before is None:
            del os.environ["PYTHONWARNINGS"]
        else:
            os.environ["PYTHONWARNINGS"] = before


def _executor(jobs: int) -> Any:
    from joblib.externals.loky import ProcessPoolExecutor

    _keep_count()
    return ProcessPoolExecutor(
        jobs, timeout=IDLE, initializer=_start_worker, initargs=(os.getpid(),), env={"OPENBLAS_NUM_THREADS": "1"}
    )


@contextmanager
def _cluster(address: str) -> Iterator[Pool]:
    need("--cluster (Dask)", "distributed", "cluster")
    import logging
    import warnings

    import distributed

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
            warnings.filterwarnings("ignore", "Sending large graph", UserWarning)  # it is sent whole, on purpose
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


def elsewhere(program: str, work: Callable[..., Any], *given: Any) -> Any:
    """The work on a worker of a cluster, which has to run the same program."""
    if fingerprint() != program:
        raise UserError(f"--cluster: a worker has {fingerprint()}, expected {program}, as here")
    return work(*given)


class _Cluster:
    """A Dask cluster. Dask gives the work of a lost worker to another one, a few times."""

    def __init__(self, client: Any, address: str) -> None:
        from distributed.scheduler import KilledWorker

        self.died: type[Exception] = KilledWorker
        self.client, self.address = client, address
        self.counted, self.threads = -1e9, 1

    def workers(self) -> int:
        if time.monotonic() - self.counted > 5.0:  # workers come and go
            self.counted, self.threads = time.monotonic(), max(1, sum(self.client.nthreads().values()))
        return self.threads

    def submit(self, work: Callable[..., Any], *given: Any) -> Future:
        future = self.client.submit(elsewhere, fingerprint(), work, *given, pure=False)
        return _Remote(future, self.address, self.died)

    def again(self, work: Callable[..., Any], *given: Any) -> Any:
        raise Lost("every worker that worked on it was lost (out of memory?)")


@dataclass(frozen=True)
class _Remote:
    future: Any
    address: str
    died: type[Exception]

    def done(self) -> bool:
        return bool(self.future.done())

    def result(self) -> Any:
        from concurrent.futures import CancelledError

        try:
            outcome = self.future.result()
        except (UserError, self.died):
            raise
        except (CancelledError, OSError) as error:
            raise UserError(f"--cluster: {self.address}: lost ({type(error).__name__})", status=1) from None
        except Exception as error:  # whatever a Python raises that lacks the program
            text = f"{type(error).__name__}: {error}".splitlines()[0]
            raise UserError(f"--cluster: {self.address}: a worker cannot run terrapin: {text}") from None
        return outcome
