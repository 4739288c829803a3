"""Expressions of effects as programs for the compiled integrators (program.h).

>>> terms = Additions({"k": 20, "omega": 1}, 0.05)
>>> terms.add("k * omega**2", TORQUE, ground=False)
>>> len(terms.terms), len(terms.code)
(1, 5)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hil.physics.compiled import ffi
from hil.physics.expression import Name, Node, Number, parse

__all__ = ["ADD", "MULTIPLY", "ROLES", "TORQUE", "Additions"]

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
        )
    )
}
FIRST = 16  # HIL_ROLES
DEPTH = 64  # HIL_PROGRAM_DEPTH

_BINARY = ("+", "-", "*", "/", "**", "<", "<=", ">", ">=", "==", "!=", "min", "max")
_UNARY = ("neg", "abs", "sign", "sqrt", "exp", "log", "sin", "cos", "tan", "tanh")
_OPERATION = {kind: 2 + i for i, kind in enumerate((*_BINARY, *_UNARY))}

Instruction = tuple[int, int, float]


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
        depth = self._write(formula.tree, {**self.slots, **(slots or {})})
        if depth > DEPTH:
            raise ValueError(f"formula too deeply nested: {expression}")
        inertial = kind == TORQUE and "acceleration" in formula.names
        slot = self.slots[target] if kind != TORQUE else 0
        self.terms.append((kind, int(ground), slot, begin, len(self.code) - begin, int(inertial)))

    def _write(self, node: Node, slots: Mapping[str, int]) -> int:
        """Appends the instructions of a node; the stack that they need."""
        if isinstance(node, Number):
            self.code.append((0, 0, node.value))
            return 1
        if isinstance(node, Name):
            self.code.append((1, slots[node.name], 0.0))
            return 1
        depth = 0
        for i, argument in enumerate(node.arguments):
            depth = max(depth, i + self._write(argument, slots))
        self.code.append((_OPERATION[node.kind], 0, 0.0))
        return depth

    def native(self) -> tuple[Any, list[Any]]:
        """hil_additions *, and what must be kept alive beside it."""
        f = ffi()
        code = f.new("hil_instruction[]", self.code or [(0, 0, 0.0)])
        term = f.new("hil_term[]", self.terms or [(0, 0, 0, 0, 0, 0)])
        whole = f.new("hil_additions *", (len(self.terms), term, code, self.smoothing))
        return whole, [code, term, whole]
