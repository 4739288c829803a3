"""Would the tests see a slip in Python, where one misleads or lets in? `python -m tests.mutation.python --count 400`.

    --count N         a seeded sample over the rooms (60)
    --room NAME       one room alone; may be repeated
    --seed N          of the sample (1)
    --list            what there is, and what the sample would be; nothing is run

A mutant is a module with one slip: comparison, sum, product or logic turned round, an operand dropped, a condition
always true or false, min for max, two arguments exchanged, a constant or an index one off, a statement left out. It is
run with the tests of its room (rooms.toml) that call its function, until one fails, in a process of its own that sees
the changed text in place of the module's (warm.py); so do processes that a test starts. What `make test` leaves out is
left out. Survivors are printed; status 1 when a room's share is below its bound. Results are JSON lines in
out/mutation/python.jsonl and are not made again, a survivor's not as long as the room's tests are what they were.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import math
import os
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from terrapin_hil.paths import ROOT
from tests.mutation.warm import Seen, failing, prepare, record

__all__ = ["Room", "Slip", "judge", "passes", "rooms", "slips"]

KEPT = ROOT / "out" / "mutation"
REST_S = 20.0  # of the processor
EQUIVALENT = Path(__file__).with_name("equivalent_python.toml")
LISTED = 0.05  # of a file's slips
BEFORE = 8  # tests that killed last, which come first
COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE,), ast.LtE: (ast.Lt,), ast.Gt: (ast.GtE,), ast.GtE: (ast.Gt,), ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip
COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.Pow: ast.Mult,
}  # fmt: skip
NAMED = {
    "min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum", "maximum": "minimum",
    "argmin": "argmax", "argmax": "argmin", "floor": "ceil", "ceil": "floor",
}  # fmt: skip
COMMUTES = ("min", "max", "minimum", "maximum", "logaddexp", "hypot")  # either order of two is the same


@dataclass(frozen=True)
class Room:
    """Modules, the test files that should see a slip in them, and the share that they must see."""

    name: str
    modules: tuple[str, ...]
    tests: tuple[str, ...]
    share: float

    @property
    def runs(self) -> list[list[str]]:
        """Arguments of pytest for each run that the tests need, doctests included."""
        chosen = [test.partition(" -k ") for test in self.tests]
        plain = [file for file, _, words in chosen if not words]
        return [[*plain, *self.modules], *([file, "-k", words] for file, _, words in chosen if words)]


@dataclass(frozen=True)
class Slip:
    """One slip: the bytes of `path` from `begin` to `end` become `new`."""

    path: str
    line: int
    function: str
    begin: int
    end: int
    old: str
    new: str

    @property
    def change(self) -> str:
        return " ".join(f"{self.old} -> {self.new or 'nothing'}".split())[:160]

    @property
    def name(self) -> str:
        return f"{self.path}:{self.line} {self.function}: {self.change}"

    @property
    def key(self) -> str:
        """As long as the module and the slip are what they were."""
        text = (ROOT / self.path).read_bytes()
        named = f"{hashlib.sha256(text).hexdigest()} {self.begin} {self.old} {self.new}"
        return hashlib.sha256(named.encode()).hexdigest()[:16]

    def text(self) -> str:
        data = (ROOT / self.path).read_bytes()
        return (data[: self.begin] + self.new.encode() + data[self.end :]).decode()


def rooms() -> list[Room]:
    """Those of rooms.toml."""
    table = tomllib.loads(Path(__file__).with_name("rooms.toml").read_text(encoding="utf-8"))
    found = []
    for name, entry in table.items():
        modules = sorted({p.relative_to(ROOT).as_posix() for pattern in entry["modules"] for p in ROOT.glob(pattern)})
        found.append(Room(name, tuple(modules), tuple(entry["tests"]), entry.get("share", 0.85)))
    return found


def _swapped(node: ast.AST) -> Iterator[ast.expr]:
    """Other expressions in the place of this one."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        for other in COMPARED.get(type(node.ops[0]), ()):
            yield ast.Compare(node.left, [other()], node.comparators)
    elif isinstance(node, ast.BoolOp):
        for i in range(len(node.values)):
            rest = [value for k, value in enumerate(node.values) if k != i]
            yield rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    elif (
        isinstance(node, ast.BinOp)
        and type(node.op) in COMPUTED
        and not isinstance(node.left, ast.Constant | ast.JoinedStr)
    ):
        yield ast.BinOp(node.left, COMPUTED[type(node.op)](), node.right)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub | ast.Invert):
        yield node.operand
    elif isinstance(node, ast.Constant) and type(node.value) is bool:
        yield ast.Constant(not node.value)
    elif isinstance(node, ast.Constant) and type(node.value) is int:
        yield ast.Constant(node.value + 1)
    elif isinstance(node, ast.Constant) and type(node.value) is float and math.isfinite(node.value):
        yield ast.Constant(node.value * 2.0 if node.value else 1.0)
    elif isinstance(node, ast.IfExp):
        yield ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, ast.Call):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in NAMED:
            renamed = (
                ast.Attribute(node.func.value, NAMED[name])
                if isinstance(node.func, ast.Attribute)
                else ast.Name(NAMED[name])
            )
            yield ast.Call(renamed, node.args, node.keywords)
        two = node.args[:2]
        if (
            len(two) > 1
            and name not in COMMUTES
            and not any(isinstance(a, ast.Starred | ast.Constant | ast.JoinedStr) for a in two)
            and ast.dump(two[0]) != ast.dump(two[1])
        ):
            yield ast.Call(node.func, [node.args[1], node.args[0], *node.args[2:]], node.keywords)


