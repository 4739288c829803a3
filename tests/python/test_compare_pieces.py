"""Pieces of compare, on numbers that are worked out by hand: gains of columns, findings of noise, sds,
parameters that are tied."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from terrapin_hil.arrays import Array, Mask
from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare import comparison, groups, together
from terrapin_tools.workbench.compare.adequacy import (
    Adequacy,
    _Alternative,
    _by_effect,
    _gains,
    _simulated,
    assess,
    failure_on,
    where_it_fails,
)  # fmt: skip
from terrapin_tools.workbench.compare.bayes_factor import blocks_of
from terrapin_tools.workbench.compare.comparison import _base_starts, analyse
from terrapin_tools.workbench.compare.input_noise import _column, undecided
from terrapin_tools.workbench.compare.intervals import _side
from terrapin_tools.workbench.compare.noise_findings import far_above_stated, noise_findings
from terrapin_tools.workbench.model.data_columns import Shapes
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import NODES, Node
from terrapin_tools.workbench.noise.marginal_likelihood import STATED
from terrapin_tools.workbench.noise.mishaps import Mishap
from terrapin_tools.workbench.noise.stated import FAR
from tests.python.casekit import of_formula

WHITE = Node(0.0, 0.0, 0.0, 0.0, 1.0)


def _case(folder: Path, formula: str, fit: str, rows: Iterable[tuple[float, ...]], sigma: float | None = None) -> Path:
    """A case of y over x and z, rows of run, x, z, y."""
    stated = "" if sigma is None else f", sigma = {sigma}"
    columns = f'x = {{ column = "x" }}\nz = {{ column = "z" }}\ny = {{ column = "y"{stated} }}'
    (folder / "case.toml").write_text(of_formula(formula, fit, columns))
    (folder / "runs.csv").write_text("run,x,z,y\n" + "".join(",".join(f"{v:.12g}" for v in row) + "\n" for row in rows))
    return folder


def test_the_gain_of_a_column_is_what_it_takes_from_the_sum_of_squares() -> None:
    """n log of the fall less log n for each column; what the model's own parameters take up gains nothing and costs
    nothing, down to a ten thousandth that is left of it."""
    rows = 40
    random = np.random.default_rng(1)
    basis = np.linalg.qr(random.standard_normal((rows, 4)))[0].T
    own, one, other, rest = basis
    left = 3.0 * one + 1.0 * other + 2.0 * rest + 5.0 * own  # 14 without what the parameter takes
    asked = [
        _Alternative("one", one[:, None] + 2.0 * own[:, None]),
        _Alternative("both", np.stack([one, one + other], axis=1)),
        _Alternative("own", -3.0 * own[:, None]),
        _Alternative("nearly own", own[:, None] + 1.5e-4 * one[:, None]),
        _Alternative("own but for rounding", own[:, None] + 5e-5 * one[:, None]),
        _Alternative("twice", other[:, None]),
        _Alternative("twice", one[:, None]),
    ]
    found = _gains(Runs(np.zeros(rows, dtype=np.int64)), own[None, :, None], left[:, None], WHITE, asked)
    price = np.log(rows)
    taken = rows * np.log(14.0 / 5.0) - price
    assert found == {
        "one": pytest.approx(taken),
        "both": pytest.approx(rows * np.log(14.0 / 4.0) - 2.0 * price),
        "own": 0.0,
        "nearly own": pytest.approx(taken, rel=1e-6),
        "own but for rounding": 0.0,
        "twice": pytest.approx(taken),
    }


def test_a_constant_misfit_is_told_on_a_column_of_the_model() -> None:
    """Where a constant does most the range is all there is, and a column that the model knows says it, though one that
    is not mapped does a little more."""
    u = np.linspace(0.0, 1.0, 400)
    case: Any = SimpleNamespace(roles={"u": u}, library={})
    adequacy = Adequacy(0.0, 9.0, {"column:u:0": 2.0, "column:q:0": 3.0, "constant::0": 5.0})
    rows = np.ones(400, dtype=bool)
    first, second = where_it_fails(case, adequacy, np.ones((1, 400)), rows, {"q": u[::-1], "u": u}, ("y",))
    assert (first.variable, first.low, first.high, first.mean_residual, first.gain) == ("u", 0.0, 1.0, 1.0, 5.0)
    assert second.variable == "q"


def test_what_is_only_driven_one_way_has_no_direction() -> None:
    """It stands, or rolls forwards: the misfit of standing rows counts as it is."""
    load, omega = np.linspace(10.0, 20.0, 400), np.tile([0.0, 3.0, 3.0, 3.0], 100)
    left = np.where(load > 15.0, np.where(omega > 0.0, 2.0, -2.0), 0.0)
    rows = np.ones(400, dtype=bool)
    case: Any = SimpleNamespace(roles={"omega": omega})
    found = failure_on(case, "load", load, left[None], 0, rows, ("current",), 7.0)
    assert not found.with_direction
    assert found.mean_residual == pytest.approx(1.0, abs=0.1)


def _noise(**changed: Any) -> Any:
    given = {
        "weights": np.zeros(len(NODES)),
        "wrong": np.zeros(2),
        "ratio": np.array([1.0, 1.0]),
        "sigma": np.array([0.2, 0.5]),
        "known": np.array([True, True]),
        "node": NODES[0],
        "carried": np.array([-1, -1]),
    }
    return SimpleNamespace(**{**given, **changed})


def _found(noise: Any, missing: bool = False, named: bool = False, odd: int = 0, stuck: int = 0) -> list[Any]:
    marks = np.arange(6)
    case = SimpleNamespace(
        run=np.array([0, 0, 1, 1, 2, 2]), run_names=("a", "b", "c"), place=lambda row: f"t:{row + 2}"
    )
    analysis: Any = SimpleNamespace(
        case=case,
        missing=missing,
        told=noise,
        model=SimpleNamespace(channels=("f", "g")),
        prediction=np.stack([np.full(6, 3.0), np.array([1.0, -1.0, 7.0, -7.0, 5.0, -5.0])]),
        odd=marks < odd,
        stuck=marks >= 6 - stuck,
    )
    return noise_findings(analysis, noise if named else None)


def test_noise_that_is_not_as_stated_is_told_with_its_factor() -> None:
    noise = _noise(wrong=np.array([0.0, 0.97]), ratio=np.array([4.0, 2.5]))
    (found,) = _found(noise)
    assert (found.kind, found.channel, found.value, found.probability, found.runs) == ("larger", "g", 2.5, 0.97, ())
    (found,) = _found(_noise(wrong=np.array([0.9, 0.0]), ratio=np.array([0.5, 1.0]), carried=np.array([0, 1])))
    assert (found.kind, found.channel, found.value, found.runs) == ("smaller", "f", 0.5, ())
    for carried, runs in (((0, 1), ("b",)), ((0, -1), ())):  # one run alone, where one makes it so
        (found,) = _found(_noise(wrong=np.array([0.0, 0.97]), ratio=np.array([1.0, 2.5]), carried=np.array(carried)))
        assert found.runs == runs
    assert _found(noise, missing=True) == []  # a misfit would pass for it
    assert [one.kind for one in _found(noise, missing=True, named=True)] == ["larger"]


@pytest.mark.parametrize(("kind", "size"), [("run_offsets", "offset"), ("run_gains", "gain"), ("drift", "drift"),
    ("walk", "walk")])  # fmt: skip
@pytest.mark.parametrize("known", [True, False])
def test_what_differs_from_run_to_run_is_told_in_the_channels_unit(kind: str, size: str, known: bool) -> None:
    """Its mean over the kinds of noise that have it; a sd that was estimated holds it already. A gain is a factor."""
    alone = [
        i for i, node in enumerate(NODES) if node.rest is None and getattr(node, size) == node.floor**2 - 1.0 == 1.0
    ] or [i for i, node in enumerate(NODES) if node.rest is None and getattr(node, size)]
    node = NODES[alone[0]]
    for weight, told in ((0.85, True), (0.75, False)):
        weights = np.zeros(len(NODES))
        weights[[alone[0], 0]] = weight, 1.0 - weight
        found = [
            one
            for one in _found(_noise(weights=weights, known=np.array([known, known]), node=node))
            if one.kind == kind
        ]
        assert [one.channel for one in found] == (["f", "g"] if told else [])
        for one, sigma, usual in zip(found, (0.2, 0.5), (3.0, 5.0), strict=False):
            assert one.probability == pytest.approx(weight)
            in_unit = getattr(node, size) * sigma / (1.0 if known else node.floor)
            assert one.value == pytest.approx(in_unit / (usual if kind == "run_gains" else 1.0))


def test_rows_that_were_left_out_are_named_for_sure() -> None:
    found = _found(_noise(), missing=True, odd=3, stuck=1)
    assert [(one.kind, one.channel, one.value, one.probability, one.rows, one.runs) for one in found] == [
        ("rows", "", 3.0, 1.0, ("t:2", "t:3", "t:4"), ("a", "b")),
        ("stuck", "", 1.0, 1.0, ("t:7",), ("c",)),
    ]


def test_a_model_without_numbers_at_its_start_values_says_so(tmp_path: Path) -> None:
    rows = [(i // 10, 1.0 + i, 0.0, np.log(1.0 + i)) for i in range(40)]
    folder = _case(tmp_path, "log(a*x)", "a = { value = -1.0 }", rows, 0.1)
    with pytest.raises(UserError, match=r"runs\.csv:2: .*at the start values"):
        analyse(load_case(folder))


@pytest.mark.parametrize("stated", [True, False])
def test_the_sd_of_a_mean_of_runs_that_differ_is_that_of_their_means(tmp_path: Path, stated: bool) -> None:
    """Whether the noise of a row is stated or found: the offset of a run is counted once."""
    random = np.random.default_rng(7)
    offset = random.standard_normal(24)
    rows = [(run, i, 0.0, 5.0 + offset[run] + 0.1 * random.standard_normal()) for run in range(24) for i in range(12)]
    found = analyse(load_case(_case(tmp_path, "a", "a = { value = 1.0 }", rows, 0.1 if stated else None)))
    trained = np.unique(found.case.run[found.case.train])
    means = np.array([np.mean([row[3] for row in rows if row[0] == run]) for run in trained])
    assert found.sd[0] == pytest.approx(np.std(means, ddof=1) / np.sqrt(len(means)), rel=0.35)


def test_parameters_that_are_known_well_are_told_apart_however_alike_their_columns(tmp_path: Path) -> None:
    """To a tenth: their columns differ by less than a hundredth, and the noise is small enough for that."""
    random = np.random.default_rng(3)
    x = random.uniform(1.0, 5.0, 100)
    z = x + 0.02 * random.standard_normal(100)
    y = x + z + 0.02 * random.standard_normal(100)
    rows = list(zip(np.arange(100) // 10, x, z, y, strict=True))
    fit = "a = { value = 0.9 }\nb = { value = 1.1 }"
    found = analyse(load_case(_case(tmp_path, "a*x + b*z", fit, rows, 0.02)))
    assert found.sd == pytest.approx([0.1, 0.1], rel=0.5)
    assert together.together(found) == []


def test_groups_may_lie_between_each_other() -> None:
    lost = np.array([[0.7, 0.0], [0.0, 0.0], [0.0, 0.6], [0.7, 0.0], [0.0, 0.8], [0.02, 0.01]])
    assert together._groups(lost) == [[0, 3], [2, 4]]
    assert together._groups(np.array([[0.0], [1.0], [0.0]])) == []  # one alone


@pytest.mark.parametrize("sd", [np.inf, np.nan, 0.0])
@pytest.mark.parametrize(("bound", "end"), [(np.inf, (None, "open")), (4.0, (4.0, "bound"))])
def test_a_parameter_that_nothing_determines_has_an_open_interval(
    sd: float, bound: float, end: tuple[float | None, str]
) -> None:
    one = SimpleNamespace(whole=False)
    model = SimpleNamespace(lower=np.array([-bound]), upper=np.array([bound]), fitted=[one])
    analysis: Any = SimpleNamespace(
        sd=np.array([sd]), fit=SimpleNamespace(model=model, theta=np.array([1.0]), cost=0.0)
    )

    def refit(start: Any, free: Any) -> Any:
        raise AssertionError("there is nothing to look for")

    assert _side(analysis, refit, 0, 1.0, 1.0) == end


def test_every_alternative_has_its_share_of_its_family() -> None:
    """An effect's shapes share its own, a column's stand in each channel; each column of a mishap is one."""
    runs = Runs(np.zeros(5, dtype=np.int64), 2)
    random = np.random.default_rng(8)

    def shape() -> Any:
        return SimpleNamespace(columns=random.standard_normal((10, 1)))

    effects = {"drag": [shape(), shape()], "none": [], "gear": [shape()]}
    together_, singly = random.standard_normal((3, 5)), random.standard_normal((2, 5))
    shapes = {"": Shapes(np.zeros((0, 5)), singly[:1]), "load": Shapes(together_, singly)}
    varying = [random.standard_normal((10, 1)) for _ in range(4)]
    wrong = [Mishap("run", one, random.standard_normal((10, 4))) for one in range(3)]
    wrong += [Mishap("slope", 1, random.standard_normal((10, 1)))]
    found = blocks_of(effects, shapes, runs, varying, wrong)
    of = {family: [one for one in found if one.family == family] for family in {one.family for one in found}}
    assert {family: len(blocks) for family, blocks in of.items()} == {
        "catalogue": 3, "column": 2 * (1 + 3), "varying": 4, "run": 12, "slope": 1
    }  # fmt: skip
    for blocks in of.values():
        assert sum(one.share for one in blocks) == pytest.approx(1.0)
    assert [one.share for one in of["catalogue"]] == [0.25, 0.25, 0.5]
    assert [one.share for one in of["column"]] == pytest.approx([0.25] * 2 + [1.0 / 12.0] * 6)
    first, second = of["column"][2], of["column"][5]
    np.testing.assert_allclose(first.columns, np.concatenate([together_.T, np.zeros((5, 3))]))
    np.testing.assert_allclose(second.columns, np.concatenate([np.zeros((5, 3)), together_.T]))
    np.testing.assert_allclose(of["run"][5].columns, wrong[1].columns[:, 1:2])


def test_noise_is_simulated_of_each_kind_as_often_as_it_is_likely() -> None:
    runs = Runs(np.repeat(np.arange(10), 4))
    offsets = next(i for i, node in enumerate(NODES) if node.offset == 2.0 and not node.share)
    drawn = _simulated(runs, [0, offsets], np.array([0.75, 0.25]), np.random.default_rng(1))
    assert drawn.shape == (40, 400)
    within = drawn.reshape(10, 4, 400).mean(axis=1).std(axis=0)
    assert (within > 1.0).sum() == pytest.approx(100, abs=5)
    assert drawn[:, within < 1.0].std() == pytest.approx(1.0, abs=0.03)


def test_a_role_gains_by_the_effects_that_need_it() -> None:
    """Less what their number of shapes would find by chance; of roles of which one must be there, the first that is."""
    order = Parameter("n", "1", 1.0, grid=(1.0, 2.0, 3.0, 4.0))
    library = {
        "wave": Effect("wave", "", "", "", (), (Parameter("a", "N", 0.0), order), (("angle", "position"),), "a", "y"),
        "drag": Effect("drag", "", "", "", (), (Parameter("c", "N", 0.0),), (("speed",), ("position",)), "c", "y"),
        "off": Effect("off", "", "", "", (), (Parameter("d", "N", 0.0),), (), "d", "y"),
    }  # fmt: skip
    case: Any = SimpleNamespace(library=library, roles={"position": 0, "speed": 0})
    gain = {"effect:wave": 10.0, "effect:drag": 6.0, "effect:off": 50.0, "effect:y: x**2": 70.0, "column:load:0": 80.0}
    found = _by_effect(case, Adequacy(0.0, 9.0, gain))
    assert found == {"position": pytest.approx(10.0 - 2.0 * np.log(4.0)), "speed": 6.0}


def test_groups_that_differ_are_told_by_walds_test(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three groups with sds of their own that are twice what the covariance says, for something is missing."""
    own = SimpleNamespace(by="", name="k", group="", unit="N")
    fitted = [own, *(SimpleNamespace(by="soil", name="f", group=one, unit="1") for one in ("sand", "loam", "clay"))]
    matrix = np.diag([9.0, 1.0, 4.0, 1.0])
    monkeypatch.setattr(groups, "covariance", lambda fit, run, node: (matrix, None))
    fit = SimpleNamespace(theta=np.array([7.0, 1.0, 3.0, 5.0]), model=SimpleNamespace(fitted=fitted))
    case = SimpleNamespace(run=np.zeros(4), train=np.ones(4, dtype=bool), by={"f": "soil"})
    analysis: Any = SimpleNamespace(
        fit=fit, case=case, noise=SimpleNamespace(node=WHITE), sd=np.array([6.0, 2.0, 4.0, 2.0])
    )
    (found,) = groups.differences(analysis)
    assert (found.parameter, found.by, found.unit) == ("f", "soil", "1")
    assert found.values == {"sand": 1.0, "loam": 3.0, "clay": 5.0}
    assert found.sds == {"sand": 2.0, "loam": 4.0, "clay": 2.0}
    variance = np.array([4.0, 16.0, 4.0])
    mean = (found_ := np.array([1.0, 3.0, 5.0])) @ (1.0 / variance) / (1.0 / variance).sum()
    assert found.p_value == pytest.approx(chi2.sf((((found_ - mean) ** 2) / variance).sum(), 2))


