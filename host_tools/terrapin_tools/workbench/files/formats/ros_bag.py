"""Bags of ROS 1 (.bag) and ROS 2 (a folder with metadata.yaml): a part for each topic, a column for each number."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.reading import shorten
from terrapin_tools.bounded import room
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.format import Asked, Column, Format, Part, cells

LONGEST = 64  # of an array in a message whose entries become columns
DEEPEST = 8


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
            row = {"time": (stamp - begin) * 1e-9, **dict(_fields(message, "", 0))}
            size += 32 * len(row)
            if size > most:
                raise UserError(f"{path.name}: holds more than {most >> 20} MiB, expected less, or --read topic=TOPIC")
            rows.setdefault(connection.topic, []).append(row)
    notes = (f"left out, as its type is not known: {', '.join(sorted(unknown)[:3])}",) if unknown else ()
    return [Part(topic, _columns(found), {"time": "s"}, 0, notes) for topic, found in rows.items()]


def _fields(message: Any, name: str, depth: int) -> Iterator[tuple[str, Any]]:
    """The numbers and texts in a message by their names, pose.position.x."""
    if dataclasses.is_dataclass(message) and depth < DEEPEST:
        for each in dataclasses.fields(message):
            if each.name != "__msgtype__":
                yield from _fields(getattr(message, each.name), f"{name}.{each.name}".lstrip("."), depth + 1)
    elif isinstance(message, (bool, int, float, str, np.number)):
        yield name, message
    elif isinstance(message, (list, tuple, np.ndarray)) and 0 < len(message) <= LONGEST:
        for i, each in enumerate(message):
            yield from _fields(each, f"{name}.{i}", depth + 1)


def _columns(rows: list[dict[str, Any]]) -> dict[str, Column]:
    names = dict.fromkeys(name for row in rows for name in row)
    found: dict[str, Column] = {}
    for name in names:
        values = [row.get(name) for row in rows]
        if any(isinstance(value, str) for value in values):
            found[name] = cells(values)
        else:
            found[name] = np.array([np.nan if value is None else float(value) for value in values])
    return found


def _is_bag(folder: Path) -> bool:
    return (folder / "metadata.yaml").is_file()


FORMAT = Format("a ROS bag", (".bag",), read, part="topic", package="rosbags", extra="ros", folder=_is_bag)
