"""Expressions for effects that no catalogue has: shapes, units, sums, equations, steps; and what they may not claim."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "campaigns"))

from discovery_cases import Made, make

from terrapin_hil.physics.expression import parse
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.compare.comparison import analyse, error
from terrapin_tools.workbench.discover.discovery import Discovery, discover
from terrapin_tools.workbench.formulas.vocabulary import product_text, shapes
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.marginal_likelihood import STATED, Evidence
from terrapin_tools.workbench.story.told import told
from tests.campaigns import misled


def rolling(target: str, text: str, column: str, seed: int, size: float = 3.0, runs: int = 18) -> Made:
    """The first case of steady rolling from this seed on that has the columns of the expression."""
    for attempt in range(30):
        random = np.random.default_rng([seed, attempt])
        found = make("rolling_steady", (), runs, 0.0, size, random, expression=(target, text, column))
        if found is not None:
            return found
    raise AssertionError("no case in 30 has the column")


def named(found: Discovery) -> list[str]:
    """Formulas of what is said to be missing."""
    by_name = {c.effect.name: c.effect.expression for c in found.candidates}
    return [by_name[name] for name in found.missing]


def spring(folder: Path, hidden: str, size: float, seed: int, sigma: str = ", sigma = 0.5") -> Case:
    """A spring and damper in equations with units; `hidden` is in the measured force, its rms `size` noise sd."""
    random = np.random.default_rng(seed)
    runs, rows = 12, 25
    run = np.repeat(np.arange(runs), rows)

    def each(low: float, high: float) -> np.ndarray:
        return np.repeat(random.uniform(low, high, runs), rows)

    t = np.tile(0.1 * np.arange(rows), runs)
    amplitude, rate, phase = each(0.02, 0.1), each(2, 8), each(0, 6)
    x, v = amplitude * np.sin(rate * t + phase), amplitude * rate * np.cos(rate * t + phase)
    oil = each(15, 35)
    extra = parse(hidden).evaluate({"x": x, "v": v, "t": t, "oil": oil})
    noise = random.standard_normal(len(run))
    force = 900.0 * x + 25.0 * v + 0.5 * (size * extra / np.sqrt(np.mean(extra**2)) + noise)
    lines = ["run,x,v,t,oil,force"]
    for i in range(len(run)):
        values = (x[i], v[i], t[i], oil[i], force[i])
        lines.append(",".join([f"m{run[i]:02d}", *(f"{value:.8g}" for value in values)]))
    folder.mkdir()
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(
        f"""[case]
