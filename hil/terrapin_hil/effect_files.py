"""Effects in a user's own files: the one-file form of the catalogue (physics/effects), read and never executed.

A file states `EFFECT = Effect(...)` with texts, numbers, tuples, dictionaries and `Parameter(...)`. It is Python to
look at, and to move into the catalogue as it is, but here its syntax tree is copied piece by piece with a whitelist: a
file from a stranger can describe an effect, and do nothing else.
"""

from __future__ import annotations

import ast
import math
import operator
import os
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from terrapin_hil.physics.effects import Effect, Parameter, catalogue
from terrapin_hil.physics.expression import parse
from terrapin_hil.reading import ReadingError, python_tree, shorten
from terrapin_hil.units import read_unit

__all__ = ["known_effects", "read_effect_file", "read_effect_folder", "user_folder"]

MAX_SIZE = 100_000  # bytes of a file
KINDS: Mapping[str, tuple[type | tuple[type, ...], str]] = {
    "str": (str, "text"),
    "float": ((int, float), "a number"),
    "bool": (bool, "True or False"),
    "tuple[str, ...]": (tuple, "a tuple of texts such as ('rolling_steady',)"),
    "tuple[float, ...]": (tuple, "a tuple of numbers"),
    "tuple[tuple[str, ...], ...]": (tuple, "a tuple of tuples of roles such as (('omega',),)"),
    "tuple[Parameter, ...]": (tuple, "a tuple of Parameter(...)"),
    "Mapping[str, str]": (dict, "a dictionary of texts"),
    "Mapping[str, float]": (dict, "a dictionary of numbers"),
}
INSIDE: Mapping[str, type | tuple[type, ...]] = {
    "tuple[str, ...]": str,
    "tuple[float, ...]": (int, float),
    "tuple[tuple[str, ...], ...]": tuple,
    "tuple[Parameter, ...]": Parameter,
    "Mapping[str, str]": str,
    "Mapping[str, float]": (int, float),
}
ARITHMETIC: Mapping[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
NAMES = {"pi": math.pi, "inf": math.inf, "nan": math.nan}
# A file may import these as if it were run; the second name is the one that files of before the packages had names of
# their own carry.
IMPORTS = ("terrapin_hil.physics.effects", "hil.physics.effects", "math", "__future__")
STAGES = ("channel", "gain", "measured")


def user_folder() -> Path:
    """Where a user keeps effects for all cases and scenarios: $XDG_CONFIG_HOME/terrapin/effects."""
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "terrapin" / "effects"


def known_effects() -> dict[str, Effect]:
    """The catalogue and the user's own effects, by name. ReadingError names file and line of what is wrong."""
    return {**catalogue(), **read_effect_folder(user_folder(), catalogue())}


def read_effect_folder(folder: Path, taken: Mapping[str, Effect]) -> dict[str, Effect]:
    """Every *.py file of a folder as an effect; none when there is no such folder. `taken` are names in use."""
    found: dict[str, Effect] = {}
    try:
        files = sorted(folder.glob("[!_.]*.py"))
    except OSError as error:
        raise ReadingError(f"{folder}: {error.strerror}, expected a folder of effects") from None
    for file in files:
        effect = read_effect_file(file)
        if effect.name in taken or effect.name in found:
            raise ReadingError(f"{file}: the name {effect.name} is in use, expected another")
        found[effect.name] = effect
    return found


def read_effect_file(file: Path) -> Effect:
    """The effect that a file describes. ReadingError: one line with file and line."""
    try:
        if file.stat().st_size > MAX_SIZE or not file.is_file():
            raise ReadingError(f"{file}: expected a text file of at most {MAX_SIZE} bytes")
        text = file.read_text(encoding="utf-8-sig")
        tree = python_tree(text, "exec")
    except UnicodeDecodeError:
        raise ReadingError(f"{file}: not a text file in UTF-8") from None
    except OSError as error:
        raise ReadingError(f"{file}: {error.strerror}, expected a readable file") from None
    except SyntaxError as error:
        raise ReadingError(f"{file}:{error.lineno or 1}: not Python: {error.msg}") from None
    except (ValueError, RecursionError, MemoryError) as error:
        raise ReadingError(f"{file}: not Python: {error or 'too deeply nested'}") from None
    reader = _Reader(file)
    try:
        return reader.module(tree)
    except RecursionError:
        raise ReadingError(f"{file}: too deeply nested") from None


class _Reader:
    def __init__(self, file: Path) -> None:
        self.file = file

    def wrong(self, node: ast.AST, message: str) -> ReadingError:
        return ReadingError(f"{self.file}:{getattr(node, 'lineno', 1)}: {message}")

    def module(self, tree: ast.Module) -> Effect:
        effect: Effect | None = None
        for node in tree.body:
            match node:
                case ast.Expr(value=ast.Constant(value=str())):  # the docstring
                    continue
                case ast.ImportFrom(module=name) if name in IMPORTS:
                    continue
                case ast.Assign(targets=[ast.Name(id="EFFECT")], value=value):
                    found = self.value(value)
                    if not isinstance(found, Effect):
                        raise self.wrong(node, "EFFECT is no Effect(...)")
                    effect = self.checked(node, found)
                case _:
                    raise self.wrong(
                        node, f"found {_words(node)}, expected only EFFECT = Effect(...): the file is read, not run"
                    )
        if effect is None:
            raise self.wrong(tree, "EFFECT is missing, expected EFFECT = Effect(name=..., ...)")
        return effect

    def value(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=bool() | str() | float() as value):
                return value
            case ast.Constant(value=int() as value) if abs(value) < 2**53:
                return value
            case ast.Name(id=name) if name in NAMES:
                return NAMES[name]
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self.number(operand)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in ARITHMETIC:
                try:
                    return ARITHMETIC[type(op)](self.number(left), self.number(right))
                except ArithmeticError as error:
                    raise self.wrong(node, str(error)) from None
            case ast.Tuple(elts=elements) | ast.List(elts=elements):
                return tuple(self.value(element) for element in elements)
            case ast.Call(
                func=ast.Name(id="tuple"),
                args=[
                    ast.Call(
                        func=ast.Name(id="map"),
                        args=[
                            ast.Name(id="float"),
                            ast.Call(
                                func=ast.Name(id="range"),
                                args=[ast.Constant(value=int(first)), ast.Constant(value=int(end))],
                            ),
                        ],
                    )
                ],
            ) if 0 <= first < end <= 1000:
                return tuple(map(float, range(first, end)))
            case ast.Dict(keys=keys, values=values):
                return {self.key(node, key): self.value(value) for key, value in zip(keys, values, strict=True)}
            case ast.Call(func=ast.Name(id="Effect"), args=args, keywords=keywords):
                return self.record(node, Effect, args, keywords)
            case ast.Call(func=ast.Name(id="Parameter"), args=args, keywords=keywords):
                return self.record(node, Parameter, args, keywords)
            case _:
                raise self.wrong(
                    node, f"found {shorten(ast.unparse(node))}, expected text, a number, a tuple or Parameter(...)"
                )

    def number(self, node: ast.expr) -> float:
        value = self.value(node)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.wrong(node, f"found {shorten(ast.unparse(node))}, expected a number")
        return value

    def key(self, node: ast.AST, key: ast.expr | None) -> str:
        value = None if key is None else self.value(key)
        if not isinstance(value, str):
            raise self.wrong(node, "expected texts as keys")
        return value

    def record(self, node: ast.Call, kind: type, args: list[ast.expr], keywords: list[ast.keyword]) -> Any:
        """Effect(...) or Parameter(...), each field of the type that the class states."""
        known = {field.name: str(field.type) for field in fields(kind)}
        given: dict[str, Any] = {}
        where: dict[str, ast.expr] = {}
        pairs = [*zip(known, args, strict=False), *((keyword.arg, keyword.value) for keyword in keywords)]
        if len(args) > len(known):
            raise self.wrong(node, f"{kind.__name__} takes at most {len(known)} values")
        for name, value in pairs:
            if name not in known:
                raise self.wrong(value, f"{kind.__name__} has no field {name}, expected one of {', '.join(known)}")
            if name in given:
                raise self.wrong(value, f"{name} is given twice")
            given[name], where[name] = self.value(value), value
            self.fits(value, name, known[name], given[name])
        try:
            return kind(**given)
        except TypeError as error:
            missing = str(error).partition("missing ")[2] or str(error)
            raise self.wrong(node, f"{kind.__name__}: missing {missing}") from None

    def fits(self, node: ast.expr, name: str, kind: str, value: Any) -> None:
        expected, words = KINDS[kind]
        good = isinstance(value, expected) and (kind == "bool" or not isinstance(value, bool))
        if good and kind in INSIDE:
            inside = value.values() if isinstance(value, dict) else value
            good = all(isinstance(v, INSIDE[kind]) and not isinstance(v, bool) for v in inside)
            if good and kind == "tuple[tuple[str, ...], ...]":
                good = all(isinstance(text, str) for group in value for text in group)
        if not good:
            raise self.wrong(node, f"{name}: found {shorten(ast.unparse(node))}, expected {words}")

    def checked(self, node: ast.AST, effect: Effect) -> Effect:
        """The effect, if it means something: ReadingError otherwise."""
        if not effect.name.isidentifier():
            raise self.wrong(node, f"name: found {effect.name!r}, expected letters, digits and _")
        if not effect.parameters:
            raise self.wrong(node, "parameters: found none, expected at least the effect's size")
        try:
            names = parse(effect.expression).names
        except ValueError as error:
            raise self.wrong(node, f"expression: {error}") from None
        for parameter in effect.parameters:
            at = f"parameter {parameter.name}"
            if parameter.name not in names:
                raise self.wrong(node, f"{at} does not occur in the expression")
            numbers = (parameter.start, *parameter.grid)
            if not all(parameter.minimum <= v <= parameter.maximum and math.isfinite(v) for v in numbers):
                raise self.wrong(node, f"{at}: start or grid outside {parameter.minimum:g} to {parameter.maximum:g}")
            try:
                read_unit(parameter.unit)
            except ValueError as error:
                raise self.wrong(node, f"{at}: {error}") from None
        if len({p.name for p in effect.parameters}) < len(effect.parameters):
            raise self.wrong(node, "parameters: a name stands twice")
        if effect.parameters[0].start != 0.0:
            raise self.wrong(
                node, f"parameter {effect.parameters[0].name}: found start {effect.parameters[0].start:g}, expected 0: "
                "the first parameter is the effect's size"
            )  # fmt: skip
        if effect.stage not in STAGES:
            raise self.wrong(node, f"stage: found {effect.stage!r}, expected one of {', '.join(STAGES)}")
        if effect.where not in ("robot", "ground"):
            raise self.wrong(node, f"where: found {effect.where!r}, expected robot or ground")
        return effect


def _words(node: ast.AST) -> str:
    return shorten(ast.unparse(node).splitlines()[0])
