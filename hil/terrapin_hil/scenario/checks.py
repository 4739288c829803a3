"""What must hold in a run, as one line of text: `max(slip[5:15]) < 0.55`.

Signals are columns of the truth (`slip`, `contact_torque`) and of the telemetry (`GROUND.torque`), all on the grid of
ticks, telemetry held at its last value. `[from:to]` cuts out a time window in seconds, either side may be left out.
What has no value (an empty window, a message that never came) is neither true nor false, and a check of it fails.
`max min mean rms std first last any all count` make one number of a signal (values that are not there yet do not
count), `abs sqrt` act on either; + - * / ** and comparisons as usual, joined by `and`, `or`, `not`. A quoted word is a
value of the enumeration of the signal it is compared with: `any(ACTUATE.state == "stuck")`.
"""

from __future__ import annotations

import ast
import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.errors import UserError
from terrapin_hil.reading import python_tree

__all__ = ["Check", "CheckError", "Outcome", "parse_check", "parse_number", "what_there_is"]


REDUCTIONS: dict[str, Callable[[Array], float]] = {
    "max": lambda a: float(np.max(a)),
    "min": lambda a: float(np.min(a)),
    "mean": lambda a: float(np.mean(a)),
    "rms": lambda a: float(np.sqrt(np.mean(a * a))),
    "std": lambda a: float(np.std(a)),
    "first": lambda a: float(a[0]),
    "last": lambda a: float(a[-1]),
    "any": lambda a: float(np.any(a != 0)),
    "all": lambda a: float(np.all(a != 0)),
    "count": lambda a: float(np.sum(a != 0)),
}
YES_OR_NO = ("any", "all", "first", "last")  # alone they are a check: of a flag the last two, too
FUNCTIONS: dict[str, Callable[[Any], Any]] = {"abs": np.abs, "sqrt": np.sqrt}
BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
COMPARE: dict[type[ast.cmpop], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Lt: ("<", lambda a, b: a < b),
    ast.LtE: ("<=", lambda a, b: a <= b),
    ast.Gt: (">", lambda a, b: a > b),
    ast.GtE: (">=", lambda a, b: a >= b),
    ast.Eq: ("==", lambda a, b: a == b),
    ast.NotEq: ("!=", lambda a, b: a != b),
}


class CheckError(UserError, ValueError):
    """A check cannot be read, or names what the run does not have."""


@dataclass(frozen=True)
class Outcome:
    """Result of a check; `found` is its text with numbers in the place of the signals.

    `numbers`: each part that made one number of a signal, and that number; NaN where it had no value. `missed`: of one
    that failed what was found, what was expected, and by how much it is off.
    """

    text: str
    passed: bool
    found: str
    numbers: tuple[tuple[str, float], ...] = field(default=(), repr=False, compare=False)
    missed: str = field(default="", repr=False, compare=False)


