"""CAN logs as candump text: `(12.345000) can0 182#0011223344556677`, one frame a line.

>>> line(12.345, 0x182, bytes([0, 0xFF]))
'(12.345000) can0 182#00FF'
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array
from terrapin_hil.messages import Interface
from terrapin_hil.telemetry import decode
from terrapin_tools.errors import UserError
from terrapin_tools.logs.frames import ERROR, EXTENDED, FD, REMOTE, SENT, Frames, frames, joined

__all__ = ["Form", "blocks", "line", "lines", "read", "telemetry"]


BLOCK = 4 << 20  # bytes of text taken at once

# ID#DATA, ID#R (remote), ID##FDATA (CAN FD, with a digit of flags); candump -x adds the direction.
_LINE = re.compile(
    rb"^\((\d+(?:\.\d+)?)\)[ \t]+(\S+)[ \t]+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#"
    rb"(?:(R)\d?|(#[0-9A-Fa-f])?((?:[0-9A-Fa-f]{2}){0,64}))(?:[ \t]+([RT]))?[ \t\r]*$",
    re.MULTILINE,
)
# As candump prints it on a screen: stamp (-t), channel, direction and flags (-x), ID, [length], data.
_SCREEN = re.compile(
    rb"^[ \t]*(?:\(([^)]*)\)[ \t]+)?(\S+)[ \t]+(?:([RT])X [-BE ]{3}[ \t]+)?([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})[ \t]+"
    rb"\[(\d+)\]((?:[ \t]+[0-9A-Fa-f]{2})*)(?:[ \t]+(remote request|ERRORFRAME))?[ \t]*(?:'.*')?[ \t\r]*$",
    re.MULTILINE,
)
# Of -td (between frames) and -tz (from the first frame on); -ta has ten digits.
_SHORT = re.compile(rb"^[ \t]*\((\d{3,9}\.\d{6})\)", re.MULTILINE)
_EXPLAINED = re.compile(rb"^\t[ \t]*[a-z][^\r\n]*(?=\r?$)", re.MULTILINE)  # of an error frame, by candump -e
STEPS_BACK = 0.1  # share of short stamps that do not rise: from it on they are times between frames
_ERROR_FRAME = 0x2000_0000  # as the kernel marks them, in an identifier of 8 digits


@dataclass
class Form:
    """How a log is written: found at its beginning, and told. `bus` numbers the buses by name."""

    bus: Callable[[str], int] = lambda _: 0
    assumed: list[str] = field(default_factory=list)
    untimed: bool = False
    delta: bool | None = None  # times between frames (candump -td)
    time: float = 0.0  # so far [s], of times between frames

    def look(self, text: bytes) -> None:
        """At the first block. On one bus, two frames cannot have the same time, and only mishaps let one step back: if
        many do, the stamps are the times between frames."""
        stamps = [float(stamp) for stamp in _SHORT.findall(text)]
        steps = np.diff(stamps)
        short = len(stamps) > 1 and len(stamps) == text.count(b"(")
        self.delta = short and bool((steps <= 0).mean() >= STEPS_BACK)
        if self.delta:
            self.assumed.append("times are those between frames (candump -td): summed")

    def tell(self, what: str) -> None:
        """Once."""
        if what not in self.assumed:
            self.assumed.append(what)

    def summed(self, block: Frames) -> Frames:
        """Times from the first frame on."""
        if not self.delta or not len(block):
            return block
        times = self.time + np.cumsum(block.times)
        self.time = float(times[-1])
        return replace(block, times=times)


def line(time: float, identifier: int, data: bytes, channel: str = "can0", flags: int = 0) -> str:
    """One frame, without the end of line. `flags` as in Frames."""
    if flags & ERROR:
        identifier |= _ERROR_FRAME
    name = f"{identifier:08X}" if flags & (EXTENDED | ERROR) else f"{identifier:03X}"
    body = "R" if flags & REMOTE else f"#0{data.hex().upper()}" if flags & FD else data.hex().upper()
    return f"({time:.6f}) {channel} {name}#{body}{' T' if flags & SENT else ''}"


def lines(records: npt.NDArray[Any], first_tick: int, channel: str = "can0") -> str:
    """Rows of a simulator's log (terrapin_hil.simulation) as text: per tick what the host sent, then the answers."""
    tick, place = np.nonzero(_there(records))
    frames = np.concatenate([records["host"], records["answer"]], axis=1)[tick, place]
    hexes = frames["data"].tobytes().hex().upper()
    stamps = [f"({number / 1000:.6f}) {channel} " for number in range(first_tick, first_tick + len(records))]
    rows = zip(tick.tolist(), frames["id"].tolist(), frames["length"].tolist(), range(0, len(hexes), 16), strict=True)
    return "".join(f"{stamps[i]}{name:03X}#{hexes[at : at + 2 * length]}\n" for i, name, length, at in rows)


