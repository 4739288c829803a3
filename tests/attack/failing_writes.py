"""A full disk, kill -9, a folder that is read-only, two at once: at each command of the command line that writes.

What was there before is still whole, or the command succeeded and it is whole in its new state; what is said is one
line. A command that is new stands in WRITES with a way to call it, or in OTHERS with the reason why not: a test asks
for that.
"""

from __future__ import annotations

import importlib
import pkgutil
import random
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from tests.attack import Result
from tests.attack.bombs import frames_log
from tests.attack.damage import _case, _kept, _key, _scenario, _table
from tests.attack.forked import Outcome, together

COUNT, SHORT = 120, 12  # failures, over all commands and kinds
ROOT = Path(__file__).resolve().parents[2]
KINDS = ("full disk", "kill -9", "read-only", "two at once")
SECONDS = 60.0  # of the processor; beside others
MEMORY = 1 << 30
PROGRESS = re.compile(r"^\d+ (of \d+ )?runs\b.*\n", re.MULTILINE)  # of a batch, as it goes on standard error


def command_names() -> set[str]:
    """Every command of the command line, "case table" and the like, as it registers them itself."""
    from terrapin_tools import commands

    found = set()
    for info in pkgutil.iter_modules(commands.__path__):
        module = importlib.import_module(f"{commands.__name__}.{info.name}")
        below = [function.__name__.rstrip("_") for function in getattr(module, "SUBCOMMANDS", ())]
        found |= {f"{info.name} {name}".replace("_", "-") for name in below} if below else {info.name}
    return found


@dataclass(frozen=True)
class Write:
    """How to call a command that writes, in a folder where `make` was; `changes`: what of that it may change."""

    arguments: tuple[str, ...]
    make: Callable[[Path], object] = lambda folder: None
    changes: tuple[str, ...] = ()


def _two_tables(folder: Path) -> None:
    draw = random.Random(1)  # a speed that repeats itself would tell no offset of the clocks
    lines = [f"{i / 10:.1f},{draw.random():.6f},{draw.random():.6f}" for i in range(400)]
    for name, column in (("a.csv", "force [N]"), ("b.csv", "torque [N m]")):
        rows = "\n".join([f"time [s],speed [rad/s],{column}", *lines])
        (folder / name).write_text(rows + "\n", encoding="utf-8")


def _in_a_case(folder: Path) -> None:
    _case(folder / "case" / "case.toml")


def _with_an_effect(folder: Path) -> None:
    _in_a_case(folder)
    together([("add", "case", "stribeck")], folder)


def _more_rows(folder: Path) -> None:
    _in_a_case(folder)
    head, _, rows = (folder / "case" / "runs.csv").read_text(encoding="utf-8").partition("\n")
    cells = [row.split(",") for row in rows.splitlines()]  # other runs, with other numbers
    more = [",".join([f"new_{row[0]}", *row[1:-1], f"{1.01 * float(row[-1]):.2f}"]) for row in cells]
    (folder / "more.csv").write_text("\n".join([head, *more, ""]), encoding="utf-8")


CASE, MATCH = ("case",), "speed [rad/s]=speed [rad/s]"
BATCH = ("batch", "x.toml", "--seeds", "1:2", "--jobs", "1", "--out", "made")
WRITES = {
    "add": Write(("add", "case", "stribeck"), _in_a_case, CASE),
    "remove": Write(("remove", "case", "stribeck"), _with_an_effect, CASE),
    "case hold": Write(("case", "hold", "case", "r02"), _in_a_case, CASE),
    "case set": Write(("case", "set", "case", "radius=81 mm"), _in_a_case, CASE),
    "case undo": Write(("case", "undo", "case"), _with_an_effect, CASE),
    "case append": Write(("case", "append", "case", "more.csv"), _more_rows, CASE),
    "case example": Write(("case", "example", "heated_motor", "--to", "made")),
    "case table": Write(("case", "table", "x.parquet", "--to", "made"), lambda folder: _table(folder / "x.parquet")),
    "case merge": Write(("case", "merge", "a.csv", "b.csv", "--match", MATCH, "--to", "made.csv"), _two_tables),
    "compare": Write(("compare", "case"), _in_a_case, CASE),
    "report": Write(("report", "case", "--output", "page.html"), _in_a_case, CASE),
    "batch": Write(BATCH, lambda folder: _scenario(folder / "x.toml")),
    "run": Write(("run", "x.toml", "--out", "made"), lambda folder: _scenario(folder / "x.toml")),
    "log convert": Write(("log", "convert", "x.mcap", "new.blf"), lambda folder: frames_log(folder / "x.mcap", 4000)),
    "log dbc": Write(("log", "dbc", "new.dbc", "--node", "3")),
    "keys new": Write(("keys", "new", "new.pem")),
    "keys public": Write(("keys", "public", "x.pem", "public.pem"), lambda folder: _key(folder / "x.pem")),
    "keys link": Write(("keys", "link", "new.key")),
    "keys renew": Write(("keys", "renew", "x.key", "new.key"), lambda folder: _key(folder / "x.key")),
    "robot new": Write(("robot", "new", "mine.toml", "--like", "roller")),
}  # fmt: skip
_LIVE, _READS, _SAME = "asks a controller or a bus", "reads only", "writes as another does that is tried: "
OTHERS = {
    **dict.fromkeys(("flash", "monitor", "node list", "node set", "node clear", "sim", "web", "log record"), _LIVE),
    **dict.fromkeys(("param list", "param get", "param set", "param save", "param load", "param diff"), _LIVE),
    "param reset": _LIVE,
    **dict.fromkeys(("effects", "doctor", "look", "log info", "log replay", "image verify", "image info"), _READS),
    **dict.fromkeys(("robot list", "robot show", "robot check", "keys show"), _READS),
    **dict.fromkeys(("soil vehicle", "soil tactile", "soil plates", "experiment slip-limit"), _READS),
    "case runs": _SAME + "case table", "experiment l9": _READS, "case map": _SAME + "case table",
    "case redo": _SAME + "case undo", "fmu export": "a build, of some seconds",
    "discover": _SAME + "compare",
    "export": _SAME + "report",
    "experiment run": _SAME + "case append", "demo": _SAME + "report", "papers": _SAME + "report",
    "image build": "a build, of some minutes", "image sign": "tests/boot/test_flash.py",
    "keys revoke": _SAME + "keys new",
}  # fmt: skip


