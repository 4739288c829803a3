"""The mutants of a C file: every place where one of a fixed set of slips could be made, one mutant each.

    for mutant in mutants(Path("firmware/core/supervisor.c")): mutant.text()    # the whole file with that slip

Operators: comparisons (to the neighbour and to the opposite), + - * / %, shifts, bits, logic, constants one off, true
and false, conditions negated, statements deleted. The sources are formatted by clang-format, so that an operator of two
operands stands between spaces. Assertions, declarations of types and preprocessor lines are left alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

__all__ = ["HEAD", "Mutant", "Token", "closing", "constants", "mutants", "tokens_of"]

SWAPS = {
    "<": ("<=", ">="), "<=": ("<", ">"), ">": (">=", "<="), ">=": (">", "<"), "==": ("!=",), "!=": ("==",),
    "+": ("-",), "-": ("+",), "*": ("/",), "/": ("*",), "%": ("*",), "+=": ("-=",), "-=": ("+=",), "*=": ("/=",),
    "/=": ("*=",), "<<": (">>",), ">>": ("<<",), "<<=": (">>=",), ">>=": ("<<=",), "&": ("|",), "|": ("&",),
    "^": ("&",), "&=": ("|=",), "|=": ("&=",), "^=": ("|=",), "&&": ("||",), "||": ("&&",),
    "++": ("--",), "--": ("++",), "true": ("false",), "false": ("true",),
}  # fmt: skip
_TOKEN = re.compile(
    r"(?P<skip>/\*.*?\*/|//[^\n]*|^[ \t]*#(?:[^\\\n]|\\.|\\\n)*|\s+)"
    r"|(?P<text>\"(?:\\.|[^\"\\])*\"|'(?:\\.|[^'\\])+')"
    r"|(?P<number>0[xX][0-9a-fA-F]+[uUlL]*|\d[\d.]*(?:[eE][+-]?\d+)?[uUlLfF]*)"
    r"|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<sign><<=|>>=|\.\.\.|->|\+\+|--|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/%&|^]=|.)",
    re.DOTALL | re.MULTILINE,
)
_ASSERTION = ("TERRAPIN_ASSERT", "_Static_assert", "static_assert")
HEAD = re.compile(
    r"^[A-Za-z_][^;={}]*?\b(\w+)\([^;{}]*\)\s*\{$|^(?:static )?(?:const )?(enum)\b[^;{}]*\{$", re.MULTILINE
)
_DECLARING = {"const", "static", "struct", "enum", "union", "typedef", "extern", "volatile", "return", "case", "goto"}


@dataclass(frozen=True)
class Mutant:
    """One slip: `old` at `begin` of the file's text becomes `new`. `function` is "enum" or "table" for constants of the
    file."""

    path: Path
    source: str
    begin: int
    old: str
    new: str
    function: str

    @property
    def line(self) -> str:
        """The line's text, without indentation."""
        first = self.source.rfind("\n", 0, self.begin) + 1
        return self.source[first : self.source.find("\n", self.begin)].strip()

    @property
    def number(self) -> int:
        """The line's number, from 1."""
        return self.source.count("\n", 0, self.begin) + 1

    @property
    def change(self) -> str:
        """What is changed into what, in one line; with its place among the same in the line, from the second on."""
        first = self.source.rfind("\n", 0, self.begin) + 1
        before = self.source[first : self.begin].count(self.old)
        told = " ".join(f"{self.old} -> {self.new or 'nothing'}".split())
        return told + (f" (number {before + 1})" if before and self.new else "")

    @property
    def name(self) -> str:
        return f"{self.path.as_posix()} {self.function}: {self.line} | {self.change}"

    def text(self) -> str:
        """The whole file with the slip."""
        return self.source[: self.begin] + self.new + self.source[self.begin + len(self.old) :]


@dataclass(frozen=True)
class Token:
    """A word of C: its kind (name, number, text, sign), and where it begins in the file."""

    kind: str
    text: str
    begin: int

    @property
    def end(self) -> int:
        return self.begin + len(self.text)


