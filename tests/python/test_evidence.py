"""Evidence, rows that stand alone and repeated settings, each against a direct calculation on covariances written
out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import special
from scipy.linalg import block_diag
from scipy.stats import norm, t

from terrapin_hil.arrays import Array, Mask
from terrapin_tools.workbench.noise import marginal_likelihood, odd
from terrapin_tools.workbench.noise.covariance import Runs, carried, doublings, orthonormal
from terrapin_tools.workbench.noise.estimate import EXACT, Noise, estimate_noise, repeated_settings, within_scatter
from terrapin_tools.workbench.noise.kinds import ALIKE, NODES, PLAIN, Node, by_filter, considered
from terrapin_tools.workbench.noise.log_sums import logsumexp
from terrapin_tools.workbench.noise.marginal_likelihood import LIKELY, SIZES, STATED, Evidence
from terrapin_tools.workbench.noise.odd import gathered, odd_rows, standing_alone
from terrapin_tools.workbench.noise.stated import followed
from tests.python.casekit import dense

WHITE = Node(0.0, 0.0, 0.0, 0.0, 1.0)
# of two channels: some of each family that both have, and of each that one has
SOME = [*range(0, len(ALIKE), 4), *range(len(ALIKE), considered(2), 5)]


class _Dense:
    """Evidence of a residual of two channels, runs of several lengths, written out."""

    def __init__(self, behind: float) -> None:
        random = np.random.default_rng(12)
        run = random.permutation(np.repeat(np.arange(9), [3, 4, 5, 2, 6, 3, 4, 1, 5]))
        level = random.uniform(0.5, 3.0, (2, len(run)))
        self.runs, self.behind = Runs(run, 2, level), behind
        self.residual = 1.2 * random.standard_normal((2, len(run))) + 0.3 * random.standard_normal(9)[run]
        self.base = random.standard_normal((2, len(run), 3))
        self.columns = random.standard_normal((2 * len(run), 4))
        self.columns[:, 1] += 0.5 * self.residual.reshape(-1)
        self.each = [Runs(run, level=one[None]) for one in level]

    def evidence(self, nodes: list[int] | None = None) -> Evidence:
        return Evidence(self.runs, self.residual, self.base, self.behind, SOME if nodes is None else nodes)

    def covariance(self, node: Node) -> Array:
        return np.asarray(block_diag(*(dense(one, node.of(channel)) for channel, one in enumerate(self.each))))

    def beyond(self, covariance: Array) -> tuple[Array, float]:
        """V^-1 less what the base takes up, and log |V| + log |X' V^-1 X| of an orthonormal base X."""
        x = np.linalg.qr(self.base.reshape(-1, 3))[0]
        inverse = np.linalg.inv(covariance)
        inner = x.T @ inverse @ x
        found = inverse - inverse @ x @ np.linalg.solve(inner, x.T @ inverse)
        return found, float(np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inner)[1])

    def fit(self, square: float) -> float:
        freedom = self.residual.size - 3
        return float(-0.5 * (self.behind + freedom) * np.log(self.behind + square))

    def logs(self, nodes: list[int], columns: Array | None = None) -> Array:
        """Log evidence at each kind of noise, with columns whose sizes have one of SIZES as their sd."""
        found = []
        for place in nodes:
            plain, parts = self.covariance(NODES[place]), []
            for size in SIZES if columns is not None else [0.0]:
                added = 0.0 if columns is None else size**2 * columns @ columns.T
                inverse, determinant = self.beyond(plain + added)
                flat = self.residual.reshape(-1)
                parts.append(self.fit(float(flat @ inverse @ flat)) - 0.5 * determinant + np.log(NODES[place].prior))
            found.append(special.logsumexp(parts) - np.log(len(parts)))
        return np.array(found)


