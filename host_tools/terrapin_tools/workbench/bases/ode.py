"""The user's own differential equations: states, their derivatives and what is measured, as formulas of case.toml."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.bases.kinds.base import (
    ALONE,
    CHANNEL_COST,
    PARAMETER_COST,
    PRODUCT_COST,
    Base,
    Factor,
    Problem,
    Target,
)
from terrapin_tools.workbench.bases.kinds.equations_of_motion import Stretches


@dataclass(frozen=True, kw_only=True)
class OwnEquations(Base):
    """States integrated over the time of each run."""

    def targets(self) -> list[Target]:
        whole = ((gain, PARAMETER_COST * PRODUCT_COST) for gain in self.further)
        return [*((force, 1.0) for force in self.forces), *((c, CHANNEL_COST) for c in self.channels), *whole]

    def factors(self, target: str, main: str, values: Mapping[str, Array], roles: Collection[str]) -> list[Factor]:
        if target in self.further:
            return [(*ALONE[:2], False)] if main else []
        return super().factors(target, main, values, {*roles, *self.provides})

    def predictor(self, problem: Problem) -> Stretches:
        return Stretches(problem)


BASE = OwnEquations(
    name="ode", own_names=True, own_dynamics=True, whole_runs=True, needs={"time": ""}, follows=("time",)
)
