"""Pieces of the verdict: names of a class, what decides between the verdicts, runs drawn anew against evidence of the
rows that they repeat, what an answer leaves and what a column explains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import f

from terrapin_hil.arrays import Array
from terrapin_hil.physics.effects import Parameter
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.discover import (
    decide,
    discovery,
    leftover,
    misfit,
    planted,
    ranker,
    suspect_answers,
    unexplained,
)
from terrapin_tools.workbench.discover import ranking as ranking_
from terrapin_tools.workbench.discover.certainty import _log_odds, calibrated
from terrapin_tools.workbench.discover.decide import Class, Decision, inclusion
from terrapin_tools.workbench.discover.leftover import Doubts, Left, absent, allowed, pays
from terrapin_tools.workbench.discover.misfit import explained, front, part_of
from terrapin_tools.workbench.discover.ranker import Hypothesis, Ranker
from terrapin_tools.workbench.discover.ranking import Blamed, Ranking
from terrapin_tools.workbench.discover.resampled import Sums
from terrapin_tools.workbench.formulas import free_curves
from terrapin_tools.workbench.formulas.expressions import FOUND
from terrapin_tools.workbench.model.effect_columns import Shape
from terrapin_tools.workbench.model.linearised import Linear
from terrapin_tools.workbench.model.table_faults import Fault
from terrapin_tools.workbench.model.usual_sizes import MOST_TAX
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.kinds import NODES, Node
from terrapin_tools.workbench.noise.marginal_likelihood import SIZES, STATED, Evidence

WHITE = Node(0.0, 0.0, 0.0, 0.0, 1.0)
EVERY = np.ones(4, dtype=bool)


def _set(*effects: str, kind: str = "catalogue", parameters: int = 1, taxed: float = 0.0, column: str = "") -> Any:
    fit: Any = SimpleNamespace(theta=np.zeros(parameters), left=1.0)
    return Hypothesis(effects, kind, 0.0, fit, column, taxed)


def _names(*members: tuple[Any, float]) -> dict[tuple[str, ...], float]:
    found = Class(members).names
    assert sum(p for _, p in found) == pytest.approx(sum(p for _, p in members))
    return {h.effects: p for h, p in found}


def test_a_class_is_called_by_what_says_no_more_than_the_likeliest() -> None:
    """With a tenth of its probability at least; formulas where nothing known is among them."""
    a, b, more = _set("a"), _set("b"), _set("c", parameters=2)
    assert _names((a, 0.5), (b, 0.06), (more, 0.4)) == {
        ("a",): pytest.approx(0.96 * 50 / 56), ("b",): pytest.approx(0.96 * 6 / 56)
    }  # fmt: skip
    assert list(_names((a, 0.5), (b, 0.04))) == [("a",)]
    assert list(_names((_set("a", "b", parameters=2), 0.5), (a, 0.1), (b, 0.06))) == [
        ("a",),
        ("b",),
    ]  # a term for nothing
    formula = _set("k*x", kind="expression")
    assert list(_names((formula, 0.5), (a, 0.3))) == [("a",)]
    assert list(_names((formula, 0.5), (_set("k*x**2", kind="expression"), 0.1))) == [("k*x",), ("k*x**2",)]


def test_an_unusual_size_is_no_reason_to_leave_a_name_out() -> None:
    """What it lost to its size is given back; beside effects of such sizes a formula of a fifth is told, too."""
    large, formula = _set("a", taxed=MOST_TAX), _set("k*x", kind="expression")
    usual = _set("b", taxed=MOST_TAX - 0.01)
    assert list(_names((_set("c"), 0.5), (_set("d", taxed=1.0), 0.02))) == [("c",), ("d",)]  # 0.05 / e
    assert list(_names((_set("c"), 0.5), (_set("d", taxed=1.0), 0.018))) == [("c",)]
    assert list(_names((large, 0.5), (formula, 0.1))) == [("a",), ("k*x",)]
    assert list(_names((large, 0.5), (formula, 0.099))) == [("a",)]
    assert list(_names((large, 0.5), (formula, 0.1), (usual, 0.1))) == [("a",), ("b",)]


def _classes(*masses: float, partly: float = 0.0) -> list[Class]:
    found = [Class(((_set(name), mass),)) for name, mass in zip("abc", masses, strict=False)]
    part = ((_set(found[0].members[0][0].effects[0], kind="part", column="load"), partly),) if partly else ()
    return [replace(found[0], parts=part), *found[1:]] if found else []


def _decided(
    monkeypatch: pytest.MonkeyPatch, every: list[Class], p_value: float = 1.0, known: Any = None, as_found: float = 0.0,
    ratio: float = 1.0, **shares: float,
) -> Decision:  # fmt: skip
    def probability(*kinds: str) -> float:
        return sum(shares.get(kind, 0.0) for kind in kinds)

    blamed = Blamed("run", ("seven",)) if shares.get("run", 0.0) > 0.2 else None
    curve = Hypothesis((), "unknown", 0.0, column="speed")
    ranking: Any = SimpleNamespace(
        probability=probability, mishap=lambda names: blamed, hypotheses=(curve,), blind=False, expressions={}
    )
    analysis: Any = SimpleNamespace(missing=True, case=SimpleNamespace(run_names=()))
    monkeypatch.setattr(decide, "classes", lambda *_: every)
    monkeypatch.setattr(
        decide, "left", lambda of, fit: Left(1.0, 1.0, max(p_value, as_found if of is not analysis else 0.0))
    )
    monkeypatch.setattr(decide, "_halving", lambda *_: known)
    noise = SimpleNamespace(ratio=np.array([1.0, ratio]))
    monkeypatch.setattr(decide, "_as_found", lambda analysis, answer: SimpleNamespace(noise=noise))
    monkeypatch.setattr(decide, "_worth", lambda analysis, ranking, top: top)
    return decide.decide(analysis, ranking, 0.05)


def test_what_has_most_mass_is_the_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    def said(every: list[Class], **shares: Any) -> tuple[str, float, str, str]:
        found = _decided(monkeypatch, every, **shares)
        return found.verdict, found.probability, " ".join(e for h in found.told for e in h.effects), found.column

    assert said(_classes(0.8, 0.1), nothing=0.1) == ("missing", pytest.approx(calibrated(0.8)), "a", "")
    assert said(_classes(0.4, 0.3, 0.2)) == ("ambiguous", pytest.approx(calibrated(0.4)), "a b c", "")
    assert said(_classes(0.3), unknown=0.6) == ("unexplained", pytest.approx(0.6), "", "speed")
    assert said(_classes(0.3), unknown=0.6, known=_set("drag")) == ("partial", pytest.approx(0.6), "drag", "speed")
    assert said(_classes(0.3, partly=0.6)) == ("partial", pytest.approx(calibrated(0.6)), "a", "load")
    # what is left is clearly no noise: at a level of 0.05 from a thousandth on
    assert said(_classes(0.8, 0.1), p_value=0.0009) == ("partial", calibrated(0.9991, "unexplained"), "a", "")
    assert said(_classes(0.8, 0.1), p_value=0.0011)[0] == "missing"
    assert said(_classes(0.8, 0.1), p_value=0.0009, as_found=0.5)[0] == "missing"  # noise that was stated too small
    # by more than a user may be wrong: as of a model that leaves so much and raises no alarm
    far = said(_classes(0.8, 0.1), p_value=0.0009, as_found=0.5, ratio=3.01)
    assert far == ("partial", pytest.approx(0.7), "a", "")
    found = _decided(monkeypatch, _classes(0.3), run=0.6, lag=0.05)
    assert (found.verdict, found.blamed, found.probability) == (
        "unexplained", Blamed("run", ("seven",)), pytest.approx(0.6)
    )  # fmt: skip
    found = _decided(monkeypatch, _classes(0.3), run=0.2, lag=0.2)
    assert (found.verdict, found.blamed, found.probability) == ("unexplained", None, pytest.approx(0.4))
    assert len(found.classes) == 1


@pytest.mark.parametrize(
    ("wrong", "ratio", "found"),
    [([0.95], [3.0], True), ([0.95], [9.0], True), ([], [1.0], False), ([0.0], [1.0], False)],
)
def test_noise_is_as_found_where_a_stated_sd_is_off(
    monkeypatch: pytest.MonkeyPatch, wrong: list[float], ratio: list[float], found: bool
) -> None:
    @dataclass(frozen=True)
    class Of:
        case: str
        noise: Any

    noise = SimpleNamespace(wrong=np.array(wrong), ratio=np.array(ratio))
    asked: list[Any] = []
    monkeypatch.setattr(decide, "noise_around", lambda *given, again: asked.append((*given, again)) or noise)
    analysis: Any = Of("case", "stated")
    fit: Any = "answer"
    assert decide._as_found(analysis, fit).noise is (noise if found else "stated")
    assert asked == [("case", "answer", "stated", True)]


@pytest.mark.parametrize("behind", [0.0, STATED])
def test_runs_drawn_anew_are_rows_that_are_repeated(behind: float) -> None:
    """A run that is counted twice is two runs that are alike, one that is not drawn is left out."""
    random = np.random.default_rng(1)
    run = np.repeat(np.arange(5), [4, 6, 5, 7, 4])
    rows = len(run)
    level, residual = random.uniform(0.5, 2.0, (2, rows)), random.standard_normal((2, rows))
    base, columns = random.standard_normal((2, rows, 2)), random.standard_normal((2 * rows, 2))
    nodes = [0, 3, 8, next(i for i, node in enumerate(NODES) if node.drift), len(NODES) // 2]
    nodes = [i for i in nodes if NODES[i].rest is None and not NODES[i].walk and not NODES[i].grow]
    signs, offset = np.array([0.0, 0.0]), np.array([0.5, -1.0])
    linear = Linear(residual, base, np.zeros(base.shape[2]), columns, offset, signs, 0.0)
    sums = Sums(Runs(run, 2, level), linear, behind, nodes)
    weight = np.array([[1.0, 1.0, 1.0, 1.0, 1.0], [2.0, 0.0, 1.0, 2.0, 0.0]])
    found = sums.evidence(weight)
    picks = np.concatenate([np.flatnonzero(run == one) for one in (0, 0, 2, 3, 3)])
    again = np.repeat(np.arange(5), [4, 4, 5, 7, 7])

    def evidence(mine: Array, run: Array) -> float:
        both = np.concatenate([mine, mine + rows])
        at_zero = (residual.reshape(-1) + columns @ offset)[both].reshape(2, -1)
        # of the whole set, orthonormal there
        x = np.linalg.qr(base.reshape(2 * rows, 2))[0][both].reshape(2, -1, 2)
        of = Evidence(Runs(run, 2, level[:, mine]), at_zero, x, behind, nodes)
        taken = np.linalg.slogdet(x.reshape(-1, 2).T @ x.reshape(-1, 2))[1]  # Evidence takes one that is so on its rows
        return float(of.blocks(of.gram(columns[both]), np.array([[0, 1]]), np.zeros((1, 2)))[0] - 0.5 * taken)

    assert found[0] == pytest.approx(evidence(np.arange(rows), run), abs=1e-6)
    plain = [i for i in nodes if not NODES[i].gain]
    assert plain == nodes
    assert found[1] == pytest.approx(evidence(picks, again), abs=1e-6)


def test_log_odds_of_a_block_are_those_of_its_covariance() -> None:
    random = np.random.default_rng(2)
    columns, draws = random.standard_normal((12, 2)), random.standard_normal((12, 3))
    parts = []
    for size in SIZES:
        covariance = np.eye(12) + size**2 * columns @ columns.T
        inverse, determinant = np.linalg.inv(covariance), np.linalg.slogdet(covariance)[1]
        parts.append([0.5 * (d @ d - d @ inverse @ d - determinant) for d in draws.T])
    np.testing.assert_allclose(_log_odds(columns, draws), logsumexp(parts, axis=0) - np.log(len(SIZES)))


def test_correlated_rows_count_by_bartletts_variance() -> None:
    """The variance of a mean square is 2 (1 + r^2) / (1 - r^2) over the rows."""
    assert leftover._independent(100, WHITE) == 100.0
    node = Node(0.5, 0.8, 0.0, 0.0, 1.0)
    lags = np.arange(1, 400)
    expected = 100.0 / (1.0 + 2.0 * (0.4 ** (2 * lags)).sum())
    assert leftover._independent(100, node) == pytest.approx(expected)
    assert allowed(50, WHITE) == pytest.approx(1.0 + 2.0 * np.sqrt(2.0 / 50.0))
    assert allowed(0, WHITE) == pytest.approx(1.0 + 2.0 * np.sqrt(2.0))


def test_an_effect_of_size_0_is_not_there() -> None:
    fitted = [SimpleNamespace(effect=one) for one in (None, "drag", "drag", "gear")]
    fit: Any = SimpleNamespace(model=SimpleNamespace(fitted=fitted), theta=np.array([0.0, 2.0, 0.0, 0.0]))
    assert not absent(fit, ("drag",))  # its size comes first
    assert absent(fit, ("drag", "gear"))
    assert not absent(fit, ("table.load.scale",))
    assert not absent(None, ("gear",))


@pytest.fixture
def errors(monkeypatch: pytest.MonkeyPatch) -> Any:
    """An analysis of 100 rows to train on and 50 held out; a fit is the errors that it leaves on them."""
    train = np.arange(150) < 100

    def error(fit: tuple[float, float], rows: Array, sigma: Array) -> float | None:
        return fit[0] if rows[0] else fit[1]

    for module in (leftover, misfit):
        monkeypatch.setattr(module, "error", error)
    base = SimpleNamespace(whole_runs=False)
    case = SimpleNamespace(train=train, test=~train, base=base, dynamics=None)
    noise = SimpleNamespace(sigma=np.ones(1), node=WHITE, known=np.array([True]))
    return SimpleNamespace(case=case, noise=noise, level=0.05)


def test_a_further_formula_pays_where_the_fall_is_no_chance(errors: Any) -> None:
    """Of half the squares of 50 rows, more than log 20; down to the floor of 1; and at once where much is left."""
    enough = np.log(20.0) / 50.0

    def after(fall: float) -> float:
        return float(np.sqrt(1.15**2 - 2.0 * fall))

    assert pays(errors, (1.0, after(1.01 * enough)), (1.1, 1.15))  # type: ignore[arg-type]
    assert not pays(errors, (1.0, after(0.99 * enough)), (1.1, 1.15))  # type: ignore[arg-type]
    assert not pays(errors, (1.0, 0.2), (1.0, 1.04))  # type: ignore[arg-type]
    assert not pays(errors, (1.0, 1.3), (1.3, 1.3))  # type: ignore[arg-type]
    assert pays(errors, (1.0, 1.29), (1.3, 1.3))  # type: ignore[arg-type]
    assert pays(errors, (1.0, None), (1.0, None))  # type: ignore[arg-type]
    # the noise of 100 and of 50 rows: 1 + 2 sqrt(2 / n)
    train, held = np.sqrt(1.0 + 2.0 * np.sqrt(0.02)), np.sqrt(1.0 + 2.0 * np.sqrt(0.04))
    for before, paid in (((0.999 * train, 0.999 * held), False), ((1.001 * train, 1.0), True),
        ((1.0, 1.001 * held), True)):  # fmt: skip
        assert pays(errors, (1.0, before[1] - 1e-3), before) == paid  # type: ignore[arg-type]
    errors.noise.known = np.array([False])  # the sd may hold what is missing: the ratio counts
    assert pays(errors, (0.5, 0.44), (0.5, 0.44 * 1.12))  # type: ignore[arg-type]
    assert not pays(errors, (0.5, 0.44), (0.5, 0.44 * 1.117))  # type: ignore[arg-type]


def test_beside_a_body_that_leaves_more_than_noise_a_term_brings_a_tenth_of_it(errors: Any) -> None:
    """Of 100 rows with 1.3^2 - 1 = 0.69 and 50 with 1.2^2 - 1 = 0.44: 91, of which the held-out rows bring 1 at least
    in any case; equations of the user's own, and what is at the floor, as ever."""
    before = (1.3, 1.2)

    def after(fall: float) -> tuple[float, float]:
        return float(np.sqrt(1.69 - (fall - 1.0) / 100.0)), float(np.sqrt(1.44 - 1.0 / 50.0))

    for whole, dynamics, paid in ((False, None, True), (True, "x' = x", True), (True, None, False)):
        errors.case.base.whole_runs, errors.case.dynamics = whole, dynamics
        assert pays(errors, after(9.0), before) == paid  # type: ignore[arg-type]
        assert pays(errors, after(9.2), before)  # type: ignore[arg-type]
        assert not pays(errors, (1.0, 1.2), before)  # type: ignore[arg-type]
    enough = 2.0 * np.log(20.0) / 50.0
    for share, paid in ((1.01, True), (0.99, False)):
        held = float(np.sqrt(1.15**2 - share * enough))
        assert pays(errors, (1.0, held), (1.1, 1.15)) == paid  # type: ignore[arg-type]


