"""Groups: a fitted parameter with one value for each surface, robot or day, and whether these differ."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.compare.groups import differences
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.model.model import Model
from tests.python.casekit import one_line, terrapin
from tests.python.test_ode import TEXT, spring

SLIDE = """[case]
title = "Sled"
[model]
base = "equation"
[model.equation]
pull = "mu*load + drag*speed"
[fit]
mu = { value = 0.3, min = 0.0, max = 2.0, by = "surface" }
drag = { value = 1.0, min = 0.0 }
[groups]
surface = { column = "surface" }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
load = { column = "load", unit = "N" }
speed = { column = "speed", unit = "m/s" }
pull = { column = "pull", unit = "N", sigma = 0.5 }
"""
SURFACES = ("sand", "ice", "turf")


def sled(
    folder: Path,
    frictions: tuple[float, ...],
    text: str = SLIDE,
    seed: int = 3,
    drags: tuple[float, ...] = (2.0, 2.0, 2.0),
) -> Path:
    """Runs r00, r01, ... on sand, ice, turf in turn."""
    random = np.random.default_rng(seed)
    lines = ["run,load,speed,pull,surface"]
    for run in range(12):
        surface = run % 3
        for _ in range(12):
            load, speed = random.uniform(20, 60), random.uniform(0.1, 2)
            pull = frictions[surface] * load + drags[surface] * speed + 0.5 * random.standard_normal()
            lines.append(f"r{run:02d},{load:.8g},{speed:.8g},{pull:.8g},{SURFACES[surface]}")
    folder.mkdir(parents=True)
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(text)
    return folder


def test_each_group_has_its_value(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frictions = (0.6, 0.1, 0.4)
    folder = sled(tmp_path / "case", frictions)
    status, out, _ = terrapin(capsys, "compare", folder, "--json", "-")
    assert status == 0
    answer = json.loads(out)
    assert answer["verdict"] == "adequate"
    found = answer["groups"]["mu"]
    assert (found["by"], found["unit"]) == ("surface", "1")
    assert found["p_value"] < 1e-12
    for surface, truth in zip(SURFACES, frictions, strict=True):
        one = found["values"][surface]
        assert abs(one["value"] - truth) < 4.0 * one["sd"] < 0.05
        assert answer["parameters"][f"mu[{surface}]"]["value"] == one["value"]
    assert abs(answer["parameters"]["drag"]["value"] - 2.0) < 4.0 * answer["parameters"]["drag"]["sd"]
    assert "mu differs by surface (p < 1e-12): ice < turf < sand" in terrapin(capsys, "compare", folder)[1]


def test_discover_tells_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = sled(tmp_path / "case", (0.6, 0.1, 0.4))
    compared, discovered = (
        json.loads(terrapin(capsys, command, folder, "--json", "-")[1]) for command in ("compare", "discover")
    )
    assert discovered["groups"] == compared["groups"]


def test_without_groups_their_difference_is_one_of_runs(tmp_path: Path) -> None:
    """The same data with one value for all: the model fails."""
    text = SLIDE.replace(', by = "surface"', "")
    found = analyse(load_case(sled(tmp_path / "case", (0.6, 0.1, 0.4), text)))
    assert found.missing or found.noise.node.of_runs


def test_equal_groups_are_told_apart_as_often_as_stated(tmp_path: Path) -> None:
    """24 cases without a difference: p below 0.05 in at most 5 (a right test has more once in 200)."""
    below = 0
    for seed in range(24):
        case = load_case(sled(tmp_path / str(seed), (0.4, 0.4, 0.4), seed=seed))
        below += differences(analyse(case))[0].p_value < 0.05
    assert below <= 5


def test_the_derivatives_are_those_of_the_prediction(tmp_path: Path) -> None:
    case = load_case(sled(tmp_path / "case", (0.6, 0.1, 0.4)))
    bound = Model.of(case).bind(case.inputs, case.train)
    theta = np.array([0.2, 0.5, 0.3, 1.5])
    prediction, slopes = bound.jacobian(theta)
    np.testing.assert_array_equal(prediction, bound.predict(theta))
    for column in range(4):
        step = np.zeros(4)
        step[column] = 1e-5
        quotient = (bound.predict(theta + step) - bound.predict(theta - step)) / 2e-5
        np.testing.assert_allclose(slopes[..., column], quotient, atol=1e-6)


def test_groups_of_differential_equations(tmp_path: Path) -> None:
    """One spring for each robot; the rest is shared. They are the same, and found so."""
    text = TEXT.replace('unit = "N/m" }', 'unit = "N/m", by = "robot" }')
    folder = spring(tmp_path / "case", text=text + '[groups]\nrobot = { column = "robot" }\n')
    head, *rows = (folder / "runs.csv").read_text().splitlines()
    rows = [f"{row},{'b' if int(row[1]) % 2 else 'a'}" for row in rows]
    (folder / "runs.csv").write_text("\n".join([f"{head},robot", *rows]) + "\n")
    found = analyse(load_case(folder))
    assert not found.missing
    (one,) = differences(found)
    assert one.p_value > 0.01
    for name in "ab":
        assert abs(one.values[name] - 8.0) < 4.0 * one.sds[name] < 4.0


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('by = "surface"', 'by = "ground"', r"case\.toml:8: fit\.mu\.by: found 'ground', expected one of surface"),
        ('[groups]\nsurface = { column = "surface" }\n', "", r"by: found 'surface', expected a name of \[groups\]"),
        ('column = "surface"', 'column = "ground"', r"groups\.surface\.column: column 'ground' is not in runs\.csv"),
        ('column = "surface"', 'column = "load"', r"column: found '.*' and '.*' in run r00, expected one"),
        ('column = "surface" }', 'column = "surface", text = 1 }', r"groups\.surface\.text: unknown name, expected"),
    ],
)  # fmt: skip
def test_wrong_groups(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert old in SLIDE
    with pytest.raises(UserError, match=expected) as found:
        load_case(sled(tmp_path / "case", (0.4, 0.4, 0.4), SLIDE.replace(old, new, 1)))
    assert "\n" not in str(found.value)


def test_a_group_of_one_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = sled(tmp_path / "case", (0.4, 0.4, 0.4))
    with (folder / "runs.csv").open("a") as file:
        file.write("a00,30,1,14,mud\n")
    status, _, err = terrapin(capsys, "compare", folder)
    assert status == 2
    one_line(err, ["case.toml:11: groups.surface.column: group 'mud' has 1 row to train on, expected at least 2"])


def test_a_single_group(tmp_path: Path) -> None:
    folder = sled(tmp_path / "case", (0.4, 0.4, 0.4))
    text = (folder / "runs.csv").read_text()
    for surface in SURFACES:
        text = text.replace(f",{surface}\n", ",ground\n")
    (folder / "runs.csv").write_text(text)
    with pytest.raises(UserError, match="surface has the one group 'ground', expected two or more"):
        load_case(folder)


def test_a_group_that_no_parameter_has_is_found_missing(tmp_path: Path) -> None:
    """Factors from run to run used to take it up, and the group that the case declares was not asked."""
    text = SLIDE.replace(', by = "surface"', "")
    found = discover(load_case(sled(tmp_path / "case", (0.6, 0.4, 0.4), text)))
    formulas = [c.effect.expression for c in found.candidates if c.effect.name in found.missing]
    assert any("surface_sand" in formula for formula in formulas)
    assert discover(load_case(sled(tmp_path / "null", (0.4, 0.4, 0.4), text))).verdict == "adequate"


@pytest.mark.parametrize("by", ["", ', by = "surface"'])
def test_groups_are_columns(tmp_path: Path, by: str) -> None:
    shared = load_case(sled(tmp_path / "shared", (0.6, 0.1, 0.4), SLIDE.replace(', by = "surface"', by)))
    assert {"surface_sand", "surface_ice", "surface_turf"} <= shared.extra.keys()
    assert shared.extra["surface_ice"].mean() == pytest.approx(1.0 / 3.0)


def test_what_else_differs_between_groups_is_found(tmp_path: Path) -> None:
    """The friction has a value for each surface already; the drag is larger on ice, and nobody has said so."""
    found = discover(load_case(sled(tmp_path / "case", (0.6, 0.1, 0.4), drags=(2.0, 3.0, 2.0))))
    formulas = [c.effect.expression for c in found.candidates if c.effect.name in found.missing]
    assert (found.verdict, len(formulas)) == ("missing", 1)
    assert "surface_ice" in formulas[0]