@pytest.mark.parametrize(
    ("lower", "upper", "convex", "count"),
    [((1.0, -1.0), (100.0, 1.0), False, 3), ((1.0, -1.0), (np.inf, 1.0), False, 1),
     ((1.0, -1.0), (100.0, 1.0), True, 1), ((), (), False, 1)],
)  # fmt: skip
def test_further_starts_lie_inside_the_bounds(
    lower: tuple[float, ...], upper: tuple[float, ...], convex: bool, count: int
) -> None:
    """By its logarithm where a bound is many times the other; only where all are bounded, and more than one can be."""
    low, high = np.array(lower), np.array(upper)
    base = SimpleNamespace(convex=convex, whole_runs=False)
    start = np.array([2.0, 0.0][: len(low)])
    model = SimpleNamespace(start=start, lower=low, upper=high, case=SimpleNamespace(base=base))
    bound: Any = SimpleNamespace(model=model, predict=lambda theta: np.zeros((1, 3)))
    found = _base_starts(bound, 3)
    assert len(found) == count
    np.testing.assert_array_equal(found[0], start)
    for one in found[1:]:
        assert 10.0**0.2 < one[0] < 10.0**1.8
        assert -0.8 < one[1] < 0.8
    if count > 1:
        many = np.array([one for seed in range(200) for one in _base_starts(bound, seed)[1:]])
        assert np.median(np.log10(many[:, 0])) == pytest.approx(1.0, abs=0.1)
        assert np.median(many[:, 1]) == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(("good", "count"), [("none", 3), ("start", 3), ("drawn", 4)])
