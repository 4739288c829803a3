"""A case's model refitted with further effects."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.case.changes import OwnEffect, extended
from terrapin_tools.workbench.compare.comparison import fitted_on, predict
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.model.table_faults import fault_of

Array = npt.NDArray[np.float64]

__all__ = ["refit"]


def refit(case: Case, sigma: Array, own: Mapping[str, OwnEffect], effects: tuple[str, ...]) -> Fit | None:
    """The case's model with further effects, fitted on its training runs; None when it gives no prediction.

    Parameters
    ----------
    sigma : (channels,), noise sd in the channels' units.
    effects : names of the catalogue, or of expressions in `own`.
    own : the expressions among the effects, and what faults of the table need.
    """
    wrong = [fault_of(case, name, own[name].mend) for name in effects if name in own and own[name].mend]
    effects = tuple(name for name in effects if name not in {fault.name for fault in wrong})
    wanted = {n: o for n, o in own.items() if n in effects and n not in case.library}
    try:
        larger = case.changed(extended(case.text, case.stated, effects, wanted))
    except UserError:  # a proposal that case.toml cannot hold: its card stands without a curve
        return None
    fit = fitted_on(larger, larger.effects, case.train, sigma, wrong=wrong)[-1]
    return fit if bool(np.isfinite(predict(fit, case.train | case.test)).all()) else None
