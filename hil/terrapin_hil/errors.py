"""The one way to say that what the program was given is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["UserError", "about"]


class UserError(Exception):
    """Something outside the program is wrong. `str()` is one line: where, which field, found, expected."""

    def __init__(self, message: str, status: int = 2) -> None:
        super().__init__(message)
        self.status = status


@contextmanager
def about(place: object, kind: type[Exception] | tuple[type[Exception], ...] = ValueError) -> Iterator[None]:
    """An error of this kind, or one of these, becomes a UserError that begins with the place.

    >>> with about("--level"):
    ...     float("high")
    Traceback (most recent call last):
    terrapin_hil.errors.UserError: --level: could not convert string to float: 'high'
    """
    try:
        yield
    except kind as error:
        said = error.strerror if isinstance(error, OSError) else None  # str() of it has number and place once more
        raise UserError(f"{place}: {said or error}") from None
