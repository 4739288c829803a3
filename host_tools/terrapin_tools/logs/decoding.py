"""Frames to signals by any description that cantools reads (DBC, ARXML, KCD, SYM), whole arrays at a time.

decoder = Decoder(Path("terrapin.dbc"))
decoder.decode(frames)["GROUND"].signals["torque"]      physical values, one a frame
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil import paths
from terrapin_hil.arrays import Array, Index
from terrapin_hil.robots import selected
from terrapin_tools.errors import UserError
from terrapin_tools.logs.frames import EXTENDED, Frames

__all__ = ["Decoded", "Decoder", "Described", "description_of", "in_steps_of"]


EXPECTED = "a DBC file (or ARXML, KCD, SYM)"


def description_of(log: Path) -> tuple[Path, bool]:
    """The terrapin.dbc in the folder `log` or beside the log, and True; else that of this process's robot."""
    beside = (log if log.is_dir() else log.parent) / "terrapin.dbc"
    return (beside, True) if beside.is_file() else (paths.dbc(), False)


def in_steps_of() -> str:
    """What to say of a log that is read with the description of this process's robot, because it has none."""
    return f"in steps of the {selected().name}"


@dataclass(frozen=True)
class Decoded:
    """Frames of one message. Signals that a frame does not carry (multiplexed, cut short) are NaN there."""

    rows: Index  # of the frames that were decoded
    times: Array
    signals: dict[str, Array]


@dataclass(frozen=True)
class Described:
    """What the description says of a signal: unit, meaning, and words for its values ("" and none where it says
    nothing)."""

    name: str
    unit: str
    comment: str
    words: Mapping[int, str]  # raw value -> word
    flag: bool  # one bit that is 0 or 1

    @property
    def text(self) -> str:
        """Meaning and unit in a line."""
        return " ".join(part for part in (f"[{self.unit}]" if self.unit else "", self.comment) if part)


class Decoder:
    """A description of a bus: DBC, ARXML, KCD or SYM. UserError when it is none. `wanted` limits the messages."""

    def __init__(self, dbc: Path, wanted: Collection[str] = ()) -> None:
        import cantools

        if not dbc.is_file():
            raise UserError(f"{dbc}: no such file")
        try:
            database: Any = _load(dbc)
        except (cantools.Error, SyntaxError, LookupError, ValueError, TypeError, AttributeError) as error:
            reason = next(iter(str(error).splitlines()), "") or type(error).__name__
            raise UserError(f"{dbc.name}: {reason[:200]}, expected {EXPECTED}") from None
        if not hasattr(database, "messages"):
            raise UserError(f"{dbc.name}: describes no CAN messages, expected {EXPECTED}")
        self.path = dbc
        self.messages = {
            (m.frame_id, bool(m.is_extended_frame)): m for m in database.messages if not wanted or m.name in wanted
        }

    def units(self, message: str) -> list[tuple[str, str]]:
        """(signal, unit) of a message, by its name."""
        found = next(m for m in self.messages.values() if m.name == message)
        return [(signal.name, signal.unit or "") for signal in found.signals]

    def described(self, message: str) -> list[Described]:
        """The signals of a message, by its name."""
        found = next(m for m in self.messages.values() if m.name == message)
        return [_described(signal) for signal in found.signals]

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


def _described(signal: Any) -> Described:
    plain = float(signal.scale) == 1.0 and float(signal.offset) == 0.0 and not signal.is_float
    words = {int(value): str(word) for value, word in (signal.choices or {}).items()} if plain else {}
    flag = plain and not words and int(signal.length) == 1 and not signal.is_signed
    return Described(str(signal.name), signal.unit or "", " ".join((signal.comment or "").split()), words, flag)


def _load(path: Path) -> Any:
    """cantools' database; its strict check refuses signals that overlap or leave their message, as some that are in use
    do: they are decoded all the same."""
    import cantools

    try:
        return cantools.database.load_file(path)
    except cantools.Error:
        return cantools.database.load_file(path, strict=False)


def _signals(message: Any, data: npt.NDArray[np.uint8], lengths: Index) -> Iterator[tuple[str, Array]]:
    named = {signal.name: signal for signal in message.signals}
    found: dict[str, tuple[npt.NDArray[Any], npt.NDArray[np.bool_]]] = {}

    def raw(signal: Any, depth: int = 0) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_]]:
        """Raw values, and where there are none. With extended multiplexing the selector may be selected itself."""
        if signal.name not in found:
            values, last = _raw(signal, data)
            absent = lengths <= last
            selector = named.get(signal.multiplexer_signal)
            if signal.multiplexer_ids is not None and selector is not None and depth < len(named):
                chosen, missing = raw(selector, depth + 1)
                absent = absent | missing | ~np.isin(chosen, list(signal.multiplexer_ids))
            found[signal.name] = values, absent
        return found[signal.name]

    for signal in message.signals:
        values, absent = raw(signal)
        physical = values.astype(np.float64) * float(signal.scale) + float(signal.offset)
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
