"""Every shipped scenario is a test: it runs, its checks hold, and they are checks that can fail."""

from __future__ import annotations

from pathlib import Path

import pytest

from terrapin_hil import paths
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import load_scenario

SHIPPED = sorted(paths.SCENARIOS.glob("*.toml"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_scenario(path: Path) -> None:
    scenario = load_scenario(path)
    assert scenario.title
    assert scenario.checks
    result = run(scenario)
    failed = [f"{outcome.text}: {outcome.found}" for outcome in result.outcomes if not outcome.passed]
    assert failed == []
