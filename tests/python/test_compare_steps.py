"""What compare is made of, against direct calculations: Bayes factors by evidence, intervals of costs that are known,
combinations that stay, stretches where a model fails, rows that are looked at."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import logsumexp

from terrapin_hil.arrays import Array, Mask
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.compare import comparison, intervals, thinned, together
from terrapin_tools.workbench.compare.adequacy import Adequacy, _alternatives, _p_value, failure_on, where_it_fails
from terrapin_tools.workbench.compare.bayes_factor import WEIGHT, BayesFactor, Block
from terrapin_tools.workbench.compare.intervals import SDS, _side
from terrapin_tools.workbench.model.data_columns import Direction, Shapes
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import NODES, Node
from terrapin_tools.workbench.noise.marginal_likelihood import STATED, Evidence
from tests.python.casekit import dense

EVERY = np.ones(400, dtype=bool)
OFFSETS = next(i for i, node in enumerate(NODES) if node.offset == 2.0 and not node.share)


@pytest.mark.parametrize("behind", [None, 0.0, STATED])
def test_a_bayes_factor_is_that_of_evidence_of_each_alternative(behind: float | None) -> None:
    """Averaged by prior shares: of single columns and of blocks, whose sizes are of one sd."""
    random = np.random.default_rng(1)
    run = random.permutation(np.repeat(np.arange(8), 5))
    runs, base = Runs(run, 1, random.uniform(0.5, 2.0, (1, 40))), random.standard_normal((1, 40, 2))
    columns = [random.standard_normal((40, count)) for count in (1, 3, 1, 2)]
    given = [("catalogue", 0.7), ("column", 1.0), ("run", 0.25), ("lag", 0.5)]
    blocks = [Block(family, one, share) for one, (family, share) in zip(columns, given, strict=True)]
    nodes = [0, 3, OFFSETS, 20, 40]
    residuals = random.standard_normal((40, 3))
    residuals[:, 1] += 0.8 * columns[1][:, 2]
    stated = {} if behind is None else {"behind": behind}
    statistic = BayesFactor(runs, base, blocks, **stated, nodes=nodes)
    factors, posterior = statistic(residuals)
    assert factors.shape == (3,)
    for column, factor in enumerate(factors):
        evidence = Evidence(runs, residuals[None, :, column], base, behind or 0.0, nodes)
        logs = []
        for one, (family, share) in zip(columns, given, strict=True):
            count = one.shape[1]
            found = evidence.blocks(evidence.gram(one), np.arange(count)[None], np.zeros((1, count)))[0]
            logs.append(found + np.log(WEIGHT[family] * share))
        assert factor == pytest.approx(logsumexp(logs) - evidence.nothing)
        np.testing.assert_allclose(posterior[:, column], evidence.posterior, rtol=1e-9)
    assert sum(WEIGHT.values()) == pytest.approx(1.0)


def test_a_p_value_is_a_share_of_what_is_simulated_and_a_tail_beyond() -> None:
    null = np.arange(400.0)
    assert _p_value(200.0, null) == 201 / 401
    assert _p_value(390.0, null) == 11 / 401  # as large as ten of them
    edge = np.quantile(null, 0.95)
    excess = np.mean(null[null > edge] - edge)
    for statistic in (391.0, 500.0):
        assert _p_value(statistic, null) == pytest.approx(0.05 * np.exp(-(statistic - edge) / excess))


def test_what_is_ranked_is_in_noise_and_of_its_channel() -> None:
    sigma = np.array([2.0, 0.5])
    shapes = {"": Shapes(np.zeros((0, 3)), np.ones((1, 3))), "u": Shapes(np.eye(3)[:2], np.eye(3)[2:])}
    change = np.arange(6.0).reshape(2, 3)
    found = _alternatives([Direction("drag", change)], shapes, 3, sigma)
    assert [one.label for one in found] == [
        "effect:drag", "constant::0", "constant::0", "constant::1", "constant::1",
        "column:u:0", "plain:u:0", "column:u:1", "plain:u:1",
    ]  # fmt: skip
    np.testing.assert_allclose(found[0].columns[:, 0], [0.0, 0.5, 1.0, 6.0, 8.0, 10.0])
    assert found[1].columns.shape == (6, 0)
    assert found[2].columns[:, 0].tolist() == [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    np.testing.assert_array_equal(found[7].columns, np.vstack([np.zeros((3, 2)), np.eye(3)[:, :2]]))
    assert found[8].columns[:, 0].tolist() == [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


def test_the_stretch_where_a_model_fails_is_where_its_sum_stands_out() -> None:
    """Rows of one value stay together; 70 % of the rows at most, a twentieth at least."""
    u = np.random.default_rng(2).permutation(np.linspace(0.0, 1.0, 400))
    case: Any = SimpleNamespace(roles={}, library={})
    left = np.where((u > 0.4) & (u < 0.6), -3.0, 0.1)
    found = failure_on(case, "u", u, np.stack([np.zeros(400), left]), 1, EVERY, ("f", "g"), 7.5)
    assert (found.variable, found.channel, found.gain, found.with_direction) == ("u", "g", 7.5, False)
    assert found.low == pytest.approx(0.4, abs=0.02)
    assert found.high == pytest.approx(0.6, abs=0.02)
    assert found.mean_residual == pytest.approx(-3.0, abs=0.2)
    levels = np.repeat([0.0, 1.0, 2.0, 3.0], 100)
    found = failure_on(case, "u", levels, np.where(levels == 2.0, 1.0, 0.0)[None], 0, EVERY, ("f",), 1.0)
    assert (found.low, found.high, found.mean_residual) == (2.0, 2.0, 1.0)
    narrow = np.where(u > 0.99, 50.0, 0.0)  # 4 rows: the stretch has 20
    found = failure_on(case, "u", u, narrow[None], 0, EVERY, ("f",), 1.0)
    assert found.high == 1.0
    assert found.low == pytest.approx(0.95, abs=0.005)
    constant = failure_on(case, "u", u, np.ones((1, 400)), 0, EVERY, ("f",), 1.0)
    assert constant.high - constant.low == pytest.approx(0.7, abs=0.03)
    omega = np.where(np.arange(400) % 2, 2.0, -2.0)
    turned = np.where(u > 0.5, np.sign(omega), 0.0)
    case.roles["omega"] = omega
    found = failure_on(case, "u", u, turned[None], 0, EVERY, ("f",), 1.0)
    assert found.with_direction
    assert found.mean_residual == pytest.approx(1.0, abs=0.05)
    part = np.arange(400) < 200
    found = failure_on(case, "u", u[part], turned[None, part], 0, part, ("f",), 1.0)
    assert found.mean_residual == pytest.approx(1.0, abs=0.05)


def test_columns_are_told_by_what_they_gain_strongest_first() -> None:
    """A plain factor must do better than a constant by six; each column once a channel, five at most."""
    u = np.linspace(0.0, 1.0, 400)
    case: Any = SimpleNamespace(roles={}, library={})
    columns = dict.fromkeys("abcdefg", u)

    def told(gain: dict[str, float], limit: int = 5) -> list[tuple[str, str, float]]:
        adequacy = Adequacy(0.0, 1.0, gain)
        found = where_it_fails(case, adequacy, np.ones((2, 400)), EVERY, columns, ("x", "y"), limit)
        return [(one.variable, one.channel, one.gain) for one in found]

    gain = {"column:a:0": 5.0, "column:b:1": 9.0, "plain:b:1": 11.0, "constant::0": -1.0, "column:c:0": -3.0}
    assert told(gain) == [("b", "y", 11.0), ("a", "x", 5.0)]
    assert told({**gain, "constant::1": 5.5})[0] == told({**gain, "constant::1": 5.0})[0] == ("b", "y", 9.0)
    assert told({**gain, "constant::1": 4.9})[0] == ("b", "y", 11.0)
    assert told({"column:c:0": -3.0, "column:d:0": -4.0}) == [("c", "x", -3.0)]  # one is told at least
    assert told({"column:a:0": 5.0, "column:a:1": 4.0}) == [("a", "x", 5.0), ("a", "y", 4.0)]
    many = {f"column:{name}:0": 10.0 + place for place, name in enumerate("abcdefg")}
    assert [name for name, *_ in told(many)] == list("gfedc")
    assert [name for name, *_ in told(many, 2)] == list("gf")
    effect = SimpleNamespace(parameters=(None,), needs=(("a",),))
    case.library, case.roles = {"drag": effect}, {"a": u}
    assert told({"effect:drag": 12.0, "column:a:1": 3.0}) == [("a", "y", 12.0)]
    assert told({"effect:drag": 12.0}) == [("a", "x", 12.0)]


def _analysis(cost: Any, theta: float, sd: float, lower: float = -np.inf, upper: float = np.inf) -> tuple[Any, Any]:
    """With one parameter whose cost is known, and another that follows."""
    fitted = [SimpleNamespace(whole=False), SimpleNamespace(whole=False), SimpleNamespace(whole=True)]
    model = SimpleNamespace(
        lower=np.array([lower, -9.0, 0.0]), upper=np.array([upper, 9.0, 9.0]), fitted=fitted
    )  # fmt: skip
    fit = SimpleNamespace(theta=np.array([theta, 0.0, 3.0]), model=model, cost=cost(theta))
    asked: list[float] = []

    def refit(start: Array, free: Mask) -> tuple[Array, float]:
        assert free.tolist() == [False, True, False]
        assert start[2] == 3.0
        asked.append(float(start[0]))
        assert len(asked) == 1 or start[1] in [0.0, *asked]  # from where the last one inside ended
        return np.array([start[0], start[0], 3.0]), cost(float(start[0]))

    return SimpleNamespace(fit=fit, sd=np.array([sd, 1.0, 1.0])), refit


def test_an_interval_ends_where_the_cost_has_risen_by_that_of_two_sds() -> None:
    """Of a parabola at 1.96 sd; of one that is steeper on one side, where it has; an sd that is told larger widens it
    in proportion."""
    for sd, white in ((0.5, 0.5), (1.5, 0.5)):
        analysis, refit = _analysis(lambda x: 7.0 + ((x - 2.0) / 0.5) ** 2, 2.0, sd)
        for way in (-1.0, 1.0):
            end, why = _side(analysis, refit, 0, white, way)
            assert why == "closes"
            assert end == pytest.approx(2.0 + way * SDS * sd, abs=4e-3 * SDS * sd)
    assert pytest.approx(1.959964, abs=1e-6) == SDS
    for power in (0.5, 4.0):
        analysis, refit = _analysis(lambda x, power=power: abs(x) ** (2.0 * power), 0.0, 1.0)
        end, why = _side(analysis, refit, 0, 1.0, 1.0)
        assert why == "closes"
        assert end is not None
        assert end**power == pytest.approx(SDS, rel=4e-3)


@pytest.mark.parametrize("off", [0.9985, 0.9999])
def test_where_the_sd_is_nearly_right_one_refit_finds_an_end(off: float) -> None:
    """To two thousandths: that is near enough."""
    analysis, refit = _analysis(lambda x: (x / off) ** 2, 0.0, 1.0)
    asked: list[float] = []

    def counted(start: Array, free: Mask) -> tuple[Array, float]:
        asked.append(float(start[0]))
        found: tuple[Array, float] = refit(start, free)
        return found

    assert _side(analysis, counted, 0, 1.0, -1.0) == (pytest.approx(-SDS), "closes")
    assert len(asked) == 1


def test_an_interval_may_end_at_a_bound_or_nowhere() -> None:
    def flat(x: float) -> float:
        return 1.0 + 1e-3 * np.tanh(x)

    analysis, refit = _analysis(flat, 0.0, 1.0, upper=50.0)
    assert _side(analysis, refit, 0, 1.0, 1.0) == (50.0, "bound")
    assert _side(analysis, refit, 0, 1.0, -1.0) == (None, "open")
    analysis, refit = _analysis(lambda x: x * x, 3.0, 1.0, upper=3.0)
    assert _side(analysis, refit, 0, 1.0, 1.0) == (3.0, "bound")  # it is there
    # a cost that rises at last, at half of the farthest that is looked at
    far = SDS * 2.0**11
    analysis, refit = _analysis(lambda x: 0.0 if x < far else 1e9, 0.0, 1.0)
    assert _side(analysis, refit, 0, 1.0, 1.0)[1] == "no numbers"
    analysis, refit = _analysis(lambda x: (x / 1000.0) ** 2, 0.0, 1.0)
    end, why = _side(analysis, refit, 0, 1.0, 1.0)
    assert (why, end) == ("closes", pytest.approx(1000.0 * SDS, rel=4e-3))


def test_an_interval_stops_where_the_model_gives_no_numbers() -> None:
    """But where the cost has risen by nine tenths of what ends it, it ends there."""
    for edge, why in ((0.5, "no numbers"), (0.88, "no numbers"), (0.95, "closes")):
        analysis, refit = _analysis(lambda x, edge=edge: x * x if x < edge * SDS else np.nan, 0.0, 1.0)
        end, told = _side(analysis, refit, 0, 1.0, 1.0)
        assert told == why
        assert end == pytest.approx(edge * SDS, rel=1e-6)


def test_intervals_of_all_but_whole_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each with the other that it is most correlated with, of either sign."""
    keys = [("k", "N", False), ("n", "", True), ("m", "", False)]
    fitted = [SimpleNamespace(key=key, unit=unit, whole=whole) for key, unit, whole in keys]
    fit = SimpleNamespace(theta=np.array([1.0, 2.0, 3.0]), bound=None)
    fit.model = SimpleNamespace(fitted=fitted, case=SimpleNamespace(train=np.ones(3, dtype=bool)))
    case = SimpleNamespace(run=np.zeros(3), train=np.ones(3, dtype=bool))
    both = np.array([[4.0, 0.6, -1.8], [0.6, 1.0, 0.1], [-1.8, 0.1, 1.0]])
    analysis: Any = SimpleNamespace(fit=fit, case=case, noise=SimpleNamespace(sigma=np.ones(1)), told=None)
    monkeypatch.setattr(intervals, "covariance", lambda *_: (np.diag([9.0, 16.0, 25.0]), None))
    monkeypatch.setattr(intervals, "covered", lambda *_: (both, None))
    monkeypatch.setattr(intervals, "minimiser", lambda *_: None)
    monkeypatch.setattr(intervals, "measured", lambda *_: None)
    monkeypatch.setattr(intervals, "_side", lambda a, r, place, white, way: (place + way * white, f"{way:g}"))
    said: list[str] = []
    found = intervals.intervals(analysis, said.append)
    assert said == ["interval of k", "interval of m"]
    k, m = found["k"], found["m"]
    assert (k.value, k.low, k.high, k.ends, k.unit) == (1.0, -3.0, 3.0, ("-1", "1"), "N")
    assert (k.partner, k.correlation) == ("m", pytest.approx(-0.9))
    assert (m.value, m.low, m.high, m.unit, m.partner) == (3.0, -3.0, 7.0, "1", "k")
    fitted[1:] = []
    fit.theta = np.array([1.0])
    both = np.array([[4.0]])
    alone = intervals.intervals(analysis)["k"]
    assert (alone.partner, alone.correlation) == ("", 0.0)