@dataclass(frozen=True)
class Check:
    """A check that was read; `evaluate` holds it against a run."""

    text: str
    tree: ast.expr

    def evaluate(
        self, time: Array, signals: Mapping[str, Array], enums: Mapping[str, Mapping[str, int]] | None = None
    ) -> Outcome:
        """The outcome of the check on a run. CheckError for a name that the run does not have.

        Parameters
        ----------
        time : (ticks,), s.
        signals : by name, each (ticks,).
        enums : signal -> word -> value.
        """
        run = _Run(time, signals, enums or {})
        with np.errstate(all="ignore"):
            value = run.value(self.tree)
        if isinstance(value, np.ndarray):
            raise CheckError(f"{self.text!r} is a signal, not yes or no; put any() or all() around it")
        passed = bool(value) and not np.isnan(value)
        missed = "" if passed else "; ".join(filter(None, (self.missed(run.numbers), self._empty(time))))
        return Outcome(self.text, passed, "; ".join(run.seen), tuple(run.numbers.items()), missed)

    def _empty(self, time: Array) -> str:
        """Which time window has no value, whatever was measured."""
        end = float(time[-1]) if time.size else 0.0
        late = self.beyond(end)
        return f"{late} is empty: the run ends at {end:.4g} s" if late else ""

    def missed(self, numbers: Mapping[str, float]) -> str:
        """What does not hold in a check that failed, and by how much, from its numbers as `Outcome` has them.

        >>> parse_check("max(slip[1:]) < 0.55").missed({"max(slip[1:])": 0.75})
        'max(slip[1:]) is 0.75, expected < 0.55: 0.2 too much'
        """
        try:
            with np.errstate(all="ignore"):
                return ", ".join(_missed(self.tree, _Told(numbers)))
        except CheckError:  # a part that is no number of these
            return ""

    def number(
        self, time: Array, signals: Mapping[str, Array], enums: Mapping[str, Mapping[str, int]] | None = None
    ) -> float:
        """What the text comes to as a number: 1 and 0 for yes and no. Parameters and errors as `evaluate`."""
        with np.errstate(all="ignore"):
            value = _Run(time, signals, enums or {}).value(self.tree)
        if isinstance(value, np.ndarray):
            raise CheckError(f"{self.text!r} is a signal, not a number; put max() or another reduction around it")
        return float(value)

    def beyond(self, end: float) -> str:
        """The first time window that begins after `end` [s], where no run of that length has a value; "" for none.

        >>> parse_number("max(slip[:5]) - max(slip[50:])").beyond(25.0)
        'slip[50:]'
        """
        run = _Run(np.zeros(0), {}, {})
        windows = [node for node in ast.walk(self.tree) if isinstance(node, ast.Subscript)]
        return next((ast.unparse(one) for one in windows if run.bounds(one)[0] > end), "")

    def require(self, signals: Iterable[str], enums: Mapping[str, Mapping[str, int]]) -> None:
        """CheckError unless a run with these signals can be held against the check: found out before the run."""
        self.evaluate(np.zeros(2), dict.fromkeys(signals, np.zeros(2)), enums)


def _known(outcome: Any, *of: Any) -> Any:
    """`outcome`, NaN where a value that it was made of is not there: that is neither true nor false."""
    gone = np.any(np.broadcast_arrays(*(np.isnan(np.asarray(value, dtype=float)) for value in of)), axis=0)
    return np.where(gone, np.nan, outcome)[()] if np.any(gone) else outcome


