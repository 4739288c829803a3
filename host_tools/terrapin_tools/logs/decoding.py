"""Frames to signals by any DBC, whole arrays at a time.

decoder = Decoder(Path("terrapin.dbc"))
decoder.decode(frames)["GROUND"].signals["torque"]      physical values, one a frame
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array, Index
from terrapin_tools.errors import UserError
from terrapin_tools.logs.frames import EXTENDED, Frames

__all__ = ["Decoded", "Decoder"]


@dataclass(frozen=True)
class Decoded:
    """Frames of one message. Signals that a frame does not carry (multiplexed, cut short) are NaN there."""

    rows: Index  # of the frames that were decoded
    times: Array
    signals: dict[str, Array]


class Decoder:
    """A DBC. UserError when it is none. `wanted` limits the messages."""

    def __init__(self, dbc: Path, wanted: Collection[str] = ()) -> None:
        import cantools

        if not dbc.is_file():
            raise UserError(f"{dbc}: no such file")
        try:
            database: Any = cantools.database.load_file(dbc)
        except (cantools.Error, UnicodeDecodeError, ValueError) as error:
            raise UserError(f"{dbc.name}: {str(error).splitlines()[0]}, expected a DBC file") from None
        if not hasattr(database, "messages"):
            raise UserError(f"{dbc.name}: describes no CAN messages, expected a DBC file")
        self.path = dbc
        self.messages = {
            (m.frame_id, bool(m.is_extended_frame)): m for m in database.messages if not wanted or m.name in wanted
        }

    def units(self, message: str) -> list[tuple[str, str]]:
        """(signal, unit) of a message, by its name."""
        found = next(m for m in self.messages.values() if m.name == message)
        return [(signal.name, signal.unit or "") for signal in found.signals]

    def decode(self, frames: Frames) -> dict[str, Decoded]:
        """Message -> its signals, for those that the DBC knows and the log has. Remote and error frames are not
        decoded, nor frames too short for any signal."""
        usable = frames.flags & 0b110 == 0
        key = frames.identifiers * 2 + (frames.flags & EXTENDED)
        found = {}
        for (identifier, extended), message in self.messages.items():
            rows = np.flatnonzero((key == identifier * 2 + extended) & usable)
            if rows.size:
                signals = dict(_signals(message, frames.data[rows], frames.lengths[rows]))
                found[str(message.name)] = Decoded(rows, frames.times[rows], signals)
        return found


def _signals(message: Any, data: npt.NDArray[np.uint8], lengths: Index) -> Iterator[tuple[str, Array]]:
    raw: dict[str, npt.NDArray[Any]] = {}
    for signal in sorted(message.signals, key=lambda s: not s.is_multiplexer):
        values, last = _raw(signal, data)
        raw[signal.name] = values
        physical = values.astype(np.float64) * float(signal.scale) + float(signal.offset)
        absent = lengths <= last
        if signal.multiplexer_ids is not None:
            selector = raw.get(signal.multiplexer_signal)
            if selector is not None:
                absent = absent | ~np.isin(selector, list(signal.multiplexer_ids))
        physical[absent] = np.nan
        yield signal.name, physical


def _raw(signal: Any, data: npt.NDArray[np.uint8]) -> tuple[npt.NDArray[Any], int]:
    """Raw values and the last byte that they need."""
    length = int(signal.length)
    if signal.byte_order == "little_endian":
        first, shift = divmod(int(signal.start), 8)
        last = (int(signal.start) + length - 1) // 8
        order = "<u8"
    else:  # start is the most significant bit; bits of a byte count down, bytes up
        first, bit = divmod(int(signal.start), 8)
        last = first + (length - bit - 1 + 7) // 8 if length > bit + 1 else first
        shift = (last - first + 1) * 8 - (7 - bit) - length
        order = ">u8"
    width = last - first + 1
    if last >= data.shape[1]:
        return np.zeros(len(data), dtype=np.int64), last
    if width <= 8:
        window = np.zeros((len(data), 8), dtype=np.uint8)
        if order == "<u8":
            window[:, :width] = data[:, first : last + 1]
        else:
            window[:, 8 - width :] = data[:, first : last + 1]
        words = window.view(order).reshape(-1) >> np.uint64(shift)
    else:  # 9 bytes: a long signal that does not begin with a byte
        bits = np.unpackbits(data[:, first : last + 1], axis=1, bitorder="little" if order == "<u8" else "big")
        begin = shift if order == "<u8" else width * 8 - shift - length
        chosen = bits[:, begin : begin + length]
        chosen = chosen if order == "<u8" else chosen[:, ::-1]
        powers = np.uint64(1) << np.arange(length, dtype=np.uint64)
        words = (chosen.astype(np.uint64) * powers).sum(axis=1, dtype=np.uint64)
    words = words & np.uint64((1 << length) - 1)
    if signal.is_float:
        kind = {16: ("<u2", "<f2"), 32: ("<u4", "<f4"), 64: ("<u8", "<f8")}[length]
        with np.errstate(invalid="ignore"):  # signalling NaN
            return words.astype(kind[0]).view(kind[1]).astype(np.float64), last
    if signal.is_signed:
        if length < 64:
            words = np.where(words >> np.uint64(length - 1) != 0, words | ~np.uint64((1 << length) - 1), words)
        return words.astype(np.uint64).view(np.int64), last
    return words, last
