"""Which column matters: the one without which most of the answer is gone, not one that happens to stand in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from casekit import ROLLING, rolling

from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import analyse, fitted_on
from terrapin_tools.workbench.discover.misfit import explained, importance
from terrapin_tools.workbench.discover.ranker import Hypothesis
from terrapin_tools.workbench.discover.ranking import Ranking

OWN = """
[effect.mine]
expression = "k * log(humidity) * (temperature - 25)"
k = { value = 1e-4, min = -1.0, max = 1.0 }
"""


def shares(folder: Path, text: str, effect: str) -> dict[str, float]:
    """What `importance` says of a case whose only answer is this effect."""
    case = load_case(rolling(folder, 5, heating=0.004, text=text))
    analysis = analyse(case)
    fit = fitted_on(case, (effect,), case.train, analysis.noise.sigma)[-1]
    only = (Hypothesis((effect,), "catalogue", 0.0, fit),)
    return importance(analysis, Ranking(only, np.ones(1), {}, {}, {}, {}))


def test_a_factor_that_hardly_varies_does_not_matter(tmp_path: Path) -> None:
    found = shares(tmp_path, ROLLING + OWN, "mine")
    assert set(found) == {"temperature", "humidity"}
    assert found["temperature"] > 0.1  # not more: held at its median it still makes a constant torque
    assert found["humidity"] < 0.01


def test_an_effect_that_reads_no_column_depends_on_what_is_left_of_it(tmp_path: Path) -> None:
    found = shares(tmp_path, ROLLING, "current_offset")
    assert set(found) == {"omega", "load", "temperature", "humidity"}
    assert max(found, key=lambda name: found[name]) == "omega"  # f_o takes up what goes with the direction
    assert all(0.0 <= share <= 1.0 for share in found.values())


def test_what_bins_explain_of_noise_is_nothing() -> None:
    random = np.random.default_rng(2)
    x, noise = random.uniform(-1, 1, 500), random.standard_normal(500)
    assert explained(np.sin(2 * x), x) > 0.95
    assert explained(noise, x) < 0.05
    assert explained(np.zeros(500), x) == 0.0
    assert explained(noise, np.ones(500)) == 0.0
