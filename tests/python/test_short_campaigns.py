"""The campaigns of docs/rates.md in a short form: two cases of each family, on a seed of their own.

Whole, they run for hours (docs/campaigns.md); here a family that has broken shows. Two cases cannot show a rate: a
family may miss one of them, and no answer may be wrong above 0.9.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.campaigns import calibration, hidden, mujoco_rigs, noises, several_columns, two_channels
from tests.campaigns.resumed import Record, sure_and_wrong

SEED, CASES, MISSES = 3, 2, 1
ANSWERED: dict[str, Callable[[str, int], Record]] = {
    **{f"noises {name}": lambda name, number: noises.one(name, number, 0.0, 14, SEED) for name in noises.FAMILIES},
    **{f"calibration {name}": lambda name, number: calibration.one(name, number, SEED) for name in calibration.GROUPS},
    **{f"hidden {name}": lambda name, number: hidden.one(name, number, SEED) for name in hidden.FAMILIES},
    **{
        f"columns {name}": lambda name, number: several_columns.one(name, number, SEED)
        for name in several_columns.FORMS
    },
    "two channels": lambda name, number: two_channels.one(name, number, SEED),
    **{f"mujoco {name}": lambda name, number: mujoco_rigs.one(name, number, SEED) for name in mujoco_rigs.FEATURES},
}


@pytest.mark.parametrize("which", ANSWERED)
def test_two_cases_of_a_family(which: str) -> None:
    family = which.partition(" ")[2]
    records = [ANSWERED[which](family, number) for number in range(CASES)]
    wrong = [r for r in records if not r["right"]]
    assert len(wrong) <= MISSES, wrong
    sure = [r for r in wrong if sure_and_wrong(r["verdict"], r["probability"], r["right"])]
    assert not sure, sure