def test_the_front_goes_on_as_long_as_held_out_rows_gain(errors: Any) -> None:
    def one(effects: str, fit: Any, kind: str = "catalogue") -> Hypothesis:
        return Hypothesis(tuple(effects.split()), kind, 0.0, fit)

    @dataclass(frozen=True)
    class Fit:
        train: float
        held: float | None
        model: Any = None

        def __getitem__(self, place: int) -> float | None:
            return (self.train, self.held)[place]

    whole = {("a", "b"): 0.6}  # of its class, as the verdict has it

    named: dict[tuple[str, ...], Hypothesis] = {}

    def told(*pairs: tuple[Hypothesis, float]) -> list[tuple[str, float]]:
        ranking: Any = SimpleNamespace(probability=lambda kind: 0.1, pairs=lambda: list(pairs))
        return [(" ".join(s.effects), s.probability) for s in front(errors, ranking, np.ones(1), named, whole)]

    errors.fit = Fit(3.0, 3.0)
    original = misfit.absent
    misfit.absent = lambda fit, names: "gone" in names  # type: ignore[assignment]
    try:
        best, second = one("a", Fit(2.0, 2.0)), one("b", Fit(1.0, 1.0))
        two, worse = one("a b", Fit(1.5, 1.9)), one("c d e", Fit(0.5, 1.9))
        assert told((two, 0.5), (best, 0.3), (second, 0.05), (worse, 0.05)) == [("", 0.1), ("a", 0.3), ("a b", 0.6)]
        named[("a",)] = one("law", Fit(2.0, 2.0))  # predicts what a does, and is what both go by
        assert told((best, 0.9)) == [("", 0.1), ("law", 0.9)]
        named.clear()
        assert told((one("a", Fit(1.0, 3.0)), 0.9)) == [("", 0.1)]
        assert told((one("gone", Fit(1.0, 1.0)), 0.9)) == told((one("a", Fit(1.0, 1.0), "part"), 0.9)) == [("", 0.1)]
        errors.fit = Fit(3.0, None)  # nothing is held out: by the training runs
        assert told((one("a", Fit(2.0, None)), 0.9), (one("a b", Fit(2.5, None)), 0.9)) == [("", 0.1), ("a", 0.9)]
    finally:
        misfit.absent = original


