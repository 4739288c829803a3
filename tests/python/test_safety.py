"""docs/safety.md is made of the sources as they are, and what is missing is seen."""

from __future__ import annotations

import copy
import sys
from typing import Any

import pytest

from terrapin_hil.paths import ROOT

sys.path.insert(0, str(ROOT / "tests" / "tools"))

import safety

HAZARDS = safety.table(safety.HAZARDS)["hazard"]
FAULTS = safety.table(safety.DESCRIPTION)["fault"]
ASKED = ("without an operator", "direction", "heating", "Brick", "e-stop", "Rolling away", "Regeneration")


def test_no_gap_and_the_page_is_as_it_would_be_made() -> None:
    assert safety.gaps(HAZARDS, FAULTS) == []
    assert safety.PAGE.read_text(encoding="utf-8") == safety.page(HAZARDS, FAULTS), "tests/tools/safety.py --renew"
    for words in ASKED:
        assert any(words in hazard["name"] for hazard in HAZARDS), words


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tests": ["tests/boot/test_boot.py::test_of_nothing"]}, "no test"),
        ({"where": "firmware/core/supervisor.c: words that do not stand there"}, "has no"),
        ({"where": "firmware/core/absent.c: x"}, "has no"),
        ({"tests": [], "open": ""}, "neither a test nor"),
        ({"faults": ["no_such"]}, "no fault"),
    ],
)
def test_gaps_are_seen(change: dict[str, Any], words: str) -> None:
    hazards = copy.deepcopy(HAZARDS)
    hazards[0]["barrier"][1] |= change
    assert any(words in line for line in safety.gaps(hazards, FAULTS))


def test_a_fault_of_no_hazard_is_a_gap() -> None:
    faults = {**FAULTS, "another": next(iter(FAULTS.values()))}
    assert safety.gaps(HAZARDS, faults) == ["fault another: no hazard names it"]
