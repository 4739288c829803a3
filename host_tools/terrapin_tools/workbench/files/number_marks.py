"""How numbers are written in text: which cells are some, their decimal mark and that of thousands.

Marks are one thing for a whole file: what one cell leaves open another one settles, or it is asked for.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from terrapin_hil.reading import shorten
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import Ambiguous

__all__ = ["GAPS", "is_marked", "is_number", "plain_numbers"]

GAPS = ("", "nan", "na", "n/a", "#n/a", "#na", "null", "none", "-", "--", "---", "inf", "-inf", "+inf", "#div/0!")
FEW = 0.05  # share of a column's numbers that are odd if they alone show no decimals
LEAP = 10.0  # times the largest of them
Place = tuple[int, str, str]
_NUMBER = re.compile(r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eEdD][-+]?\d+)?")
# A number with any marks: digits in groups, an exponent as Fortran writes it too.
_MARKED = re.compile(r"([-+]?)(\d[\d.,' \u00a0\u2009\u202f]*|[.,]\d+)(?:[eEdD]([-+]?\d+))?")
_GROUPS = re.compile(r"\d{1,3}(?:\.\d{3})+|\d{1,3}(?:,\d{3})+")  # of thousands
_SPACES = re.compile(r"(?<=\d)['\u00a0\u2009\u202f ](?=\d{3}(?!\d))")


def is_number(text: str) -> bool:
    """Whether a cell is written as a number, with a point or a comma."""
    return _NUMBER.fullmatch(text.strip()) is not None


def _has_marks(cells: Sequence[str]) -> bool:
    """Whether most of a column are numbers, of which one is more than digits; what is none is told by who needs it."""
    told = [cell for cell in cells if cell.strip().lower() not in GAPS]
    return any(not cell.strip().isdigit() for cell in told) and 2 * sum(map(is_marked, told)) > len(told)


def is_marked(cell: str) -> bool:
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
            digits = _MARKED.fullmatch(cell.strip()) if is_marked(cell) else None
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
    digits = _MARKED.fullmatch(cell.strip()) if is_marked(cell) else None
    if digits is None:
        return cell
    body = _SPACES.sub("", digits[2]).replace(group, "").replace(point, ".")
    return f"{digits[1]}{body}" + (f"e{digits[3]}" if digits[3] else "")
