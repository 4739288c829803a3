"""Frames to a log of any kind that `reading` reads.

with LogWriter(path, decoder) as log:
    log.write(frames)

Candump text, BLF, MF4 and MCAP can grow as frames come (growing=True): what stands can then be read after a crash. ASC
and Parquet are whole when they are closed.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from terrapin_tools.errors import UserError
from terrapin_tools.extras import need
from terrapin_tools.logs.candump import line
from terrapin_tools.logs.decoding import Decoder, Described
from terrapin_tools.logs.formats.mcap import RAW_TOPIC
from terrapin_tools.logs.frames import ERROR, EXTENDED, FD, REMOTE, SENT, Frames, writing
from terrapin_tools.logs.mf4 import GrowingMf4, WholeMf4

__all__ = ["BAG", "GROWING", "WRITABLE", "JsonTopics", "LogWriter"]

WRITABLE = (".log", ".blf", ".asc", ".mf4", ".mcap", ".parquet")
BAG = ".rosbag2"  # a folder: a bag of ROS 2, which `reading` does not read
GROWING = (".log", ".blf", ".mf4", ".mcap")  # readable up to the last flush, whatever happens
EVENTS_TOPIC = "/events"
C = TypeVar("C")  # a channel, as its owner has it


class _Writer(Protocol):
    def write(self, frames: Frames) -> None: ...
    def flush(self) -> None: ...
    def close(self) -> None: ...


class LogWriter(AbstractContextManager["LogWriter"]):
    """A log file, by its suffix. `decoder` adds what the frames mean: its description is in the file (MCAP, whole MF4,
    Parquet), and the signals by name, with units, comments and words for values (MCAP, whole MF4). `growing`: readable
    up to the last flush even if it is never closed. UserError (status 1) when it cannot be written."""

    def __init__(self, path: Path, decoder: Decoder | None = None, growing: bool = False) -> None:
        kinds: Mapping[str, Any] = {
            ".log": lambda: _Candump(path),
            ".blf": lambda: _PythonCan(path),
            ".asc": lambda: _PythonCan(path),
            ".mf4": lambda: GrowingMf4(path) if growing else WholeMf4(path, decoder),
            ".mcap": lambda: _Mcap(path, decoder, growing),
            ".parquet": lambda: _Parquet(path, decoder),
            BAG: lambda: _Ros2Bag(path, decoder),
        }
        kind = path.suffix.lower()
        if kind not in kinds:
            raise UserError(f"{path}: unknown kind of log {kind!r}, expected one of {' '.join((*WRITABLE, BAG))}")
        if kind == ".mf4":
            need(f"{path.name}: .mf4", "asammdf", "mf4")
        if kind == BAG:
            need(f"{path.name}: {BAG}", "rosbags", "ros")
        self.path = path
        self._open = True
        with writing(path):
            self._writer: _Writer = kinds[kind]()

    def write(self, frames: Frames) -> None:
        """Appends frames."""
        with writing(self.path):
            self._writer.write(frames)

    def event(self, time: float, text: str) -> None:
        """Notes an event at `time` [s]; kept in MCAP only."""
        if isinstance(self._writer, _Mcap):
            self._writer.event(time, text)

    def flush(self) -> None:
        """What came so far is in the file."""
        with writing(self.path):
            self._writer.flush()

    def close(self) -> None:
        """Ends the file. Closing twice is allowed."""
        if not self._open:
            return
        self._open = False
        with writing(self.path):
            self._writer.close()

    def __exit__(self, *error: object) -> None:
        self.close()


class _Candump:
    def __init__(self, path: Path) -> None:
        self._file = path.open("w", encoding="ascii")

    def write(self, frames: Frames) -> None:
        columns = (frames.times.tolist(), frames.identifiers.tolist(), frames.bus.tolist(), frames.flags.tolist())
        rows = enumerate(zip(*columns, strict=True))
        self._file.writelines(line(t, i, frames.payload(row), f"can{b}", f) + "\n" for row, (t, i, b, f) in rows)

    def flush(self) -> None:
        self._file.flush()

    def close(self) -> None:
        self._file.close()


_OLDEST = 631_152_000.0  # s: BLF has no start before 1990, so times of simulated logs count from 0


class _PythonCan:
    """BLF and ASC by python-can's writers."""

    def __init__(self, path: Path) -> None:
        import can

        self._message = can.Message
        self._writer: Any = can.Logger(str(path))

    def write(self, frames: Frames) -> None:
        if len(frames) and getattr(self._writer, "start_timestamp", 0.0) is None and frames.times[0] < _OLDEST:
            self._writer.start_timestamp = 0.0
        for row in range(len(frames)):
            flags = int(frames.flags[row])
            self._writer.on_message_received(
                self._message(
                    timestamp=float(frames.times[row]),
                    arbitration_id=int(frames.identifiers[row]),
                    is_extended_id=bool(flags & EXTENDED),
                    is_remote_frame=bool(flags & REMOTE),
                    is_error_frame=bool(flags & ERROR),
                    is_fd=bool(flags & FD),
                    is_rx=not flags & SENT,
                    channel=int(frames.bus[row]),
                    data=b"" if flags & REMOTE else frames.payload(row),
                )
            )

    def flush(self) -> None:
        file = self._writer.file
        if hasattr(self._writer, "_flush"):  # BLF holds up to 128 kB back, and writes its start and size when it ends
            self._writer._flush()
            end = file.tell()
            file.seek(0)
            self._writer._write_header(end)
            file.seek(end)
        file.flush()

    def close(self) -> None:
        self._writer.stop()


