"""The one way to say that what the program was given is wrong."""

from __future__ import annotations

__all__ = ["UserError"]


class UserError(Exception):
    """Something outside the program is wrong. `str()` is one line: where, which field, found, expected."""

    def __init__(self, message: str, status: int = 2) -> None:
        super().__init__(message)
        self.status = status
