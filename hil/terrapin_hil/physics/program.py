"""Expressions of effects as programs for the compiled integrators and the plant (program.h).

>>> instructions("2 * omega", {"omega": 1}, {})
[(0, 0, 2.0), (1, 1, 0.0), (4, 0, 0.0)]
>>> terms = Additions({"k": 20, "omega": 1}, 0.05)
>>> terms.add("k * omega**2", TORQUE, ground=False)
>>> len(terms.terms), len(terms.code)
(1, 5)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from terrapin_hil.physics.compiled import ffi
from terrapin_hil.physics.expression import Name, Node, Number, parse

__all__ = ["ADD", "MULTIPLY", "ROLES", "TORQUE", "Additions", "Instruction", "instructions"]

ADD, MULTIPLY, TORQUE = 0, 1, 2  # HIL_TERM_*

# Slots of the roles, by their names in formulas; parameters of the model follow from FIRST on
ROLES: Mapping[str, int] = {
    name: slot
    for slot, name in enumerate(
        (
            "time",
            "omega",
            "angle",
            "acceleration",
            "slip",
            "speed",
            "load",
            "slope",
            "temperature",
            "pass_",
            "moisture",
            "voltage",
            "joint_rate",
            "drive_torque",
            "bulldozing_resistance",
            "direction",
            "swing_angle",
        )
    )
}
FIRST = 17  # HIL_ROLES

_BINARY = ("+", "-", "*", "/", "**", "<", "<=", ">", ">=", "==", "!=", "min", "max")
_UNARY = ("neg", "abs", "sign", "sqrt", "exp", "log", "sin", "cos", "tan", "tanh")
_OPERATION = {kind: 2 + i for i, kind in enumerate((*_BINARY, *_UNARY))}

Instruction = tuple[int, int, float]


def instructions(
    expression: str, slots: Mapping[str, int], values: Mapping[str, float | Sequence[Instruction]]
) -> list[Instruction]:
    """A formula's instructions; each of its names is one of `values` (a number, or what computes it) or stands in a
    slot. KeyError when neither."""

    def write(node: Node) -> list[Instruction]:
        if isinstance(node, Number):
            return [(0, 0, node.value)]
        if isinstance(node, Name):
            value = values.get(node.name)
            if value is None:
                return [(1, slots[node.name], 0.0)]
            return [(0, 0, value)] if isinstance(value, (int, float)) else list(value)
        return [*(one for argument in node.arguments for one in write(argument)), (_OPERATION[node.kind], 0, 0.0)]

    return write(parse(expression).tree)


class Additions:
    """Terms of one set of effects, over the slots that their names have."""

    def __init__(self, slots: Mapping[str, int], smoothing: float) -> None:
        self.slots, self.smoothing = slots, smoothing
        self.terms: list[tuple[int, int, int, int, int, int]] = []
        self.code: list[Instruction] = []

    def add(
        self, expression: str, kind: int, ground: bool, target: str = "", slots: Mapping[str, int] | None = None
    ) -> None:
        """One more term; `slots` are names of its own, which hide equal ones. KeyError when a name has no slot."""
        formula = parse(expression)
        begin = len(self.code)
        self.code += instructions(expression, {**self.slots, **(slots or {})}, {})
        inertial = kind == TORQUE and "acceleration" in formula.names
        slot = self.slots[target] if kind != TORQUE else 0
        self.terms.append((kind, int(ground), slot, begin, len(self.code) - begin, int(inertial)))

    def native(self) -> tuple[Any, list[Any]]:
        """hil_additions *, and what must be kept alive beside it."""
        f = ffi()
        code = f.new("hil_instruction[]", self.code or [(0, 0, 0.0)])
        term = f.new("hil_term[]", self.terms or [(0, 0, 0, 0, 0, 0)])
        whole = f.new("hil_additions *", (len(self.terms), term, code, self.smoothing))
        return whole, [code, term, whole]
