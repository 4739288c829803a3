"""Formulas as text: read with a whitelist, evaluated over arrays, written as LaTeX, checked for units.

A formula is arithmetic over names and numbers: + - * / **, one comparison at a time, and the functions
abs sign sqrt exp log sin cos tan tanh min max. Nothing else is understood, and nothing of the text is ever executed:
Python's own parser gives a tree, this module copies the allowed nodes into its own and refuses the rest.

>>> e = parse("f_s * omega**2 * sign(omega)")
>>> sorted(e.names)
['f_s', 'omega']
>>> float(e.evaluate({"f_s": 0.5, "omega": -2.0}))
-2.0
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from keyword import iskeyword
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.reading import python_tree
from terrapin_hil.units import unit_in_formula

if TYPE_CHECKING:
    import pint

__all__ = ["FUNCTIONS", "Expression", "is_name", "parse"]


MAX_LENGTH = 1000  # characters; keeps the parser's and our own recursion bounded
MAX_DEPTH = 150  # of operations inside each other (a sum of n terms has n): everything below follows the tree


@dataclass(frozen=True)
class Number:
    value: float


@dataclass(frozen=True)
class Name:
    name: str


@dataclass(frozen=True)
class Operation:
    """An operator or a function with its arguments; `sign` names are those of the whitelist, "neg" is unary minus."""

    kind: str
    arguments: tuple[Node, ...]


Node: TypeAlias = Number | Name | Operation

_BINARY = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
_SIGNS = {ast.BitOr: "|", ast.BitAnd: "&", ast.Mod: "%", ast.FloorDiv: "//", ast.MatMult: "@", ast.BitXor: "^"}
_SIGNS |= {ast.LShift: "<<", ast.RShift: ">>"}
_MEANT = {
    ast.BitXor: "^ is not known: a power is written **",
    ast.BitOr: "| is not known: a magnitude is written abs(x)",
}
_COMPARE = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
# Two operands without an operator between them: 2 x, 2x, k (x), (a)(b); 2e3 and 2e-3 are numbers.
_BESIDE = re.compile(r"[\w.)]\s+(?=[\w(])|\)(?=[\w(])|(?<![\w.])[\d.]*\d(?=(?!e[-+]?\d)[A-Za-z_(])")
FUNCTIONS = ("abs", "sign", "sqrt", "exp", "log", "sin", "cos", "tan", "tanh", "min", "max")

_NUMPY: dict[str, Any] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "**": np.power,
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    "==": np.equal,
    "!=": np.not_equal,
    "neg": np.negative,
    "abs": np.abs,
    "sign": np.sign,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "tanh": np.tanh,
    "min": np.minimum,
    "max": np.maximum,
}


def is_name(text: str) -> bool:
    """Whether formulas can use it as a name.

    >>> [name for name in ("temp_1", "\u00d6l", "T [K]", "lambda", "max") if is_name(name)]
    ['temp_1']
    """
    plain = text.isascii() and text.isidentifier() and not text.startswith("__")
    return plain and not iskeyword(text) and text not in FUNCTIONS


@lru_cache(maxsize=1024)
def parse(text: str) -> Expression:
    """Read a formula. ValueError with the column (from 1) and the reason when it is not one.

    >>> parse("2 * open(x)")
    Traceback (most recent call last):
        ...
    ValueError: column 5: unknown function open; known: abs sign sqrt exp log sin cos tan tanh min max
    """
    if len(text) > MAX_LENGTH:
        raise ValueError(f"column {MAX_LENGTH}: formula longer than {MAX_LENGTH} characters")
    for column, letter in enumerate(text, 1):
        if not " " <= letter <= "~":
            raise ValueError(f"column {column}: character {letter!r} is not printable ASCII")
    stripped = text.strip()
    if not stripped:
        raise ValueError("column 1: empty formula")
    offset = len(text) - len(text.lstrip())
    try:
        tree = python_tree(stripped, "eval")
    except SyntaxError as error:
        column, reason = _mistake(stripped, error)
        raise ValueError(f"column {column + offset}: {reason}") from None
    except (ValueError, MemoryError, RecursionError) as error:
        raise ValueError(f"column 1: not a formula: {error or 'too deeply nested'}") from None
    try:
        converted = _convert(tree.body, stripped, offset)
        if _depth(converted) > MAX_DEPTH:
            raise RecursionError
        return Expression(stripped, converted)
    except RecursionError:
        raise ValueError("column 1: not a formula: too deeply nested") from None


def _mistake(text: str, error: SyntaxError) -> tuple[int, str]:
    """Column, from 1, and reason of what Python's parser refuses, in words of formulas where it has none."""
    if equals := re.search(r"(?<![<>=!:])=(?!=)", text):
        return equals.start() + 1, (
            "not a formula: what it is equal to is chosen beside it, expected what stands right of ="
        )
    if "|" in text:
        return text.index("|") + 1, f"operator {_MEANT[ast.BitOr]}"
    if text[-1] in "+-*/<>=":
        return len(text) + 1, "not a formula: it ends where a name, a number or ( is expected"
    if beside := _BESIDE.search(text):
        return beside.end() + 1, f"not a formula: expected an operator (+ - * / **) before {text[beside.end() :]}"
    return error.offset or 1, f"not a formula: {error.msg}"