class _Run:
    def __init__(self, time: Array, signals: Mapping[str, Array], enums: Mapping[str, Mapping[str, int]]) -> None:
        self.time, self.signals, self.enums = time, signals, enums
        self.seen: list[str] = []
        self.numbers: dict[str, float] = {}

    def value(self, node: ast.expr) -> Any:
        if isinstance(node, ast.Constant):
            if isinstance(node.value, str):
                raise CheckError(f"{node.value!r} is a word, which can only be compared with a signal")
            return np.float64(str(node.value))
        if isinstance(node, ast.Name | ast.Attribute):
            return self._signal(ast.unparse(node))
        if isinstance(node, ast.Subscript):
            return self._window(node)
        if isinstance(node, ast.UnaryOp):
            value = self.value(node.operand)
            return _known(np.logical_not(value), value) if isinstance(node.op, ast.Not) else -value
        if isinstance(node, ast.BinOp):
            return BINARY[type(node.op)](self.value(node.left), self.value(node.right))
        if isinstance(node, ast.BoolOp):
            values = [self.value(value) for value in node.values]  # all of them, so that each is reported
            for part, value in zip(node.values, values, strict=True):
                if isinstance(value, np.ndarray):
                    raise CheckError(f"{ast.unparse(part)!r} is a signal, not yes or no; put any() or all() around it")
            decides = isinstance(node.op, ast.Or)
            if any(bool(value) is decides for value in values if not np.isnan(value)):
                return decides
            return np.nan if any(np.isnan(value) for value in values) else not decides
        if isinstance(node, ast.Compare):
            return self._compare(node)
        assert isinstance(node, ast.Call)
        assert isinstance(node.func, ast.Name)
        argument = self.value(node.args[0])
        if node.func.id in FUNCTIONS:
            return FUNCTIONS[node.func.id](argument)
        array = np.atleast_1d(np.asarray(argument, dtype=float))
        array = array[~np.isnan(array)]
        result = REDUCTIONS[node.func.id](array) if array.size else float("nan")
        self.numbers[ast.unparse(node)] = result
        self.seen.append(f"{ast.unparse(node)} = {result:.6g}" if array.size else f"{ast.unparse(node)}: no value")
        return result

    def _signal(self, name: str) -> Array:
        if name not in self.signals:
            raise CheckError(f"the run has no signal '{name}'; {what_there_is(name, self.signals)}")
        return self.signals[name]

    def _window(self, node: ast.Subscript) -> Array:
        low, high = self.bounds(node)
        inside = (self.time >= low) & (self.time <= high)
        return np.where(inside, np.asarray(self.value(node.value), dtype=float), np.nan)

    def bounds(self, node: ast.Subscript) -> tuple[float, float]:
        """Of a time window [s]."""
        assert isinstance(node.slice, ast.Slice)
        return self._second(node.slice.lower, -np.inf), self._second(node.slice.upper, np.inf)

    def _second(self, node: ast.expr | None, absent: float) -> float:
        value = absent if node is None else self.value(node)
        if isinstance(value, np.ndarray):
            raise CheckError("the bound of a time window is a number of seconds, found a signal")
        return float(value)

    def _compare(self, node: ast.Compare) -> Any:
        left: ast.expr = node.left
        result: Any = True
        for operator, right in zip(node.ops, node.comparators, strict=True):
            a, b = self._operand(left, right), self._operand(right, left)
            outcome = _known(COMPARE[type(operator)][1](a, b), a, b)
            result = outcome if result is True else result * outcome
            left = right
        return result

    def _operand(self, node: ast.expr, other: ast.expr) -> Any:
        if not (isinstance(node, ast.Constant) and isinstance(node.value, str)):
            return self.value(node)
        name = next((n for n in (ast.unparse(part) for part in ast.walk(other)) if n in self.enums), "")
        words = self.enums.get(name, {})
        if node.value not in words:
            known = f"; known: {', '.join(words)}" if words else ""
            raise CheckError(f"'{node.value}' is no value of {ast.unparse(other)}{known}")
        return float(words[node.value])


class _Told(_Run):
    """Numbers that were told in the place of the signals that they were made of."""

    def __init__(self, told: Mapping[str, float]) -> None:
        super().__init__(np.zeros(0), {}, {})
        self.told = told

    def value(self, node: ast.expr) -> Any:
        if isinstance(node, ast.Call) and ast.unparse(node) in self.told:
            return np.float64(self.told[ast.unparse(node)])
        return super().value(node)


def _missed(node: ast.expr, run: _Told) -> list[str]:
    """The parts of a check that do not hold."""
    if isinstance(node, ast.BoolOp):
        return [text for part in node.values for text in _missed(part, run)]
    text, value = ast.unparse(node), run.value(node)
    if value and not np.isnan(value):
        return []
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        sign, _ = COMPARE[type(node.ops[0])]
        left, right = run.value(node.left), run.value(node.comparators[0])
        if np.isnan(left) or np.isnan(right):
            return [f"{text}: no value"]
        off = {"<": "too much", ">": "too little"}.get(sign[0], "off")
        yes_or_no = sign == "!=" or {float(left), float(right)} <= {0.0, 1.0}
        by = "" if yes_or_no else f": {abs(left - right):.3g} {off}"
        return [f"{ast.unparse(node.left)} is {left:.4g}, expected {sign} {right:.4g}{by}"]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("all", "any"):
        inner = ast.unparse(node.args[0])
        said = "does not hold all the time" if node.func.id == "all" else "never holds"
        return [f"{inner}: no value" if np.isnan(value) else f"{inner} {said}"]
    return [f"{text} does not hold"]


