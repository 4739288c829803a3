"""Discovery on cases with known answers: what it names, what it says when the data cannot tell, and what it costs."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "campaigns"))

from discovery_campaign import one
from discovery_cases import Made, confounded, make

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.compare.comparison import LEVEL, analyse, error, fitted_on, measured
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from terrapin_tools.workbench.discover.ranking import Blamed
from terrapin_tools.workbench.discover.resampled import Sums
from terrapin_tools.workbench.files.json_text import to_json
from terrapin_tools.workbench.model.linearised import linearise
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import PLAIN
from terrapin_tools.workbench.noise.marginal_likelihood import STATED, Evidence
from terrapin_tools.workbench.story.answer import answer
from terrapin_tools.workbench.story.terminal import tell
from terrapin_tools.workbench.story.told import told


def made(*arguments: object, seed: int, **options: object) -> Made:
    """The first case from this seed on whose columns are those that the effect needs."""
    for attempt in range(20):
        found = make(*arguments, np.random.default_rng([seed, attempt]), **options)  # type: ignore[arg-type]
        if found is not None:
            return found
    raise AssertionError("no case in 20 has the columns that the effect needs")


@cache
def searched(effect: str, seed: int) -> tuple[Made, Discovery]:
    """A case that lacks an effect, and what the search says of it."""
    case = made("rolling_steady", (effect,), 14, 0.5, 3.0, seed=seed)
    return case, discover(case.case)


def heldout_ratio(case: Made, found: Discovery) -> float:
    sigma = np.array([case.sigma[c] for c in found.analysis.model.channels])
    best = error(fitted_on(case.case, sorted(case.truth), case.case.train, sigma)[-1], case.case.test, sigma)
    after = error(found.ladder[-1].fit, case.case.test, sigma)
    assert best is not None
    assert after is not None
    return after / best


@pytest.mark.parametrize(
    ("effect", "seed"),
    [
        ("speed_squared", 1),
        ("viscous_friction", 3),
        ("cogging", 10),
        ("motor_heating", 10),
        ("current_offset", 5),
    ],
)
def test_names_the_one_hidden_effect(effect: str, seed: int) -> None:
    case, found = searched(effect, seed)
    assert found.verdict == "missing"
    assert found.missing == (effect,)
    assert found.answer_probability > 0.5
    assert found.candidates[0].effect.name == effect
    assert heldout_ratio(case, found) < 1.05


def test_what_the_next_comparison_says_is_in_the_probability() -> None:
    """Noise as one case in a thousand has it: the effect is sure, and that nothing else is missing is not."""
    case = made("rolling_steady", ("cogging",), 14, 0.5, 3.0, seed=9)
    found = discover(case.case)
    assert (found.verdict, found.missing) == ("missing", ("cogging",))
    assert found.candidates[0].probability > 0.9
    assert 0.05 < found.answer_probability < 0.5
    after = analyse(replace(case.case, effects=(*case.case.effects, "cogging")), 0, LEVEL)
    assert after.adequacy.p_value < 0.01


@pytest.mark.parametrize(("effect", "seed"), [("slip_sinkage", 2), ("force_offset", 3)])
def test_names_the_one_hidden_effect_on_soft_ground(effect: str, seed: int) -> None:
    case = made("sphere_contact", (effect,), 18, 0.0, 3.0, seed=seed)
    found = discover(case.case)
    assert (found.verdict, found.missing) == ("missing", (effect,))


def test_names_two_hidden_effects() -> None:
    case = made("rolling_steady", ("viscous_friction", "current_offset"), 16, 0.5, 2.0, seed=11)
    found = discover(case.case)
    assert found.verdict == "missing"
    assert set(found.missing) == {"viscous_friction", "current_offset"}
    assert heldout_ratio(case, found) < 1.05


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_keeps_silent_when_nothing_is_missing(rho: float) -> None:
    case = made("rolling_steady", (), 14, rho, 1.0, seed=21)
    found = discover(case.case)
    assert found.verdict == "adequate"
    assert found.missing == ()
    assert found.rivals == ()


@pytest.mark.parametrize("seed", [1])
def test_says_when_the_data_cannot_tell_and_what_to_vary(seed: int) -> None:
    case, pair = confounded(np.random.default_rng(seed), 16, 0.0, 3.0)
    assert case is not None
    found = discover(case.case)
    assert found.verdict == "ambiguous"
    assert pair <= {frozenset(r) for r in found.rivals}
    assert found.experiment is not None
    wanted = {"load", "speed", "pass"}
    assert wanted & set(found.experiment.vary)
    assert found.experiment.runs >= len(found.experiment.settings)
    for setting in found.experiment.settings:
        for role, value in setting.items():
            seen = case.case.roles.get(role, np.array([case.case.parameters.get(role, np.nan)]))
            span = max(float(np.ptp(seen)), abs(float(seen.mean())))
            assert seen.min() - 0.51 * span <= value <= seen.max() + 0.51 * span


@pytest.mark.parametrize("size", [20.0, 200.0])
def test_a_large_effect_is_not_two_halves(size: float) -> None:
    """Sizes beyond those that are expected look likelier shared between two effects that are one on these data."""
    made = make("rolling_steady", ("speed_squared",), 16, 0.0, size, np.random.default_rng(1), confound="load")
    assert made is not None
    found = discover(made.case)
    assert found.verdict == "ambiguous"
    assert {frozenset(r) for r in found.rivals} >= {frozenset(["speed_squared"]), frozenset(["aerodynamic_drag"])}
    assert found.answer_probability < 0.95


def test_finds_an_expression_in_a_column_that_is_not_mapped() -> None:
    hidden = ("resistance", "k*humidity*sign(omega)", "humidity")
    case = made("rolling_steady", (), 14, 0.0, 3.0, seed=31, expression=hidden)
    found = discover(case.case)
    assert found.verdict in ("missing", "ambiguous")  # the exponent, 1 or 1.5, hardly shows
    (name,) = found.missing
    said = [{found.ranking.expressions[n].expression for n in one} for one in (found.rivals or [found.missing])]
    assert said[0] == {"k*humidity*sign(omega)"}
    assert all("humidity" in text for one in said for text in one)
    assert next(c for c in found.candidates if c.effect.name == name).kind == "expression"
    assert found.where[0].variable == "humidity"


def test_finds_an_expression_beside_an_effect() -> None:
    hidden = ("resistance", "k*humidity*sign(omega)", "humidity")
    case = made("rolling_steady", ("viscous_friction",), 16, 0.3, 3.0, seed=2, expression=hidden)
    found = discover(case.case)
    assert found.verdict == "missing"
    assert found.missing[0] == "viscous_friction"
    candidate = next(c for c in found.candidates if c.effect.name == found.missing[1])
    assert "humidity" in candidate.effect.expression


def test_the_limit_of_a_shape_is_no_rival() -> None:
    """stribeck with a large omega_s is coulomb_friction: the one with fewer parameters is the answer."""
    case = made("rolling_steady", ("coulomb_friction",), 20, 0.0, 3.0, seed=4)
    found = discover(case.case)
    assert (found.verdict, found.missing) == ("missing", ("coulomb_friction",))


def test_bootstrap_over_runs() -> None:
    case = made("rolling_steady", ("motor_heating",), 12, 0.0, 3.0, seed=10)
    found = discover(case.case, seed=3, bootstrap=50)
    assert found.selected[0].effects == ("motor_heating",)
    assert found.selected[0].frequency > 0.9
    assert sum(s.frequency for s in found.selected) == pytest.approx(1.0)
    assert answer(told(found.analysis, found))["selected"][0]["effects"] == ["motor_heating"]
    twins, rivals = confounded(np.random.default_rng([3, 1]), 14, 0.0, 2.0)
    assert twins is not None
    both = {frozenset(s.effects) for s in discover(twins.case, bootstrap=50).selected if s.frequency > 0.02}
    assert both & rivals


def test_bootstrap_weights_give_the_evidence_of_all_runs() -> None:
    """Each run once is the data themselves: sums over runs and the evidence of the whole must be the same number."""
    case = made("rolling_steady", ("cogging",), 10, 0.5, 2.0, seed=9)
    analysis = analyse(case.case, 0, LEVEL)
    effects = ("shell_imbalance", "aerodynamic_drag")
    fit = fitted_on(case.case, effects, case.case.train, analysis.noise.sigma)[-1]
    values = measured(analysis.model, analysis.rows)
    linear = linearise(fit, effects, values, analysis.rows, analysis.noise.sigma)
    runs = Runs(case.case.run[analysis.rows])
    for behind in (STATED, 0.0):
        whole = Evidence(runs, linear.residual, linear.base, behind, PLAIN)
        picks = np.arange(linear.columns.shape[1])[None, :]
        expected = whole.blocks(whole.gram(linear.columns), picks, linear.signs[None, :], linear.offset)
        assert Sums(runs, linear, behind, PLAIN).evidence(np.ones((1, 10))) == pytest.approx(expected, abs=1e-6)


def test_around_a_fit_a_model_is_linear_in_noise_sd() -> None:
    """Derivatives are those of the prediction over the noise sd; an effect's column has the size of the noise."""
    case = made("rolling_steady", ("aerodynamic_drag",), 10, 0.5, 2.0, seed=9).case
    sigma = np.array([0.02])
    fit = fitted_on(case, ("aerodynamic_drag",), case.train, sigma)[-1]
    rows = case.train | case.test
    found = linearise(fit, ("aerodynamic_drag",), measured(fit.model, rows), rows, sigma)
    bound = fit.model.bind(case.inputs, rows)

    def moved(place: int) -> Array:
        step = 1e-5 * max(abs(fit.theta[place]), 1e-3)
        near = [fit.theta + way * step * (np.arange(len(fit.theta)) == place) for way in (1.0, -1.0)]
        return np.asarray((bound.predict(near[0]) - bound.predict(near[1])) / (2.0 * step) / sigma[:, None])

    np.testing.assert_allclose(found.residual, (measured(fit.model, rows) - bound.predict(fit.theta)) / sigma[:, None])
    own = [i for i, f in enumerate(fit.model.fitted) if f.effect is None]
    for k, place in enumerate(own):
        np.testing.assert_allclose(found.base[..., k], moved(place), rtol=1e-4, atol=1e-6)
    (at,) = [i for i, f in enumerate(fit.model.fitted) if f.effect == "aerodynamic_drag"][:1]
    np.testing.assert_allclose(
        found.columns[:, 0] * found.offset[0], (fit.theta[at] * moved(at)).reshape(-1), rtol=1e-4
    )
    assert np.sqrt(np.mean(found.columns[:, 0] ** 2)) == pytest.approx(1.0)