_RAW_SCHEMA = {
    "type": "object",
    "title": "CAN frame",
    "properties": {
        "id": {"type": "integer"},
        "flags": {"type": "integer", "description": "1 extended, 2 remote, 4 error, 8 CAN FD, 16 sent"},
        "data": {"type": "string", "contentEncoding": "base64"},
        "bus": {"type": "integer", "description": "number of the bus; 0 where it is not given"},
    },
}


class JsonTopics(Generic[C]):
    """Frames as JSON messages by topic: each as it is on /can, and what it means on a topic of its DBC message.

    `channel(topic, schema, metadata)` opens a topic, with the words for values in its schema and units in its metadata;
    `put(channel, time, value)` sends one message, at `time` [s].
    """

    def __init__(
        self,
        decoder: Decoder | None,
        channel: Callable[[str, Mapping[str, Any], Mapping[str, str]], C],
        put: Callable[[C, float, Mapping[str, Any]], None],
    ) -> None:
        self._decoder, self._channel, self._put = decoder, channel, put
        self._raw = channel(RAW_TOPIC, _RAW_SCHEMA, {})
        self._topics: dict[str, C] = {}
        self._whole: dict[str, dict[str, type]] = {}  # message -> signals that are no floats

    def write(self, frames: Frames) -> None:
        """All of them, in their order."""
        decoded: list[tuple[str, dict[str, float]] | None] = [None] * len(frames)
        for message, table in (self._decoder.decode(frames) if self._decoder else {}).items():
            columns = {name: values.tolist() for name, values in table.signals.items()}
            for place, row in enumerate(table.rows.tolist()):
                values = {name: column[place] for name, column in columns.items()}
                decoded[row] = message, {name: value for name, value in values.items() if value == value}
        for row, time in enumerate(frames.times.tolist()):
            raw = base64.b64encode(frames.payload(row)).decode()
            value = {"id": int(frames.identifiers[row]), "flags": int(frames.flags[row]), "data": raw}
            if frames.bus[row]:
                value["bus"] = int(frames.bus[row])
            self._put(self._raw, time, value)
            found = decoded[row]
            if found is not None:
                topic, kinds = self._topic(found[0]), self._whole[found[0]]
                self._put(topic, time, {name: kinds.get(name, float)(value) for name, value in found[1].items()})

    def _topic(self, message: str) -> C:
        if message not in self._topics:
            assert self._decoder is not None
            signals = self._decoder.described(message)
            properties = {signal.name: _property(signal) for signal in signals}
            schema = {"type": "object", "title": message, "properties": properties}
            units = {f"unit.{signal.name}": signal.unit for signal in signals if signal.unit}
            self._topics[message] = self._channel(f"/{message}", schema, units)
            self._whole[message] = {s.name: bool if s.flag else int for s in signals if s.flag or s.words}
        return self._topics[message]


class _Mcap:
    """JSON messages by topic, and the DBC attached."""

    def __init__(self, path: Path, decoder: Decoder | None, growing: bool) -> None:
        from mcap.writer import Writer

        self._file = path.open("wb")
        self._writer: Any = Writer(self._file, use_chunking=not growing)
        self._writer.start(profile="", library="terrapin")
        self._topics = JsonTopics(decoder, self._channel, self._put)
        if decoder is not None:
            self._writer.add_attachment(0, 0, decoder.path.name, "text/plain", decoder.path.read_bytes())
        self._events: int | None = None

    def _channel(self, topic: str, schema: Mapping[str, Any], metadata: Mapping[str, str]) -> int:
        name = str(schema["title"])
        number = self._writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
        return int(self._writer.register_channel(topic, "json", number, dict(metadata)))

    def _put(self, channel: int, time: float, value: Mapping[str, Any]) -> None:
        stamp = round(time * 1e9)
        self._writer.add_message(channel, stamp, json.dumps(value).encode(), stamp)

    def event(self, time: float, text: str) -> None:
        if self._events is None:
            schema = {"type": "object", "title": "event", "properties": {"text": {"type": "string"}}}
            self._events = self._channel(EVENTS_TOPIC, schema, {})
        self._put(self._events, time, {"text": text})

    def write(self, frames: Frames) -> None:
        self._topics.write(frames)

    def flush(self) -> None:
        self._file.flush()

    def close(self) -> None:
        self._writer.finish()
        self._file.close()


def _property(signal: Described) -> dict[str, Any]:
    """A signal in a JSON schema; words for values as Foxglove reads them: `oneOf` with `const` and `title`."""
    if signal.flag:
        return {"type": "boolean", "description": signal.text}
    if signal.words:
        words = [{"title": word, "const": value} for value, word in sorted(signal.words.items())]
        return {"type": "integer", "oneOf": words, "description": signal.text}
    return {"type": "number", "description": signal.text}