def test_a_part_takes_its_share_of_what_is_above_the_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """And leaves the rest, where it stands out most, in the channel that has most of it."""
    u = np.linspace(0.0, 1.0, 400)
    before, after = (
        np.stack([np.full(400, 3.0), np.full(400, 6.0)]),
        np.stack([np.full(400, 1.0), np.where(u > 0.8, 6.0, 0.0)]),
    )
    monkeypatch.setattr(misfit, "_left", lambda analysis, fit: fit)
    monkeypatch.setattr(misfit, "curved", lambda fit: fit is before)
    q = np.random.default_rng(3).permutation(u)
    case = SimpleNamespace(roles={"u": u}, extra={"q": q})
    rows = np.ones(400, dtype=bool)
    analysis: Any = SimpleNamespace(
        case=case, fit=before, rows=rows, model=SimpleNamespace(channels=("f", "g"))
    )  # fmt: skip
    found = part_of(analysis, after, "", np.array([1.0, 2.0]))  # type: ignore[arg-type]
    square = (1.0 + np.mean(after[1] ** 2) / 4.0) / 2.0
    assert found.takes == pytest.approx((9.0 - square) / 8.0)
    assert found.left == pytest.approx(np.sqrt(square))
    assert (found.at.variable, found.at.channel, found.at.mean_residual) == ("u", "g", pytest.approx(3.0))
    assert found.at.low == pytest.approx(0.8, abs=0.01)
    assert part_of(analysis, after, "q", np.array([1.0, 2.0])).at.variable == "q"  # type: ignore[arg-type]
    assert part_of(analysis, after, "x", np.array([1.0, 2.0])).at.variable == "u"  # type: ignore[arg-type]  # a state
    assert not found.together
    assert part_of(analysis, before, "q", np.array([1.0, 2.0])).takes == 0.0  # type: ignore[arg-type]
    assert part_of(analysis, before, "q", np.array([1.0, 2.0])).together  # type: ignore[arg-type]


