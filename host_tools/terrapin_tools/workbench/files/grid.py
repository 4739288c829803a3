"""Cells of a sheet as a table: where it begins and ends, its names, the headings and units around them."""

from __future__ import annotations

import datetime
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from terrapin_hil.reading import shorten
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.csv_layout import are_units, distinct, with_unit
from terrapin_tools.workbench.files.format import Ambiguous, Asked, Column, Part, cells
from terrapin_tools.workbench.files.number_marks import is_number, plain_numbers

__all__ = ["Merged", "Row", "part_of_grid"]

Row = Sequence[Any]
Place = tuple[int, int]
Merged = list[tuple[Place, Place]]  # first and last cell, (row, column) from 0
RIVAL = 0.2  # of the largest table's numbers, from which another one is no remark beside it
TALLEST = 5  # rows of headings


@dataclass(frozen=True)
class _Block:
    """A table in a sheet: rows [top, end), its names at `names`, its first row of values, columns [left, right)."""

    top: int
    names: int
    first: int
    end: int
    left: int
    right: int
    numbers: int


def part_of_grid(name: str, rows: list[Row], merged: Merged, place: str, origin: Place, asked: Asked) -> Part | None:
    """The one table of a sheet; None where it holds none.

    Parameters
    ----------
    place : the file and sheet, for complaints. origin : row and column of the sheet at which `rows` begin.

    Raises
    ------
    UserError : several tables in one sheet, or a name or a mark of numbers that may be read in two ways.
    """
    filled = _filled(rows, merged)
    if asked.names:
        at = int(asked.names) - 1 - origin[0]
        if not 0 <= at < len(filled):
            raise UserError(f"{place}: names: found {asked.names}, expected a row that holds cells")
        found = [block for block in [_block(filled, at, len(filled), at)] if block is not None]
    else:
        found = [block for top, end in _apart(filled) if (block := _block(filled, top, end, None)) is not None]
    if not found:
        return None
    best = max(found, key=lambda block: block.numbers)
    rivals = [block for block in found if block.numbers >= RIVAL * best.numbers]
    if len(rivals) > 1:
        ranges = [_called(block, origin) for block in rivals]
        raise Ambiguous(f"{place}: holds tables in {' and '.join(ranges[:5])}", "range", ranges)
    return _part(name, filled, best, merged, place, origin, asked)


def _part(name: str, rows: list[Row], block: _Block, merged: Merged, place: str, origin: Place, asked: Asked) -> Part:
    first, span = block.first, slice(block.left, block.right)
    names = [_text(cell) for cell in rows[block.names][span]]
    notes = []
    upper = _headings(rows, block, merged, names)
    if upper:
        notes.append(f"headings of {len(upper)} row{'s' * (len(upper) > 1)} above the names")
        names = [
            " ".join(dict.fromkeys(filter(None, [*above, own]))) for *above, own in zip(*upper, names, strict=True)
        ]
    elif block.names - block.top > 0 or block.top > 0:
        count = sum(any(_text(cell) for cell in row) for row in rows[: block.names])
        notes += [f"{count} row{'s' * (count > 1)} above the names"] if count else []
    if first > block.names + 1 and asked.units != "0":
        units = [_text(cell) for cell in rows[block.names + 1][span]]
        notes.append(f"units from row {origin[0] + block.names + 2}")
        where = f"{place}:{origin[0] + block.names + 2}"
        names = [with_unit(one, unit, where) for one, unit in zip(names, units, strict=True)]
    elif first > block.names + 1:
        first = block.names + 1
    if merged and any(a >= first for (a, _), _ in merged):
        notes.append("merged cells hold their value in each row")
    nameless = [i for i, one in enumerate(names) if not one]
    names, twice = distinct(one or _letters(origin[1] + block.left + i) for i, one in enumerate(names))
    if twice:
        notes.append(f"{shorten(twice)} stands more than once, so its columns are numbered")
    below = rows[first : block.end]
    columns: dict[str, list[Any]] = {}
    for i, one in enumerate(names):
        column = [row[block.left + i] for row in below]
        if i not in nameless or any(_text(cell) for cell in column):
            columns[one] = column
    texts = {one: [cell.strip() if isinstance(cell, str) else "" for cell in column] for one, column in columns.items()}
    line = origin[0] + first + 1
    written = {one: column for one, column in texts.items() if any(column)}
    plain, told = plain_numbers(written, ";", place, line, asked.decimal)
    done = {one: _column(column, plain.get(one)) for one, column in columns.items()}
    return Part(name, done, {}, line, (*notes, *told))