def _there(records: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Which places for frames are used, first the host's, then the answers' (ticks, places)."""
    places = [
        np.arange(records[who].shape[1]) < records[f"{who}_count"].astype(np.int64)[:, None]
        for who in ("host", "answer")
    ]
    return np.concatenate(places, axis=1)


def blocks(path: Path, told: Callable[[int], None] = lambda _: None, form: Form | None = None) -> Iterator[Frames]:
    """All frames of a log, some ten thousand at a time; `told` gets the bytes read so far.

    A last line without its end is one that a crash cut off and is left out. UserError names file and line of what is
    no candump text. `form` gets how it is written.
    """
    form = form or Form()
    number, done, rest = 1, 0, b""
    with path.open("rb") as file:
        while piece := file.read(BLOCK):
            done += len(piece)
            text = rest + piece
            end = text.rfind(b"\n") + 1
            if end == 0 and len(text) > BLOCK:
                raise _no_candump(path, number, text)
            text, rest = text[:end], text[end:]
            if end:
                if form.delta is None:
                    form.look(text)
                yield form.summed(_parse(path, text, number, form))
            number += text.count(b"\n")
            told(done)


def _parse(path: Path, text: bytes, first: int, form: Form) -> Frames:
    text = _EXPLAINED.sub(b"", text)
    if _SCREEN.match(text.lstrip(b"\r\n")):
        text = _as_log(path, text, first, form)
    rows = _LINE.findall(text)
    if len(rows) != text.count(b"\n"):  # empty lines, or something else
        for number, row in enumerate(text.split(b"\n"), first):
            if row.strip() and not _LINE.fullmatch(row):
                raise _no_candump(path, number, row)
    times, channels, names, remote, fd, body, sent = zip(*rows, strict=True) if rows else ((),) * 7
    if not any(fd):
        long = next((i for i, hexes in enumerate(body) if len(hexes) > 16), None)
        if long is not None:
            raise _no_candump(path, first + long, b"%s#%s" % (names[long], body[long]))
    identifiers = [int(name, 16) for name in names]
    flags = [
        (EXTENDED if len(name) == 8 else 0) | (REMOTE if r else 0) | (FD if f else 0) | (SENT if s == b"T" else 0)
        for name, r, f, s in zip(names, remote, fd, sent, strict=True)
    ]
    for i, identifier in enumerate(identifiers):
        if identifier & _ERROR_FRAME:
            flags[i] = flags[i] & ~EXTENDED | ERROR
            identifiers[i] = identifier & ~_ERROR_FRAME
    stamps = np.array(times, dtype="S").astype(np.float64) if times else np.zeros(0)
    numbers = {channel: form.bus(channel.decode("utf-8", "replace")) for channel in dict.fromkeys(channels)}
    payloads = [bytes.fromhex(hexes.decode()) for hexes in body]
    return frames(path, stamps, identifiers, payloads, flags, [numbers[channel] for channel in channels])


def _as_log(path: Path, text: bytes, first: int, form: Form) -> bytes:
    """Lines of a screen as candump -l writes them, line by line. Without stamps all times are 0; dates are of UTC."""
    found = []
    for number, row in enumerate(text.splitlines(), first):
        parts = _SCREEN.fullmatch(row)
        if parts is None and row.strip():
            raise _no_candump(path, number, row)
        if parts is None:
            found.append(b"")
            continue
        stamp, channel, sent, name, length, data, kind = parts.groups()
        body = b"".join(data.split())
        if kind == b"remote request":
            body = b"R"
        elif len(body) != 2 * int(length):
            raise _no_candump(path, number, row)
        elif len(length) == 2:  # two digits: CAN FD
            body = b"#0" + body
        seconds = b"%.6f" % _seconds(path, number, stamp, row, form)
        found.append(b"(%s) %s %s#%s%s" % (seconds, channel, name, body, b" T" if sent == b"T" else b""))
    return b"\n".join([*found, b""])


def _seconds(path: Path, number: int, stamp: bytes | None, row: bytes, form: Form) -> float:
    if stamp is None:
        form.untimed = True
        form.tell("found no time stamps (candump without -t): all times are 0")
        return 0.0
    try:
        return float(stamp)
    except ValueError:
        pass
    try:
        seconds = datetime.fromisoformat(stamp.decode()).replace(tzinfo=UTC).timestamp()
        form.tell("dates are taken as those of UTC")
        return seconds
    except ValueError:
        raise _no_candump(path, number, row) from None


def _no_candump(path: Path, number: int, row: bytes) -> UserError:
    found = row[:60].decode("ascii", "replace")
    return UserError(f"{path}:{number}: found {found!r}, expected candump text: (seconds) channel ID#DATA")


def read(path: Path) -> Frames:
    """All data frames of a log; error and remote frames are left out. As `blocks`, at once."""
    return joined(path, list(blocks(path))).data_frames


def telemetry(log: Frames, interface: Interface) -> Mapping[str, dict[str, Array]]:
    """Message -> signal (and "time") -> array in SI units, for the frames that the controller's interface knows.

    UserError when one of them has another length than its message: it is damaged, or another version's.
    """
    for message in interface.messages.values():
        wrong = np.flatnonzero((log.identifiers == message.id) & (log.lengths != message.length))
        if wrong.size:
            raise UserError(
                f"{log.path}: {message.name} at {log.times[wrong[0]]:.6f} s: "
                f"found {log.lengths[wrong[0]]} bytes, expected {message.length}"
            )
    return decode(interface, log.times, log.identifiers, log.data[:, :8])
