"""Pieces of what noise is like: sds and likelihoods against covariances written out, a stated sd, sensors that stick or
clip, and what each mishap of a rig does to which rows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, f

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.estimate import EXACT, TRIED, Noise, _agree, _strongest, least_noise, within_scatter
from terrapin_tools.workbench.noise.kinds import ALIKE, NODES, Node, considered
from terrapin_tools.workbench.noise.marginal_likelihood import STATED, Evidence
from terrapin_tools.workbench.noise.mishaps import mishaps
from terrapin_tools.workbench.noise.odd import farthest, gathered, odd_limit
from terrapin_tools.workbench.noise.restricted import restricted_likelihood
from terrapin_tools.workbench.noise.stated import Given, followed
from terrapin_tools.workbench.noise.stuck import clipped_rows, stuck_rows
from tests.python.casekit import dense

WHITE = Node(0.0, 0.0, 0.0, 0.0, 1.0)
OFFSETS = Node(0.0, 0.0, 2.0, 0.0, 1.0)
KINDS = (
    WHITE, OFFSETS, Node(0.5, 0.6, 0.5, 1.0, 1.0), Node(1.0, 0.8, 0.0, 0.0, 1.0), Node(0.5, 0.6, 0.5, 0.0, 1.0, 1.0),
    Node(0.0, 0.0, 0.5, 0.0, 1.0, gain=1.5), Node(0.0, 0.0, 0.5, 0.0, 1.0, grow=0.98),
)  # fmt: skip


def _runs() -> Runs:
    random = np.random.default_rng(3)
    run = random.permutation(np.repeat(np.arange(9), [4, 5, 6, 3, 7, 4, 5, 2, 6]))
    return Runs(run, level=random.uniform(0.5, 3.0, (1, len(run))))


@pytest.mark.parametrize("node", KINDS, ids=str)
def test_the_scatter_of_repeats_is_compared_with_what_that_noise_gives(node: Node) -> None:
    """Of n rows about their mean: the trace of their covariance less their sum's variance over n."""
    runs, random = _runs(), np.random.default_rng(4)
    values, group = random.standard_normal(runs.rows), random.integers(0, 12, runs.rows)
    group[0] = 12  # alone
    covariance = dense(runs, node)
    scatter = share = 0.0
    for one in range(13):
        rows = np.flatnonzero(group == one)
        scatter += float(((values[rows] - values[rows].mean()) ** 2).sum())
        inside = covariance[np.ix_(rows, rows)]
        share += float(np.trace(inside) - inside.sum() / len(rows))
    assert within_scatter(runs, values, group, node) == pytest.approx(np.sqrt(scatter / share))


@pytest.mark.parametrize("node", KINDS, ids=str)
def test_the_floor_is_the_rms_of_whole_runs(node: Node) -> None:
    run = np.repeat(np.arange(40), 8)
    runs = Runs(run, level=np.random.default_rng(6).uniform(0.5, 3.0, (1, 320)))
    assert node.floor == pytest.approx(np.sqrt(np.diag(dense(runs, node)).mean()), rel=1e-3)


@pytest.mark.parametrize("stated", [None, 0.7])
def test_the_restricted_likelihood_is_that_of_dense_covariances(stated: float | None) -> None:
    """Of two channels, at each kind of noise: what is left beyond the fitted columns, with the prior of the kind."""
    runs, random = _runs(), np.random.default_rng(5)
    each = [runs, Runs(runs.run, level=random.uniform(0.5, 3.0, (1, runs.rows)))]
    residuals = list(random.standard_normal((2, runs.rows)))
    bases = [np.linalg.qr(random.standard_normal((runs.rows, count)))[0] for count in (2, 3)]
    found, squares = restricted_likelihood(each, residuals, bases, [stated, None])
    assert len(found) == considered(2)
    for place in [*range(0, len(ALIKE), 3), *range(len(ALIKE), len(found), 2)]:
        node, expected = NODES[place], -2.0 * np.log(NODES[place].prior)
        for channel, sd in enumerate((stated, None)):
            inverse = np.linalg.inv(covariance := dense(each[channel], node.of(channel)))
            inner = bases[channel].T @ inverse @ bases[channel]
            taken = bases[channel].T @ inverse @ residuals[channel]
            total = residuals[channel] @ inverse @ residuals[channel] - taken @ np.linalg.solve(inner, taken)
            free = runs.rows - bases[channel].shape[1]
            expected += np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inner)[1]
            expected += free * np.log(total) if sd is None else (STATED + free) * np.log(STATED + total / sd**2)
            assert squares[place, channel] == pytest.approx(total)
        assert found[place] == pytest.approx(expected)


