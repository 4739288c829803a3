"""Files in .gz and .zip: unpacked one at a time into a folder that goes again, up to a bound."""

from __future__ import annotations

import contextlib
import gzip
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from terrapin_hil.reading import shorten
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import MAX_BYTES

__all__ = ["unpacked"]

MOST = 1000  # files of a .zip
BLOCK = 1 << 20


@contextlib.contextmanager
def unpacked(path: Path, suffixes: tuple[str, ...]) -> Iterator[list[Path]]:
    """The files in it, as files; those that end in `suffixes`. Their names are the packed ones, without folders.

    UserError for no such file, a password, and more than MAX_BYTES in all.
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
                _copy(path, source, target, MAX_BYTES)
            yield [target]
            return
        packed = stack.enter_context(zipfile.ZipFile(path))
        found: list[Path] = []
        left = MAX_BYTES
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
                left -= _copy(path, source, target, left)
            found.append(target)
        if not found:
            raise UserError(f"{path.name}: holds no file that ends in {' '.join(suffixes)}")
        yield found


def _copy(path: Path, source: IO[bytes] | gzip.GzipFile, target: Path, most: int) -> int:
    done = 0
    with target.open("wb") as file:
        while block := source.read(BLOCK):
            done += len(block)
            if done > most:
                raise UserError(f"{path.name}: unpacks to more than {MAX_BYTES >> 20} MiB, expected less")
            file.write(block)
    return done
