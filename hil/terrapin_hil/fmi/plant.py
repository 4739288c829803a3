"""An FMU in the place of the simulated body, in lockstep.

with Session("steady_sand", plant=FmuPlant(Path("motor.fmu"))) as s:
    s.step(10.0)

It needs the input `voltage` [V] of the bridge or `duty_q15`, and the outputs `omega` [rad/s], `speed` [m/s] and
`current` [A]. The input `enable` (or `enabled`) and what else a plant of one's own may say (run/endless.py) are taken
where they are.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from terrapin_hil.errors import UserError
from terrapin_hil.fmi.unit import Block, Unit
from terrapin_hil.run.endless import KNOWN, NEEDED, SLOWEST

__all__ = ["FmuPlant"]

INPUTS = {"duty_q15": "Int32", "voltage": "Float64", "enable": "Boolean", "enabled": "Boolean"}
TICK = 1e-3  # s


class FmuPlant:
    """A plant for Session and run; `names` says what a variable is called in the FMU where that differs.

    `patience` is what a tick may take [s]. UserError where the FMU lacks what is needed.
    """

    def __init__(
        self,
        path: Path,
        names: Mapping[str, str] | None = None,
        patience: float = SLOWEST,
        start: Mapping[str, float] | None = None,
    ) -> None:
        names = names or {}
        for name in names:
            if name not in (*INPUTS, *KNOWN):
                raise UserError(f"{path}: found the name {name}, expected one of {', '.join((*INPUTS, *KNOWN))}")
        self._unit = unit = Unit(path)
        self._patience, self._ticks = patience, 0
        try:
            inputs = {n: names.get(n, n) for n in INPUTS if self._has(names.get(n, n), "input", n in names)}
            outputs = {n: names.get(n, n) for n in KNOWN if self._has(names.get(n, n), "output", n in names)}
            self._require(inputs, outputs)
            unit.start(start)
        except BaseException:
            unit.close()
            raise
        self._set = {name: Block(unit, [own], True) for name, own in inputs.items()}
        self._get = Block(unit, list(outputs.values()), False)
        self._said = tuple(outputs)
        weakref.finalize(self, unit.close)

    def _has(self, name: str, causality: str, required: bool) -> bool:
        found = self._unit.variables.get(name)
        if found is not None and found.causality == causality:
            return True
        if required:
            raise UserError(f"{self._unit.path}: no {causality} {name} in it")
        return False

    def _require(self, inputs: Mapping[str, str], outputs: Mapping[str, str]) -> None:
        path, variables = self._unit.path, self._unit.variables
        of = {kind: sorted(v.name for v in variables.values() if v.causality == kind) for kind in ("input", "output")}
        if "voltage" not in inputs and "duty_q15" not in inputs:
            found = ", ".join(of["input"])[:200] or "none"
            raise UserError(f"{path}: found the inputs {found}; expected voltage or duty_q15")
        missing = [name for name in NEEDED if name not in outputs]
        if missing:
            found = ", ".join(of["output"])[:200] or "none"
            raise UserError(f"{path}: found the outputs {found}; expected {', '.join(missing)} too")
        for name, own in [*inputs.items(), *outputs.items()]:
            expected = INPUTS.get(name, "Float64")
            if variables[own].type != expected:
                raise UserError(f"{path}: {own} is {variables[own].type}, expected {expected}")
        size = self._unit.step_size
        if size > 0.0 and abs(TICK / size - round(TICK / size)) > 1e-6:
            raise UserError(f"{path}: its steps are {size:g} s, expected 1 ms or a whole part of that")

    def drive(self, voltage: float, duty: int, enabled: bool) -> dict[str, float]:
        """A tick under the bridge; what the FMU says then. UserError when it fails or comes late."""
        return dict(
            zip(self._said, self._unit.within(self._patience, lambda: self._tick(voltage, duty, enabled)), strict=True)
        )

    def __call__(self, voltage: float | None) -> dict[str, float]:
        return self.drive(voltage or 0.0, 0, voltage is not None)

    def _tick(self, voltage: float, duty: int, enabled: bool) -> list[float]:
        given = {"voltage": voltage, "duty_q15": duty, "enable": enabled, "enabled": enabled}
        for name, block in self._set.items():
            block.values[0] = given[name]
            block()
        self._unit.step(1, self._ticks)
        self._ticks += 1
        return list(self._get())

    def checkpoint(self) -> Any:
        """Its state. UserError when it keeps none."""
        if not self._unit.keeps_state:
            raise UserError(f"checkpoint: {self._unit.path} keeps no state, expected canGetAndSetFMUState")
        return self._unit.within(self._patience, self._unit.keep), self._ticks

    def restore(self, kept: Any) -> None:
        """Back to a `checkpoint`."""
        state, self._ticks = kept
        self._unit.within(self._patience, lambda: self._unit.back(state))

    def close(self) -> None:
        """Ends the FMU."""
        self._unit.close()
