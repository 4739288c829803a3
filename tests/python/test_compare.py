"""Compare: verdicts on data whose truth is known, the answer's form, and the level at which it raises an alarm."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from casekit import ROLLING, ar1, dense, rolling, terrapin
from scipy.linalg import null_space
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.adequacy import Adequacy, _p_value, failure_on, where_it_fails
from terrapin_tools.workbench.compare.bayes_factor import WEIGHT, BayesFactor, Block
from terrapin_tools.workbench.compare.comparison import Analysis, analyse, fitted_on
from terrapin_tools.workbench.model.data_columns import DEGREE, column_shapes
from terrapin_tools.workbench.model.fitting import covariance
from terrapin_tools.workbench.model.model import Model
from terrapin_tools.workbench.noise.covariance import Runs
from terrapin_tools.workbench.noise.estimate import repeated_settings
from terrapin_tools.workbench.noise.kinds import ALIKE, Node
from terrapin_tools.workbench.noise.marginal_likelihood import SIZES, STATED

KEYS = {"schema", "case", "model", "parameters", "channels", "adequacy", "where", "verdict", "ladder", "seconds"}


def _analysis(folder: Path, seed: int = 0) -> Analysis:
    return analyse(load_case(folder), seed)


def test_adequate_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 11, rho=0.6)
    status, out, err = terrapin(capsys, "compare", folder, "--json", "-")
    assert (status, err) == (0, "")
    answer = json.loads(out)
    assert answer.keys() >= KEYS
    assert answer["schema"] == "terrapin.case/3"
    assert answer["case"] == "Rolling"
    assert answer["model"] == {"base": "rolling_steady", "effects": []}
    assert answer["verdict"] == "adequate"
    assert answer["where"] == []
    assert answer["adequacy"]["false_alarm_rate"] == 0.05
    assert answer["adequacy"]["p_value"] > 0.05
    assert answer["parameters"]["f_o"]["unit"] == "1"
    assert answer["parameters"]["f_o"]["value"] == pytest.approx(0.09, abs=4 * answer["parameters"]["f_o"]["sd"])
    channel = answer["channels"]["current"]
    assert channel["noise_sd"] == pytest.approx(0.004)
    assert channel["unit"] == "A"
    (rung,) = answer["ladder"]
    assert rung["added"] is None
    assert rung["train_error"] == pytest.approx(channel["train_rmse"] / 0.004)
    assert rung["heldout_error"] == pytest.approx(channel["heldout_rmse"] / 0.004)
    assert 0.75 < rung["train_error"] < 1.25


def test_missing_effect_is_seen_and_placed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 12, heating=0.003, rho=0.5)
    status, out, _ = terrapin(capsys, "compare", folder, "--json", tmp_path / "answer.json")
    answer = json.loads((tmp_path / "answer.json").read_text())
    assert status == 0
    assert answer["verdict"] == "missing"
    assert answer["adequacy"]["p_value"] < 1e-4
    first = answer["where"][0]
    assert first["variable"] == "temperature"
    assert first["channel"] == "current"
    assert 20 <= first["range"][0] < first["range"][1] <= 65
    assert abs(first["mean_residual_in_sd"]) > 1
    assert "Something is missing" in out
    assert "temperature" in out


def test_same_seed_same_bytes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = rolling(tmp_path, 13, heating=0.001)
    answers = []
    for seed in (4, 4, 5):
        _, out, _ = terrapin(capsys, "compare", folder, "--json", "-", "--seed", seed, "--jobs", "2")
        answers.append("\n".join(line for line in out.splitlines() if '"seconds"' not in line))
    assert answers[0] == answers[1]
    assert answers[0] != answers[2]


def test_level_decides_the_verdict(tmp_path: Path) -> None:
    folder = rolling(tmp_path, 14, heating=0.0003, rows=10)
    p = _analysis(folder).adequacy.p_value
    assert 1e-6 < p < 0.9
    case = load_case(folder)
    assert analyse(case, level=min(0.99, p * 1.5)).missing
    assert not analyse(case, level=p / 1.5).missing


def test_noise_from_repeated_settings(tmp_path: Path) -> None:
    text = ROLLING.replace(", sigma = 4.0", "").replace('temperature = { column = "temp", unit = "degF" }\n', "")
    folder = rolling(tmp_path, 15, runs=8, rows=10, text=text)
    lines = (folder / "runs.csv").read_text().splitlines()
    fixed = [lines[0]]
    first: dict[str, list[str]] = {}
    for line in lines[1:]:
        cells = line.split(",")
        start = first.setdefault(cells[0], cells)
        ratio = float(start[1]) / float(cells[1])  # the same speed in every row of a run, and the current that it takes
        torque = 0.09 * 0.08 * float(cells[2]) + 0.012
        omega, before = abs(float(start[1])) * np.pi / 30, abs(float(cells[1])) * np.pi / 30
        shift = 1e-3 * (omega - before) * 0.018 / (0.08 * 0.1) * 1000 * np.sign(float(cells[1]))
        assert abs(ratio - 1) < 0.2
        assert torque > 0
        fixed.append(",".join([cells[0], start[1], *cells[2:4], str(float(cells[4]) + shift), cells[5]]))
    (folder / "runs.csv").write_text("\n".join(fixed) + "\n")
    analysis = _analysis(folder)
    assert "72 repeats" in analysis.noise.source
    assert analysis.noise.sigma[0] == pytest.approx(0.004, rel=0.25)
    assert not analysis.missing


def test_noise_from_the_smoothest_model(tmp_path: Path) -> None:
    text = ROLLING.replace(", sigma = 4.0", "")
    good = _analysis(rolling(tmp_path / "a", 16, text=text))
    assert "smoothest model" in good.noise.source
    assert good.noise.sigma[0] == pytest.approx(0.004, rel=0.2)
    assert not good.missing
    bad = _analysis(rolling(tmp_path / "b", 16, text=text, heating=0.003))
    assert bad.missing
    assert bad.noise.sigma[0] == pytest.approx(0.004, rel=0.3)
    assert bad.ladder[0].train_error > 2


STRAIGHT = """[case]
title = "Straight"
[model]
base = "equation"
[model.equation]
y = "a + b*x"
[fit]
a = { value = 0.0 }
b = { value = 1.0 }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
x = { column = "x", unit = "m" }
y = { column = "y", unit = "N" }
"""


def _straight(folder: Path, rows: Iterable[tuple[object, ...]], text: str = STRAIGHT) -> Path:
    """A case of y over x with rows of run, x, y and a column q that is not mapped."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "case.toml").write_text(text)
    (folder / "runs.csv").write_text("run,x,y,q\n" + "".join(",".join(map(str, row)) + "\n" for row in rows))
    return folder


