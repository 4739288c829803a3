"""How compare puts its answer together, with the pieces given: rows that are looked at, fits and noise around them,
what is told of them, and the test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from terrapin_hil.arrays import Array, Mask
from terrapin_tools.workbench.compare import adequacy, comparison, input_noise
from terrapin_tools.workbench.compare.adequacy import Adequacy
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import NODES, Node
from terrapin_tools.workbench.noise.marginal_likelihood import STATED
from terrapin_tools.workbench.noise.odd import ODD_SHARE

WHITE = Node(0.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Case:
    """Of a case what is read; `name` says which rows were taken."""

    name: str = "whole"
    train: Any = None
    test: Any = "held"
    run: Any = None
    rows: int = 6
    effects: Sequence[str] = ()
    base: Any = None
    run_names: Sequence[str] = ()
    inputs: Any = None
    sigma: Any = None


def _steps(monkeypatch: pytest.MonkeyPatch, long: int = 1, step: int = 1, thin: tuple[bool, float] = (False, 0.5),
    whole: tuple[bool, float] = (False, 0.5)) -> tuple[Any, list[Any]]:  # fmt: skip
    """The answer on thinned rows, and what was analysed; `thin`, `whole`: whether something is missing, and p."""
    done: list[Any] = []

    def analysed(case: Case, seed: int, level: float, step: int, fitted: Any, held: Any) -> Any:
        done.append((case.name, step, fitted[0], held))
        missing, p = whole if "/" not in case.name or case.name == f"whole/{long}" else thin
        return SimpleNamespace(name=case.name, missing=missing, adequacy=SimpleNamespace(p_value=p))

    patches: dict[str, Any] = {
        "step_of_long": lambda case: long, "step_of": lambda case, node: step,
        "every": lambda case, step: replace(case, name=f"{case.name}/{step}", test=f"held/{step}"),
        "_fitted": lambda case, seed: (f"fits of {case.name}", SimpleNamespace(node="node")), "_analysed": analysed,
    }  # fmt: skip
    for name, does in patches.items():
        monkeypatch.setattr(comparison, name, does)
    case: Any = Case()
    return comparison._at_steps(case, 3, 0.05), done


def test_rows_that_say_the_same_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is missing there is missing; what is seen only on all rows has to be seen clearly."""
    found, done = _steps(monkeypatch)
    assert (found.name, done) == ("whole", [("whole", 1, "fits of whole", "held")])
    found, done = _steps(monkeypatch, long=3)
    assert (found.name, done) == ("whole/3", [("whole/3", 3, "fits of whole/3", "held")])
    found, done = _steps(monkeypatch, step=4, thin=(True, 1e-9), whole=(True, 1e-9))
    assert (found.name, done) == ("whole/4", [("whole/4", 4, "fits of whole/4", "held")])
    for p, clear in ((0.00099, True), (0.00101, False)):
        found, done = _steps(monkeypatch, step=4, whole=(True, p))
        assert found.name == ("whole" if clear else "whole/4")
        assert done[1] == ("whole", 1, "fits of whole", "held")
    found, done = _steps(monkeypatch, long=2, step=4)
    assert [one[:2] for one in done] == [("whole/2/8", 8), ("whole/2", 2)]