@pytest.mark.parametrize("behind", [0.0, STATED])
def test_evidence_is_that_of_covariances_with_columns_in_them(behind: float) -> None:
    """What a column of unknown size adds is its square in the covariance, at each of the sizes that are likely."""
    case = _Dense(behind)
    evidence, nodes = case.evidence(), SOME
    nothing = case.logs(nodes)
    assert evidence.nothing == pytest.approx(special.logsumexp(nothing), abs=1e-7)
    np.testing.assert_allclose(evidence.posterior, np.exp(nothing - special.logsumexp(nothing)), rtol=1e-6)
    few = [SOME[0], SOME[7], SOME[-2]]
    less = case.evidence(few)
    one = [special.logsumexp(case.logs(few, case.columns[:, [i]])) for i in range(4)]
    np.testing.assert_allclose(less.single(case.columns), one, atol=1e-7)
    gram = less.gram(case.columns)
    picks = np.array([[0, 1], [2, 1], [3, 0]])
    two = [special.logsumexp(case.logs(few, case.columns[:, pick])) for pick in picks]
    np.testing.assert_allclose(less.blocks(gram, picks, np.zeros((3, 2))), two, atol=1e-7)
    np.testing.assert_allclose(less.pairs(gram, picks[:, 0], picks[:, 1]), two, atol=1e-7)
    three = special.logsumexp(case.logs(few, case.columns[:, [3, 1, 2]]))
    np.testing.assert_allclose(less.blocks(gram, np.array([[3, 1, 2]]), np.zeros((1, 3))), [three], atol=1e-7)
    # what the base can take up says nothing
    taken = case.base.reshape(-1, 3) @ [[2.0], [-1.0], [40.0]]
    np.testing.assert_allclose(less.single(taken), [less.nothing], atol=1e-7)
    for place, node in enumerate(few):
        inverse = case.beyond(case.covariance(NODES[node]))[0]
        np.testing.assert_allclose(gram.products[place], case.columns.T @ inverse @ case.columns, atol=1e-8)
        np.testing.assert_allclose(gram.scores[place], case.columns.T @ inverse @ case.residual.reshape(-1), atol=1e-8)


def test_many_columns_are_handled_a_part_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    case = _Dense(STATED)
    evidence = case.evidence(SOME[:6])
    whole = evidence.single(case.columns)
    monkeypatch.setattr(marginal_likelihood, "CHUNK", 3)
    np.testing.assert_allclose(evidence.single(case.columns), whole, rtol=1e-12)


@pytest.mark.parametrize("behind", [0.0, STATED])
def test_a_size_of_one_sign_counts_by_its_share_of_the_posterior(
    monkeypatch: pytest.MonkeyPatch, behind: float
) -> None:
    """Of each coefficient alone, twice over; what is free counts as it is."""
    monkeypatch.setattr(marginal_likelihood, "SIZES", np.array([0.7]))
    case, node = _Dense(behind), SOME[4]
    evidence = case.evidence([node])
    gram, picks = evidence.gram(case.columns), np.array([[0, 1], [2, 1], [3, 0], [1, 3]])
    signs = np.array([[1.0, -1.0], [0.0, 1.0], [0.0, 0.0], [-1.0, 0.0]])
    free = evidence.blocks(gram, picks, np.zeros((4, 2)))
    inverse = case.beyond(case.covariance(NODES[node]))[0]
    for pick, side, bounded, pair, plain in zip(
        picks, signs, evidence.blocks(gram, picks, signs), evidence.pairs(gram, picks[:, 0], picks[:, 1], signs), free,
        strict=True,
    ):  # fmt: skip
        c = case.columns[:, pick]
        posterior = np.linalg.inv(c.T @ inverse @ c + np.eye(2) / 0.7**2)
        mean = posterior @ c.T @ inverse @ case.residual.reshape(-1)
        share = norm.logcdf(side * mean / np.sqrt(np.diagonal(posterior))) + np.log(2.0)
        assert bounded == pytest.approx(plain + share[side != 0.0].sum(), abs=1e-8)
        assert pair == pytest.approx(bounded, abs=1e-8)


