"""Files that are flipped, cut and mixed, at every reader and its commands: one line, nothing lost, within bounds."""

from __future__ import annotations

import hashlib
import random
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from terrapin_hil import paths
from tests.attack import Result
from tests.attack.bombs import frames_log
from tests.attack.forked import Outcome, counted, learn, run
from tests.python import table_files

COUNT, SHORT = 600, 2 * 20  # over all readers
MEMORY, SECONDS = 1 << 30, 10.0
ROOT = Path(__file__).resolve().parents[2]
KEPT = b"what was here before\n"
NUMBERS = ("0", "-1", "1e309", "nan", "99999999999999999999", '""', "[]", "{}")


@dataclass(frozen=True)
class Reader:
    """A file that a command reads: who makes a whole one, and the command (FILE: the damaged one)."""

    file: str
    make: Callable[[Path], object]
    command: tuple[str, ...]
    text: bool = False


def _table(path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    draw = np.random.default_rng(1)
    names = ("run", "shell_speed [rad/s]", "winding [degC]", "motor_current [mA]")
    table = pyarrow.table({name: np.round(draw.random(300), 3) for name in names})
    pyarrow.parquet.write_table(table, path, compression="zstd")


def _of_kind(write: Callable[[Path, table_files.Columns], None]) -> Callable[[Path], object]:
    return lambda path: write(path, table_files.numbers(1))


def _case(path: Path) -> None:
    shutil.copytree(ROOT / "cases" / "heated_motor", path.parent, dirs_exist_ok=True)
    if path.name == "history.jsonl":
        from terrapin_tools.workbench.case.history import remember

        sides = {side: {"train_error": 2.0, "heldout_error": 3.0} for side in ("before", "after")}
        for action in ("add", "remove", "add"):
            remember(path.parent.parent, action, ["speed_squared"], sides)


def _scenario(path: Path) -> None:
    path.write_text(
        'duration = "0.1 s"\nseed = 1\nchecks = ["max(abs(slip)) < 2"]\n[sensors]\nkit = "ideal"\n[[path]]\n'
        'terrain = "sand"\n[[operator]]\nat = "0 s"\nrequest = "run"\nsetpoint = "8 V"\n',
        encoding="utf-8",
    )


def _key(path: Path) -> None:
    from terrapin_hil.links.seal import LinkKey
    from terrapin_tools.flash.keys import new_key, write_secret

    if path.suffix == ".pem":
        new_key(path)
    else:
        write_secret(path, LinkKey.new().text().encode())


def _image(path: Path) -> None:
    from tests.boot.kit import image

    path.write_bytes(image("a", "1.0.0"))


def _logs(path: Path) -> None:
    frames_log(path, 400)


def _of_python_can(path: Path) -> None:
    """A log of a kind that the tools read and do not write."""
    import can

    with can.Logger(path) as log:
        for i in range(300):
            data = bytes([i & 255, 2, 3, 4, 5, 6, 7, 8])
            log.on_message_received(
                can.Message(timestamp=i * 1e-3, arbitration_id=0x180 + i % 4, data=data, is_extended_id=False)
            )


def _robot(path: Path) -> None:
    shutil.copyfile(ROOT / "firmware/terrapin_interface/robots/roller.toml", path)


def _sqlite(path: Path) -> None:
    columns = "ts REAL, arbitration_id INTEGER, extended INTEGER, remote INTEGER, error INTEGER, dlc INTEGER, data BLOB"
    with closing(sqlite3.connect(path)) as connection:
        connection.execute(f"CREATE TABLE messages ({columns})")
        rows = ((i * 1e-3, 0x180, 0, 0, 0, 8, bytes([i & 255] * 8)) for i in range(300))
        connection.executemany("INSERT INTO messages VALUES (?, ?, ?, ?, ?, ?, ?)", rows)
        connection.commit()


def _dbc(path: Path) -> None:
    shutil.copyfile(paths.dbc(), path)
    frames_log(path.with_name("good.log"), 50)


TABLES = {
    "x.xlsx": table_files.xlsx, "y.xlsx": table_files.xlsx_headed, "x.ods": table_files.ods, "x.mat": table_files.mat,
    "y.mat": table_files.mat_73, "x.h5": table_files.hdf5, "x.nc": table_files.netcdf_3, "y.nc": table_files.netcdf_4,
    "x.feather": table_files.feather, "x.npz": table_files.npz, "x.tdms": table_files.tdms, "x.bag": table_files.bag,
    "x.mcap": table_files.mcap, "x.csv.gz": table_files.csv_gz, "x.zip": table_files.zipped,
}  # fmt: skip
READERS = (
    *(Reader(f"x.{kind}", _logs, ("log", "info", "FILE")) for kind in ("log", "blf", "asc", "mf4", "mcap", "parquet")),
    *(Reader(f"x.{kind}", _logs, ("log", "convert", "FILE", "new.log")) for kind in ("blf", "mf4", "mcap")),
    *(Reader(f"x.{kind}", _of_python_can, ("log", "info", "FILE"), text=True) for kind in ("trc", "csv")),
    Reader("x.asc", _logs, ("log", "convert", "FILE", "new.log"), text=True),
    Reader("x.db", _sqlite, ("log", "info", "FILE")),
    Reader("x.parquet", _table, ("case", "table", "FILE", "--to", "made")),
    *(Reader(name, _of_kind(write), ("case", "table", "FILE", "--to", "made")) for name, write in TABLES.items()),
    Reader("case/runs.csv", _case, ("compare", "case"), text=True),
    Reader("case/case.toml", _case, ("compare", "case"), text=True),
    Reader("case/.terrapin/history.jsonl", _case, ("report", "case", "--output", "page.html"), text=True),
    Reader("x.dbc", _dbc, ("log", "info", "good.log", "--dbc", "FILE"), text=True),
    Reader("x.toml", _scenario, ("run", "FILE", "--out", "made"), text=True),
    Reader("x.toml", _scenario, ("batch", "FILE", "--seeds", "1:2", "--jobs", "1", "--out", "made"), text=True),
    Reader("mine.toml", _robot, ("robot", "check", "FILE"), text=True),
    Reader("mine.toml", _robot, ("robot", "show", "FILE"), text=True),
    Reader("x.bin", _image, ("image", "info", "FILE")),
    Reader("x.bin", _image, ("image", "verify", "FILE")),
    Reader("x.pem", _key, ("keys", "show", "FILE"), text=True),
    Reader("x.key", _key, ("keys", "show", "FILE"), text=True),
)  # fmt: skip


def damaged(data: bytes, draw: random.Random, text: bool = False) -> bytes:
    """Flipped, cut or mixed: bytes changed, an end missing, pieces twice, left out, from elsewhere; fields of text."""
    new = bytearray(data)
    for _ in range(draw.choice([1, 1, 2, 5])):
        a, b = sorted(draw.randrange(len(new) + 1) for _ in range(2))
        b = min(b, a + draw.choice([1, 4, 16, 4096]))
        kind = draw.choice(["flip", "flip", "bytes", "cut", "twice", "out", "elsewhere", "field"])
        if kind == "flip" and new:
            for _ in range(draw.choice([1, 1, 8, 64])):
                new[draw.randrange(len(new))] ^= 1 << draw.randrange(8)
        elif kind == "bytes":
            new[a:b] = draw.choice([draw.randbytes(b - a), bytes(b - a), b"\xff" * (b - a)])
        elif kind == "cut":
            del new[draw.randrange(len(new) + 1) :]
        elif kind == "twice":
            new[a:a] = new[a:b]
        elif kind == "out":
            del new[a:b]
        elif kind == "elsewhere":
            at = draw.randrange(len(new) + 1)
            new[a:b] = new[at : at + b - a]
        elif text and (words := new.split(b" ")):
            words[draw.randrange(len(words))] = bytearray(draw.choice(NUMBERS).encode())
            new = bytearray(b" ".join(words))
    return bytes(new)


def _words(reader: Reader) -> list[str]:
    return [reader.file if word == "FILE" else word for word in reader.command]


def _kept(folder: Path) -> dict[str, str]:
    """What must still be there: everything, by its digest."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def tried(count: int, seed: int, readers: Sequence[Reader] = READERS) -> Iterator[tuple[Reader, int, Outcome, str]]:
    """Reader, number, what `terrapin` did, and what is wrong with it, for `count` damaged files over all readers."""
    with tempfile.TemporaryDirectory() as name:
        whole = [Path(name, f"whole_{i}") for i in range(len(readers))]
        for reader, folder in zip(readers, whole, strict=True):
            (folder / reader.file).parent.mkdir(parents=True)
            reader.make(folder / reader.file)
        for number in range(count):
            reader = readers[number % len(readers)]
            folder = Path(name, "tried")
            shutil.copytree(whole[number % len(readers)], folder)
            if number < len(readers):
                learn(_words(reader), folder)
                shutil.rmtree(folder)
                shutil.copytree(whole[number], folder)
            file = folder / reader.file
            file.write_bytes(damaged(file.read_bytes(), random.Random(f"{seed} {number}"), reader.text))
            before = _kept(folder)
            outcome = run(_words(reader), folder)
            wrong = outcome.wrong(MEMORY, SECONDS)
            after = _kept(folder)
            if not wrong and any(after.get(path) != digest for path, digest in before.items()):
                wrong = "a file that was there is another"
            yield reader, number, outcome, wrong
            shutil.rmtree(folder)


def attack(count: int, seed: int) -> Result:
    """`count` damaged files over all readers: no traceback, one line, at most 1 GB and 10 s of the processor."""
    return counted("damaged files at readers", told(tried(count, seed), seed))


def told(tries: Iterable[tuple[Reader, int, Outcome, str]], seed: int) -> Iterator[tuple[str, Outcome, str]]:
    """Each with the words that repeat it."""
    for reader, number, outcome, wrong in tries:
        yield f"{reader.file}, number {number} (seed {seed})", outcome, wrong
