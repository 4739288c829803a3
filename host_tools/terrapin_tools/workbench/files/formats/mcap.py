"""MCAP of JSON messages: a part for each topic, a column for each number in a message. Logs of frames are logs/'s."""

from __future__ import annotations

import json
import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.reading import shorten
from terrapin_tools.bounded import each, refuse_beyond
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import Asked, Column, Format, Part
from terrapin_tools.workbench.files.trees.messages import columns, fields

STAMP = ""  # of a row: when it was logged [ns]
UNIT = "unit."  # of a column, in the metadata of the channel: `unit.torque`


def read(path: Path, asked: Asked, texts: Collection[str]) -> list[Part]:
    """`time` [s] is that of the log, since its first message. UserError for no JSON, and for a damaged end."""
    from mcap.exceptions import McapError
    from mcap.records import Channel, Message

    from terrapin_tools.logs.packed import check_mcap

    check_mcap(path)
    channels: dict[int, Any] = {}
    rows: dict[str, list[dict[str, Any]]] = {}
    units: dict[str, dict[str, str]] = {}
    other: dict[str, str] = {}
    size, begin = 0, None
    try:
        for record in each(path, _records(path)):
            if isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                begin = record.log_time if begin is None else min(begin, record.log_time)
                if channel.message_encoding != "json":
                    other[channel.topic] = channel.message_encoding
                    continue
                if asked.part not in ("", "*", channel.topic):
                    continue
                row = {STAMP: record.log_time, **dict(fields(json.loads(record.data)))}
                size += 32 * len(row)
                refuse_beyond(path, size)
                rows.setdefault(channel.topic, []).append(row)
                units[channel.topic] = {
                    key.removeprefix(UNIT): unit for key, unit in channel.metadata.items() if key.startswith(UNIT)
                }
    except (McapError, struct.error, EOFError, KeyError, RecursionError) as error:
        raise UserError(f"{path.name}: is cut off or damaged ({error or type(error).__name__})") from None
    if other and not rows:
        topic, kind = next(iter(other.items()))
        raise UserError(f"{path.name}: topic {shorten(topic)} is encoded as {shorten(kind)}, expected json")
    notes = (f"left out, as they are no JSON: {', '.join(sorted(other)[:3])}",) if other else ()
    return [
        Part(topic, columns, {next(iter(columns)): "s", **units[topic]}, 0, notes)
        for topic, columns in ((topic, _columns(found, begin or 0)) for topic, found in rows.items())
    ]


def _records(path: Path) -> Iterator[Any]:
    from mcap.records import Chunk, DataEnd
    from mcap.stream_reader import StreamReader

    from terrapin_tools.logs.packed import chunk_records

    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True, record_size_limit=path.stat().st_size).records:
            if isinstance(record, DataEnd):
                return
            yield from chunk_records(record) if isinstance(record, Chunk) else (record,)
    raise EOFError("the end is missing")


def _columns(rows: list[dict[str, Any]], begin: int) -> dict[str, Column]:
    """Those of the messages after the time of the log, whose name gives way to a message's own."""
    found = columns([{name: value for name, value in row.items() if name != STAMP} for row in rows])
    stamp = "time" if "time" not in found else "log_time"
    return {stamp: np.array([(row[STAMP] - begin) * 1e-9 for row in rows]), **found}


FORMAT = Format("an MCAP file", (".mcap",), read, part="topic")
