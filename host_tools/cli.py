"""`terrapin`: one sub-command a module of host_tools.commands."""

from __future__ import annotations

import importlib
import os
import pkgutil
import sys

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


def main() -> None:
    """Run the command line. Exit status 2 and one line on standard error for bad input, 130 for Ctrl-C."""
    try:
        status = _app()(standalone_mode=False)
    except UserError as error:
        print(f"terrapin: {error}", file=sys.stderr)
        sys.exit(error.status)
    except (typer.Abort, KeyboardInterrupt):
        print("terrapin: interrupted", file=sys.stderr)
        sys.exit(130)
    except typer.TyperException as error:  # a wrong command line; without any argument its message is the help
        message = error.format_message()
        print(f"terrapin: {message}" if len(sys.argv) > 1 else message, file=sys.stderr)
        sys.exit(error.exit_code)
    except BrokenPipeError:  # the reader of a pipe went away: not an error of ours
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)
    except OSError as error:  # full disk, no permission, no such device
        where = f"{error.filename}: " if error.filename else ""
        print(f"terrapin: {where}{error.strerror or error}", file=sys.stderr)
        sys.exit(1)
    sys.exit(status if isinstance(status, int) else 0)
