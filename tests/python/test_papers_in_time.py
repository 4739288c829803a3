"""Tables of the papers' systems by code of our own: with what was hidden in them, the program's model leaves noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import fitted_on
from tests.campaigns.papers_in_time import make, write


@pytest.mark.parametrize("family", ["axle", "printed", "rut", "swing", "winding"])
def test_what_was_hidden_explains_the_table(family: str, tmp_path: Path) -> None:
    hidden = make(family, 1, 5)
    case = load_case(write(hidden, tmp_path / "case"))
    sigma = np.array([case.sigma[channel] for channel in case.channels])
    fits = fitted_on(case, hidden.truth, case.train, sigma)
    readings = int(case.train.sum()) * len(sigma)
    without, with_it = (float(np.sqrt(fit.cost / readings)) for fit in (fits[0], fits[-1]))
    assert 0.9 < with_it < 1.1
    assert without > 1.02 * with_it