def _analysed(monkeypatch: pytest.MonkeyPatch, p_value: float = 0.5, gains: bool = False, lags: bool = False,
    known: Any = "directions", gathered: bool = False, odd: Any = ()) -> tuple[Any, dict[str, Any]]:  # fmt: skip
    """An answer of two channels on six rows, four of them trained on; what its pieces were given, by their names."""
    given: dict[str, Any] = {}

    def noted(name: str, result: Any) -> Any:
        def call(*asked: Any, **_: Any) -> Any:
            given.setdefault(name, []).append(asked)
            return result

        return call

    kinds = [SimpleNamespace(kind="run"), SimpleNamespace(kind="lag")]
    model = SimpleNamespace(channels=("f", "g"))
    fits = [SimpleNamespace(name=name, theta="theta", model=model) for name in ("first", "last")]
    sigma = np.array([0.5, 2.0])
    prediction, residual = np.stack([np.full(6, 5.0), np.full(6, 7.0)]), np.stack([np.full(6, 2.0), np.full(6, 3.0)])
    mask = np.isin(np.arange(6), odd)
    noise = SimpleNamespace(name="noise", sigma=sigma, odd=mask, node="node")
    errors = {("first", True): 4.0, ("first", False): 5.0, ("last", True): 2.0, ("last", False): 3.0}
    patches: dict[str, Any] = {
        "numeric_columns": lambda case: "columns", "odd_limit": lambda rows: 1,
        "farthest": noted("farthest", "apart"), "gathered": noted("gathered", gathered),
        "_fitted": noted("_fitted", (fits, replace_odd(noise), np.full((2, 6, 2), 9.0), known)),
        "free_slopes": noted("free_slopes", (prediction, residual, np.full((2, 6, 1), 8.0))),
        "_directions": noted("_directions", "directions of its own"), "column_shapes": lambda *_: "shapes",
        "shapes_of_each": noted("shapes_of_each", {"drag": "shape"}), "suspected": lambda model: "suspected",
        "varying_parameters": noted("varying", "varying"), "terms_of": noted("terms_of", {"term": "one"}),
        "_mishaps": noted("_mishaps", kinds), "_lags": noted("_lags", lags), "_felt": lambda *_: "felt",
        "assess": noted("assess", Adequacy(p_value, 1.0, {})), "where_it_fails": noted("where", ["failure"]),
        "noise_around": noted("noise_around", "noise around"), "sds": noted("sds", np.array([1.0, 2.0, 0.5])),
        "covariance": noted("covariance", (None, np.diag([4.0, 1.0, -1.0]))),
        "error": lambda fit, rows, sigma: errors[fit.name, bool(rows[0])],
    }  # fmt: skip
    for name, does in patches.items():
        monkeypatch.setattr(comparison, name, does)
    train = np.arange(6) < 4
    case: Any = Case(
        "case", train, ~train, np.arange(6) // 2, effects=("drag",), base=SimpleNamespace(gains=lambda: gains)
    )
    fitted: Any = (fits, noise, np.full((2, 6, 2), 9.0), known)
    held: Any = "held"
    return comparison._analysed(case, 3, 0.05, 2, fitted, held), given


def replace_odd(noise: Any) -> Any:
    return SimpleNamespace(**{**vars(noise), "name": "noise again", "odd": np.zeros(5, dtype=bool)})


def test_an_answer_is_put_together_of_its_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    found, given = _analysed(monkeypatch)
    assert (found.missing, found.where, found.told, found.step, found.held) == (False, [], "noise around", 2, "held")
    assert (found.fit.name, found.noise.name, found.shapes, found.felt) == ("last", "noise", {"drag": "shape"}, "felt")
    assert [(one.added, one.train_error, one.heldout_error) for one in found.ladder] == [
        (None, 4.0, 5.0), ("drag", 2.0, 3.0)
    ]  # fmt: skip
    np.testing.assert_allclose(found.nuisance[:, 0], [[18.0, 18.0], [4.5, 4.5]])
    assert found.sd.tolist() == [1.0, 2.0, 0.5]
    assert given["sds"][0][3] == "noise around"
    assert found.rows.all()
    assert not found.odd.any()
    _, residual, widened, prediction, noise, directions, effects, shapes, rows, seed, varying, wrong, felt = given[
        "assess"
    ][0]
    assert widened.shape == (2, 6, 3)
    assert widened[0, 0].tolist() == [8.0, 9.0, 9.0]
    assert (directions, effects, shapes, seed) == ("directions", {"drag": "shape", "term": "one"}, "shapes", 3)
    assert (varying, felt, [one.kind for one in wrong]) == ("varying", "felt", ["run"])
    assert (prediction[0, 0], residual[1, 0], noise.name, rows.all()) == (5.0, 3.0, "noise", True)
    np.testing.assert_allclose(given["varying"][0][1][:, 0], [[16.0], [4.0]])
    run, scaled, slopes, _ = given["_lags"][0]
    assert run.tolist() == [0, 0, 1, 1, 2, 2]
    np.testing.assert_allclose(scaled[:, 0], [4.0, 1.5])
    np.testing.assert_allclose(slopes[:, 0, 0], [16.0, 4.0])
    assert not {"where", "covariance", "_directions"} & given.keys()