def test_a_motion_that_no_start_carries_is_looked_for_once_more(good: str, count: int) -> None:
    """One start more, that gives numbers, where none of the three does and any of twenty more does."""
    seen: list[float] = []

    def predict(theta: Array) -> Array:
        seen.append(theta[0])
        carried = {"none": False, "start": theta[0] == 2.0, "drawn": len(set(seen)) > 5}[good]
        return np.full((1, 3), 1.0 if carried else np.nan)

    base = SimpleNamespace(convex=False, whole_runs=True)
    model = SimpleNamespace(
        start=np.array([2.0]), lower=np.array([1.0]), upper=np.array([100.0]), case=SimpleNamespace(base=base)
    )
    bound: Any = SimpleNamespace(model=model, predict=predict)
    found = _base_starts(bound, 3)
    assert len(found) == count
    assert len(set(seen)) == {"none": 23, "start": 1, "drawn": 6}[good]


def test_a_formula_that_divides_by_a_start_of_0_begins_elsewhere() -> None:
    """At each power of ten from 0.001 to 1000 that its bounds allow and that gives numbers; what is not 0 stays."""
    base = SimpleNamespace(convex=True, whole_runs=False)
    model = SimpleNamespace(
        start=np.array([0.0, 5.0]), lower=np.full(2, -np.inf), upper=np.array([100.0, np.inf]),
        case=SimpleNamespace(base=base),
    )  # fmt: skip
    bound: Any = SimpleNamespace(model=model, predict=lambda theta: np.array([[theta[1] / theta[0]]]))
    found = np.array(_base_starts(bound, 3))
    np.testing.assert_allclose(found[:, 0], [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 100.0])
    assert (found[:, 1] == 5.0).all()
    bound.predict = lambda theta: np.array([[np.nan]])
    (alone,) = _base_starts(bound, 3)
    np.testing.assert_array_equal(alone, model.start)