def _together(names: str, theta: Array, formula: Any, noise: float = 0.1, missing: bool = False) -> Any:
    """An analysis of a model of one channel over 60 rows of x and z."""
    random = np.random.default_rng(3)
    x, z = random.uniform(1.0, 2.0, (2, 60))
    fitted = [SimpleNamespace(key=name, whole=False) for name in names]

    def predict(values: Array) -> Array:
        return np.asarray(formula(values, x, z))[None]

    def jacobian(values: Array) -> tuple[Array, Array]:
        steps = 1e-6 * np.diag(np.maximum(np.abs(values), 1e-3))
        slopes = [(predict(values + s) - predict(values - s)) / (2.0 * s.max()) for s in steps]
        return predict(values), np.stack(slopes, axis=-1)

    @dataclass(frozen=True)
    class Fit:
        theta: Array
        jacobian: Array
        residual: Array
        model: Any
        bound: Any
        at_bound: tuple[str, ...] = ()

    model = SimpleNamespace(fitted=fitted)
    bound = SimpleNamespace(predict=predict, jacobian=jacobian)
    residual = random.standard_normal((1, 60))
    fit = Fit(theta, jacobian(theta)[1] / noise, residual, model, bound)
    run = np.arange(60) // 6
    case = SimpleNamespace(run=run, train=np.ones(60, dtype=bool))
    told = SimpleNamespace(node=NODES[0], known=np.array([True]), sigma=np.array([noise]))
    return SimpleNamespace(
        fit=fit, case=case, noise=SimpleNamespace(sigma=np.array([noise])), told=told, missing=missing
    )  # fmt: skip