title = "spring"
[model]
base = "equation"
[model.equation]
force = "stiffness*x + damping*v"
[fit]
stiffness = {{ value = 500.0, min = 0.0, max = 1e5, unit = "N/m" }}
damping = {{ value = 10.0, min = 0.0, max = 1e4, unit = "N s/m" }}
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
x = {{ column = "x", unit = "m" }}
v = {{ column = "v", unit = "m/s" }}
t = {{ column = "t", unit = "s" }}
force = {{ column = "force", unit = "N"{sigma} }}
"""
    )
    return load_case(folder)


def test_a_saturating_quotient_is_told_from_other_bends(tmp_path: Path) -> None:
    """v/(|v| + x0) has no tail like tanh: named as what it is, with its scale."""
    found = discover(spring(tmp_path / "x", "v/(abs(v) + 0.15)", 20.0, seed=3))
    assert named(found) == ["k*v/(abs(v) + x0)"]
    fit = next(c.fit for c in found.candidates if c.effect.name in found.missing)
    scale = dict(zip((f.key for f in fit.model.fitted), fit.theta, strict=True))[f"{found.missing[0]}.x0"]
    assert scale == pytest.approx(0.15, rel=0.15)


@pytest.mark.parametrize(
    ("parts", "text"),
    [
        (("k", "omega", "sign(omega)"), "k*abs(omega)"),
        (("k", "sign(omega)*sqrt(abs(omega))", "sign(omega)"), "k*sqrt(abs(omega))"),
        (("k", "load", "load*sign(omega)"), "k*load**2*sign(omega)"),
        (("k", "1/x", "y"), "k*(1/x)*y"),
        (("k", "1/x**2", ""), "k*(1/x**2)"),
        (("k", "omega**2", "sign(omega)"), "k*omega**2*sign(omega)"),
    ],
)
def test_formulas_are_written_as_one_would(parts: tuple[str, str, str], text: str) -> None:
    random = np.random.default_rng(1)
    values = {name: random.uniform(0.5, 2.0, 9) * random.choice([-1.0, 1.0], 9) for name in ("omega", "load", "x", "y")}
    values["k"] = np.full(9, 2.0)
    whole = product_text(*parts)
    assert whole == text
    by_hand = values["k"] * parse(f"({parts[1]})").evaluate(values) * parse(parts[2] or "1").evaluate(values)
    assert parse(whole).evaluate(values) == pytest.approx(by_hand)


@pytest.mark.parametrize(("low", "high"), [(30.0, 70.0), (-8.0, 8.0), (0.0, 50.0), (-5.0, -1.0)])
def test_every_shape_is_a_number_on_its_column(low: float, high: float) -> None:
    values = np.linspace(low, high, 50)
    for term in shapes("x", values, "m"):
        numbers = parse(term.text).evaluate({"x": values, **term.starts})
        assert np.isfinite(numbers).all(), term.text
        assert 0.0 < term.prior <= 1.0
        for scale in term.scales.values():
            for start in (scale.start, *scale.grid):
                assert scale.low <= start <= scale.high, term.text


def test_what_falls_with_a_distance_may_fall_with_its_square() -> None:
    far = {term.text: term.prior for term in shapes("x", np.linspace(1.0, 7.0, 50), "m")}
    assert far["1/x**2"] < far["1/x"] < far["x"]
    assert not any(term.text.startswith("1/") for term in shapes("x", np.linspace(0.0, 7.0, 50), "m"))


@pytest.mark.parametrize(("low", "high"), [(0.0, 0.5), (0.2, 0.5), (-0.5, 0.0), (-0.5, 0.5)])
def test_in_a_column_of_one_sign_its_sign_is_nothing(low: float, high: float) -> None:
    """|x| is x there and sign(x) a constant: said beside each other, the one law would be taken for two."""
    found = {term.text for term in shapes("x", np.linspace(low, high, 50), "m")}
    assert ("sign(x)" in found) == ("abs(x)" in found) == (low * high < 0.0)
    assert any("sign(" in text for text in found) == (low * high < 0.0)
    if low >= 0.0:
        assert not any("abs(" in text for text in found)


@pytest.mark.parametrize(
    ("target", "text", "column", "seed"),
    [
        ("resistance", "k*humidity**2*sign(omega)", "humidity", 1),
        ("resistance", "k*(board_temp - 33)*sign(omega)", "board_temp", 2),
        ("resistance", "k*abs(omega)", "omega", 3),
        ("resistance", "k*(humidity > 52)*sign(omega)", "humidity", 4),
        ("current", "k*exp(-time/3)", "time", 5),
    ],
)
def test_finds_what_no_catalogue_has(target: str, text: str, column: str, seed: int) -> None:
    case = rolling(target, text, column, seed)
    found = discover(case.case)
    assert found.verdict == "missing"
    assert any(column in formula for formula in named(found))
    after = error(found.ladder[-1].fit, case.case.test, found.analysis.noise.sigma)
    assert after is not None
    assert after < 1.2  # noise sd; the held-out error of the true model is 1 give or take 0.1
    assert found.ladder[0].heldout_error is not None
    assert found.ladder[0].heldout_error > 1.1 * after


def test_a_deviation_from_a_reference_may_as_well_be_an_offset() -> None:
    """k*(humidity - x0), and an offset of the current beside k*humidity: no data tell them apart, so both are told."""
    found = discover(rolling("current", "k*(humidity - 42)", "humidity", seed=78, size=4.0).case)
    assert named(found) == ["k*(humidity - x0)"]
    told_too = " ".join(told(found.analysis, found).notes)
    assert "does exactly what" in told_too
    assert "current_offset" in told_too
    assert "k*humidity in" in told_too


def test_where_no_column_varies_a_constant_may_be_missing(tmp_path: Path) -> None:
    """A balance that is read again and again: the library holds no column, but a constant on the channel."""
    random = np.random.default_rng(4)
    rows = [f"r{i // 12},20,{9.0 + 0.1 * random.standard_normal():.6g}" for i in range(96)]
    (tmp_path / "runs.csv").write_text("\n".join(["run,load,reading", *rows]) + "\n")
    (tmp_path / "case.toml").write_text(
        '[model]\nbase = "equation"\n[model.equation]\nreading = "gain*load"\n[parameters]\ngain = 0.5\n'
        '[data]\nfiles = ["runs.csv"]\nrun = "run"\n[data.columns]\nload = { column = "load", unit = "N" }\n'
        'reading = { column = "reading", unit = "N", sigma = 0.1 }\n'
    )
    assert discover(load_case(tmp_path)).analysis.missing


def test_every_formula_that_is_told_can_be_added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A set beside a curve may stand far down the list of which formulas were fitted alone: `terrapin add` of what was
    told ended with "unknown effect expression_12"."""
    monkeypatch.setattr("terrapin_tools.workbench.discover.ranking.SHOWN", 0)
    found = discover(spring(tmp_path / "case", "x**3", 5.0, seed=12))
    assert found.missing
    assert set(found.missing) <= {c.effect.name for c in found.candidates}


