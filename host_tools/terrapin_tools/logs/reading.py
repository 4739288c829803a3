"""Any log to frames, some ten thousand at a time: candump text (of a file or a screen), BLF, ASC, TRC, MF4, MCAP,
Parquet, a run's folder.

with LogReader(path) as log:
    for frames in log.blocks(): ...
    log.cut         what is wrong with the end, if a crash cut the log off; else ""
    log.lost        what its reader passed over in silence; else ""
"""

from __future__ import annotations

import base64
import gc
import io
import json
import logging
import re
import struct
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_tools.errors import UserError
from terrapin_tools.logs import candump
from terrapin_tools.logs.frames import ERROR, EXTENDED, FD, REMOTE, SENT, Frames, frames, joined

__all__ = ["RAW_TOPIC", "READABLE", "LogReader", "message_flags", "read_log"]

BLOCK = 50_000  # frames
TRIES = 5  # at a log that grows while it is read
RAW_TOPIC = "/can"  # of MCAP: frames as they are; one topic more a message, with its signals
READABLE = (".log", ".blf", ".asc", ".trc", ".mf4", ".mcap", ".parquet")
TOP = 1 << 16  # bytes at the beginning of an ASC log in which its trigger block is looked for

logging.getLogger("can").addHandler(logging.NullHandler())