def test_where_something_is_missing_it_is_told_where_and_how_unsure_it_makes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The misfit outweighs the noise: the scatter over the runs counts where that is more."""
    found, given = _analysed(monkeypatch, p_value=0.04, lags=True, gains=True, known=None)
    assert (found.missing, found.where, found.told.name) == (True, ["failure"], "noise")
    assert found.sd.tolist() == [2.0, 2.0, 0.5]
    assert given["covariance"][0][1].tolist() == [0, 0, 1, 1]
    np.testing.assert_allclose(given["where"][0][2][:, 0], [4.0, 1.5])
    assert [one.kind for one in found.mishaps] == ["run", "lag"]
    assert given["assess"][0][5] == "directions of its own"
    may_vary = given["varying"][0][1]  # the formulas as a whole, too, each in its channel
    np.testing.assert_allclose(may_vary[:, 0], [[16.0, 10.0, 0.0], [4.0, 0.0, 3.5]])
    assert "noise_around" not in given
    assert _analysed(monkeypatch, p_value=0.05)[0].missing is False


def test_a_row_that_stands_alone_is_left_out_unless_such_rows_gather(monkeypatch: pytest.MonkeyPatch) -> None:
    found, given = _analysed(monkeypatch, odd=[2])
    assert np.flatnonzero(found.odd).tolist() == [2]
    assert given["_fitted"][0][0].train.tolist() == [True, True, False, True, False, False]
    assert (found.noise.name, found.rows.sum(), found.rows[2]) == ("noise again", 5, False)
    found, given = _analysed(monkeypatch, odd=[2], gathered=True)
    assert (found.noise.name, found.odd.any(), found.rows.sum()) == ("noise", False, 6)
    assert given["gathered"][0][1] == "apart"
    found, given = _analysed(monkeypatch, odd=[2, 3])  # more than may be
    assert (found.noise.name, found.odd.any(), "_fitted" in given) == ("noise", False, False)


def test_the_noise_around_a_fit_is_estimated_with_that_of_its_inputs(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    @dataclass(frozen=True)
    class Noise:
        odd: Array
        columns: int
        sigma: Array
        known: Array
        node: str = "node"

    def estimate(residual: Array, slopes: Array, *given: Any) -> Noise:
        asked.append(given)
        return Noise(np.array([True, False, False]), slopes.shape[-1], np.ones(1), np.array([True]))

    count = [0]
    patches: dict[str, Any] = {
        "free_slopes": lambda *_: (np.ones((1, 3)), np.ones((1, 3)), np.ones((1, 3, 2))), "estimate_noise": estimate,
        "require_numbers": lambda *_: None, "_directions": lambda *_: ["direction"], "_pools": lambda *_: "pools",
        "column_shapes": lambda *_: None, "_felt": lambda *_: "felt",
        "input_noise": lambda fit, rows, residual, slopes, sigma, node, whole: np.ones((1, 3, count[0])),
        "undecided": lambda nuisance, sigma, share: np.array([False, False, share == ODD_SHARE]),
    }  # fmt: skip
    for name, does in patches.items():
        monkeypatch.setattr(comparison, name, does)
    base = SimpleNamespace(whole_runs=False)
    case: Any = SimpleNamespace(
        train=np.ones(4, dtype=bool), test=np.arange(4) > 9, base=base, run=np.array([7, 8, 9, 9]),
        roles={"omega": np.arange(4.0)},
    )  # fmt: skip
    case.train[0] = False
    fit: Any = SimpleNamespace(model=None, theta=None)
    given: Any = [0.5]
    least: Any = "least"

    def found() -> tuple[Any, Any, Any]:
        asked.clear()
        return comparison._noise_of(case, fit, np.ones(1), given, least)

    noise, nuisance, directions = found()
    assert (noise.columns, noise.odd.tolist(), nuisance.shape, directions) == (
        2, [True, False, False], (1, 3, 0), ["direction"]
    )  # fmt: skip
    _, run, sigmas, roles, pools, lowest, felt = asked[0]
    assert (run.tolist(), sigmas, pools, lowest, felt) == ([8, 9, 9], [0.5], "pools", "least", "felt")
    assert roles["omega"].tolist() == [1.0, 2.0, 3.0]
    count[0] = 3
    noise, nuisance, _ = found()
    assert (noise.columns, noise.odd.tolist(), len(asked)) == (5, [True, False, True], 2)
    base.whole_runs = True
    found()
    assert asked[0][3] == {}  # of a motion equal inputs are no repeated settings


def test_an_sd_that_is_off_is_told_with_the_run_that_makes_it_so(monkeypatch: pytest.MonkeyPatch) -> None:
    @dataclass(frozen=True)
    class Noise:
        name: str
        wrong: Array
        carried: Any = None
        sigma: str = "sigma"

    asked: list[Any] = []
    wrong = [np.array([0.0, 0.0])]

    def noise_of(case: Any, fit: Any, sigma: Any, given: Any, least: Any) -> tuple[Noise, None, None]:
        asked.append((sigma, list(given), least))
        return Noise("estimated", wrong[0]), None, None

    monkeypatch.setattr(comparison, "_noise_of", noise_of)
    monkeypatch.setattr(comparison, "measured", lambda model, rows: "measured")
    monkeypatch.setattr(comparison, "least_noise", lambda values: f"least of {values}")
    monkeypatch.setattr(comparison, "followed", lambda noise, given, estimated: noise)
    monkeypatch.setattr(comparison, "_one_run", lambda case, fit: "carried")
    mask = np.ones(2, dtype=bool)
    case: Any = SimpleNamespace(train=mask, test=mask, sigma={"f": 0.5, "g": None})
    fit: Any = SimpleNamespace(model=SimpleNamespace(channels=("f", "g")))
    known: Any = Noise("known", np.array([0.0, 0.9]))
    found: Any = comparison.noise_around(case, fit, known)
    assert (found.name, found.carried, asked) == ("known", "carried", [])
    found = comparison.noise_around(case, fit, known, again=True)
    assert (found.name, found.carried, asked) == ("estimated", None, [("sigma", [0.5, None], "least of measured")])


def test_larger_models_are_fitted_from_their_parents(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the faults that the table has; made once more the first starts where it ended."""

    class Model:
        def __init__(self, names: tuple[str, ...] = ()) -> None:
            self.names = names

        def having(self, effect: Any) -> Model:
            return Model((*self.names, str(effect)))

        def bind(self, inputs: Any, rows: Any) -> str:
            return "+".join(self.names) or "plain"

    monkeypatch.setattr("terrapin_tools.workbench.compare.comparison.Model.of", lambda case, effects: Model())
    monkeypatch.setattr("terrapin_tools.workbench.compare.comparison.Model.having", Model.having)
    monkeypatch.setattr(comparison, "measured", lambda model, rows: "values")
    monkeypatch.setattr(comparison, "_base_starts", lambda bound, seed: [bound, seed])
    monkeypatch.setattr(comparison, "fit_model", lambda bound, values, sigma, starts: (bound, values, sigma, starts))
    monkeypatch.setattr(
        comparison, "extend", lambda fit, name, bound, values, sigma: (fit[0], name, bound, values, sigma)
    )
    case: Any = SimpleNamespace(inputs=None, library={"drag": "drag", "gear": "gear"})
    fitted: Any = comparison.fitted_on
    given = (case, ["drag", "gear"], "rows", "sigma", 4)
    first, second, third = fitted(*given)
    assert first == ("plain", "values", "sigma", ["plain", 4])
    assert second == ("plain", "drag", "drag", "values", "sigma")
    assert third == ("plain", "gear", "drag+gear", "values", "sigma")
    first, second, _ = fitted(*given, ["fault"], [SimpleNamespace(theta="theta"), None])
    assert first == ("fault", "values", "sigma", ["theta"])
    assert second == ("fault", "drag", "fault+drag", "values", "sigma")