def test_a_reference_may_lie_outside_what_was_measured() -> None:
    """The oil was never as cold as where its friction begins: k*oil**2, which was told at 0.97, is another curve."""
    record = misled.one("tie", 8, 11)
    assert (record["verdict"], record["missing"]) == ("missing", ["k*(oil - x0)"])
    assert record["right"]


@pytest.mark.parametrize("hidden", ["x**3", "sign(v)*max(abs(v) - 0.25, 0)", "v*abs(v)", "oil*v"])
def test_equations_get_expressions_in_their_columns(tmp_path: Path, hidden: str) -> None:
    case = spring(tmp_path / "case", hidden, 2.5, seed=7)
    found = discover(case)
    assert found.verdict in ("missing", "ambiguous")  # the square of what hardly varies is a rival, and says so
    (formula,) = named(found)
    assert parse(hidden).names & parse(formula).names
    assert found.ladder[-1].heldout_error is not None
    assert found.ladder[-1].heldout_error < 1.15


@pytest.mark.parametrize("seed", [5, 6, 7, 8])
def test_a_parameter_that_goes_with_a_column_is_seen(tmp_path: Path, seed: int) -> None:
    """A stiffness that falls with the oil's temperature: no column alone shows it. A stiffness that differs from run to
    run by chance does, too: that it goes with the oil is what 14 runs show, not their rows. Whether the damping goes
    with it these runs hardly show."""
    found = discover(spring(tmp_path / "case", "oil*x", 2.5, seed=seed))
    assert found.analysis.adequacy.p_value < 1e-3
    formulas = {c.effect.name: (c.effect.target, c.effect.expression) for c in found.candidates}
    target, formula = formulas[found.missing[0]]
    assert (target, formula) == ("force", "k*oil*x") or (target == "gain_of_force" and formula.startswith("k*(oil - 2"))
    assert ("force", "k*oil*x") in [formulas[name] for names in found.rivals for name in names]


def plates(folder: Path, seed: int) -> Path:
    """Pressure over sinkage under plates of three sizes, whose exponent goes with the size, against one exponent."""
    random, lines = np.random.default_rng(seed), ["run,size,z,p"]
    for size in (60.0, 80.0, 100.0):
        for repeat in range(3):
            z = np.linspace(2.0, 25.0, 14) + 0.2 * random.standard_normal(14)
            p = 1.4 * z ** (0.5 + 0.005 * size) + 0.8 * random.standard_normal(14)
            lines += [f"s{size:g}_{repeat},{size},{a:.5g},{b:.5g}" for a, b in zip(z, p, strict=True)]
    folder.mkdir()
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(
        '[model]\nbase = "equation"\n[model.equation]\np = "k*z**n"\n'
        "[fit]\nk = { value = 1, min = 0, max = 100 }\nn = { value = 1, min = 0.1, max = 3 }\n"
        '[data]\nfiles = ["runs.csv"]\nrun = "run"\n[data.columns]\nz = { column = "z", unit = "mm" }\n'
        'size = { column = "size", unit = "mm" }\np = { column = "p", unit = "kPa", sigma = 0.8 }\n'
    )
    return folder


