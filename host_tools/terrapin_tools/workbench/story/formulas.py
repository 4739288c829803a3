r"""Formulas as MathML, which browsers set without help: from the LaTeX of the catalogue and from a user's expression.

>>> from_latex(r"f_s")
'<math><mrow><msub><mi>f</mi><mi>s</mi></msub></mrow></math>'
>>> from_expression("omega**2 / tau")
'<math><mrow><mfrac><mrow><msup><mi>ω</mi><mrow><mn>2</mn></mrow></msup></mrow><mrow><mi>τ</mi></mrow></mfrac></mrow></math>'
"""

from __future__ import annotations

import html
import re
import tomllib
from xml.etree.ElementTree import tostring

from latex2mathml.converter import convert_to_element

from terrapin_hil.physics.expression import parse

__all__ = ["from_expression", "from_latex", "of_model"]

BETWEEN = re.compile(r",\s*\\(?:;|,|quad)\s*")  # two equations of one line
FUNCTION = re.compile(r"\\(?:sin|cos|tan|exp|log)(?![a-z])")
KEPT = {"accent", "displaystyle", "fence", "form", "mathvariant", "scriptlevel", "separator", "stretchy", "width"}


def from_latex(text: str) -> str:
    """An equation, or several that a comma and a space part, one after the other. What is no LaTeX stands as text."""
    parts = BETWEEN.split(text)
    if any(part.count("(") != part.count(")") or part.count("{") != part.count("}") for part in parts):
        parts = [text]  # the comma stands inside a bracket
    return " ".join(_math(part) for part in parts)


def of_model(text: str) -> list[tuple[str, str]]:
    r"""The formulas that case.toml, `text`, gives its model: of what each is, and the formula as MathML.

    >>> [left for left, _ in of_model('[model.derivative]\nx = "v"\n[model.measured]\nway = "x"')]
    ['dx/dt', 'way']
    """
    model = tomllib.loads(text).get("model", {})
    return [
        (f"d{name}/dt" if part == "derivative" else name, from_expression(formula))
        for part in ("equation", "derivative", "measured")
        for name, formula in model.get(part, {}).items()
    ]


def from_expression(text: str) -> str:
    """A formula of case.toml; ValueError when it is none."""
    return _math(parse(text).to_latex())


def _math(text: str) -> str:
    try:
        spaced = FUNCTION.sub(r"\\,\g<0>\\,", text).replace(r"\mathrm", r"\text")  # words in one piece
        math = convert_to_element(spaced)
    except Exception:  # the library's errors have no common base
        return f"<math><mtext>{html.escape(text)}</mtext></math>"
    for element in math.iter():
        element.text = html.unescape(element.text or "")  # entities of the library; tostring escapes again
        for name in element.attrib.keys() - KEPT:  # \href, \style and \class could bring more than a formula
            del element.attrib[name]
    return tostring(math, encoding="unicode", short_empty_elements=False)