def _column(column: list[Any], plain: list[str] | None) -> Column:
    """Numbers where all cells are, gaps as NaN; else text, with numbers in text as `plain` has them."""
    if plain is None and all(cell is None or cell == "" or _is_typed(cell) for cell in column):
        return np.array([np.nan if cell is None or cell == "" else float(cell) for cell in column])
    told = plain or [""] * len(column)
    return cells(
        [text or (None if isinstance(cell, str) else _text(cell)) for cell, text in zip(column, told, strict=True)]
    )


def _is_typed(cell: Any) -> bool:
    return isinstance(cell, (int, float)) and not isinstance(cell, bool)


def _text(cell: Any) -> str:
    if cell is None:
        return ""
    if isinstance(cell, bool):
        return str(cell).lower()
    if isinstance(cell, datetime.datetime):
        return cell.isoformat(" ")
    if isinstance(cell, (datetime.date, datetime.time)):
        return cell.isoformat()
    if isinstance(cell, datetime.timedelta):
        hours, rest = divmod(cell.total_seconds(), 3600.0)
        return f"{int(hours):02d}:{int(rest // 60):02d}:{rest % 60:09.6f}"
    return str(cells([cell])[0]).strip()


def _is_value(cell: Any) -> bool:
    """Whether a cell is measured: a number, a date, or text that is a number."""
    if isinstance(cell, str):
        return is_number(cell)
    return cell is not None and not isinstance(cell, bool)


def _filled(rows: list[Row], merged: Merged) -> list[Row]:
    """The cells with the value of a merged range in each of its cells."""
    found = [list(row) for row in rows]
    for (top, left), (bottom, right) in merged:
        if 0 <= top < len(found) and 0 <= left < len(found[top]):
            for row in found[top : bottom + 1]:
                row[left : right + 1] = [found[top][left]] * len(row[left : right + 1])
    return list(found)


def _apart(rows: list[Row]) -> Iterator[tuple[int, int]]:
    """Blocks of rows between empty ones."""
    top = None
    for i, row in enumerate([*rows, []]):
        there = any(_text(cell) for cell in row)
        if there and top is None:
            top = i
        if not there and top is not None:
            yield top, i
            top = None


def _block(rows: list[Row], top: int, end: int, names: int | None) -> _Block | None:
    """The table in some rows: names, perhaps units, and below them rows that hold numbers."""
    while end > top and not any(_text(cell) for cell in rows[end - 1]):
        end -= 1
    for at in range(top, end - 1) if names is None else [names]:
        own = {i for i, cell in enumerate(rows[at]) if _text(cell)}
        words = [_text(rows[at][i]) for i in own]
        if not own or any(_is_value(rows[at][i]) for i in own) or (len(words) > 1 and len(set(words)) == 1):
            continue
        left, right = min(own), max(own) + 1
        first = at + 1
        row = [_text(cell) for cell in rows[first][left:right]] if first < end else []
        below = [_text(cell) for cell in rows[first + 1][left:right]] if first + 1 < end else []
        if are_units(row, below, right - left):
            first += 1
        body = rows[first:end]
        held = Counter(i for row in body for i, cell in enumerate(row) if _text(cell))
        usual = {i for i, count in held.items() if 2 * count > len(body)}
        numbers = sum(_is_value(cell) for row in body for cell in row[left:right])
        begins = first < end and any(_is_value(cell) for cell in rows[first][left:right])
        if numbers and (names is not None or (begins and usual <= own | {left - 1})):
            left = min([left, *usual])
            return _Block(top, at, first, end, left, max([right, *(i + 1 for i in usual)]), numbers)
    return None


def _headings(rows: list[Row], block: _Block, merged: Merged, names: list[str]) -> list[list[str]]:
    """Rows above the names that are headings of several of them: merged cells, or what parts names that are alike."""
    found: list[list[str]] = []
    for at in range(block.names - 1, max(block.top, block.names - TALLEST) - 1, -1):
        row = [_text(cell) for cell in rows[at][block.left : block.right]]
        if len({*filter(None, row)}) < 2 or any(_is_value(cell) for cell in rows[at]):
            break
        spans = any(a <= at <= c and d > b for (a, b), (c, d) in merged)
        if not spans:
            held, filled = "", []
            for cell in row:
                held = cell or held
                filled.append(held)
            pairs = list(zip(filled, names, strict=True))
            if len(set(names)) == len(names) or len(set(pairs)) < len(pairs):
                break
            row = filled
        found.insert(0, row)
    return found


def _called(block: _Block, origin: Place) -> str:
    top, end = origin[0] + block.names + 1, origin[0] + block.end
    return f"{_letters(origin[1] + block.left)}{top}:{_letters(origin[1] + block.right - 1)}{end}"


def _letters(column: int) -> str:
    found = ""
    column += 1
    while column:
        column, rest = divmod(column - 1, 26)
        found = chr(65 + rest) + found
    return found
