"""The cases that ship with something hidden: what their notes say explains them, and nothing short of it does."""

from __future__ import annotations

import numpy as np
import pytest

from terrapin_hil import paths
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.model.fitting import extend, fit_model
from terrapin_tools.workbench.model.model import Model

HIDDEN = {
    "car_on_soft_soil": ("multipass", 0.45, 0.05),
    "cylinder_over_time": ("speed_squared", 0.6e-3, 0.05e-3),
    "sphere_on_sand": ("slip_sinkage", 2.0, 0.5),
    "wheel_on_soil": ("rut_recovery", 0.3, 0.02),
}


@pytest.mark.parametrize("name", HIDDEN)
def test_the_notes_tell_what_is_hidden(name: str) -> None:
    """Without the effect the fit is far off; with it, it is at the noise, and its size is that of the notes."""
    case = load_case(paths.examples()[name])
    assert sum(path.stat().st_size for path in paths.examples()[name].iterdir()) < 20_000
    model = Model.of(case)
    sigma = np.array([case.sigma[channel] for channel in model.channels])
    measured = np.stack([case.channels[channel] for channel in model.channels])[:, case.train]
    effect, size, within = HIDDEN[name]
    present = fit_model(model.bind(case.inputs, case.train), measured, sigma, [model.start])
    more = model.having(case.library[effect]).bind(case.inputs, case.train)
    found = extend(present, effect, more, measured, sigma)
    assert np.sqrt(present.cost / measured.size) > 2.0
    assert 0.8 < np.sqrt(found.cost / measured.size) < 1.2
    assert found.theta[len(present.theta)] == pytest.approx(size, abs=within)


def test_plates_are_told_the_water() -> None:
    """In no catalogue: the pressure's gain follows the moisture."""
    answer = discover(load_case(paths.examples()["plates_in_soil"]))
    assert answer.verdict == "missing"
    assert answer.answer_probability > 0.9
    (name,) = answer.missing
    (effect,) = (candidate.effect for candidate in answer.candidates if candidate.effect.name == name)
    assert effect.target == "gain_of_p"
    assert "w" in effect.expression