def test_what_stays_of_parameters_that_go_together() -> None:
    """A product, a quotient with a power, a sum; with the value that they have together and its sd, as if it were a
    parameter."""
    theta = np.array([2.0, 3.0, 5.0])
    (found,) = together.together(_together("abc", theta, lambda p, x, z: p[0] * p[1] * x + p[2] * z))
    (stays,) = found.determined
    assert (found.parameters, stays.formula, stays.near) == (("a", "b"), "a*b", False)
    assert stays.value == pytest.approx(6.0)
    random = np.random.default_rng(3)
    x, z = random.uniform(1.0, 2.0, (2, 60))
    columns = np.stack([x, z], axis=1) / 0.1
    assert stays.sd == pytest.approx(np.sqrt(np.linalg.inv(columns.T @ columns)[0, 0]), rel=1e-3)
    (found,) = together.together(_together("abc", theta, lambda p, x, z: p[1] / p[0] ** 2 * x + p[2] * z))
    assert {one.formula for one in found.determined} <= {"b/a^2", "a/b^0.5"}
    (found,) = together.together(_together("abc", theta, lambda p, x, z: (p[0] - p[1]) * x + p[2] * z))
    (stays,) = found.determined
    assert stays.formula in ("a - b", "b - a")
    assert abs(stays.value) == pytest.approx(1.0)
    assert not stays.near
    (found,) = together.together(
        _together("abc", theta, lambda p, x, z: (p[0] ** 2 + p[0] * np.exp(p[1])) * x + p[2] * z)
    )
    assert found.determined[0].near  # neither holds farther off
    assert together.together(_together("abc", theta, lambda p, x, z: p[0] * x + p[1] + p[2] * z)) == []
    two = _together("abcd", np.array([2.0, 3.0, 5.0, 7.0]), lambda p, x, z: p[0] * p[1] * x + p[2] * p[3] * z)
    assert sorted(one.parameters for one in together.together(two)) == [("a", "b"), ("c", "d")]


