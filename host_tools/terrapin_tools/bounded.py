"""What a file may unpack to, and what reading it may take: some kB can hold gigabytes, or blocks that never end.

    check(path, unpacked)                before anything is unpacked, by what the file states
    with bounded(path): ...              a limit of memory and of processor time for a library that reads the file
    for part in each(path, parts): ...   the same for every step of a reader, not for what is done with its parts
    survived(path, read)                 before a library in C reads a damaged file that may end this process, or never

docs/logs.md states the limits.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TypeVar

try:
    import resource
except ImportError:  # Windows: no limit of memory there
    resource = None  # type: ignore[assignment]

from terrapin_tools.errors import UserError

__all__ = [
    "CELLS",
    "LEAST",
    "MEMORY",
    "TIMES",
    "bounded",
    "check",
    "each",
    "most",
    "refuse_beyond",
    "refuse_columns",
    "room",
    "survived",
]

# The tightest log of this controller that we know is an idle one: 8 times as BLF, 6 as MCAP. Zeros make 1000 (deflate)
# to 30,000 (zstd).
TIMES = 50  # a file may unpack to so many times its size,
LEAST = 16 << 20  # or to so many bytes, whichever is more
MEMORY = 600 << 20  # bytes that a library may take for a file, and GROWTH for each of its bytes
GROWTH = 32
SECONDS = 8.0  # of the processor for one step, and one more for each PACE bytes of the file
PACE = 2e6
TRIED = 2.0  # s of the processor where a file is read in a copy of this process first, and one more for each
TRIED_PACE = 5e5  # bytes: so 10,000 small sets have 18 s, and a system that ends it late has stayed below 10
# Of tables: a number takes 8 bytes, and some 45 more while a case is made of it.
CELLS = 1 << 24  # that any table may hold, 128 MiB,
TABLE_TIMES = 16  # or so many times the bytes of its file,
TABLE_MOST = 1 << 30  # and never more than so many bytes
COLUMNS = 1 << 12  # a case is made of a few dozen; 20,000 took half a minute

T = TypeVar("T")


def most(size: int, times: int = TIMES) -> int:
    """The bytes that a file of `size` bytes may unpack to."""
    return max(LEAST, times * size)


def check(path: Path, unpacked: int, times: int = TIMES) -> None:
    """UserError when a file that states (or was counted to hold) `unpacked` bytes may not."""
    size = path.stat().st_size
    if unpacked > most(size, times):
        found = f"{unpacked / 1e6:.0f} MB or more in {max(1, size // 1000)} kB"
        raise UserError(f"{path}: unpacks to {found}, expected at most {times} times its size or {LEAST >> 20} MiB")


class _TooLong(BaseException):
    """The time is over: no Exception, which libraries catch."""


def room(path: Path) -> int:
    """The bytes of numbers or text that a table's file, or a folder of them, may stand for once it is unpacked."""
    files = [path, *path.glob("*")] if path.is_dir() else [path]
    return min(TABLE_MOST, max(8 * CELLS, TABLE_TIMES * sum(file.stat().st_size for file in files)))


def refuse_beyond(path: Path, size: int) -> None:
    """UserError for a table of more bytes than `room`."""
    if size > room(path):
        raise UserError(
            f"{path.name}: stands for more than {room(path) >> 20} MiB, expected at most {TABLE_TIMES} times its size "
            f"or {8 * CELLS >> 20} MiB"
        )


def refuse_columns(path: Path, count: int) -> None:
    """UserError for a table of more columns than anybody measures."""
    if count > COLUMNS:
        raise UserError(f"{path.name}: holds {count} columns, expected at most {COLUMNS}")


@contextmanager
def bounded(path: Path) -> Iterator[None]:
    """Limits of memory (this process may not ask for more) and of processor time. UserError where one is met."""
    size = path.stat().st_size
    seconds = SECONDS + size / PACE
    try:
        with _memory(MEMORY + GROWTH * size), _time(seconds):
            yield
    except MemoryError:
        raise UserError(f"{path}: takes more than {(MEMORY + GROWTH * size) >> 20} MiB to read") from None
    except _TooLong:
        raise UserError(f"{path}: found no end of it in {seconds:.0f} s of the processor") from None


def each(path: Path, parts: Iterable[T]) -> Iterator[T]:
    """What a reader of a file yields, each step `bounded`."""
    steps = iter(parts)
    while True:
        with bounded(path):
            try:
                part = next(steps)
            except StopIteration:
                return
        yield part


def survived(path: Path, read: Callable[[], object], seconds: float = TRIED) -> None:
    """UserError where `read` ends the process or has no end: what loops in C is told of no signal, and raises nothing.

    It is tried in a copy of this process (fork), so it is read twice; what it raises there, it raises here again.
    """
    if resource is None:
        return
    allowed = max(1, round(seconds + path.stat().st_size / TRIED_PACE))
    pid = os.fork()
    if pid == 0:
        _alone(read, allowed)
    until = time.monotonic() + 60.0 * allowed  # of the clock: others may work on this machine
    status = None
    try:
        while status is None:
            done, found = os.waitpid(pid, os.WNOHANG)
            status = found if done else None
            if not done and time.monotonic() > until:
                break
            time.sleep(0.0 if done else 0.002)
    finally:
        if status is None:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
    if status is None or os.WIFSIGNALED(status):
        number = signal.SIGXCPU if status is None else os.WTERMSIG(status)
        if number in (signal.SIGXCPU, signal.SIGKILL):
            raise UserError(f"{path}: found no end of it in {allowed} s of the processor")
        raise UserError(f"{path}: is damaged: its library ends with {signal.Signals(number).name}")


def _alone(read: Callable[[], object], seconds: int) -> None:
    """In the copy: says nothing, leaves nothing, and ends."""
    try:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
        faulthandler.disable()
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        nothing = os.open(os.devnull, os.O_RDWR)
        for number in (1, 2):
            os.dup2(nothing, number)
        with suppress(BaseException):  # the reader raises it again where somebody hears it
            read()
    finally:
        os._exit(0)


@contextmanager
def _memory(more: int) -> Iterator[None]:
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
    except (OSError, ValueError, IndexError):  # no Linux
        yield
        return
    limit = pages * resource.getpagesize() + more
    before, hard = resource.getrlimit(resource.RLIMIT_DATA)
    if before != resource.RLIM_INFINITY and before <= limit:
        yield
        return
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (before, hard))


@contextmanager
def _time(seconds: float) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield  # only the main thread is told of signals
        return

    def over(number: int, frame: FrameType | None) -> None:
        raise _TooLong

    before = signal.signal(signal.SIGVTALRM, over)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds, 1.0)  # and again, where a library swallowed it
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)
