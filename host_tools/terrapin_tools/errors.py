"""The one way in which the tools say that what they were given is wrong: the simulator's own."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Collection
from typing import ParamSpec, TypeVar

from terrapin_hil.errors import UserError, about

__all__ = ["InputError", "UserError", "about", "for_programs", "in_a_program", "printable"]

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class InputError(UserError, ValueError):
    """What a program that imports `terrapin_tools` gave is wrong: a UserError that is a ValueError as well.

    >>> isinstance(InputError("fit: found 2 numbers, expected 1 or 3"), ValueError)
    True
    """


OPTION = re.compile(r"(?<![\w/-])--([a-z]+(?:-[a-z]+)*)(?:=(\S+))?")
COMMANDS = (  # of the command line, and what a program calls in their place
    (re.compile(r"`?terrapin case table`?"), "Case.from_table"),
    (re.compile(r"`?terrapin run --out`?"), "Session(..., log=FOLDER)"),
    (re.compile(r"`?terrapin (compare|discover|add|remove|report)\b`?"), r"Case.\1"),
    (re.compile(r"--robot\b"), "Robot(NAME).use()"),
    (re.compile(r'is = "\.\.\."'), "roles= of Case.from_table"),
)


def in_a_program(text: str, arguments: Collection[str] = ()) -> str:
    """A complaint in the words of a program that called a function with these arguments: an option is the argument of
    its name, a command the method. What a program has no word for stays.

    >>> in_a_program("run.toml: found 'sphere', expected 'cylinder': name it with --robot", ["robot"])
    "run.toml: found 'sphere', expected 'cylinder': name it with robot="
    >>> in_a_program("--soil: found 'mud', expected one of sand", ["soil"])
    "soil: found 'mud', expected one of sand"
    >>> in_a_program("--effect: found 'mud', expected one of sinkage", ["effects"])
    "effects: found 'mud', expected one of sinkage"
    """

    def argument(found: re.Match[str]) -> str:
        name, value = found[1].replace("-", "_"), found[2]
        name = name if name in arguments else f"{name}s"  # an option that is given once for each of several
        if name not in arguments:
            return found[0]
        if value:
            return f"{name}={value!r}"
        return name if found.start() == 0 and text[found.end() :].startswith(":") else f"{name}="

    text = OPTION.sub(argument, text)
    for command, instead in COMMANDS:
        text = command.sub(instead, text)
    return text


def for_programs(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function with its UserErrors as InputErrors. What is raised below it speaks to the command line, which is
    most of its callers: here, and nowhere else, a program gets its own words (`in_a_program`)."""

    @functools.wraps(function)
    def called(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        try:
            return function(*args, **kwargs)
        except InputError:
            raise
        except UserError as error:
            said = in_a_program(str(error), inspect.signature(function).parameters)
            raise InputError(said, error.status) from None
        except OSError as error:
            if len(error.args) == 1:  # a link's; those of the system have a number
                error.args = (in_a_program(str(error.args[0]), inspect.signature(function).parameters),)
            raise

    return called


def printable(text: str, keep: str = "") -> str:
    r"""Text without control characters, whatever a title, a run's name or a file brought along; `keep` are kept.

    >>> printable("run \x1b]0;owned\x07")
    'run \\x1b]0;owned\\x07'
    """
    return "".join(c if c.isprintable() or c in keep else c.encode("unicode_escape").decode() for c in text)