def test_rows_of_a_long_recording_are_taken_evenly_in_each_run() -> None:
    @dataclass(frozen=True)
    class Case:
        train: Mask
        test: Mask
        run: Array
        base: Any

    def case(runs: int, length: int, whole: bool = False, train: float = 0.5) -> Any:
        run = np.random.default_rng(4).permutation(np.repeat(np.arange(runs), length))
        mine = run < train * runs
        return Case(mine, ~mine, run, SimpleNamespace(whole_runs=whole))

    for rows, step in ((4999, 1), (5000, 1), (9999, 1), (10_000, 2), (15_000, 3)):
        assert thinned.step_of_long(case(1, rows)) == step
    assert thinned.step_of_long(case(1, 20_000, whole=True)) == 1
    small = case(6, 20)
    found = thinned.every(small, 3)
    for number in range(6):
        mine = np.flatnonzero(small.run == number)
        assert np.flatnonzero((found.train | found.test) & (small.run == number)).tolist() == mine[::3].tolist()
    assert not (found.train & ~small.train).any()
    assert not (found.test & ~small.test).any()

    def step(share: float, rho: float, length: int = 1000, whole: bool = False) -> int:
        return thinned.step_of(case(4, length, whole), Node(share, rho, 0.0, 0.0, 1.0))

    assert step(1.0, 0.8) == 6  # 0.8^5 is above 0.3, 0.8^6 below
    assert step(0.5, 0.9) == 5  # half of 0.9^4 above, of 0.9^5 below
    assert step(1.0, 0.98) == 16  # sixty rows of a thousand stay
    assert step(1.0, 0.8, 240) == 4
    assert step(1.0, 0.8, 120) == 2
    assert (step(1.0, 0.8, 119), step(0.3, 0.9), step(0.0, 0.0), step(1.0, 0.8, whole=True)) == (1, 1, 1, 1)


