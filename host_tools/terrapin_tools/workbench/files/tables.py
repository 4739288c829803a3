"""Measurements from files: tables of any kind (formats/), and bus logs with a DBC, as columns with their place.

A table keeps for each row where it stands, so that a complaint about a value names the file and the line.
"""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from terrapin_hil.reading import shorten
from terrapin_tools.bounded import refuse_beyond, refuse_columns
from terrapin_tools.errors import UserError, printable
from terrapin_tools.extras import need
from terrapin_tools.logs.reading import is_log
from terrapin_tools.workbench.files.format import Ambiguous, Asked, Column, Part, cells, meant, named
from terrapin_tools.workbench.files.formats import PACKED, SUFFIXES, format_of
from terrapin_tools.workbench.files.number_marks import GAPS
from terrapin_tools.workbench.files.packed import unpacked
from terrapin_tools.workbench.files.split_runs import split
from terrapin_tools.workbench.files.times import switched, timed
from terrapin_tools.workbench.files.units import LARGEST

__all__ = ["LOG_SUFFIXES", "Table", "read"]

LOG_SUFFIXES = (".log", ".blf", ".asc", ".trc", ".mf4", ".mcap")  # what else may be a log: logs.reading.is_log
PLAIN = Asked()
Pieces = tuple[tuple[int, str, int], ...]


@dataclass(frozen=True)
class Table:
    """One file's rows. `columns` all have the same length; `first_line` is the line of row 0 (0: rows are counted)."""

    path: Path
    columns: dict[str, Column]
    first_line: int
    notes: tuple[str, ...] = ()  # what was assumed about the file, in words
    pieces: Pieces = ()  # where its parts begin: row, part, line of its first row

    @property
    def rows(self) -> int:
        return len(next(iter(self.columns.values()))) if self.columns else 0

    def place(self, row: int) -> str:
        """Where a row stands, for a message."""
        if self.pieces:
            begin, part, first = next(piece for piece in reversed(self.pieces) if piece[0] <= row)
            return f"{self.path.name}: {part}: row {row - begin + (first or 1)}"
        return f"{self.path.name}:{row + self.first_line}" if self.first_line else f"{self.path.name}: row {row + 1}"

    def called(self, names: Iterable[str]) -> Table:
        """The table with each column that one of `names` means (format.meant) under that name."""
        said = {}
        for name in names:
            found = meant(name, self.columns)
            if found is not None and found != name:
                said[found] = name
        return replace(self, columns={said.get(n, n): column for n, column in self.columns.items()}) if said else self

    def numbers(self, name: str, gaps: bool = False) -> npt.NDArray[np.float64]:
        """A column as finite numbers; with `gaps` an empty cell or NaN is NaN. UserError with file, line and field."""
        column = self.columns[name]
        if column.dtype.kind in "fiub":
            values = column.astype(np.float64)
        else:
            texts = [str(cell) for cell in column.tolist()]
            if gaps:
                texts = ["nan" if text.strip().lower() in GAPS else text for text in texts]
            wrong = next((row for row, text in enumerate(texts) if not _is_number(text)), None)
            if wrong is not None:
                text = texts[wrong]
                found = f"text {shorten(text)}" if text.strip() else "an empty cell"
                point = " with a decimal point" if "," in text else ""
                raise UserError(f"{self.place(wrong)}: column {name}: found {found}, expected a number{point}")
            # Not by NumPy's astype: a Ctrl-C that comes while it reads text is lost.
            values = np.array([float(text) for text in texts])
        bad = np.flatnonzero(~((np.abs(values) <= LARGEST) | (gaps & np.isnan(values))))
        if bad.size:
            row = int(bad[0])
            found = "NaN" if np.isnan(values[row]) else "infinity" if np.isinf(values[row]) else f"{values[row]:g}"
            raise UserError(
                f"{self.place(row)}: column {name}: found {found}, expected a finite number below {LARGEST:g}"
            )
        return values

    def text(self, name: str) -> list[str]:
        """A column as text; whole numbers without a decimal point, so that run 3.0 of a Parquet file is "3"."""
        column = self.columns[name]
        if column.dtype.kind == "f":
            return ["" if np.isnan(v) else str(int(v)) if float(v).is_integer() else str(v) for v in column]
        return [str(v).strip() for v in column.tolist()]


