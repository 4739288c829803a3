"""`terrapin`: whatever ends a command becomes one line and an exit status, from the first import on."""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from terrapin_tools.errors import UserError, printable

__all__ = ["main"]


class _Terminated(BaseException):
    """SIGTERM or SIGHUP; unwinds like Ctrl-C, so that logs end whole and controllers are let go."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


@contextmanager
def _signals() -> Iterator[None]:
    """SIGTERM and SIGHUP as exceptions, while a command runs in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        raise _Terminated(number)

    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    taken = [number for number, handler in before.items() if handler is signal.SIG_DFL]  # nohup stays in force
    for number in taken:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


def _say(message: object) -> None:
    """One line on standard error, whatever a file or a name brought along."""
    print(f"terrapin: {printable(str(message))}", file=sys.stderr)


def _discard_output() -> None:
    """What could not be written is not tried again when the interpreter ends."""
    with suppress(io.UnsupportedOperation):  # standard output that is no file: a test's
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _nowhere() -> io.TextIOWrapper:
    """For a stream that was closed before the start (`terrapin run >&-`)."""
    return open(os.devnull, "w", encoding="utf-8")  # until the interpreter ends


def main() -> None:
    """Run the command line. Exit status 2 and one line on standard error for bad input, 130 for Ctrl-C."""
    sys.stdout, sys.stderr = sys.stdout or _nowhere(), sys.stderr or _nowhere()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a title may hold what the terminal cannot show
    try:
        with _signals():
            from terrapin_tools.command_line import run  # takes half a second, in which Ctrl-C may come
            from terrapin_tools.extras import can_without_mf4

            can_without_mf4()
            status = run()
            sys.stdout.flush()
    except UserError as error:
        _say(error)
        sys.exit(error.status)
    except KeyboardInterrupt:
        _say("interrupted")
        sys.exit(130)
    except _Terminated as stopped:
        _say(f"stopped by {signal.Signals(stopped.number).name}")
        sys.exit(128 + stopped.number)
    except BrokenPipeError:  # the reader of a pipe went away: not an error of ours
        _discard_output()
        sys.exit(141)
    except OSError as error:  # full disk, no permission, no such device
        _say(f"{error.filename}: {error.strerror or error}" if error.filename else error.strerror or error)
        _discard_output()
        sys.exit(1)
    except MemoryError:
        _say("out of memory")
        sys.exit(1)
    sys.exit(status if isinstance(status, int) else 0)