@pytest.mark.parametrize("behind", [0.0, STATED])
def test_a_parameter_at_a_bound_counts_by_its_share_within(monkeypatch: pytest.MonkeyPatch, behind: float) -> None:
    """Beside what is asked, each by itself, with the sd integrated over: Student's t, to what its form as a normal
    variate costs."""
    monkeypatch.setattr(marginal_likelihood, "SIZES", np.array([0.7]))
    case, node = _Dense(behind), SOME[4]
    case.residual += np.tensordot(case.base, [-0.4, 0.3, 0.3], axes=1)  # beyond both bounds
    given = (case.runs, case.residual, case.base, behind, [node])
    free, held = Evidence(*given), Evidence(*given, np.array([1.0, 0.0, -1.0]))
    inverse = np.linalg.inv(case.covariance(NODES[node]))

    def within(*columns: int) -> float:
        x = np.column_stack([case.base.reshape(-1, 3), case.columns[:, columns]])
        normal = x.T @ inverse @ x + np.diag([0.0] * 3 + [0.7**-2] * len(columns))
        score = x.T @ inverse @ case.residual.reshape(-1)
        spread = np.linalg.inv(normal)
        mean = spread @ score
        freedom = behind + case.residual.size - 3
        square = case.residual.reshape(-1) @ inverse @ case.residual.reshape(-1) - mean @ score
        scale = np.sqrt((behind + square) / freedom * np.diagonal(spread))
        return float(t.logcdf(mean[0] / scale[0], freedom) + t.logcdf(-mean[2] / scale[2], freedom))

    assert within() < -5.0
    assert held.nothing - free.nothing == pytest.approx(within(), rel=1e-2)
    one = [within(i) for i in range(4)]
    np.testing.assert_allclose(held.single(case.columns) - free.single(case.columns), one, rtol=1e-2)
    assert np.ptp(one) > 0.2
    gram, picks = held.gram(case.columns), np.array([[0, 1], [2, 1], [3, 0]])
    signs = np.array([[0.0, 0.0], [0.0, 1.0], [-1.0, 1.0]])
    two, asked = [within(*pick) for pick in picks], (gram, picks, signs)
    alone = free.blocks(free.gram(case.columns), picks, signs)
    np.testing.assert_allclose(held.blocks(*asked) - alone, two, rtol=1e-2)
    monkeypatch.setattr(marginal_likelihood, "CHUNK", 2)
    np.testing.assert_allclose(held.pairs(gram, *picks.T, signs), held.blocks(*asked), rtol=1e-12)
    offset = np.array([0.5, -0.3, 0.2, 0.1])
    moved = Evidence(
        case.runs, case.residual - (case.columns @ offset).reshape(2, -1), case.base, behind, [node], held.signs
    )
    again = moved.blocks(moved.gram(case.columns), picks, signs, offset)
    np.testing.assert_allclose(again, held.blocks(*asked), rtol=1e-9)
    few = held.of_few()
    assert few.nothing == pytest.approx(Evidence(*given[:4], few.nodes, held.signs).nothing)
    assert Evidence(*given, np.array([0.0, 0.0])).nothing == free.nothing


def test_kinds_of_noise_that_are_likely_with_or_without_a_column() -> None:
    """Of columns what the best size takes off."""
    case = _Dense(0.0)
    every = list(range(considered(2)))[::3]
    evidence = case.evidence(every)
    lost = []
    for place in every:
        inverse, determinant = case.beyond(case.covariance(NODES[place]))
        flat = case.residual.reshape(-1)
        total = float(flat @ inverse @ flat)
        taken = [0.0, *((c @ inverse @ flat) ** 2 / (c @ inverse @ c) for c in case.columns.T)]
        fits = [case.fit(total - one) for one in taken]
        lost.append([fit - 0.5 * determinant + np.log(NODES[place].prior) for fit in fits])
    share = special.softmax(np.array(lost), axis=0)
    likely = {place for place, row in zip(every, share, strict=True) if row.max() > LIKELY}
    assert set(evidence.among(case.columns)) == likely | (set(PLAIN) & set(every))
    alone = {place for place, row in zip(every, share, strict=True) if row[0] > LIKELY}
    assert set(evidence.among(case.columns[:, :0])) == alone | (set(PLAIN) & set(every))
    assert alone < likely
    few, best = case.evidence(every[1:]).of_few(), every[1 + int(np.argmax(share[1:, 0]))]
    assert few.nodes == (0, best)
    assert few.nothing == pytest.approx(case.evidence([0, best]).nothing)


