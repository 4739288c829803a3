"""Small files that unpack to gigabytes, or whose blocks never end, at every reader of packed logs and tables."""

from __future__ import annotations

import random
import shutil
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from tests.attack import Result
from tests.attack.forked import Outcome, counted, run

COUNT, SHORT = 40, 2  # of each reader
MEMORY, SECONDS = 1 << 30, 10.0  # that a command may take
ZEROS = bytes(1 << 20)


def frames_log(path: Path, rows: int = 500) -> Path:
    """A whole log of that kind: some messages of a bus."""
    from terrapin_tools.logs.frames import frames
    from terrapin_tools.logs.writing import LogWriter

    some = frames(
        path, np.arange(rows) * 1e-3, [0x180 + i % 4 for i in range(rows)],
        [bytes([i & 255, i >> 8, 3, 4, 5, 6, 7, 8]) for i in range(rows)], [0] * rows,
    )  # fmt: skip
    with LogWriter(path) as log:
        log.write(some)
    return path


def packed_zeros(how: str, mebibytes: int, piece: bytes = ZEROS) -> bytes:
    """`piece`, a MiB, over and over."""
    if how == "zstd":
        import zstandard

        packer = zstandard.ZstdCompressor(level=3).compressobj()
        return b"".join([*(packer.compress(piece) for _ in range(mebibytes)), packer.flush()])
    if how == "lz4":
        import lz4.frame

        lz = lz4.frame.LZ4FrameCompressor()
        return b"".join([lz.begin(), *(lz.compress(piece) for _ in range(mebibytes)), lz.flush()])
    deflate = zlib.compressobj(9)
    return b"".join([*(deflate.compress(piece) for _ in range(mebibytes)), deflate.flush()])


def _mcap_message() -> bytes:
    text = b'{"id": 384, "data": "AAAAAAAAAAA=", "flags": 0}'
    body = struct.pack("<HIQQ", 1, 0, 0, 0) + text
    return struct.pack("<BQ", 5, len(body)) + body