def _is_number(spelling: str) -> bool:
    """As people write numbers in tables: Python's 1_000 and digits of other scripts are text."""
    try:
        float(spelling)
    except ValueError:
        return False
    return spelling.isascii() and "_" not in spelling


def read(
    path: Path,
    dbc: Path | None = None,
    period: float | None = None,
    needed: Collection[str] = (),
    texts: Collection[str] = (),
    asked: Asked = PLAIN,
) -> Table:
    """The rows of one file, read by its suffix.

    Parameters
    ----------
    dbc, period : a log needs both; rows are `period` [s] apart, columns are MESSAGE.SIGNAL and `time` [s].
    needed : signals of a log; the first row is the first in which all of them have come.
    texts : columns that stay text.
    asked : what the user said of tables.

    Raises
    ------
    UserError : names the file, and the line or row, and what was expected. Ambiguous where `asked` would settle it.
    """
    try:
        if path.is_dir() and format_of(path) is None:
            raise UserError(f"{path}: is a folder, expected a file")
        if not path.exists() or not (path.is_file() or path.is_dir()):
            raise UserError(f"{path}: no such file")
        if is_log(path):
            if dbc is None or period is None:
                raise UserError(f"{path.name}: a log needs data.dbc and data.period in case.toml")
            return _read_log(path, dbc, period, needed)
        return _read_table(path, texts, asked)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror or error}, expected a readable file") from None


def _read_table(path: Path, texts: Collection[str], asked: Asked) -> Table:
    """The parts that were asked for as one table, with units in the names, times in seconds and runs told apart."""
    before = path.stat()
    part, kind, pieces = _joined(path, _parts(path, texts, asked), asked)
    now = path.stat()
    if (now.st_size, now.st_mtime_ns) != (before.st_size, before.st_mtime_ns):
        raise UserError(f"{path.name}: changed while it was read, expected a file that is finished")
    raw = Table(path, part.columns, part.first_line, pieces=pieces)
    notes = [kind] if kind else []
    columns = {}
    for name, column in part.columns.items():
        spelt, odd = named(name, part.units.get(name, ""))
        columns[spelt if spelt not in columns else name] = column
        notes += [odd] if odd else []
    columns, times = timed(columns, asked, texts, raw.place)
    columns, switches = switched(columns, texts)
    columns, runs = split(columns, asked, path.stem)
    found = tuple(dict.fromkeys([*part.notes, *notes, *times, *switches, *runs]))
    return Table(path, columns, part.first_line, found, pieces)


def _parts(path: Path, texts: Collection[str], asked: Asked) -> list[Part]:
    """What a file holds, unpacked where it is packed."""
    if path.suffix.lower() in PACKED:
        inner = tuple(suffix for suffix in SUFFIXES if suffix not in PACKED)
        with _complaints(path, "a packed file"), unpacked(path, inner) as files:
            found = []
            several = len(files) > 1
            for file in files:
                if several and asked.part not in ("", "*", file.stem, file.name):
                    continue
                parts = _parts(file, texts, replace(asked, part="") if several else asked)
                part, kind, _ = _joined(file, parts, PLAIN)
                found.append(replace(part, name=file.stem, notes=(*part.notes, kind) if kind else part.notes))
            return found
    entry = format_of(path)
    if entry is None:
        expected = " ".join([*SUFFIXES, *LOG_SUFFIXES])
        raise UserError(f"{path.name}: unknown kind of file {path.suffix.lower()!r}, expected {expected}")
    if entry.package:
        need(f"{path.name}: {path.suffix}", entry.package, entry.extra)
    with _complaints(path, entry.name):
        found = entry.read(path, asked, texts)
        refuse_columns(path, max((len(part.columns) for part in found), default=0))
        refuse_beyond(path, 8 * sum(part.rows * len(part.columns) for part in found))
        return found