def test_the_range_that_fails_in_a_column_of_few_levels(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    rows = []
    for run in range(10):
        for i in range(60):
            level = random.choice(7, p=[0.05, 0.2, 0.15, 0.25, 0.15, 0.13, 0.07])  # a converter's codes
            rows.append((f"r{run}", i / 60, 1.0 + i / 30 + (level > 3) + 0.2 * random.standard_normal(), 0.25 * level))
    first = _analysis(_straight(tmp_path, rows, STRAIGHT.replace('"N" }', '"N", sigma = 0.2 }'))).where[0]
    assert (first.variable, first.channel) == ("q", "y")
    assert (first.low, first.high) in ((0.0, 0.75), (1.0, 1.5))
    assert abs(first.mean_residual) > 1.5


def test_polynomials_of_a_column_go_up_to_their_degree(tmp_path: Path) -> None:
    """Where a column has no more levels than that, to what they can tell apart."""
    case = load_case(rolling(tmp_path, 1))
    rows = np.ones(case.rows, dtype=bool)
    levels = np.round(2.0 * np.linspace(-1.0, 1.0, case.rows)) / 2.0  # five
    case = replace(case, extra={**case.extra, "levels": levels})
    shapes = column_shapes(case, rows)
    for name, most in (("humidity", DEGREE), ("levels", min(DEGREE, 4))):
        x = case.extra[name]
        basis = np.vstack([np.ones(case.rows), shapes[name].together]).T
        u = (2.0 * x - x.min() - x.max()) / (x.max() - x.min())
        for k in range(1, most + 1):
            left = u**k - basis @ np.linalg.lstsq(basis, u**k, rcond=None)[0]
            assert np.sqrt(np.mean(left**2)) < 1e-9, (name, k)
    np.testing.assert_allclose(np.mean(shapes["humidity"].together ** 2, axis=1), 1.0)


def test_a_model_is_off_everywhere_when_a_constant_does_most() -> None:
    """Else the range is where a column says; also when no column gains anything, and a channel may have none."""
    u = np.linspace(0.0, 1.0, 400)
    case: Any = SimpleNamespace(roles={"u": u}, library={})
    off, all_rows = np.stack([np.ones(400), np.zeros(400)]), np.ones(400, dtype=bool)

    def ranges(**gain: float) -> list[tuple[str, float, float]]:
        named = {name.replace("_", ":"): value for name, value in gain.items()}
        found = where_it_fails(case, Adequacy(0.0, 9.0, named), off, all_rows, {"u": u}, ("a", "b"))
        return [(one.channel, one.low, one.high) for one in found]

    assert ranges(column_u_0=2.0, constant__0=5.0) == [("a", 0.0, 1.0)]
    for gains in (
        {"column_u_0": 5.0, "constant__0": 2.0},
        {"column_u_0": -3.0},
        {"column_u_0": -3.0, "constant__0": -4.0},
    ):
        ((channel, low, high),) = ranges(**gains)
        assert channel == "a"
        assert high - low <= 0.75
    assert [one[0] for one in ranges(column_u_0=2.0, constant__1=5.0)] == ["a"]


@pytest.mark.parametrize("directed", [True, False])
def test_what_turns_with_the_motion_is_told_so(directed: bool) -> None:
    """Friction that is missing has a mean of zero over both directions: without them it would stand out nowhere."""
    random = np.random.default_rng(4)
    load, omega = np.linspace(10.0, 20.0, 400), random.choice([-3.0, 3.0], 400)
    rows = np.ones(402, dtype=bool)
    rows[[0, 401]] = False  # of the case, and not of those that are looked at
    case: Any = SimpleNamespace(roles={"omega": np.concatenate([[0.0], omega, [0.0]])})
    left = np.where(load > 15.0, 2.0 * (np.sign(omega) if directed else 1.0), 0.0)
    found = failure_on(case, "load", load, left[None], 0, rows, ("current",), 7.0)
    assert found.with_direction == directed
    assert found.low == pytest.approx(15.0, abs=0.3)
    assert found.high == 20.0
    assert found.mean_residual == pytest.approx(2.0, abs=0.2)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("shift", [0.0, 0.1], ids=["repeated settings", "no repeats"])
@pytest.mark.parametrize("curved", [0.0, 0.3])
def test_what_was_computed_has_no_noise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], curved: float, shift: float
) -> None:
    settings = [(run, i + shift * run) for run in range(6) for i in range(8)]
    rows = [(f"r{run}", x, 1.0 + 2.0 * x + curved * x * x, 0) for run, x in settings]
    status, out, err = terrapin(capsys, "discover", _straight(tmp_path, rows), "--json", "-")
    assert (status, err) == (0, "")
    answer = json.loads(out)
    assert "without noise" in answer["noise"]["source"]
    assert 1e-7 < answer["channels"]["y"]["noise_sd"] < 1e-4
    assert answer["ladder"][-1]["heldout_error"] < 0.01
    if curved:
        assert (answer["verdict"], len(answer["missing"])) == ("missing", 1)
        assert answer["candidates"][0]["expression"] == "k*x**2"
        assert answer["candidates"][0]["parameters"]["k"]["value"] == pytest.approx(0.3)
    else:
        assert answer["verdict"] == "adequate"


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_what_was_computed_as_nought(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [(f"r{run}", i, 0, 0) for run in range(6) for i in range(8)]
    status, out, err = terrapin(capsys, "compare", _straight(tmp_path, rows))
    assert (status, err) == (0, "")
    assert "Nothing is missing" in out


def test_repeated_settings_leave_running_roles_out() -> None:
    roles = {
        "omega": np.array([1.0, 1.004, 2.0, 1.5, 1.0]),
        "load": np.array([10.0, 10.0, 20.0, 10.0, 20.0]),
        "time": np.arange(5.0),
    }
    groups = repeated_settings(roles, 5)
    assert groups[0] == groups[1]
    assert len(set(groups.tolist())) == 4


@pytest.mark.parametrize(("given", "rho"), [(True, 0.0), (True, 0.95), (False, 0.9)])
def test_false_alarms(tmp_path: Path, given: bool, rho: float) -> None:
    """Nothing missing, level 5 %: of 20 sets five or more raise an alarm by chance in 0.3 % of trials."""
    text = ROLLING if given else ROLLING.replace(", sigma = 4.0", "")
    alarms = 0
    for seed in range(20):
        case = load_case(rolling(tmp_path, 1000 + seed, runs=8, rows=12, rho=rho, text=text))
        alarms += analyse(case, seed).missing
    assert alarms < 5


def test_bayes_factor_is_that_of_dense_covariances() -> None:
    """The same number from Student's densities of what the model's own parameters leave, written out in full."""
    random = np.random.default_rng(2)
    run = np.repeat([0, 1, 2], [4, 6, 5])
    runs, base = Runs(run), random.standard_normal((1, 15, 2))
    blocks = [
        Block("catalogue", random.standard_normal((15, 1)), 0.7),
        Block("catalogue", random.standard_normal((15, 2)), 0.3),
        Block("run", (run == 1).astype(float)[:, None], 1.0),
    ]
    residual = random.standard_normal((15, 2)) + 2.0 * blocks[0].columns
    found, posterior = BayesFactor(runs, base, blocks, STATED)(residual)
    assert posterior.sum(axis=0) == pytest.approx([1.0, 1.0])
    rest = null_space(base[0].T)
    for one in range(2):
        observed = rest.T @ residual[:, one]
        nothing, something = [], []
        for node in ALIKE:
            prior, noise = np.log(node.prior), rest.T @ dense(runs, node) @ rest

            def density(covariance: np.ndarray, observed: np.ndarray = observed) -> float:
                return float(multivariate_t.logpdf(observed, np.zeros(len(observed)), covariance, STATED))

            nothing.append(prior + density(noise))
            for block in blocks:
                inside = rest.T @ block.columns
                weight = prior + np.log(WEIGHT[block.family] * block.share / len(SIZES))
                something += [weight + density(noise + size**2 * inside @ inside.T) for size in SIZES]
        assert found[one] == pytest.approx(logsumexp(something) - logsumexp(nothing), abs=1e-8)


def test_power_with_correlated_noise(tmp_path: Path) -> None:
    """An effect of about one noise sd (rms) in 12 runs is seen, correlation 0.8 within runs or not."""
    seen = []
    for seed in range(8):
        case = load_case(rolling(tmp_path, 2000 + seed, runs=12, rho=0.8, heating=0.0012))
        seen.append(analyse(case, seed).missing)
    assert sum(seen) >= 7


def test_intervals_cover(tmp_path: Path) -> None:
    """90 % intervals of f_o, noise of correlation 0.8: they hold the truth in 90 % of 200 sets (+- 3 sd)."""
    hits = 0
    for seed in range(200):
        case = load_case(rolling(tmp_path, 3000 + seed, runs=10, rows=8, rho=0.8))
        fit = fitted_on(case, (), case.train, np.array([0.004]))[-1]
        sd = float(np.sqrt(covariance(fit, case.run[case.train], Node(1.0, 0.8, 0.0, 0.0, 1.0))[0][0, 0]))
        hits += abs(fit.theta[0] - 0.09) < 1.645 * sd
    assert 167 <= hits <= 193


def test_what_the_data_do_not_determine_has_no_small_sd(tmp_path: Path) -> None:
    """Of two columns that are one, either may take up anything; a third keeps its sd; an idle one has none."""
    random = np.random.default_rng(5)
    run = np.repeat(np.arange(10), 10)
    columns = random.standard_normal((1, 100, 2))
    case = load_case(rolling(tmp_path, 1))
    fit = fitted_on(case, (), case.train, np.array([0.004]))[-1]
    residual = random.standard_normal((1, 100))

    def sds(jacobian: np.ndarray) -> np.ndarray:
        made = replace(fit, jacobian=jacobian, residual=residual)
        return np.sqrt(np.array([np.diag(c) for c in covariance(made, run, Node(1.0, 0.5, 0.0, 0.0, 1.0))]))

    alone = sds(columns)
    tied = sds(np.concatenate([columns, -3.0 * columns[..., :1], 0.0 * columns[..., :1]], axis=2))
    assert tied[:, 1] == pytest.approx(alone[:, 1], rel=1e-9)
    assert (tied[:, [0, 2]] > 1e4 * alone[:, :1]).all()
    assert (tied[:, 3] > 1e4).all()


SPHERE = """[case]
title = "Sphere"
[model]
base = "sphere_contact"
effects = []
[parameters]
radius = "200 mm"
stress = "linear"
n = 1.0
cohesion = "0.4 kPa"
shear_modulus = "18 mm"
c1 = 0.18
c2 = 0.32
unit_weight = "16 kN/m^3"
n_c = 20
n_gamma = 6
[fit]
k_s = { value = "900 kPa/m", min = 2e4, max = 2e7 }
friction_angle = { value = 0.55, min = 0.35, max = 0.9 }
[data]
files = ["rig.csv"]
run = "run"
[data.columns]
slip = { column = "slip", unit = "%" }
load = { column = "load", unit = "kN" }
traction = { column = "F", unit = "N" }
torque = { column = "T", unit = "N m", sigma = 0.3 }
sinkage = { column = "z", unit = "mm", sigma = 0.5 }
"""


def _sphere(folder: Path, seed: int, xi1: float) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "case.toml").write_text(SPHERE)
    (folder / "rig.csv").write_text("run,slip,load,F,T,z\np0,20,0.1,1,1,1\np1,30,0.2,1,1,1\n")
    random = np.random.default_rng(seed)
    slip = np.repeat(np.round(random.uniform(0.1, 0.9, 15), 3), 3)
    load = np.repeat(random.uniform(80, 350, 15), 3)
    model = Model.of(load_case(folder), ["slip_sinkage"])
    truth = model.bind({"slip": slip, "load": load}).predict(np.array([6e5, 0.65, xi1, 0.4, 2.0]))
    noise = np.array([[1.2], [0.3], [0.0005]]) * random.standard_normal((3, 45))
    rows = truth + noise
    lines = ["run,slip,load,F,T,z"]
    for i in range(45):
        values = (100 * slip[i], load[i] / 1000, rows[0, i], rows[1, i], 1000 * rows[2, i])
        lines.append(",".join([f"p{i // 3:02d}", *(f"{v:.8g}" for v in values)]))
    (folder / "rig.csv").write_text("\n".join(lines) + "\n")
    return folder


