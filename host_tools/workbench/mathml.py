"""Formulas as MathML, which browsers set without help: from the LaTeX of the catalogue and from a user's expression.

>>> from_latex(r"f_s")
'<math><msub><mi>f</mi><mi>s</mi></msub></math>'
>>> from_expression("omega**2 / tau")
'<math><mfrac><mrow><msup><mi>ω</mi><mrow><mn>2</mn></mrow></msup></mrow><mrow><mi>τ</mi></mrow></mfrac></math>'
"""

from __future__ import annotations

import html
import re

from hil.physics.expression import parse

__all__ = ["from_expression", "from_latex"]

NAMES = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau phi chi psi omega "
    "Gamma Delta Theta Lambda Xi Pi Sigma Phi Psi Omega varphi vartheta varepsilon"
)
GREEK = dict(zip(NAMES.split(), "αβγδεζηθικλμνξπρστφχψωΓΔΘΛΞΠΣΦΨΩφϑε", strict=True))
SYMBOLS = {
    "to": "→",
    "mp": "∓",
    "pm": "±",
    "int": "∫",
    "cdot": "·",
    "times": "\u00d7",
    "le": "≤",
    "ge": "≥",
    "circ": "∘",
}
SYMBOLS |= {"infty": "∞", "ne": "≠", "approx": "≈", "sum": "∑", "partial": "∂"}
MINUS = "\u2212"
FUNCTIONS = ("sin", "cos", "tan", "tanh", "exp", "log", "max", "min", "sgn", "sign")
SPACES = {",": "0.17em", ";": "0.28em", "quad": "1em", "qquad": "2em", " ": "0.25em", "!": "0"}
TOKEN = re.compile(r"\\([A-Za-z]+|.)|([0-9]+(?:\.[0-9]+)?)|([A-Za-z])|(\S)")


def from_latex(text: str) -> str:
    """The part of LaTeX that the catalogue uses; equations that commas part, one after the other. A command that is not
    known stands as its name."""
    tokens = [next((kind, part) for kind, part in enumerate(found) if part) for found in TOKEN.findall(text)]
    tokens = [token for token in tokens if token not in ((0, "left"), (0, "right"))]
    equations, depth = [[]], 0  # type: list[list[tuple[int, str]]], int
    for token in tokens:
        depth += (token[1] in "({[" and token[0] == 3) - (token[1] in ")}]" and token[0] == 3)
        if token == (3, ",") and depth == 0:
            equations.append([])
        else:
            equations[-1].append(token)
    return " ".join(f"<math>{_Reader(one).row()}</math>" for one in equations if one)


class _Reader:
    """Tokens (0 command, 1 number, 2 letter, 3 other) read from left to right."""

    def __init__(self, tokens: list[tuple[int, str]]) -> None:
        self.tokens, self.at = tokens, 0

    def row(self, closing: tuple[int, str] | None = None) -> str:
        parts = []
        while self.at < len(self.tokens):
            if self.tokens[self.at] == closing:
                self.at += 1
                break
            parts.append(self.scripted())
        return "".join(parts)

    def scripted(self) -> str:
        base, scripts = self.atom(), {}
        while self.at < len(self.tokens) and self.tokens[self.at] in ((3, "_"), (3, "^")):
            kind = self.tokens[self.at][1]
            self.at += 1
            scripts[kind] = self.atom()
        if not scripts:
            return base
        if len(scripts) == 2:
            return f"<msubsup>{base}{scripts['_']}{scripts['^']}</msubsup>"
        kind, script = next(iter(scripts.items()))
        tag = "msub" if kind == "_" else "msup"
        return f"<{tag}>{base}{script}</{tag}>"

    def atom(self) -> str:
        if self.at >= len(self.tokens):
            return "<mrow></mrow>"
        kind, text = self.tokens[self.at]
        self.at += 1
        if kind == 0:
            return self.command(text)
        if kind == 1:
            return f"<mn>{text}</mn>"
        if kind == 2:
            return f"<mi>{text}</mi>"
        if text == "{":
            return f"<mrow>{self.row((3, '}'))}</mrow>"
        if text == "(":
            fence = '<mo stretchy="false">{}</mo>'.format
            return f"<mrow>{fence('(')}{self.row((3, ')'))}{fence(')')}</mrow>"
        return f'<mo stretchy="false">{MINUS if text == "-" else html.escape(text)}</mo>'

    def argument(self) -> str:
        """A group, or one token, which of a number is its first digit."""
        kind, text = self.tokens[self.at] if self.at < len(self.tokens) else (3, "")
        if kind == 1 and len(text) > 1:
            self.tokens[self.at : self.at + 1] = [(1, text[0]), (1, text[1:])]
        return self.atom()

    def command(self, name: str) -> str:
        if name in ("frac", "tfrac", "dfrac"):
            return f"<mfrac>{self.argument()}{self.argument()}</mfrac>"
        if name in ("dot", "hat", "bar"):
            accent = {"dot": "˙", "hat": "^", "bar": "¯"}[name]
            return f'<mover accent="true">{self.atom()}<mo>{accent}</mo></mover>'
        if name in ("mathrm", "text", "mathcal", "operatorname"):
            return f'<mi mathvariant="normal">{html.escape(self.plain())}</mi>'
        if name == "sqrt":
            return f"<msqrt>{self.atom()}</msqrt>"
        if name in SPACES:
            return f'<mspace width="{SPACES[name]}"></mspace>'
        if name in FUNCTIONS:
            return f'<mspace width="0.17em"></mspace><mi>{name}</mi><mo>&#8289;</mo>'
        if name in GREEK:
            return f"<mi>{GREEK[name]}</mi>"
        return f"<mo>{html.escape(SYMBOLS.get(name, name))}</mo>"

    def plain(self) -> str:
        """The letters of the next group."""
        if self.at >= len(self.tokens) or self.tokens[self.at] != (3, "{"):
            self.at += 1
            return self.tokens[self.at - 1][1] if self.at <= len(self.tokens) else ""
        letters = []
        self.at += 1
        while self.at < len(self.tokens) and self.tokens[self.at] != (3, "}"):
            letters.append(self.tokens[self.at][1])
            self.at += 1
        self.at += 1
        return "".join(letters)


def from_expression(text: str) -> str:
    """A formula of case.toml; ValueError when it is none."""
    return from_latex(parse(text).to_latex())
