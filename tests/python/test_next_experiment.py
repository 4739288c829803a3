"""The next experiment: within the rig's limits, with its reason, and right when it is run."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "campaigns"))

import next_experiment
from discovery_cases import Made

from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_tools.workbench.compare.comparison import Analysis, analyse, fitted_on
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.experiment.proposal import Experiment, propose
from terrapin_tools.workbench.experiment.rig_settings import held, levels, rows_of


@cache
def confounded(kind: str, seed: int = 1, rho: float = 0.0, size: float = 3.0) -> Made:
    random = np.random.default_rng(seed)
    for _ in range(30):
        made = next_experiment.confounded(kind, 16, rho, size, random)
        if made is not None:
            return made
    raise AssertionError("no case in 30 has the columns")


def proposed(kind: str, limits: Mapping[str, tuple[float, float]] | None = None) -> tuple[Analysis, Experiment | None]:
    """What is proposed to tell the pair apart, both refitted, on a case with these limits."""
    made = confounded(kind).case
    case = made if limits is None else replace(made, limits=limits)
    analysis = analyse(case)
    fits = [
        ((name,), fitted_on(case, [name], case.train, analysis.noise.sigma)[-1])
        for name in next_experiment.PAIRS[kind][1]
    ]
    return analysis, propose(analysis, fits)


@pytest.mark.parametrize(
    ("kind", "vary", "reason"),
    [
        ("load", {"load"}, "load stays at"),
        ("pass", {"speed", "pass"}, "pass and speed go together in all runs (correlation 1.00)"),
        ("slope", {"load", "slope"}, "stays at"),
        ("direction", {"omega"}, "omega has one direction"),
        ("ramp", {"omega", "acceleration"}, "acceleration and omega go together in all runs (correlation 1.00)"),
    ],
)
def test_varies_what_has_not_varied_and_says_so(kind: str, vary: set[str], reason: str) -> None:
    _, plan = proposed(kind)
    assert plan is not None
    assert vary & set(plan.vary)
    assert reason in plan.reason
    assert set(plan.separates) == set(next_experiment.PAIRS[kind][1])
    assert plan.runs == len(plan.settings) >= 2
    assert plan.error_rate < 0.02
    assert not set(plan.vary) & set(plan.hold)


@pytest.mark.parametrize("limits", [{"load": (20.0, 26.0)}, {"omega": (-4.0, 4.0), "load": (10.0, 80.0)}])
def test_stays_within_the_rigs_limits(limits: dict[str, tuple[float, float]]) -> None:
    analysis, plan = proposed("load", limits)
    assert plan is not None
    case = analysis.case
    for setting in plan.settings:
        for role, value in {**setting, **plan.hold}.items():
            seen = case.roles.get(role, np.array([case.parameters.get(role, np.nan)]))
            low, high = limits.get(role, (float(seen.min()), float(seen.max())))
            assert low <= value <= high, role


def test_a_rig_that_can_set_nothing_new_is_told_so() -> None:
    analysis, plan = proposed("load", {"omega": (1.0, 5.0)})
    assert plan is None
    assert "load" not in {r for r, steps in levels(analysis.case, analysis.rows).items() if len(set(steps)) > 1}


def test_narrow_limits_take_more_runs() -> None:
    wide, narrow = (proposed("slope", {"load": span})[1] for span in ((10.0, 60.0), (17.5, 18.5)))
    assert wide is not None
    assert narrow is not None
    assert narrow.runs > wide.runs


def test_a_twin_that_no_setting_separates_does_not_stand_in_the_way() -> None:
    case = confounded("direction").case
    analysis = analyse(case)
    names = ("coulomb_friction", "current_offset", "coulomb_friction")
    fits = [((name,), fitted_on(case, [name], case.train, analysis.noise.sigma)[-1]) for name in names]
    plan = propose(analysis, fits)
    assert plan is not None
    assert plan.vary == ("omega",)
    assert propose(analysis, [fits[0], fits[2]]) is None
    assert propose(analysis, fits[:1]) is None


def test_an_unmapped_column_that_a_rival_reads_is_set_within_what_was_measured() -> None:
    """And the reason speaks of what was measured: a column that went far did not vary too little."""
    made, random = confounded("load").case, np.random.default_rng(5)
    x = np.repeat(random.uniform(47.0, 220.0, made.run.max() + 1), np.bincount(made.run))
    other = x + 4.0 * random.standard_normal(len(x))
    case = replace(made, extra={**made.extra, "x": x, "z": other, "kind": (x > 100.0).astype(float)}, limits={})
    rows = np.ones(case.rows, dtype=bool)
    assert "x" not in levels(case, rows)
    steps = levels(case, rows, {"x", "kind"})
    assert min(steps["x"]) == pytest.approx(x.min(), rel=1e-3)
    assert max(steps["x"]) == pytest.approx(x.max(), rel=1e-3)
    assert steps["kind"] == [0.0, 1.0]
    assert "z" not in steps
    own = {
        name: Effect(name, name, "", "", (case.base.name,), (Parameter("k", "1", 0.0),), (), f"k*{text}", "current")
        for name, text in (("first", "x"), ("second", "sqrt(x)"))
    }
    case = replace(case, library={**case.library, **own})
    analysis = analyse(replace(case, channels={"current": case.channels["current"] + 3e-4 * x}))
    fits = [((n,), fitted_on(analysis.case, [n], case.train, analysis.noise.sigma)[-1]) for n in own]
    plan = propose(analysis, fits)
    assert plan is not None
    assert "x" in {*plan.vary, *plan.hold}
    assert "varies too little" not in plan.reason


def test_new_rows_run_on_and_the_axle_follows_the_shell() -> None:
    made = confounded("direction")
    case = made.case
    rows = np.ones(case.rows, dtype=bool)
    inputs = rows_of(case, rows, [{"omega": 2.0}, {"omega": -4.0}], held(case, rows), 5)
    assert inputs["omega"].tolist() == [2.0] * 5 + [-4.0] * 5
    if "speed" in case.roles:
        assert inputs["speed"][5] == pytest.approx(-2.0 * inputs["speed"][0])
    for name, values in inputs.items():
        assert values.shape == (10,), name


@pytest.mark.parametrize(("kind", "rho"), [("load", 0.0), ("pass", 0.8), ("direction", 0.0), ("ramp", 0.0)])
def test_one_candidate_is_left_after_the_proposed_runs(kind: str, rho: float) -> None:
    made = confounded(kind, seed=3, rho=rho)
    found = discover(made.case)
    assert found.verdict == "ambiguous"
    assert {frozenset([n]) for n in next_experiment.PAIRS[kind][1]} <= {frozenset(r) for r in found.rivals}
    later = next_experiment.after_proposed(made, found, np.random.default_rng(7))
    assert later.verdict == "missing"
    assert later.missing == made.truth


def test_a_speed_that_was_not_measured_is_asked_of_no_rig_without_limits() -> None:
    """Not the other way round, not faster; what else is settable may go a quarter beyond."""
    case = replace(confounded("direction").case, limits={})
    omega = case.roles["omega"]
    for role, steps in levels(case, np.ones(case.rows, dtype=bool)).items():
        if role in ("omega", "speed"):
            assert omega.min() <= min(steps)
            assert max(steps) <= omega.max()
    plan = proposed("direction", {})[1]
    assert plan is None  # the other direction alone tells this pair apart