class LogReader:
    """One log. UserError when the file is none, or of no known kind."""

    def __init__(self, path: Path) -> None:
        if path.is_dir():  # a run's folder
            path = path / "telemetry.log"
        self.path = path
        self.kind = path.suffix.lower()
        self.cut = ""
        self.lost = ""
        if self.kind not in READABLE:
            raise UserError(f"{path}: unknown kind of log {self.kind!r}, expected one of {' '.join(READABLE)}")
        try:
            self.size = path.stat().st_size
            with path.open("rb"):
                pass
        except OSError as error:
            raise UserError(f"{path}: {error.strerror or error}, expected a readable log") from None

    def blocks(self, told: Callable[[int], None] = lambda _: None) -> Iterator[Frames]:
        """All frames in file order. `told` gets the bytes done so far. UserError for what is no log of its kind."""
        reader = {".log": self._candump, ".mcap": self._mcap, ".parquet": self._parquet}.get(
            self.kind, self._python_can
        )
        begun = False
        for _ in range(TRIES - 1):  # a log that is being written may grow between two looks at it
            size = self.path.stat().st_size
            try:
                for frames in reader(told):
                    begun = True
                    yield frames
                return
            except UserError:
                if begun or self.path.stat().st_size == size:
                    raise
        yield from reader(told)

    def _candump(self, told: Callable[[int], None]) -> Iterator[Frames]:
        yield from candump.blocks(self.path, told)
        with self.path.open("rb") as file:
            file.seek(max(0, self.size - 1))
            if self.size and file.read(1) != b"\n":
                self.cut = "the last line has no end"

    def _python_can(self, told: Callable[[int], None]) -> Iterator[Frames]:
        import can

        collected = _Collected(self.path)
        if self.kind == ".mf4":
            self._check_mf4()
        try:
            with _without_trigger(self.path) or can.LogReader(self.path) as reader:
                file = getattr(reader, "file", None)
                for message in reader:
                    collected.add_message(message)
                    if len(collected.times) >= BLOCK:
                        yield collected.take()
                        if file is not None and self.kind != ".mf4":
                            told(file.tell() if self.kind == ".blf" else self.size // 2)
        except UserError:
            raise
        except Exception as error:  # each reader of python-can has its own way of failing on a broken file
            _bury(error)
            if not collected.total:
                raise UserError(f"{self.path}: {_brief(error)}, expected a {self.kind[1:].upper()} bus log") from None
            self.cut = f"unreadable after {collected.last:.6f} s ({_brief(error)})"
        yield collected.take()
        if self.kind == ".blf" and not self.cut:
            self.cut = _blf_cut(self.path)
        if self.kind == ".trc":
            self.lost = _trc_rest(self.path, collected.total)
        told(self.size)

    def _check_mf4(self) -> None:
        with self.path.open("rb") as file:
            begin = file.read(3)
        if begin not in (b"MDF", b"UnF"):  # UnFinMF: unfinished
            raise UserError(f"{self.path}: begins with {begin!r}, expected an MF4 bus log")

    def _mcap(self, told: Callable[[int], None]) -> Iterator[Frames]:
        from mcap.exceptions import McapError
        from mcap.records import Channel, DataEnd, Message
        from mcap.stream_reader import StreamReader

        collected = _Collected(self.path)
        raw: set[int] = set()
        ended = False
        with self.path.open("rb") as file:
            try:
                for record in StreamReader(file).records:
                    if isinstance(record, Channel) and record.topic == RAW_TOPIC:
                        raw.add(record.id)
                    elif isinstance(record, Message) and record.channel_id in raw:
                        collected.add_json(record.log_time * 1e-9, record.data)
                    elif isinstance(record, DataEnd):
                        ended = True
                        break
                    if len(collected.times) >= BLOCK:
                        yield collected.take()
                        told(file.tell())
            except (
                McapError,
                struct.error,
                ValueError,
                KeyError,
                TypeError,
                EOFError,
                OverflowError,
                MemoryError,
            ) as error:
                if not collected.total and not raw:
                    raise UserError(f"{self.path}: {_brief(error)}, expected an MCAP file") from None
                self.cut = "the end is missing" if collected.total else f"unreadable ({_brief(error)})"
        if not ended and not self.cut:
            self.cut = "the end is missing"
        yield collected.take()
        told(self.size)

    def _parquet(self, told: Callable[[int], None]) -> Iterator[Frames]:
        import pyarrow.parquet

        try:
            with pyarrow.parquet.ParquetFile(self.path) as file:
                missing = {"time", "id", "data", "flags"} - set(file.schema_arrow.names)
                if missing:
                    expected = "the columns time, id, data, flags of frames"
                    raise UserError(f"{self.path}: found no column {sorted(missing)[0]!r}, expected {expected}")
                done = 0
                for batch in file.iter_batches(BLOCK, columns=["time", "id", "data", "flags"]):
                    done += batch.num_rows
                    times, names, data, flags = (column.to_pylist() for column in batch.columns)
                    yield frames(self.path, times, names, data, flags)
                    told(self.size * done // max(1, file.metadata.num_rows))
        except (pyarrow.ArrowException, OSError, TypeError, ValueError) as error:
            raise UserError(f"{self.path}: {_brief(error)}, expected a Parquet file of frames") from None


def _without_trigger(path: Path) -> Any:
    """python-can's reader of an ASC log that has no trigger block (BusMaster writes none); None for any other log.

    python-can takes the line behind the header for the block's begin, whatever it is, and so loses the first frame
    (4.6, `ASCReader.__iter__`): here it gets one.
    """
    import can

    if path.suffix.lower() != ".asc":
        return None
    with path.open("rb") as file:
        if re.search(rb"^begin trigger", file.read(TOP), re.IGNORECASE | re.MULTILINE):
            return None
    text = path.read_text(encoding="utf-8", errors="replace")
    first = re.search(r"^[ \t]*\d+\.\d+[ \t]", text, re.MULTILINE)
    if first is None:
        return None
    date = re.search(r"^date[ \t]+(.*)$", text[: first.start()], re.IGNORECASE | re.MULTILINE)
    begin = f"Begin Triggerblock {date[1] if date else ''}\n"
    return can.ASCReader(io.StringIO(text[: first.start()] + begin + text[first.start() :]))


def _trc_rest(path: Path, read: int) -> str:
    """What of a PCAN log python-can passes over in silence: rows of errors and of events."""
    with path.open("rb") as file:
        rows = [number for number, line in enumerate(file, 1) if re.match(rb"\s*\d+\)?\s+[\d.]+\s", line)]
    left = len(rows) - read
    return f"{left} of its {len(rows)} rows are no frames that could be read (errors, events)" if left > 0 else ""


def message_flags(message: Any) -> int:
    """Frames.flags of a python-can message."""
    return (
        (EXTENDED if message.is_extended_id else 0)
        | (REMOTE if message.is_remote_frame else 0)
        | (ERROR if message.is_error_frame else 0)
        | (FD if message.is_fd else 0)
        | (0 if message.is_rx else SENT)
    )


class _Collected:
    """Frames on their way into arrays."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.total = 0
        self.last = 0.0
        self.times: list[float] = []
        self._rest: tuple[list[int], list[bytes], list[int]] = ([], [], [])

    def add(self, time: float, identifier: int, data: bytes, flags: int) -> None:
        self.times.append(time)
        identifiers, payloads, all_flags = self._rest
        identifiers.append(identifier)
        payloads.append(data)
        all_flags.append(flags)
        self.total += 1
        self.last = time

    def add_message(self, message: Any) -> None:
        flags = message_flags(message)
        self.add(message.timestamp, message.arbitration_id, b"" if flags & REMOTE else bytes(message.data), flags)

    def add_json(self, time: float, text: bytes) -> None:
        value = json.loads(text)
        self.add(time, int(value["id"]), base64.b64decode(value["data"], validate=True), int(value["flags"]))

    def take(self) -> Frames:
        block = frames(self.path, self.times, *self._rest)
        self.times, self._rest = [], ([], [], [])
        return block


def _bury(error: Exception) -> None:
    """asammdf's object of a file that it could not open complains once more when it is deleted: not to the user."""
    before = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        gc.collect()
    finally:
        sys.unraisablehook = before


def _brief(error: Exception) -> str:
    text = next(iter(str(error).splitlines()), "")
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _blf_cut(path: Path) -> str:
    """The header of a BLF gets its size when the file is closed."""
    with path.open("rb") as file:
        header = file.read(32)
    stated = int.from_bytes(header[16:24], "little")
    size = path.stat().st_size
    return f"the header states {stated} bytes, the file has {size}" if stated != size else ""


def read_log(path: Path) -> tuple[Frames, str]:
    """All frames of a log in order of time, and what is wrong with its end ("" if nothing)."""
    log = LogReader(path)
    whole = joined(log.path, list(log.blocks()))
    return whole.pick(np.argsort(whole.times, kind="stable")), log.cut