def test_sphere_parameters_come_back(tmp_path: Path) -> None:
    good = _analysis(_sphere(tmp_path, 5, 0.0))
    assert not good.missing
    assert np.all(np.abs(good.fit.theta - [6e5, 0.65]) < 4 * good.sd)
    assert good.noise.sigma[0] == pytest.approx(1.2, rel=0.3)
    assert good.model.fitted[0].unit == "Pa/m^1.0"


def test_sphere_that_digs_in(tmp_path: Path) -> None:
    folder = _sphere(tmp_path, 6, 0.6)
    bad = _analysis(folder)
    assert bad.missing
    assert bad.where[0].variable == "slip"
    case = load_case(folder)
    text = case.text.replace("effects = []", 'effects = ["slip_sinkage"]')
    (folder / "case.toml").write_text(text)
    mended = _analysis(folder)
    assert not mended.missing
    assert mended.ladder[1].heldout_error is not None
    assert mended.ladder[1].heldout_error < 1.3
    assert mended.ladder[0].train_error > 1.5 * mended.ladder[1].train_error
    values = dict(zip((f.key for f in mended.model.fitted), mended.fit.theta, strict=True))
    assert values["slip_sinkage.xi2"] == pytest.approx(0.4, abs=0.1)


def test_shipped_table_shows_that_the_torque_is_not_explained() -> None:
    from terrapin_hil.paths import ROOT

    folder = ROOT / "cases" / "forced_slip_sand"
    analysis = _analysis(folder)
    assert analysis.missing
    torque = analysis.residual[analysis.model.channels.index("torque")]
    assert np.sqrt(np.mean(torque**2)) > 3.5  # N m, of some 24
    fits = fitted_on(analysis.case, ("bulldozing", "slip_sinkage"), analysis.case.train, analysis.noise.sigma)
    assert fits[-1].cost == pytest.approx(fits[0].cost, rel=1e-3)  # theory 2 does not mend it
    assert "bulldozing.scale" in fits[-1].at_bound