def _verify(node: ast.AST) -> None:
    """Refuses whatever the language of checks does not have."""
    if isinstance(node, ast.Call):
        known = {*REDUCTIONS, *FUNCTIONS}
        if not isinstance(node.func, ast.Name) or node.func.id not in known:
            raise CheckError(f"unknown function {ast.unparse(node.func)}; known: {' '.join(sorted(known))}")
        if len(node.args) != 1 or node.keywords:
            raise CheckError(f"{node.func.id} takes one argument; a time window is written signal[from:to]")
        _verify(node.args[0])
        return
    if isinstance(node, ast.Attribute) and not isinstance(node.value, ast.Name):
        raise CheckError(f"{ast.unparse(node)} is no signal; telemetry is written MESSAGE.signal")
    if isinstance(node, ast.Subscript) and (not isinstance(node.slice, ast.Slice) or node.slice.step is not None):
        raise CheckError(f"{ast.unparse(node)}: a time window is written signal[from:to], in seconds")
    if isinstance(node, ast.Constant) and (
        isinstance(node.value, bool) or not isinstance(node.value, int | float | str)
    ):
        raise CheckError(f"{ast.unparse(node)} is neither a number nor a word")
    allowed = (
        ast.Name, ast.Attribute, ast.Subscript, ast.Slice, ast.Constant, ast.UnaryOp, ast.USub, ast.Not, ast.BinOp,
        ast.BoolOp, ast.And, ast.Or, ast.Compare, ast.Load, *BINARY, *COMPARE,
    )  # fmt: skip
    if not isinstance(node, allowed):
        raise CheckError(f"cannot be used here: {ast.unparse(node) or type(node).__name__}")
    for child in ast.iter_child_nodes(node):
        _verify(child)


def what_there_is(name: str, signals: Iterable[str]) -> str:
    """What may have been meant: of hundreds of names those that are near, or those of its message."""
    near = difflib.get_close_matches(name, list(signals), 1)
    message, dot, _ = name.partition(".")
    same = sorted(known for known in signals if known.startswith(f"{message}."))
    alone = sorted(known for known in signals if "." not in known)
    messages = sorted({known.partition(".")[0] for known in signals if "." in known})
    said = [f"is `{near[0]}` meant?"] if near else []
    if dot and same:
        said.append(f"{message} has {', '.join(same)}")
    else:
        kinds = [", ".join(alone)] * bool(alone) + [f"MESSAGE.signal of {', '.join(messages)}"] * bool(messages)
        said.append(f"it has {', and '.join(kinds)}")
    return " ".join(said)


def parse_check(text: str) -> Check:
    """Reads a check. CheckError (a ValueError) says what is wrong with it.

    >>> import numpy as np
    >>> check = parse_check("max(slip[1:]) < 0.55")
    >>> check.evaluate(np.array([0.0, 1.0, 2.0]), {"slip": np.array([0.9, 0.5, 0.25])})
    Outcome(text='max(slip[1:]) < 0.55', passed=True, found='max(slip[1:]) = 0.5')
    """
    tree = _parsed(text)
    if not isinstance(tree, ast.Compare | ast.BoolOp | ast.UnaryOp | ast.Call):
        raise CheckError("expected a comparison, such as max(slip) < 0.55")
    for part in _parts(tree):
        if isinstance(part, ast.Call) and isinstance(part.func, ast.Name) and part.func.id not in YES_OR_NO:
            said = ast.unparse(part)
            raise CheckError(f"{said!r} is a number, not yes or no; expected a comparison, such as {said} < 0.55")
    return Check(text, tree)


def _parts(tree: ast.expr) -> list[ast.expr]:
    """What `and`, `or` and `not` join."""
    if isinstance(tree, ast.BoolOp):
        return [part for value in tree.values for part in _parts(value)]
    return _parts(tree.operand) if isinstance(tree, ast.UnaryOp) and isinstance(tree.op, ast.Not) else [tree]


def parse_number(text: str) -> Check:
    """Reads what makes a number of a run, in the language of checks, for `Check.number`. CheckError as `parse_check`.

    >>> import numpy as np
    >>> parse_number("max(slip) - min(slip)").number(np.zeros(2), {"slip": np.array([0.5, 0.25])})
    0.25
    """
    return Check(text, _parsed(text))


def _parsed(text: str) -> ast.expr:
    if len(text) > 500:
        raise CheckError("longer than 500 characters")
    try:
        tree = python_tree(text.strip(), "eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        reason = error.msg if isinstance(error, SyntaxError) else "no expression"
        raise CheckError(f"cannot be read: {reason}; expected text such as max(slip) < 0.55, in SI, no unit") from None
    _verify(tree)
    return tree
