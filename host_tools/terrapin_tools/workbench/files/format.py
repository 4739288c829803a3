"""What a kind of file is to this program (`Format`), what it holds (`Part`), and what a user says of it (`Asked`).

A format is one file in formats/: it turns a file into parts, tables of typed columns or cells. What is common to all of
them (which part, units, dates, runs, bounds, complaints) is in tables.py.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.reading import shorten
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files import units

__all__ = [
    "Ambiguous",
    "Asked",
    "Column",
    "Format",
    "Part",
    "arrow_texts",
    "cells",
    "meant",
    "named",
    "parted",
    "text_cells",
]

Column = npt.NDArray[Any]  # float64, or str where the file holds text
LONG = 200  # characters of a text that stay where one makes its column too wide,
ROOM = 16 << 20  # which is so many characters

_VALUES = {
    "decimal": ("point", "comma"),
    "dates": ("day first", "month first"),
    "clock": ("h:m", "m:s"),
}
_HEADING = re.compile(r"\s*(.*?\S)\s*[\[(]([^\])]*)[\])]\s*")
_PART = ("sheet", "group", "topic", "variable", "file")  # other words for `part`
_RUNS = re.compile(r"(?:repeat|gap|gap:[0-9.eE+-]+|trigger:.+|column:.+)")


class Ambiguous(UserError):
    """A file that may be read in two ways; `key` of `Asked` says which, with one of `choices`. The page makes
    buttons of what stands behind --read (map_read.js)."""

    def __init__(self, found: str, key: str, choices: Sequence[str]) -> None:
        self.found, self.key, self.choices = found, key, tuple(choices)
        say = " or ".join(f"{key}={choice!r}" if " " in choice else f"{key}={choice}" for choice in choices[:6])
        super().__init__(f"{found}; say which it is with --read {say}")


@dataclass(frozen=True)
class Asked:
    """How files are to be read: [data.read] of case.toml, --read KEY=VALUE. "" is what the file itself tells.

    part : a sheet, group, topic, variable or packed file by its name; * for all, a run each.
    range : cells of a sheet, A3:F90. names, units : their lines, or 0 for no line of units.
    separator, encoding, decimal (point, comma), dates (day first, month first), clock (h:m, m:s).
    runs : repeat (a time that starts again), gap or gap:SECONDS, trigger:COLUMN, column:COLUMN.
    """

    part: str = ""
    range: str = ""
    names: str = ""
    units: str = ""
    separator: str = ""
    encoding: str = ""
    decimal: str = ""
    dates: str = ""
    clock: str = ""
    runs: str = ""

    @classmethod
    def of(cls, said: Mapping[str, Any], where: str) -> Asked:
        """UserError, which begins with `where`, for a key or a value that is none."""
        keys = [each.name for each in fields(cls)]
        found: dict[str, str] = {}
        for key, value in said.items():
            name = "part" if key in _PART else key
            if name not in keys:
                raise UserError(f"{where}: found {shorten(key)}, expected one of {', '.join([*keys, *_PART])}")
            if not isinstance(value, str) or not value or name in found:
                raise UserError(f"{where}: {key}: found {shorten(value)}, expected one text")
            if value not in _VALUES.get(name, (value,)):
                raise UserError(f"{where}: {key}: found {shorten(value)}, expected {' or '.join(_VALUES[name])}")
            if name in ("names", "units") and not (value.isdecimal() and len(value) < 8):
                raise UserError(f"{where}: {key}: found {shorten(value)}, expected the number of a line")
            if name == "runs" and not _RUNS.fullmatch(value):
                raise UserError(
                    f"{where}: runs: found {shorten(value)}, expected repeat, gap, gap:SECONDS, trigger:COLUMN or "
                    "column:COLUMN"
                )
            found[name] = value
        return cls(**found)

    def also(self, key: str, value: str) -> Asked:
        """The same with an answer to an `Ambiguous`."""
        return replace(self, **{"part" if key in _PART else key: value})

    def said(self) -> dict[str, str]:
        """What is not left to the file."""
        return {each.name: value for each in fields(self) if (value := getattr(self, each.name))}


@dataclass(frozen=True)
class Part:
    """A table of a file. `first_line` is the line of row 0, 0 where rows are counted from 1.

    Columns have the same length each. `units` are as the file spells them, by column.
    """

    name: str
    columns: dict[str, Column]
    units: Mapping[str, str] = field(default_factory=dict)
    first_line: int = 0
    notes: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        return len(next(iter(self.columns.values()))) if self.columns else 0


@dataclass(frozen=True)
class Format:
    """A kind of file.

    name : as a complaint calls it, "a spreadsheet". part : what it calls its parts.
    read : the parts of a file; columns named in the third argument stay text. What it raises is told as "no such file".
    package, extra : what has to be installed for it, and the extra of this program that brings it ("" for none).
    folder : whether a folder is a file of this kind.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Path, Asked, Collection[str]], list[Part]]
    part: str = "part"
    package: str = ""
    extra: str = ""
    folder: Callable[[Path], bool] | None = None