def test_a_short_campaign() -> None:
    """Twelve cases drawn like those of the long campaign: nothing missing, or one effect of 3 noise sd."""
    options = {"seed": 5, "runs": 14, "rho": 0.5, "size": 3.0, "base": "rolling_steady"}
    singles = [r for number in range(8) if (r := one(("single", number, options))) is not None]
    nothing = [r for number in range(4) if (r := one(("adequate", number, options))) is not None]
    assert len(singles) >= 5
    assert sum(r["first"] in r["truth"] for r in singles) >= len(singles) - 1
    assert sum(r["verdict"] == "adequate" for r in nothing) >= len(nothing) - 1
    assert not [r for r in singles if r["probability"] > 0.9 and not r["named_right"]]


@pytest.mark.parametrize(("too_small", "verdict"), [(2.5, "missing"), (4.0, "partial")])
def test_noise_that_was_stated_too_small_is_not_missing(too_small: float, verdict: str) -> None:
    """As far as a user may be wrong in it; beyond that it may be something that is missing."""
    case = made("rolling_steady", ("viscous_friction",), 14, 0.0, 8.0, seed=3).case
    found = discover(replace(case, sigma={"current": (case.sigma["current"] or 0.0) / too_small}))
    assert (found.verdict, found.missing) == (verdict, ("viscous_friction",))
    text = " ".join(tell(told(found.analysis, found)).split())
    assert "times what is stated" in text
    assert ("That nothing else is missing has probability 0.30." in text) == (verdict == "partial")
    assert "more is missing" not in text


