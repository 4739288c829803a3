"""Messages of a recording as a table: a row for each message, a column for each number or text in it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from terrapin_tools.workbench.files.format import Column, cells

__all__ = ["columns", "fields"]

LONGEST = 64  # of an array in a message whose entries become columns
DEEPEST = 8


def fields(message: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """The numbers and texts in a message, an object of JSON or a dataclass, by their names: pose.position.x.

    >>> dict(fields({"pose": {"x": 1.0}, "word": "a", "each": [1, 2]}))
    {'pose.x': 1.0, 'word': 'a', 'each.0': 1, 'each.1': 2}
    """
    if isinstance(message, (bool, int, float, str, np.number)):
        yield name or "value", message
    elif depth < DEEPEST:
        for key, value in _parts(message):
            yield from fields(value, f"{name}.{key}".lstrip("."), depth + 1)


def _parts(message: Any) -> Iterable[tuple[Any, Any]]:
    if isinstance(message, dict):
        return message.items()
    if dataclasses.is_dataclass(message):
        names = [each.name for each in dataclasses.fields(message) if each.name != "__msgtype__"]
        return [(name, getattr(message, name)) for name in names]
    short = isinstance(message, (list, tuple, np.ndarray)) and len(message) <= LONGEST
    return enumerate(message) if short else ()


def columns(rows: Sequence[Mapping[str, Any]]) -> dict[str, Column]:
    """A column of each name in the rows; where a row lacks it, NaN, or "" among texts."""
    found: dict[str, Column] = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        values = [row.get(name) for row in rows]
        if any(isinstance(value, str) for value in values):
            found[name] = cells(values)
        else:
            found[name] = np.array([np.nan if value is None else float(value) for value in values])
    return found
