"""An effect that goes into a case's model: by its name, or with a formula of one's own."""

from __future__ import annotations

from collections.abc import Mapping
from math import isinf
from numbers import Real
from typing import Any

from terrapin_tools.door.named import Named
from terrapin_tools.errors import UserError, for_programs
from terrapin_tools.workbench.case.changes import OwnEffect, OwnParameter

__all__ = ["Effect", "numbers", "plain"]


def plain(given: Any) -> Any:
    """The same, with Python's numbers and lists for NumPy's."""
    if isinstance(given, tuple | list):
        return [plain(one) for one in given]
    return given.tolist() if hasattr(given, "tolist") else given


def numbers(name: str, given: Any) -> tuple[float, float | None, float | None, str]:
    """START, or (START, MIN, MAX) or (START, MIN, MAX, UNIT); a bound is None where there is none, as it is where one
    is infinite. UserError names `name`."""
    from terrapin_tools.workbench.files.units import spelling

    shape = "START, (START, MIN, MAX) or (START, MIN, MAX, UNIT)"
    simple = plain(given)
    parts = simple if isinstance(simple, list) else [simple]
    if len(parts) not in (1, 3, 4):
        raise UserError(f"{name}: found {given!r}, expected {shape}")
    values = [*parts[:3], None, None][:3]
    unit = parts[3] if len(parts) == 4 else ""
    sound = all(isinstance(v, Real) and not isinstance(v, bool) for v in values if v is not None)
    if not sound or values[0] is None or not isinstance(unit, str):
        raise UserError(f"{name}: found {given!r}, expected {shape}")
    low, high = (None if v is None or isinf(v) else float(v) for v in values[1:])
    return float(values[0]), low, high, spelling(unit) if unit else ""


class Effect(str):
    """An effect of the catalogue by its name, or one of your own: a formula with parameters. It is its name.

    >>> drag = Effect("my_drag", "k * w**3", k=(0.0, -1.0, 1.0, "N m s^3/rad^3"))
    >>> drag, drag.expression, drag.unit("k")
    ('my_drag', 'k * w**3', 'N m s^3/rad^3')

    Parameters
    ----------
    name : letters, digits and _.
    expression : the formula; see docs/effects.md for what it may hold. "": an effect that is known by its name.
    target : what it acts on: a channel, `resistance`, a parameter of the model; "": the base model's usual one.
    parameters : each START, (START, MIN, MAX) or (START, MIN, MAX, UNIT).

    Raises
    ------
    errors.InputError : a name or a parameter is none.
    """

    own: OwnEffect | None

    @for_programs
    def __new__(cls, name: str, expression: str = "", target: str = "", **parameters: Any) -> Effect:
        if not expression:
            if target or parameters:
                raise UserError("target, parameters: expected together with an expression")
            return cls._of(name, None)
        if not name.isidentifier():
            raise UserError(f"found {name!r}, expected a name of letters, digits and _ for the expression")
        given = {key: numbers(key, value) for key, value in parameters.items()}
        found = {key: OwnParameter(v, low, high, unit or "1") for key, (v, low, high, unit) in given.items()}
        return cls._of(name, OwnEffect(expression, target or None, found))

    @classmethod
    def _of(cls, name: str, own: OwnEffect | None) -> Effect:
        made = str.__new__(cls, name)
        made.own = own
        return made

    def __reduce__(self) -> Any:
        return self._of, (str(self), self.own)

    @property
    def expression(self) -> str:
        """Its formula, "" for one of the catalogue."""
        return self.own.expression if self.own else ""

    @property
    def target(self) -> str:
        """What it acts on, "" for the usual."""
        return (self.own.target if self.own else None) or ""

    @property
    def parameters(self) -> Mapping[str, OwnParameter]:
        """Start, bounds and unit of its formula's parameters."""
        return Named(self.own.parameters if self.own else {}, "parameters")

    def unit(self, parameter: str) -> str:
        """The unit of a parameter of its formula. InputError where it has none of that name."""
        return self.parameters[parameter].unit
