"""ASAM MDF 4 bus logging: data frames as records, all at once or growing.

asammdf writes a file when it is closed. A log that grows needs more: asammdf writes the head (with what describes the
records), and the records follow as one last data block whose length, and the count of records, are kept true by every
flush. Such a file is a whole MF4 at any moment, without compression.
"""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array
from terrapin_tools.logs.decoding import Decoded, Decoder, Described
from terrapin_tools.logs.frames import EXTENDED, FD, SENT, Frames

__all__ = ["GrowingMf4", "WholeMf4"]

_FD_LENGTHS = np.array([*range(9), 12, 16, 20, 24, 32, 48, 64])
# In a data group's block its third link is the data; in a channel group's, after six links and the record's id, the
# count of records (ASAM MDF 4.1, blocks DG and CG). A block begins with id, 4 bytes, length, count of links.
_HEAD = 24
_DATA_LINK = _HEAD + 2 * 8
_CYCLES = _HEAD + 6 * 8 + 8
_LENGTH = 8
CHUNK = 1 << 16  # records


def _kind(width: int) -> np.dtype[Any]:
    """Names and widths of ASAM's bus logging, with `width` bytes of data a record."""
    return np.dtype(
        [
            ("CAN_DataFrame.BusChannel", "u1"),
            ("CAN_DataFrame.ID", "<u4"),
            ("CAN_DataFrame.IDE", "u1"),
            ("CAN_DataFrame.DLC", "u1"),
            ("CAN_DataFrame.DataLength", "u1"),
            ("CAN_DataFrame.DataBytes", "u1", (width,)),
            ("CAN_DataFrame.Dir", "u1"),
            ("CAN_DataFrame.EDL", "u1"),
            ("CAN_DataFrame.BRS", "u1"),
            ("CAN_DataFrame.ESI", "u1"),
        ]
    )


def _record(width: int) -> np.dtype[Any]:
    return np.dtype([("time", "<f8"), ("frame", _kind(width))])


def _samples(frames: Frames, width: int) -> npt.NDArray[Any]:
    samples = np.zeros(len(frames), dtype=_kind(width))
    for name, values in {
        "BusChannel": 1 + frames.bus,
        "ID": frames.identifiers,
        "IDE": (frames.flags & EXTENDED) != 0,
        "DLC": np.searchsorted(_FD_LENGTHS, frames.lengths),
        "DataLength": frames.lengths,
        "DataBytes": _as_wide(frames.data, width),
        "Dir": (frames.flags & SENT) != 0,
        "EDL": (frames.flags & FD) != 0,
    }.items():
        samples[f"CAN_DataFrame.{name}"] = values
    return samples


def _as_wide(data: npt.NDArray[np.uint8], width: int) -> npt.NDArray[np.uint8]:
    """Data (rows, any) as (rows, `width`): zeros at the end, or what is beyond left out."""
    return np.pad(data, ((0, 0), (0, max(0, width - data.shape[1]))))[:, :width]


class WholeMf4:
    """Compressed, and whole when it is closed. Remote and error frames are left out. With a `decoder` it has its
    description attached, and a group of channels for each message: its signals with unit, comment and words."""

    def __init__(self, path: Path, decoder: Decoder | None = None) -> None:
        from asammdf import MDF

        with path.open("wb"):
            pass  # complain now, not at the end
        self._path = path
        self._mdf: Any = MDF(version="4.10")
        self._start: float | None = None
        self._decoder = decoder
        self._decoded: dict[str, list[Decoded]] = {}

    def write(self, frames: Frames) -> None:
        frames = frames.data_frames
        if not len(frames):
            return
        samples = _samples(frames, 64)
        if self._start is None:
            self._start = _begin(self._mdf, frames, samples)
        else:
            self._mdf.extend(0, [(frames.times - self._start, None), (samples, None)])
        for message, table in (self._decoder.decode(frames) if self._decoder else {}).items():
            self._decoded.setdefault(message, []).append(table)

    def flush(self) -> None:
        pass  # not before close

    def _describe(self, decoder: Decoder) -> None:
        self._mdf.attach(decoder.path.read_bytes(), decoder.path.name, mime="text/plain")
        for message, tables in self._decoded.items():
            times = np.concatenate([table.times for table in tables]) - (self._start or 0.0)
            signals = [
                _signal(one, times, np.concatenate([table.signals[one.name] for table in tables]))
                for one in decoder.described(message)
            ]
            self._mdf.append(signals, acq_name=message, comment=message, common_timebase=True)

    def close(self) -> None:
        if self._decoder is not None:
            self._describe(self._decoder)
        self._mdf.save(self._path, overwrite=True, compression=2)
        self._mdf.close()