def _left_out(node: ast.AST) -> bool:
    """A statement whose end is not the end of something else."""
    plain = isinstance(node, ast.AugAssign | ast.Raise | ast.Delete)
    called = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call | ast.Await)
    stored = isinstance(node, ast.Assign) and all(isinstance(t, ast.Subscript | ast.Attribute) for t in node.targets)
    return plain or called or stored


class _Finder(ast.NodeVisitor):
    def __init__(self, path: str, text: str) -> None:
        self.path, self.text = path, text
        self.found: list[Slip] = []
        self._starts = [0]
        for line in text.encode().split(b"\n"):
            self._starts.append(self._starts[-1] + len(line) + 1)
        self._function = "module"

    def _add(self, node: ast.stmt | ast.expr, new: str) -> None:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        begin = self._starts[node.lineno - 1] + node.col_offset
        end = self._starts[node.end_lineno - 1] + node.end_col_offset
        old = self.text.encode()[begin:end].decode()
        self.found.append(Slip(self.path, node.lineno, self._function, begin, end, old, new))

    def visit(self, node: ast.AST) -> None:
        if isinstance(node, ast.JoinedStr | ast.arguments | ast.Import | ast.ImportFrom | ast.AnnAssign | ast.Assert):
            return  # words, types and what must hold
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            before, self._function = self._function, node.name
            for statement in node.body:
                self.visit(statement)
            self._function = before
            return
        if isinstance(node, ast.ClassDef):  # without what decorates it: mypy sees what frozen=False would allow
            for statement in node.body:
                self.visit(statement)
            return
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING":
            return
        if isinstance(node, ast.If | ast.While) and not isinstance(node.test, ast.Constant):
            for value in ("True", "False") if isinstance(node, ast.If) else ("False",):
                self._add(node.test, value)
        if _left_out(node):
            assert isinstance(node, ast.stmt)
            self._add(node, "pass")
        for other in _swapped(node):
            assert isinstance(node, ast.expr)
            self._add(node, f"({ast.unparse(other)})")
        if not isinstance(node, ast.Raise):  # its words
            self.generic_visit(node)


def slips(path: str, text: str) -> list[Slip]:
    """All slips of a module, in the order of its syntax tree."""
    finder = _Finder(path, text)
    finder.visit(ast.parse(text))
    unique = {(s.begin, s.end, s.new): s for s in finder.found if s.new.strip("()") != s.old}
    return list(unique.values())