class _Parquet:
    def __init__(self, path: Path, decoder: Decoder | None) -> None:
        import pyarrow.parquet

        self._arrow = pyarrow
        self._schema = pyarrow.schema(
            [
                ("time", pyarrow.float64()),
                ("id", pyarrow.uint32()),
                ("data", pyarrow.binary()),
                ("flags", pyarrow.uint8()),
                ("bus", pyarrow.uint8()),
            ],
            {"unit.time": "s", **({"dbc": decoder.path.read_bytes()} if decoder is not None else {})},
        )
        self._writer = pyarrow.parquet.ParquetWriter(path, self._schema)

    def write(self, frames: Frames) -> None:
        payloads = [frames.payload(row) for row in range(len(frames))]
        columns = [frames.times, frames.identifiers.astype(np.uint32), payloads, frames.flags, frames.bus]
        arrays = [self._arrow.array(c, type=f.type) for c, f in zip(columns, self._schema, strict=True)]
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))

    def flush(self) -> None:
        pass  # not before close

    def close(self) -> None:
        self._writer.close()


_FRAME = """std_msgs/Header header
uint32 id
bool is_rtr
bool is_extended
bool is_error
uint8 dlc
uint8[8] data
"""


class _Ros2Bag:
    """A bag of ROS 2 (MCAP inside): frames as can_msgs/Frame on /can, and a topic for each message of the DBC. Its type
    terrapin_msgs/NAME has the words for values as constants, and units in its comments and in the bag's metadata."""

    def __init__(self, path: Path, decoder: Decoder | None) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self._decoder = decoder
        self._store: Any = get_typestore(Stores.ROS2_HUMBLE)
        self._types_of = get_types_from_msg
        self._writer: Any = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.open()
        self._frames = self._connection("/can", "can_msgs/msg/Frame", _FRAME)
        self._topics: dict[str, tuple[Any, dict[str, type]]] = {}

    def _connection(self, topic: str, kind: str, text: str) -> Any:
        self._store.register(self._types_of(text, kind))
        hashed = self._store.hash_rihs01(kind)
        own, _ = self._store.generate_msgdef(kind)
        text += own[own.index("=" * 80) :] if "=" * 80 in own else ""  # the types inside
        return self._writer.add_connection(topic, kind, msgdef=text, rihs01=hashed)

    def _topic(self, message: str) -> tuple[Any, dict[str, type]]:
        if message not in self._topics:
            assert self._decoder is not None
            lines: list[str] = []
            kinds: dict[str, type] = {}
            for signal in self._decoder.described(message):
                kinds[signal.name] = bool if signal.flag else int if signal.words else float
                for value, word in sorted(signal.words.items()) if not signal.flag else ():
                    lines.append(f"int32 {signal.name}_{word}={value}".upper().replace("INT32", "int32", 1))
                kind = {bool: "bool", int: "int32", float: "float64"}[kinds[signal.name]]
                lines.append(f"{kind} {signal.name} # {signal.text}".rstrip(" #"))
                if signal.unit:
                    self._writer.set_custom_data(f"unit.{message}.{signal.name}", signal.unit)
            name = "".join(part.capitalize() for part in message.split("_"))
            connection = self._connection(f"/{message.lower()}", f"terrapin_msgs/msg/{name}", "\n".join(lines) + "\n")
            self._topics[message] = connection, kinds
        return self._topics[message]

    def _put(self, connection: Any, stamp: int, **values: Any) -> None:
        message = self._store.types[connection.msgtype](**values)
        self._writer.write(connection, stamp, self._store.serialize_cdr(message, connection.msgtype))

    def write(self, frames: Frames) -> None:
        types = self._store.types
        for row, time in enumerate(frames.times.tolist()):
            flags, payload, stamp = int(frames.flags[row]), frames.payload(row), round(time * 1e9)
            if len(payload) > 8:
                raise UserError(
                    f"frame of {len(payload)} bytes at {time:.6f} s: a bag's can_msgs/Frame holds at most 8"
                )
            at = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
            header = types["std_msgs/msg/Header"](stamp=at, frame_id=f"can{frames.bus[row]}")
            data = np.frombuffer(payload.ljust(8, b"\0"), dtype=np.uint8)
            self._put(
                self._frames, stamp, header=header, id=int(frames.identifiers[row]), is_rtr=bool(flags & REMOTE),
                is_extended=bool(flags & EXTENDED), is_error=bool(flags & ERROR), dlc=len(payload), data=data,
            )  # fmt: skip
        for message, table in (self._decoder.decode(frames) if self._decoder else {}).items():
            connection, kinds = self._topic(message)
            columns = {name: values.tolist() for name, values in table.signals.items()}
            for place, row in enumerate(table.rows.tolist()):
                values = {
                    name: kind(columns[name][place]) if columns[name][place] == columns[name][place] else kind(0)
                    for name, kind in kinds.items()
                }
                self._put(connection, round(float(frames.times[row]) * 1e9), **values)

    def flush(self) -> None:
        pass  # not before close

    def close(self) -> None:
        self._writer.close()