def cells(values: Sequence[Any]) -> Column:
    """A column of any values, as text: whole numbers without a point, nothing as ""."""
    return text_cells(["" if value is None else _text(value) for value in values])


def text_cells(texts: Sequence[str]) -> Column:
    """A column of text. NumPy gives each row the room of the longest: where that is much, long ones are cut.

    What is cut keeps its beginning, its length and a digest, so that different texts stay different.
    """
    longest = max(map(len, texts), default=0)
    if longest > LONG and longest * len(texts) > ROOM:
        texts = [text if len(text) <= LONG else _cut(text) for text in texts]
    return np.array(texts, dtype=str)


def _cut(text: str) -> str:
    digest = hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:8]
    return f"{text[: LONG - 60]}... ({len(text)} characters, SHA-256 {digest})"


def arrow_texts(column: Any) -> Column:
    """A column of text of Arrow's, as `text_cells`; texts that come again are made once."""
    import pyarrow

    if isinstance(column, pyarrow.ChunkedArray):
        column = column.combine_chunks()
    coded = column.fill_null("").dictionary_encode()
    words = text_cells(coded.dictionary.to_pylist())
    if words.itemsize * len(coded) > 4 * ROOM:
        words = text_cells([word if len(word) <= LONG else _cut(word) for word in coded.dictionary.to_pylist()])
    return words[coded.indices.to_numpy()] if len(words) else np.array([""] * len(coded), dtype=str)


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", errors="replace")
    if isinstance(value, (float, np.floating)):
        number = float(value)
        if np.isnan(number):
            return ""
        return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)
    return str(value)


def parted(heading: str) -> tuple[str, str]:
    """A heading's bare name, and the unit behind it as it is written, or that of words; "" for none.

    >>> parted("D [mm]"), parted("q (kPa)"), parted("slip"), parted("Zeit in Sekunden")
    (('D', 'mm'), ('q', 'kPa'), ('slip', ''), ('Zeit', 's'))
    """
    match = _HEADING.fullmatch(heading)
    return (match[1], match[2].strip()) if match else units.behind_words(heading.strip())


def meant(said: str, columns: Iterable[str]) -> str | None:
    """The column that somebody means: its heading as written, or its bare name where only one has it. A unit that is
    said beside the name is that of the heading, or the heading has none. None for no column.

    >>> meant("D [mm]", ["D [mm]"]), meant("D", ["D [mm]"]), meant("D [mm]", ["D"]), meant("D [mm]", ["D (mm)"])
    ('D [mm]', 'D [mm]', 'D', 'D (mm)')
    >>> meant("D [cm]", ["D [mm]"]), meant("D", ["D [mm]", "D [cm]"])
    (None, None)
    """
    columns = list(columns)
    if said in columns:
        return said
    name, unit = parted(said)
    found = []
    for column in columns:
        bare, own = parted(column)
        if bare == name and (not unit or not own or units.spelling(own) == units.spelling(unit)):
            found.append(column)
    return found[0] if len(found) == 1 else None


def named(column: str, unit: str) -> tuple[str, str]:
    """A column's name with its unit, `torque [mN m]`; and a note where the unit is none that pint reads."""
    spelt = units.spelling(unit.partition(" since ")[0]) if unit.strip() else ""
    if not spelt or re.search(r"[\[(][^\])]*[\])]\s*$", column):
        return column, ""
    try:
        units.check(spelt)
    except ValueError:
        return column, f"{column}: unit {shorten(unit)} is not known and left out"
    return f"{column} [{spelt}]", ""