@contextlib.contextmanager
def _complaints(path: Path, kind: str) -> Iterator[None]:
    """Whatever a library says of a broken file, as one line."""
    try:
        yield
    except UserError:
        raise
    except OSError as error:
        if error.strerror and error.errno in (errno.EACCES, errno.EIO, errno.ENOENT, errno.ENOSPC, errno.EISDIR):
            raise
        raise UserError(_complaint(path, error, kind)) from None
    except MemoryError:
        raise UserError(f"{path.name}: does not fit into the memory, expected {kind} of a smaller size") from None
    except Exception as error:  # of many libraries, each with its own
        raise UserError(_complaint(path, error, kind)) from None
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # of a library in Rust
            raise
        raise UserError(_complaint(path, error, kind)) from None


def _complaint(path: Path, error: BaseException, kind: str) -> str:
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return f"{path.name}: {printable(lines[0].rstrip('.'))[:200]}, expected {kind}"


def _joined(path: Path, parts: list[Part], asked: Asked) -> tuple[Part, str, Pieces]:
    """The part that was asked for, or all that have the same columns, each a run; what was assumed; where they are."""
    entry = format_of(path)
    word = entry.part if entry is not None else "file"
    there = [part for part in parts if part.columns]
    if not there:
        raise UserError(f"{path.name}: holds no table: found no column of values, expected at least one")
    if asked.part not in ("", "*"):
        chosen = [part for part in there if part.name == asked.part]
        if not chosen and len(there) > 1:
            expected = ", ".join(shorten(part.name) for part in there[:20])
            raise UserError(f"{path.name}: {word}: found {shorten(asked.part)}, expected one of {expected}")
        there = chosen or there
    alike = all(list(part.columns) == list(there[0].columns) for part in there)
    if len(there) > 1 and asked.part != "*" and not alike:
        counted = [part for part in there if _has_numbers(part)]
        if len(counted) > 1:
            choices = [part.name or "*" for part in counted]
            what = f"{path.name}: holds {len(counted)} {word}s with other columns each"
            raise Ambiguous(f"{what} ({', '.join(map(shorten, choices[:5]))})", word, choices)
        others = ", ".join(shorten(part.name) for part in there if part not in counted)
        there = counted or there[:1]
        return there[0], f"{word} {shorten(there[0].name)} (not {others})", ()
    if len(there) == 1:
        return there[0], f"{word} {there[0].name}" if there[0].name and len(parts) > 1 else "", ()
    names = [name for name in there[0].columns if all(name in part.columns for part in there)]
    if not names:
        raise UserError(f"{path.name}: its {word}s have no column in common, expected tables of one kind")
    label = "run" if "run" not in map(str.lower, names) else word
    runs = [f"{path.stem} {part.name}".strip() for part in there]
    columns: dict[str, Column] = {label: np.repeat(np.array(runs, dtype=str), [part.rows for part in there])}
    for name in names:
        column = [part.columns[name] for part in there]
        text = any(one.dtype.kind == "U" for one in column)
        columns[name] = np.concatenate(
            [cells(one.tolist()) if text and one.dtype.kind != "U" else one for one in column]
        )
    starts = np.cumsum([0, *(part.rows for part in there[:-1])]).tolist()
    pieces = tuple((start, part.name, part.first_line) for start, part in zip(starts, there, strict=True))
    notes = tuple(dict.fromkeys(note for part in there for note in part.notes))
    told = f"{len(there)} {word}s of the same columns, each a run by its name in column {label!r}"
    return Part("", columns, there[0].units, 0, notes), told, pieces


def _has_numbers(part: Part) -> bool:
    return any(
        column.dtype.kind == "f" or any(map(_is_number, column[:100].tolist())) for column in part.columns.values()
    )


def _read_log(path: Path, dbc: Path, period: float, needed: Collection[str]) -> Table:
    from terrapin_tools.logs.decoding import Decoder
    from terrapin_tools.logs.resample import signals_on_grid

    if not dbc.is_file():
        raise UserError(f"{dbc}: no such file (data.dbc)")
    notes: list[str] = []
    columns = dict(signals_on_grid(path, Decoder(dbc), period, needed, notes))
    return Table(path, columns, 0, tuple(notes))
