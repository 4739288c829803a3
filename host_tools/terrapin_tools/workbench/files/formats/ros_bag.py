"""Bags of ROS 1 (.bag) and ROS 2 (a folder with metadata.yaml): a part for each topic, a column for each number."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from terrapin_hil.reading import shorten
from terrapin_tools.bounded import room
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import Asked, Format, Part
from terrapin_tools.workbench.files.trees.messages import columns, fields


def read(path: Path, asked: Asked, texts: Collection[str]) -> list[Part]:
    """`time` [s] is that at which a message was recorded, since the bag's first. UserError beyond its bound."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    rows: dict[str, list[dict[str, Any]]] = {}
    unknown: set[str] = set()
    size, most = 0, room(path)
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        chosen = [c for c in reader.connections if asked.part in ("", "*", c.topic)]
        if not chosen:
            topics = ", ".join(sorted({c.topic for c in reader.connections}))
            raise UserError(f"{path.name}: topic: found {shorten(asked.part)}, expected one of {topics}")
        begin = reader.start_time
        for connection, stamp, raw in reader.messages(connections=chosen):
            try:
                message = reader.deserialize(raw, connection.msgtype)
            except KeyError:
                unknown.add(f"{connection.topic} ({connection.msgtype})")
                continue
            row = {"time": (stamp - begin) * 1e-9, **dict(fields(message))}
            size += 32 * len(row)
            if size > most:
                raise UserError(f"{path.name}: holds more than {most >> 20} MiB, expected less, or --read topic=TOPIC")
            rows.setdefault(connection.topic, []).append(row)
    notes = (f"left out, as its type is not known: {', '.join(sorted(unknown)[:3])}",) if unknown else ()
    return [Part(topic, columns(found), {"time": "s"}, 0, notes) for topic, found in rows.items()]


def _is_bag(folder: Path) -> bool:
    return (folder / "metadata.yaml").is_file()


FORMAT = Format("a ROS bag", (".bag",), read, part="topic", package="rosbags", extra="ros", folder=_is_bag)
