"""Spreadsheets of Excel and LibreOffice: the values that stand in their cells. No macro runs, no link is followed."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Collection, Iterator
from pathlib import Path

from terrapin_hil.reading import shorten
from terrapin_tools.bounded import refuse_beyond
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import Asked, Format, Part
from terrapin_tools.workbench.files.grid import Merged, Row, part_of_grid

MOST = 20_000_000  # cells of a sheet
FEW = 1 << 18  # rows and cells that stand in a file of any size,
EACH = 2  # and for each of its bytes: they pack to 2 or more
_PLACE = re.compile(rb'<c\b[^>]*?\br="([A-Z]{1,3})(\d{1,7})"')
_ODS = re.compile(rb"<table:(table|table-row|table-cell|covered-table-cell)(?![\w-])([^>]*)>")
_ELEMENT = re.compile(rb"<(?:\w+:)?(?:c|row|table-row|table-cell)[\s/>]")
_RANGE = re.compile(r"\$?([A-Z]{1,3})\$?(\d{1,7}):\$?([A-Z]{1,3})\$?(\d{1,7})", re.IGNORECASE)
_NEVER = re.compile(rb"(?!)()()")
BLOCK = 1 << 20


def read(path: Path, asked: Asked, texts: Collection[str]) -> list[Part]:
    """A part for each sheet that holds cells. UserError for a bomb and for a range that is none."""
    import python_calamine

    _check_size(path)
    box = _box(asked.range)
    book = python_calamine.CalamineWorkbook.from_path(str(path))
    found = []
    for name in book.sheet_names:
        if asked.part not in ("", "*", name):
            continue
        sheet = book.get_sheet_by_name(name)
        if sheet.start is None:
            continue
        rows: list[Row] = list(sheet.to_python(skip_empty_area=False))
        merged: Merged = [(a, b) for a, b in sheet.merged_cell_ranges or []]
        if box:
            (top, left), (bottom, right) = box
            rows = [row[left : right + 1] for row in rows[top : bottom + 1]]
            merged = [((a - top, b - left), (c - top, d - left)) for (a, b), (c, d) in merged]
        place = f"{path.name}: sheet {shorten(name)}" if len(book.sheet_names) > 1 else path.name
        part = part_of_grid(name, rows, merged, place, (box[0] if box else (0, 0)), asked)
        if part is not None:
            found.append(part)
    if not found and asked.part not in ("", "*", *book.sheet_names):
        raise UserError(
            f"{path.name}: sheet: found {shorten(asked.part)}, expected one of {', '.join(book.sheet_names)}"
        )
    return found


def _box(text: str) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """A3:F90 as (row, column) of its corners, from 0."""
    if not text:
        return None
    match = _RANGE.fullmatch(text.strip())
    if match is None or int(match[2]) < 1 or int(match[4]) < int(match[2]):
        raise UserError(f"range: found {shorten(text)}, expected cells such as A3:F90")
    left, right = _number(match[1].upper().encode()), _number(match[3].upper().encode())
    if right < left:
        raise UserError(f"range: found {shorten(text)}, expected cells such as A3:F90")
    return (int(match[2]) - 1, left), (int(match[4]) - 1, right)


def _number(letters: bytes) -> int:
    number = 0
    for letter in letters:
        number = 26 * number + letter - 64
    return number - 1


def _check_size(path: Path) -> None:
    """UserError for a file that unpacks to more than it may, to more cells than a file of its size, or to a sheet of
    more than MOST cells.

    The library holds a sheet as the rectangle of its cells: two of them in opposite corners would fill the memory.
    """
    if not zipfile.is_zipfile(path):
        return  # .xls: what a file of its size can hold
    with zipfile.ZipFile(path) as packed:
        refuse_beyond(path, sum(info.file_size for info in packed.infolist()))
        left = FEW + EACH * path.stat().st_size
        for info in packed.infolist():
            if info.filename.startswith("xl/worksheets/") or info.filename == "content.xml":
                left -= sum(len(_ELEMENT.findall(text)) for text in _texts(packed, info))
            if left < 0:
                most = FEW + EACH * path.stat().st_size
                raise UserError(
                    f"{path.name}: holds more than {most} rows and cells, expected fewer in a file of its size"
                )
            if re.fullmatch(r"xl/worksheets/[^/]+\.xml", info.filename):
                last = [(int(row), _number(letters)) for letters, row in _places(packed, info, _PLACE)]
                if last and max(r for r, _ in last) * (max(c for _, c in last) + 1) > MOST:
                    raise UserError(f"{path.name}: has a sheet of more than {MOST} cells, expected fewer")
            elif info.filename == "content.xml":
                if _ods_cells(packed, info) > MOST:
                    raise UserError(f"{path.name}: has a sheet of more than {MOST} cells, expected fewer")
            elif info.filename.startswith("xl/") or info.filename.endswith(".xml"):
                for _ in _places(packed, info, _NEVER):  # whether it is as large as it says
                    pass


def _places(
    packed: zipfile.ZipFile, info: zipfile.ZipInfo, pattern: re.Pattern[bytes]
) -> Iterator[tuple[bytes, bytes]]:
    """The groups of each match in a packed file."""
    for text in _texts(packed, info):
        for match in pattern.finditer(text):
            yield match[1], match[2]


def _texts(packed: zipfile.ZipFile, info: zipfile.ZipInfo) -> Iterator[bytes]:
    """A packed file in pieces that end behind an element's bracket."""
    done, rest = 0, b""
    with packed.open(info) as file:
        while block := file.read(BLOCK):
            done += len(block)
            refuse_beyond(Path(packed.filename or ""), done)
            text = rest + block
            end = text.rfind(b">") + 1
            yield text[:end]
            rest = text[end:] if len(text) - end < BLOCK else b""


def _ods_cells(packed: zipfile.ZipFile, info: zipfile.ZipInfo) -> int:
    """Cells of the largest rectangle that a sheet's values span, repetitions counted."""

    def count(attributes: bytes, what: bytes) -> int:
        match = re.search(rb"table:number-" + what + rb'-repeated="(\d{1,9})"', attributes)
        return int(match[1]) if match else 1

    most = row = last = wide = column = 0  # row: of the sheet so far; last: that holds a value
    repeated = filled = 0
    for tag, attributes in [*_places(packed, info, _ODS), (b"table", b"")]:
        if tag in (b"table", b"table-row"):
            row += repeated
            last = row if filled else last
            most = max(most, last * wide)
            repeated, filled, column = (count(attributes, b"rows") if tag == b"table-row" else 0), 0, 0
            if tag == b"table":
                row = last = wide = 0
        else:
            column += count(attributes, b"columns")
            if b"value-type" in attributes:
                filled, wide = 1, max(wide, column)
    return most


FORMAT = Format(
    "a spreadsheet",
    (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"),
    read,
    part="sheet",
    package="python_calamine",
    extra="spreadsheets",
)
