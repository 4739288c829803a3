"""Units of own effects, under every kind of base model: right ones are taken, wrong ones refused, others said so."""

from __future__ import annotations

from pathlib import Path

import pytest

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.story.told import told
from tests.python.casekit import ROLLING, rolling

TABLE = "run,t,w,x,temp,i\n" + "".join(
    f"r{run},{0.1 * row:.1f},{w},{w / 60},{20 + row},{0.1 + 0.01 * w:.4f}\n"
    for run in range(4)
    for row, w in enumerate((10, 20, 35, 50, 30, 60))
)
EQUATION = """[model]
base = "equation"
effects = ["mine"]
[model.equation]
i = "a + b*w"
[fit]
a = { value = 0.1, unit = "A" }
b = { value = 0.01, unit = "A/rpm" }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
i = { column = "i", unit = "A" }
w = { column = "w", unit = "rpm" }
x = { column = "x", unit = "m" }
temp = { column = "temp", unit = "degC" }
"""
ODE = """[model]
base = "ode"
effects = ["mine"]
[model.states]
v = { initial = "fit", unit = "rad/s" }
[model.derivative]
v = "-c*v"
[model.measured]
w = "v"
[fit]
c = { value = 0.1, min = 0, max = 5, unit = "1/s" }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
time = { column = "t", unit = "s" }
w = { column = "w", unit = "rad/s" }
x = { column = "x", unit = "m" }
temp = { column = "temp", unit = "degC" }
"""
FORMULAS = {  # base -> what the effect acts on -> formulas with the units that make them sound
    "equation": {
        "i": {
            "k*x": {"k": "A/m"},
            "k*w**2": {"k": "A/rpm^2"},
            "k*sign(w)": {"k": "A"},
            "k*(temp - 25)": {"k": "A/K"},
            "k*w*x": {"k": "A/rpm/m"},
            "k*tanh(x/s)": {"k": "A", "s": "m"},
            "k*sqrt(abs(x))": {"k": "A/m^0.5"},
            "k*max(w - s, 0)": {"k": "A/rpm", "s": "rpm"},
            "k*exp(-x/s)": {"k": "A", "s": "m"},
            "k*x/w": {"k": "A rpm/m"},
        },
        "b": {
            "k*(temp - 25)": {"k": "1/K"},
            "k*x": {"k": "1/m"},
            "k*w": {"k": "1/rpm"},
            "k*x**2": {"k": "1/m^2"},
            "k*tanh(w/s)": {"k": "1", "s": "rpm"},
        },
    },
    "ode": {
        "derivative.v": {
            "k*v**2": {"k": "1/rad"},
            "k*x": {"k": "rad/s^2/m"},
            "k*sign(v)": {"k": "rad/s^2"},
            "k*(temp - 25)*v": {"k": "1/s/K"},
            "k*x*v": {"k": "1/s/m"},
            "k*tanh(v/s)": {"k": "rad/s^2", "s": "rad/s"},
            "k*max(x - s, 0)": {"k": "rad/s^2/m", "s": "m"},
            "k*v**3": {"k": "s/rad^2"},
            "k*exp(-x/s)*v": {"k": "1/s", "s": "m"},
            "k*sqrt(abs(x))": {"k": "rad/s^2/m^0.5"},
        },
        "w": {
            "k*x": {"k": "rad/s/m"},
            "k*(temp - 25)": {"k": "rad/s/K"},
            "k*v": {"k": "1"},
            "k*sign(x)": {"k": "rad/s"},
            "k*x**2": {"k": "rad/s/m^2"},
        },
    },
    "rolling_steady": {
        "resistance": {
            "k*omega": {"k": "N m s/rad"},
            "k*omega**2": {"k": "N m s^2/rad^2"},
            "k*load": {"k": "m"},
            "k*sign(omega)": {"k": "N m"},
            "k*(temperature - 25)": {"k": "N m/K"},
            "k*load*omega": {"k": "m s/rad"},
            "k*tanh(omega/s)": {"k": "N m", "s": "rad/s"},
            "k*exp(-omega/s)": {"k": "N m", "s": "rad/s"},
            "k*load**2": {"k": "m/N"},
            "k*max(omega - s, 0)": {"k": "N m s/rad", "s": "rad/s"},
        },
        "current": {
            "k*omega": {"k": "A s/rad"},
            "k*load": {"k": "A/N"},
            "k*sign(omega)": {"k": "A"},
            "k*(temperature - 25)": {"k": "A/K"},
            "k*omega**2": {"k": "A s^2/rad^2"},
        },
    },
}
CASES = {"equation": EQUATION, "ode": ODE, "rolling_steady": ROLLING.replace("effects = []", 'effects = ["mine"]')}
EACH = [
    (base, target, formula, units, good)
    for base, targets in FORMULAS.items()
    for target, formulas in targets.items()
    for formula, units in formulas.items()
    for good in (True, False)
]


def written(folder: Path, base: str, target: str, formula: str, units: dict[str, str], more: str = "") -> Path:
    if base == "rolling_steady":
        rolling(folder, 1, runs=4, rows=4)
    else:
        folder.mkdir()
        (folder / "runs.csv").write_text(TABLE, encoding="utf-8")
    effect = f'\n[effect.mine]\nexpression = "{formula}"\ntarget = "{target}"\n'
    effect += "".join(f'{n} = {{ value = 0.1, unit = "{unit}" }}\n' for n, unit in units.items())
    (folder / "case.toml").write_text(CASES[base] + effect + more, encoding="utf-8")
    return folder


@pytest.mark.parametrize(("base", "target", "formula", "units", "good"), EACH)
def test_right_units_are_taken_and_wrong_ones_refused(
    tmp_path: Path, base: str, target: str, formula: str, units: dict[str, str], good: bool
) -> None:
    stated = units if good else {**units, "k": f"({units['k']})*kg"}
    folder = written(tmp_path / "case", base, target, formula, stated)
    if good:
        assert load_case(folder).effects == ("mine",)
        return
    with pytest.raises(UserError) as told_so:
        load_case(folder)
    assert "effect.mine.expression" in str(told_so.value)
    assert "comes out in" in str(told_so.value)


def test_nothing_is_converted_where_formulas_take_numbers_as_they_stand(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="expected A"):
        load_case(written(tmp_path / "milli", "equation", "i", "k*x", {"k": "mA/m"}))
    with pytest.raises(UserError, match="expected A"):
        load_case(written(tmp_path / "rad", "equation", "i", "k*w", {"k": "A s/rad"}))


def test_what_cannot_be_checked_is_said(tmp_path: Path) -> None:
    folder = written(tmp_path / "case", "equation", "i", "k*x*q", {"k": "N m"}, "[parameters]\nq = 2.0\n")
    story = told(analyse(load_case(folder)))
    assert "The units of mine are not checked: q has none." in story.notes