def test_lengths_are_those_beyond_the_base() -> None:
    case, node = _Dense(0.0), NODES[SOME[5]]
    evidence = case.evidence([SOME[5]])
    covariance = case.covariance(node)
    inverse = case.beyond(covariance)[0]
    white = evidence.whitened(case.columns, node)
    np.testing.assert_allclose(white.T @ white, case.columns.T @ inverse @ case.columns, atol=1e-8)
    gap = case.columns[:, 0].reshape(2, -1)
    assert evidence.distance(gap, case.base, node) == pytest.approx(gap.reshape(-1) @ inverse @ gap.reshape(-1))
    none = np.zeros((*gap.shape, 0))
    alone = gap.reshape(-1) @ np.linalg.solve(covariance, gap.reshape(-1))
    assert evidence.distance(gap, none, node) == pytest.approx(alone)


def test_a_recurrence_is_that_of_one_row_after_the_other() -> None:
    random = np.random.default_rng(1)
    for rows in (1, 2, 3, 8, 37):
        rate = random.uniform(-0.9, 0.9, rows) * (np.arange(rows) % 7 > 0)
        columns = random.standard_normal((rows, 2))
        expected = columns.copy()
        for row in range(1, rows):
            expected[row] += rate[row] * expected[row - 1]
        np.testing.assert_allclose(carried(columns.copy(), doublings(rate)), expected, atol=1e-12)
    assert doublings(np.zeros(50)) == []  # nothing is carried
    assert len(doublings(np.append(0.0, np.full(999, 1e-5)))) == 2  # to the fourth power it is below rounding


def test_a_basis_leaves_out_what_adds_nothing() -> None:
    random = np.random.default_rng(2)
    columns = random.standard_normal((9, 3)) * [1e-100, 1.0, 1e100]
    given = np.column_stack([columns, np.zeros(9), columns[:, 0] * 1e100 + columns[:, 1]])
    found = orthonormal(given)
    assert found.shape == (9, 3)
    np.testing.assert_allclose(found.T @ found, np.eye(3), atol=1e-12)
    scaled = columns / np.abs(columns).max(axis=0)
    np.testing.assert_allclose(found @ (found.T @ scaled), scaled, atol=1e-9)
    assert orthonormal(np.zeros((9, 2))).shape == orthonormal(np.zeros((9, 0))).shape == (9, 0)


def test_rows_that_are_left_out_leave_the_others_as_they_were() -> None:
    random = np.random.default_rng(3)
    run, level = random.permutation(np.repeat(np.arange(4), 5)), random.uniform(1.0, 2.0, (2, 20))
    felt, out = random.standard_normal((2, 20, 3)), np.arange(20) % 3 == 0
    runs = Runs(run, 2, level, felt, np.array([True, False]))
    kept = runs.without(out)
    assert kept.run.tolist() == run[~out].tolist()
    np.testing.assert_allclose(kept.reading / kept.reading[:, :1], level[:, ~out] / level[:, ~out][:, :1])
    assert kept.felt is not None
    np.testing.assert_array_equal(kept.felt, felt[:, ~out])
    assert kept.whole is runs.whole
    np.testing.assert_array_equal(kept.own, kept.sort(felt[:, ~out].reshape(-1, 3)))
    assert Runs(run, 2).without(out).felt is None
    shifts = Runs(run, 2, level).shifts
    np.testing.assert_array_equal(shifts[..., 0], np.ones((2, 20)))
    np.testing.assert_array_equal(shifts[1, :, 1], runs.line)
    np.testing.assert_allclose(shifts[..., 2], level / np.sqrt(np.mean(level**2, axis=1, keepdims=True)))


@pytest.mark.parametrize("node", [WHITE, Node(1.0, 0.8, 0.0, 0.0, 1.0), Node(0.5, 0.6, 0.5, 0.0, 1.0)], ids=str)
def test_a_row_is_worth_what_it_adds_to_the_mean_of_a_long_run(node: Node) -> None:
    covariance = dense(Runs(np.zeros(900, dtype=int)), node)
    assert node.thin(900) == pytest.approx(1.0 / (covariance.mean() * 900), rel=0.01)


