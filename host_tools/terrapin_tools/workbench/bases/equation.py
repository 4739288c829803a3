"""The user's own formulas: a line of [model.equation] for each channel, over columns and constants of any name."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from terrapin_hil.arrays import Array
from terrapin_hil.physics.expression import Expression
from terrapin_tools.workbench.bases.kinds.algebraic import Algebraic, Rows, Terms, Values
from terrapin_tools.workbench.bases.kinds.base import PRODUCT_COST, Factor, Problem


@dataclass(frozen=True, kw_only=True)
class Equation(Algebraic):
    """Channels by the formulas of a case, which works on numbers as they stand in the file, or in SI with `scales`."""

    formulas: Mapping[str, Expression] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)

    def reads(self) -> set[str]:
        return {name for formula in self.formulas.values() for name in formula.names}

    def factors(self, target: str, main: str, values: Mapping[str, Array], roles: Collection[str]) -> list[Factor]:
        found: list[Factor] = []
        for name, prior, step in super().factors(target, main, values, roles):
            found.append((name, prior, step))
            if name and values[name].min() < 0.0 < values[name].max():
                found += [(f"sign({name})", PRODUCT_COST, True), (f"{name}*abs({name})", PRODUCT_COST**2, False)]
        return found

    def evaluate(self, values: Values, effects: Terms) -> dict[str, Array]:
        scaled = {name: value * self.scales.get(name, 1.0) for name, value in values.items()}
        return {c: f.evaluate(scaled) / self.scales.get(c, 1.0) for c, f in self.formulas.items()}

    def predictor(self, problem: Problem) -> Rows:
        return Rows(replace(self, formulas=problem.formulas, scales=problem.scales), problem)


BASE = Equation(name="equation", own_names=True, follows=())
