"""Reading TOML that people write: units, ranges and names are checked, and an error says where and what was expected.

Numbers are SI; a string carries its unit ("80 mm", "14 deg", "5 ms"). Temperatures are in degC.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, fields
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

from hil.physics.expression import units

__all__ = ["ReadingError", "Section", "load", "parse_quantity", "quantities"]

T = TypeVar("T")


class ReadingError(ValueError):
    """A file is wrong. `str()` is one line: file, line, field, what was found, what was expected."""


def parse_quantity(value: object, unit: str) -> float:
    """`value` in `unit` (pint's spelling): a number as it is, a string converted. ValueError says what was expected.

    >>> parse_quantity("80 mm", "m")
    0.08
    >>> parse_quantity("20 degC", "degC")
    20.0
    """
    expected = "a number" if unit in ("", "1") else f"a number in {unit} or a string with a unit that converts to it"
    if isinstance(value, str):
        match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", value)
        if match is None:
            raise ValueError(f"found {value!r}, expected {expected}")
        try:
            given = units().Quantity(float(match[1]), match[2] or "dimensionless")
            number = float(given.to(unit or "dimensionless").magnitude)
        except Exception:  # pint's parser lets the tokenizer's errors and its own assertions through
            raise ValueError(f"found {value!r}, expected {expected}") from None
    elif isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"found {value!r}, expected {expected}")
    else:
        number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"found {value!r}, expected a finite number")
    return number


def _locate(text: str, table: str, index: int | None, key: str | None) -> int | None:
    """Line of `key` in the table `table` (its `index`-th copy if it is an array of tables), or of the table."""
    current, seen, header = "", -1, None
    for number, line in enumerate(text.splitlines(), 1):
        if match := re.match(r"\s*\[\[?\s*([^\[\]]+?)\s*\]\]?", line):
            current = match[1].replace(" ", "")
            if current == table:
                seen += 1
                if index is None or seen == index:
                    header = number
        elif (
            key is not None
            and current == table
            and (index is None or seen == index)
            and re.match(rf"\s*[\"']?{re.escape(key)}[\"']?\s*[=.]", line)
        ):
            return number
    return header


class Section:
    """One table of a file. Each reader takes a key; `done` refuses what nobody read."""

    def __init__(
        self, values: Mapping[str, Any], file: str, text: str, table: str = "", index: int | None = None
    ) -> None:
        self._values = values
        self._file = file
        self._text = text
        self._table = table
        self._index = index
        self._read: set[str] = set()

    def error(self, key: str | None, message: str) -> ReadingError:
        """The error to raise about `key`; `message` reads "found ..., expected ..."."""
        line = _locate(self._text, self._table, self._index, key)
        name = ".".join(part for part in (self._table, key) if part)
        if self._index is not None:
            name = name.replace(self._table, f"{self._table}[{self._index + 1}]", 1)
        place = self._file if line is None else f"{self._file}:{line}"
        return ReadingError(f"{place}: {name}: {message}" if name else f"{place}: {message}")

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def raw(self, key: str) -> Any:
        self._read.add(key)
        return self._values.get(key)

    def value(self, key: str, convert: Callable[[Any], T], default: T | None = None) -> T:
        """`convert` raises ValueError with "found ..., expected ..."; without `default` the key must be there."""
        self._read.add(key)
        if key not in self._values:
            if default is None:
                raise self.error(key, "missing, and it has no default")
            return default
        try:
            return convert(self.raw(key))
        except ValueError as error:
            raise self.error(key, str(error)) from None

    def quantity(
        self, key: str, unit: str, default: float | None = None, low: float = -math.inf, high: float = math.inf
    ) -> float:
        def convert(value: Any) -> float:
            number = parse_quantity(value, unit)
            if not low <= number <= high:
                shown = "" if unit == "1" else f" {unit}"
                raise ValueError(f"found {value!r}, expected {low:g} to {high:g}{shown}")
            return number

        return self.value(key, convert, default)

    def whole(self, key: str, default: int | None = None, low: int = 0, high: int = 2**63 - 1) -> int:
        def convert(value: Any) -> int:
            if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
                raise ValueError(f"found {value!r}, expected a whole number from {low} to {high}")
            return value

        return self.value(key, convert, default)

    def flag(self, key: str, default: bool | None = None) -> bool:
        def convert(value: Any) -> bool:
            if not isinstance(value, bool):
                raise ValueError(f"found {value!r}, expected true or false")
            return value

        return self.value(key, convert, default)

    def text(self, key: str, default: str | None = None) -> str:
        def convert(value: Any) -> str:
            if not isinstance(value, str):
                raise ValueError(f"found {value!r}, expected text")
            return value

        return self.value(key, convert, default)

    def choice(self, key: str, allowed: Iterable[str], default: str | None = None) -> str:
        names = list(allowed)

        def convert(value: Any) -> str:
            if value not in names:
                raise ValueError(f"found {value!r}, expected one of {', '.join(names)}")
            return str(value)

        return self.value(key, convert, default)

    def points(self, key: str, unit: str) -> tuple[tuple[float, float], ...]:
        """A function of time as [[time, value], ...], times rising."""

        def convert(value: Any) -> tuple[tuple[float, float], ...]:
            if not isinstance(value, list) or not value or any(not isinstance(p, list) or len(p) != 2 for p in value):
                raise ValueError(f"found {value!r}, expected a list of [time, value] pairs")
            found = tuple((parse_quantity(t, "s"), parse_quantity(v, unit)) for t, v in value)
            if any(b[0] <= a[0] for a, b in pairwise(found)):
                raise ValueError(f"found {value!r}, expected rising times")
            return found

        return self.value(key, convert)

    def section(self, key: str) -> Section:
        """The table `key`, empty when absent."""
        value = self.raw(key) if key in self._values else {}
        self._read.add(key)
        if not isinstance(value, dict):
            raise self.error(key, f"found {value!r}, expected a table")
        return Section(value, self._file, self._text, ".".join(part for part in (self._table, key) if part))

    def sections(self, key: str) -> list[Section]:
        """The array of tables `key`, empty when absent."""
        value = self.raw(key) if key in self._values else []
        self._read.add(key)
        if not isinstance(value, list) or any(not isinstance(item, dict) for item in value):
            raise self.error(key, f"found {value!r}, expected tables, each begun with [[{key}]]")
        name = ".".join(part for part in (self._table, key) if part)
        return [Section(item, self._file, self._text, name, index) for index, item in enumerate(value)]

    def done(self, known: Iterable[str] = ()) -> None:
        """Refuses the first key that was not read."""
        for key in self._values:
            if key not in self._read:
                near = difflib.get_close_matches(key, {*known, *self._read}, 1)
                hint = f"; is `{near[0]}` meant?" if near else ""
                raise self.error(key, f"no such field{hint}")


def quantities(section: Section, kind: type[T], default: T | None = None) -> T:
    """A dataclass whose float fields carry `metadata={"unit": ...}` (and "low", "high"), read field by field."""
    values: dict[str, Any] = {}
    known = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    for field in fields(kind):  # type: ignore[arg-type]
        if "unit" not in field.metadata:
            continue
        fallback = getattr(default, field.name) if default is not None else field.default
        values[field.name] = section.quantity(
            field.name,
            field.metadata["unit"],
            None if fallback is MISSING else fallback,
            field.metadata.get("low", -math.inf),
            field.metadata.get("high", math.inf),
        )
    section.done(known)
    return kind(**values)


def load(path: Path) -> Section:
    """The file as its root table. ReadingError for what is no TOML, OSError when it cannot be read."""
    try:
        text = path.read_text(encoding="utf-8")
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        match = re.search(r"^(.*) \(at line (\d+), column (\d+)\)$", str(error))
        if match:
            raise ReadingError(f"{path}:{match[2]}: not TOML: {match[1]}, column {match[3]}") from None
        raise ReadingError(f"{path}: not TOML: {error}") from None
    except UnicodeDecodeError:
        raise ReadingError(f"{path}: not a text file in UTF-8") from None
    return Section(values, str(path), text)