def sample(count: int, seed: int, names: list[str]) -> list[tuple[Room, Slip]]:
    """As many of each room, those with the lowest digests; a room with few gives all."""
    chosen = [room for room in rooms() if not names or room.name in names]
    found: list[tuple[Room, Slip]] = []
    for room in chosen:
        every = [s for path in room.modules for s in slips(path, (ROOT / path).read_text(encoding="utf-8"))]
        every.sort(key=lambda s: hashlib.sha256(f"{seed} {s.name} {s.begin}".encode()).digest())
        found += [(room, s) for s in every[: math.ceil(count / len(chosen))]]
    return found


def listed(every: Sequence[Slip]) -> tuple[set[Slip], list[str]]:
    """Those of these slips that equivalent_python.toml names, and what is wrong with that list."""
    found: set[Slip] = set()
    wrong = []
    for entry in tomllib.loads(EQUIVALENT.read_text(encoding="utf-8")).get("equivalent", []):
        meant = tuple(entry.get(word, "") for word in ("file", "function", "change"))
        mine = [slip for slip in every if (slip.path, slip.function, slip.change) == meant]
        mine = mine[entry["number"] - 1 : entry["number"]] if "number" in entry else mine
        if not mine or not entry.get("why"):
            told = "matches no slip" if not mine else "gives no reason"
            wrong.append(f"{EQUIVALENT.name}: {meant[0]} {meant[1]}: {meant[2]}: {told}")
        found |= set(mine)
    counts = Counter(slip.path for slip in every)
    for path, count in Counter(slip.path for slip in found).items():
        if count > LISTED * counts[path]:
            wrong.append(
                f"{EQUIVALENT.name}: {path}: found {count} of {counts[path]} slips, expected at most {LISTED:.0%}"
            )
    return found, wrong


def everything() -> list[Slip]:
    """All slips of all rooms' modules."""
    paths = sorted({path for room in rooms() for path in room.modules})
    return [slip for path in paths for slip in slips(path, (ROOT / path).read_text(encoding="utf-8"))]


def tests_for(slip: Slip, known: dict[str, Seen]) -> list[str]:
    """Those that call the slip's function first, those after them of which that is not known, quickest first; the rest
    where they take no longer than REST_S: what a cache keeps, another test may have called."""
    called = f"{slip.path} {slip.function}"
    everywhere = slip.function == "module"
    first = sorted((n for n, t in known.items() if called in t.calls), key=lambda n: known[n].seconds)
    others = sorted((n for n in known if n not in first), key=lambda n: known[n].seconds)
    then = [n for n in others if everywhere or known[n].elsewhere]
    rest = [n for n in others if n not in then]
    return [*first, *then, *(rest if sum(known[n].seconds for n in rest) <= REST_S else [])]


def judge(
    slip: Slip, runs: Sequence[Sequence[str]], known: dict[str, Seen], before: Sequence[str] = ()
) -> tuple[str, str]:
    """("killed", by which test) or ("survived", "") or ("invalid", "") for what is no Python.

    `known`: the tests to choose of, and what they call; when empty, all of `runs` are made, one after the other.
    `before`: tests that killed another slip, those to begin with first.
    """
    text = slip.text()
    try:
        compile(text, slip.path, "exec")
    except SyntaxError:
        return "invalid", ""
    chosen = tests_for(slip, known)
    chosen = [*(n for n in before if n in chosen), *(n for n in chosen if n not in before)]
    if known and not chosen:
        return "survived", ""
    files = list(dict.fromkeys(name.partition("::")[0] for name in chosen))
    seconds = sum(known[name].seconds for name in chosen) if known else None
    with tempfile.TemporaryDirectory() as folder:
        os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = folder
        planted = Path(folder, "mutant.json")
        planted.write_text(json.dumps([os.path.realpath(ROOT / slip.path), text]), encoding="utf-8")
        for part in [files] if known else runs:
            by = failing(part, chosen, planted, seconds)
            if by:
                return "killed", by
    return "survived", ""


def passes(test: str) -> bool:
    """Whether a test, by its name, passes as the tree is."""
    return not failing([test.partition("::")[0]], [test] if "::" in test else [])