@pytest.mark.parametrize("stated", [None, 1.0])
def test_the_gain_of_a_shape_is_that_of_dense_covariances(stated: float | None) -> None:
    """The best of three shapes, beside what was fitted, where the kind of noise may change with it."""
    runs, random = _runs(), np.random.default_rng(9)
    pool = random.standard_normal((runs.rows, 3))
    basis = np.linalg.qr(random.standard_normal((runs.rows, 2)))[0]
    residual = random.standard_normal(runs.rows) + 0.9 * pool[:, 1]
    criterion, squares = restricted_likelihood([runs], [residual], [basis], [stated])
    best = int(np.argmin(criterion))
    gain, channel, index = _strongest([runs], residual[None], [basis], [pool], [stated], squares, best, {})

    def lost(place: int, columns: Array) -> float:
        inverse = np.linalg.inv(covariance := dense(runs, NODES[place]))
        taken = np.linalg.solve(columns.T @ inverse @ columns, columns.T @ inverse @ residual)
        total = float((residual - columns @ taken) @ inverse @ residual)
        fit = runs.rows * np.log(total) if stated is None else (STATED + runs.rows) * np.log(STATED + total / stated**2)
        return float(fit + np.linalg.slogdet(covariance)[1] - 2.0 * np.log(NODES[place].prior))

    present = min(lost(place, basis) for place in range(len(ALIKE)))
    new = [min(lost(place, np.column_stack([basis, one])) for place in {best, *TRIED}) for one in pool.T]
    assert (channel, index) == (0, int(np.argmin(new))) == (0, 1)
    assert gain == pytest.approx(present - min(new))


def test_a_size_of_one_sign_or_the_other_is_one_of_any_sign() -> None:
    """Twice over: each sign alone is half of all sizes, so where one must be, its evidence counts twice."""
    random = np.random.default_rng(6)
    run = np.repeat(np.arange(6), 8)
    columns = random.standard_normal((48, 3))
    evidence = Evidence(Runs(run), random.standard_normal((1, 48)) + 0.8 * columns[:, 1], np.ones((1, 48, 1)), STATED)
    gram, picks = evidence.gram(columns), np.array([[0], [1], [2]])

    def found(sign: float) -> Array:
        return evidence.blocks(gram, picks, np.full((3, 1), sign))

    np.testing.assert_allclose(np.logaddexp(found(1.0), found(-1.0)), np.log(2.0) + found(0.0))
    assert found(1.0)[1] > found(0.0)[1] > found(-1.0)[1]
    np.testing.assert_allclose(found(0.0), evidence.single(columns))


def test_the_evidence_is_the_same_from_wherever_the_residual_was_taken() -> None:
    random = np.random.default_rng(7)
    run = np.repeat(np.arange(6), 8)
    columns, residual = random.standard_normal((48, 3)), random.standard_normal((1, 48))
    picks, signs, offset = np.array([[0, 1], [1, 2]]), np.array([[1.0, 0.0], [-1.0, 1.0]]), np.array([0.5, -2.0, 1.0])
    base = random.standard_normal((1, 48, 2))

    def found(left: Array, offset: Array | None) -> Array:
        evidence = Evidence(Runs(run), left, base, 0.0)
        return evidence.blocks(evidence.gram(columns), picks, signs, offset)

    np.testing.assert_allclose(found(residual, None), found(residual - columns @ offset, offset))


