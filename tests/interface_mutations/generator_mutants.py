"""The generator with one operator, number or sign changed: something must notice.

Mutated are the Python that decides bytes (codec, scaling, dbc, description) by its syntax tree, and the C that stands
in texts of codec and scaling token by token. A mutant is caught when the generator fails on
a good description, accepts one of planted.py's bad ones or refuses it for another reason, or when the oracle finds what
it made of the controller's description, or of a small one with what the controller does not use, to be wrong. One that
makes the same files and refusals is not caught; those that cannot make a difference stand in EQUIVALENT with a reason.
"""

from __future__ import annotations

import ast
import copy
import json
import multiprocessing
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from terrapin_interface.description import CONTROLLER_TOML
from tests.interface_mutations.oracle import compile_core, wrong
from tests.interface_mutations.planted import GOOD, PLANTED, big

__all__ = ["EQUIVALENT", "MUTANTS", "Mutant", "judge"]

PACKAGE = CONTROLLER_TOML.parent
MODULES = ("codec", "scaling", "dbc", "description")
C_TEXT = ("codec", "scaling")
SECONDS = 120
FILES = ("terrapin_interface.h", "terrapin_interface.c", "terrapin_pack.h", "terrapin_scaling.h", "terrapin.dbc",
         "interface.json")  # fmt: skip
COMPARISONS: dict[type, type] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
OPERATIONS: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.FloorDiv, ast.FloorDiv: ast.Mult, ast.Div: ast.Mult,
    ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.BitOr: ast.BitAnd, ast.BitAnd: ast.BitOr,
    ast.BitXor: ast.BitOr, ast.Mod: ast.FloorDiv, ast.Pow: ast.Mult,
}  # fmt: skip
TOKENS = {
    "<<": ">>", ">>": "<<", "<=": "<", ">=": ">", "==": "!=", "!=": "==", "&&": "||", "||": "&&", "|=": "&=",
    "^=": "|=", "+=": "-=", "++": "--", "--": "++", " + ": " - ", " - ": " + ", " & ": " | ", " | ": " & ",
    " ^ ": " | ", " < ": " <= ", " > ": " >= ", " % ": " / ", " / ": " * ",
}  # fmt: skip
TOKEN = re.compile("|".join(map(re.escape, sorted(TOKENS, key=len, reverse=True))) + r"|\b0x[0-9A-F]+|\b\d+")
WORDS = {'"-"': '"+"', '"+"': '"-"', "@1": "@0", ",0)": ",1)"}  # of a DBC: sign, order of bytes, offset
# What is no C that a host compiles: comments, and the branch for the chip's compiler (tests/target compares its bits).
NO_CODE = re.compile(r"/\*.*?\*/|#if defined\(__ARM.*?#else|#(?:ifndef|include|if|endif)[^\n]*|\"[^\"\n]*\"", re.DOTALL)


@dataclass(frozen=True)
class Mutant:
    module: str
    line: int
    number: int  # of the mutants in this module
    what: str

    def text(self) -> str:
        """Of the module with it."""
        return next(
            text for number, (_, text) in enumerate(_mutants(self.module, self.number)) if number == self.number
        )

    @property
    def name(self) -> str:
        return f"{self.module}.py:{self.line} {self.what}"


def _reasons(lines: str) -> dict[str, str]:
    return dict(line.split(" :: ") for line in lines.strip().splitlines())


# Line and change -> why nobody can see it. Kept as lines: most are longer than a line of Python may be.
EQUIVALENT: dict[str, str] = _reasons(Path(__file__).with_name("equivalent.txt").read_text(encoding="utf-8"))


def _nodes(tree: ast.Module) -> Iterator[ast.AST]:
    """Nodes whose value reaches what is generated, or decides what is refused."""

    def visit(node: ast.AST) -> Iterator[ast.AST]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Raise | ast.Import | ast.ImportFrom):
                continue
            if isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant):  # docstring
                continue
            if isinstance(child, ast.Assign) and any(
                isinstance(t, ast.Name) and t.id == "__all__" for t in child.targets
            ):
                continue
            if isinstance(child, ast.arg) or child in getattr(node, "decorator_list", ()):
                continue
            if isinstance(child, ast.AnnAssign) and isinstance(node, ast.ClassDef):  # parse gives every field
                continue
            if isinstance(child, ast.JoinedStr):
                for part in _code(child):
                    yield part
                    yield from visit(part)
                continue
            yield child
            yield from visit(child)

    return visit(tree)


