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
from terrapin_tools.workbench.files.format import Ambiguous, Asked

__all__ = [
    "GAPS",
    "Layout",
    "are_units",
    "called",
    "distinct",
    "find_layout",
    "is_number",
    "plain_numbers",
    "with_unit",
]

GAPS = ("", "nan", "na", "n/a", "#n/a", "#na", "null", "none", "-", "--", "---", "inf", "-inf", "+inf", "#div/0!")
TOP = 1 << 18  # bytes at the beginning in which names and rows are looked for
MAX_TOP = 1000  # lines above the names
FEW = 0.05  # share of a column's numbers that are odd if they alone show no decimals
LEAP = 10.0  # times the largest of them
BODY = 3  # rows of equal length, names among them, that make a table below other lines
PLAIN = Asked()
Place = tuple[int, str, str]
DELIMITERS = ",;\t|"
_SEP_LINE = re.compile(r'"?sep=(.)"?,*;*\s*')
_NUMBER = re.compile(r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eEdD][-+]?\d+)?")
# A number with any marks: digits in groups, an exponent as Fortran writes it too.
_MARKED = re.compile(r"([-+]?)(\d[\d.,' \u00a0\u2009\u202f]*|[.,]\d+)(?:[eEdD]([-+]?\d+))?")
_GROUPS = re.compile(r"\d{1,3}(?:\.\d{3})+|\d{1,3}(?:,\d{3})+")  # of thousands
_SPACES = re.compile(r"(?<=\d)['\u00a0\u2009\u202f ](?=\d{3}(?!\d))")


@dataclass(frozen=True)
class Layout:
    """What `find_layout` found. `first` is the line of the first row of numbers, from 1."""

    encoding: str
    delimiter: str
    names: tuple[str, ...]
    first: int
    notes: tuple[str, ...]


def is_number(text: str) -> bool:
    """Whether a cell is written as a number, with a point or a comma."""
    return _NUMBER.fullmatch(text.strip()) is not None


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
    if not asked.names and not _is_table(lines[number:], delimiter):
        found = _below_others(lines, number, given or DELIMITERS)
        if found:
            above, delimiter = found
            told.append(f"{above - number} lines above the names")
            number = above
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


def _below_others(lines: Sequence[str], begin: int, delimiters: str) -> tuple[int, str] | None:
    """The line of names and the delimiter of a table that stands below lines of something else."""
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
            if at == begin or alike < BODY or 2 * alike <= len(rest):
                continue
            names = [cell.strip() for cell in next(csv.reader([lines[at]], delimiter=delimiter))]
            sound = not any(is_number(name) for name in names) and sum(map(bool, names)) >= 2
            if sound and (best is None or (alike, width) > best[:2]):
                best = (alike, width, at, delimiter)
    return (best[2], best[3]) if best else None


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
    if len(below) != count or not any(_is_marked(below[i]) for i in given):
        return False
    for i in given:
        try:
            units.check(_unit(row[i]))
        except ValueError:
            return False
    return True


def with_unit(name: str, cell: str, place: str) -> str:
    """A name with the unit below it. UserError, which begins with `place`, where the name has another one already."""
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


def _has_marks(cells: Sequence[str]) -> bool:
    """Whether most of a column are numbers, of which one is more than digits; what is none is told by who needs it."""
    told = [cell for cell in cells if cell.strip().lower() not in GAPS]
    return any(not cell.strip().isdigit() for cell in told) and 2 * sum(map(_is_marked, told)) > len(told)


def _is_marked(cell: str) -> bool:
    """Whether a cell is a number with any marks; a date with points and a version are none."""
    digits = _MARKED.fullmatch(cell.strip())
    if digits is None:
        return False
    body = _SPACES.sub("", digits[2].strip())
    marks = [c for c in body if c in ".,"]
    if len(marks) < 2:
        return re.search(r"[' \u00a0\u2009\u202f]", body) is None
    whole, _, part = body.rpartition(marks[-1])
    if len(set(marks)) == 2:
        return part.isdigit() and _GROUPS.fullmatch(whole) is not None
    return _GROUPS.fullmatch(body) is not None


