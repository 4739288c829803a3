"""Files in .gz and .zip: unpacked one at a time into a folder that goes again, up to a bound."""

from __future__ import annotations

import contextlib
import gzip
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from terrapin_hil.reading import shorten
from terrapin_tools.bounded import CELLS, refuse_beyond
from terrapin_tools.errors import UserError

__all__ = ["unpacked"]

MOST = 1000  # files of a .zip
BLOCK = 1 << 20
TEXT = (".csv", ".tsv", ".txt", ".dat")


@contextlib.contextmanager
def unpacked(path: Path, suffixes: tuple[str, ...]) -> Iterator[list[Path]]:
    """The files in it, as files; those that end in `suffixes`. Their names are the packed ones, without folders.

    UserError for no such file, a password, and more than it may stand for in all.
    """
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="terrapin-")))
        if path.suffix.lower() == ".gz":
            target = folder / path.stem
            if target.suffix.lower() not in suffixes:
                raise UserError(
                    f"{path.name}: holds {shorten(path.stem)}, expected a name that ends in {' '.join(suffixes)}"
                )
            with gzip.open(path, "rb") as source:
                _copy(source, target, Left(path))
            yield [target]
            return
        packed = stack.enter_context(zipfile.ZipFile(path))
        found: list[Path] = []
        left = Left(path)
        for number, info in enumerate(packed.infolist()):
            name = Path(info.filename).name
            if info.is_dir() or name.startswith(".") or "__MACOSX" in info.filename:
                continue
            if Path(name).suffix.lower() not in suffixes:
                continue
            if info.flag_bits & 1:
                raise UserError(f"{path.name}: {shorten(name)} is locked by a password, expected none")
            if len(found) == MOST:
                raise UserError(f"{path.name}: holds more than {MOST} files, expected fewer")
            target = folder / str(number) / name
            target.parent.mkdir()
            with packed.open(info) as source:
                _copy(source, target, left)
            found.append(target)
        if not found:
            raise UserError(f"{path.name}: holds no file that ends in {' '.join(suffixes)}")
        yield found


@dataclass
class Left:
    """What was unpacked of a file so far: bytes, and what looks like cells of text."""

    path: Path
    bytes: int = 0
    cells: int = 0


def _copy(source: IO[bytes] | gzip.GzipFile, target: Path, so_far: Left) -> None:
    with target.open("wb") as file:
        while block := source.read(BLOCK):
            so_far.bytes += len(block)
            refuse_beyond(so_far.path, so_far.bytes)
            if target.suffix.lower() in TEXT:  # two bytes may be a cell
                so_far.cells += sum(map(block.count, (b",", b";", b"\t", b"|", b"\n")))
                if so_far.cells > CELLS:
                    raise UserError(f"{so_far.path.name}: holds more than {CELLS >> 20} Mi cells, expected fewer")
            file.write(block)
