"""The noise of rigs: its algebra against dense matrices, odd rows, noisy inputs, a stated sd that is off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from casekit import dense, rolling
from scipy.linalg import block_diag

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.noise.covariance import Runs, orthonormal
from terrapin_tools.workbench.noise.estimate import Noise
from terrapin_tools.workbench.noise.kinds import ALIKE, ALL, NODES, PLAIN, Kind, Node, by_filter, considered
from terrapin_tools.workbench.noise.marginal_likelihood import LIKELY, STATED, Evidence
from terrapin_tools.workbench.noise.odd import odd_rows
from terrapin_tools.workbench.noise.precision import Precision
from terrapin_tools.workbench.noise.stated import SURE, Given, followed
from terrapin_tools.workbench.noise.stuck import clipped_rows, stuck_rows
from terrapin_tools.workbench.story.answer import answer
from terrapin_tools.workbench.story.told import told
from tests.campaigns import calibration, two_channels

LEVEL = np.random.default_rng(4).uniform(0.5, 3.0, (2, 98))  # what a model predicts, on two channels
WHITE = Node(0.0, 0.0, 0.0, 0.0, 1.0)


def scattered() -> Runs:
    """Two channels, runs of 12, 7, 1, 60 and a few rows, their rows mixed."""
    run = np.random.default_rng(0).permutation(np.repeat([2, 0, 1, 3, 7, 6, 4, 5], [12, 7, 1, 60, 2, 3, 5, 8]))
    return Runs(run, 2, LEVEL)


KINDS = NODES[: considered(2)]


@pytest.mark.parametrize(
    ("node", "whole"), [*((n, False) for n in KINDS), *((n, True) for n in KINDS if n.only == 1)], ids=str
)
def test_products_are_those_of_dense_covariances(node: Node, whole: bool) -> None:
    runs = scattered()
    runs.whole = np.array([whole, whole])
    random = np.random.default_rng(1)
    x, y = random.standard_normal((2 * runs.rows, 3)), random.standard_normal((2 * runs.rows, 2))
    each = [dense(Runs(runs.run, level=one[None]), node.of(channel)) for channel, one in enumerate(LEVEL)]
    if whole:  # the sd that is known is that of whole runs
        each = [one / node.of(channel).floor ** 2 for channel, one in enumerate(each)]
    covariance = block_diag(*each)
    expected = x.T @ np.linalg.solve(covariance, y)
    fx, fy = runs.filtered(x, node.filter), runs.filtered(y, node.filter)
    assert runs.products(fx, fy).at(node) == pytest.approx(expected, abs=1e-7)
    assert runs.whiten(x, node).T @ runs.whiten(y, node) == pytest.approx(expected, abs=1e-7)
    squares = np.diagonal(x.T @ np.linalg.solve(covariance, x))
    assert runs.squares(fx, (node,))[0] == pytest.approx(squares, rel=1e-9)
    assert runs.log_determinant(node) == pytest.approx(np.linalg.slogdet(covariance)[1], abs=1e-7)
    ordered = runs.sort(x)
    assert ordered.T @ runs.times(ordered, node) == pytest.approx(x.T @ covariance @ x, rel=1e-9)


@pytest.mark.parametrize("most", [1, 2**21])
@pytest.mark.parametrize("kind", list(by_filter(range(considered(2)))), ids=str)
def test_several_kinds_of_noise_at_once_are_each_alone(kind: Kind, most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """However few of them fit into memory together."""
    monkeypatch.setattr("terrapin_tools.workbench.noise.covariance.MOST", most)
    runs = scattered()
    random = np.random.default_rng(1)
    x, y = (runs.filtered(random.standard_normal((2 * runs.rows, count)), kind) for count in (3, 2))
    nodes = [node for node in NODES if node.filter == kind]
    together, squares = runs.products(x, y).each(nodes), runs.squares(x, nodes)
    assert together.shape == (len(nodes), 3, 2)
    for node, products, square in zip(nodes, together, squares, strict=True):
        assert runs.products(x, y).at(node) == pytest.approx(products, rel=1e-12)
        assert np.diagonal(runs.products(x, x).at(node)) == pytest.approx(square, rel=1e-12)


def test_a_factor_on_a_run_of_few_rows_is_noise_of_its_rows() -> None:
    runs, level = np.repeat(np.arange(4), [1, 2, 3, 9]), np.ones((1, 15))
    assert np.array_equal(Runs(runs, level=level).level[0], np.repeat([0.0, 1.0], [3, 12]))


def test_what_is_drawn_has_the_covariance() -> None:
    run, level = np.repeat(np.arange(8)[::-1], [6, 4, 1, 2, 1, 1, 3, 2]), np.linspace(-1.0, 2.0, 20)[None]
    runs, node = Runs(run, level=level), Node(0.5, 0.8, 0.7, 0.5, 1.0, 0.8, 0.9, 0.4)
    drawn = runs.draw(np.random.default_rng(2), 200_000, node)
    assert drawn @ drawn.T / 200_000 == pytest.approx(dense(runs, node), abs=0.06)


@pytest.mark.parametrize("whole", [False, True])
def test_unlike_noise_is_drawn_in_each_channel(whole: bool) -> None:
    run = np.repeat(np.arange(4)[::-1], [4, 2, 1, 3])
    runs, node = (
        Runs(run, 2, whole=np.array([whole, whole])),
        Node(0.5, 0.8, 0.7, 0.5, 1.0, only=1, rest=Node(0.0, 0.0, 1.0, 0.0, 1.0)),
    )
    drawn = runs.draw(np.random.default_rng(2), 200_000, node)
    each = [dense(Runs(run), one) / (one.floor**2 if whole else 1.0) for one in (node.of(0), node.of(1))]
    assert drawn @ drawn.T / 200_000 == pytest.approx(block_diag(*each), abs=0.04)


@pytest.mark.parametrize("number", [11, 32, 52])
def test_unlike_noise_of_two_channels_is_no_effect(number: int) -> None:
    """Offsets of runs in one channel, rows that are alike or white noise in the other; stated or not."""
    case, kinds = two_channels.drawn(number, 20)
    assert "offsets" in kinds
    found = analyse(case, seed=number)
    assert not found.missing
    assert found.noise.node.rest is not None


def test_noise_of_one_channel_in_words() -> None:
    node = Node(0.0, 0.0, 1.0, 0.0, 1.0, only=1, rest=WHITE)
    assert node.words(("current", "voltage")) == "white + run offsets in voltage, white elsewhere"


def test_a_drift_has_unit_size_in_each_run() -> None:
    """So that its sd is that of a row, however long a run is; in a run of one row there is none."""
    runs = scattered()
    for number in np.unique(runs.run):
        line = runs.line[runs.run == number]
        if len(line) == 1:
            assert line.tolist() == [0.0]
            continue
        assert line.mean() == pytest.approx(0.0, abs=1e-12)
        assert np.mean(line**2) == pytest.approx(1.0)
        np.testing.assert_allclose(np.diff(line), line[1] - line[0])
        assert line[1] > line[0]


@pytest.mark.parametrize("behind", [0.0, STATED])
def test_the_likeliest_noise_has_its_sd_and_few_kinds_go_with_it(behind: float) -> None:
    """White noise of 1.3 sd: with a sd of 1 stated, by STATED degrees of freedom, a mean of the two."""
    run = np.repeat(np.arange(10), 40)
    residual = 1.3 * np.random.default_rng(6).standard_normal((1, 400))
    evidence = Evidence(Runs(run), residual, np.ones((1, 400, 1)), behind)
    node, sd = evidence.likeliest()
    assert replace(node, prior=1.0) == WHITE
    square = float(((residual - residual.mean()) ** 2).sum())
    assert sd == pytest.approx(np.sqrt((behind + square) / (behind + 399.0)), rel=1e-6)
    among = set(evidence.among(np.zeros((400, 0))))
    likely = {evidence.nodes[i] for i in np.flatnonzero(evidence.posterior > LIKELY)}
    assert among == likely | set(PLAIN)
    assert len(among) < len(evidence.nodes)


def test_how_surely_a_stated_sd_is_off_is_told_of_that_channel_alone() -> None:
    """Rows of 1.35 times the sd that is stated, by 60 degrees of freedom, are not sure: they are nearly so."""
    stated = Noise(
        np.ones(2), np.array([True, True]), WHITE, "as given", np.full(2, np.inf), None,
        ratio=np.array([1.35, 1.0]), ratio_freedom=60.0,
    )  # fmt: skip
    asked: list[Given] = []

    def again(given: Given) -> Noise:
        asked.append(given)
        return replace(stated, sigma=np.array([1.35, 1.0]), known=np.array([False, given[1] is not None]))

    found = followed(stated, [1.0, 1.0], again)
    assert asked == [[None, None], [None, 1.0]]
    assert SURE < found.wrong[0] < 0.9999
    assert found.wrong[1] == 0.0
    assert found.ratio.tolist() == [1.35, 1.0]


def test_priors_of_the_kinds_of_noise_add_up() -> None:
    assert sum(node.prior for node in ALIKE) == pytest.approx(1.0)
    assert len(set(NODES)) == len(NODES)
    assert considered(1) == len(ALIKE)  # a channel alone is unlike none
    assert {node.only for node in NODES[: considered(3)]} == {ALL, 0, 1, 2}


def test_pairs_in_closed_form_are_blocks_of_two() -> None:
    random = np.random.default_rng(1)
    runs = Runs(np.repeat(np.arange(8), 12))
    columns, base = random.standard_normal((96, 6)), random.standard_normal((1, 96, 2))
    evidence = Evidence(runs, random.standard_normal((1, 96)) + columns[:, 1], base, STATED)
    gram = evidence.gram(columns)
    first, second = np.triu_indices(6, 1)
    signs = random.integers(-1, 2, (len(first), 2)).astype(float)
    expected = evidence.blocks(gram, np.stack([first, second], axis=1), signs)
    assert evidence.pairs(gram, first, second, signs) == pytest.approx(expected, abs=1e-8)


def test_a_glitch_stands_alone_and_an_effect_does_not() -> None:
    random = np.random.default_rng(3)
    run = np.repeat(np.arange(10), 14)
    runs, basis = Runs(run), np.ones((140, 1)) / np.sqrt(140.0)
    slow = 3.0 * np.sin(np.tile(np.arange(14) / 4.0, 10))
    node = Node(1.0, 0.8, 0.0, 0.0, 1.0)
    plain = random.standard_normal(140)
    assert not odd_rows(runs, slow + plain, basis, node, 1.0).any()
    glitch = slow + plain
    glitch[[30, 77]] += [12.0, -9.0]
    assert set(np.flatnonzero(odd_rows(runs, glitch, basis, node, 1.0))) == {30, 77}
    assert set(np.flatnonzero(odd_rows(runs, glitch, basis, node, None))) == {30, 77}
    assert odd_rows(runs, 20.0 * (random.random(140) < 0.5) + plain, basis, WHITE, 1.0).sum() <= 7  # never many


def test_a_speed_whose_noise_turns_it_round_is_no_effect(tmp_path: Path) -> None:
    """Noise of 3 % of the range on slow runs: the sign of a measured speed is that of its noise, not of the motion."""
    made = load_case(rolling(tmp_path / "case", 11, runs=14))
    random = np.random.default_rng(12)
    slow = np.where(made.run == 2, 0.9, np.where(made.run == 5, -0.9, made.roles["omega"]))
    model = Model.of(made)
    still = replace(made, roles={**made.roles, "omega": slow})
    current = model.bind(_inputs(still)).predict(model.start)[0] + 0.004 * random.standard_normal(made.rows)
    noisy = slow + 0.5 * random.standard_normal(made.rows)
    turned = (np.sign(noisy) != np.sign(slow)) & np.isin(made.run, (2, 5))
    assert 0 < turned.sum() <= 0.05 * made.rows
    found = analyse(replace(still, roles={**made.roles, "omega": noisy}, channels={"current": current}))
    assert not found.missing
    assert found.odd[turned].all()


def _inputs(case: Case) -> Mapping[str, Array]:
    return {**case.inputs, "omega": case.roles["omega"]}


def test_odd_rows_are_left_out_and_said(tmp_path: Path) -> None:
    case = load_case(rolling(tmp_path / "case", 5, runs=12))
    spoilt = dict(case.channels)
    spoilt["current"] = case.channels["current"].copy()
    spoilt["current"][[20, 71]] += 0.004 * np.array([14.0, -11.0])
    found = analyse(replace(case, channels=spoilt))
    assert set(np.flatnonzero(found.odd)) == {20, 71}
    assert not found.missing
    assert not (found.case.train | found.case.test)[[20, 71]].any()


def test_an_offset_from_run_to_run_is_no_effect(tmp_path: Path) -> None:
    """Twelve of twenty such sets raised an alarm when rows counted as independent."""
    alarms = 0
    for seed in range(12):
        case = load_case(rolling(tmp_path / str(seed), 100 + seed, runs=14))
        offset = 0.004 * np.random.default_rng(seed).standard_normal(14)
        alarms += analyse(replace(case, channels={"current": case.channels["current"] + offset[case.run]})).missing
    assert alarms <= 2


def test_a_stated_sd_that_is_too_small_hides_no_effect(tmp_path: Path) -> None:
    case = load_case(rolling(tmp_path / "case", 7, runs=14, heating=0.002))
    found = discover(replace(case, sigma={"current": 0.004 / 1.4}))
    assert (found.verdict, found.missing) == ("missing", ("motor_heating",))
    quiet = load_case(rolling(tmp_path / "quiet", 8, runs=14))
    assert not analyse(replace(quiet, sigma={"current": 0.002})).missing


@pytest.mark.parametrize("times", [8.0, 20.0])
def test_offsets_of_runs_that_are_mounted_anew_are_no_effect(tmp_path: Path, times: float) -> None:
    """Of many sd of a row: all such sets raised an alarm, and some were one odd run at 0.99."""
    alarms = 0
    for seed in range(4):
        case = load_case(rolling(tmp_path / str(seed), 100 + seed, runs=14))
        offsets = times * np.std(analyse(case).residual) * np.random.default_rng(seed).standard_normal(14)
        found = analyse(replace(case, channels={"current": case.channels["current"] + offsets[case.run]}))
        alarms += found.missing
    assert alarms <= 1


def test_a_factor_from_run_to_run_is_no_effect(tmp_path: Path) -> None:
    """Before the noise knew of factors, three in four such sets raised an alarm."""
    alarms, told_so = 0, 0
    for seed in range(24):
        case = load_case(rolling(tmp_path / str(seed), 100 + seed, runs=14))
        factor = 1.0 + 0.04 * np.random.default_rng(seed).standard_normal(14)
        found = analyse(replace(case, channels={"current": case.channels["current"] * factor[case.run]}))
        alarms += found.missing
        told_so += "run_gains" in [one.kind for one in told(found).noise.findings]
    assert alarms <= 4
    assert told_so >= 12


def test_a_sensor_that_sticks_is_told_and_left_out(tmp_path: Path) -> None:
    case = load_case(rolling(tmp_path / "case", 8, runs=14))
    values = case.channels["current"].copy()
    rows = np.flatnonzero(case.run == 5)[:10]
    values[rows] = values[rows[0]]
    found = analyse(replace(case, channels={"current": values}))
    assert set(np.flatnonzero(found.stuck)) == set(rows[1:])  # the first may be right
    assert not found.missing
    assert not (found.case.train | found.case.test)[rows[1:]].any()
    assert any("sensor that sticks" in note for note in told(found).notes)
    limit = np.minimum(case.channels["current"], np.quantile(case.channels["current"], 0.9))
    assert not stuck_rows(limit, case.run).any()  # the end of a range
    assert not stuck_rows(np.round(values, 2), case.run).any()  # a coarse converter
    run = np.repeat([0, 1], 10)
    alike = np.arange(20.0)
    alike[6:14] = 6.0  # four rows at the end of a run and four at the begin of the next
    assert not stuck_rows(alike, run).any()


def test_a_sensor_that_clips_is_told_from_what_saturates(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    values = random.normal(2.0, 1.0, 200)
    clipped = np.minimum(values, 4.0)
    assert set(np.flatnonzero(clipped_rows(clipped))) == set(np.flatnonzero(values > 4.0))
    assert clipped_rows(clipped).sum() >= 3
    assert not clipped_rows(values).any()
    assert not clipped_rows(clipped + 1e-3 * random.standard_normal(200)).any()  # saturated, then measured
    coarse = np.round(np.minimum(values, 3.4), 2)  # other numbers occur two and three times
    assert set(np.flatnonzero(clipped_rows(coarse))) == set(np.flatnonzero(coarse == 3.4))
    assert not clipped_rows(np.round(clipped, 1)).any()  # a coarse converter
    assert not clipped_rows(np.minimum(values, 2.5)).any()  # a third of the rows: that is no exception
    assert not clipped_rows(np.maximum(values, 0.0)).any()  # at rest


def test_noise_far_above_what_is_stated_is_no_adequate_model(tmp_path: Path) -> None:
    """A speed without its sign, where nothing else has it: the residual has no shape but is far too large."""
    case = load_case(rolling(tmp_path / "case", 8, runs=14))
    random = np.random.default_rng(3)
    lost = replace(case, channels={"current": case.channels["current"] * random.choice([-1.0, 1.0], case.rows)})
    found = discover(lost)
    assert found.verdict == "adequate"
    assert found.answer_probability < 0.5
    both = told(found.analysis, found), told(found.analysis)
    assert all("far more than the stated noise" in story.headline and story.chip == "no alarm" for story in both)


def test_what_the_noise_is_like_is_told_and_no_effect(tmp_path: Path) -> None:
    case = load_case(rolling(tmp_path / "case", 8, runs=14))
    small = told(analyse(replace(case, sigma={"current": 0.0025})))
    assert small.verdict == "adequate"
    assert [one.kind for one in small.noise.findings] == ["larger"]
    assert small.noise.findings[0].value == pytest.approx(1.6, abs=0.25)
    offset = 0.008 * np.random.default_rng(1).standard_normal(14)
    apart = told(analyse(replace(case, channels={"current": case.channels["current"] + offset[case.run]})))
    assert [one.kind for one in apart.noise.findings] == ["run_offsets"]
    assert 0.5 < apart.noise.findings[0].value / offset.std() < 2.0  # sizes are weighed a factor of 2 apart
    assert "run offsets" in apart.noise.model
    for story in (small, apart):
        assert answer(story)["noise"]["findings"][0]["kind"] in ("larger", "run_offsets")
        assert any("times what is stated" in note or "Runs differ by" in note for note in story.notes)
    assert not told(analyse(case)).noise.findings


def test_what_wanders_over_the_whole_test_is_no_effect() -> None:
    """A random walk of 0.5 sd over the runs in their order looks like a column that falls from run to run."""
    _, case, noise = calibration.drawn("correlated", 18, 3)
    found = discover(case)
    assert (noise, found.verdict) == ("drift", "adequate")
    assert any(note.startswith("Over the whole test the data drift by") for note in told(found.analysis).notes)
    made, case, noise = calibration.drawn("correlated", 13, 3)
    found = discover(case)
    assert (noise, found.verdict, found.missing) == ("drift", "missing", made.truth)


def test_what_the_search_is_sure_of_is_an_alarm() -> None:
    """Stribeck and drag in runs of steady speed: one thing at a time, the test takes them for run offsets."""
    made, case, _ = calibration.drawn("odd rows", 14, 3)
    found = discover(case)
    assert found.analysis.adequacy.p_value > found.analysis.level
    assert found.analysis.missing
    assert set(found.missing) == set(made.truth)
    # the area of this drag is far more than usual: a formula of its curve is told beside it, and nothing else
    assert [set(one) - {"expression_1"} for one in found.rivals] == [set(made.truth), {"stribeck"}]
    assert "the test alone does not show it" in told(found.analysis, found).alarm


@pytest.mark.parametrize("place", [*range(0, len(ALIKE), 5), len(ALIKE) - 9, len(ALIKE) - 2, len(ALIKE) - 1])
def test_the_precision_is_the_inverse_of_the_covariance(place: int) -> None:
    random = np.random.default_rng(place)
    run = random.permutation(np.repeat(np.arange(8), [1, 2, 3, 9, 20, 40, 4, 4]))
    runs, node = Runs(run, level=random.uniform(-1.0, 2.0, (1, len(run)))), NODES[place]
    covariance = runs.times(np.eye(len(run)), node)
    precision = Precision(runs, node)
    assert precision.times(covariance) == pytest.approx(np.eye(len(run)), abs=1e-10)
    assert precision.diagonal == pytest.approx(np.diag(np.linalg.inv(covariance)), rel=1e-9)


def test_rows_that_stand_alone_in_long_runs() -> None:
    """Each is judged by the rows beside it, however many there are."""
    random = np.random.default_rng(2)
    runs, node = Runs(np.repeat(np.arange(3), 4000)), NODES[PLAIN[-1]]
    values = runs.draw(random, 1, node)[:, 0]
    odd = np.array([17, 4100, 4200, 11_999])
    values[odd] += 15.0
    basis = orthonormal(random.standard_normal((12_000, 3)))
    assert set(np.flatnonzero(odd_rows(runs, values, basis, node, None))) == set(odd)
