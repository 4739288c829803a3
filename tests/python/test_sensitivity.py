"""The tool that halves and doubles the numbers of the decision (tests/campaigns/sensitivity.py)."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from terrapin_tools.workbench.discover import decide, unexplained
from tests.campaigns.sensitivity import MODULES, Threshold, compared, put, scaled, table, thresholds


@pytest.mark.parametrize(
    ("value", "halved", "doubled"),
    [
        (3, 1, 6),
        (1, 1, 2),
        (0.2, 0.1, 0.4),
        (0.75, 0.5, 0.875),
        ((1, 4.0), (1, 2.0), (2, 8.0)),
        ({"a": 2.0, "b": "c"}, {"a": 1.0, "b": "c"}, {"a": 4.0, "b": "c"}),
        (("omega", "load"), None, None),
        (True, None, None),
    ],
)
def test_numbers_and_nothing_else_are_scaled(value: Any, halved: Any, doubled: Any) -> None:
    assert (scaled(value, 0.5), scaled(value, 2.0)) == (halved, doubled)


def test_all_modules_that_have_a_number_get_it() -> None:
    one = next(t for t in thresholds("decide") if t.name == "ALONE")
    assert (one.value, one.means) == (decide.ALONE, "of the mass of all sets from which one class is told alone")
    try:
        put(one, 0.5)
        assert decide.ALONE == 0.5
        assert next(t for t in thresholds("unexplained") if t.name == "KNOWN").value == unexplained.KNOWN
    finally:
        put(Threshold("decide", "ALONE", 0.5, ""), one.value)
    assert one.value == decide.ALONE


def test_each_module_of_the_decision_says_what_its_numbers_are() -> None:
    for module in MODULES:
        for one in thresholds(module):
            assert one.means, f"{module}.{one.name} has no comment"


def test_the_table_has_what_changes_most_first() -> None:
    before = {"a": {"said": ["missing", "x"], "probability": 0.8, "right": True}}
    after = {"a": {"said": ["missing", "y"], "probability": 0.8, "right": False}}
    assert compared(before, after) == {"cases": 1, "changed": 1, "better": 0, "worse": 1}
    assert compared(before, before)["changed"] == 0
    listed = [Threshold("decide", name, 1, name.lower()) for name in ("CALM", "LOUD")]
    counts = {"CALM": compared(before, before), "LOUD": compared(before, after)}
    records = [{"module": "decide", "name": n, "factor": f, **c} for n, c in counts.items() for f in (0.5, 2.0)]
    rows = table(records, listed).splitlines()[2:]
    assert rows == [
        "| `decide.LOUD` | 1 | loud | 1 of 1 (+0 -1) | 1 of 1 (+0 -1) |",
        "| `decide.CALM` | 1 | calm | 0 of 1 | 0 of 1 |",
    ]