def test_kinds_of_noise_lie_near_enough_to_each_other() -> None:
    """Sizes of what runs differ by go from a quarter or half of a row's sd to several, in steps of four at most; of
    correlations from weak to those of fast loggers; and none stands out of the order of what is likely."""
    for name, least, most in (("offset", 0.25, 20.0), ("drift", 0.4, 1.0), ("walk", 0.5, 1.0), ("gain", 0.5, 5.0)):
        sizes = sorted({getattr(node, name) for node in ALIKE} - {0.0})
        assert (sizes[0], sizes[-1]) == (least, most)
        assert max(np.divide(sizes[1:], sizes[:-1])) < 4.0
    assert {(node.share, node.rho) for node in ALIKE} == {
        (0.0, 0.0), (0.5, 0.6), (0.5, 0.9), (1.0, 0.3), (1.0, 0.6), (1.0, 0.8), (1.0, 0.92), (1.0, 0.98)
    }  # fmt: skip
    assert {node.grow for node in ALIKE} == {0.0, 0.5, 0.98}
    assert {NODES[i].rho for i in TRIED} == {0.0, 0.6, 0.92}  # a shape is tried in white noise, too, and in slow
    for node in ALIKE:  # what is alike over most of a run is hard to tell from an offset: one beside it will do
        plain = not (node.drift or node.walk or node.gain or node.grow)
        beside = {
            one.offset for one in ALIKE if replace(one, offset=0.0, prior=0.0) == replace(node, offset=0.0, prior=0.0)
        }
        assert not plain or beside == ({0.0, 1.0} if node.rho > 0.9 else {0.0, 0.25, 0.5, 1.0, 2.0, 6.0, 20.0})
    assert max(ALIKE, key=lambda node: node.prior) == ALIKE[0] == replace(WHITE, prior=ALIKE[0].prior)
    unlike = NODES[len(ALIKE) : considered(2)]
    assert all(node.prior < 0.02 for node in unlike)
    assert {(one.share, one.rho) for node in unlike for one in (node, node.rest) if one is not None} == {
        (0.0, 0.0), (0.5, 0.6), (0.5, 0.9), (1.0, 0.4), (1.0, 0.8)
    }  # fmt: skip
    for node in unlike:
        assert node.rest is not None
        for one in (node, node.rest):
            assert one.share in (0.0, 0.5, 1.0)
            assert 0.0 <= one.rho < 1.0
            assert (one.drift, one.walk) == (0.0, 0.0)
            assert one.offset in (0.0, 0.5, 1.0, 2.0)
            assert one.gain in (0.0, 1.5)
            assert one.grow in (0.0, 0.98)


def _stated(ratio: float, freedom: float, sigma: float = 1.0, node: Node = WHITE) -> Noise:
    known = np.array([True])
    return Noise(np.array([sigma]), known, node, "as given", np.array([np.inf]), None, ratio=np.array([ratio]),
        ratio_freedom=freedom)  # fmt: skip


@pytest.mark.parametrize(
    ("ratio", "whole", "off"),
    [(1.0, 1.0, False), (1.12, 1.0, False), (1.3, 1.0, True),
     (2.0, 1.0, True), (0.4, 1.0, True), (0.9, 1.0, False), (1.0, 2.1, True),
     (1.0, 1.9, False), (1.0, 1 / 2.1, True), (1.0, 1 / 1.9, False)],
)  # fmt: skip
def test_a_stated_sd_is_off_by_what_rows_or_whole_runs_say(ratio: float, whole: float, off: bool) -> None:
    """`whole`: the sd of runs that is found without the statement, over that with it."""
    noise = _stated(ratio, 200.0, node=OFFSETS)

    def again(given: Given) -> Noise:
        assert given == [None]
        return replace(noise, sigma=np.array([whole * OFFSETS.floor]), known=np.array([False]))

    found = followed(noise, [1.0], again)
    assert (found is not noise) == off
    if off:
        assert found.ratio[0] == pytest.approx(whole)
        assert "not as stated" in found.source
        assert found.wrong[0] > 0.9
    if off and whole > 2.0:
        assert found.wrong[0] == 1.0


def test_how_likely_a_stated_sd_is_off_is_by_its_degrees_of_freedom() -> None:
    """Off is what lies outside 10 %, given what was found and that nobody states an sd better than to 18 %."""
    for ratio, freedom in ((1.4, 40.0), (0.7, 40.0)):
        noise = _stated(ratio, freedom)
        found = followed(noise, [1.0], lambda given: noise)  # noqa: B023
        degrees, square = STATED + freedom, STATED + freedom * ratio**2
        larger, smaller = chi2.cdf(square / 1.1**2, degrees), chi2.sf(square * 1.1**2, degrees)
        expected = max(larger, smaller)
        assert expected > 0.9
        assert found.wrong[0] == pytest.approx(expected)
    noise = replace(_stated(5.0, 40.0), known=np.array([False]))
    assert followed(noise, [1.0], lambda given: pytest.fail("nothing is stated")) is noise
    noise = _stated(5.0, 40.0)  # known by its rounding alone
    assert followed(noise, [None], lambda given: pytest.fail("nothing is stated")) is noise