def test_what_may_go_wrong_on_the_rig_acts_through_the_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """A change of a channel in its noise sd; a slope on what rolls, a run at a time, where the base has it and no
    column says it."""
    acted: list[tuple[str, Array]] = []

    def acting(model: Any, theta: Any, target: str, rows: Any, sigma: Any) -> Any:
        def act(change: Array) -> Array:
            acted.append((target, change))
            return 10.0 * change

        return act

    monkeypatch.setattr(comparison, "acting", acting)
    monkeypatch.setattr(comparison, "mishaps", lambda runs, act, whole, slopes: (runs, act, whole, slopes))
    base = SimpleNamespace(forces=("rolling_resistance",), whole_runs=True)
    case = SimpleNamespace(run=np.array([3, 3, 5]), base=base, roles={})
    model: Any = SimpleNamespace(channels=("f", "g"), case=case)
    theta, rows, sigma = np.zeros(1), np.ones(3, dtype=bool), np.array([0.5, 2.0])

    def found() -> Any:
        acted.clear()
        return comparison._mishaps(model, theta, np.ones((2, 3)), rows, sigma)

    runs, act, whole, slopes = found()
    assert (runs.channels, runs.runs, whole) == (2, 2, True)
    np.testing.assert_allclose(slopes, [[10.0, 10.0, 0.0], [0.0, 0.0, 10.0]])
    np.testing.assert_allclose(act(1, np.array([1.0, 0.0, 3.0])), [20.0, 0.0, 60.0])
    assert acted[-1][0] == "g"
    case.roles = {"slope": None}
    assert found()[3] is None
    case.roles, base.forces = {}, ("drag",)
    assert found()[3] is None


