"""Would the tests see a slip in Python, where one misleads or lets in? `python -m tests.mutation.python --count 400`.

    --count N         a seeded sample over the rooms (60)
    --room NAME       one room alone; may be repeated
    --seed N          of the sample (1)
    --list            what there is, and what the sample would be; nothing is run

A mutant is a module with one slip: comparison, sum, product or logic turned round, an operand dropped, a condition
always true or false, min for max, two arguments exchanged, a constant or an index one off, a statement left out. It is
run with the test files of its room (rooms.toml), quickest first, until one fails, in a process of its own that sees the
changed text in place of the module's (inside/sitecustomize.py); so do processes that a test starts. Survivors are
printed; status 1 when a room's share is below its bound. Results are JSON lines in out/mutation/python.jsonl and are
not made again.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import math
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from terrapin_hil.paths import ROOT

__all__ = ["Room", "Slip", "judge", "passes", "rooms", "slips"]

LIMIT = 300  # s of the processor for all of a mutant's tests; a mutant that takes longer is killed, and counts as seen
NO_TESTS = 5  # of pytest: all that was chosen is of the other tier
WAITED = 1800.0  # s by the clock
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


@dataclass(frozen=True)
class Room:
    """Modules, the test files that should see a slip in them, and the share that they must see."""

    name: str
    modules: tuple[str, ...]
    tests: tuple[str, ...]
    share: float


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
    def name(self) -> str:
        told = " ".join(f"{self.old} -> {self.new or 'nothing'}".split())
        return f"{self.path}:{self.line} {self.function}: {told[:160]}"

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
            other = (
                ast.Attribute(node.func.value, NAMED[name])
                if isinstance(node.func, ast.Attribute)
                else ast.Name(NAMED[name])
            )
            yield ast.Call(other, node.args, node.keywords)
        if len(node.args) > 1 and not any(
            isinstance(a, ast.Starred | ast.Constant | ast.JoinedStr) for a in node.args[:2]
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


def _run(tests: tuple[str, ...], environment: dict[str, str]) -> tuple[bool, str]:
    """Whether a test failed (or took too long), and its name."""
    plugins = [word for name in ("cacheprovider", "xdist", "schemathesis") for word in ("-p", f"no:{name}")]
    for test in tests:
        file, _, words = test.partition(" -k ")
        command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "--tb=no", *plugins, file]
        command += ["-k", words] if words else []
        process = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            start_new_session=True, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT + 1)),
        )  # fmt: skip
        try:
            out, _ = process.communicate(timeout=WAITED)
        except subprocess.TimeoutExpired:
            return True, f"{file}: no end"
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        if process.returncode not in (0, NO_TESTS):
            return True, next(
                (line.partition(" - ")[0] for line in out.splitlines() if line.startswith("FAILED")), file
            )
    return False, ""


def passes(file: str) -> bool:
    """Whether a test file passes as the tree is."""
    return not _run((file,), dict(os.environ))[0]


def judge(slip: Slip, room: Room) -> tuple[str, str]:
    """("killed", by which test) or ("survived", "") or ("invalid", "") for what is no Python."""
    text = slip.text()
    try:
        compile(text, slip.path, "exec")
    except SyntaxError:
        return "invalid", ""
    with tempfile.TemporaryDirectory() as folder:
        planted = Path(folder, "mutant.json")
        planted.write_text(json.dumps([os.path.realpath(ROOT / slip.path), text]), encoding="utf-8")
        path = os.pathsep.join([str(Path(__file__).with_name("inside")), os.environ.get("PYTHONPATH", "")])
        environment = {**os.environ, "TERRAPIN_MUTANT": str(planted), "PYTHONPATH": path.rstrip(os.pathsep)}
        failed, by = _run(room.tests, environment)
    return ("killed", by) if failed else ("survived", "")


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
    path = ROOT / "out" / "mutation" / "python.jsonl"
    path.parent.mkdir(parents=True, exist_ok=True)
    known = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        entry = json.loads(line)
        known[entry["key"]] = entry
    counts: dict[str, Counter[str]] = {room.name: Counter() for room, _ in chosen}
    used = sorted({room.name: room for room, _ in chosen}.values(), key=lambda room: room.name)
    for room in used:
        if any(room is r and s.key not in known for r, s in chosen) and (told := _run(room.tests, dict(os.environ)))[0]:
            print(f"{room.name}: {told[1]}: failed without a mutant, expected to pass first", file=sys.stderr)
            return 2
    with path.open("a", encoding="utf-8") as file:
        for room, slip in chosen:
            entry = known.get(slip.key)
            if entry is None or entry["verdict"] == "survived":
                begin = time.monotonic()
                verdict, by = judge(slip, room)
                entry = {"key": slip.key, "verdict": verdict, "by": by, "room": room.name, "slip": slip.name}
                file.write(json.dumps({**entry, "seconds": round(time.monotonic() - begin, 1)}) + "\n")
                file.flush()
            counts[room.name][entry["verdict"]] += 1
            if entry["verdict"] == "survived":
                print(f"  survived: {room.name}: {slip.name}", flush=True)
    missed = 0
    for room in used:
        kinds = counts[room.name]
        counted = kinds["killed"] + kinds["survived"]
        share = kinds["killed"] / counted if counted else 1.0
        missed += share < room.share
        print(f"{room.name}: {kinds['killed']} of {counted} killed, {share:.0%} (at least {room.share:.0%})")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
