"""`terrapin` commands in forks of this process, which has imported everything: some ms each, measured and bounded."""

from __future__ import annotations

import ctypes
import fcntl
import importlib
import os
import resource
import signal
import struct
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from tests.attack import Result

__all__ = ["Outcome", "counted", "learn", "run", "together"]

SECONDS = 30  # of the processor; then the command is killed
WALL = 240.0  # s
CAPABILITIES = 0x20080522  # version 3 of their structure: 3 words each, twice
WARM = (
    *(f"terrapin_tools.commands.{name}" for name in ("add", "batch", "case", "compare", "log", "report", "run")),
    "can", "cantools", "asammdf", "mcap.stream_reader", "pyarrow.parquet", "pyarrow.csv", "zstandard", "lz4.frame",
    "terrapin_hil.run.run", "terrapin_tools.batch.batch", "terrapin_tools.logs.info", "terrapin_tools.logs.packed",
    "terrapin_tools.logs.mf4_blocks", "terrapin_tools.parquet_files", "terrapin_tools.command_line",
    "terrapin_tools.workbench.story.page", "terrapin_tools.workbench.discover.discovery", "tomlkit",
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What a command did: its exit status (negative: the signal that ended it), words, cost."""

    status: int
    out: str
    err: str
    seconds: float  # of the processor
    memory: int  # bytes, at most at any time

    def wrong(self, memory: int = 1 << 30, seconds: float = 10.0) -> str:
        """What is wrong with it for a command that was given something damaged; "" when nothing is."""
        if "Traceback" in self.err or "Exception ignored" in self.err:
            return "a traceback"
        if self.status not in (0, 1, 2):
            return f"status {self.status}"
        if self.status and not (self.err.startswith("terrapin: ") and self.err.count("\n") == 1):
            return f"{self.err.count(chr(10))} lines"
        if self.memory > memory:
            return f"{self.memory >> 20} MiB"
        return f"{self.seconds:.1f} s" if self.seconds > seconds else ""


def counted(name: str, outcomes: Iterable[tuple[str, Outcome, str]]) -> Result:
    """The sums of what was tried: what each try was, what came of it, and what is wrong with that."""
    total, taken, first, most, longest = 0, 0, "", 0, 0.0
    for what, outcome, wrong in outcomes:
        total += 1
        most, longest = max(most, outcome.memory), max(longest, outcome.seconds)
        if wrong:
            taken += 1
            first = first or f"; first: {what}: {wrong}"
    return Result(name, total, taken, f"at most {most >> 20} MiB, {longest:.1f} s{first}")


def run(arguments: Sequence[object], folder: Path, file_size: int | None = None) -> Outcome:
    """One command in `folder`; `file_size`: no file may grow beyond [bytes], as on a full disk."""
    return together([arguments], folder, file_size)[0]


def learn(arguments: Sequence[object], folder: Path) -> Outcome:
    """One command in `folder`; what it has imported is imported here, so that those after it need not."""
    with tempfile.NamedTemporaryFile("r", encoding="utf-8") as names:
        outcome = together([arguments], folder, names=Path(names.name))[0]
        for name in names.read().split():
            if name not in sys.modules and not name.startswith("__"):
                with suppress(Exception):  # one that another made by hand
                    importlib.import_module(name)
    return outcome


def together(
    commands: Sequence[Sequence[object]],
    folder: Path,
    file_size: int | None = None,
    kill_after: float | None = None,
    only_reads: bool = False,
    names: Path | None = None,
    apart: float = 0.0,
    then: Callable[[], object] = lambda: None,
) -> list[Outcome]:
    """Commands that are started at the same moment, or `apart` [s]. `kill_after`: each gets SIGKILL then [s];
    `only_reads`: they may write nothing in `folder`, as one who is not its owner; `names`: gets the names of all
    modules that they have; `then`: is done when the last has begun."""
    for name in WARM:
        importlib.import_module(name)
    with ExitStack() as open_files:
        begun = []
        for number, arguments in enumerate(commands):
            time.sleep(apart if number else 0.0)
            out, err = (open_files.enter_context(_Words(file_size is not None)) for _ in range(2))
            sys.stdout.flush()
            sys.stderr.flush()
            pid = os.fork()
            if pid == 0:
                _child([str(a) for a in arguments], folder, out.to, err.to, file_size, only_reads, names)
            begun.append((pid, out, err))
        then()
        if kill_after is not None:
            time.sleep(kill_after)
            for pid, _, _ in begun:
                os.kill(pid, signal.SIGKILL)  # not waited for yet: the number is still its own
        until = time.monotonic() + WALL
        return [_ended(pid, out, err, until) for pid, out, err in begun]


class _Words:
    """Where a command speaks: a file, or a pipe of 1 MiB, which a full disk does not fill."""

    def __init__(self, pipe: bool) -> None:
        self._file: IO[bytes]
        if pipe:
            end, self.to = os.pipe()
            fcntl.fcntl(self.to, fcntl.F_SETPIPE_SZ, 1 << 20)
            os.set_blocking(end, False)
            self._file = os.fdopen(end, "rb", buffering=0)
        else:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115
            self.to = os.dup(self._file.fileno())

    def __enter__(self) -> _Words:
        return self

    def __exit__(self, *what: object) -> None:
        self._file.close()
        os.close(self.to)

    def said(self) -> str:
        if self._file.seekable():
            self._file.seek(0)
        return (self._file.read(1 << 20) or b"").decode("utf-8", "replace")


def _ended(pid: int, out: _Words, err: _Words, until: float) -> Outcome:
    while True:
        done, status, used = os.wait4(pid, os.WNOHANG)
        if done:
            break
        if time.monotonic() > until:
            os.killpg(pid, signal.SIGKILL)
        time.sleep(0.005)
    words = [file.said() for file in (out, err)]
    cpu = used.ru_utime + used.ru_stime
    return Outcome(os.waitstatus_to_exitcode(status), words[0], words[1], cpu, used.ru_maxrss << 10)


def _give_up_writing(folder: Path) -> None:
    """What is in `folder` may be read and not written, by root neither: it gives up what lets it (capset(2))."""
    for path in [folder, *folder.rglob("*")]:
        path.chmod(path.stat().st_mode & 0o555)
    if os.geteuid() == 0:
        head = struct.pack("Ii", CAPABILITIES, 0)
        if ctypes.CDLL(None, use_errno=True).capset(head, bytes(24)):
            raise OSError(ctypes.get_errno(), "capset")


def _child(
    arguments: list[str],
    folder: Path,
    out: int,
    err: int,
    file_size: int | None,
    only_reads: bool,
    names: Path | None,
) -> None:
    status = 70
    try:
        os.setsid()
        os.chdir(folder)
        nothing = os.open(os.devnull, os.O_RDONLY)
        for number, handle in enumerate((nothing, out, err)):
            os.dup2(handle, number)
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if only_reads:
            _give_up_writing(folder)
        if file_size is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (file_size, file_size))
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
        sys.argv = ["terrapin", *arguments]
        from terrapin_tools.cli import main

        try:
            main()
        except SystemExit as stop:
            status = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
            if names is not None:
                names.write_text("\n".join(sys.modules), encoding="utf-8")
        except OSError:
            pass
        os._exit(status)