def _convert(node: ast.expr, text: str, offset: int) -> Node:
    """A node of Python's tree as one of ours; `offset`: spaces before `text`."""

    def refuse(reason: str, column: int = node.col_offset) -> ValueError:
        return ValueError(f"column {column + 1 + offset}: {reason}")

    match node:
        case ast.Constant(value=value):
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise refuse(f"{value!r} is not a number")
            try:
                number = float(value)
            except OverflowError:
                number = math.inf
            if not math.isfinite(number):
                raise refuse("number out of range")
            return Number(number)
        case ast.Name(id=name):
            if name in FUNCTIONS:
                raise refuse(f"{name} is a function and needs its argument")
            if name.startswith("__"):
                raise refuse(f"{name} is not a name that a formula may use")
            return Name(name)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return Operation("neg", (_convert(operand, text, offset),))
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _convert(operand, text, offset)
        case ast.BinOp(left=left, op=operator, right=right):
            kind = _BINARY.get(type(operator))
            if kind is None:
                sign = _SIGNS[type(operator)]
                reason = f"operator {_MEANT.get(type(operator), f'{sign} is not known; known: + - * / **')}"
                raise refuse(reason, text.index(sign, left.end_col_offset))
            return Operation(kind, (_convert(left, text, offset), _convert(right, text, offset)))
        case ast.Compare(left=left, ops=[operator], comparators=[right]):
            kind = _COMPARE.get(type(operator))
            if kind is None:
                raise refuse("comparison not known; known: < <= > >= == !=")
            return Operation(kind, (_convert(left, text, offset), _convert(right, text, offset)))
        case ast.Compare():
            raise refuse("chained comparison; write one comparison at a time")
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
            if name not in FUNCTIONS:
                raise refuse(f"unknown function {name}; known: {' '.join(FUNCTIONS)}")
            if any(isinstance(argument, ast.Starred) for argument in args):
                raise refuse("* before an argument")
            many = name in ("min", "max")
            if len(args) < 2 if many else len(args) != 1:
                raise refuse(f"{name} takes {'two or more arguments' if many else 'one argument'}, not {len(args)}")
            arguments = tuple(_convert(argument, text, offset) for argument in args)
            result = arguments[0] if many else Operation(name, arguments)
            for argument in arguments[1:]:
                result = Operation(name, (result, argument))
            return result
        case ast.Call(func=ast.Constant() | ast.BinOp() as func):
            raise refuse(
                "not a formula: expected an operator (+ - * / **) before (", text.index("(", func.end_col_offset)
            )
        case ast.Tuple(elts=[first, *_]):
            reason = "a comma, which parts arguments of min and max; a decimal mark is a point"
            raise refuse(reason, text.index(",", first.end_col_offset))
        case _:
            raise refuse(f"{type(node).__name__} is not allowed in a formula")


