"""How a CSV file is laid out: encoding, delimiter, lines above the names, a row of units, marks of numbers.

Everything here is found in the file and told as an assumption (`Layout.notes`); what is plain has none.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from terrapin_hil.reading import shorten
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files import units
from terrapin_tools.workbench.files.format import Asked
from terrapin_tools.workbench.files.number_marks import GAPS, is_marked, is_number
from terrapin_tools.workbench.files.times import is_clock_format, is_time

__all__ = [
    "Layout",
    "are_units",
    "called",
    "distinct",
    "find_layout",
    "with_unit",
]

TOP = 1 << 18  # bytes at the beginning in which names and rows are looked for
MAX_TOP = 1000  # lines above the names
SOME = 20  # rows at the end by which columns of numbers are told
BODY = 3  # rows of equal length, names among them, that make a table below other lines
PLAIN = Asked()
DELIMITERS = ",;\t|"
_SEP_LINE = re.compile(r'"?sep=(.)"?,*;*\s*')


@dataclass(frozen=True)
class Layout:
    """What `find_layout` found. `first` is the line of the first row of numbers, from 1."""

    encoding: str
    delimiter: str
    names: tuple[str, ...]
    first: int
    notes: tuple[str, ...]


def find_layout(path: Path, asked: Asked = PLAIN) -> Layout:
    """The layout of a file, as far as `asked` (encoding, separator, names, units) leaves it open.

    Raises
    ------
    UserError : there is no line of names, or a byte that no encoding has.
    csv.Error : a quote that does not end.
    """
    with path.open("rb") as file:
        top = file.read(TOP + 1)
    encoding, told = (_known(asked.encoding), []) if asked.encoding else _encoding(path, top)
    if len(top) > TOP:
        top = top[: max(top.rfind(b"\n"), top.rfind(b"\r")) + 1] or top  # whole lines
    text = top.decode(encoding, errors="ignore")
    lines = re.split(r"\r\n|\n|\r", text)
    while lines and not lines[-1]:
        lines.pop()
    number = 0
    separator = _SEP_LINE.fullmatch(lines[0]) if lines else None
    given = {"tab": "\t", "comma": ",", "semicolon": ";", "bar": "|"}.get(asked.separator, asked.separator)
    if len(given) > 1 or given in ('"', "\n", "\r"):
        raise UserError(f"separator: found {shorten(given)}, expected one character, or tab, comma, semicolon, bar")
    if separator:
        number = 1
        told.append(f"separator {called(separator[1])} by its first line")
    while number < min(len(lines), MAX_TOP) and lines[number].startswith("#"):
        number += 1
    if number >= len(lines):
        raise UserError(f"{path.name}:{number + 1}: found nothing, expected a line of column names")
    if len(lines[number]) > csv.field_size_limit():
        long = len(lines[number])
        raise UserError(f"{path.name}:{number + 1}: a line of {long} characters, expected a line of column names")
    if asked.names:
        number = int(asked.names) - 1
        if not 0 <= number < len(lines):
            raise UserError(f"{path.name}: names: found {asked.names}, expected one of its first {len(lines)} lines")
    delimiter = given or (separator[1] if separator else "")
    delimiter = delimiter or next((mark for mark in DELIMITERS if mark in lines[number]), ",")
    if not asked.names:
        begin = number
        if not _is_table(lines[number:], delimiter):
            number, delimiter = _below_others(lines, number, given or DELIMITERS, delimiter)
        above, hint = _above_names(lines[number:], delimiter, number, asked.units)
        number += above
        if number > begin:
            told.append(f"{number - begin} line{'s' * (number - begin > 1)} above the names")
        if hint:
            told.append(hint)
    names = [name.strip() for name in next(csv.reader([lines[number]], delimiter=delimiter), [])]
    _check(path, names, number + 1)
    row = next(csv.reader([lines[number + 1]], delimiter=delimiter), []) if number + 1 < len(lines) else []
    below = next(csv.reader([lines[number + 2]], delimiter=delimiter), []) if number + 2 < len(lines) else []
    number += 1
    if asked.units and asked.units not in ("0", str(number + 1)):
        raise UserError(
            f"{path.name}: units: found {asked.units}, expected {number + 1}, below the names, or 0 for none"
        )
    if asked.units != "0" and (asked.units or are_units(row, below, len(names))):
        told.append(f"units from line {number + 1}")
        place = f"{path.name}:{number + 1}"
        names = [with_unit(name, unit, place) for name, unit in zip(names, row, strict=False)]
        number += 1
    names, twice = distinct(names)
    if twice:
        told.append(f"{shorten(twice)} stands more than once, so its columns are numbered")
    if told and delimiter != ",":
        told.insert(0, f"separator {called(delimiter)}")
    return Layout(encoding, delimiter, tuple(names), number + 1, tuple(told))


def _known(encoding: str) -> str:
    """UserError for an encoding that Python does not have."""
    try:
        if codecs.lookup(encoding)._is_text_encoding:
            return "utf-8-sig" if codecs.lookup(encoding).name == "utf-8" else encoding
    except (LookupError, ValueError):
        pass
    raise UserError(f"encoding: found {shorten(encoding)}, expected utf-8, utf-16, cp1252, latin-1 or the like")


def _encoding(path: Path, top: bytes) -> tuple[str, list[str]]:
    if top[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16", ["UTF-16"]
    try:
        path.read_text(encoding="utf-8-sig")
        return "utf-8-sig", []
    except UnicodeDecodeError as error:
        at = error.start
    try:
        text = path.read_bytes().decode("cp1252")
    except UnicodeDecodeError:
        text = "\0"
    if any(ord(c) < 32 and c not in "\t\r\n\f" for c in text):
        raise UserError(f"{path.name}: byte {at} is not UTF-8 text, expected a CSV file of text") from None
    return "cp1252", ["Windows-1252, as it is not UTF-8"]


def called(mark: str) -> str:
    return {"\t": "tab", ",": "comma", ";": "semicolon"}.get(mark, mark)


def _counts(lines: Sequence[str], delimiter: str) -> list[int]:
    return [len(next(csv.reader([line], delimiter=delimiter), [])) for line in lines]


def _is_table(lines: Sequence[str], delimiter: str) -> bool:
    """Whether most lines have as many fields as the first, or one more, where they end with a delimiter."""
    filled = [line for line in lines if line]
    counts = _counts(filled, delimiter)
    ends = [count - line.endswith(delimiter) for count, line in zip(counts, filled, strict=True)]
    alike = sum(counts[0] in (count, end) for count, end in zip(counts, ends, strict=True))
    return 2 * alike > len(counts) and (counts[0] > 1 or len(lines) < BODY)


def _below_others(lines: Sequence[str], begin: int, delimiters: str, tried: str) -> tuple[int, str]:
    """The line of names and the delimiter of a table that stands below lines of something else, or has another
    delimiter than the one that was `tried`; `begin` and that one where there is none."""
    best: tuple[int, int, int, str] | None = None
    for delimiter in delimiters:
        if delimiter == "," and any(2 * sum(mark in line for line in lines) > len(lines) for mark in ";\t|"):
            continue  # these commas are decimal ones
        plain = _counts(lines, delimiter)
        ended = [count - (line.endswith(delimiter) and count > 1) for count, line in zip(plain, lines, strict=True)]
        for counts in (plain, ended):
            width, _ = Counter(count for count in counts if count > 1).most_common(1)[0] if max(counts) > 1 else (0, 0)
            at = next((i for i in range(begin, len(lines)) if counts[i] == width), len(lines))
            rest = counts[at:]
            alike = rest.count(width)
            if (at == begin and delimiter == tried) or alike < BODY or 2 * alike <= len(rest):
                continue
            at += _above_names(lines[at:], delimiter)[0]
            names = [cell.strip() for cell in next(csv.reader([lines[at]], delimiter=delimiter))]
            sound = not any(is_number(name) for name in names) and sum(map(bool, names)) >= 2
            if sound and (best is None or (alike, width) > best[:2]):
                best = (alike, width, at, delimiter)
    return (best[2], best[3]) if best else (begin, tried)


class _Top:
    """Lines of a table as cells; `counted` are its columns of numbers, by its last rows."""

    def __init__(self, lines: Sequence[str], delimiter: str) -> None:
        self.lines, self.delimiter = lines, delimiter
        self.known: dict[int, list[str]] = {}
        last = [self.row(i) for i in range(max(len(lines) - SOME, len(lines) // 2), len(lines))]
        self.width = max(map(len, last), default=0)
        self.counted = [c for c in range(self.width) if sum(_kind(cells, c) for cells in last) > 0]

    def row(self, i: int) -> list[str]:
        if i not in self.known:
            self.known[i] = next(csv.reader([self.lines[i]], delimiter=self.delimiter), [])
        return self.known[i]

    def kinds(self, i: int) -> list[int]:
        return [_kind(self.row(i), c) for c in self.counted]

    def counts(self, i: int) -> bool:
        """Whether a line holds more numbers than words in the columns of numbers."""
        return sum(self.kinds(i)) > 0

    def names(self, i: int) -> bool:
        """Whether a line has a word for each of them."""
        return all(kind < 0 for kind in self.kinds(i))

    def filled_up(self, i: int) -> bool:
        """Whether a line ends in empty cells, and has none before."""
        cells = [bool(cell.strip()) for cell in self.row(i)]
        there = max((at + 1 for at, cell in enumerate(cells) if cell), default=0)
        return 0 < there <= self.counted[-1] and all(cells[:there])

    def first(self) -> int:
        """The line in which the numbers begin, 0 where they do not."""
        count = len(self.lines)
        for i in range(1, min(count, MAX_TOP)):
            if all(self.counts(j) for j in range(i, min(i + BODY, count))):
                while i > 1 and not any(_kind(self.row(i - 1), c) for c in range(self.width)):
                    i -= 1  # a row of gaps
                return i
        return 0


def _above_names(lines: Sequence[str], delimiter: str, offset: int = 0, units: str = "") -> tuple[int, str]:
    """How many lines as wide as the table stand above its names, and what to say where they may but need not.

    Numbers begin below the names, or below the units of these. What is above them is no row of names where it ends in
    empty cells above columns of numbers, as a logger's lines do that are filled up with delimiters; or where units
    show the names and a line above these names less. `offset`: of the first line, for what is said; units: `Asked`'s.
    """
    top = _Top(lines, delimiter)
    if not top.counted or (top.names(0) and all(top.counts(i) for i in range(1, min(BODY, len(lines))))):
        return 0, ""
    first = top.first()
    own = first > 1 and units != "0" and are_units(top.row(first - 1), top.row(first), len(top.row(first - 2)))
    at = first - 1 - own
    if at < 1:
        return 0, ""
    above = range(at)
    sure = any(map(top.filled_up, above)) and not top.names(at - 1)  # of two lines of words one may be units in words
    if top.names(at) and (sure or (own and not all(map(top.names, above)))):
        return at, ""
    if not own and top.names(first - 2) and max(top.kinds(first - 1)) < 1:
        at, own = first - 2, True
    if not top.names(at):
        return 0, ""
    said, has = f"--read names={offset + at + 1}", "names"
    if own:
        said, has = f"{said} --read units={offset + at + 2}", f"names and line {offset + at + 2} units"
    begins = f"text above the numbers, which begin in line {offset + first + 1}"
    return 0, f"{begins}: if line {offset + at + 1} holds the {has}, say {said}"


def _kind(cells: Sequence[str], column: int) -> int:
    """1 for a number or a time, -1 for a word, 0 for a gap."""
    cell = cells[column].strip() if column < len(cells) else ""
    if cell.lower() in GAPS:
        return 0
    return 1 if is_number(cell) or is_marked(cell) or is_time(cell) else -1


def _check(path: Path, names: Sequence[str], line: int) -> None:
    if not any(names):
        raise UserError(f"{path.name}:{line}: found nothing, expected a line of column names")
    if any("\0" in name for name in names):
        raise UserError(f"{path.name}:{line}: found a byte 0, expected text")
    if all(is_number(name) for name in names if name):
        raise UserError(f"{path.name}:{line}: found numbers only, expected a line of column names")


def _unit(cell: str) -> str:
    """A cell of a row of units, in pint's spelling."""
    return units.spelling(cell.strip().strip("[]()"))


