"""A named set is held to the noise floor, an expression beside effects must pay, and words and numbers agree."""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "campaigns"))

from casekit import terrapin
from discovery_cases import Made, make

from terrapin_hil.paths import ROOT
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import Analysis, analyse, error, fitted_on
from terrapin_tools.workbench.compare.thinned import step_of
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.discover.leftover import absent, allowed, left, pays
from terrapin_tools.workbench.model.constants import value_of
from terrapin_tools.workbench.model.fitting import Fit
from terrapin_tools.workbench.noise.kinds import Node
from terrapin_tools.workbench.story.terminal import tell
from terrapin_tools.workbench.story.told import told

Array = npt.NDArray[np.float64]
BOTH = ("speed_squared", "motor_heating")


def _line(folder: Path, x: Array, y: Array, sigma: str = "", other: Array | None = None) -> Path:
    """A case of a straight line through y over x, in eight runs, and a column `other` that is not mapped."""
    columns = [np.arange(len(x)) * 8 // len(x), x, y, *([] if other is None else [other])]
    rows = "".join(",".join(map(str, row)) + "\n" for row in zip(*columns, strict=True))
    (folder / "runs.csv").write_text("run,x,y" + (",other" if len(columns) > 3 else "") + "\n" + rows)
    (folder / "case.toml").write_text(
        '[case]\ntitle = "Line"\n[model]\nbase = "equation"\n[model.equation]\ny = "a + b*x"\n'
        "[fit]\na = { value = 0 }\nb = { value = 1 }\n"
        '[data]\nfiles = ["runs.csv"]\nrun = "run"\n'
        f'[data.columns]\nx = {{ column = "x", unit = "m" }}\ny = {{ column = "y", unit = "N"{sigma} }}\n'
    )
    return folder


@pytest.fixture(scope="module")
def two() -> tuple[Made, Analysis, list[Fit]]:
    """A case that lacks two effects of 4 noise sd, and fits with none, one and both of them."""
    found = next(
        c for i in range(20) if (c := make("rolling_steady", BOTH, 14, 0.0, 4.0, np.random.default_rng([3, i])))
    )
    analysis = analyse(found.case)
    return found, analysis, fitted_on(found.case, BOTH, found.case.train, analysis.noise.sigma)


def test_the_whole_set_leaves_noise_and_a_part_of_it_does_not(two: tuple[Made, Analysis, list[Fit]]) -> None:
    _, analysis, (nothing, one, both) = two
    assert analysis.missing
    assert left(analysis, nothing).p_value < 0.1  # each run has one speed: no single effect explains such offsets
    assert left(analysis, one).clearly(0.05)
    assert not left(analysis, both).clearly(0.05)


def test_an_sd_that_nobody_could_state_so_is_left_over() -> None:
    """No shape in any column: the sum of squares alone tells only what no estimate of an sd is off by."""
    plain = next(c for i in range(20) if (c := make("rolling_steady", (), 14, 0.0, 0.0, np.random.default_rng([4, i]))))
    sigma = {channel: sd / 3.0 for channel, sd in plain.sigma.items()}
    analysis = analyse(replace(plain.case, sigma=sigma))
    assert left(analysis, analysis.fit).clearly(0.05)
    slightly = analyse(replace(plain.case, sigma={channel: sd / 1.5 for channel, sd in plain.sigma.items()}))
    assert not left(slightly, slightly.fit).clearly(0.05)


def test_an_expression_below_the_floor_does_not_pay(two: tuple[Made, Analysis, list[Fit]]) -> None:
    case, analysis, (nothing, one, both) = two
    assert pays(analysis, one, nothing)
    assert pays(analysis, both, one)
    assert not pays(analysis, one, both)
    # the same two fits with a noise sd that makes the smaller one good enough
    held, train = error(one, case.case.test, analysis.noise.sigma), error(one, case.case.train, analysis.noise.sigma)
    assert held is not None
    assert train is not None
    coarse = replace(analysis, noise=replace(analysis.noise, sigma=analysis.noise.sigma * max(held, train)))
    coarse = replace(coarse, noise=replace(coarse.noise, known=np.ones(1, dtype=bool)))
    assert not pays(coarse, both, one)
    # where that sd is an estimate, it may hold what the further effect explains
    estimated = replace(coarse, noise=replace(coarse.noise, known=np.zeros(1, dtype=bool)))
    assert pays(estimated, both, one)
    assert not pays(estimated, one, both)


def test_mean_square_that_noise_allows() -> None:
    """Bartlett: the mean square of correlated noise scatters as that of fewer independent rows."""
    random = np.random.default_rng(5)
    noise = random.standard_normal((400, 2000))
    for row in range(1, 400):
        noise[row] = 0.8 * noise[row - 1] + 0.6 * noise[row]
    above = (noise * noise).mean(axis=0) > allowed(400, Node(1.0, 0.8, 0.0, 0.0, 1.0))
    assert 0.005 < above.mean() < 0.06


def test_the_shipped_table_names_the_radius_that_would_reconcile_it() -> None:
    """Its five runs lie far from the model: no answer is likely. Among those told is the radius, with what would be
    left, and what speaks against it."""
    found = discover(load_case(ROOT / "cases" / "forced_slip_sand"))
    assert found.analysis.missing
    assert found.verdict == "ambiguous"
    assert found.answer_probability < 0.5
    assert found.where[0].variable == "slip"
    with_radius = next(h for h in found.ranking.hypotheses if "constant.radius" in h.effects and h.fit)
    assert with_radius.effects in found.rivals
    assert with_radius.fit is not None
    radius = value_of(with_radius.fit, "constant.radius")
    assert 0.28 < radius < 0.34  # m; 0.22 as stated
    words = " ".join(tell(told(found.analysis, found)).split())
    assert f"radius would be {radius:.3g} m" in words
    assert f"Against it: {round(100 * (radius / 0.22 - 1))} % from what is stated and more than noise is left." in words


def test_what_an_expression_says_is_told_where_none_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    random = np.random.default_rng(3)
    x = np.tile(np.linspace(0.0, 4.0, 60), 10)
    y = 1.0 + x + np.sin(5.0 * x) + 0.2 * random.standard_normal(len(x))  # a wave is no short expression
    folder = _line(tmp_path, x, y, ", sigma = 0.2")
    text = (folder / "case.toml").read_text()
    (folder / "case.toml").write_text(text.replace('"m"', '"degC"'))  # along a position it would have its period
    status, out, _ = terrapin(capsys, "discover", folder, "--json", tmp_path / "answer.json")
    answer = json.loads((tmp_path / "answer.json").read_text())
    assert (status, answer["verdict"]) == (0, "unexplained")
    first = answer["candidates"][0]
    assert f"{first['effect']} = {first['expression']}, added to y" in out


def test_an_effect_of_size_zero_is_not_there() -> None:
    case = load_case(ROOT / "cases" / "forced_slip_sand")
    fits = fitted_on(case, ("bulldozing", "slip_sinkage"), case.train, np.array([1.4, 0.42]))
    assert absent(fits[1], ("bulldozing",))
    assert not absent(fits[0], ())


def test_words_do_not_contradict_the_probability() -> None:
    plain = next(c for i in range(20) if (c := make("rolling_steady", (), 10, 0.0, 0.0, np.random.default_rng([6, i]))))
    found = discover(plain.case)
    assert found.verdict == "adequate"
    assert found.answer_probability > 0.5
    sure = told(found.analysis, found)
    assert sure.headline.startswith("The model is adequate: with probability")
    assert (sure.chip, sure.headline in tell(sure).replace("\n", " ")) == ("adequate", True)
    doubtful = tell(told(found.analysis, replace(found, answer_probability=0.0)))
    assert "adequate" not in doubtful
    assert "Nothing is missing" not in doubtful
    assert "probability below 0.01" in doubtful
    story = told(found.analysis, replace(found, answer_probability=0.3))
    assert (story.verdict, story.chip) == ("adequate", "no alarm")
    assert story.headline.startswith("No alarm")
    assert "only probability 0.30" in story.headline


def test_settings_that_can_show_nothing_make_no_model_adequate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    random = np.random.default_rng(2)
    x = np.repeat([0.0, 1.0], 20)  # two settings, and a straight line through them
    status, out, _ = terrapin(capsys, "discover", _line(tmp_path, x, 1 + x + 0.1 * random.standard_normal(40)))
    assert status == 0
    assert "adequate" not in out
    assert "could not show it either" in out
    assert discover(load_case(tmp_path)).answer_probability < 0.5


def test_a_wave_that_passes_for_noise_is_no_root_of_time(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    time = np.tile(np.arange(200) / 50.0, 8)
    x = random.random(len(time))
    y = 3.0 * np.sin(10.0 * time) + 0.1 * random.standard_normal(len(time))
    found = discover(load_case(_line(tmp_path, x, y, other=time)))
    assert not found.missing
    if (
        found.verdict == "adequate"
    ):  # rows a correlation length apart raise no alarm; then it is said that this is no proof
        assert "only probability" in told(found.analysis, found).headline
        assert found.answer_probability < 0.5
    else:
        assert found.verdict == "unexplained"


def test_what_rows_between_those_that_are_taken_show_is_not_lost(tmp_path: Path) -> None:
    """Neighbours are alike, so one row of five is looked at; of what changes from row to row all rows know far more."""
    random = np.random.default_rng(2)
    time = np.tile(np.arange(300) / 50.0, 8)
    drive, noise = random.standard_normal(len(time)), np.zeros(len(time))
    for i in range(1, len(time)):
        noise[i] = 0.9 * noise[i - 1] + 0.44 * drive[i]
    x = random.random(len(time))
    case = load_case(_line(tmp_path, x, 0.3 * noise + 0.03 * np.sign(x - 0.7), other=time))
    assert step_of(case, analyse(replace(case, test=np.zeros_like(case.test))).noise.node) > 1
    assert analyse(case).missing


def test_bootstrap_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "heated"
    shutil.copytree(ROOT / "cases" / "heated_motor", folder, ignore=shutil.ignore_patterns(".terrapin"))
    status, out, _ = terrapin(capsys, "discover", str(folder), "--bootstrap", "50", "--json", str(tmp_path / "a.json"))
    assert status == 0
    assert "motor_heating, runs drawn anew" in out
    selected = json.loads((tmp_path / "a.json").read_text())["selected"]
    assert selected[0]["effects"] == ["motor_heating"]
    assert sum(one["frequency"] for one in selected) == pytest.approx(1.0)
    status, _, said = terrapin(capsys, "discover", str(folder), "--bootstrap", "-1")
    assert status == 2
    assert "--bootstrap: found -1" in said


@pytest.mark.parametrize("curve", [0.0, 1.0])
@pytest.mark.parametrize("sigma", ["", ", sigma = 0.1"])
def test_a_case_without_free_parameters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], curve: float, sigma: str
) -> None:
    """Nothing is fitted: the tables of parameters are empty, and what is missing is found all the same."""
    random = np.random.default_rng(1)
    lines = ["run,x,y"]
    for run in range(8):
        for x in random.uniform(-2.0, 2.0, 10):
            lines.append(f"r{run},{x:.5f},{2 * x + curve * x * abs(x) + 0.1 * random.standard_normal():.5f}")
    (tmp_path / "d.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "case.toml").write_text(
        '[model]\nbase = "equation"\n[model.equation]\ny = "k*x"\n[parameters]\nk = 2.0\n[data]\nfiles = ["d.csv"]\n'
        f'run = "run"\n[data.columns]\nx = {{ column = "x" }}\ny = {{ column = "y"{sigma} }}\n'
    )
    status, out, _ = terrapin(capsys, "compare", tmp_path)
    assert status == 0
    assert "Parameters" not in out
    status, out, _ = terrapin(capsys, "discover", tmp_path, "--json", "-", "--bootstrap", "3")
    assert status == 0
    answer = json.loads(out)
    assert answer["parameters"] == {}
    assert answer["verdict"] == ("missing" if curve else "adequate")
    assert terrapin(capsys, "report", tmp_path, "-o", tmp_path / "page.html")[0] == 0
