"""The sub-commands: one a module of host_tools.commands, named as the module and imported when it is called."""

from __future__ import annotations

import importlib
import pkgutil
import sys
from pathlib import Path
from typing import Any

import typer
import typer.main
from typer.core import TyperGroup

from host_tools import commands
from host_tools.errors import UserError

__all__ = ["run"]


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


def run() -> object:
    """Run the command that the arguments name; its exit status, where it is a number. UserError, KeyboardInterrupt and
    whatever the command raises: Typer's own way out would turn Ctrl-C and a closed pipe into others."""
    group: Any = typer.main.get_command(_app(_Commands))
    try:
        with group.make_context("terrapin", sys.argv[1:]) as context:
            return group.invoke(context)
    except typer.Exit as stop:  # --help
        return stop.exit_code
    except typer.Abort:
        raise KeyboardInterrupt from None
    except typer.TyperException as error:  # a wrong command line; without any argument its message is the help
        message = error.format_message()
        if not message.startswith("Usage:"):
            raise UserError(message, status=error.exit_code) from None
        print(message, file=sys.stderr)  # a command without its sub-command: help, not a complaint
        return error.exit_code