def are_units(row: Sequence[str], below: Sequence[str], count: int) -> bool:
    """Whether a row is the units of the columns above it: words that pint reads, above numbers."""
    row, below = (cells[:-1] if len(cells) == count + 1 and not cells[-1] else cells for cells in (row, below))
    given = [i for i, cell in enumerate(row) if cell.strip()]
    if len(row) != count or not given or any(is_number(row[i]) for i in given):
        return False
    formats = [i for i in given if is_clock_format(row[i].strip().strip("[]()"))]
    if len(below) != count or not any(is_time(below[i]) if i in formats else is_marked(below[i]) for i in given):
        return False
    for i in given:
        if i in formats:
            continue
        try:
            units.check(_unit(row[i]))
        except ValueError:
            return False
    return True


def with_unit(name: str, cell: str, place: str) -> str:
    """A name with the unit below it. UserError, which begins with `place`, where the name has another one already."""
    if is_clock_format(cell.strip().strip("[]()")):
        return name
    own = re.search(r"[\[(]([^\])]*)[\])]\s*$", name)
    if own and cell.strip():
        if _unit(own[1]) != _unit(cell):
            raise UserError(
                f"{place}: column {shorten(name)}: found the unit {shorten(cell)}, expected that of its name"
            )
        return name
    return f"{name} [{_unit(cell)}]" if cell.strip() else name


def distinct(names: Iterable[str]) -> tuple[list[str], str]:
    """Names of which none stands twice: `torque [N m]`, `torque 2 [N m]`; and one that did ("" for none)."""
    found: list[str] = []
    twice = ""
    for name in names:
        if name and name in found:
            twice = name
            plain, bracket, unit = name.partition(" [")
            number = 2
            while f"{plain} {number}{bracket}{unit}" in found:
                number += 1
            name = f"{plain} {number}{bracket}{unit}"
        found.append(name)
    return found, twice