def test_noise_is_named_by_what_it_is_made_of() -> None:
    full = Node(1.0, 0.6, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5)
    assert full.words() == "AR(1) growing with the reading + run offsets + run gains + drift + drift over the test"
    assert WHITE.words() == "white"
    assert replace(WHITE, share=0.5).words() == "white + AR(1)"
    assert replace(WHITE, only=0, rest=full).words().startswith("white in one channel, AR(1) growing")


def test_kinds_of_noise_by_their_filter() -> None:
    chosen = list(range(3, considered(3), 7))
    found = by_filter(chosen)
    assert sorted(place for places in found.values() for place in places) == list(range(len(chosen)))
    for kind, places in found.items():
        assert {NODES[chosen[place]].filter for place in places} == {kind}
    each = considered(2) - len(ALIKE)
    assert [(considered(n) - len(ALIKE)) / each for n in (1, 2, 3, 6, 7)] == [0, 2 / 2, 3 / 2, 3, 3]


def test_a_sum_of_numbers_by_their_logarithms() -> None:
    random = np.random.default_rng(4)
    logs = 300.0 * random.standard_normal((3, 4, 5)) - 900.0
    logs[1] = -np.inf
    logs[0, 0, 0] = -np.inf
    for axis in (None, 0, 1, (0, 2)):
        np.testing.assert_allclose(logsumexp(logs, axis), special.logsumexp(logs, axis=axis))


def _one_by_one(runs: Runs, residual: Array, basis: Array, node: Node, sd: float | None, most: int) -> Mask:
    """Rows that stand alone, each found by a fit that has a column for it, beside those that were found before."""
    inverse, behind = np.linalg.inv(dense(runs, node)), STATED if sd is not None else 0.0
    residual = residual / (sd or 1.0)
    gone: list[int] = []
    while True:
        ratio = np.zeros(runs.rows)
        for row in set(range(runs.rows)) - set(gone):
            x = np.column_stack([np.eye(runs.rows)[:, [*gone, row]], basis])
            inner = np.linalg.inv(x.T @ inverse @ x)
            fitted = inner @ x.T @ inverse @ residual
            left = residual - x @ fitted
            free = runs.rows - x.shape[1] + behind
            variance = (behind + left @ inverse @ left) / free
            place = len(gone)
            ratio[row] = abs(fitted[place]) / np.sqrt(inner[place, place] * variance)
        row = int(np.argmax(ratio))
        if ratio[row] < t.isf(0.005 / runs.rows, free):
            return np.isin(np.arange(runs.rows), gone)
        if len(gone) == most:
            return np.zeros(runs.rows, dtype=bool)
        gone.append(row)


@pytest.mark.parametrize("node", [WHITE, Node(0.5, 0.6, 0.5, 0.0, 1.0), Node(1.0, 0.8, 0.0, 0.4, 1.0)], ids=str)
@pytest.mark.parametrize("sd", [None, 2.0])
def test_a_row_stands_alone_by_a_fit_that_has_a_column_for_it(node: Node, sd: float | None) -> None:
    """From the same size on, to a tenth of a percent: of one row, and of another beside one that is large."""
    random = np.random.default_rng(5)
    runs = Runs(random.permutation(np.repeat(np.arange(6), 7)))
    basis = orthonormal(random.standard_normal((42, 2)))
    plain = runs.draw(random, 1, node)[:, 0]
    for first in (0.0, 15.0):

        def residual(size: float, first: float = first) -> Array:
            found = plain.copy()
            found[[3, 20]] += [first, -size]
            return found * (sd or 0.01)

        low, high = 0.0, 12.0
        while high - low > 0.004:
            size = 0.5 * (low + high)
            low, high = (low, size) if _one_by_one(runs, residual(size), basis, node, sd, 2)[20] else (size, high)
        assert 1.0 < low < high < 10.0
        for size, stands in ((low, False), (high, True)):
            found = odd_rows(runs, residual(size), basis, node, sd)
            assert np.flatnonzero(found).tolist() == [*([3] if first else []), *([20] if stands else [])]