def test_a_channel_that_sticks_most_of_the_time_is_looked_at_as_it_is() -> None:
    values = np.random.default_rng(4).standard_normal(100)
    values[[0, 1]] = -9.0, 9.0
    stuck = values.copy()
    stuck[30:40] = stuck[30]
    base = SimpleNamespace(channels=("f", "g", "absent"))
    train = np.ones(100, dtype=bool)
    train[60:] = False
    case: Any = SimpleNamespace(
        base=base, channels={"f": values, "g": stuck}, run=np.zeros(100, dtype=int), train=train
    )
    assert np.flatnonzero(comparison._stuck(case)).tolist() == list(range(31, 40))
    train[:] = False
    train[29:46] = True  # 9 of 17 that are trained on
    assert not comparison._stuck(case).any()
    train[46:49] = True
    assert comparison._stuck(case).sum() == 9


def test_what_a_sensor_s_noise_leaves_open_is_left_out_where_that_is_rare() -> None:
    """Rows whose prediction it moves by more than ten sds of the channel, in any channel, by any input."""
    moved = np.zeros((2, 40, 2))
    moved[0, 3, 1], moved[1, 7, 0], moved[0, 9, 0], moved[1, 11, 0] = -2.1, 10.1, 1.9, 9.9
    sigma = np.array([0.2, 1.0])
    assert np.flatnonzero(undecided(moved, sigma, 0.05)).tolist() == [3, 7]
    assert not undecided(moved, sigma, 0.049).any()
    assert not undecided(np.zeros((2, 40, 0)), sigma, 0.05).any()


