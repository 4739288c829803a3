"""What differs between groups: each parameter's values, and whether they are one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from terrapin_tools.workbench.compare.comparison import Analysis
from terrapin_tools.workbench.model.fitting import covariance

__all__ = ["Differing", "differences"]


@dataclass(frozen=True)
class Differing:
    """A parameter with a value for each group. `values` and `sds` by group, in `unit`; `p_value` that they are one."""

    parameter: str
    by: str
    unit: str
    values: dict[str, float]
    sds: dict[str, float]
    p_value: float


def differences(analysis: Analysis) -> list[Differing]:
    """Every parameter that has one value a group, with Wald's test on the covariance of the fit.

    Where something is missing the covariance is widened to the sds of the answer, which then come from the scatter over
    runs.
    """
    fit, case = analysis.fit, analysis.case
    matrix = covariance(fit, case.run[case.train], analysis.noise.node)[0]
    wider = analysis.sd / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    matrix = matrix * np.outer(wider, wider)
    found = []
    for name, by in case.by.items():
        at = [i for i, one in enumerate(fit.model.fitted) if one.by and one.name == name]
        values, mine = fit.theta[at], matrix[np.ix_(at, at)]
        contrast = np.eye(len(at))[1:] - np.eye(len(at))[:1]
        gap = contrast @ values
        distance = float(gap @ np.linalg.solve(contrast @ mine @ contrast.T, gap))
        names = [fit.model.fitted[i].group for i in at]
        found.append(
            Differing(
                parameter=name,
                by=by,
                unit=fit.model.fitted[at[0]].unit or "1",
                values=dict(zip(names, values.tolist(), strict=True)),
                sds=dict(zip(names, np.sqrt(np.diag(mine)).tolist(), strict=True)),
                p_value=float(chdtrc(len(at) - 1, distance)),
            )
        )
    return found