def test_the_run_that_makes_up_most_of_what_a_fit_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    """More than half of all squares, of three runs at least."""
    run = np.repeat([4, 1, 7], 4)
    case: Any = SimpleNamespace(train=run != 9, test=np.zeros(12, dtype=bool), run=run)
    left = np.ones((3, 12))
    left[0, run == 7] = 1.5  # 9 of 17
    left[1, run == 7] = 1.4  # 7.84 of 15.84
    left[2, run == 1] = -9.0
    fit: Any = SimpleNamespace(model=None)
    monkeypatch.setattr(comparison, "measured", lambda model, rows: left[:, rows] + 5.0)
    monkeypatch.setattr(comparison, "predict", lambda fit, rows: np.full((3, rows.sum()), 5.0))
    assert comparison._one_run(case, fit).tolist() == [7, -1, 1]
    case.train = run != 4
    assert comparison._one_run(case, fit).tolist() == [-1, -1, -1]


def test_an_error_is_the_rms_in_noise_sds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(comparison, "measured", lambda model, rows: np.array([[3.0, 5.0], [1.0, 1.0]]))
    monkeypatch.setattr(comparison, "predict", lambda fit, rows: np.array([[1.0, 1.0], [1.0, 4.0]]))
    fit: Any = SimpleNamespace(model=None)
    found = comparison.error(fit, np.ones(2, dtype=bool), np.array([2.0, 0.5]))
    assert found == pytest.approx(np.sqrt((1.0 + 4.0 + 0.0 + 36.0) / 4.0))
    assert comparison.error(fit, np.zeros(2, dtype=bool), np.ones(2)) is None