def test_as_many_rows_as_a_twentieth_and_one_more_are_no_exception() -> None:
    random = np.random.default_rng(7)
    values = random.standard_normal(60)
    rows = [5, 17, 30, 44]
    for count, found in ((3, 3), (4, 0)):
        with_them = values.copy()
        with_them[rows[:count]] = [40.0, -35.0, 30.0, -26.0][:count]
        assert odd_rows(Runs(np.zeros(60, dtype=int)), with_them, np.zeros((60, 0)), WHITE, 1.0).sum() == found


@pytest.mark.parametrize(
    ("share", "sides", "columns", "together"),
    [(0.030, 1, 1, True), (0.042, 1, 1, False), (0.016, 2, 1, True), (0.020, 2, 1, False),
     (0.022, 1, 2, True), (0.028, 1, 2, False)],
)  # fmt: skip
def test_three_rows_lie_together_where_chance_is_a_thousandth(
    share: float, sides: int, columns: int, together: bool
) -> None:
    """Of n rows in a share w of a column, n w^(n - 1), and a quarter of that on one side of the model, a column."""
    rows, run = 1000, np.arange(1000) // 100
    x = np.random.default_rng(8).permutation(rows) / rows
    ranks = [300, 300 + round(0.4 * share * rows), 300 + round(share * rows) - 1]
    few = [int(np.flatnonzero(x == rank / rows)[0]) for rank in ranks]
    found = np.isin(np.arange(rows), few)
    residual = np.where(found, 5.0, 1.0)
    if sides == 2:
        residual[few[1]] = -5.0
    far = np.roll(x, 1)
    far[few] = 0.0, 0.5, 1.0
    other = {"y": far} if columns == 2 else {}
    every = np.ones(rows, dtype=bool)
    assert gathered(found, residual, run, {"x": x, **other}, every) == together


def test_a_glitch_that_lasts_counts_once_and_a_run_ends_it() -> None:
    """Two rows are too few to lie together."""
    every, residual, x = np.ones(1000, dtype=bool), np.ones(1000), np.arange(1000.0)
    run = np.arange(1000) // 10

    def found(*rows: int) -> bool:
        return gathered(np.isin(np.arange(1000), rows), residual, run, {"x": x}, every)

    assert found(31, 33, 35)
    assert not found(31, 32, 34)  # two glitches
    assert found(29, 30, 32)  # of two runs
    assert not found(31, 33)
    wide = np.isin(np.arange(1000), [31, 33, 35])
    assert gathered(wide, residual, run, {"x": x}, every)
    assert not gathered(wide, residual, run, {"x": x}, x < 100.0)  # a twentieth of what is looked at


def test_glitches_at_large_readings_are_no_noise_that_grows() -> None:
    """Unless it is the likeliest without them, too."""
    random = np.random.default_rng(9)
    level = random.uniform(0.05, 2.0, 120)
    run = np.repeat(np.arange(12), 10)
    runs, basis = Runs(run, level=level[None]), np.zeros((120, 0))
    values = 0.5 * random.standard_normal(120)
    big = np.argsort(level)[[-2, -6, -11]]
    values[big] += [9.0, -8.0, 8.0]
    assert np.flatnonzero(standing_alone([runs], [values], [basis], [None])).tolist() == sorted(big)
    runs = Runs(run, level=np.exp(1.2 * random.standard_normal(120))[None])
    grown = runs.sd(0.98) * random.standard_normal(120)
    assert not standing_alone([runs], [grown], [basis], [None]).any()
    assert odd_rows(runs, grown, basis, WHITE, None).any()  # in white noise they would


def test_a_row_of_any_channel_stands_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(10)
    run = np.repeat(np.arange(6), 10)
    values = random.standard_normal((2, 60)) * [[1.0], [100.0]]
    values[0, 7], values[1, 31] = 9.0, -900.0
    found = standing_alone([Runs(run)] * 2, list(values), [np.zeros((60, 0))] * 2, [None, 100.0])
    assert np.flatnonzero(found).tolist() == [7, 31]
    assert odd.odd_limit(60) == 3