def test_names_a_single_bad_run() -> None:
    case = made("rolling_steady", (), 14, 0.0, 1.0, seed=41).case
    current = case.channels["current"].copy()
    current[case.run == 5] += 8.0 * float(case.sigma["current"] or 0.0)
    found = discover(replace(case, channels={"current": current}))
    assert found.verdict == "unexplained"
    assert found.blamed == Blamed("run", (case.run_names[5],))
    assert "stands out" in tell(told(found.analysis, found))


def test_the_same_seed_gives_the_same_bytes() -> None:
    case = made("rolling_steady", ("viscous_friction",), 10, 0.5, 2.0, seed=3)
    first, second = (to_json(answer(told(f.analysis, f))) for f in [discover(case.case, seed=7) for _ in range(2)])
    assert first == second


def test_the_answer_has_what_the_contract_asks_for() -> None:
    case, found = searched("motor_heating", 10)
    story = told(found.analysis, found)
    said = answer(story)
    assert said["schema"] == "terrapin.case/3"
    for key in ("case", "model", "parameters", "channels", "adequacy", "where", "verdict", "missing"):
        assert key in said
    assert said["ladder"][0]["added"] is None
    assert said["ladder"][-1]["heldout_error"] < said["ladder"][0]["heldout_error"]
    first = said["candidates"][0]
    assert first["effect"] == "motor_heating"
    assert first["kind"] == "catalogue"
    assert set(first["heldout_rmse"]) == {"current"}
    value, sd = first["parameters"]["a_t"]["value"], first["parameters"]["a_t"]["sd"]
    assert abs(value - case.theta["motor_heating.a_t"]) < 4 * sd
    assert first["explains"] > 0.8
    probabilities = [c["probability"] for c in said["candidates"]]
    assert probabilities == sorted(probabilities, reverse=True)
    assert all(0.0 <= p <= 1.0 for p in probabilities)
    text = tell(story)
    assert "the model lacks motor_heating and nothing else" in text