def test_an_sd_that_was_found_holds_what_runs_have_in_common(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[list[float]] = []
    monkeypatch.setattr(comparison, "covariance", lambda fit, run, node, sd: seen.append(sd.tolist()))
    case: Any = SimpleNamespace(run=np.zeros(2), train=np.ones(2, dtype=bool))
    noise: Any = SimpleNamespace(node=NODES[OFFSETS], known=np.array([True, False]), sigma=np.array([3.0, 4.0]))
    fit: Any = None
    comparison.covered(fit, case, np.array([2.0, 8.0]), noise)
    assert seen == [[1.5, pytest.approx(0.5 / np.sqrt(5.0))]]


def test_a_parameter_at_its_bound_takes_nothing_up(monkeypatch: pytest.MonkeyPatch) -> None:
    slopes = np.arange(12.0).reshape(1, 4, 3)
    fitted = [SimpleNamespace(key=key, effect=effect) for key, effect in (("k", None), ("a", "drag"), ("m", None))]
    model = SimpleNamespace(fitted=fitted, case=SimpleNamespace(inputs={}, base=SimpleNamespace(whole_runs=False)))
    model.bind = lambda inputs, rows: SimpleNamespace(jacobian=lambda theta: (np.full((1, 4), 2.0), slopes))
    monkeypatch.setattr(comparison, "measured", lambda model, rows: np.full((1, 4), 5.0))
    fit: Any = SimpleNamespace(model=model, theta=np.zeros(3), at_bound=("k", "a"))
    prediction, residual, free = comparison.free_slopes(fit, np.ones(1), np.ones(4, dtype=bool))
    assert (prediction[0, 0], residual[0, 0]) == (2.0, 3.0)
    np.testing.assert_array_equal(free, slopes[..., 2:])
    free = comparison.free_slopes(fit, np.ones(1), np.ones(4, dtype=bool), released=True)[2]
    np.testing.assert_array_equal(free, slopes[..., [0, 2]])  # the model's own may follow what is added


def test_what_runs_have_of_their_own_is_followed_by_starts_that_are_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    def acting(model: Any, theta: Array, target: str, rows: Mask, sigma: Array) -> Any:
        def act(change: Array) -> Array:
            own = np.zeros((1, 2, change.shape[1]))
            own[0, "fg".index(target)] = 0.5 * change[0] / sigma["fg".index(target)]
            return own

        return act

    monkeypatch.setattr(comparison, "acting", acting)
    run, prediction = np.repeat([0, 1], 4), np.arange(1.0, 17.0).reshape(2, 8)
    case = SimpleNamespace(dynamics=object(), run=run)
    model: Any = SimpleNamespace(case=case, channels=("f", "g"))
    rows, sigma = np.ones(8, dtype=bool), np.array([2.0, 4.0])
    found = comparison._felt(model, np.zeros(1), prediction, rows, sigma)
    np.testing.assert_allclose(found, 0.5 * Runs(run, 2, prediction).shifts)
    case.dynamics = None
    assert comparison._felt(model, np.zeros(1), prediction, rows, sigma) is None
    seen: list[Any] = []

    def mishaps(runs: Runs, act: Any, whole_runs: bool, slopes: Any) -> str:
        seen.extend([runs, act, whole_runs, slopes])
        return "found"

    monkeypatch.setattr(comparison, "mishaps", mishaps)
    case.base, case.roles = SimpleNamespace(forces=("f",), whole_runs=True), {}
    assert comparison._mishaps(model, np.zeros(1), prediction, rows, sigma) == "found"
    change = np.arange(8.0)
    np.testing.assert_allclose(seen[1](1, change), [np.zeros(8), 0.5 * change])  # of a channel's sd
    assert seen[2:] == [True, None]
    np.testing.assert_allclose(seen[0].reading[0], Runs(run, 2, prediction).reading[0])
    monkeypatch.setattr(comparison, "GROUND", "f")

    def rolls(model: Any, theta: Array, target: str, rows: Mask, sigma: Array) -> Any:
        return lambda change: 3.0 * change

    monkeypatch.setattr(comparison, "acting", rolls)
    comparison._mishaps(model, np.zeros(1), prediction, rows, sigma)
    assert seen[-1].tolist() == [[3.0] * 4 + [0.0] * 4, [0.0] * 4 + [3.0] * 4]  # of one run each
    case.roles = {"slope": np.zeros(8)}
    comparison._mishaps(model, np.zeros(1), prediction, rows, sigma)
    assert seen[-1] is None  # it was measured


def test_shapes_for_the_smoothest_model_are_those_of_columns_and_of_effects() -> None:
    model: Any = SimpleNamespace(channels=("f", "g"))
    rows = np.ones(3, dtype=bool)
    drag = Direction("drag", np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]]))
    shapes = {"u": Shapes(np.eye(3)[:2], np.eye(3)[2:])}
    first, second = comparison._pools(model, [drag], shapes, rows)
    np.testing.assert_array_equal(first, [*np.eye(3), [1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(second, np.eye(3))
    empty = comparison._pools(model, [drag], {}, rows)
    assert [one.shape for one in empty] == [(1, 3), (0, 3)]


def test_the_first_row_without_a_number_is_named() -> None:
    rows = np.array([False, True, True, True])
    model: Any = SimpleNamespace(channels=("f", "g"))
    bound: Any = SimpleNamespace(trouble=lambda theta: "")
    model.bind = lambda inputs, rows: bound
    case: Any = SimpleNamespace(inputs={}, place=lambda row: f"t.csv:{row + 2}", folder="x")
    prediction = np.ones((2, 3))
    comparison.require_numbers(case, model, prediction, np.zeros(1), rows, "now")
    for value in (np.nan, -np.inf, 1e200):
        prediction[1, 1] = prediction[0, 2] = value
        with pytest.raises(UserError, match=rf"^t\.csv:4: the model gives {value:g}".replace("+", r"\+")):
            comparison.require_numbers(case, model, prediction, np.zeros(1), rows, "now")


def test_noise_of_one_kind_has_that_covariance() -> None:
    """What the Bayes factor takes as white is so."""
    runs = Runs(np.repeat(np.arange(4), 5))
    white = runs.whiten(np.linalg.cholesky(dense(runs, NODES[OFFSETS])), NODES[OFFSETS])
    np.testing.assert_allclose(white @ white.T, np.eye(20), atol=1e-9)