def _code(node: ast.JoinedStr) -> Iterator[ast.AST]:
    """Parts of a text that do not lie in a comment of the C that it becomes."""
    texts = [part.value if isinstance(part, ast.Constant) else "?" for part in node.values]
    dark = [found.span() for found in NO_CODE.finditer("".join(texts))]
    place = 0
    for part, text in zip(node.values, texts, strict=True):
        if not any(begin <= place and place + len(text) <= end for begin, end in dark):
            yield part
        place += len(text)


def _python(node: Any) -> Iterator[tuple[str, Callable[[Any], None]]]:
    """Changes of one node: what it is, and how it is done to a copy of that node."""
    if isinstance(node, ast.Compare):
        for i, operation in enumerate(node.ops):
            other = COMPARISONS[type(operation)]
            yield f"{type(operation).__name__} -> {other.__name__}", lambda n, i=i, o=other: n.ops.__setitem__(i, o())
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATIONS:
        other = OPERATIONS[type(node.op)]
        yield f"{type(node.op).__name__} -> {other.__name__}", lambda n, o=other: setattr(n, "op", o())
    elif isinstance(node, ast.AugAssign) and type(node.op) in OPERATIONS:
        other = OPERATIONS[type(node.op)]
        yield f"{type(node.op).__name__}= -> {other.__name__}=", lambda n, o=other: setattr(n, "op", o())
    elif isinstance(node, ast.BoolOp):
        other = ast.Or if isinstance(node.op, ast.And) else ast.And
        yield f"{type(node.op).__name__} -> {other.__name__}", lambda n, o=other: setattr(n, "op", o())
    elif isinstance(node, ast.IfExp):
        yield "branches swapped", lambda n: n.__dict__.update(body=n.orelse, orelse=n.body)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        replacement = ast.UAdd if isinstance(node.op, ast.USub) else None
        if replacement:
            yield "- -> +", lambda n: setattr(n, "op", ast.UAdd())
        else:
            yield "not removed", lambda n: n.__dict__.update(op=ast.Not(), operand=ast.UnaryOp(ast.Not(), n.operand))
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield f"{node.value} -> {not node.value}", lambda n: setattr(n, "value", not n.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int):
        for step in (1, -1):
            yield f"{node.value} -> {node.value + step}", lambda n, s=step: setattr(n, "value", n.value + s)


def _texts(module: str, node: ast.Constant) -> Iterator[tuple[str, Callable[[Any], None]]]:
    text = node.value
    if module == "dbc":
        for old, new in WORDS.items():
            if old in f'"{text}"' if old.startswith('"') else old in text:
                changed = new.strip('"') if old.startswith('"') else text.replace(old, new)
                yield f"{old} -> {new}", lambda n, c=changed: setattr(n, "value", c)
        return
    dark = [found.span() for found in NO_CODE.finditer(text)]
    for found in TOKEN.finditer(text):
        if any(begin <= found.start() < end for begin, end in dark):
            continue
        token = found[0]
        new = TOKENS.get(token) or (f"0x{int(token, 16) ^ 1:X}" if token.startswith("0x") else str(int(token) + 1))
        line = text.count("\n", 0, found.start())
        around = text[: found.start()].rpartition("\n")[2] + "@" + text[found.start() :].partition("\n")[0]
        changed = text[: found.start()] + new + text[found.end() :]
        yield (
            f"C+{line} {around.strip()[:70]}: {token.strip()} -> {new.strip()}",
            (lambda n, c=changed: setattr(n, "value", c)),
        )


def _mutants(module: str, wanted: int = -1) -> Iterator[tuple[Mutant, str]]:
    """All of a module; with the module's text for the one whose number is `wanted`, since writing it takes its time."""
    source = (PACKAGE / f"{module}.py").read_text(encoding="utf-8")
    tree = ast.parse(source)
    nodes = list(_nodes(tree))
    number = 0
    seen: Counter[str] = Counter()
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            changes = list(_texts(module, node)) if module in (*C_TEXT, "dbc") else []
        else:
            changes = list(_python(node))
        for what, change in changes:
            kept = copy.copy(node.__dict__)
            if isinstance(node, ast.Compare):
                node.ops = list(node.ops)
            change(node)
            text = ast.unparse(tree) if number == wanted else ""
            node.__dict__.update(kept)
            if isinstance(node, ast.Compare):
                node.ops = kept["ops"]
            line = source.splitlines()[node.lineno - 1].strip() if hasattr(node, "lineno") else ""
            what = f"{line[:80]}: {what}"
            seen[what] += 1
            what += f" (number {seen[what]})" if seen[what] > 1 else ""
            yield Mutant(module, getattr(node, "lineno", 0), number, what), text
            number += 1