def test_an_instrument_that_lags_takes_something_off_in_most_runs() -> None:
    """What the parameters can take is no reason to say so, nor is what one run alone asks for."""
    random = np.random.default_rng(5)
    run = np.repeat(np.arange(6), 20)
    late, slope = random.standard_normal(120), random.standard_normal(120)
    mishap: Any = SimpleNamespace(columns=late[:, None])
    slopes = slope[None, :, None]
    noise = 0.1 * random.standard_normal(120)
    assert comparison._lags(run, (late + noise + 3.0 * run)[None], slopes, mishap)
    assert comparison._lags(run, (late + noise + 5.0 * slope)[None], slopes, mishap)
    alone = np.where(run == 2, 5.0 * late, 0.0) + noise
    assert not comparison._lags(run, alone[None], slopes, mishap)
    # of two channels each has a column
    both: Any = SimpleNamespace(columns=np.kron(np.eye(2), late[:, None]))
    two = np.concatenate([slopes, 0.0 * slopes])
    assert comparison._lags(run, np.stack([noise, late + noise]), two, both)
    assert not comparison._lags(run, np.stack([noise, alone]), two, both)


@pytest.mark.parametrize("holds", [True, False])
def test_a_model_without_numbers_at_a_run_s_mean_says_nothing_of_its_scatter(holds: bool) -> None:
    """The prediction with an input as it was read less that with what the run held; none where a row has no number."""
    run = np.repeat(np.arange(4), 20)
    random = np.random.default_rng(6)
    speed = np.array([2.0, 3.0, 4.0, 5.0])[run] + 0.1 * random.standard_normal(80)

    def predict(inputs: dict[str, Array]) -> Array:
        found = inputs["speed"] ** 2
        constant = np.isin(run, [1]) & (np.ptp(inputs["speed"][run == 1]) < 1e-9)
        return np.where(constant & (not holds), np.nan, found)[None]

    case = SimpleNamespace(inputs={"speed": speed, "load": np.ones(80)}, run=run)
    model = SimpleNamespace(case=case)
    model.bind = lambda inputs, rows: SimpleNamespace(predict=lambda theta: predict(inputs))
    fit: Any = SimpleNamespace(model=model, theta=np.zeros(1))
    rows = np.ones(80, dtype=bool)
    assert _column(fit, "load", rows) is None  # held still, and measured so
    found = _column(fit, "speed", rows)
    if not holds:
        assert found is None
        return
    assert found is not None
    means = np.array([speed[run == one].mean() for one in range(4)])
    np.testing.assert_allclose(found[0], speed**2 - means[run] ** 2)
    case.inputs["speed"] = np.sort(speed)  # it went on rising: the setting moved
    assert _column(fit, "speed", rows) is None


