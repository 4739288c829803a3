"""case.toml as tables: what is asked of them, and complaints that name file, line and field.

Anything wrong is a UserError of one line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.reading import locate, parse_toml, shorten
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.units import check, quantity

__all__ = ["Complaint", "Estimate", "Tables", "case_tables", "read_case_text", "read_estimate"]

Complaint = Callable[..., UserError]


@dataclass(frozen=True)
class Estimate:
    """A parameter to be fitted: start value and bounds, in `unit`."""

    name: str
    value: float
    minimum: float
    maximum: float
    unit: str


def read_case_text(folder: Path) -> str:
    """The text of case.toml, its line ends as they are. UserError when it cannot be read."""
    file = folder / "case.toml"
    try:
        with file.open(encoding="utf-8-sig", newline="") as opened:
            return opened.read()
    except NotADirectoryError:
        raise UserError(f"{folder}: is a file, expected a case's folder; `terrapin case table` makes one") from None
    except FileNotFoundError:
        raise UserError(f"{file}: no such file, expected a case folder with a case.toml, or a folder of such") from None
    except (UnicodeDecodeError, IsADirectoryError):
        raise UserError(f"{file}: found something that is not UTF-8 text, expected TOML") from None
    except OSError as error:
        raise UserError(f"{file}: {error.strerror}, expected a readable file") from None


class Tables:
    """A TOML document that says where in the file a wrong value stands."""

    def __init__(self, document: dict[str, Any], complain: Complaint) -> None:
        self.document = document
        self.complain = complain

    @contextmanager
    def about(self, *path: str) -> Iterator[None]:
        """A ValueError from inside becomes a complaint about that place."""
        try:
            yield
        except ValueError as error:
            raise self.complain(str(error), *path) from None

    def get(self, *path: str, default: Any = None) -> Any:
        value: Any = self.document
        for depth, key in enumerate(path):
            if not isinstance(value, dict):
                raise self.complain(f"found {shorten(value)}, expected a table", *path[:depth])
            if key not in value:
                return default
            value = value[key]
        return value

    def table(self, *path: str) -> dict[str, Any]:
        value = self.get(*path, default={})
        if not isinstance(value, dict):
            raise self.complain(f"found {shorten(value)}, expected a table", *path)
        return value

    def entry(self, path: tuple[str, ...], *names: str, also: tuple[str, ...] = ()) -> None:
        """Complains unless a table of these names stands at `path`; a complaint does not speak of those of `also`."""
        value = self.get(*path)
        if not isinstance(value, dict):
            raise self.complain(f"found {value!r}, expected {{ {' , '.join(f'{name} =' for name in names)} }}", *path)
        self.allow(path, *names, *also)

    def allow(self, path: tuple[str, ...], *names: str) -> None:
        for name in self.table(*path) if path else self.document:
            if name not in names:
                raise self.complain(f"unknown name, expected one of {', '.join(names)}", *path, name)

    def text(self, *path: str, default: str | None = None) -> str:
        value = self.get(*path, default=default)
        if value is None:
            raise self.complain("missing, expected text", *path)
        if not isinstance(value, str):
            raise self.complain(f"found {shorten(value)}, expected text", *path)
        return value

    def texts(self, *path: str, default: list[str] | None = None) -> list[str]:
        value = self.get(*path, default=default)
        if value is None:
            raise self.complain("missing, expected a list of names", *path)
        if not isinstance(value, list) or any(isinstance(v, bool) or not isinstance(v, (str, int)) for v in value):
            raise self.complain(f"found {shorten(value)}, expected a list of names", *path)
        names = [str(v) for v in value]
        for name in names:
            if names.count(name) > 1:
                raise self.complain(f"found {name!r} twice, expected it once", *path)
        return names

    def truth(self, *path: str) -> float:
        """1.0 for true, 0.0 for false, however they are written."""
        value = self.get(*path)
        if str(value).lower() not in ("true", "false"):
            raise self.complain(f"found {value!r}, expected true or false", *path)
        return float(str(value).lower() == "true")

    def unit(self, *path: str, default: str | None = None) -> str:
        """A unit that is known."""
        unit = self.text(*path, default=default)
        with self.about(*path):
            check(unit)
        return unit

    def number(self, unit: str, *path: str) -> float:
        with self.about(*path):
            return quantity(self.get(*path), unit)

    def files(self) -> list[str]:
        """The names in data.files, one at least."""
        names = self.texts("data", "files")
        if not names:
            raise self.complain("found an empty list, expected file names", "data", "files")
        return names


def case_tables(folder: Path, text: str) -> Tables:
    """`text` as the tables of a folder's case.toml. UserError with file and line when it is no TOML."""
    file = folder / "case.toml"

    def complain(message: str, *path: str) -> UserError:
        return UserError(f"{file}:{locate(text, path) or 1}: {'.'.join(path)}: {message}")

    return Tables(parse_toml(text, file), complain)


def read_estimate(tables: Tables, path: tuple[str, ...], unit: str, standard: Estimate | None = None) -> Estimate:
    """{ value, min, max } at `path`, in `unit`; what is missing comes from `standard`."""
    limits = {"value": None, "min": -np.inf, "max": np.inf}
    if standard is not None:
        limits = {"value": standard.value, "min": standard.minimum, "max": standard.maximum}
    numbers = {}
    for key, default in limits.items():
        if tables.get(*path, key) is None:
            if default is None:
                raise tables.complain("missing, expected a start value", *path, key)
            numbers[key] = float(default)
        else:
            numbers[key] = tables.number(unit, *path, key)
    value, low, high = numbers["value"], numbers["min"], numbers["max"]
    if low >= high:
        raise tables.complain(f"found min {low:g} and max {high:g}, expected min below max", *path)
    if tables.get(*path, "value") is None:
        value = min(max(value, low), high)
    if not low <= value <= high:
        raise tables.complain(f"found value {value:g}, expected between min {low:g} and max {high:g}", *path)
    return Estimate(path[-1], value, low, high, unit)
