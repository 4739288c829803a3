"""More slips of a C file: what is written by somebody who looks at the wrong line, not only at the wrong sign.

    for mutant in further(Path("firmware/core/slip.c"), ROOT): mutant.text()

Operators: a field for its neighbour of the same type in the same struct, an operand of && or || dropped, a condition
always true or always false, the branches of ?: exchanged (min for max), an index one on, two arguments exchanged, a
constant of a table one off. They come beside those of operators.py, behind them in each function. What is no C, or only
with a warning, the bench finds out.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

from tests.mutation.operators import HEAD, Mutant, Token, closing, constants, tokens_of

__all__ = ["further"]

_TABLE = re.compile(r"^(?:static )?const [\w ]+\*?(?: const)? ?\w+(?:\[[^\]]*\])+ = \{", re.MULTILINE)
_STRUCT = re.compile(r"typedef struct[^{;]*\{(.*?)\n\}", re.DOTALL)
_FIELDS = re.compile(
    r"^\s+((?:const |volatile |unsigned |struct )*\w+) +(\**\w+(?:\[[^\]]*\])?(?:, *\**\w+(?:\[[^\]]*\])?)*);",
    re.MULTILINE,
)
_ENDS = {",", ";", "=", "?", ":", "return", "&&", "||", "{", "}", "+=", "-=", "|=", "&="}
HEADERS = ("firmware/*/*.h", "firmware/ports/*/*.h")
Slip = tuple[int, str, str]


def further(path: Path, root: Path) -> list[Mutant]:
    """The further mutants of root/path, in the order of the file."""
    source = (root / path).read_text(encoding="utf-8")
    fields = _neighbours(root)
    found = []
    for head in HEAD.finditer(source):
        tokens = tokens_of(source, head.end(), source.find("\n}", head.end()))
        slips = {
            *_fields(tokens, fields), *_operands(source, tokens), *_always(source, tokens), *_branches(source, tokens),
            *_indices(source, tokens), *_arguments(source, tokens),
        }  # fmt: skip
        found += [Mutant(path, source, begin, old, new, head[1] or head[2]) for begin, old, new in sorted(slips)]
    for head in _TABLE.finditer(source):
        inside = [h for h in HEAD.finditer(source) if h.end() <= head.start() < source.find("\n}", h.end())]
        if not inside:
            tokens = tokens_of(source, head.end(), source.find("};", head.end()))
            found += [Mutant(path, source, *slip, "table") for slip in sorted(constants(tokens))]
    return found


@cache
def _neighbours(root: Path) -> dict[str, str]:
    """The next field of the same type, for names that stand in one struct alone."""
    next_of: dict[str, set[str]] = defaultdict(set)
    for pattern in HEADERS:
        for path in sorted(root.glob(pattern)):
            text = re.sub(r"/\*.*?\*/", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
            for body in _STRUCT.findall(text):
                by_type: dict[str, list[str]] = defaultdict(list)
                for kind, names in _FIELDS.findall(body):
                    for name in re.split(r", *", names):
                        shape = kind + re.sub(r"\w+", "", name, count=1)
                        by_type[shape].append(re.sub(r"^\**|\[.*", "", name))
                for names in by_type.values():
                    for name, other in zip(names, [*names[1:], names[0]], strict=True):
                        next_of[name].add(other if other != name else "")
    return {name: next(iter(others)) for name, others in next_of.items() if len(others) == 1 and "" not in others}


def _fields(tokens: list[Token], fields: dict[str, str]) -> Iterator[Slip]:
    for before, token in pairwise(tokens):
        if before.text in ("->", ".") and token.text in fields:
            yield token.begin, token.text, fields[token.text]


def _span(tokens: list[Token], at: int, step: int) -> int:
    """Index of the last token of the operand beside the operator at `at`, on the side of `step`."""
    depth, last = 0, at
    opening = "([" if step < 0 else ")]"
    here = at + step
    while 0 <= here < len(tokens):
        text = tokens[here].text
        if text in "()[]":
            depth += -1 if text in opening else 1
            if depth < 0:
                break
        elif depth == 0 and text in _ENDS:
            break
        last = here
        here += step
    return last


def _operands(source: str, tokens: list[Token]) -> Iterator[Slip]:
    """A && B becomes A, and B. The operators do not stand mixed without parentheses (MISRA C:2012, 12.1)."""
    for at, token in enumerate(tokens):
        if token.text in ("&&", "||"):
            first, last = _span(tokens, at, -1), _span(tokens, at, 1)
            if first < at < last:
                left = source[tokens[first].begin : tokens[at + 1].begin]
                right = source[tokens[at - 1].end : tokens[last].end]
                yield tokens[first].begin, left, "\n" * left.count("\n")
                yield tokens[at - 1].end, right, "\n" * right.count("\n")


def _always(source: str, tokens: list[Token]) -> Iterator[Slip]:
    for at, token in enumerate(tokens[:-1]):
        if token.text in ("if", "while") and tokens[at + 1].text == "(":
            begin, end = tokens[at + 1].begin, tokens[closing(tokens, at + 1)].end
            lines = "\n" * source.count("\n", begin, end)
            yield begin, source[begin:end], f"(0{lines})"
            if token.text == "if":
                yield begin, source[begin:end], f"(1{lines})"


def _branches(source: str, tokens: list[Token]) -> Iterator[Slip]:
    for at, token in enumerate(tokens):
        if token.text != "?":
            continue
        colon = _span(tokens, at, 1) + 1
        if colon < len(tokens) and tokens[colon].text == ":":
            last = _span(tokens, colon, 1)
            one = source[tokens[at + 1].begin : tokens[colon - 1].end]
            between = source[tokens[colon - 1].end : tokens[colon + 1].begin]
            two = source[tokens[colon + 1].begin : tokens[last].end]
            if last > colon and one != two:
                yield tokens[at + 1].begin, one + between + two, two + between + one


def _indices(source: str, tokens: list[Token]) -> Iterator[Slip]:
    """x[i] becomes x[(i) + 1]; constants are the business of operators.py."""
    for at, token in enumerate(tokens):
        if token.text == "[" and at and tokens[at - 1].kind == "name":
            end = at + 1
            depth = 1
            while end < len(tokens) and depth:
                depth += {"[": 1, "]": -1}.get(tokens[end].text, 0)
                end += 1
            inner = source[tokens[at].end : tokens[end - 1].begin]
            if depth == 0 and inner and not re.fullmatch(r"[\w ]*\d\w*", inner) and "sizeof" not in inner:
                yield tokens[at].end, inner, f"({inner}) + 1"


def _arguments(source: str, tokens: list[Token]) -> Iterator[Slip]:
    """f(a, b) becomes f(b, a), for each two neighbours."""
    for at, token in enumerate(tokens[:-1]):
        if token.kind != "name" or token.text in ("if", "while", "for", "switch", "sizeof", "return"):
            continue
        if tokens[at + 1].text != "(":
            continue
        end = closing(tokens, at + 1)
        begins, depth = [at + 2], 0
        for here in range(at + 2, end):
            depth += {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}.get(tokens[here].text, 0)
            if tokens[here].text == "," and depth == 0:
                begins.append(here + 1)
        parts = [(begin, other - 2) for begin, other in zip(begins, [*begins[1:], end + 1], strict=True)]
        for (a, b), (c, d) in pairwise(parts):
            one, two = source[tokens[a].begin : tokens[b].end], source[tokens[c].begin : tokens[d].end]
            if one != two and a <= b and c <= d:
                between = source[tokens[b].end : tokens[c].begin]
                yield tokens[a].begin, one + between + two, two + between + one
