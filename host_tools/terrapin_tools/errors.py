"""The one way in which the tools say that what they were given is wrong."""


class UserError(Exception):
    """Something outside the program is wrong. `str()` is one line: where, which field, found, expected."""

    def __init__(self, message: str, status: int = 2) -> None:
        super().__init__(message)
        self.status = status