def test_a_sensor_sticks_from_eight_equal_rows_on() -> None:
    random, run = np.random.default_rng(8), np.repeat([1, 0], 100)
    for length, sticks in ((7, 0), (8, 7), (12, 11)):
        values = random.standard_normal(200)
        values[0], values[1] = -9.0, 9.0
        values[40 : 40 + length] = 0.5
        assert stuck_rows(values, run).sum() == sticks
        values[40 : 40 + length] = 0.0  # at rest
        assert not stuck_rows(values, run).any()
    values = random.standard_normal(200)
    values[0], values[1] = -9.0, 9.0
    for length, sticks in ((21, 20), (22, 0)):  # more than a tenth of the rows is no exception
        values[40 : 40 + length] = 0.5
        assert stuck_rows(values, run).sum() == sticks
    values = random.standard_normal(200)
    values[0], values[1] = -9.0, 9.0
    values[40:50] = 0.5
    values[101:125:3] = values[100:124:3]  # 8 pairs, 4 % of the rest: the channel is not coarse
    assert stuck_rows(values, run).sum() == 9
    values[131:149:3] = values[130:148:3]
    assert not stuck_rows(values, run).any()


def test_a_sensor_clips_at_either_end() -> None:
    random = np.random.default_rng(9)
    for end in (-4.0, 4.0):
        values = random.uniform(-3.0, 3.0, 100)
        values[[5, 50]] = end
        assert not clipped_rows(values).any()  # twice may be chance
        values[70] = end
        assert np.flatnonzero(clipped_rows(values)).tolist() == [5, 50, 70]
        values[[1, 2]] = 0.25  # two of one number inside ask for six at the end
        assert not clipped_rows(values).any()
        values[[71, 72, 73]] = end
        assert clipped_rows(values).sum() == 6
        values[80:84] = end
        assert clipped_rows(values).sum() == 10
        values[84] = end  # more than a tenth
        assert not clipped_rows(values).any()
    assert not clipped_rows(np.array([1.0, 1.0, 1.0, 2.0] * 10)).any()  # a switch


def test_of_each_row_the_channel_that_is_farthest_off_counts() -> None:
    rows = np.array([True, False, True, True])
    residual = np.array([[1.0, -2.0, 0.5], [-3.0, 1.0, 0.25]])
    assert farthest(residual, rows).tolist() == [-3.0, 0.0, -2.0, 0.5]


def test_a_switch_is_no_place_at_which_rows_gather() -> None:
    """Four glitches with a heater on say nothing of the heater; at three levels they may."""
    odd = np.zeros(100, dtype=bool)
    odd[[10, 30, 50, 70, 90]] = True
    every, up, run = np.ones(100, dtype=bool), np.ones(100), np.arange(100) % 2
    assert not gathered(odd, up, run, {"heater": 1.0 * odd}, every)
    level = 1.0 * odd
    level[0] = 2.0
    assert gathered(odd, up, run, {"level": level}, every)
    assert not gathered(odd, up, run, {"level": np.where(odd, level, np.nan)}, every)
    assert [odd_limit(rows) for rows in (19, 20, 40, 60, 200)] == [0, 2, 2, 3, 10]


def test_what_was_computed_is_believed_to_a_millionth_of_its_spread() -> None:
    values = np.linspace(0.0, 1.0, 101)
    few = np.zeros(101)
    few[0] = 3.0
    given = np.stack([values, few, np.full(101, -4.0), np.zeros(101)])
    np.testing.assert_allclose(least_noise(given), EXACT * np.array([0.9, 3.0, 4.0, 1.0]))


def _identity(channel: int, change: Array) -> Array:
    found = np.zeros((2, len(change)))
    found[channel] = change
    return found


def _named(found: Any) -> list[tuple[str, int | None]]:
    return [(one.kind, one.run) for one in found]