def _all() -> Iterator[Mutant]:
    for module in MODULES:
        yield from (mutant for mutant, _ in _mutants(module))


MUTANTS: tuple[Mutant, ...] = tuple(_all())

_ATTEMPT = """
import json, sys
from pathlib import Path
package, good, bad, out = sys.argv[1:]
sys.path.insert(0, package)
from terrapin_interface.entries import DescriptionError
from terrapin_interface.generate import generate
for name in json.loads(good):
    generate(Path(name), [], Path(name).parent / "generated")
said = []
file = Path(out).with_name("bad.toml")
for text in json.loads(Path(bad).read_text()):
    file.write_text(text)
    try:
        generate(file, [], file.parent / "bad")
        said.append("")
    except DescriptionError as error:
        said.append(str(error))
Path(out).write_text(json.dumps(said))
"""


class _Workplace:
    """Folders, and what the generator makes when nothing is changed."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="mutants-"))
        self.integer = compile_core(self.folder)
        self.good = {"controller": CONTROLLER_TOML.read_text(encoding="utf-8"), "toy": GOOD, "big": big()}
        for name, text in self.good.items():
            (self.folder / name).mkdir()
            (self.folder / name / "description.toml").write_text(text, encoding="utf-8")
        (self.folder / "bad.json").write_text(json.dumps([GOOD.replace(old, new, 1) for old, new, _ in PLANTED]))
        self.package = self.folder / "package"
        shutil.copytree(PACKAGE, self.package / "terrapin_interface", ignore=shutil.ignore_patterns("__pycache__"))
        self.told = self.attempt()
        assert self.told is not None
        self.made = self.files()

    def attempt(self) -> list[str] | None:
        """Generate both; what the bad ones are refused with. None when it fails."""
        said = self.folder / "said.json"
        command = [sys.executable, "-I", "-B", "-c", _ATTEMPT, str(self.package),
                   json.dumps([str(self.folder / name / "description.toml") for name in self.good]),
                   str(self.folder / "bad.json"), str(said)]  # fmt: skip
        try:
            done = subprocess.run(command, capture_output=True, timeout=30, check=False)
        except subprocess.TimeoutExpired:
            return None
        return json.loads(said.read_text()) if done.returncode == 0 else None

    def files(self) -> dict[str, bytes]:
        return {f"{name}/{file}": (self.folder / name / "generated" / file).read_bytes()
                for name in self.good for file in FILES}  # fmt: skip


@cache
def _workplace() -> _Workplace:
    return _Workplace()


def _watched(text: str, folder: Path, integer: Path | None) -> str:
    """`wrong` in a process of its own: what a mutant does to memory, or never ends, stays there."""
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)

    def work() -> None:
        sender.send(wrong(text, folder, integer))

    process = context.Process(target=work)
    process.start()
    sender.close()
    try:
        if not receiver.poll(SECONDS):
            return "never ends"
        return str(receiver.recv())
    except EOFError:
        return "dies"
    finally:
        process.kill()
        process.join()


def judge(mutant: Mutant) -> tuple[bool, str]:
    """Whether it was caught (or is known to make no difference), and by what."""
    place = _workplace()
    file = place.package / "terrapin_interface" / f"{mutant.module}.py"
    kept = file.read_text(encoding="utf-8")
    file.write_text(mutant.text(), encoding="utf-8")
    try:
        said = place.attempt()
    finally:
        file.write_text(kept, encoding="utf-8")
    if said is None:
        return True, "the generator fails"
    for line, (_, _, expected) in zip(said, PLANTED, strict=True):
        if expected not in line:
            return True, f"refusal: {expected}"
    made = place.files()
    for name, text in place.good.items():
        if any(made[key] != place.made[key] for key in made if key.startswith(f"{name}/")):
            found = _watched(text, place.folder / name / "generated", place.integer if name == "controller" else None)
            if found:
                return True, found
    known = EQUIVALENT.get(mutant.what)
    return known is not None, f"equivalent: {known}" if known else "NOT CAUGHT"