@dataclass(frozen=True)
class Expression:
    """A parsed formula. `str()` is its text."""

    text: str
    tree: Node

    def __str__(self) -> str:
        return self.text

    @cached_property
    def names(self) -> frozenset[str]:
        """Every name that the formula uses."""
        return frozenset(_names(self.tree))

    @cached_property
    def divisors(self) -> frozenset[str]:
        """Names that by themselves divide something, or stand under a logarithm or a root: their zero has a meaning."""
        return frozenset(_divisors(self.tree))

    @cached_property
    def exponents(self) -> frozenset[str]:
        """Names that stand in an exponent."""
        return frozenset(_exponents(self.tree))

    @cached_property
    def numbers(self) -> bool:
        """Whether plain numbers stand in it, but for exponents."""
        return _numbers(self.tree)

    def evaluate(self, values: Mapping[str, Array | float]) -> Array:
        """Value over arrays (broadcast against each other); comparisons give 0.0 or 1.0.

        KeyError when a name has no value. Where arithmetic has no real value (log of a negative number, 0/0) the result
        is NaN or infinite and no warning is given: the caller checks.
        """
        with np.errstate(all="ignore"):
            return np.asarray(_evaluate(self.tree, values), dtype=np.float64)

    def unit(self, units: Mapping[str, str]) -> pint.Unit:
        """The unit that the formula yields when its names have `units` (pint's spelling, ^ or **).

        A plain number beside a quantity (`temperature - 25`) takes its unit; degC counts as K, degF as degR.
        ValueError when kinds of quantity are mixed; KeyError when a name has no unit.
        """
        unit: pint.Unit | None = _unit(self.tree, units, self.text)
        return unit_in_formula("1") if unit is None else unit

    def to_latex(self) -> str:
        """The formula for people, as LaTeX."""
        return _to_latex(self.tree)[0]


def _depth(node: Node) -> int:
    depth, level = 0, [node]
    while level:
        depth += 1
        level = [a for n in level if isinstance(n, Operation) for a in n.arguments]
    return depth


def _names(node: Node) -> set[str]:
    if isinstance(node, Name):
        return {node.name}
    if isinstance(node, Operation):
        return set().union(*(_names(a) for a in node.arguments))
    return set()


def _divisors(node: Node) -> set[str]:
    if not isinstance(node, Operation):
        return set()
    below = {"/": node.arguments[1:], "log": node.arguments, "sqrt": node.arguments}.get(node.kind, ())
    own = {argument.name for argument in below if isinstance(argument, Name)}
    return own.union(*(_divisors(a) for a in node.arguments))


def _exponents(node: Node) -> set[str]:
    if not isinstance(node, Operation):
        return set()
    own = _names(node.arguments[1]) if node.kind == "**" else set()
    return own.union(*(_exponents(a) for a in node.arguments))


def _numbers(node: Node) -> bool:
    if not isinstance(node, Operation):
        return isinstance(node, Number)
    return any(_numbers(a) for a in (node.arguments[:1] if node.kind == "**" else node.arguments))


def _evaluate(node: Node, values: Mapping[str, Array | float]) -> Any:
    if isinstance(node, Number):
        return node.value
    if isinstance(node, Name):
        return values[node.name]
    if node.kind == "**" and isinstance(node.arguments[1], Number) and node.arguments[1].value == 2.0:
        base = np.asarray(_evaluate(node.arguments[0], values), dtype=np.float64)
        return base * base  # the same rounding as in program.c
    result = _NUMPY[node.kind](*(np.asarray(_evaluate(a, values), dtype=np.float64) for a in node.arguments))
    return np.asarray(result, dtype=np.float64) if node.kind in _COMPARE.values() else result