def _assessed(
    monkeypatch: pytest.MonkeyPatch, size: float = 1.0, rows: int = 40, behind: float = 3.0
) -> dict[str, Any]:
    """What the test of a residual of that size, in noise sd, is made with."""
    given: dict[str, Any] = {"made": []}
    kinds = [2, 5, 7, 9]

    class Factor:
        def __init__(self, runs: Any, slopes: Array, blocks: Any, behind: float, nodes: Any) -> None:
            given["made"].append((slopes, behind, list(nodes)))
            self.evidence = SimpleNamespace(nodes=nodes)

        def weigh(self, scaled: Array) -> tuple[Array, Array]:
            given["scaled"] = scaled
            nothing, something = np.log([[0.5], [0.5], [9e-4], [9e-4]]), np.log([[0.99], [5e-4], [2e-3], [1e-4]])
            return nothing, something

        def __call__(self, sets: Array) -> tuple[Array, Array]:
            given.setdefault("sets", []).append(sets)
            return np.array([4.0]), np.full((3, 1), 1.0 / 3.0)

    def simulated(runs: Any, nodes: Any, posterior: Array, random: Any) -> Array:
        given["nodes"] = list(nodes)
        return np.full((rows, 7), 2.0)

    patches: dict[str, Any] = {
        "BayesFactor": Factor, "_simulated": simulated, "blocks_of": lambda *given: given,
        "_p_value": lambda statistic, null: 0.02, "_alternatives": lambda *_: [],
        "_gains": lambda runs, slopes, scaled, node, alternatives: {"gain": float(scaled[0, 0])},
    }  # fmt: skip
    for name, does in patches.items():
        monkeypatch.setattr(adequacy, name, does)
    noise: Any = SimpleNamespace(sigma=np.array([2.0]), known=np.array([True]), behind=behind, kinds=kinds, node=WHITE)
    case: Any = SimpleNamespace(run=np.zeros(rows, dtype=int))
    residual = 2.0 * size * np.where(np.arange(rows) % 2, 1.0, -1.0)[None]
    found = adequacy.assess(
        case, residual, np.full((1, rows, 4), 8.0), np.ones((1, rows)), noise, [], {}, {}, np.ones(rows, dtype=bool), 6
    )
    return {**given, "found": found}


def test_a_residual_is_tested_in_the_kinds_of_noise_that_are_likely(monkeypatch: pytest.MonkeyPatch) -> None:
    """With something missing or without; in noise sd, of which many rows say what it is."""
    given = _assessed(monkeypatch)
    np.testing.assert_allclose(np.abs(given["scaled"]), 1.0)
    (slopes, behind, every), (_, again, likely) = given["made"]
    assert (behind, again, every, likely, given["nodes"]) == (0.0, 0.0, [2, 5, 7, 9], [2, 5, 7], [2, 5, 7])
    np.testing.assert_allclose(slopes, 4.0)
    assert (given["sets"][1] == 2.0).all()
    found = given["found"]
    assert (found.p_value, found.log_bayes_factor, found.gain) == (pytest.approx(1.2 * 0.02), 4.0, {"gain": -1.0})


def test_of_few_rows_a_stated_sd_tells_noise_from_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """30 beside the parameters are enough; and a misfit of rounding has no scale of its own."""
    for rows, behind in ((34, 0.0), (33, 3.0)):
        given = _assessed(monkeypatch, rows=rows)
        assert {one[1] for one in given["made"]} == {behind}
        spread = given["sets"][1][0] / 2.0
        assert bool((spread == 1.0).all()) == (behind == 0.0)
        if behind:  # the sets have an sd as uncertain as a stated one
            random = np.random.default_rng([6, 0x7E57])
            np.testing.assert_allclose(spread, np.sqrt(STATED / random.chisquare(STATED, 7)))
    assert {one[1] for one in _assessed(monkeypatch, size=0.0099)["made"]} == {3.0}
    assert {one[1] for one in _assessed(monkeypatch, size=0.0101)["made"]} == {0.0}
    given = _assessed(monkeypatch, rows=33, behind=0.0)
    assert (given["sets"][1] == 2.0).all()


