"""Stated constants as suspects: a radius that was measured at the wrong place explains as much as an effect may.

Each is an effect that multiplies the constant by 1 + d. It competes with the catalogue under the name constant.NAME, at
a prior of some percent together, and a large error of a constant is less likely than a small one.
"""

from __future__ import annotations

import numpy as np

from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_tools.workbench.case.changes import SUSPECT, SUSPECTED
from terrapin_tools.workbench.model.data_columns import candidates
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.model import Model

__all__ = ["constants", "error_tax", "named", "suspected", "value_of"]

ERROR = "relative_error"
# Log of the ratio of a constant to what is stated, where that is wrong: some percent to some tens. A radius that is
# half as large and a gear that is twice as large are one error on many rigs, and must not differ in this.
TYPICAL = 0.3


def constants(model: Model) -> list[Effect]:
    """One suspect for each stated parameter of the base model, or of formulas of the user's own, that is not fitted,
    and neither 0 nor what the base takes where nothing is stated."""
    case = model.case
    formulas = [*case.equations.values(), *(case.dynamics.derivative.values() if case.dynamics is not None else ())]
    unstated = {name: quantity.default for name, quantity in case.base.parameters.items()}
    read = set(case.base.parameters).union(*(formula.names for formula in formulas))
    return [
        _suspect(case.base.name, name)
        for name, value in case.parameters.items()
        if value not in (0.0, unstated.get(name)) and name in read and name not in case.fit
    ]


def _suspect(base: str, name: str) -> Effect:
    symbol = r"\mathrm{" + name.replace("_", r"\_") + "}"
    return Effect(
        name=SUSPECT + name,
        title=f"{name.replace('_', ' ')} is not what is stated",
        equation=rf"{symbol} \to {symbol} (1 + d)",
        source="the measurements themselves",
        bases=(base,),
        parameters=(Parameter(ERROR, "1", 0.0, *SUSPECTED, "relative error of the statement"),),
        needs=(),
        expression=ERROR,
        target=name,
    )


def suspected(model: Model) -> list[Effect]:
    """Whatever has a name and could be missing: the catalogue's effects, and the stated constants."""
    return [*candidates(model), *constants(model)]


def named(effect: str) -> str:
    """The constant that a suspect is about; "" for other effects.

    >>> named("constant.radius"), named("stribeck")
    ('radius', '')
    """
    return effect.removeprefix(SUSPECT) if effect.startswith(SUSPECT) else ""


def error_tax(fit: Fit, effects: tuple[str, ...]) -> float:
    """Log of how unlikely errors of this size are, for the suspects among the effects."""
    found = 0.0
    for one, value in zip(fit.model.fitted, fit.theta, strict=True):
        if one.effect in effects and one.effect is not None and named(one.effect):
            found += float(np.log1p((np.log1p(value) / TYPICAL) ** 2))
    return found


def value_of(fit: Fit, effect: str) -> float:
    """What the constant of a suspect would be, in its SI unit."""
    error = next(v for one, v in zip(fit.model.fitted, fit.theta, strict=True) if one.effect == effect)
    return float(fit.model.case.parameters[named(effect)] * (1.0 + error))
