"""How large an effect usually is, so that an area of fifty frontal areas is no winner.

Each effect of the catalogue states a magnitude (Effect.usual), a rule of thumb from the robot's own numbers. The prior
of a size falls as Cauchy's around 0 with that width, to a tenth at most: the rule is rough, and an effect that is truly
large must not lose to a formula that imitates it.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from terrapin_hil.physics.effects import Effect
from terrapin_hil.physics.expression import parse
from terrapin_tools.workbench.bases import formula_name
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.model.fitting import Fit

__all__ = ["MOST_TAX", "size_tax", "usual_size"]

MOST_TAX = float(np.log(10.0))  # that a size can cost; chosen by hand


def usual_size(effect: Effect, case: Case) -> float | None:
    """In the unit of the effect's first parameter; None where it states none, or the case lacks a number in it."""
    if not effect.usual:
        return None
    known = {name: estimate.value for name, estimate in case.fit.items()} | dict(case.parameters)
    known |= {formula_name(name): float(np.abs(v).max()) for name, v in {**case.roles, **case.channels}.items()}
    wanted = parse(effect.usual)
    if not wanted.names <= known.keys():
        return None
    with np.errstate(all="ignore"):
        found = abs(float(wanted.evaluate({name: known[name] for name in wanted.names})))
    return found if 0.0 < found < np.inf else None


def size_tax(fit: Fit, names: Collection[str]) -> float:
    """Log of how unlikely the sizes of these effects are."""
    sizes = {f.effect: value for f, value in reversed(list(zip(fit.model.fitted, fit.theta, strict=True)))}
    tax = 0.0
    for effect in fit.model.effects:
        usual = usual_size(effect, fit.model.case) if effect.name in names else None
        if usual is not None:
            tax += min(float(np.log1p((sizes[effect.name] / usual) ** 2)), MOST_TAX)
    return tax
