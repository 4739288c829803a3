"""Packed parts of logs, unpacked no further than they state: containers of BLF, chunks of MCAP, blocks of MF4."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import can
from can.io.blf import BLFReader

from terrapin_tools.bounded import check, most

__all__ = ["BoundedBLF", "check_blf", "check_mcap", "chunk_records", "unpacked"]

PIECE = 1 << 20
MOST_CHUNK = 64 << 20  # bytes of an MCAP chunk: what writes it keeps one in memory, and chooses some MB
_OBJECT = struct.Struct("<4sHHII")  # of BLF: LOBJ, size of the header, its version, size of all, kind
_CONTAINER, _DEFLATE = 10, 2
_CHUNK = 6  # an MCAP record: times of its first and last message, bytes unpacked, ...
_DATA_END = struct.pack("<BQI", 15, 4, 0)


def unpacked(how: str, data: bytes, limit: int) -> bytes:
    """At most `limit` + 1 bytes of what was packed by deflate, zstd or lz4. ValueError for what is damaged."""
    if how == "deflate":
        try:
            return zlib.decompressobj().decompress(data, limit + 1)
        except zlib.error as error:
            raise ValueError(str(error)) from None
    if how == "zstd":
        import zstandard

        try:
            with zstandard.ZstdDecompressor().stream_reader(data) as stream:
                return bytes(stream.read(limit + 1))
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from None
    if how == "lz4":
        import lz4.frame

        try:
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, limit + 1))
        except (RuntimeError, EOFError) as error:
            raise ValueError(str(error)) from None
    raise ValueError(f"packed by {how[:20]!r}, expected zstd or lz4")


def check_blf(path: Path) -> None:
    """UserError when the containers hold more than they may. They state no size that holds: each is looked through."""
    total, limit = 0, most(path.stat().st_size)
    with path.open("rb") as file:
        head = file.read(8)
        if len(head) < 8 or head[:4] != b"LOGG":
            return  # its reader says so
        file.seek(int.from_bytes(head[4:], "little"))
        while len(head := file.read(_OBJECT.size)) == _OBJECT.size and total <= limit:
            mark, _, _, size, kind = _OBJECT.unpack(head)
            if mark != b"LOBJ":
                break
            if size < _OBJECT.size:  # python-can reads the rest of the file as its content
                size = path.stat().st_size
            if kind == _CONTAINER:
                total += _inflated(file, size - _OBJECT.size, limit - total)
            else:
                file.seek(size - _OBJECT.size, io.SEEK_CUR)
            file.seek(size % 4, io.SEEK_CUR)
    check(path, total)


def _inflated(file: BinaryIO, size: int, limit: int) -> int:
    """The bytes of a container that are read from `file`: how many it has unpacked, counted up to `limit` and some."""
    method = int.from_bytes(file.read(min(16, size))[:2], "little")
    left, count, inflater = size - 16, 0, zlib.decompressobj()
    while left > 0 and (data := file.read(min(PIECE, left))):
        left -= len(data)
        while method == _DEFLATE and data and count <= limit and not inflater.eof:
            try:
                count += len(inflater.decompress(data, PIECE))
            except zlib.error:
                method = 0  # its reader says so
                break
            data = inflater.unconsumed_tail
        count += len(data) if method != _DEFLATE else 0
    return count


class BoundedBLF(BLFReader):
    """python-can's reader, which takes an object of 0 bytes again and again (4.6, `_parse_data`)."""

    def _parse_container(self, data: bytes) -> Iterator[can.Message]:
        whole, at = self._tail + data, 0
        while (at := whole.find(b"LOBJ", at, at + 8)) >= 0 and at + _OBJECT.size <= len(whole):
            size = _OBJECT.unpack_from(whole, at)[3]
            if size < _OBJECT.size:
                yield from super()._parse_container(data[: at - len(self._tail)])
                raise ValueError(f"an object of {size} bytes, expected at least {_OBJECT.size}")
            at += size
        yield from super()._parse_container(data)


def check_mcap(path: Path) -> None:
    """UserError when the chunks state more bytes than they may hold."""
    size, total = path.stat().st_size, 0
    with path.open("rb") as file:
        file.seek(8)
        while len(head := file.read(9)) == 9:
            kind, length = struct.unpack("<BQ", head)
            if kind == _CHUNK and len(times := file.read(24)) == 24:
                total += int.from_bytes(times[16:], "little")
                length -= 24
            if length < 0 or file.tell() + length > size:
                break
            file.seek(length, io.SEEK_CUR)
    check(path, total)


def chunk_records(chunk: Any) -> Iterator[Any]:
    """The records in an MCAP chunk. ValueError when it is damaged, or holds another number of bytes than it states."""
    from mcap.records import DataEnd
    from mcap.stream_reader import StreamReader

    stated, data = chunk.uncompressed_size, chunk.data
    if chunk.compression:
        if stated > max(MOST_CHUNK, 4 * len(data)):
            raise ValueError(f"a chunk of {stated >> 20} MiB, expected at most {MOST_CHUNK >> 20}")
        data = unpacked(chunk.compression, data, stated)
    if len(data) != stated:
        raise ValueError(
            f"a chunk of {'more' if len(data) > stated else 'less'} than the {stated} bytes that it states"
        )
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("a chunk with another checksum than it states")
    inside = StreamReader(io.BytesIO(data + _DATA_END), skip_magic=True, record_size_limit=len(data))
    for record in inside.records:
        if isinstance(record, DataEnd):
            return
        yield record
