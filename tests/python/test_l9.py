"""The orthogonal array in nine runs: Tables 2 and 3 of Li et al. 2024 to the printed digit, and what is refused."""

from __future__ import annotations

import doctest
import json
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from terrapin_tools import cli
from terrapin_tools.experiments import l9
from terrapin_tools.experiments.l9 import ARRAY, LI_2024, analyse, plan


def test_examples() -> None:
    assert doctest.testmod(l9).failed == 0


def test_the_array_is_orthogonal() -> None:
    for one, other in combinations(range(4), 2):
        assert len({(row[one], row[other]) for row in ARRAY}) == 9


def test_table_2_to_the_printed_digit() -> None:
    mass, acceleration, velocity = analyse(LI_2024).factors
    assert [f"{k:.3f}" for k in mass.sums] == ["4.844", "5.591", "6.596"]
    assert [f"{k:.3f}" for k in acceleration.sums] == ["5.035", "5.748", "6.248"]
    assert [f"{k:.3f}" for k in velocity.sums] == ["5.645", "5.670", "5.716"]
    assert [f"{f.range_of_means:.2f}" for f in (mass, acceleration, velocity)] == ["0.58", "0.40", "0.02"]


def test_table_3_to_the_printed_digit() -> None:
    analysis = analyse(LI_2024)
    assert [f"{f.sum_of_squares:.3f}" for f in analysis.factors] == ["0.515", "0.248", "0.001"]
    assert [f"{f.f_ratio:.3f}" for f in analysis.factors] == ["506.835", "243.687", "0.850"]
    assert [f"{f.p_value:.5f}" for f in analysis.factors] == ["0.00197", "0.00409", "0.54040"]
    assert [f"{f.p_value:.3f}" for f in analysis.factors] == ["0.002", "0.004", "0.540"]
    assert f"{analysis.error_squares:.3f}" == "0.001"
    assert analysis.total_squares == pytest.approx(0.764912, abs=5e-7)
    assert (analysis.error_degrees, round(analysis.critical_f, 2)) == (2, 19.0)
    assert [round(ratio) for _, ratio, _ in analysis.pooled] == [548, 263]
    squares = sum(f.sum_of_squares for f in analysis.factors) + analysis.error_squares
    assert squares == pytest.approx(analysis.total_squares, rel=1e-12)


def test_two_degrees_of_freedom_do_not_support_the_papers_optimum() -> None:
    analysis = analyse(LI_2024)
    assert [name.split()[0] for name in analysis.order] == ["mass", "joint", "maximum"]
    said = " ".join(analysis.conclusions)
    assert "maximum joint angular velocity [rad/s]: F = 0.850 is below 19.0; no effect is shown" in said
    assert "2 degrees of freedom" in said
    assert "No run was repeated" in said


def test_pure_noise_is_called_significant_as_often_as_stated() -> None:
    rng = np.random.default_rng(5)
    p = [f.p_value for _ in range(700) for f in analyse(replace(LI_2024, response=tuple(rng.normal(size=9)))).factors]
    assert abs(np.mean(np.array(p) < 0.05) - 0.05) < 0.015  # 3 sd of 2,100 draws


def test_left_out_runs() -> None:
    """Of an additive response without error the others give the same means; a level without runs has none."""
    steps = [
        {v: k * (n + 1) for n, v in enumerate(levels)}
        for k, levels in zip((3.0, 1.0, 0.5), LI_2024.levels, strict=True)
    ]
    noise = [0.01, -0.02, 0.0, 0.02, 0.01, -0.01, 0.0, -0.01, 0.01]
    exact = [sum(step[v] for step, v in zip(steps, run, strict=True)) for run in LI_2024.settings]
    response = tuple(e + n for e, n in zip(exact, noise, strict=True))
    whole = analyse(replace(LI_2024, response=response))
    one = analyse(replace(LI_2024, response=(99.0, *response[1:]), left_out=(0,)))
    assert [f.range_of_means for f in one.factors] == pytest.approx([f.range_of_means for f in whole.factors], abs=0.05)
    assert (one.error_degrees, one.order) == (1, whole.order)
    assert "Left out: run 1, ended by something else." in one.conclusions
    two = analyse(replace(LI_2024, response=response, left_out=(0, 5)))
    assert two.error_degrees == 0
    assert np.isnan([f.f_ratio for f in two.factors]).all()
    assert two.order == whole.order
    three = analyse(replace(LI_2024, response=response, left_out=(6, 7, 8)))
    assert np.isnan(three.factors[0].range_of_means)
    assert three.order == whole.order[1:]
    assert "there is no F" in " ".join(three.conclusions) or three.error_degrees == 1


def test_what_is_no_l9_is_refused() -> None:
    swapped = list(LI_2024.settings)
    swapped[0], swapped[1] = (8.3, 0.3, 1.25), (8.3, 0.4, 1.0)
    with pytest.raises(ValueError, match="found a pair of levels twice"):
        analyse(replace(LI_2024, settings=tuple(swapped)))
    with pytest.raises(ValueError, match="found 8 runs, expected 9"):
        analyse(replace(LI_2024, settings=LI_2024.settings[:8]))
    with pytest.raises(ValueError, match="not finite"):
        analyse(replace(LI_2024, response=(float("nan"), *LI_2024.response[1:])))
    with pytest.raises(ValueError, match="expected one to compare with"):
        analyse(replace(LI_2024, response=tuple(row[0] for row in LI_2024.settings)))
    with pytest.raises(ValueError, match="for factor 2, expected 3 different levels"):
        plan([(1, 2, 3), (1, 1, 3), (1, 2, 3)])


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["terrapin", "experiment", "l9", *arguments])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return int(stop.value.code or 0)


def test_command_prints_tables_and_json(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(monkeypatch) == 0
    words = capsys.readouterr().out
    assert "506.835" in words
    assert "R 0.58" in words
    assert run(monkeypatch, "--json", "-") == 0
    assert json.loads(capsys.readouterr().out)["factors"][1]["f_ratio"] == pytest.approx(243.687, abs=5e-4)


def test_command_plans_and_reads_back(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    factors = ["mass [kg]=7.7,8.0,8.3", "acceleration=0.3,0.4,0.5", "velocity=1,1.125,1.25"]
    assert run(monkeypatch, *(part for f in factors for part in ("--factor", f))) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "mass [kg],acceleration,velocity,response"
    file = tmp_path / "runs.csv"
    file.write_text("\n".join([lines[0], *(f"{line}{k * k}" for k, line in enumerate(lines[1:]))]) + "\n")
    assert run(monkeypatch, str(file)) == 0
    assert "mass [kg]" in capsys.readouterr().out
    file.write_text("a,b,c,y\n1,2,3,x\n")
    assert run(monkeypatch, str(file)) == 2
    error = capsys.readouterr().err
    assert error.startswith("terrapin: runs.csv:2: column y: found text 'x'")
    assert error.count("\n") == 1
    assert run(monkeypatch, "--factor", "mass") == 2
    assert "expected NAME=LEVEL,LEVEL,LEVEL" in capsys.readouterr().err