def test_settings_are_repeated_to_a_hundredth_of_their_range() -> None:
    """Of all that was set, not of what runs by; a row is of the first setting that it agrees with."""
    speed = np.array([0.0, 0.9, 1.8, 100.0, 50.0, 50.5, 0.5])
    load = np.array([10.0, 10.0, 10.0, 20.0, 10.0, 10.2, 10.0])
    roles = {"omega": speed, "load": load, "time": np.arange(7.0)}
    assert repeated_settings({"omega": speed}, 7).tolist() == [0, 0, 1, 2, 3, 3, 0]
    assert repeated_settings(roles, 7).tolist() == [0, 0, 1, 2, 3, 4, 0]  # a load of 10.2 is another
    assert repeated_settings({"load": np.full(7, 3.0)}, 7).tolist() == [0] * 7
    assert repeated_settings({"omega": speed, "load": np.full(7, 3.0)}, 7).tolist() == [0, 0, 1, 2, 3, 3, 0]
    assert repeated_settings({"time": np.arange(7.0)}, 7).tolist() == list(range(7))
    assert repeated_settings({}, 3).tolist() == [0, 1, 2]


def _repeats(settings: int, times: int, noise: float = 0.4) -> tuple[Any, ...]:
    """Residual, derivatives, prediction, run and roles of settings that are repeated."""
    random = np.random.default_rng(11)
    rows = settings * times
    residual = noise * random.standard_normal((1, rows))
    roles = {"omega": np.tile(np.arange(float(settings)), times)}
    return residual, np.ones((1, rows, 1)), np.ones((1, rows)), np.arange(rows) % 8, roles


def _estimated(given: tuple[Any, ...], sd: float | None = None, roles: bool = True, **changed: Any) -> Noise:
    residual, slopes, prediction, run, named = given
    shapes = [np.zeros((0, residual.shape[1]))]
    least = changed.get("least", np.zeros(1))
    return estimate_noise(residual, slopes, prediction, run, [sd], named if roles else {}, shapes, least)


def test_many_repeats_give_the_sd_and_few_share_it_with_the_smoothest_model() -> None:
    """30 degrees of freedom are many; below four they say nothing; a stated sd stays."""
    few, many, none = _repeats(16, 2), _repeats(15, 3), _repeats(3, 2)
    for given, repeats in ((few, 16), (many, 30)):
        smooth, found = _estimated(given, roles=False), _estimated(given)
        assert smooth.node == found.node
        assert "no repeated settings" in smooth.source
        rows = given[0].shape[1]
        scatter = within_scatter(Runs(given[3]), given[0][0], repeated_settings(given[4], rows), found.node)
        row = smooth.sigma[0] / found.node.floor
        if repeats == 16:
            pooled = np.sqrt(((rows - 1) * row**2 + 16 * scatter**2) / (rows - 1 + 16))
            assert found.sigma[0] == pytest.approx(pooled * found.node.floor)
            assert found.freedom[0] == rows - 1 + 16
            assert "16 repeats of settings and, agreeing" in found.source
            assert found.groups is None
        else:
            assert found.sigma[0] == pytest.approx(scatter * found.node.floor)
            assert found.freedom[0] == 30
            assert found.source == "noise sd from repeated settings (30 repeats)"
            assert found.groups is not None
        stated = _estimated(given, 0.5)
        assert (stated.sigma[0], stated.freedom[0], stated.source) == (0.5, np.inf, "noise sd as given")
        assert stated.ratio[0] == pytest.approx(row / 0.5, rel=0.1)
    assert "no repeated settings" in _estimated(none).source
    assert "5 repeats" in _estimated(_repeats(5, 2)).source
    assert "4 repeats" in _estimated(_repeats(4, 2)).source


def test_few_repeats_that_disagree_are_believed_alone() -> None:
    """Where the model misses a shape it leaves more than they scatter by."""
    residual, slopes, prediction, run, roles = _repeats(20, 2, 0.01)
    residual = residual + np.sin(3.0 * roles["omega"])
    found = _estimated((residual, slopes, prediction, run, roles))
    assert found.source == "noise sd from repeated settings (20 repeats)"
    row = within_scatter(Runs(run), residual[0], repeated_settings(roles, 40), found.node)
    assert found.sigma[0] == pytest.approx(row * found.node.floor)