def _unit(node: Node, given: Mapping[str, str], text: str) -> Any:
    """None: a plain number, which fits beside anything."""
    if isinstance(node, Number):
        return None
    if isinstance(node, Name):
        return unit_in_formula(given[node.name])
    arguments = [_unit(a, given, text) for a in node.arguments]
    one = unit_in_formula("1")
    match node.kind:
        case "neg" | "abs":
            return arguments[0]
        case "+" | "-" | "min" | "max" | "<" | "<=" | ">" | ">=" | "==" | "!=":
            left, right = arguments
            if left is not None and right is not None and left.dimensionality != right.dimensionality:
                raise ValueError(f"{text}: {node.kind} between {left:~} and {right:~}")
            if node.kind in _COMPARE.values():
                return one
            return left if left is not None else right
        case "*" | "/":
            left, right = (one if a is None else a for a in arguments)
            if arguments == [None, None]:
                return None
            return left * right if node.kind == "*" else left / right
        case "**":
            base, exponent = arguments
            if exponent is not None and exponent.dimensionality:
                raise ValueError(f"{text}: exponent has the unit {exponent:~}")
            if base is None:
                return None if exponent is None else one
            if not base.dimensionality:
                return one
            if _names(node.arguments[1]):
                raise ValueError(f"{text}: a quantity in {base:~} raised to a power that is not a plain number")
            return base ** float(_evaluate(node.arguments[1], {}))
        case "sqrt":
            return None if arguments[0] is None else arguments[0] ** 0.5
        case "sign":
            return one
        case _:
            if arguments[0] is not None and arguments[0].dimensionality:
                raise ValueError(f"{text}: {node.kind} of a quantity in {arguments[0]:~}")
            return None if arguments[0] is None else one


_GREEK = (
    *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda", "mu"),
    *("nu", "xi", "pi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega"),
)


def _symbol(name: str) -> str:
    head, _, tail = name.rstrip("_").partition("_")
    root = head.rstrip("0123456789")
    digits = head[len(root) :]
    symbol = f"\\{root}" if root in _GREEK else root if len(root) == 1 else f"\\mathrm{{{root}}}"
    lower = ",".join(part for part in (digits, *tail.split("_")) if part)
    return symbol + (f"_{{\\mathrm{{{lower}}}}}" if lower else "")


def _to_latex(node: Node) -> tuple[str, int]:
    """LaTeX and how tightly it binds: 1 comparison, 2 sum, 3 product, 4 power, 5 atom."""
    if isinstance(node, Number):
        text = f"{node.value:.12g}"
        if "e" in text:
            mantissa, exponent = text.split("e")
            return (f"{mantissa}\\cdot 10^{{{int(exponent)}}}", 3)
        return (text, 5)
    if isinstance(node, Name):
        return (_symbol(node.name), 5)
    parts = [_to_latex(a) for a in node.arguments]

    def within(index: int, level: int) -> str:
        text, binds = parts[index]
        return text if binds >= level else f"\\left({text}\\right)"

    match node.kind:
        case "+":
            return (f"{within(0, 2)} + {within(1, 2)}", 2)
        case "-":
            return (f"{within(0, 2)} - {within(1, 3)}", 2)
        case "*":
            gap = "\\cdot " if isinstance(node.arguments[1], Number) else "\\,"
            leads = isinstance(node.arguments[0], Operation) and node.arguments[0].kind == "neg"
            return (f"{within(0, 2 if leads else 3)}{gap}{within(1, 3)}", 2 if leads else 3)
        case "/":
            return (f"\\frac{{{parts[0][0]}}}{{{parts[1][0]}}}", 4)
        case "**":
            return (f"{within(0, 5)}^{{{parts[1][0]}}}", 4)
        case "neg":
            return (f"-{within(0, 3)}", 2)
        case "abs":
            return (f"\\left|{parts[0][0]}\\right|", 5)
        case "sqrt":
            return (f"\\sqrt{{{parts[0][0]}}}", 5)
        case "exp":
            return (f"e^{{{parts[0][0]}}}", 4)
        case "sign":
            return (f"\\mathrm{{sgn}}\\left({parts[0][0]}\\right)", 5)
        case "min" | "max":
            return (f"\\{node.kind}\\left({parts[0][0]},\\,{parts[1][0]}\\right)", 5)
        case "<" | "<=" | ">" | ">=" | "==" | "!=":
            sign = {"<=": "\\le", ">=": "\\ge", "==": "=", "!=": "\\ne"}.get(node.kind, node.kind)
            return (f"\\left[{parts[0][0]} {sign} {parts[1][0]}\\right]", 5)
        case _:
            return (f"\\{node.kind}\\left({parts[0][0]}\\right)", 5)
