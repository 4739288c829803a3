"""`terrapin`: one sub-command a module of host_tools.commands, named as the module."""

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
from pathlib import Path
from types import FrameType
from typing import Any

import typer
import typer.main
from typer.core import TyperGroup

from host_tools import commands
from host_tools.errors import UserError

__all__ = ["main"]


def _summary(path: Path) -> str:
    """The first line of a module's docstring without the command that it names: enough for the list of commands.

    Read as text, so that the list comes at once: importing every command takes most of a second.
    """
    with path.open(encoding="utf-8") as file:
        line = file.readline().strip().strip('"')
    summary = line.partition("`: ")[2]
    return summary[:1].upper() + summary[1:]


class _Commands(TyperGroup):
    """The sub-commands; a module is imported when its command is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        return sorted(info.name for info in pkgutil.iter_modules(commands.__path__))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in self.list_commands(ctx):
            return None
        app = _app(None)
        importlib.import_module(f"{commands.__name__}.{cmd_name}").register(app)
        group: Any = typer.main.get_command(app)
        return group.commands[cmd_name]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        folder = Path(next(iter(commands.__path__)))
        rows = [(name, _summary(folder / f"{name}.py")) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl(rows)


def _app(group: type[TyperGroup] | None) -> typer.Typer:
    app = typer.Typer(
        name="terrapin",
        help="Controller, simulator and workbench for robots that roll on soft ground.",
        cls=group or TyperGroup,
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    app.callback()(lambda: None)
    return app


def _run() -> object:
    """Run the command that the arguments name. Typer's own way out would turn Ctrl-C and a closed pipe into others."""
    group: Any = typer.main.get_command(_app(_Commands))
    try:
        with group.make_context("terrapin", sys.argv[1:]) as context:
            return group.invoke(context)
    except typer.Exit as stop:  # --help
        return stop.exit_code


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
            status = _run()
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