def _digest(room: Room) -> str:
    """Changes with the room's modules and tests."""
    digest = hashlib.sha256(repr(room.tests).encode())
    for path in sorted({*room.modules, *(test.partition(" -k ")[0] for test in room.tests)}):
        digest.update(path.encode() + (ROOT / path).read_bytes())
    return digest.hexdigest()[:12]


def _recorded(room: Room) -> dict[str, Seen]:
    """What the room's tests call, as long as they and its modules are what they were. ValueError: one fails."""
    place = KEPT / f"{room.name}-{_digest(room)}.json"
    if place.exists():
        stored = json.loads(place.read_text(encoding="utf-8"))
        return {n: Seen(frozenset(calls), elsewhere, took) for n, (calls, elsewhere, took) in stored.items()}
    known = record(room.runs, room.modules)
    told = {name: [sorted(test.calls), test.elsewhere, test.seconds] for name, test in known.items()}
    place.write_text(json.dumps(told), encoding="utf-8")
    return known


def _judged(chosen: list[tuple[Room, Slip]]) -> Iterator[tuple[Room, Slip, dict[str, Any]]]:
    """The slips with their verdicts, a room after the other; those that are known already are not judged again."""
    path = KEPT / "python.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    stored = {entry["key"]: entry for entry in map(json.loads, lines)}
    with path.open("a", encoding="utf-8") as file:
        for room in {room.name: room for room, _ in chosen}.values():
            known: dict[str, Seen] = {}
            before: list[str] = []
            sound: set[str] = set()  # tests that pass alone without a slip, too
            now = _digest(room)
            for slip in [slip for r, slip in chosen if r.name == room.name]:
                entry = stored.get(slip.key)
                if entry is None or (entry["verdict"] == "survived" and entry.get("tests") != now):
                    known = known or _recorded(room)
                    begin = time.monotonic()
                    verdict, by = judge(slip, room.runs, known, before)
                    test = by if by in known else by.partition(": ")[0]  # a file whose process crashed
                    if verdict == "killed" and test not in sound:
                        if not passes(test):
                            raise ValueError(by)
                        sound.add(test)
                    if by in known:
                        before = [by, *(name for name in before if name != by)][:BEFORE]
                    entry = {"key": slip.key, "verdict": verdict, "by": by, "room": room.name, "slip": slip.name}
                    took = round(time.monotonic() - begin, 1)
                    file.write(json.dumps({**entry, "tests": now, "seconds": took}) + "\n")
                    file.flush()
                yield room, slip, entry


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation.python", description="Mutants of Python modules.")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--room", action="append", default=[], choices=[room.name for room in rooms()])
    parser.add_argument("--list", action="store_true", help="run nothing")
    options = parser.parse_args()
    chosen = sample(options.count, options.seed, options.room)
    if options.list:
        for room, slip in chosen:
            print(f"{room.name}: {slip.name}")
        return 0
    KEPT.mkdir(parents=True, exist_ok=True)
    prepare()
    os.environ["PYTEST_ADDOPTS"] = "-p tests.tools.tiers --tier test"
    counts: dict[str, Counter[str]] = {room.name: Counter() for room, _ in chosen}
    equivalent, wrong = listed(everything())
    try:
        for room, slip, entry in _judged([(room, slip) for room, slip in chosen if slip not in equivalent]):
            counts[room.name][entry["verdict"]] += 1
            if entry["verdict"] == "survived":
                print(f"  survived: {room.name}: {slip.name}", flush=True)
    except ValueError as error:
        print(f"{error}: failed without a slip, expected to pass first", file=sys.stderr)
        return 2
    print(*wrong, sep="\n", end="\n" if wrong else "")
    missed = len(wrong)
    for room in sorted({room.name: room for room, _ in chosen}.values(), key=lambda room: room.name):
        kinds = counts[room.name]
        counted = kinds["killed"] + kinds["survived"]
        share = kinds["killed"] / counted if counted else 1.0
        missed += share < room.share
        print(f"{room.name}: {kinds['killed']} of {counted} killed, {share:.0%} (at least {room.share:.0%})")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