def test_what_a_column_explains_is_adjusted_for_chance() -> None:
    """One less the variance within eight bins over that of all, each by its degrees of freedom."""
    random = np.random.default_rng(4)
    values = random.permutation(np.arange(160.0))
    change = np.floor(values / 20.0) + random.standard_normal(160)
    bins = np.floor(values / 20.0).astype(int)
    within = sum(((change[bins == b] - change[bins == b].mean()) ** 2).sum() for b in range(8)) / 152.0
    assert explained(change, values) == pytest.approx(1.0 - within / np.var(change, ddof=1))
    assert explained(random.standard_normal(160), values) < 0.1
    assert explained(np.ones(160), values) == 0.0
    assert explained(change, np.ones(160)) == 0.0


@pytest.mark.parametrize("rho", [0.0, 0.5])
def test_settings_that_are_repeated_have_their_misfit_in_common(rho: float) -> None:
    """The F test of lack of fit, with as many rows as are independent."""
    random = np.random.default_rng(5)
    settings, times = 8, 5
    omega = np.tile(np.arange(float(settings)), times)
    run = np.repeat(np.arange(times), settings)
    residual = random.standard_normal((2, 40))
    residual[1] += 0.8 * np.sin(3.0 * omega)
    case = SimpleNamespace(base=SimpleNamespace(whole_runs=False), run=run, roles={"omega": omega})
    noise = SimpleNamespace(node=Node(1.0 if rho else 0.0, rho, 0.0, 0.0, 1.0))
    analysis: Any = SimpleNamespace(case=case, rows=np.ones(40, dtype=bool), noise=noise)
    fit: Any = SimpleNamespace(theta=np.zeros(2))
    shrink = (1.0 - rho**2) / (1.0 + rho**2)
    expected = []
    for channel in residual:
        table = channel.reshape(times, settings)
        above = times * (table.mean(axis=0) ** 2).sum() / (settings - 2)
        within = ((table - table.mean(axis=0)) ** 2).sum() / (settings * (times - 1))
        expected.append(f.sf(above / within, shrink * (settings - 2), shrink * settings * (times - 1)))
    assert leftover._repeated(analysis, fit, residual) == pytest.approx(min(expected))
    exact = np.stack([np.floor(omega), residual[1]])  # equal rows to the last digit: computed, not measured
    assert leftover._repeated(analysis, fit, exact) == pytest.approx(expected[1])
    case.roles = {"omega": omega // 2}
    assert leftover._repeated(analysis, fit, residual) == 1.0  # of four settings it is not asked
    case.roles, case.run = {"omega": omega}, np.zeros(40, dtype=int)
    assert leftover._repeated(analysis, fit, residual) == 1.0  # nor of one run
    case.run, case.base.whole_runs = run, True
    assert leftover._repeated(analysis, fit, residual) == 1.0


def test_doubts_are_of_parameters_that_the_data_pull_beyond_their_bounds() -> None:
    """By three sd of what is left, after what the free ones take; not of a catalogued effect's."""
    random = np.random.default_rng(6)
    free, held = random.standard_normal((2, 1, 60))
    left = 0.5 * random.standard_normal((1, 60))

    def found(size: float, key: str = "k", effect: str | None = None) -> tuple[str, ...]:
        fitted = [SimpleNamespace(key="m", effect=None), SimpleNamespace(key=key, effect=effect)]
        made = SimpleNamespace(name="made", source=FOUND)
        fit: Any = SimpleNamespace(
            model=SimpleNamespace(fitted=fitted, effects=(made,)), at_bound=("k",), residual=left + size * held,
            jacobian=np.stack([free, held], axis=-1),
        )  # fmt: skip
        analysis: Any = SimpleNamespace(case=SimpleNamespace(dynamics=None))
        said = leftover.doubts(analysis, fit)
        assert bool(said) == bool(said.at_bound)
        return said.at_bound

    basis = free[0] / np.sqrt(free[0] @ free[0])
    slope = held[0] - basis * (basis @ held[0])

    def times(size: float) -> float:
        residual = (left + size * held)[0]
        return float(abs(slope @ residual) / np.sqrt(residual @ residual / 59.0 * (slope @ slope)))

    sizes = np.linspace(0.0, 2.0, 400)
    least = next(float(size) for size in sizes if times(size) > 3.0)
    assert found(least) == ("k",)
    assert found(least - 0.006) == ()
    assert found(5.0, effect="drag") == ()
    assert found(5.0, effect="made") == ("k",)  # a formula that was found has scales that nobody measured
    assert found(5.0, key="other") == ()
    assert not Doubts()
    assert Doubts(restless={"f": 3.0})


def _ranking(*given: tuple[Hypothesis, float], columns: dict[str, str] | None = None) -> Ranking:
    return Ranking(
        tuple(h for h, _ in given), np.array([p for _, p in given]), {}, {}, {}, columns or {}
    )  # fmt: skip


def test_a_mishap_is_told_where_it_is_half_of_all_that_may_be_wrong() -> None:
    def run(name: str) -> Hypothesis:
        return Hypothesis((), "run", 0.0, column=name)

    nothing, names = Hypothesis((), "nothing", 0.0), ("one", "two", "three")
    found = _ranking((nothing, 0.4), (run("two"), 0.2), (run("one"), 0.16), (run("three"), 0.01), (_set("a"), 0.23))
    assert found.mishap(names) == Blamed("run", ("two",))
    assert found.probability("run", "nothing") == pytest.approx(0.77)
    less = _ranking((nothing, 0.4), (run("two"), 0.29), (_set("a"), 0.31))
    assert less.mishap(names) is None
    change = _ranking((nothing, 0.1), (Hypothesis((), "change", 0.0, column="three"), 0.7), (_set("a"), 0.2))
    assert change.mishap(names) == Blamed("change", ("two", "three"))
    lag = _ranking((Hypothesis((), "lag", 0.0), 0.7), (run("one"), 0.3))
    assert lag.mishap(names) == Blamed("lag", ())
    assert lag.blind
    assert not change.blind


def test_an_effect_and_a_column_have_the_mass_of_all_that_holds_them() -> None:
    one = _set("a", "e1", kind="mixed", column="load")
    found = _ranking((one, 0.4), (_set("a"), 0.2), (_set("b", kind="part", column="load"), 0.1),
        (_set("e2", kind="expression", column="speed"), 0.2), (Hypothesis((), "unknown", 0.0, column="load"), 0.1),
        columns={"e1": "load", "e2": "speed"})  # fmt: skip
    assert inclusion(found, [], "a") == pytest.approx(0.6)
    assert inclusion(found, [], "e2") == pytest.approx(0.2)
    mixed, plain, part, *_ = found.hypotheses
    same = Class(((plain, 0.2), (mixed, 0.4)), ((part, 0.1),))  # e1 adds nothing to a; a stands beside the curve
    assert inclusion(found, [same], "a") == pytest.approx(0.7)
    assert inclusion(found, [same], "e1") == inclusion(found, [same], "b") == 0.0
    assert inclusion(found, [same], "e2") == pytest.approx(0.2)
    assert found.column_inclusion("load") == pytest.approx(0.4 + 0.1 + 0.1)
    assert found.column_inclusion("speed") == pytest.approx(0.2)
    assert found.pairs()[3][1] == pytest.approx(0.2)


def test_classes_are_of_sets_that_were_refitted_and_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """What predicts the same is one; parts stand with the set that they are of, most mass first."""

    class Apart:
        def __init__(self, analysis: Any, ranking: Any, top: Hypothesis) -> None:
            assert top.effects == ("a", "z")

        def alike(self, first: Hypothesis, other: Hypothesis) -> bool:
            return first.column == other.column

    monkeypatch.setattr(decide, "_Apart", Apart)
    monkeypatch.setattr(decide, "absent", lambda fit, names: "gone" in names)
    unfitted = replace(_set("u", column="x"), fit=None)
    pairs = [
        (Hypothesis((), "nothing", 0.0, _set("a").fit), 0.2), (_set("a", "z", column="x"), 0.2),
        (_set("b", column="y"), 0.15),
        (_set("c", column="x"), 0.1), (_set("d", column="y"), 0.15), (_set("gone", column="x"), 0.1), (unfitted, 0.1),
        (_set("b", kind="part", column="q"), 0.05), (_set("rare", column="y"), 9e-7), (_set("alone", column="x"), 9e-7),
        (_set("alone", kind="part", column="q"), 2e-6), (_set("small", column="x"), 1e-3),
        (_set("z", column="x"), 1e-4),
    ]  # fmt: skip
    ranking: Any = SimpleNamespace(pairs=lambda: pairs)
    analysis: Any = None
    found = decide.classes(analysis, ranking)
    named = [[" ".join(h.effects) for h, _ in one.members] for one in found]
    # what has less than a hundredth of the likeliest joins only a set that it is a part of
    assert named == [["a z", "c", "z"], ["b", "d"], ["small"], ["alone"]]
    assert [one.mass for one in found[:2]] == pytest.approx([0.3001, 0.3])
    assert [one.partly for one in found] == pytest.approx([0.0, 0.05, 0.0, 2e-6])
    ranking.pairs = lambda: [(Hypothesis((), "nothing", 0.0), 1.0)]
    assert decide.classes(analysis, ranking) == []


def test_predictions_are_alike_where_each_reaches_the_other() -> None:
    """By squares of less than two sd; of the sds that the likeliest leaves."""
    apart = decide._Apart.__new__(decide._Apart)
    evidence = Evidence(Runs(np.zeros(6, dtype=int)), np.zeros((1, 6)), np.zeros((1, 6, 0)), 0.0, [0])
    apart.evidence, apart.node, apart.row = evidence, WHITE, 2.0
    unit, across = np.eye(6)[0][None], np.eye(6)[1][None]
    hypotheses = {name: _set(name) for name in "ab"}
    apart.known = {
        id(hypotheses["a"]): (3.0 * unit + across, unit[..., None]),
        id(hypotheses["b"]): (0.0 * unit, np.zeros((1, 6, 0))),
    }
    # from a's way b is 1 across, from b's a is 3 and 1; in sds of 2
    assert apart(hypotheses["b"], hypotheses["a"]) == pytest.approx(1.0 / 4.0)
    assert apart(hypotheses["a"], hypotheses["b"]) == pytest.approx(10.0 / 4.0)
    assert not apart.alike(hypotheses["a"], hypotheses["b"])
    assert not apart.alike(hypotheses["b"], hypotheses["a"])
    apart.row = 3.0
    assert apart.alike(hypotheses["a"], hypotheses["b"])
    apart.evidence = None
    assert apart(hypotheses["a"], hypotheses["b"]) == np.inf


def _push(minimum: float, maximum: float) -> Any:
    return SimpleNamespace(name="push", parameters=(Parameter("a", "N", 0.0, minimum, maximum),))


def test_a_size_that_is_planted_lies_within_its_bounds() -> None:
    """Of an effect that can only be negative a size in sd is; what it cannot be is refused."""
    assert planted._in_bounds(_push(-9.0, 0.0), 3.0, 3.0) == -3.0
    assert planted._in_bounds(_push(-9.0, 0.0), 0.5, 0.5) == -0.5
    assert planted._in_bounds(_push(-9.0, -1.0), 3.0, 3.0) == -3.0
    assert planted._in_bounds(_push(-9.0, 0.0), -3.0, -3.0) == -3.0
    assert planted._in_bounds(_push(0.0, 9.0), 9.0, 9.0) == 9.0
    for low, high, size in ((-9.0, 0.5, 0.7), (-9.0, 0.5, 3.0), (0.0, 9.0, 9.1), (0.0, 9.0, -0.1), (-9.0, 0.0, 9.5)):
        with pytest.raises(UserError, match=r"expected .* to .* N"):
            planted._in_bounds(_push(low, high), size, size)


def test_a_size_that_is_planted_is_read_in_its_unit_or_in_sds() -> None:
    push: Any = _push(-9.0, 9.0)
    assert planted.size_of("2sd", push) == (2.0, True)
    assert planted.size_of(" 0.5 ", push) == (0.5, False)
    assert planted.size_of("-3 kN", push) == (-3000.0, False)
    for text in ("2 sd", "1 m", "many", "infsd", "nan"):
        with pytest.raises(UserError, match="expected a number in N"):
            planted.size_of(text, push)
    assert planted._words("unexplained", ("a",)) == "unexplained"
    assert planted._words("missing", ("expression_2", "a")) == "a + a formula"


def test_a_table_with_an_effect_has_the_noise_that_the_fit_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each run with one sign, larger by the share that a fit takes away; a wave starts anywhere."""

    @dataclass(frozen=True)
    class Case:
        train: Array
        test: Array
        inputs: dict[str, Array]
        channels: dict[str, Array]
        run: Array
        run_names: tuple[str, ...]

    rows = np.arange(10) < 8
    case: Any = Case(rows, np.zeros(10, dtype=bool), {}, {"f": np.arange(10.0)}, np.arange(10) // 2, tuple("abcde"))
    asked: list[Array] = []
    plain = SimpleNamespace(predict=lambda theta: np.full((1, 8), theta[0]))

    def predict(theta: Array) -> Array:
        asked.append(theta)
        return np.full((1, 8), theta[0] + 100.0 * theta[2])

    model = SimpleNamespace(channels=("f",), case=case, bind=lambda inputs, mask: plain)
    model.having = lambda effect: SimpleNamespace(bind=lambda inputs, mask: SimpleNamespace(predict=predict))
    monkeypatch.setattr(planted.Model, "of", lambda case: model)
    phase = Parameter("p", "rad", 0.0, -2.0 * np.pi, 2.0 * np.pi)
    effect: Any = SimpleNamespace(parameters=(Parameter("a", "N", 0.0), Parameter("n", "1", 2.0), phase))
    analysis: Any = SimpleNamespace(fit=SimpleNamespace(theta=np.array([3.0, 1.0])))
    shape: Any = SimpleNamespace(values=(5.0, 0.0))
    found = planted._table(case, analysis, effect, shape, 2.0, np.random.default_rng(1))
    (theta,) = asked
    assert theta[:4].tolist() == [3.0, 1.0, 2.0, 5.0]
    assert theta[4] != 0.0
    assert abs(theta[4]) <= np.pi
    noise = np.arange(8.0) - 3.0
    known = np.flatnonzero(noise)
    ratio = (found.channels["f"][known] - 203.0) / noise[known] * np.sqrt(6.0 / 8.0)
    np.testing.assert_allclose(np.abs(ratio), 1.0)
    for run in range(4):
        assert len(set(np.sign(ratio[case.run[known] == run]))) == 1
    assert found.channels["f"][8:].tolist() == [8.0, 9.0]
    assert case.channels["f"][0] == 0.0


def test_the_size_of_an_effect_is_that_in_its_loudest_channel() -> None:
    """Against its absence, or what comes nearest to it within its bounds."""
    fitted = [SimpleNamespace(effect=None), SimpleNamespace(effect="drag"), SimpleNamespace(effect="drag")]
    x = np.array([1.0, -1.0, 1.0, -3.0])

    def predict(theta: Array) -> Array:
        return np.stack([theta[0] + theta[1] * x, 0.2 * theta[1] * x])

    model = SimpleNamespace(fitted=fitted, lower=np.array([0.0, 0.5, 0.0]), upper=np.full(3, 9.0))
    model.bind = lambda inputs, rows: SimpleNamespace(predict=predict)
    fit: Any = SimpleNamespace(model=model, theta=np.array([2.0, 3.5, 4.0]))
    noise = SimpleNamespace(sigma=np.array([1.0, 0.1]))
    analysis: Any = SimpleNamespace(case=SimpleNamespace(inputs={}), rows=EVERY, noise=noise)
    rms = np.sqrt(np.mean(x**2))
    assert discovery._size(analysis, fit, "drag") == pytest.approx(3.0 * 0.2 / 0.1 * rms)
    noise.sigma = np.array([1.0, 10.0])
    assert discovery._size(analysis, fit, "drag") == pytest.approx(3.0 * rms)


def test_the_column_of_the_likeliest_answers_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    def failure(name: str) -> Any:
        return SimpleNamespace(variable=name, channel="g", gain=4.0)

    shares: dict[str, float] = {}
    monkeypatch.setattr(discovery, "importance", lambda *_: dict(shares))
    monkeypatch.setattr(discovery, "numeric_columns", lambda case: {"q": np.arange(6.0)})
    made: list[Any] = []

    def failure_on(case: Any, name: str, values: Array, scaled: Array, channel: int, *rest: Any) -> Any:
        made.append((values.tolist(), scaled.tolist(), channel, rest[-1]))
        return failure(name)

    monkeypatch.setattr(discovery, "failure_on", failure_on)
    analysis: Any = SimpleNamespace(
        where=[failure("u"), failure("v")], case=None, rows=np.arange(6) % 2 == 0,
        model=SimpleNamespace(channels=("f", "g")), residual=np.ones((2, 3)),
        noise=SimpleNamespace(sigma=np.array([2.0, 4.0])),
    )  # fmt: skip

    def told(top: Any, column: str = "") -> list[str]:
        ranking: Any = None
        return [one.variable for one in discovery._where(analysis, ranking, top, column)]

    top = _set("a")
    assert told(None) == ["u", "v"]
    shares.update(u=0.5, v=0.6)
    assert told(top) == ["v", "u"]
    assert told(None) == ["u", "v"]
    shares.update(u=0.6004, v=0.6)  # as much, to a thousandth: the order of compare
    assert told(top) == ["u", "v"]
    shares.update(q=0.7)
    assert told(top) == ["q", "u", "v"]
    assert made == [([0.0, 2.0, 4.0], [[0.5] * 3, [0.25] * 3], 1, 4.0)]
    assert told(top, "v") == ["v", "u"]
    assert told(top, "a state") == ["q", "u", "v"]
    analysis.where = []
    assert told(top, "v") == []


def test_a_bump_or_waves_of_a_column_are_of_unit_size() -> None:
    """Cosines over its range, slow ones larger, beside a constant; bumps as wide as their distance."""
    values = np.linspace(-3.0, 5.0, 801)
    one = np.ones(801)
    waves = free_curves.Waves("q", "", values, one)
    place = (values + 3.0) / 8.0
    expected = [one, *(np.sqrt(2.0 / k) * np.cos(np.pi * k * place) for k in range(1, 9))]
    np.testing.assert_allclose(waves.at(values).T, expected, atol=1e-12)
    bumps = free_curves.Bump("q", "", values, one)
    found = bumps.at(values)
    assert found.shape == (801, 50)
    np.testing.assert_allclose(np.sqrt((found**2).mean(axis=0)), 1.0)
    assert place[np.argmax(found[:, 7])] == pytest.approx(7.5 / 50.0, abs=1e-3)
    high = found[:, 7] > np.exp(-0.5) * found[:, 7].max()
    assert np.ptp(place[high]) == pytest.approx(2.0 / 50.0, abs=3e-3)
    block = free_curves.Waves("q", "load", values, 2.0 * one).block(1, 3).reshape(3, 801, 9)
    assert not block[[0, 2]].any()
    np.testing.assert_allclose(block[1], 2.0 * waves.at(values))


def test_prior_of_a_set_is_shared_by_its_kinds_of_terms() -> None:
    """0.62 among the catalogue, 0.07 among the constants, 0.03 among the faults, the rest among formulas; sets of two
    in any order."""
    own: Any = SimpleNamespace(
        catalogue=10, suspects={"constant.r": 0, "constant.s": 0}, possible=[0] * 6, faults={"table.x": 0},
        sketches={"e": SimpleNamespace(prior=0.25, scales={"w": 0, "x0": 0})}, razor={},
        kinds=["catalogue", "constant", "fault"],
    )  # fmt: skip

    def prior(*names: str) -> float:
        return Ranker.log_prior(own, names)

    formula = 0.28 * 0.25
    assert prior() == pytest.approx(np.log(0.2))
    assert prior("drag") == pytest.approx(np.log(0.54 * 0.062))
    assert prior("constant.r") == pytest.approx(np.log(0.54 * 0.035))
    assert prior("table.x") == pytest.approx(np.log(0.54 * 0.005))
    assert prior("e") == pytest.approx(np.log(0.54 * formula))
    assert prior("drag", "e") == pytest.approx(np.log(0.19 * 2.0 * 0.062 * formula))
    assert prior("a", "b", "c", "d", "f") == pytest.approx(np.log(0.005 * 120.0 * 0.062**5))
    own.kinds = []
    assert prior("e") == pytest.approx(np.log(0.54 * 0.25))
    own.razor = {frozenset(["a"]): -1.0, frozenset(["b"]): -2.0, frozenset(["a", "c"]): -0.5}
    assert Ranker.lost(own, ("a", "b")) == -3.0
    assert Ranker.lost(own, ("a", "c")) == -0.5
    assert Ranker.lost(own, ("a", "e")) == pytest.approx(-1.0 - 2.0 * ranker.SCALE_COST)


def test_an_effect_is_weighed_by_its_shapes_on_average() -> None:
    shapes: Any = [
        SimpleNamespace(effect=name, columns=np.full((3, count), value)) for name, count, value in
        (("a", 1, 1.0), ("a", 1, 2.0), ("wave", 2, 5.0), ("b", 1, 3.0), ("b", 1, np.nan), ("c", 1, 9.0))
    ]  # fmt: skip
    logs = {1.0: -5.0, 2.0: -4.0, 3.0: -3.0, 9.0: -np.inf}
    beyond: Any = SimpleNamespace(single=lambda columns: np.array([logs[v] for v in columns[0]]))
    found = ranker.by_effect(beyond, shapes)
    assert found == {"a": pytest.approx(np.log(0.5 * (np.exp(-5.0) + np.exp(-4.0)))), "b": pytest.approx(-3.0)}
    assert ranker.by_effect(beyond, shapes[2:3]) == {}
    for lower, upper, sign in ((0.0, 9.0, 1.0), (-9.0, 0.0, -1.0), (-9.0, 9.0, 0.0)):
        one = Shape("a", (), np.ones((3, 1)), 1.0, lower, upper)
        assert ranker._sign(one) == sign


def test_where_a_pair_starts_is_read_off_its_coefficients() -> None:
    phase = Parameter("p", "rad", 0.0, -2.0 * np.pi, 2.0 * np.pi)
    effect = SimpleNamespace(parameters=(Parameter("a", "N", 0.0), phase, Parameter("n", "1", 1.0)))
    own: Any = SimpleNamespace(effects={"wave": effect})
    wave = Shape("wave", (0.0, 3.0), np.ones((4, 2)), 2.0, -np.inf, np.inf)
    name, start = Ranker._start(own, wave, np.array([3.0, 4.0]))
    assert name == "wave"
    np.testing.assert_allclose(start, [10.0, np.arctan2(4.0, 3.0), 3.0])
    # a sine of that phase is what the two columns are together
    x = np.linspace(0.0, 6.0, 20)
    np.testing.assert_allclose(5.0 * np.sin(3.0 * x + start[1]), 3.0 * np.sin(3.0 * x) + 4.0 * np.cos(3.0 * x))
    push = Shape("wave", (0.5, 3.0), np.ones((4, 1)), 2.0, 0.0, 1.5)
    for size, expected in ((1.0, 2.0), (9.0, 3.0), (-1.0, 0.0)):
        np.testing.assert_allclose(Ranker._start(own, push, np.array([size]))[1], [expected, 0.5, 3.0])


def test_of_the_factors_of_a_column_those_that_cannot_be_told_apart_are_named_together() -> None:
    """Odds of 20; an unusual one only beside one that is as unusual."""

    def looked(title: str, alone: float, beside: float = -np.inf, cost: float = 0.0) -> Any:
        return suspect_answers._Looked(
            Fault("t", f"load {title}", "", "", (), (), (), "0", "load", column="load", cost=cost), alone, beside, ""
        )

    def told(*each: Any) -> str:
        return suspect_answers._likeliest(each).fault.title

    a, b, far, odd = looked("is a", 5.0), looked("is b", 0.0, 2.1), looked("is c", 1.9), looked("is d", 4.0, cost=3.0)
    assert told(b, a, far, odd) == "load is a or is b"
    assert told(looked("is e", 6.0, cost=3.0), odd, a) == "load is e or is a or is d"
    assert told(far) == "load is c"


def test_mishaps_share_the_prior_of_their_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    def one(kind: str, run: int | None, count: int) -> Any:
        return SimpleNamespace(kind=kind, run=run, columns=np.zeros((4, count)))

    listed = [one("run", 0, 2), one("run", 2, 2), one("lag", None, 1)]
    logs = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    own: Any = SimpleNamespace(
        analysis=SimpleNamespace(mishaps=listed), runs=SimpleNamespace(runs=4),
        evidence=SimpleNamespace(single=lambda columns: logs), case=SimpleNamespace(run_names=("one", "two", "three")),
    )  # fmt: skip
    found = ranking_._mishaps(own)
    assert [(h.kind, h.column, h.effects) for h in found] == [("run", "one", ()), ("run", "three", ()), ("lag", "", ())]
    expected = [
        logsumexp([1.0, 2.0]) + np.log(0.02 / 4.0),
        logsumexp([3.0, 4.0]) + np.log(0.02 / 4.0),
        5.0 + np.log(0.01),
    ]
    assert [h.log_weight for h in found] == pytest.approx(expected)
    own.runs.runs = 3
    assert ranking_._mishaps(own) == []


def _analysed(missing: bool, rows: int = 6) -> Any:
    @dataclass(frozen=True)
    class Analysed:
        missing: bool
        odd: Array
        told: str = "told"
        noise: str = "noise"
        together: bool = False

    return Analysed(missing, np.zeros(rows, dtype=bool))


@pytest.mark.parametrize(
    ("missing", "alone", "nothing", "looks", "together"),
    [(True, (2, 1, 0), 0.0, 2, False), (True, (0,), 0.0, 0, False), (False, (2,), 1.0, 0, False),
     (False, (2,), 0.0, 0, True), (True, (1, 1, 1, 1, 1, 1, 1), 0.0, None, False)],
)  # fmt: skip
def test_rows_that_stand_alone_beside_an_answer_are_looked_for_again(
    monkeypatch: pytest.MonkeyPatch,
    missing: bool,
    alone: tuple[int, ...],
    nothing: float,
    looks: int | None,
    together: bool,
) -> None:
    """Until there are none; all that were left out are kept in mind, and so is the first look. Where no test shows it
    and the search is sure, the search is told what it found."""

    @dataclass(frozen=True)
    class Case:
        train: Array
        test: Array

    ranked: list[Any] = []
    answer, rows = _set("a"), np.arange(12) < 8
    monkeypatch.setattr(discovery, "analyse", lambda case, seed, level: _analysed(missing, 12))

    def with_curves(analysis: Any, number: int) -> Any:
        known = Hypothesis((), "nothing", 0.0), answer
        return SimpleNamespace(hypotheses=known, probability=lambda kind: nothing, number=number)

    def rank(analysis: Any, report: Any, before: Any = None) -> int:
        ranked.append((analysis, before))
        return len(ranked)

    monkeypatch.setattr(discovery, "rank", rank)
    monkeypatch.setattr(discovery, "with_curves", with_curves)

    def stand_alone(analysis: Any, fit: Any) -> Array:
        assert fit is answer.fit
        count = alone[len(ranked) - 1]
        found = np.zeros(12, dtype=bool)
        found[3 * (len(ranked) - 1) : 3 * (len(ranked) - 1) + count] = True
        return found

    monkeypatch.setattr(discovery, "stand_alone", stand_alone)
    case: Any = Case(rows, ~rows)
    found: Any = discovery.weighed(case, 1, 0.05)
    most = discovery.LOOKS if looks is None else looks
    assert len(ranked) == most + 1 + together
    assert found.whole[0] is ranked[0][0]
    assert ranked[0][1] is None
    assert all(before.number == place for place, (_, before) in enumerate(ranked) if place)
    if looks == 2:
        assert np.flatnonzero(found.analysis.odd).tolist() == [0, 1, 3]
    assert found.analysis.together == together
    assert found.analysis.told == ("noise" if together else "told")


def test_two_ways_to_write_one_curve_are_one_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside the same effects, in the same columns; with the weight of both."""
    curves = {"one": 0.0, "same": 0.0, "other": 5.0}
    columns = {"e1": "u", "e2": "u", "e3": "v", "e4": "u"}
    monkeypatch.setattr(ranking_, "_predicted", lambda ranker, fit: np.full(3, curves[fit.name]))
    monkeypatch.setattr(
        ranking_, "_columns", lambda ranker, one: frozenset(columns[n] for n in one.effects if n in columns)
    )
    own: Any = SimpleNamespace(sketches=columns)

    def answer(effects: str, weight: float, curve: str, kind: str = "expression") -> Hypothesis:
        fit: Any = SimpleNamespace(name=curve)
        return Hypothesis(tuple(effects.split()), kind, weight, fit)

    def merged(*given: Hypothesis) -> list[tuple[str, float]]:
        return [(" ".join(h.effects), h.log_weight) for h in ranking_._merged(own, given)]

    both = np.logaddexp(2.0, 1.0)
    assert merged(answer("e2", 1.0, "same"), answer("e1", 2.0, "one")) == [("e1", pytest.approx(both))]
    assert merged(answer("e2", 2.5, "other"), answer("e1", 2.0, "one"), answer("e4", 1.9, "same")) == [
        ("e1", pytest.approx(np.logaddexp(2.0, 1.9))), ("e2", 2.5)
    ]  # fmt: skip
    assert len(merged(answer("e1", 2.0, "one"), answer("e3", 1.0, "same"))) == 2  # two columns that go together
    assert len(merged(answer("e1", 2.0, "one"), answer("e2", 1.0, "other"))) == 2
    assert len(merged(answer("a e1", 2.0, "one", "mixed"), answer("b e2", 1.0, "same", "mixed"))) == 2
    assert merged(answer("a e1", 2.0, "one", "mixed"), answer("a e2", 1.0, "same", "mixed")) == [
        ("a e1", pytest.approx(both))
    ]  # fmt: skip
    assert len(merged(answer("a", 2.0, "one", "catalogue"), answer("b", 1.0, "same", "catalogue"))) == 2


def test_a_curve_of_a_column_is_told_with_its_size_and_sd() -> None:
    """In the unit of its channel, without its mean: of a wave that is known, near it, by no more than its sds say."""
    random = np.random.default_rng(8)
    u = random.permutation(np.linspace(0.0, 4.0, 240))
    wave = 3.0 * np.cos(2.0 * np.pi * u / 4.0)
    noise = random.standard_normal((2, 240))
    residual = np.stack([noise[0], noise[1] + wave])
    sigma = np.array([1.0, 0.5])
    evidence = Evidence(Runs(np.arange(240) // 20, 2), residual, np.ones((2, 240, 1)), STATED, [0])
    case = SimpleNamespace(roles={}, extra={"u": u}, units={"u": "m", "g": "N"})
    analysis: Any = SimpleNamespace(
        rows=np.ones(240, dtype=bool), case=case, model=SimpleNamespace(channels=("f", "g")),
        noise=SimpleNamespace(sigma=sigma),
    )  # fmt: skip
    found = unexplained.curve(analysis, evidence, "u")
    assert (found.column, found.unit, found.channel, found.channel_unit, found.by) == ("u", "m", "g", "N", "")
    assert (found.x[0], found.x[-1], len(found.x)) == (0.0, 4.0, 121)
    assert found.in_sd == pytest.approx(3.0 / np.sqrt(2.0), rel=0.1)
    assert found.rms == pytest.approx(0.5 * found.in_sd)
    expected = 0.5 * 3.0 * np.cos(2.0 * np.pi * np.array(found.x) / 4.0)
    gap, sd = np.array(found.y) - expected, np.array(found.sd)
    assert np.sqrt(np.mean((gap / sd) ** 2)) < 2.0
    assert 0.5 * np.sqrt(7.0 / 240.0) < np.median(sd) < 0.5 * np.sqrt(14.0 / 240.0)
