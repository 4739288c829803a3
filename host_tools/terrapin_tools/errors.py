"""The one way in which the tools say that what they were given is wrong: the simulator's own."""

from terrapin_hil.errors import UserError, about

__all__ = ["UserError", "about", "printable"]


def printable(text: str, keep: str = "") -> str:
    r"""Text without control characters, whatever a title, a run's name or a file brought along; `keep` are kept.

    >>> printable("run \x1b]0;owned\x07")
    'run \\x1b]0;owned\\x07'
    """
    return "".join(c if c.isprintable() or c in keep else c.encode("unicode_escape").decode() for c in text)