def test_an_exponent_that_goes_with_a_column_is_named(tmp_path: Path) -> None:
    folder = plates(tmp_path / "case", 2)
    found = discover(load_case(folder))
    told = [found.missing, *found.rivals]
    targets = {(found.ranking.expressions[name].target, found.ranking.columns[name]) for one in told for name in one}
    assert ("n", "size") in targets, told
    assert found.ladder[-1].heldout_error is not None
    assert found.ladder[-1].heldout_error < 1.2
    # and as the user's own
    text = (folder / "case.toml").read_text()
    own = '[effect.by_size]\nexpression = "c*size"\ntarget = "n"\nc = { value = 0.0, unit = "1/mm" }\n'
    (folder / "case.toml").write_text(text.replace('"equation"', '"equation"\neffects = ["by_size"]', 1) + own)
    assert analyse(load_case(folder)).ladder[-1].train_error < 1.2
    # from a start beside which nothing fits, the fit goes on from the model without the effect
    far = text.replace('"equation"', '"equation"\neffects = ["by_size"]', 1) + own.replace("value = 0.0", "value = 0.2")
    (folder / "case.toml").write_text(far)
    assert analyse(load_case(folder)).ladder[-1].train_error < 1.2
    (folder / "case.toml").write_text(text + own.replace('"n"', '"m"'))
    with pytest.raises(UserError, match="target: found 'm', expected one of p, k, n"):
        load_case(folder)


def test_units_of_an_expression_are_sound(tmp_path: Path) -> None:
    case = spring(tmp_path / "case", "v*abs(v)", 3.0, seed=3)
    found = discover(case)
    (name,) = found.missing
    effect = next(c.effect for c in found.candidates if c.effect.name == name)
    units = {"x": "m", "v": "m/s", "t": "s", **{p.name: p.unit for p in effect.parameters}}
    given = parse(effect.expression).unit(units)
    assert given.dimensionality == parse("force").unit({"force": "N"}).dimensionality


def test_two_terms_where_the_heldout_runs_pay_for_them(tmp_path: Path) -> None:
    case = spring(tmp_path / "case", "20*x**3/0.001 + 0.7*sign(v)*(1 + 0.0*t) + 0.03*oil", 5.0, seed=11)
    found = discover(case)
    assert found.verdict == "missing"
    assert 2 <= len(found.missing) <= 3
    assert found.ladder[-1].heldout_error is not None
    assert found.ladder[-1].heldout_error < 1.15


def test_one_term_stays_one_term(tmp_path: Path) -> None:
    case = spring(tmp_path / "case", "x**3", 5.0, seed=12)
    assert len(discover(case).missing) == 1


def test_columns_may_have_the_names_of_an_expressions_parameters() -> None:
    for name in ("k", "w", "tau", "x0"):
        values = np.linspace(1.0, 9.0, 40)
        for term in shapes(name, values, "m", {name, "other"}):
            assert name not in term.scales
            assert np.isfinite(parse(term.text).evaluate({name: values, **term.starts})).all()


@pytest.mark.parametrize(("low", "high"), [(1.0, 7.0), (-8.0, 8.0), (0.0, 50.0)])
def test_every_shape_is_sound_in_its_units(low: float, high: float) -> None:
    for unit in ("m/s", "degC", "rad", "1"):
        for term in shapes("x", np.linspace(low, high, 50), unit):
            scales = {key: scale.unit for key, scale in term.scales.items()}
            parse(term.text).unit({"x": unit, **scales})  # ValueError where kinds mix


def test_evidence_of_single_columns_is_that_of_blocks_of_one() -> None:
    random = np.random.default_rng(4)
    run = random.permutation(np.repeat(np.arange(7), 9))
    base = random.standard_normal((2, 63, 3)) * np.array([1e-5, 1.0, 1e4])
    evidence = Evidence(Runs(run, 2), random.standard_normal((2, 63)), base, STATED)
    columns = random.standard_normal((126, 20))
    picks = np.arange(20)[:, None]
    blocks = evidence.blocks(evidence.gram(columns), picks, np.zeros((20, 1)))
    assert evidence.single(columns) == pytest.approx(blocks, abs=1e-8)