def plain_numbers(
    columns: dict[str, list[str]], delimiter: str, file: str, first: int = 1, decimal_is: str = ""
) -> tuple[dict[str, list[str]], list[str]]:
    """The columns with their numbers as Python reads them, and what was assumed of their marks.

    The decimal mark and that of thousands are one thing for the whole file; `decimal_is` (point, comma) says which
    where it is known. A column with other text stays as it is.

    Raises
    ------
    UserError : two decimal marks in one file, or numbers that may be read in two ways; names the line, counted from
        that of the first row.
    """
    marked = [name for name, cells in columns.items() if _has_marks(cells)]
    # mark -> the cells that prove it to be of that kind: (row, column, cell)
    decimal: dict[str, list[Place]] = {}
    thousands: dict[str, list[Place]] = {}
    unsure: dict[str, list[Place]] = {}
    for name in marked:
        for row, cell in enumerate(columns[name]):
            digits = _MARKED.fullmatch(cell.strip()) if _is_marked(cell) else None
            body = _SPACES.sub("", digits[2].strip()) if digits else ""
            marks = [c for c in body if c in ".,"]
            if digits is None or not marks:
                continue
            place, last = (row, name, cell), marks[-1]
            whole, _, part = body.rpartition(last)
            if len(set(marks)) == 2:
                decimal.setdefault(last, []).append(place)
                thousands.setdefault("," if last == "." else ".", []).append(place)
            elif len(marks) > 1:
                thousands.setdefault(last, []).append(place)
            elif len(part) != 3 or len(whole) > 3 or whole in ("", "0") or digits[3]:
                decimal.setdefault(last, []).append(place)
            else:
                unsure.setdefault(last, []).append(place)
    if decimal_is:
        here, there = (".", ",") if decimal_is == "point" else (",", ".")
        wrong = [*decimal.pop(there, []), *thousands.pop(here, [])]
        if wrong:
            row, name, cell = wrong[0]
            raise UserError(
                f"{file}:{row + first}: column {name}: found {shorten(cell)}, expected a decimal {decimal_is}"
            )
        decimal[here] = [*decimal.get(here, []), *unsure.pop(here, [])]
        thousands[there] = [*thousands.get(there, []), *unsure.pop(there, [])]
    for mark in decimal:
        against = decimal.get("," if mark == "." else ".", []) or thousands.get(mark, [])
        if against and len(decimal[mark]) <= len(against):
            row, name, cell = decimal[mark][0]
            _, other, example = next(one for one in against if one[2] != cell)
            kind = "comma" if mark == "." else "point"
            raise UserError(
                f"{file}:{row + first}: column {name}: found {shorten(cell)}, expected a decimal {kind}, "
                f"as in {shorten(example)} of {other}"
            )
    doubtful = _doubtful(decimal, thousands, unsure, delimiter)
    if doubtful is not None:
        row, name, cell = doubtful
        point, none = cell.strip().replace(",", "."), re.sub("[.,]", "", cell.strip())
        what = f"{file}:{row + first}: column {name}: found {shorten(cell)}, which is {point} or {none}"
        raise Ambiguous(f"{what}; expected a decimal point, or no mark of thousands", "decimal", ("point", "comma"))
    point = next(iter(decimal), "") or ("," if "," in unsure and "," not in thousands else ".")
    group = "," if point == "." else "."
    commas = (decimal.get(",") or unsure.get(",", []))[:1]
    notes = [f"decimal comma ({shorten(commas[0][2])})"] if point == "," and commas else []
    grouped = thousands.get(group) or unsure.get(group)
    if grouped:
        notes.append(f"{group} parts thousands ({shorten(grouped[0][2])})")
    found = dict(columns)
    for name in marked:
        found[name] = [_plain(cell, point, group) for cell in columns[name]]
    return found, notes


def _doubtful(
    decimal: dict[str, list[Place]], thousands: dict[str, list[Place]], unsure: dict[str, list[Place]], delimiter: str
) -> Place | None:
    """A cell like 1,302 that nothing in the file settles, or that is unlike the others of its column."""
    for mark, places in unsure.items():
        other = "." if mark == "," else ","
        if not decimal and not thousands and (mark == "," or delimiter == ";"):
            return places[0]
        of_column, grouped = (Counter(n for _, n, _ in one) for one in (places, thousands.get(mark, [])))
        shown, largest = Counter(n for _, n, _ in decimal.get(other, [])), dict[str, float]()
        for _, name, cell in decimal.get(other, []):
            if name in of_column:
                largest[name] = max(largest.get(name, 0.0), abs(float(_plain(cell, other, mark))))
        for row, name, cell in places:
            few = FEW * shown[name] > of_column[name]
            if shown[name] and (
                not grouped[name] or few or abs(float(_plain(cell, other, mark))) > LEAP * largest[name]
            ):
                return row, name, cell
    return None


def _plain(cell: str, point: str, group: str) -> str:
    digits = _MARKED.fullmatch(cell.strip()) if _is_marked(cell) else None
    if digits is None:
        return cell
    body = _SPACES.sub("", digits[2]).replace(group, "").replace(point, ".")
    return f"{digits[1]}{body}" + (f"e{digits[3]}" if digits[3] else "")
