"""Reading TOML that people write: units, ranges and names are checked, and an error says where and what was expected.

Numbers are SI; a string carries its unit ("80 mm", "14 deg", "5 ms"). Temperatures are in degC.
"""

from __future__ import annotations

import ast
import difflib
import math
import os
import re
import shlex
import stat
import threading
import tomllib
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields
from itertools import pairwise
from pathlib import Path
from typing import IO, Any, Literal, TypeVar, overload

from terrapin_hil.errors import UserError
from terrapin_hil.units import factor, read_unit, units

__all__ = [
    "QUANTITY",
    "ReadingError",
    "Section",
    "is_meant",
    "key_parts",
    "load",
    "locate",
    "owner_alone",
    "parse_quantity",
    "parse_toml",
    "python_tree",
    "quantities",
    "shorten",
]


T = TypeVar("T")
LARGEST = 1e300  # of a number in a file; a whole number in TOML has no limit of its own
LONGEST = 16_000_000  # characters of a file: what is longer was not meant, and may never end (a device)
MAX_SHOWN = 60  # characters of a wrong value in a message


class ReadingError(UserError, ValueError):
    """A file is wrong. `str()` is one line: file, line, field, what was found, what was expected."""


def owner_alone(path: Path, file: IO[Any]) -> None:
    """ReadingError with the mend when a file of a secret, open as `file`, may be read or written by others.

    Where there are no such rights (Windows), and for a pipe, nothing is said.
    """
    found = os.fstat(file.fileno())
    if os.name == "posix" and stat.S_ISREG(found.st_mode) and found.st_mode & 0o077:
        rights = f"{stat.S_IMODE(found.st_mode):04o}"
        raise ReadingError(
            f"{path}: a secret that others may read or write (mode {rights}): chmod 600 {shlex.quote(str(path))}"
        )


QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")  # a number and its unit
_WARNINGS = threading.Lock()  # their filter is one for all threads


@overload
def python_tree(text: str, mode: Literal["eval"]) -> ast.Expression: ...


@overload
def python_tree(text: str, mode: Literal["exec"]) -> ast.Module: ...


def python_tree(text: str, mode: str) -> ast.AST:
    """What ast.parse makes of a text. Of somebody else's text, such as "1if", Python warns as if it were our code: not
    here. Raises what ast.parse raises."""
    with _WARNINGS, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ast.parse(text, mode=mode)


def parse_quantity(value: object, unit: str) -> float:
    """`value` in `unit` (pint's spelling): a number as it is, a string converted. ValueError says what was expected.

    >>> parse_quantity("80 mm", "m")
    0.08
    >>> parse_quantity("20 degC", "degC")
    20.0
    """
    expected = "a number" if unit in ("", "1") else f"a number in {unit} or a string with a unit that converts to it"
    if isinstance(value, str):
        match = QUANTITY.fullmatch(value)
        if match is None:
            raise ValueError(f"found {shorten(value)}, expected {expected}")
        try:
            number = _converted(float(match[1]), match[2], unit)
        except (TypeError, ValueError, ArithmeticError):  # pint says TypeError when kinds of quantity differ
            raise ValueError(f"found {shorten(value)}, expected {expected}") from None
    elif isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"found {shorten(value)}, expected {expected}")
    else:
        number = float(value) if abs(value) <= LARGEST else math.inf
    if not math.isfinite(number):
        raise ValueError(f"found {shorten(value)}, expected a finite number")
    return number


def _converted(number: float, given: str, unit: str) -> float:
    """Both units in pint's spelling. What pint raises where they do not convert."""
    known = factor(given, unit)
    if known is not None:
        return number * known
    return float(units().Quantity(number, read_unit(given)).to(read_unit(unit)).magnitude)


def is_meant(said: str, known: Collection[str]) -> str:
    """What stands behind a complaint about a name: a known one that is near; empty where none is.

    >>> is_meant("suply", ["supply", "stuck"])
    '; is `supply` meant?'
    """
    near = difflib.get_close_matches(said, known, 1)
    return f"; is `{near[0]}` meant?" if near else ""


def shorten(value: object) -> str:
    """A value as it stands in a message: one line, not a page.

    >>> shorten("x" * 200)
    "'xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx..."
    """
    text = repr(value)
    return text if len(text) <= MAX_SHOWN else text[:MAX_SHOWN] + "..."


_HEADER = re.compile(r"\s*\[{1,2}([^\[\],=]+)\]{1,2}\s*(?:#.*)?$")
_KEY = re.compile(r"""\s*((?:"[^"]*"|'[^']*'|[A-Za-z0-9_-]+|\s*\.\s*)+?)\s*=""")


def key_parts(dotted: str) -> tuple[str, ...]:
    """The names in a dotted key of TOML."""
    return tuple(a or b or c for a, b, c in re.findall(r'"([^"]*)"|\'([^\']*)\'|([A-Za-z0-9_-]+)', dotted))


