"""`terrapin`: one sub-command a module of host_tools.commands."""

from __future__ import annotations

import importlib
import io
import os
import pkgutil
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

import typer

from host_tools import commands
from host_tools.errors import UserError

__all__ = ["main"]


def _app() -> typer.Typer:
    app = typer.Typer(
        name="terrapin",
        help="Controller, simulator and workbench for robots that roll on soft ground.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    app.callback()(lambda: None)
    for info in sorted(pkgutil.iter_modules(commands.__path__), key=lambda m: m.name):
        importlib.import_module(f"{commands.__name__}.{info.name}").register(app)
    return app


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
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(message))
    print(f"terrapin: {text}", file=sys.stderr)


def _discard_output() -> None:
    """What could not be written is not tried again when the interpreter ends."""
    with suppress(io.UnsupportedOperation):  # standard output that is no file: a test's
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main() -> None:
    """Run the command line. Exit status 2 and one line on standard error for bad input, 130 for Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a title may hold what the terminal cannot show
    try:
        with _signals():
            status = _app()(standalone_mode=False)
            sys.stdout.flush()
    except UserError as error:
        _say(error)
        sys.exit(error.status)
    except (typer.Abort, KeyboardInterrupt):
        _say("interrupted")
        sys.exit(130)
    except _Terminated as stopped:
        _say(f"stopped by {signal.Signals(stopped.number).name}")
        sys.exit(128 + stopped.number)
    except typer.TyperException as error:  # a wrong command line; without any argument its message is the help
        message = error.format_message()
        if message.startswith("Usage:"):  # a command without its sub-command: help, not a complaint
            print(message, file=sys.stderr)
        else:
            _say(message)
        sys.exit(error.exit_code)
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
