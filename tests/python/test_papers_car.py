"""`terrapin papers`, the car of Vella et al.: estimates on simulated runs, what follows for Table 1 and Fig. 3."""

from __future__ import annotations

import re

import pytest

from terrapin_tools.papers import vella
from terrapin_tools.papers.part import Part
from terrapin_tools.papers.verdict import ASSUMED, FAILED, REPRODUCED


@pytest.fixture(scope="module")
def parts() -> dict[str, Part]:
    return {part.title: part for part in vella.parts()}


def test_table_1(parts: dict[str, Part]) -> None:
    stiffness, unchanged, most, minimum = parts["Table 1"].checks
    assert (stiffness.outcome, stiffness.found) == (REPRODUCED, "535.33")
    assert unchanged.outcome == FAILED  # neither cost leaves the other four where they were
    alone = re.search(r"K_s alone gives ([\d.]+)", unchanged.why)
    assert alone is not None
    assert float(alone[1]) == pytest.approx(357.6, rel=0.01)
    assert most.outcome == FAILED
    assert "K_s 13.7, n 27.9, c 1.1, phi 23.5, K_t 6.2" in most.found  # an independent implementation's
    assert minimum.outcome == ASSUMED
    assert "z = 60 mm" in parts["Table 1"].text[0]  # the depth at which the runs fix the pressure
    (table,) = parts["Table 1"].tables
    assert [row[0] for row in table.rows] == ["K_s", "n", "c", "phi", "K_t"]
    assert [row[5] for row in table.rows][1:3] == ["no", "no"]


def test_figure_3(parts: dict[str, Part]) -> None:
    assert {check.outcome for check in parts["Fig. 3"].checks} == {ASSUMED}  # nothing of the runs is printed
    above = parts["Fig. 3"].checks[0]
    assert above.near == "holds"
