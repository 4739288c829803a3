"""Units of an effect's expression: what it yields against what its target wants, and units that were left open.

A parameter without a unit carries what makes the expression sound: the wanted unit is followed down the formula to it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from terrapin_hil.physics.expression import Expression, Name, Node, Number, Operation
from terrapin_hil.units import read_unit, unit_in_formula, units

__all__ = ["contradiction", "open_units", "plain", "unit_problem"]

ANY = ("sign", "<", "<=", ">", ">=", "==", "!=")  # operations whose value says nothing of their arguments' unit


def unit_problem(expression: Expression, given: Mapping[str, str], wanted: str, exactly: bool = False) -> str | None:
    """What is wrong with the units of a formula, in words; None when they are sound. `exactly`: not of the same kind is
    enough, for nothing is converted."""
    try:
        found = expression.unit(given)
    except ValueError as error:
        return str(error)
    if _same(found, read_unit(wanted)):
        factor = _in_base(found) / _in_base(unit_in_formula(wanted))
        if not exactly or abs(factor - 1.0) < 1e-9:
            return None
    return f"{expression} comes out in {_spell(found)}, expected {wanted}"


def open_units(expression: Expression, given: Mapping[str, str], names: list[str], wanted: str) -> dict[str, str]:
    """Units, coherent with SI, for the parameters `names`, such that the formula yields `wanted`.

    What several could carry the first one carries; the others are plain numbers.
    """
    known = {name: unit_in_formula(unit) for name, unit in given.items() if name in expression.names}
    for last in [*reversed(names), ""]:
        while _follow(expression.tree, read_unit(wanted), known):
            pass
        if last and last not in known and any(name not in known for name in names if name != last):
            known[last] = read_unit("1")
    return {name: _spell(known.get(name, read_unit("1"))) for name in names}


def contradiction(formula: Expression, given: Mapping[str, str], wanted: str) -> str | None:
    """What is wrong with a formula whatever the units of the names that have none; None where some make it sound.

    Beside such names what stands in an exponent, or a plain number, may be of an empirical law: not checked.
    """
    known = {name: given[name] for name in formula.names if given.get(name)}
    bare = sorted(formula.names - known.keys())
    if bare and (formula.numbers or formula.exponents & {*bare}):
        return None
    return unit_problem(formula, {**known, **open_units(formula, known, bare, wanted)}, wanted)


def _follow(node: Node, wanted: Any, known: dict[str, Any]) -> bool:
    """Pass the wanted unit down; True when that told the unit of one more name."""
    if isinstance(node, Name):
        if node.name in known or wanted is None:
            return False
        known[node.name] = wanted
        return True
    if isinstance(node, Number):
        return False
    arguments = node.arguments
    asked: list[Any]
    own = [_known_unit(argument, known) for argument in arguments]
    one = read_unit("1")
    match node.kind:
        case "neg" | "abs":
            asked = [wanted]
        case "sqrt":
            asked = [None if wanted is None else wanted**2]
        case "+" | "-" | "min" | "max" | "<" | "<=" | ">" | ">=" | "==" | "!=":
            either = None if node.kind in ANY else wanted
            asked = [own[1] or own[0] or either, own[0] or own[1] or either]
        case "*":
            asked = [_over(wanted, own[1]), _over(wanted, own[0])]
        case "/":
            asked = [
                None if wanted is None or own[1] is None else wanted * own[1],
                _over(own[0], wanted),
            ]
        case "**":
            power = arguments[1].value if isinstance(arguments[1], Number) else None
            if not isinstance(arguments[1], Number):
                asked = [one, one]  # only of a plain number
            else:
                asked = [None if wanted is None or not power else wanted ** (1.0 / power), one]
        case "sign":
            asked = [None]
        case _:
            asked = [one]
    return any(_follow(argument, unit, known) for argument, unit in zip(arguments, asked, strict=True))


def _over(wanted: Any, other: Any) -> Any:
    return None if wanted is None or other is None else wanted / other


def _known_unit(node: Node, known: Mapping[str, Any]) -> Any:
    """The unit of a part of the formula, None while a name in it has none (or it is a plain number of any unit)."""
    part = Expression("", node)
    if isinstance(node, Operation) and node.kind == "sign":
        return read_unit("1")
    if not part.names <= known.keys():
        return None
    if not part.names:
        return read_unit("1")
    try:
        return part.unit({name: _spell(known[name]) for name in part.names})
    except ValueError:
        return None  # told by unit_problem, with the whole formula


def _in_base(unit: Any) -> float:
    return float(units().Quantity(1.0, unit).to_base_units().m)


def _spell(unit: Any) -> str:
    return re.sub(r"°R\b", "°F", f"{unit:~C}") or "1"  # in a product °F is read as a difference


def plain(unit: Any) -> str:
    """A unit as the program writes them, in coherent SI units.

    >>> plain(read_unit("kN/s"))
    'kg*m/s**3'
    """
    return _spell(units().Quantity(1.0, unit).to_base_units().units)


def _same(one: Any, other: Any) -> bool:
    left, right = dict(one.dimensionality), dict(other.dimensionality)
    return all(abs(float(left.get(d, 0)) - float(right.get(d, 0))) < 1e-6 for d in {*left, *right})