def test_a_misfit_of_rounding_has_no_scale_of_its_own() -> None:
    """A stated sd says nothing of one that is larger, however small: the p-value is the same at any size; below a
    hundredth of the sd it is that of nothing."""
    random = np.random.default_rng(3)
    x = np.linspace(-1.0, 1.0, 80)
    unit = random.standard_normal(80) + 0.5 * np.sign(x)
    unit /= np.sqrt(np.mean(unit**2))
    run = np.arange(80) // 8
    case: Any = SimpleNamespace(run=run)
    noise: Any = SimpleNamespace(
        sigma=np.array([2.0]), known=np.array([True]), behind=STATED, kinds=[0, 2], node=NODES[0]
    )
    rows = np.ones(80, dtype=bool)
    shapes = {"x": Shapes(np.stack([x, x**2]), np.stack([x]))}

    def found(size: float) -> float:
        residual = 2.0 * size * unit[None]
        return assess(case, residual, np.ones((1, 80, 1)), np.ones((1, 80)), noise, [], {}, shapes, rows).p_value

    assert found(3.0) == found(1.0) == found(0.0101) < 0.5
    assert found(0.0099) > 2.0 * found(1.0)


def test_where_no_sd_is_stated_it_is_found_twice_and_the_fit_made_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """From a twentieth of the measurements' rms on; where all are stated there is one fit, with these."""
    seen: list[float] = []

    def fitted(case: Any, effects: Any, train: Any, sigma: Array, seed: int, near: Any) -> list[str]:
        seen.append(float(sigma[0]))
        return [f"fit with {sigma[0]:g}"]

    def noise_of(case: Any, fit: Any, sigma: Array, given: Any, least: Array) -> Any:
        return SimpleNamespace(sigma=sigma / 10.0), np.zeros(1), ["direction"]

    model: Any = SimpleNamespace(channels=("f",), bind=lambda inputs, rows: None)
    monkeypatch.setattr(comparison.Model, "of", lambda case: model)
    monkeypatch.setattr(comparison, "_base_starts", lambda bound, seed: [np.zeros(1)])
    monkeypatch.setattr(comparison, "_gives_numbers", lambda bound, start: True)
    monkeypatch.setattr(comparison, "fitted_on", fitted)
    monkeypatch.setattr(comparison, "_noise_of", noise_of)
    base = SimpleNamespace(whole_runs=False, own_dynamics=None)
    values = np.array([3.0, -3.0, 3.0, -3.0])
    case: Any = SimpleNamespace(
        train=np.ones(4, dtype=bool), test=np.zeros(4, dtype=bool), sigma={"f": None}, base=base, effects=(), inputs={},
        channels={"f": values},
    )  # fmt: skip
    model.case = case
    fits, noise, _, directions = comparison._fitted(case, 0)
    assert seen == pytest.approx([0.15, 0.015, 0.0015])
    assert noise.sigma[0] == pytest.approx(0.0015)
    assert fits == ["fit with 0.0015"]
    assert directions is None  # those were around the fit before
    seen.clear()
    case.sigma["f"] = 0.7
    fits, noise, _, directions = comparison._fitted(case, 0)
    assert seen == [0.7]
    assert noise.sigma[0] == pytest.approx(0.07)
    assert (fits, directions) == (["fit with 0.7"], ["direction"])