def _signal(one: Described, times: Array, values: Array) -> Any:
    """A channel; words for values as a conversion, so that the raw number stays."""
    from asammdf import Signal

    conversion: dict[str, Any] | None = None
    if one.words:
        conversion = {"default_addr": b""}
        for place, (value, word) in enumerate(sorted(one.words.items())):
            conversion |= {f"val_{place}": value, f"text_{place}": word.encode()}
    whole = (one.words or one.flag) and not np.isnan(values).any()
    samples = values.astype(np.int32) if whole else values
    return Signal(samples, times, name=one.name, unit=one.unit, comment=one.comment, conversion=conversion)


def _begin(mdf: Any, frames: Frames, samples: npt.NDArray[Any]) -> float:
    """Describes the records and takes the first ones; the time from which theirs count [s]."""
    from asammdf import Signal
    from asammdf.blocks.source_utils import Source

    start = float(np.floor(frames.times[0]))
    mdf.header.start_time = datetime.fromtimestamp(start, UTC)
    source = Source("CAN", "CAN1", "", Source.SOURCE_BUS, Source.BUS_TYPE_CAN)
    mdf.append([Signal(samples, frames.times - start, name="CAN_DataFrame", source=source)])
    return start


class GrowingMf4:
    """Readable up to the last flush, whatever happens. Remote and error frames are left out."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: BinaryIO | None = None
        self._start = 0.0
        self._width = 8
        self._count = 0
        self._places = (0, 0)  # in the file: of the data block, of the count of records
        with path.open("wb"):
            pass
        self._empty()

    def _empty(self) -> None:
        from asammdf import MDF

        with MDF(version="4.10") as mdf:
            mdf.save(self._path, overwrite=True)

    def write(self, frames: Frames) -> None:
        frames = frames.data_frames
        if not len(frames):
            return
        width = 64 if int(frames.lengths.max()) > 8 else 8
        if self._file is None:
            self._width = width
            self._file = self._head(self._path, frames)
        elif width > self._width:  # the first long frame of CAN FD: rare, and worth a copy
            self._widen(frames)
        self._file.write(self._records(frames).tobytes())
        self._count += len(frames)

    def _records(self, frames: Frames) -> npt.NDArray[Any]:
        records = np.zeros(len(frames), dtype=_record(self._width))
        records["time"], records["frame"] = frames.times - self._start, _samples(frames, self._width)
        return records

    def _head(self, path: Path, frames: Frames) -> BinaryIO:
        """A file by asammdf with one record, and then an empty data block in the place of its own."""
        from asammdf import MDF

        one = frames.pick(np.arange(1))
        temporary = path.with_name(f".{path.stem}.head.mf4")
        try:
            with MDF(version="4.10") as mdf:
                self._start = _begin(mdf, one, self._records(one)["frame"])
                mdf.save(temporary, overwrite=True, compression=0)
            with MDF(temporary) as mdf:
                group = mdf.groups[0]
                link = int(group.data_group.address) + _DATA_LINK
                cycles = int(group.channel_group.address) + _CYCLES
                size = int(group.channel_group.samples_byte_nr)
            assert size == self._records(one).itemsize, (size, self._records(one).itemsize)
            file = temporary.open("r+b")
            file.seek(0, os.SEEK_END)
            block = -(-file.tell() // 8) * 8
            file.write(bytes(block - file.tell()) + b"##DT" + bytes(4) + _u64(_HEAD) + _u64(0))
            for place, value in ((link, block), (cycles, 0)):
                file.seek(place)
                file.write(_u64(value))
            file.seek(0, os.SEEK_END)
            file.flush()
            self._places = block + _LENGTH, cycles
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
        return file

    def _widen(self, frames: Frames) -> None:
        """The same log with room for 64 bytes of data."""
        assert self._file is not None
        narrow = _record(self._width)
        self.flush()
        begin = self._places[0] - _LENGTH + _HEAD
        old, start, count = self._path.open("rb"), self._start, self._count
        self._file.close()
        self._width = 64
        wider = self._path.with_name(f".{self._path.stem}.wide.mf4")
        with old:
            self._file = self._head(wider, frames)
            shift = start - self._start
            old.seek(begin)
            while count:
                records = np.frombuffer(old.read(min(count, CHUNK) * narrow.itemsize), dtype=narrow)
                count -= len(records)
                wide = np.zeros(len(records), dtype=_record(64))
                wide["time"] = records["time"] + shift
                for name in narrow["frame"].names or ():
                    column = records["frame"][name]
                    wide["frame"][name] = _as_wide(column, 64) if column.ndim == 2 else column
                self._file.write(wide.tobytes())
        self.flush()
        wider.replace(self._path)

    def flush(self) -> None:
        """Records first, then the length of their block, then their count: cut anywhere in between, the file is whole
        up to the flush before."""
        if self._file is None:
            return
        file = self._file
        file.flush()
        end = file.tell()
        length, cycles = self._places
        for place, value in ((length, end - length + _LENGTH), (cycles, self._count)):
            file.seek(place)
            file.write(_u64(value))
            file.flush()
        file.seek(end)

    def close(self) -> None:
        if self._file is not None:
            self.flush()
            self._file.close()


def _u64(value: int) -> bytes:
    return value.to_bytes(8, "little")