def mutants(path: Path, root: Path) -> list[Mutant]:
    """All mutants of root/path, in the order of the file."""
    source = (root / path).read_text(encoding="utf-8")
    found = []
    for head in HEAD.finditer(source):
        end = source.find("\n}", head.end())
        tokens = tokens_of(source, head.end(), end)
        function = head[1] or head[2]
        slips = [
            *_swaps(source, tokens),
            *constants(tokens),
            *_conditions(source, tokens),
            *_statements(source, tokens),
        ]
        found += [Mutant(path, source, begin, old, new, function) for begin, old, new in sorted(slips)]
    return found


def tokens_of(source: str, begin: int, end: int) -> list[Token]:
    """The tokens of a part of a file, without assertions."""
    found: list[Token] = []
    while begin < end:
        match = _TOKEN.match(source, begin)
        assert match is not None
        begin = match.end()
        if match.lastgroup != "skip":
            found.append(Token(str(match.lastgroup), match[0], match.start()))
    kept: list[Token] = []
    at = 0
    while at < len(found):  # assertions are what the mutants are held against
        if found[at].text in _ASSERTION:
            at = closing(found, at + 1) + 2
        else:
            kept.append(found[at])
            at += 1
    return kept


def closing(tokens: list[Token], opening: int) -> int:
    """Index of the parenthesis that closes the one at `opening`."""
    depth = 0
    for at in range(opening, len(tokens)):
        depth += {"(": 1, ")": -1}.get(tokens[at].text, 0)
        if depth == 0:
            return at
    raise ValueError(f"unbalanced parentheses at {tokens[opening].begin}")


def _swaps(source: str, tokens: list[Token]) -> Iterator[tuple[int, str, str]]:
    for token in tokens:
        spaced = source[token.begin - 1] == " " and source[token.end] in " \n"
        if token.kind == "name" or token.text in ("++", "--") or (token.kind == "sign" and spaced):
            for new in SWAPS.get(token.text, ()):
                yield token.begin, token.text, new


def constants(tokens: list[Token]) -> Iterator[tuple[int, str, str]]:
    """Each whole number one off, both ways, as far as it stays one."""
    for token in tokens:
        match = re.fullmatch(r"(0[xX][0-9a-fA-F]+|\d+)([uUlL]*)", token.text) if token.kind == "number" else None
        if match is None:
            continue
        hexadecimal = match[1][:2].lower() == "0x"
        octal = match[1][0] == "0" and len(match[1]) > 1 and not hexadecimal
        value = int(match[1], 16 if hexadecimal else 8 if octal else 10)
        for other in (value + 1, value - 1):
            if other >= 0:
                yield (
                    token.begin,
                    token.text,
                    (f"0x{other:X}" if hexadecimal else f"0{other:o}" if octal else str(other)) + match[2],
                )


def _conditions(source: str, tokens: list[Token]) -> Iterator[tuple[int, str, str]]:
    for at, token in enumerate(tokens[:-1]):
        if token.text in ("if", "while") and tokens[at + 1].text == "(":
            begin, end = tokens[at + 1].begin, tokens[closing(tokens, at + 1)].end
            yield begin, source[begin:end], f"(!{source[begin:end]})"


def _statements(source: str, tokens: list[Token]) -> Iterator[tuple[int, str, str]]:
    at = 0
    while at < len(tokens):
        first, depth, end = tokens[at], 0, at
        label = first.text in ("case", "default")
        while end < len(tokens):
            text = tokens[end].text
            depth += {"(": 1, "[": 1, ")": -1, "]": -1}.get(text, 0)
            if depth == 0 and (text in (";", "{", "}") or (label and text == ":")):
                break
            end += 1
        if end < len(tokens) and tokens[end].text == ";" and end > at:
            second = tokens[at + 1]
            declared = first.text in _DECLARING or (first.kind == "name" and second.kind == "name")
            pointer = second.text == "*" and source[second.end] != " "
            if not declared and not pointer:
                whole = source[first.begin : tokens[end].end]
                yield first.begin, whole, ";" if "\n" not in whole else ";" + "\n" * whole.count("\n")
        at = end + 1
