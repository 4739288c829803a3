"""Mappings of the front door: asked for a name that is none, they say which there are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from terrapin_tools.errors import InputError

__all__ = ["Named", "NoSuchName"]

Kind = TypeVar("Kind")


class NoSuchName(InputError, KeyError):
    """An InputError for programs that ask for a name that is none; a KeyError, as of every mapping."""

    __str__ = Exception.__str__  # a KeyError's is in quotation marks


class Named(dict[str, Kind]):
    """A dict whose complaint says `what` it is of, and the names that it has.

    >>> Named({"omega": 1.0}, "truth")["omga"]
    Traceback (most recent call last):
    terrapin_tools.door.named.NoSuchName: truth: found no omga, is `omega` meant? it has omega
    """

    def __init__(self, values: Mapping[str, Kind], what: str) -> None:
        super().__init__(values)
        self.what = what

    def __missing__(self, name: object) -> Kind:
        from terrapin_hil.scenario.checks import what_there_is

        said = what_there_is(str(name), self) if self else "it is empty"
        raise NoSuchName(f"{self.what}: found no {name}, {said}")