def _noisy(deviation: Array, shown: float, run: Any, more: dict[str, Array] | None = None) -> Array:
    """Columns of a model y = 3 x with inputs that were read with these deviations, of which `shown` shows."""
    steady = 10.0 + 5.0 * run
    inputs = {"x": steady + deviation, **(more or {})}
    rows = np.ones(len(run), dtype=bool)
    case = SimpleNamespace(inputs=inputs, run=run, base=SimpleNamespace(whole_runs=False))
    model = SimpleNamespace(case=case)
    model.bind = lambda given, mask: SimpleNamespace(
        predict=lambda theta: (3.0 * given["x"] + sum(0.5 * given[name] for name in more or {}))[None]
    )
    fit: Any = SimpleNamespace(model=model, theta=np.zeros(1))
    noise = 0.01 * np.random.default_rng(9).standard_normal(len(run))
    residual = (-3.0 * shown * deviation + noise)[None]
    slopes = np.ones((1, len(run), 1))
    return input_noise.input_noise(fit, rows, residual, slopes, np.array([0.01]), NODES[0], np.array([False]))


def test_an_inputs_noise_is_seen_where_its_share_is_that_of_noise() -> None:
    """All of it or a part; not more than there is, and nothing where it does not show or the model runs over time."""
    run = np.repeat(np.arange(8), 12)
    deviation = 0.1 * np.random.default_rng(2).standard_normal(96)
    means = np.array([deviation[run == one].mean() for one in range(8)])[run]
    for shown, count in ((1.0, 1), (0.5, 1), (1.05, 1), (0.0, 0), (-1.0, 0), (1.5, 0)):
        found = _noisy(deviation, shown, run)
        assert found.shape == (1, 96, count)
        if count:
            np.testing.assert_allclose(found[0, :, 0], 3.0 * (deviation - means), atol=1e-12)
    other = 0.1 * np.random.default_rng(3).standard_normal(96)
    both = _noisy(deviation, 1.0, run, {"z": 20.0 + other})  # the one whose noise shows stays
    assert both.shape == (1, 96, 1)
    np.testing.assert_allclose(both[0, :, 0], 3.0 * (deviation - means), atol=1e-12)
    assert _noisy(np.zeros(96), 1.0, run).shape == (1, 96, 0)
    assert _noisy(deviation[:16], 1.0, np.repeat(np.arange(8), 2)).shape == (1, 16, 0)  # of two rows no mean tells


def test_a_long_recording_is_drawn_as_often_as_its_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sets of simulated noise: each kind by its share, to the middle of four hundred slices."""
    drawn: list[tuple[int, int]] = []
    runs: Any = SimpleNamespace(channels=1, rows=3)

    def draw(random: Any, count: int, node: Any) -> Array:
        drawn.append((count, NODES.index(node)))
        return np.full((3, count), float(NODES.index(node)))

    runs.draw = draw
    random = np.random.default_rng(1)
    found = adequacy._simulated(runs, [4, 9, 11], np.array([0.5, 0.499, 0.0]), random)
    assert drawn == [(200, 4), (200, 9)]
    assert found.shape == (3, 400)
    drawn.clear()
    adequacy._simulated(runs, [4, 9, 11], np.array([0.5, 0.25, 0.2]), random)
    assert drawn == [(200, 4), (100, 9), (100, 11)]


def _mask(rows: int, *which: int) -> Mask:
    return np.isin(np.arange(rows), which)


def test_runs_that_carry_a_misfit_are_looked_for_on_all_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(comparison, "measured", lambda model, rows: np.array([[3.0, 0.0, 1.0, 1.0]]))
    monkeypatch.setattr(comparison, "predict", lambda fit, rows: np.zeros((1, 4)))
    fit: Any = SimpleNamespace(model=None)
    case: Any = SimpleNamespace(train=_mask(5, 0, 1), test=_mask(5, 2, 3), run=np.array([4, 4, 6, 8, 9]))
    assert comparison._one_run(case, fit).tolist() == [4]
    case.run = np.array([4, 4, 6, 6, 9])
    assert comparison._one_run(case, fit).tolist() == [-1]  # of two runs one always has more
    assert Runs(case.run[:4]).runs == 2
