"""TOML of robots and boards, field by field: what is wrong is told with file, line and field. Standard library only."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from terrapin_interface.quantity import LONGEST, QuantityError, parse_quantity

__all__ = ["RobotError", "RobotTable"]

MOST = 1_000_000  # characters of a file
ALIKE = 0.85  # of difflib: so much alike is a misspelt field; body.radius and body.drive_radius are less
_HEADER = re.compile(r"\s*\[([A-Za-z0-9_. -]+)\]\s*(?:#.*)?$")
_KEY = re.compile(r"\s*([A-Za-z0-9_.-]+)\s*=")


class RobotError(ValueError):
    """The file of a robot or a board is wrong; one line that says where, what was found and what was expected."""


def _lines(text: str) -> dict[str, int]:
    """Line of each table and field, by its dotted name."""
    found: dict[str, int] = {}
    table = ""
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            table = header[1].replace(" ", "")
            found.setdefault(table, number)
        elif key := _KEY.match(line):
            found.setdefault(f"{table}.{key[1]}" if table else key[1], number)
    return found


def _flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{before}{key}.")
        else:
            flat[before + key] = value
    return flat


class RobotTable:
    """The fields of one file by their dotted names. Whatever nobody reads is refused by `done`."""

    def __init__(self, text: str, file: str) -> None:
        """RobotError when `text` is no TOML. `file` is how messages name it."""
        self.text, self.file = text, file
        try:
            self.values = _flat(tomllib.loads(text))
        except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
            raise RobotError(f"{file}: not TOML: {str(error).partition(chr(10))[0]}") from None
        self._lines = _lines(text)
        self._read: set[str] = set()

    @classmethod
    def load(cls, path: Path) -> RobotTable:
        """The table of a file. RobotError when it cannot be read."""
        try:
            with path.open(encoding="utf-8-sig") as file:
                text = file.read(MOST + 1)
        except UnicodeDecodeError:
            raise RobotError(f"{path}: not a text file in UTF-8") from None
        except OSError as error:
            raise RobotError(f"{path}: {error.strerror}, expected a readable file") from None
        if len(text) > MOST:
            raise RobotError(f"{path}: found more than {MOST} characters, expected a file of TOML")
        return cls(text, str(path))

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def place(self, key: str) -> str:
        """A field with its line, where it has one: `limits.current (line 42)`."""
        return f"{key} (line {self._lines[key]})" if key in self._lines else key

    def error(self, key: str, message: str) -> RobotError:
        """The error to raise about `key`; `message` reads "found ..., expected ..."."""
        line = self._lines.get(key, self._lines.get(key.rpartition(".")[0]))
        return RobotError(f"{self.file}:{line}: {key}: {message}" if line else f"{self.file}: {key}: {message}")

    def contradiction(self, key: str, found: str, expected: str, *others: str) -> RobotError:
        """Two values that cannot both be: the error names the places of both."""
        return self.error(key, f"found {found}, expected {expected}, which follows from {', '.join(others)}")

    def _take(self, key: str, default: Any) -> Any:
        self._read.add(key)
        if key in self.values:
            return self.values[key]
        if default is None:
            near = get_close_matches(key, set(self.values) - self._read, n=1, cutoff=ALIKE)
            meant = f"; is {self.place(near[0])} meant to be it?" if near else ""
            raise self.error(key, "is missing" + meant)
        return default

    def number(
        self, key: str, unit: str, low: float, high: float, default: float | None = None, *, above: bool = False
    ) -> float:
        """A quantity in `unit` from `low` (`above`: more than that) to `high`."""
        value = self._take(key, default)
        try:
            number = parse_quantity(value, unit)
        except QuantityError as error:
            raise self.error(key, str(error)) from None
        if not (low < number if above else low <= number) or not number <= high:
            shown = "" if unit == "1" else f" {unit}"
            least = f"more than {low:g}, at most" if above else f"{low:g} to"
            raise self.error(key, f"found {value!r}, expected {least} {high:g}{shown}")
        return number

    def whole(self, key: str, low: int, high: int, default: int | None = None) -> int:
        value = self._take(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.error(key, f"found {_short(value)}, expected a whole number from {low} to {high}")
        return value

    def flag(self, key: str, default: bool | None = None) -> bool:
        value = self._take(key, default)
        if not isinstance(value, bool):
            raise self.error(key, f"found {_short(value)}, expected true or false")
        return value

    def word(self, key: str, default: str | None = None) -> str:
        value = self._take(key, default)
        if not isinstance(value, str) or len(value) > 200 or "\n" in value:
            raise self.error(key, f"found {_short(value)}, expected a text of one line")
        return value

    def choice(self, key: str, allowed: Iterable[str], default: str | None = None) -> str:
        names = list(allowed)
        value = self._take(key, default)
        if value not in names:
            raise self.error(key, f"found {_short(value)}, expected one of {', '.join(names)}")
        return str(value)

    def words(self, key: str, allowed: Iterable[str]) -> tuple[str, ...]:
        names = list(allowed)
        value = self._take(key, None)
        if not isinstance(value, list) or not value or any(word not in names for word in value):
            raise self.error(key, f"found {_short(value)}, expected a list of some of {', '.join(names)}")
        return tuple(map(str, value))

    def below(self, table: str) -> dict[str, Any]:
        """The fields of a table whose names the caller checks."""
        found = {key: value for key, value in self.values.items() if key.startswith(f"{table}.")}
        self._read |= set(found)
        return {key.removeprefix(f"{table}."): value for key, value in found.items()}

    def done(self) -> None:
        """Refuses the first field that was not read."""
        for key in self.values:
            if key not in self._read:
                raise self.error(key, f"no such field; known: {', '.join(sorted(self._read))}")


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= LONGEST else text[:LONGEST] + "..."
