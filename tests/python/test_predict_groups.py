"""A prediction for runs of a group: any rows of any groups, also of one alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import terrapin_tools as terrapin

SOILS = {"clay": 0.40, "sand": 0.55}


def sled(**beside: Any) -> dict[str, Any]:
    random, run = np.random.default_rng(0), np.repeat(np.arange(8), 30)
    load, soil = random.uniform(50.0, 150.0, 240), np.array(["clay", "sand"])[run % 2]
    pull = np.array([SOILS[one] for one in soil]) * load + random.normal(0.0, 0.5, 240)
    return {"run": run, "soil": soil, "load [N]": load, "pull [N]": pull, **beside}


def grouped(table: dict[str, Any], **more: Any) -> terrapin.Case:
    order = {"run": "run", "equation": {"pull": "mu*load"}, "fit": {"mu": (0.3, 0, 2, "1")}, "groups": {"mu": "soil"}}
    return terrapin.Case.from_table(table, **{**order, **more})


@pytest.mark.parametrize("soils", [["sand"], ["sand", "clay"], ["clay", "sand", "sand", "clay"]])
def test_each_row_has_the_value_of_its_group(soils: list[str]) -> None:
    """Of one group it was `1 row to train on`, of two `expected one value a run`."""
    case = grouped(sled())
    found = case.predict({"soil": soils, "load": [100.0] * len(soils)})
    fitted = case.compare().parameters
    assert found["pull"].to_pylist() == [pytest.approx(100.0 * fitted[f"mu[{one}]"].value) for one in soils]
    assert found["pull_sd"].to_pylist() == [pytest.approx(100.0 * fitted[f"mu[{one}]"].sd, rel=0.01) for one in soils]


def test_the_own_rows_are_predicted_as_they_were() -> None:
    case = grouped(sled())
    np.testing.assert_array_equal(case.predict(sled())["pull"], case.residuals()["pull_predicted"])


def test_a_case_of_a_file_for_each_run_knows_the_groups(tmp_path: Path) -> None:
    folder = grouped(sled()).save(tmp_path / "one")
    text = (
        (folder / "case.toml").read_text().replace('run = "run"\n', "").replace('"table.parquet"', '"a.csv", "b.csv"')
    )
    for name, soil in (("a", "clay"), ("b", "sand")):
        rows = "\n".join(f"{soil},{n},{SOILS[soil] * n + 0.1 * (-1) ** n}" for n in range(10, 40))
        (folder / f"{name}.csv").write_text(f"soil,load [N],pull [N]\n{rows}\n")
    (folder / "case.toml").write_text(text.replace("[data]", '[data]\ntrain = ["a", "b"]\ntest = []'))
    found = terrapin.Case.load(folder).predict({"soil": ["sand", "clay"], "load": [30.0, 30.0]})
    assert found["pull"].to_pylist() == pytest.approx([16.5, 12.0], abs=0.2)


def test_the_rows_outside_are_counted_among_those_that_were_asked_for() -> None:
    with pytest.warns(UserWarning, match="1 of 1 rows lie outside"):
        grouped(sled()).predict({"soil": ["sand"], "load": [900.0]})


def test_equations_of_motion_take_a_group_too() -> None:
    time = np.tile(np.arange(30) * 0.1, 8)
    speed = np.array([SOILS[one] for one in sled()["soil"]]) * time + np.random.default_rng(1).normal(0.0, 0.01, 240)
    case = grouped(
        {"run": sled()["run"], "soil": sled()["soil"], "time": time, "v": speed}, equation=None,
        units={"time": "s", "v": "m/s"}, states={"u": (0.0, "m/s")}, derivative={"u": "mu"}, measured={"v": "u"},
        fit={"mu": (0.3, 0, 2, "m/s^2")},
    )  # fmt: skip
    new = {"soil": ["sand"] * 30, "time": time[:30], "v": 0.55 * time[:30]}
    np.testing.assert_allclose(case.predict(new)["v"], new["v"], atol=0.01)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"soil": ["sand", "moon"], "load": [1.0, 2.0]}, "column soil: found 'moon', expected one of clay, sand"),
        ({"soil": ["sand", None], "load": [1.0, 2.0]}, "column soil: found '', expected one of clay, sand"),
        ({"load": [1.0, 2.0]}, "column soil: is missing, expected it: the model has a value for each of its groups"),
    ],
)
def test_an_unknown_group_is_refused(table: dict[str, Any], said: str) -> None:
    with pytest.raises(terrapin.errors.InputError, match=said):
        grouped(sled()).predict(table)
