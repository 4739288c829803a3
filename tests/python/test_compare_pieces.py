"""Pieces of compare, on numbers that are worked out by hand: gains of columns, findings of noise, sds,
parameters that are tied."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare import together
from terrapin_tools.workbench.compare.adequacy import Adequacy, _Alternative, _gains, failure_on, where_it_fails
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.compare.intervals import _side
from terrapin_tools.workbench.compare.noise_findings import noise_findings
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import NODES, Node

WHITE = Node(0.0, 0.0, 0.0, 0.0, 1.0)
CASE = """[model]
base = "equation"
[model.equation]
y = "{formula}"
[fit]
{fit}
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
x = {{ column = "x" }}
z = {{ column = "z" }}
y = {{ column = "y"{sigma} }}
"""


def _case(folder: Path, formula: str, fit: str, rows: Iterable[tuple[float, ...]], sigma: float | None = None) -> Path:
    """A case of y over x and z, rows of run, x, z, y."""
    stated = "" if sigma is None else f", sigma = {sigma}"
    (folder / "case.toml").write_text(CASE.format(formula=formula, fit=fit, sigma=stated))
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
    assert (found.kind, found.channel, found.value, found.probability) == ("larger", "g", 2.5, 0.97)
    (found,) = _found(_noise(wrong=np.array([0.9, 0.0]), ratio=np.array([0.5, 1.0])))
    assert (found.kind, found.channel, found.value) == ("smaller", "f", 0.5)
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
