"""The user's own differential equations: states, their derivatives and what is measured, as formulas of case.toml."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.bases.kinds.base import (
    ALONE,
    CHANNEL_COST,
    GAIN,
    PARAMETER_COST,
    PRODUCT_COST,
    Base,
    Factor,
    Problem,
    Target,
)
from terrapin_tools.workbench.bases.kinds.equations_of_motion import Stretches

DEFINITION_COST = 0.05  # prior factor of what adds to x' = v: that is a definition, and seldom wrong


@dataclass(frozen=True, kw_only=True)
class OwnEquations(Base):
    """States integrated over the time of each run."""

    def targets(self) -> list[Target]:
        whole = ((gain, PARAMETER_COST * PRODUCT_COST) for gain in self.further)
        laws = {force: GAIN + force.removeprefix("derivative.") in self.further for force in self.forces}
        forces = ((force, 1.0 if law else DEFINITION_COST) for force, law in laws.items())
        return [*forces, *((c, CHANNEL_COST) for c in self.channels), *whole]

    def factors(self, target: str, main: str, values: Mapping[str, Array], roles: Collection[str]) -> list[Factor]:
        if target in self.further:
            return [(*ALONE[:2], False)] if main else []
        if target in self.channels:  # what a sensor adds is simple; what is not simple happens to a state
            return [ALONE]
        return super().factors(target, main, values, {*roles, *self.provides})

    def predictor(self, problem: Problem) -> Stretches:
        return Stretches(problem)


BASE = OwnEquations(
    name="ode", own_names=True, own_dynamics=True, whole_runs=True, needs={"time": ""}, follows=("time",)
)
