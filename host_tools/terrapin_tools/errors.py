"""The one way in which the tools say that what they were given is wrong: the simulator's own."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from terrapin_hil.errors import UserError, about

__all__ = ["InputError", "UserError", "about", "for_programs", "printable"]

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class InputError(UserError, ValueError):
    """What a program that imports `terrapin_tools` gave is wrong: a UserError that is a ValueError as well.

    >>> isinstance(InputError("fit: found 2 numbers, expected 1 or 3"), ValueError)
    True
    """


def for_programs(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function with its UserErrors as InputErrors."""

    @functools.wraps(function)
    def called(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        try:
            return function(*args, **kwargs)
        except InputError:
            raise
        except UserError as error:
            raise InputError(str(error), error.status) from None

    return called


def printable(text: str, keep: str = "") -> str:
    r"""Text without control characters, whatever a title, a run's name or a file brought along; `keep` are kept.

    >>> printable("run \x1b]0;owned\x07")
    'run \\x1b]0;owned\\x07'
    """
    return "".join(c if c.isprintable() or c in keep else c.encode("unicode_escape").decode() for c in text)