def test_what_may_go_wrong_on_a_rig_and_on_which_rows() -> None:
    """An odd run, a slope, a change between two runs with two on either side, a test that warms up, runs that begin
    unsettled, an instrument that lags: each an offset and a factor in each channel."""
    run = np.repeat([3, 1, 2, 7, 5, 8], 6)  # in file order; a run's rows together
    level = np.random.default_rng(2).uniform(1.0, 2.0, (2, 36))
    runs = Runs(run, 2, level)
    slopes = np.random.default_rng(3).standard_normal((6, 2, 36))
    slopes[4, 0, 0] = np.nan  # where its motion has no numbers there is none
    found = mishaps(runs, _identity, whole_runs=False, slopes=slopes)
    numbers = [1, 2, 3, 5, 7, 8]
    assert _named(found) == [
        *(("run", one) for one in numbers), *(("slope", one) for one in (1, 2, 3, 5, 8)),
        *(("change", one) for one in (3, 5, 7)), *[("warming", None)] * 3, *[("start", None)] * 2, *[("lag", None)] * 3,
    ]  # fmt: skip
    of = {(one.kind, one.run): one.columns.reshape(2, 36, -1) for one in found}
    for number in numbers:
        inside = 1.0 * (run == number)
        expected = np.zeros((2, 36, 4))
        for channel in range(2):
            expected[channel, :, 2 * channel] = inside
            expected[channel, :, 2 * channel + 1] = inside * runs.level[channel]
        np.testing.assert_allclose(of["run", number], expected)
    np.testing.assert_allclose(of["slope", 5][..., 0], slopes[3])
    np.testing.assert_allclose(of["change", 5][0, :, 0], run >= 5)
    place = np.argsort(np.argsort(run, kind="stable")) / 36.0  # of each row in the order of the runs
    warming = [one.columns.reshape(2, 36, -1)[0, :, 0] for one in found if one.kind == "warming"]
    np.testing.assert_allclose(warming, [np.exp(-place / share) for share in (0.03, 0.1, 0.25)])
    start = [one.columns.reshape(2, 36, -1)[0, :, 0] for one in found if one.kind == "start"]
    np.testing.assert_allclose(start, [np.exp(-np.tile(np.arange(6.0), 6) / (6.0 * s)) for s in (0.05, 0.15)])
    for one, share in zip([one for one in found if one.kind == "lag"], (0.3, 0.6, 0.85), strict=True):
        late = one.columns.reshape(2, 36, 2)
        assert not late[0, :, 1].any()
        for channel in range(2):
            for number in numbers:
                own = runs.reading[channel, run == number]
                shown = own.copy()
                for row in range(1, 6):
                    shown[row] = share * shown[row - 1] + (1.0 - share) * own[row]
                np.testing.assert_allclose(late[channel, run == number, channel], shown - own)


def test_mishaps_need_runs_and_rows_enough() -> None:
    def kinds(runs: int, rows: int, whole: bool = False) -> set[str]:
        run = np.repeat(np.arange(runs), rows)
        return {one.kind for one in mishaps(Runs(run, 2, np.ones((2, len(run)))), _identity, whole)}

    assert kinds(2, 5) == {"lag"}
    assert kinds(3, 5) == {"run", "start", "lag"}
    assert kinds(3, 4) == {"run"}  # too short to begin, or to lag
    assert kinds(4, 5) == {"run", "warming", "start", "lag"}
    assert kinds(5, 4) == {"run", "warming"}
    assert kinds(6, 4) == {"run", "warming", "change"}
    assert kinds(6, 5, whole=True) == {"run", "warming", "change", "lag"}  # how its runs begin is the model's own


def test_of_many_runs_changes_are_looked_at_evenly() -> None:
    run = np.repeat(np.arange(200), 2)
    after = [one.run for one in mishaps(Runs(run, 2), _identity, True) if one.kind == "change"]
    assert len(after) == 60
    assert (after[0], after[-1]) == (2, 198)
    assert set(np.diff([one for one in after if one is not None])) == {3, 4}


def test_a_smooth_model_that_leaves_more_than_repeats_scatter_does_not_agree() -> None:
    """By the F test at 1 %, of the variances and their degrees of freedom."""
    edge = float(np.sqrt(f.isf(0.01, 40.0, 12.0)))
    assert _agree(0.99 * edge * 3.0, 40.0, 3.0, 12.0)
    assert not _agree(1.01 * edge * 3.0, 40.0, 3.0, 12.0)
    assert _agree(0.1, 40.0, 3.0, 12.0)
