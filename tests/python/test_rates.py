"""The rates that docs/rates.md gives are those of the lines that are committed."""

from __future__ import annotations

import pytest

from tests.campaigns import rates
from tests.campaigns.resumed import COUNTED, Record, committed


def test_the_page_says_what_was_counted() -> None:
    text = rates.PAGE.read_text(encoding="utf-8")
    assert rates.page(text) == text, "python -m tests.campaigns.rates --write"
    assert rates.page(text.replace("| 85 %: met |", "| 85 %: nearly |", 1)) == text


def test_lines_are_of_one_engine_which_the_page_names() -> None:
    """Figures of two programs do not mix."""
    engines = {line["engine"] for path in COUNTED.glob("*.gz") for line in committed(path.name.partition(".")[0])}
    assert len(engines) == 1
    assert f"engine** is {engines.pop()}" in rates.PAGE.read_text(encoding="utf-8")


def test_a_page_without_its_marks() -> None:
    with pytest.raises(ValueError, match="expected one <!-- counted"):
        rates.page(f"text {rates.END} {rates.BEGIN}")


def test_what_is_short_or_below_its_bound_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is wrong at 0.9 is not above it; cases in which nothing is missing are no part of the row."""
    lines: list[Record] = [
        {
            "family": "lacking",
            "number": n,
            "right": n >= 32,
            "verdict": "missing",
            "probability": 0.95 if n == 31 else 0.9,
        }
        for n in range(99)
    ]
    lines += [{**lines[-1], "family": "complete", "number": n, "right": False} for n in range(9)]
    monkeypatch.setattr(rates, "committed", {"ode_systems": lines}.__getitem__)
    (row,) = rates.own_equations()
    assert str(row).endswith("--seed 4`, 99 of 100 | 67.7 % (57.5 to 76.7) | 1 of 99 | 85 %: **not met** |")
    lines += [{**lines[-1], "family": "lacking", "right": True} for _ in range(200)]
    (row,) = rates.own_equations()
    assert str(row).endswith("--seed 4`, 299 | 89.3 % (85.2 to 92.6) | 1 of 299 | 85 %: met |")


def test_noises_come_worst_first(monkeypatch: pytest.MonkeyPatch) -> None:
    said: Record = {"setting": "0-14-13", "alarm": False, "verdict": "adequate", "probability": 0.95, "right": True}
    false: Record = {**said, "alarm": True, "verdict": "unexplained", "right": False}
    noises = [
        {**(false if n == 0 else said), "family": f} for f in ("white", "rig") for n in range(400 if f == "rig" else 10)
    ]
    monkeypatch.setattr(rates, "committed", {"noises": noises, "two_channels": []}.__getitem__)
    shown = rates.alarms()[2:]
    assert shown[0] == "| white, 10 of 400 cases | 10.0 % (0.3 to 44.5) | 1 | **not met** |"
    assert shown[1].startswith("| all rig noises together, 400 cases | 0.2 %")
    assert shown[2].endswith("| 0.5 % (0.1 to 1.8) | at most 1 % above 0.9: met |")


def test_bic_is_judged_by_both_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    def lines(ours: int, bic: int) -> dict[str, list[Record]]:
        """Of ten cases, how many each names wrongly; the rest is right."""
        both: dict[str, list[Record]] = {"calibration": [], "exhaustive": []}
        for n in range(10):
            one = {"family": "inputs", "number": n}
            both["calibration"].append({**one, "right": n >= ours, "verdict": "missing", "hidden": 9.0})
            both["exhaustive"].append({**one, "right": n >= bic, "named": ["slope"]})
        return both

    for ours, bic, met in ((1, 3, "met"), (2, 5, "**not met**"), (4, 3, "**not met**")):
        monkeypatch.setattr(rates, "committed", lines(ours, bic).__getitem__)
        assert f"wrong claims are {ours} and {bic} " in rates.beside_bic()
        assert rates.beside_bic().endswith(f"wrong claims: {met}).")