def _digests(folder: Path) -> dict[str, str]:
    return {name: digest for name, digest in _kept(folder).items() if not name.endswith(".lock")}


def _again(write: Write, folder: Path) -> str:
    """What is wrong with the case, or with the command once more, after a failure; "" when nothing is."""
    if write.changes:
        after = together([("compare", "case")], folder)[0]
        found = after.wrong(MEMORY, SECONDS) or (after.err if after.status == 2 else "")
        return f"compare afterwards: {found[:300]}" if found else ""
    for path in (folder / "made", folder / str(write.arguments[-1])):
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
    for name in ("made.csv", "new.pem", "new.key", "new.dbc", "new.blf", "public.pem", "mine.toml", "page.html"):
        (folder / name).unlink(missing_ok=True)
    after = together([write.arguments], folder)[0]
    return f"once more: status {after.status}, {after.err[:200]}" if after.status not in (0, 1) else ""


def _failing(kind: str, write: Write, folder: Path, draw: random.Random) -> list[Outcome]:
    if kind == "full disk":
        return together([write.arguments], folder, file_size=draw.choice([0, 0, 1, 100, 4096, 20000]))
    if kind == "kill -9":
        return together([write.arguments], folder, kill_after=draw.choice([0.0, 0.05, 0.2, 0.5, 1.0, 2.0]))
    if kind == "read-only":
        return together([write.arguments], folder, only_reads=True)
    return together([write.arguments] * 2, folder)


def _wrong(kind: str, said: list[Outcome], write: Write, before: dict[str, str], after: dict[str, str]) -> str:
    for one in (replace(one, err=PROGRESS.sub("", one.err)) for one in said):
        killed = kind == "kill -9" and one.status == -9
        if not killed and (found := one.wrong(MEMORY, SECONDS)):
            return f"{found}: {one.err[-200:]!r}"
    if kind == "two at once" and all(one.status == 2 for one in said):
        return f"both refused: {said[0].err[:200]!r}"
    mine = tuple(f"{name}/" for name in write.changes)
    lost = [
        name for name, digest in before.items() if not name.startswith(mine or ("\0",)) and after.get(name) != digest
    ]
    gone = [name for name in before if name not in after and "/.terrapin/versions/" not in name]  # undone: moved
    return f"lost or changed: {sorted({*lost, *gone})[:3]}" if lost or gone else ""


def tried(count: int, seed: int) -> Iterator[tuple[str, str, str]]:
    """Command, kind of failure, and what is wrong ("" when nothing is), for `count` failures over all of both."""
    pairs = [(name, kind) for name in WRITES for kind in KINDS]
    random.Random(seed).shuffle(pairs)
    for number in range(count):
        name, kind = pairs[number % len(pairs)]
        write = WRITES[name]
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place, "work")
            folder.mkdir()
            write.make(folder)
            before = _digests(folder)
            said = _failing(kind, write, folder, random.Random(f"{seed} {number}"))
            wrong = _wrong(kind, said, write, before, _digests(folder))
            yield name, kind, wrong or _again(write, folder)


def attack(count: int, seed: int) -> Result:
    """`count` failures while a command writes: nothing is lost, and the next command works."""
    total, taken, first = 0, 0, ""
    commands = set()
    for name, kind, wrong in tried(count, seed):
        total += 1
        commands.add(name)
        if wrong:
            taken += 1
            first = first or f"; first: {name}, {kind} (seed {seed}): {wrong}"
    return Result("failures while a command writes", total, taken, f"{len(commands)} commands{first}")
