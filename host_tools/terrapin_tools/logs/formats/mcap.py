"""MCAP with frames as JSON on the topic /can."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterator
from pathlib import Path

from terrapin_tools.bounded import bounded
from terrapin_tools.errors import UserError
from terrapin_tools.logs.formats.source import Source, brief, no_frame
from terrapin_tools.logs.frames import Frames

__all__ = ["RAW_TOPIC", "SUFFIXES", "blocks", "holds_frames", "recognises"]

SUFFIXES = (".mcap",)
RAW_TOPIC = "/can"  # frames as they are; one topic more a message, with its signals


def recognises(head: bytes) -> bool | None:
    """The suffix says it."""
    del head
    return None


def holds_frames(path: Path) -> bool:
    """Whether a file is a log, and no table: it has the topic of frames, or none that it tells. OSError."""
    from mcap.exceptions import McapError
    from mcap.reader import SeekingReader

    try:
        with path.open("rb") as file, bounded(path):
            summary = SeekingReader(file, record_size_limit=max(1, path.stat().st_size)).get_summary()
    except (McapError, struct.error, ValueError, KeyError, EOFError, OverflowError, UserError):
        return True  # its reader says what is wrong
    topics = {channel.topic for channel in summary.channels.values()} if summary is not None else set()
    return not topics or RAW_TOPIC in topics


def blocks(source: Source) -> Iterator[Frames]:
    """Frames of the topic."""
    from mcap.exceptions import McapError
    from mcap.records import Channel, Chunk, DataEnd, Message
    from mcap.stream_reader import StreamReader

    from terrapin_tools.logs.packed import check_mcap, chunk_records

    check_mcap(source.path)
    raw: set[int] = set()
    ended = False
    with source.path.open("rb") as file:
        try:
            for record in StreamReader(file, emit_chunks=True, record_size_limit=source.size).records:
                if isinstance(record, DataEnd):
                    ended = True
                    break
                for inner in chunk_records(record) if isinstance(record, Chunk) else (record,):
                    if isinstance(inner, Channel) and inner.topic == RAW_TOPIC:
                        raw.add(inner.id)
                    elif isinstance(inner, Message) and inner.channel_id in raw:
                        value = json.loads(inner.data)
                        data = base64.b64decode(value["data"], validate=True)
                        bus = str(value.get("bus", ""))
                        source.add(inner.log_time * 1e-9, int(value["id"]), data, int(value["flags"]), bus)
                    if source.full:
                        yield source.take()
                        source.told(file.tell())
        except (McapError, struct.error, ValueError, KeyError, TypeError, EOFError, OverflowError) as error:
            if not source.total and not raw:
                raise no_frame(source.path, "an MCAP file") from None
            source.cut = "the end is missing" if source.total else f"unreadable ({brief(error)})"
    if not ended and not source.cut:
        source.cut = "the end is missing"
    yield source.take()
    source.told(source.size)