def locate(text: str, wanted: Sequence[str], home: Sequence[str] = (), index: int | None = None) -> int | None:
    """Line (from 1) of the deepest part of the key `wanted` that the text has; None when it has none of it.

    With `index`, only within the `index`-th copy of the array of tables `home`.

    >>> locate("[data]\\nrun = 'run'\\n[data.columns]\\nomega = { unit = 'rpm' }\\n", ("data", "columns", "omega"))
    4
    """
    wanted, home = tuple(wanted), tuple(home)
    found, depth, seen = None, 0, -1
    current: tuple[str, ...] = ()
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            here = current = key_parts(header[1])
            seen += current == home
        elif entry := _KEY.match(line):
            here = (*current, *key_parts(entry[1]))
        else:
            continue
        inside = index is None or (seen == index and current[: len(home)] == home)
        if inside and len(here) > depth and here == wanted[: len(here)]:
            found, depth = number, len(here)
    return found


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
        home = key_parts(self._table)
        line = locate(self._text, home if key is None else (*home, key), home, self._index)
        name = ".".join(part for part in (self._table, key) if part)
        if self._index is not None:
            name = name.replace(self._table, f"{self._table}[{self._index + 1}]", 1)
        place = self._file if line is None else f"{self._file}:{line}"
        return ReadingError(f"{place}: {name}: {message}" if name else f"{place}: {message}")

    @property
    def source(self) -> str:
        """The whole file, as text."""
        return self._text

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
                raise ValueError(f"found {shorten(value)}, expected {low:g} to {high:g}{shown}")
            return number

        return self.value(key, convert, default)

    def whole(self, key: str, default: int | None = None, low: int = 0, high: int = 2**63 - 1) -> int:
        def convert(value: Any) -> int:
            if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
                raise ValueError(f"found {shorten(value)}, expected a whole number from {low} to {high}")
            return value

        return self.value(key, convert, default)

    def flag(self, key: str, default: bool | None = None) -> bool:
        def convert(value: Any) -> bool:
            if not isinstance(value, bool):
                raise ValueError(f"found {shorten(value)}, expected true or false")
            return value

        return self.value(key, convert, default)

    def text(self, key: str, default: str | None = None) -> str:
        def convert(value: Any) -> str:
            if not isinstance(value, str):
                raise ValueError(f"found {shorten(value)}, expected text")
            return value

        return self.value(key, convert, default)

    def choice(self, key: str, allowed: Iterable[str], default: str | None = None) -> str:
        names = list(allowed)

        def convert(value: Any) -> str:
            if value not in names:
                expected = f"one of {', '.join(names)}{is_meant(str(value), names)}"
                raise ValueError(f"found {shorten(value)}, expected {expected}")
            return str(value)

        return self.value(key, convert, default)

    def points(self, key: str, unit: str, low: float, high: float) -> tuple[tuple[float, float], ...]:
        """A function of time as [[time, value], ...], times rising, values within `low` and `high`."""

        def convert(value: Any) -> tuple[tuple[float, float], ...]:
            if not isinstance(value, list) or not value or any(not isinstance(p, list) or len(p) != 2 for p in value):
                raise ValueError(f"found {shorten(value)}, expected a list of [time, value] pairs")
            found = tuple((parse_quantity(t, "s"), parse_quantity(v, unit)) for t, v in value)
            if any(b[0] <= a[0] for a, b in pairwise(found)):
                raise ValueError(f"found {shorten(value)}, expected rising times")
            if outside := [number for _, number in found if not low <= number <= high]:
                raise ValueError(f"found {outside[0]:g}, expected {low:g} to {high:g} {unit}")
            return found

        return self.value(key, convert)

    def section(self, key: str) -> Section:
        """The table `key`, empty when absent."""
        value = self.raw(key) if key in self._values else {}
        self._read.add(key)
        if not isinstance(value, dict):
            raise self.error(key, f"found {shorten(value)}, expected a table")
        return Section(value, self._file, self._text, ".".join(part for part in (self._table, key) if part))

    def sections(self, key: str) -> list[Section]:
        """The array of tables `key`, empty when absent."""
        value = self.raw(key) if key in self._values else []
        self._read.add(key)
        if not isinstance(value, list) or any(not isinstance(item, dict) for item in value):
            raise self.error(key, f"found {shorten(value)}, expected tables, each begun with [[{key}]]")
        name = ".".join(part for part in (self._table, key) if part)
        return [Section(item, self._file, self._text, name, index) for index, item in enumerate(value)]

    def done(self, known: Iterable[str] = ()) -> None:
        """Refuses the first key that was not read."""
        for key in self._values:
            if key not in self._read:
                raise self.error(key, f"no such field{is_meant(key, {*known, *self._read})}")


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
    """The file as its root table. ReadingError when it cannot be read or is no TOML."""
    try:
        with path.open(encoding="utf-8-sig") as file:  # some editors begin a file with a byte order mark
            text = file.read(LONGEST + 1)
    except UnicodeDecodeError:
        raise ReadingError(f"{path}: not a text file in UTF-8") from None
    except OSError as error:
        raise ReadingError(f"{path}: {error.strerror}, expected a readable file") from None
    if len(text) > LONGEST:
        raise ReadingError(
            f"{path}: found more than {LONGEST // 1_000_000} million characters, expected a file of TOML"
        )
    return Section(parse_toml(text, path), str(path), text)


def parse_toml(text: str, path: Path) -> dict[str, Any]:
    """The document; ReadingError with file and line when it is none."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        match = re.search(r"^(.*) \(at line (\d+), column (\d+)\)$", str(error))
        if match:
            raise ReadingError(f"{path}:{match[2]}: not TOML: {match[1]}, column {match[3]}") from None
        raise ReadingError(f"{path}: not TOML: {error}") from None
    except RecursionError:
        raise ReadingError(f"{path}: not TOML: lists or tables too deep inside each other") from None
    except ValueError as error:  # a whole number of thousands of digits
        raise ReadingError(f"{path}: not TOML: {str(error).partition(';')[0]}") from None
