"""Small files of tables that stand for gigabytes: packed text and sheets, arrays of zeros, lists of one value."""

from __future__ import annotations

import gzip
import random
import shutil
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from tests.attack import Result
from tests.attack.bombs import ZEROS
from tests.attack.forked import Outcome, counted, learn, run
from tests.python import table_files

COUNT, SHORT = 40, 1  # of each reader
MEMORY, SECONDS = 1 << 30, 10.0  # that a command may take
MIB = 1 << 20
Make = Callable[[Path, random.Random], None]


def _mib(text: bytes) -> bytes:
    """A MiB of whole copies of a text, filled with what ends no element."""
    return text * (MIB // len(text))


def _deflated(first: bytes, piece: bytes, times: int, last: bytes) -> tuple[bytes, int, int]:
    """Raw deflate of first, piece `times` over, last; the CRC and the length of all that. One piece is packed once."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    head = packer.compress(first) + packer.flush(zlib.Z_FULL_FLUSH)
    body = packer.compress(piece) + packer.flush(zlib.Z_FULL_FLUSH)
    tail = packer.compress(last) + packer.flush()
    crc = zlib.crc32(first)
    for _ in range(times):
        crc = zlib.crc32(piece, crc)
    return head + body * times + tail, zlib.crc32(last, crc), len(first) + times * len(piece) + len(last)


def _zip(path: Path, members: dict[str, tuple[bytes, int, int]], stated: int | None = None) -> None:
    """A zip of members that are packed already; `stated`: what each says that it unpacks to."""
    data, entries = b"", b""
    for name, (packed, crc, length) in members.items():
        size = min(length if stated is None else stated, 0xFFFFFFFE)
        fields = struct.pack("<HHHHHIIIHH", 20, 0, 8, 0, 33, crc, len(packed), size, len(name), 0)
        entries += b"PK\1\2" + struct.pack("<H", 20) + fields + struct.pack("<HHHII", 0, 0, 0, 0, len(data))
        entries += name.encode()
        data += b"PK\3\4" + fields + name.encode() + packed
    count = len(members)
    end = b"PK\5\6" + struct.pack("<HHHHIIH", 0, 0, count, count, len(entries), len(data), 0)
    path.write_bytes(data + entries + end)


def _size(draw: random.Random) -> int:
    return draw.choice([40, 300, 2000])


def _stated(draw: random.Random) -> int | None:
    return draw.choice([None, None, 100, 0])


def _rows(draw: random.Random) -> tuple[bytes, bytes]:
    """A heading and a MiB of rows, or of what is none."""
    row = draw.choice([b"1,2,3\n", b"1,2,3\n", b'"' + b"a" * 99, b"\n", b"1," * 50, bytes(100)])
    return b"run,speed [rpm],torque [mN m]\n", _mib(row)


def csv_gz(path: Path, draw: random.Random) -> None:
    """One stream, or many behind each other."""
    head, piece = _rows(draw)
    if draw.random() < 0.5:
        path.write_bytes(gzip.compress(head + piece) + gzip.compress(piece) * _size(draw))
        return
    packed, crc, length = _deflated(head, piece, _size(draw), b"")
    path.write_bytes(b"\x1f\x8b\x08\0\0\0\0\0\2\3" + packed + struct.pack("<II", crc, length & 0xFFFFFFFF))


def zipped(path: Path, draw: random.Random) -> None:
    """One large file, many that are, or one within another."""
    head, piece = _rows(draw)
    count = draw.choice([1, 1, 30])
    packed = _deflated(head, piece, _size(draw) // count + 1, b"")
    _zip(path, {f"V{i}.csv": packed for i in range(count)}, _stated(draw))
    if draw.random() < 0.3:
        inner = path.read_bytes()
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as outer:
            outer.writestr("a.zip", inner)


def npz(path: Path, draw: random.Random) -> None:
    """Arrays of zeros: as large as their heads say, larger, or of objects."""
    shape = draw.choice(["({0},)", "(1, {0})", "({0}, 0)", "({0}, {0}, {0})"]).format(
        draw.choice([10**6, 10**9, 2**62])
    )
    kind = draw.choice(["<f8", "<f8", "|O", "<U1000000", "|V1000000000"])
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117) + b"\n"
    first = b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text
    _zip(
        path,
        {f"a{i}.npy": _deflated(first, ZEROS, _size(draw), b"") for i in range(draw.choice([1, 4]))},
        _stated(draw),
    )


def with_member(path: Path, name: str, at: bytes, piece: bytes, mebibytes: int, stated: int | None = None) -> None:
    """A whole file of a zip's kind becomes one of which the member `name` has `piece` over and over before `at`."""
    with zipfile.ZipFile(path) as whole:
        texts = {each: whole.read(each) for each in whole.namelist()}
    members = {each: _deflated(text, b"", 0, b"") for each, text in texts.items()}
    first, _, last = texts[name].partition(at)
    members[name] = _deflated(first, _mib(piece), mebibytes, at + last)
    _zip(path, members, stated)


def xlsx(path: Path, draw: random.Random) -> None:
    """Rows without end, cells without end, one cell that is far away, texts without end."""
    far = b'<row r="1048576"><c r="XFD1048576"><v>1</v></c></row>'
    text = b'<row><c t="inlineStr"><is><t>aaaaaaaa</t></is></c></row>'
    piece = draw.choice([b"<row><c><v>1</v></c></row>", b"<row/>", far, text, b"<!-- -->"])
    table_files.xlsx(path, table_files.numbers(1))
    with_member(path, "xl/worksheets/sheet1.xml", b"</sheetData>", piece, _size(draw), _stated(draw))


def ods(path: Path, draw: random.Random) -> None:
    """Rows without end, or one that stands for a million."""
    cell = b'<table:table-cell office:value-type="float" office:value="1"%s></table:table-cell>'
    row = b"<table:table-row%s>" + cell + b"</table:table-row>"
    many = b' table:number-rows-repeated="1048576"', b' table:number-columns-repeated="16384"'
    piece = draw.choice(
        [row % (b"", b""), row % (many[0], b""), row % (many[0], many[1]), row % (b"", many[1]), b"<!-- -->"]
    )
    table_files.ods(path, table_files.numbers(1))
    with_member(path, "content.xml", b"</table:table>", piece, _size(draw), _stated(draw))


def mat(path: Path, draw: random.Random) -> None:
    """A packed array of zeros whose head says the truth, less or more."""
    mebibytes = _size(draw)
    rows = draw.choice([mebibytes * MIB // 8, 10, (1 << 31) - 1])
    wrap = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, rows, 1) + struct.pack("<HHcxxx", 1, 1, b"a")
    inner = wrap + struct.pack("<II", 9, draw.choice([mebibytes * MIB & 0xFFFFFFFF, (rows * 8) & 0xFFFFFFFF]))
    first = struct.pack("<II", 14, draw.choice([len(inner) + mebibytes * MIB, 0xFFFFFFF0]) & 0xFFFFFFFF) + inner
    raw, _, _ = _deflated(first, ZEROS, mebibytes, b"")
    packed = b"\x78\xda" + raw + bytes(4)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM"
    path.write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)


def h5(path: Path, draw: random.Random) -> None:
    """Data sets that were never written, of any shape; many of them; text of any length; groups in a circle."""
    import h5py

    kind = draw.choice(["<f8", "<f8", "S1000000", "u1", h5py.string_dtype()])
    shape = draw.choice([(1 << 28,), (1 << 34,), (1 << 20, 1 << 20), (1 << 24,)])
    with h5py.File(path, "w") as file:
        for i in range(draw.choice([1, 8, 3000])):
            file.create_dataset(f"g/{i}", shape, kind, chunks=(1 << 16,) if len(shape) == 1 and kind == "<f8" else True,
                                compression=draw.choice([None, "gzip"]))  # fmt: skip
        file["g/again"] = file["g"]
        file["soft"] = h5py.SoftLink("/soft")


def nc(path: Path, draw: random.Random) -> None:
    """NetCDF 3 whose counts are another's: rows, dimensions, lengths of names."""
    table_files.netcdf_3(path, table_files.numbers(1))
    _counts(path, draw, ">I", [0x7FFFFFFF, 0xFFFFFFFF, 1 << 28])


def tdms(path: Path, draw: random.Random) -> None:
    table_files.tdms(path, table_files.numbers(1))
    _counts(path, draw, draw.choice(["<I", "<Q"]), [0x7FFFFFFF, 0xFFFFFFFE, 1 << 27])


def bag(path: Path, draw: random.Random) -> None:
    path.unlink(missing_ok=True)
    table_files.bag(path, table_files.numbers(1))
    _counts(path, draw, "<I", [0x7FFFFFFF, 0xFFFFFFFF, 1 << 28])


def _counts(path: Path, draw: random.Random, form: str, values: list[int]) -> None:
    """Some numbers in the file's head, small ones that may be counts, are large."""
    data = bytearray(path.read_bytes())
    width = struct.calcsize(form)
    places = [i for i in range(len(data) - width) if 0 < struct.unpack_from(form, data, i)[0] < 4096]
    for place in draw.sample(places, min(len(places), draw.choice([1, 1, 2]))):
        struct.pack_into(form, data, place, draw.choice(values))
    path.write_bytes(bytes(data))


def feather(path: Path, draw: random.Random) -> None:
    """Packed batches of zeros, one word for a million rows, more columns than rows."""
    import pyarrow as pa

    rows = 1 << 20
    kind = draw.choice(["zeros", "text", "wide", "nulls"])
    if kind == "zeros":
        batch = pa.record_batch({"a": pa.array(np.zeros(rows)), "b": pa.array(np.zeros(rows))})
    elif kind == "text":
        batch = pa.record_batch({"a": pa.array(np.full(4096, "x" * 10_000, dtype=object))})
    elif kind == "nulls":
        batch = pa.record_batch({"a": pa.nulls(rows, pa.float64()), "b": pa.nulls(rows)})
    else:
        batch = pa.record_batch({f"c{i}": pa.array(np.zeros(16)) for i in range(20_000)})
    packed = pa.ipc.IpcWriteOptions(compression=draw.choice(["zstd", "lz4"]))
    with pa.OSFile(str(path), "wb") as file, pa.ipc.new_file(file, batch.schema, options=packed) as writer:
        for _ in range(draw.choice([4, 40])):
            writer.write_batch(batch)


READERS: dict[str, Make] = {
    "x.csv.gz": csv_gz, "x.zip": zipped, "x.npz": npz, "x.xlsx": xlsx, "x.ods": ods, "x.mat": mat, "x.h5": h5,
    "x.nc": nc, "x.tdms": tdms, "x.bag": bag, "x.feather": feather,
}  # fmt: skip


def tried(count: int, seed: int) -> Iterator[tuple[str, int, Outcome]]:
    """File, number and what `terrapin case table` did, for `count` bombs of each reader."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        table_files.xlsx(folder / "whole.xlsx", table_files.numbers(1))
        learn(("case", "table", "whole.xlsx", "--to", "made"), folder)
        for file, make in READERS.items():
            for number in range(count):
                shutil.rmtree(folder / "made", ignore_errors=True)
                make(folder / file, random.Random(f"{seed} {file} {number}"))
                yield file, number, run(("case", "table", file, "--to", "made"), folder)
            (folder / file).unlink()


def attack(count: int, seed: int) -> Result:
    """`count` bombs of each reader: at most 1 GB, 10 s of the processor, one line."""
    outcomes = tried(count, seed)
    return counted(
        "bombs at readers of tables",
        ((f"{file} {number} (seed {seed})", one, one.wrong(MEMORY, SECONDS)) for file, number, one in outcomes),
    )
