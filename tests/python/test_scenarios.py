"""Every shipped scenario is a test: it runs, its checks hold, and they are checks that can fail."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from terrapin_hil import paths
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario

SHIPPED = sorted(paths.SCENARIOS.glob("*.toml"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_scenario(path: Path) -> None:
    scenario = load_scenario(path)
    assert scenario.title
    assert scenario.checks
    result = run(scenario)
    failed = [f"{outcome.text}: {outcome.found}" for outcome in result.outcomes if not outcome.passed]
    assert failed == []


def test_the_ramp_of_the_speed_loop_is_a_parameter() -> None:
    """At 1 rad/s^2 the joint is, once it turns at all, as many rad/s fast as seconds have passed."""
    scenario = load_scenario(find_scenario("speed_control"))
    order = replace(scenario.operator[0], time=0.5, control="speed", setpoint=0.4)  # 5 rad/s
    result = run(replace(scenario, operator=(order,), faults=(), firmware={"speed_ramp": 1.0}))
    for seconds in (3.5, 4.5):
        assert abs(result.truth["alpha_rate"][round(1000 * (0.5 + seconds))] - seconds) < 0.1