@pytest.mark.parametrize(("each", "left_out"), [((2, 2, 2), 4), ((5, 1), 5), ((3, 3), 3), ((2, 0, 2), 2), ((0,), 0)])
def test_rows_that_stand_alone_are_left_out_up_to_a_twentieth(
    monkeypatch: pytest.MonkeyPatch, each: tuple[int, ...], left_out: int
) -> None:
    """Of 100 rows five together, whenever they were found; after each the fit is made anew without them."""

    @dataclass(frozen=True)
    class Rows:
        train: Mask
        test: Mask
        run: Array
        rows: int = 100
        base: Any = None

    class Stop(Exception):
        pass

    left: list[int] = []  # rows of each fit

    def fitted(case: Rows, seed: int) -> Any:
        odd = np.zeros(int((case.train | case.test).sum()), dtype=bool)
        odd[7 : 7 + (each[len(left)] if len(left) < len(each) else 0)] = True
        left.append(len(odd))
        return [SimpleNamespace(model=None)], SimpleNamespace(odd=odd, sigma=np.ones(1)), np.zeros(1), []

    def looked_at(case: Rows, rows: Mask) -> Any:
        left.append(int(rows.sum()))
        raise Stop

    monkeypatch.setattr(comparison, "_fitted", fitted)
    monkeypatch.setattr(comparison, "free_slopes", lambda fit, sigma, rows: (None, np.zeros((1, rows.sum())), None))
    monkeypatch.setattr(comparison, "numeric_columns", lambda case: {})
    monkeypatch.setattr(comparison, "gathered", lambda *_: False)
    monkeypatch.setattr(comparison, "column_shapes", looked_at)
    case: Any = Rows(np.arange(100) < 60, np.arange(100) >= 60, np.zeros(100))
    with pytest.raises(Stop):
        comparison._analysed(case, 0, 0.01, 1, fitted(case, 0), case.test)
    assert left[-1] == 100 - left_out


