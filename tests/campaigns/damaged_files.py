"""Measurements that are flipped or cut at random, of every format, at every command that reads them: one line each.

`python -m tests.campaigns.damaged_files 300 [SEED]` damages so many files, and gives each to one command: table, map,
merge, look, compare, and for logs info and convert. What counts as wrong: a traceback, a status that is none of the
program's, more or less than one line on standard error with a status that is not 0, more than 2 GB, more than 30 s of
the processor.
"""

from __future__ import annotations

import random
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import can
import numpy as np

from tests.attack.damage import damaged
from tests.attack.forked import Outcome, run
from tests.python.table_files import WRITERS, csv, numbers

__all__ = ["Tried", "main", "tried"]

MEMORY, SECONDS = 2 << 30, 30.0
LOGS = (".log", ".asc", ".blf", ".mf4", ".mcap", ".parquet", ".trc", ".csv", ".db")
DBC = (
    'VERSION ""\nBU_: A\nBO_ 272 M: 8 A\n SG_ a : 0|16@1+ (0.5,0) [0|65] "N" A\n SG_ b : 16|8@1+ (1,0) [0|255] "A" A\n'
)
MAP = ("--base", "equation", "--dbc", "x.dbc", "--period", "20 ms", "--column", "f=M.a", "--unit", "f=N",
       "--column", "i=M.b", "--unit", "i=A", "--equation", "f=k*i", "--fit", "k=1:0:9:N/A", "--train", "x")  # fmt: skip
OF_A_TABLE: dict[str, tuple[str, ...]] = {
    "case table": ("case", "table", "FILE", "--to", "new"),
    "look": ("look", "FILE"),
    "case merge": ("case", "merge", "FILE", "good.csv", "--match", "torque [mN m]=torque [mN m]", "--to", "new.csv"),
    "case map": ("case", "map", "FILE", "--to", "new", "--base", "equation", "--column", "f=torque [mN m]", "--unit",
                 "f=mN m", "--column", "w=speed [rpm]", "--unit", "w=rpm", "--equation", "f=k*w", "--fit", "k=1"),
    "compare": ("compare", "made"),
}  # fmt: skip
OF_A_LOG: dict[str, tuple[str, ...]] = {
    "log info": ("log", "info", "FILE", "--dbc", "x.dbc"),
    "look": ("look", "FILE", "--dbc", "x.dbc"),
    "case map": ("case", "map", "FILE", "--to", "new", *MAP),
    "log convert": ("log", "convert", "FILE", "new.log"),
    "compare": ("compare", "made"),
}


@dataclass(frozen=True)
class Tried:
    """A file, the command it was given to, and what came of it; `wrong` is "" where nothing is."""

    kind: str
    command: str
    number: int
    outcome: Outcome
    wrong: str


def _log(path: Path) -> None:
    """300 frames; M.a is 50 times M.b."""
    path.with_name("x.dbc").write_text(DBC, encoding="ascii")
    data = [(100 * (i % 40)).to_bytes(2, "little") + bytes([i % 40, 0, 0, 0, 0, 0]) for i in range(300)]
    if path.suffix in (".trc", ".csv", ".db"):
        with can.Logger(str(path)) as writer:
            for i, each in enumerate(data):
                message = can.Message(timestamp=1e9 + 0.02 * i, arbitration_id=272, data=each, is_extended_id=False)
                writer.on_message_received(message)
        return
    from terrapin_tools.logs.frames import frames
    from terrapin_tools.logs.writing import LogWriter

    with LogWriter(path) as log:
        log.write(frames(path, np.arange(300) * 0.02, [272] * 300, data, [0] * 300))


def _table(write: Callable[[Path, dict[str, np.ndarray]], None]) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        csv(path.with_name("good.csv"), numbers(1))
        write(path, numbers(1))

    return make


KINDS: dict[str, tuple[str, Callable[[Path], None], dict[str, tuple[str, ...]]]] = {
    **{kind: (name, _table(write), OF_A_TABLE) for kind, (name, write) in WRITERS.items()},
    **{f"log {suffix}": (f"x{suffix}", _log, OF_A_LOG) for suffix in LOGS},
}


def _damage(path: Path, draw: random.Random) -> None:
    file = path if path.is_file() else draw.choice(sorted(each for each in path.rglob("*") if each.is_file()))
    file.write_bytes(damaged(file.read_bytes(), draw, file.suffix in (".csv", ".log", ".asc", ".trc", ".yaml")))


def _words(command: tuple[str, ...], file: str) -> list[str]:
    return [file if word == "FILE" else word for word in command]


def tried(count: int, seed: int) -> Iterator[Tried]:
    """`count` damaged files: each format in turn, and each of its commands in turn."""
    with tempfile.TemporaryDirectory() as name:
        whole: dict[str, Path] = {}
        for number in range(count):
            kind = list(KINDS)[number % len(KINDS)]
            file, make, commands = KINDS[kind]
            if kind not in whole:
                whole[kind] = Path(name, f"whole_{len(whole)}")
                whole[kind].mkdir()
                make(whole[kind] / file)
                command = OF_A_LOG["case map"] if commands is OF_A_LOG else OF_A_TABLE["case table"]
                run(_words(tuple("made" if word == "new" else word for word in command), file), whole[kind])
            folder = Path(name, "tried")
            shutil.copytree(whole[kind], folder)
            _damage(folder / file, random.Random(f"{seed} {number}"))
            said = list(commands)[number // len(KINDS) % len(commands)]
            outcome = run(_words(commands[said], file), folder)
            yield Tried(kind, said, number, outcome, outcome.wrong(MEMORY, SECONDS))
            shutil.rmtree(folder)


def main(count: int = 300, seed: int = 1) -> int:
    """Prints what is wrong, and the sums. 1 where anything is."""
    wrong = refused = 0
    memory, seconds = 0, 0.0
    for each in tried(count, seed):
        wrong += bool(each.wrong)
        refused += each.outcome.status != 0
        memory, seconds = max(memory, each.outcome.memory), max(seconds, each.outcome.seconds)
        if each.wrong:
            print(f"{each.number}: {each.kind}, {each.command}: {each.wrong}\n{each.outcome.err[-2000:]}", flush=True)
    print(f"{count} damaged files (seed {seed}): {wrong} wrong, {refused} refused in one line, the rest read;")
    print(f"at most {memory >> 20} MiB, {seconds:.1f} s of the processor")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
