"""Any log to frames, some ten thousand at a time. Each kind of log is a file of `formats`.

with LogReader(path) as log:
    for frames in log.blocks(): ...
    log.cut         what is wrong with the end, if a crash cut the log off; else ""
    log.lost        what gave no frame, with the first place; else ""
    log.assumed     what was assumed where the file does not say it
    log.buses       names of the buses, by number
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np

from terrapin_tools.bounded import each
from terrapin_tools.errors import UserError
from terrapin_tools.logs import formats
from terrapin_tools.logs.formats.mcap import holds_frames
from terrapin_tools.logs.formats.source import Source
from terrapin_tools.logs.frames import Frames, joined

__all__ = ["READABLE", "LogReader", "is_log", "read_log"]

TRIES = 5  # at a log that grows while it is read
HEAD = 1 << 12  # bytes by which a kind is told
# Their suffix says that they are logs; .csv, .txt and .db are, if their beginning says so.
SURE = (".log", ".blf", ".asc", ".trc", ".mf4", ".mcap")


@cache
def _kinds() -> tuple[ModuleType, ...]:
    names = [found.name for found in pkgutil.iter_modules(formats.__path__, f"{formats.__name__}.")]
    modules = [importlib.import_module(name) for name in names]
    return tuple(module for module in modules if hasattr(module, "SUFFIXES"))


@cache
def _readable() -> tuple[str, ...]:
    return tuple(dict.fromkeys((*SURE, *(suffix for kind in _kinds() for suffix in kind.SUFFIXES))))


READABLE = _readable()


def _kind(path: Path, head: bytes) -> ModuleType | None:
    """The kind that recognises the beginning, else the one that the suffix alone says."""
    found = [(kind.recognises(head), kind) for kind in _kinds() if path.suffix.lower() in kind.SUFFIXES]
    return next((kind for said in (True, None) for known, kind in found if known is said), None)


def is_log(path: Path) -> bool:
    """Whether a file is a log of a bus: by its suffix, or (.csv, .txt, .db) by its beginning, (.mcap) by its topics."""
    suffix = path.suffix.lower()
    try:
        if suffix == ".mcap":
            return holds_frames(path)
        if suffix in SURE or suffix not in READABLE or suffix == ".parquet":
            return suffix in SURE
        with path.open("rb") as file:
            return _kind(path, file.read(HEAD)) is not None
    except (OSError, ValueError):  # a name that no file can have
        return False


class LogReader:
    """One log. UserError when the file is none, or of no known kind."""

    def __init__(self, path: Path) -> None:
        if path.is_dir():  # a run's folder
            path = path / "telemetry.log"
        self.path = path
        self.kind = path.suffix.lower()
        if self.kind not in READABLE:
            raise UserError(f"{path}: unknown kind of log {self.kind!r}, expected one of {' '.join(READABLE)}")
        try:
            self.size = path.stat().st_size
            with path.open("rb") as file:
                head = file.read(HEAD)
        except OSError as error:
            raise UserError(f"{path}: {error.strerror or error}, expected a readable log") from None
        kind = _kind(path, head)
        if kind is None:
            made = {".csv": "SavvyCAN, Kvaser or python-can", ".txt": "Kvaser", ".db": "python-can"}.get(self.kind)
            raise UserError(f"{path}: begins with {head[:40]!r}, expected a log of {made}")
        self._kind = kind
        self._source = Source(path, self.size, lambda _: None)

    @property
    def cut(self) -> str:
        """What is wrong with the end."""
        return self._source.cut

    @property
    def lost(self) -> str:
        """What gave no frame, with its first place."""
        return self._source.lost

    @property
    def assumed(self) -> list[str]:
        """What was assumed, where the file does not say it."""
        return self._source.assumed

    @property
    def buses(self) -> list[str]:
        """Names of the buses, by the numbers of Frames.bus."""
        return self._source.buses

    @property
    def timed(self) -> bool:
        """Whether it has times; else all are 0."""
        return self._source.timed

    def blocks(self, told: Callable[[int], None] = lambda _: None) -> Iterator[Frames]:
        """All frames in file order. `told` gets the bytes done so far. UserError for what is no log of its kind."""
        for number in range(TRIES):  # a log that is being written may grow between two looks at it
            size = self.path.stat().st_size
            self._source = Source(self.path, self.size, told)
            begun = False
            try:
                for frames in each(self.path, self._kind.blocks(self._source)):
                    begun = True
                    yield frames
                return
            except UserError:
                if begun or self.path.stat().st_size == size or number == TRIES - 1:
                    raise


def read_log(path: Path) -> tuple[Frames, str]:
    """All frames of a log in order of time, and what is wrong with its end ("" if nothing)."""
    log = LogReader(path)
    whole = joined(log.path, list(log.blocks()))
    return whole.pick(np.argsort(whole.times, kind="stable")), log.cut
