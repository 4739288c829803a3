"""Cohesion and friction angle from a driven wheel: coverage of the regions, what is refused, case files, command."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from terrapin_hil import paths
from terrapin_tools import cli
from terrapin_tools.soil.region import deviance, explore, limit, single, strengths
from terrapin_tools.soil.tactile import Noise, Points, Rig, Unsolved, fit, predict, strength
from tests.campaigns.tactile import LEVELS, LOADS, NOISE, RIG, TRUTH, WEIGHT, coverage, measured, settings

CASE = paths.ROOT / "cases" / "driven_rig_sand"
EXACT = Noise(1e-6, 1e-6, 1e-6, 1e-6)


def command(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["terrapin", "soil", "tactile", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


@pytest.fixture
def case(tmp_path: Path) -> Path:
    return Path(shutil.copytree(CASE, tmp_path / "case"))


def pick(points: Points, rows: slice) -> Points:
    return Points(points.load[rows], points.drawbar[rows], points.torque[rows], points.slip[rows], points.sd[rows])


def test_the_settings_are_the_drawbar_levels() -> None:
    true = settings()
    assert true.shape == (12, 4)
    load = np.repeat(WEIGHT * np.array(LOADS), len(LEVELS))
    assert true[:, 0] == pytest.approx(load, rel=1e-9)
    assert true[:, 1] == pytest.approx(load * np.tile(LEVELS, len(LOADS)), abs=1e-8 * load.max())
    assert true[2, 3] == pytest.approx(0.4687, abs=1e-4)  # the published soil at no drawbar pull
    assert true[2, 2] == pytest.approx(0.321692, abs=2e-6)
    assert true[:, 3].max() < 0.9


@pytest.mark.parametrize("linear", [False, True])
def test_without_noise_the_truth_comes_back(linear: bool) -> None:
    rig = Rig(RIG.radius, RIG.width, RIG.k_c, RIG.k_phi, RIG.exponent, linear)
    truth = np.array([1500.0, np.radians(25.0), 0.018, 1.1])
    theta = np.linspace(0.3, 0.7, 12)
    slip = np.tile(np.linspace(0.1, 0.8, 4), 3)
    points = Points.of(*predict(rig, truth, theta, slip).T, EXACT)
    best = fit(rig, points, (500.0, 0.6, 0.03, 1.0), (True, True, True, True))
    assert best.q == pytest.approx(truth, rel=2e-4)
    assert best.theta == pytest.approx(theta, rel=1e-5)
    assert best.squares < 1e-3


def test_regions_cover_the_truth() -> None:
    """Short form of tests/campaigns/tactile.py, where 1,000 campaigns cover in 93.5 to 96.5 %."""
    found = coverage(120, modulus_free=False, stated=True, seed=1)
    assert 0.88 <= found.share <= 0.995  # 95 % of 120: 3.5 sd on the low side, and not always
    assert found.cohesion_sd == pytest.approx(0.072, rel=0.25)  # what the linearised design promises
    assert found.friction_sd == pytest.approx(0.012, rel=0.25)


def test_the_truth_stands_at_its_own_deviance() -> None:
    points = measured(settings(), NOISE, np.random.default_rng(5))
    best = fit(RIG, points, (1000.0, 0.6, 0.025, 1.0))
    assert deviance(RIG, points, best, (float(best.q[0]), float(best.q[1])), 0.0) == pytest.approx(0.0, abs=1e-5)
    region = explore(RIG, points, best, stated=True)
    assert region.identified
    assert region.limit == pytest.approx(5.991, abs=1e-3)
    for corner in region.outline[::8]:
        rise = deviance(RIG, points, best, (float(corner[0]), float(corner[1])), 0.0)
        assert rise == pytest.approx(region.limit, rel=0.02)
    interval = region.intervals["cohesion"]
    assert interval.high - interval.low == pytest.approx(2 * 1.96 * interval.sd, rel=0.1)
    assert region.outline[:, 0].max() > interval.high  # two together reach farther than one alone
    assert limit(best, 2, stated=False) > best.squares / best.degrees * 5.99  # F is wider than chi squared


def test_one_point_and_one_load_do_not_tell_the_two_apart() -> None:
    points = measured(settings(), NOISE, np.random.default_rng(3))
    same_load = pick(points, slice(0, 4))
    best = fit(RIG, same_load, (1000.0, 0.6, 0.025, 1.0))
    assert not explore(RIG, same_load, best, stated=True).identified
    true = settings()
    theta = np.array([np.radians(24.798)])
    sigma, tau, most = strength(RIG, TRUTH, theta, true[2:3, 3])
    one = single(RIG, pick(points, slice(2, 3)), np.array([500.0, 0.5, 0.025, 1.0]))
    assert one.low < most[0] < one.high
    # the valley's direction at the published soil, dphi/phi = -0.276 dc/c, is a normal stress of c / 0.1927
    assert one.normal_stress == pytest.approx(700.0 / 0.1927, rel=0.02)
    assert one.shear_strength == pytest.approx(
        700.0 + one.normal_stress * np.tan(TRUTH[1]), abs=4 * one.shear_strength_sd
    )
    assert one.margin == pytest.approx(1.0 - tau[0] / most[0], abs=4 * one.margin_sd)
    assert sigma[0] > one.normal_stress


def test_straight_stresses_fix_tau_max_itself() -> None:
    rig = Rig(RIG.radius, RIG.width, RIG.k_c, RIG.k_phi, RIG.exponent, linear=True)
    points = measured(settings(rig), NOISE, np.random.default_rng(4))
    one = single(rig, pick(points, slice(2, 3)), np.array([500.0, 0.5, 0.025, 1.0]))
    assert one.high - one.low < 0.12 * one.tau_max  # c and phi act only through it
    true = settings(rig)
    best = fit(rig, Points.of(*true.T, EXACT), (500.0, 0.5, 0.025, 1.0))
    assert one.low < strengths(rig, points, best).tau_max[2] < one.high


def test_a_ground_that_cannot_carry_is_named() -> None:
    soft = Rig(0.08, 0.15, 0.0, 1e3, 1.1)
    with pytest.raises(Unsolved, match=r"load: found 18\.\d+ N, more than this ground carries"):
        fit(soft, Points.of(*settings().T, NOISE), (500.0, 0.5, 0.025, 1.0))


def test_the_command_on_the_example(
    case: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = case / "region.png"
    assert command(monkeypatch, str(case), "--json", str(case / "soil.json"), "--plot", str(picture)) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    words = capsys.readouterr().out
    answer = json.loads((case / "soil.json").read_text())
    assert answer["schema"] == "terrapin.soil_tactile/1"
    assert answer["identified"]
    low, high = answer["parameters"]["cohesion"]["interval"]
    assert low < 700.0 < high
    low, high = answer["parameters"]["friction_angle"]["interval"]
    assert low < np.radians(30.0) < high
    assert answer["fit"]["p_value"] > 0.01
    assert len(answer["region"]["outline"]["cohesion"]) == 40
    assert [p["verdict"] for p in answer["traversability"]["points"]] == ["holds"] * 12
    assert [round(p["load"] / WEIGHT) for p in answer["traversability"]["most_drawbar_pull"]] == [1, 2, 4]
    assert "profile likelihood" in words


def test_a_single_observation_is_refused_and_gives_tau_max(
    case: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (CASE / "points.csv").read_text().splitlines()
    (case / "points.csv").write_text("\n".join([lines[0], lines[3]]) + "\n")
    assert command(monkeypatch, str(case), "--json", "-", "--plot", str(case / "no.png")) == 0
    captured = capsys.readouterr()
    assert "nothing to draw: one operating point cannot tell" in captured.err
    assert not (case / "no.png").exists()
    answer = json.loads(captured.out)
    assert not answer["identified"]
    assert answer["parameters"] is None
    assert "cannot tell cohesion from friction" in answer["reason"]
    assert answer["tau_max"]["range"][0] < 4559.0 < answer["tau_max"]["range"][1]
    assert answer["tau_max"]["fixed"]["sd"] < 0.03 * answer["tau_max"]["fixed"]["shear_strength"]


def test_noise_that_is_not_stated_is_taken_from_the_scatter(
    case: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (case / "case.toml").read_text()
    begin, end = text.index("[noise]"), text.index("[data]")
    (case / "case.toml").write_text(text[:begin] + text[end:])
    assert command(monkeypatch, str(case), "--json", "-") == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["region"]["kind"] == "F"
    assert answer["fit"]["p_value"] is None
    low, high = answer["parameters"]["cohesion"]["interval"]
    assert low < 700.0 < high


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('base = "driven_wheel"', 'base = "cmr"', "model.base: found 'cmr', expected driven_wheel"),
        ('radius = "80 mm"', 'radius = "-80 mm"', "parameters.radius: found -0.08 m, expected more than 0"),
        ('"1528 kN/m^3"', '"1528 kN/m^4"', "parameters.k_phi: 'kN/m^4' does not convert to 'Pa/m'"),
        ("n = 1.1", "n = 11", "parameters.n: found 11, expected at most 3"),
        ('shear_modulus = "25 mm" ', 'shear_modulus = "2 m" ', "parameters.shear_modulus: found 2 m, expected 0.0001"),
        ('shear_modulus = "25 mm" ', "", "parameters: shear_modulus is missing, expected it here or in [fit]"),
        ('torque = "1 %" ', "", "noise: torque is missing, expected all four or no table"),
        ("slip = 0.01", "slip = 0", "noise.slip: found 0, expected more than 0"),
        ('column = "torque_mNm"', 'column = "T"', "data.columns.torque: column 'T' is not in points.csv"),
        ('unit = "mN m"', 'unit = "mN"', "data.columns.torque.unit: 'mN' does not convert to 'N m'"),
    ],
)
def test_a_wrong_case_is_one_line(
    case: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    old: str,
    new: str,
    message: str,
) -> None:
    text = (case / "case.toml").read_text()
    assert old in text
    (case / "case.toml").write_text(text.replace(old, new))
    assert command(monkeypatch, str(case)) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("18.6,0.1,300,0.91", "points.csv:14: slip: found 0.91, expected at most 0.9: beyond it the shear stress is"),
        ("18.6,0.1,300,1.2", "points.csv:14: slip: found 1.2, expected -1 to 1"),
        ("-18.6,0.1,300,0.2", "points.csv:14: load: found -18.6 N, expected more than 0 N"),
        ("18.6,0.1,nan,0.2", "points.csv:14: column torque_mNm: found NaN"),
        ("18.6,0.1,300000,0.2", "sd (rms), expected about 1: no soil comes near these points; check units"),
        ("1e6,0.1,300,0.2", "load: found 1e+06 N, more than this ground carries at any sinkage"),
    ],
)
def test_a_wrong_row_is_named(
    case: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], row: str, message: str
) -> None:
    with (case / "points.csv").open("a") as file:
        file.write(row + "\n")
    assert command(monkeypatch, str(case)) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert message in captured.err
    assert not captured.out


def test_other_commands_say_whose_case_it_is(
    case: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["terrapin", "compare", str(case)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert "found 'driven_wheel', which is for terrapin soil tactile" in capsys.readouterr().err


def test_a_wrong_stiffness_is_said_and_can_be_freed(
    case: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (case / "case.toml").read_text().replace('"1528 kN/m^3"', '"1375.2 kN/m^3"').replace('"24 kN', '"21.6 kN')
    (case / "case.toml").write_text(text)
    assert command(monkeypatch, str(case)) == 0
    assert "MORE than the noise has: the model is wrong" in capsys.readouterr().out
    (case / "case.toml").write_text(text.replace('stiffness_sd = "0 %"', 'stiffness_sd = "10 %"'))
    assert command(monkeypatch, str(case), "--json", "-") == 0
    answer = json.loads(capsys.readouterr().out)
    low, high = answer["parameters"]["stiffness_factor"]["interval"]
    assert low < 1.0 / 0.9 < high
    low, high = answer["parameters"]["cohesion"]["interval"]
    assert low < 700.0 < high
    assert answer["fit"]["p_value"] > 0.01