def test_equation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(8)
    lines = ["run,v,a,F,heat"]
    for run in range(8):
        noise = ar1(random, 15, 0.5)
        for row in range(15):
            v, a = random.uniform(-2, 2), random.uniform(-1, 1)
            force = 3.0 * a + 0.8 * v + 0.5 * v * abs(v) + 0.1 * noise[row]
            lines.append(f"m{run},{v:.6f},{a:.6f},{force:.6f},{random.normal():.4f}")
    (tmp_path / "d.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "case.toml").write_text(
        '[model]\nbase = "equation"\n[model.equation]\nforce = "m*acceleration + fv*velocity"\n'
        '[fit]\nm = { value = 1.0, min = 0.0, max = 100.0, unit = "kg" }\nfv = { value = 1.0, unit = "kg/s" }\n'
        '[data]\nfiles = ["d.csv"]\nrun = "run"\n[data.columns]\nvelocity = { column = "v", unit = "m/s" }\n'
        'acceleration = { column = "a", unit = "m/s^2" }\nforce = { column = "F", unit = "N", sigma = 0.1 }\n'
    )
    _, out, _ = terrapin(capsys, "compare", tmp_path, "--json", "-")
    answer = json.loads(out)
    assert answer["verdict"] == "missing"
    assert answer["where"][0]["variable"] == "velocity"
    assert answer["parameters"]["m"]["unit"] == "kg"
    assert answer["parameters"]["m"]["value"] == pytest.approx(3.0, abs=0.1)


def test_a_p_value_is_never_zero() -> None:
    """The measured set counts as one of those drawn (Davison & Hinkley 1997, eq. 4.11)."""
    null = np.arange(400.0)
    assert _p_value(-1.0, null) == 1.0
    assert _p_value(200.0, null) == pytest.approx(201 / 401)
    assert _p_value(385.0, null) == pytest.approx(16 / 401)
    far = [_p_value(statistic, null) for statistic in (395.0, 420.0, 1000.0)]
    assert 0.0 < far[2] < far[1] < far[0] < 0.05