def test_a_shape_that_the_data_support_is_no_noise() -> None:
    residual, slopes, prediction, run, _ = _repeats(40, 2, 0.1)
    shape = np.sign(np.sin(np.arange(80.0) ** 1.7))
    shapes = [np.stack([np.cos(np.arange(80.0)), shape])]
    found = estimate_noise(residual + shape, slopes, prediction, run, [None], {}, shapes, np.zeros(1))
    assert "(1 shapes beside" in found.source
    assert found.freedom[0] == 80 - 2
    assert found.sigma[0] == pytest.approx(0.1, rel=0.2)
    stated = estimate_noise(residual + shape, slopes, prediction, run, [0.2], {}, shapes, np.zeros(1))
    assert stated.ratio[0] == pytest.approx(found.sigma[0] / 0.2, rel=0.05)
    assert stated.ratio_freedom == 78.0
    assert stated.weights.sum() == pytest.approx(1.0)
    assert NODES[int(np.argmax(stated.weights))] == stated.node


def test_noise_below_rounding_is_taken_as_that() -> None:
    given = _repeats(12, 2, 1e-9)
    found = _estimated(given, roles=False, least=np.array([1e-3]))
    assert found.sigma[0] == 1e-3
    assert found.known.tolist() == [True]
    assert f"an sd of {EXACT:g} of their spread" in found.source
    assert _estimated(given, roles=False, least=np.array([1e-12])).sigma[0] < 1e-8


def test_what_the_sd_of_one_channel_says_is_asked_again_for_that_alone() -> None:
    """The other keeps what is stated of it; the ratio is that of a row."""
    offsets = Node(0.0, 0.0, 2.0, 0.0, 1.0)
    noise = Noise(np.array([1.0, 4.0]), np.array([True, True]), WHITE, "as given", np.full(2, np.inf), None,
        ratio=np.array([1.0, 3.0]), ratio_freedom=100.0)  # fmt: skip
    asked: list[Any] = []

    def again(given: Any) -> Noise:
        asked.append(list(given))
        sigma = np.array([1.05, 12.0]) if given[0] is None else np.array([1.0, 11.0])
        return replace(noise, sigma=sigma, node=WHITE if given[0] is None else offsets)

    found = followed(noise, [1.0, 4.0], again)
    assert asked == [[None, None], [1.0, None]]
    assert found.wrong.tolist() == [0.0, 1.0]
    assert found.ratio.tolist() == [1.0, pytest.approx(11.0 / offsets.floor / 4.0)]
    assert found.sigma.tolist() == [1.0, 11.0]
    both = replace(noise, ratio=np.array([3.0, 3.0]))
    asked.clear()
    found = followed(both, [1.0, 4.0], again)
    assert asked == [[None, None]]
    assert found.sigma.tolist() == [1.05, 12.0]
    assert (found.wrong > 0.9).all()


@pytest.mark.parametrize(("gain", "enters"), [(19.0, False), (21.0, True)])
def test_a_shape_enters_the_smoothest_model_from_a_gain_of_twenty(gain: float, enters: bool) -> None:
    """Of -2 log likelihood, the stated sd counting as fifteen rows."""
    random = np.random.default_rng(14)
    noise, shape = random.standard_normal(80), np.sign(random.standard_normal(80))

    def gained(size: float) -> float:
        residual = noise + size * shape
        left = [np.zeros(80), np.zeros(80)]
        for place, columns in enumerate((np.ones((80, 1)), np.column_stack([np.ones(80), shape]))):
            left[place] = residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
        squares = [float(one @ one) for one in left]
        return float((STATED + 80) * np.log((STATED + squares[0]) / (STATED + squares[1])))

    low, high = 0.0, 3.0
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if gained(middle) > gain else (middle, high)
    residual, every = (noise + high * shape)[None], np.ones((1, 80, 1))
    found = estimate_noise(residual, every, every[..., 0], np.arange(80) % 8, [1.0], {}, [shape[None]], np.zeros(1))
    assert replace(found.node, prior=1.0) == WHITE
    assert found.ratio_freedom == (78.0 if enters else 79.0)
