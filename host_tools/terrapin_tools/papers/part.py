"""A part of a paper, ready for the page: a figure or table regenerated, with checks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from terrapin_tools.papers.verdict import Check

__all__ = ["Figure", "Part", "Table"]


@dataclass(frozen=True)
class Table:
    """Rows of text under a head; numbers come formatted."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Figure:
    """`draw` fills an empty Matplotlib figure."""

    name: str  # of the file, without its end
    caption: str
    size: tuple[float, float]  # inches
    draw: Callable[[Any], None]


@dataclass(frozen=True)
class Part:
    paper: str  # key in printed.toml
    title: str  # "Table 4"
    about: str  # what it shows, in the paper's words or ours
    checks: tuple[Check, ...]
    text: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()
    tables: tuple[Table, ...] = field(default=())