def _mcap(path: Path, draw: random.Random) -> None:
    """Chunks of zeros or of messages, sizes that are true or not, records that claim all memory."""

    def text(words: bytes) -> bytes:
        return struct.pack("<I", len(words)) + words

    def record(kind: int, body: bytes, length: int | None = None) -> bytes:
        return struct.pack("<BQ", kind, len(body) if length is None else length) + body

    how = draw.choice(["zstd", "lz4"])
    size = draw.choice([20, 96, 300])
    message = _mcap_message()
    piece = draw.choice([ZEROS, (message * (len(ZEROS) // len(message) + 1))[: len(ZEROS)]])
    data = packed_zeros(how, size, piece)
    stated = draw.choice([size << 20, 100, 1 << 60, (size << 20) + 1])
    chunk = struct.pack("<QQQI", 0, 1, stated, 0) + text(how.encode()) + struct.pack("<Q", len(data)) + data
    channel = struct.pack("<HH", 1, 0) + text(b"/can") + text(b"json") + struct.pack("<I", 0)
    length = draw.choice([None, None, 1 << 60, len(chunk) * 2])
    body = record(1, text(b"") + text(b"")) + record(4, channel) + record(6, chunk, length) * draw.choice([1, 1, 3, 40])
    magic = b"\x89MCAP0\r\n"
    path.write_bytes(magic + body + record(15, bytes(4)) + record(2, bytes(20)) + magic)


def _blf(path: Path, draw: random.Random) -> None:
    """Containers of zeros or messages, objects of 0 bytes, sizes that are not true."""
    frames_log(path, 50)
    header = path.read_bytes()[:144]
    message = struct.pack("<4sHHII", b"LOBJ", 32, 1, draw.choice([48, 48, 0, 1, 15]), 1)
    message += struct.pack("<LHHQ", 2, 0, 0, 5) + struct.pack("<HBBL8s", 1, 0, 8, 0x180, bytes(8))
    piece = draw.choice([ZEROS, message * (len(ZEROS) // 48)])
    data = packed_zeros("deflate", draw.choice([12, 40, 200]), piece)
    size = draw.choice([None, None, 0, 15, 0xFFFFFFF0])
    content = struct.pack("<H6xL4x", 2, draw.choice([len(piece), 100, 0xFFFFFFFF])) + data
    container = struct.pack("<4sHHII", b"LOBJ", 16, 1, len(content) + 16 if size is None else size, 10) + content
    path.write_bytes(header + (container + bytes(len(container) % 4)) * draw.choice([1, 1, 4, 60]))


def _links(data: bytearray, name: bytes) -> list[int]:
    at, found = 0, []
    while (at := data.find(name, at)) >= 0:
        found.append(at)
        at += 4
    return found


def _mf4(path: Path, draw: random.Random) -> None:
    """A whole log whose packed block, counts of records or links are another's."""
    frames_log(path, 2000)
    data = bytearray(path.read_bytes())

    def put(at: int, value: int, size: int = 8) -> None:
        data[at : at + size] = value.to_bytes(size, "little")

    def links(at: int) -> int:
        return int.from_bytes(data[at + 16 : at + 24], "little")

    kind = draw.choice(["size", "block", "block lies", "cycles", "circle", "data again", "width"])
    packed, groups = _links(data, b"##DZ"), _links(data, b"##CG")
    if kind == "size":
        put(draw.choice(packed) + 32, draw.choice([1 << 30, 1 << 40, (1 << 63) - 1]))
    elif kind in ("block", "block lies"):
        size = draw.choice([40, 300])
        new = packed_zeros("deflate", size)
        head = struct.pack("<4s4xQQ2sBBIQQ", b"##DZ", 48 + len(new), 0, b"DT", 0, 0, 0,
                           size << 20 if kind == "block" else 7000, len(new))  # fmt: skip
        data += bytes(-len(data) % 8)
        for group in _links(data, b"##DG"):
            put(group + 24 + 16, len(data))
        for group in groups:
            put(group + 24 + 8 * links(group) + 8, (size << 20) // 80)
        data += head + new
    elif kind == "cycles":
        put(groups[0] + 24 + 8 * links(groups[0]) + 8, draw.choice([10**7, 1 << 40, (1 << 63) - 1]))
    elif kind == "width":
        put(groups[0] + 24 + 8 * links(groups[0]) + 24, draw.choice([0, 1, 1 << 31]), 4)
    elif kind == "circle":
        name = draw.choice([b"##DG", b"##CG", b"##CN"])
        places = _links(data, name)
        put(draw.choice(places) + 24 + 8 * draw.choice([0, 1]), draw.choice(places))
    else:  # a list that names one block over and over, or itself
        target = packed[0] if packed else 64
        many = draw.choice([1000, 100_000])
        data += bytes(-len(data) % 8)
        here = len(data)
        first = here if draw.random() < 0.5 else 0
        data += struct.pack("<4s4xQQ", b"##DL", 24 + 8 * (many + 1) + 16, many + 1)
        data += struct.pack(f"<{many + 1}Q", first, *([target] * many)) + struct.pack("<BxxxIQ", 1, many, 7000)
        for group in _links(data, b"##DG"):
            put(group + 24 + 16, here)
        put(groups[0] + 24 + 8 * links(groups[0]) + 8, draw.choice([2000, 10**9]))
    path.write_bytes(data)


def _parquet(path: Path, draw: random.Random, frames: bool) -> None:
    """Run lengths, dictionaries, nulls and lists that stand for gigabytes."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows, groups = 1 << 20, draw.choice([4, 40])
    kind = draw.choice(["zeros", "text", "nulls", "list", "plain", "wide"])
    if frames:
        kind = draw.choice(["zeros", "text", "plain"])
        data = bytes(64) if kind != "text" else bytes(20_000)
        rows = rows // 4
        table = pa.table({
            "time": pa.array(np.zeros(rows)), "id": pa.array(np.zeros(rows, np.int64)),
            "data": pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), pa.array([data])),
            "flags": pa.array(np.zeros(rows, np.uint8)),
        })  # fmt: skip
    elif kind == "text":
        rows = 200_000
        cells = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), pa.array(["x" * 100_000]))
        table = pa.table({"a": cells, "b": pa.array(np.zeros(rows))})
    elif kind == "nulls":
        table = pa.table({"a": pa.nulls(rows, pa.float64()), "b": pa.nulls(rows, pa.string())})
    elif kind == "list":
        inner = pa.array(np.zeros(rows, np.int64))
        table = pa.table({"a": pa.ListArray.from_arrays(pa.array(np.arange(0, rows + 1, 64, dtype=np.int32)), inner)})
    elif kind == "wide":
        rows = 1000
        table = pa.table({f"c{i}": pa.array(np.zeros(rows)) for i in range(2000)})
        groups = min(groups, 8)
    else:
        table = pa.table({"a": pa.array(np.zeros(rows)), "b": pa.array(np.zeros(rows))})
    packed, dictionary = draw.choice(["zstd", "snappy", "gzip"]), kind != "plain"
    with pq.ParquetWriter(path, table.schema, compression=packed, use_dictionary=dictionary) as writer:
        for _ in range(groups):
            writer.write_table(table, row_group_size=rows)


Make = Callable[[Path, random.Random], None]
READERS: dict[str, tuple[str, Make, tuple[str, ...]]] = {
    "MCAP": ("bomb.mcap", _mcap, ("log", "info")),
    "BLF": ("bomb.blf", _blf, ("log", "info")),
    "MF4": ("bomb.mf4", _mf4, ("log", "info")),
    "Parquet of frames": ("bomb.parquet", lambda path, draw: _parquet(path, draw, True), ("log", "info")),
    "Parquet of a table": (
        "bomb.parquet",
        lambda path, draw: _parquet(path, draw, False),
        ("case", "table", "--to", "made"),
    ),
}


def tried(count: int, seed: int) -> Iterator[tuple[str, int, Outcome]]:
    """Reader, number and what `terrapin` did, for `count` bombs of each reader."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for reader, (file, make, command) in READERS.items():
            for number in range(count):
                path = folder / file
                shutil.rmtree(folder / "made", ignore_errors=True)
                make(path, random.Random(f"{seed} {reader} {number}"))
                yield reader, number, run([*command, path], folder)


def attack(count: int, seed: int) -> Result:
    """`count` bombs of each reader: at most 1 GB, 10 s of the processor, one line."""
    outcomes = tried(count, seed)
    return counted(
        "bombs at readers",
        ((f"{reader} {number} (seed {seed})", one, one.wrong(MEMORY, SECONDS)) for reader, number, one in outcomes),
    )