def test_rows_that_stand_have_no_direction() -> None:
    """A misfit that turns round with the motion is taken in its direction: of what stands nothing."""
    load, omega = np.linspace(10.0, 20.0, 300), np.tile([-3.0, 0.0, 3.0], 100)
    left = np.where(load > 15.0, 2.0 * np.sign(omega) + (omega == 0.0), 0.0)
    case: Any = SimpleNamespace(roles={"omega": omega})
    found = failure_on(case, "load", load, left[None], 0, np.ones(300, dtype=bool), ("current",), 7.0)
    assert found.with_direction
    assert found.mean_residual == pytest.approx(4.0 / 3.0, abs=0.05)


@pytest.mark.parametrize(("rows", "high"), [(19, 1.0), (20, 0.0)])
def test_a_stretch_has_a_twentieth_of_the_rows_at_least(rows: int, high: float) -> None:
    """Levels of a plan stay whole: to one that is too small the next one is taken."""
    u = np.repeat([0.0, 1.0, 2.0], [rows, 30, 370 - rows])
    left = np.where(u == 0.0, 5.0, 0.0)[None]
    found = failure_on(SimpleNamespace(roles={}), "u", u, left, 0, np.ones(400, dtype=bool), ("f",), 1.0)  # type: ignore[arg-type]
    assert (found.low, found.high) == (0.0, high)


def test_noise_far_above_its_stated_sd_is_told_of_channels_that_state_one() -> None:
    noise = SimpleNamespace(
        known=np.array([True, False, True, True]), ratio=np.array([FAR, 9.0 * FAR, 1.01 * FAR, 1.0])
    )
    analysis: Any = SimpleNamespace(model=SimpleNamespace(channels=("f", "g", "h", "i")), noise=noise)
    assert far_above_stated(analysis) == ("h",)
