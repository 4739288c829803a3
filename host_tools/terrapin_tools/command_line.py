"""The sub-commands: one a module of terrapin_tools.commands, named as the module and imported when it is called."""

from __future__ import annotations

import importlib
import os
import pkgutil
import re
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.main
from typer.core import TyperGroup

from terrapin_tools import __version__, commands
from terrapin_tools.errors import UserError

__all__ = ["run"]


def _summary(text: str) -> str:
    """The first line of a module's docstring without the command that it names."""
    summary = text.lstrip('"').partition("\n")[0].rstrip('"').partition("`: ")[2]
    return summary[:1].upper() + summary[1:]


class _Commands(TyperGroup):
    """The sub-commands by name and summary; a module is imported when its command is called, or completed."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        name, command, rest = super().resolve_command(ctx, args)
        if name is None or command is None:
            return name, command, rest
        module = importlib.import_module(f"{commands.__name__}.{name}")
        app = _app(TyperGroup)
        if subcommands := getattr(module, "SUBCOMMANDS", ()):
            group = typer.Typer(help=_summary(module.__doc__ or ""), no_args_is_help=True, rich_markup_mode=None)
            group.callback()(lambda: None)  # one of a single sub-command is a group too
            for function in subcommands:
                group.command(function.__name__.rstrip("_"))(function)
            app.add_typer(group, name=name)
            names = {function.__name__.rstrip("_") for function in subcommands}
            if hasattr(module, "implied") and rest and rest[0] not in {*names, "-h", "--help"}:
                rest = module.implied(rest)
        else:
            app.command(name)(getattr(module, name))
        found: Any = typer.main.get_command(app)
        return name, found.commands[name], rest


def _say_version(wanted: bool) -> None:
    if wanted:
        print(f"terrapin {__version__}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Controller, simulator and workbench for robots that roll on soft ground."""


def _app(group: type[TyperGroup]) -> typer.Typer:
    app = typer.Typer(
        name="terrapin",
        cls=group,
        context_settings={"help_option_names": ["-h", "--help"]},
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    app.callback()(_root)
    return app


_WRONG = re.compile(r"Invalid value for '([^']+)': ")
_CHOICE = re.compile(r" is not one of '([^\n]*)'\.?$")
_EXPECTED = {  # kind of pydantic's complaint -> what was expected
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_parsing": "a number",
    "greater_than_equal": "{ge} or more",
    "less_than_equal": "{le} at most",
}


def _in_own_words(error: typer.TyperException) -> str:
    """What is wrong with the command line. Of a value: which, what was found and what was expected, as everywhere else;
    Typer hands on the words of pydantic."""
    message = error.format_message()
    if re.match(r"No such option: -[\d.]", message):
        return f"{message}; a negative value comes after --"
    wrong, errors = _WRONG.match(message), getattr(error.__cause__, "errors", None)
    if wrong is None or errors is None:
        return message
    from terrapin_hil.reading import is_meant, shorten

    first = errors()[0]
    found = str(first["input"])
    if choice := _CHOICE.search(str(first["msg"])):
        known = choice[1].split("', '")
        expected = f"one of {', '.join(known)}{is_meant(found, known)}"
    elif first["type"] in _EXPECTED:
        expected = _EXPECTED[first["type"]].format(**first.get("ctx", {}))
    else:
        return message
    return f"{wrong[1]}: found {shorten(found)}, expected {expected}"


def run() -> object:
    """Run the command that the arguments name; its exit status, where it is a number. UserError, KeyboardInterrupt and
    whatever the command raises: Typer's own way out would turn Ctrl-C and a closed pipe into others."""
    app = _app(_Commands)
    for info in pkgutil.iter_modules(commands.__path__):
        text = Path(commands.__path__[0], f"{info.name}.py").read_text(encoding="utf-8")  # importing all takes a second
        app.command(info.name, short_help=_summary(text))(lambda: None)
    group: Any = typer.main.get_command(app)
    if "_TERRAPIN_COMPLETE" in os.environ:  # a shell asks what may follow
        os.environ["COLUMNS"] = "1000"  # one candidate a line, however long its help
        group.main(prog_name="terrapin")
    try:
        with group.make_context("terrapin", sys.argv[1:]) as context:
            return group.invoke(context)
    except typer.Exit as stop:  # --help, --version
        return stop.exit_code
    except typer.Abort:
        raise KeyboardInterrupt from None
    except typer.TyperException as error:  # a wrong command line; without any argument its message is the help
        message = _in_own_words(error)
        if not message.startswith("Usage:"):
            raise UserError(message, status=error.exit_code) from None
        print(message, file=sys.stderr)  # a command without its sub-command: help, not a complaint
        return error.exit_code
