"""python-can's SQLite: the table `messages`. It is opened for reading only."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from urllib.parse import quote

from terrapin_tools.errors import UserError
from terrapin_tools.logs.formats.source import Source
from terrapin_tools.logs.frames import ERROR, EXTENDED, FD, REMOTE, Frames

__all__ = ["SUFFIXES", "blocks", "recognises"]

SUFFIXES = (".db",)
MOST = 1 << 20  # bytes of a value
COLUMNS = "ts, arbitration_id, extended, remote, error, data"


def recognises(head: bytes) -> bool | None:
    """By SQLite's first bytes."""
    return head.startswith(b"SQLite format 3\0")


def blocks(source: Source) -> Iterator[Frames]:
    """Frames in the order in which they were written."""
    try:
        connection = sqlite3.connect(f"file:{quote(str(source.path.resolve()))}?mode=ro", uri=True, timeout=5.0)
    except sqlite3.Error as error:
        raise UserError(f"{source.path}: {error}, expected python-can's SQLite") from None
    try:
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST)
        kind = connection.execute("SELECT type FROM sqlite_master WHERE name = 'messages'").fetchone()
        if kind is not None and kind != ("table",):  # a view may go on for ever
            raise UserError(f"{source.path}: messages is a {str(kind[0])[:20]}, expected python-can's SQLite: a table")
        found = connection.execute(f"SELECT {COLUMNS} FROM messages ORDER BY rowid")
        for number, (time, name, extended, remote, mistake, data) in enumerate(found, 1):
            if not (isinstance(time, float | int) and isinstance(name, int) and isinstance(data, bytes | None)):
                source.passed(0, f"the first is number {number}")
                continue
            flags = (EXTENDED if extended else 0) | (REMOTE if remote else 0) | (ERROR if mistake else 0)
            body = b"" if remote or data is None else data
            if not 0 <= name < 1 << 29 or len(body) > 64:
                source.passed(0, f"the first is number {number}")
                continue
            source.add(float(time), name, body, flags | (FD if len(body) > 8 else 0))
            if source.full:
                yield source.take()
    except (sqlite3.Error, UnicodeDecodeError) as error:  # the latter of what SQLite says of a damaged schema
        if not source.total:
            raise UserError(f"{source.path}: {error}, expected python-can's SQLite: a table messages") from None
        source.cut = f"unreadable after {source.last:.6f} s ({error})"
    finally:
        connection.close()
    yield source.take()
