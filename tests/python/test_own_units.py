"""Units of own effects, under every kind of base model: right ones are taken, wrong ones refused, others said so."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import pytest

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases import BASES
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
MORE = {  # the other bases
    "cmr": {
        "resistance": {
            "k*omega**2": {"k": "N m s^2/rad^2"},
            "k*tanh(omega/s)": {"k": "N m", "s": "rad/s"},
        },
        "current": {"k*omega": {"k": "A s/rad"}},
        "voltage": {"k*omega": {"k": "s/rad"}},
    },
    "cmr_slip": {"resistance": {"k*slip": {"k": "N m"}}, "speed": {"k*omega": {"k": "m"}}},
    "sphere_slip": {"torque": {"k*slip": {"k": "N m"}}, "resistance": {"k*load": {"k": "m"}}},
    "pendulum_sphere": {
        "resistance": {"k*omega": {"k": "N m s/rad"}, "k*load": {"k": "m"}},
        "torque": {"k*sign(omega)": {"k": "N m"}},
        "rolling_angle": {"k*omega": {"k": "s"}},
    },
    "rolling_sphere": {
        "resistance": {"k*omega": {"k": "N m s/rad"}},
        "drag": {"k*load*slip": {"k": "1"}},
        "traction": {"k*load": {"k": "1"}},
    },
    "sphere_contact": {
        "drag": {"k*load": {"k": "1"}},
        "traction": {"k*slip**2": {"k": "N"}},
        "torque": {"k*load*slip": {"k": "m"}},
        "sinkage": {"k*exp(-slip/s)": {"k": "m", "s": "1"}},
    },
    "vehicle": {
        "resistance": {"k*speed": {"k": "N s"}},
        "rolling_resistance": {"k*load": {"k": "m"}},
        "speed": {"k*slip": {"k": "m/s"}},
        "drive_torque": {"k*omega": {"k": "s/rad"}},
    },
    "wheel_contact": {
        "axle": {"k*slip": {"k": "N"}},
        "traction": {"k*load**2": {"k": "1/N"}},
        "torque": {"k*load": {"k": "m"}},
        "k_s": {"k*slip": {"k": "1"}},
    },
}
FORMULAS |= MORE
COLUMNS = {  # of the other bases -> unit; one row is enough where nothing is fitted
    "cmr": {"time": "s", "voltage": "V", "omega": "rad/s", "current": "A"},
    "cmr_slip": {"time": "s", "voltage": "V", "omega": "rad/s", "speed": "m/s"},
    "sphere_slip": {"time": "s", "joint_rate": "rad/s", "torque": "N m", "speed": "m/s"},
    "pendulum_sphere": {"time": "s", "joint_rate": "rad/s", "torque": "N m", "rolling_angle": "rad"},
    "rolling_sphere": {"omega": "rad/s", "slip": "1", "load": "N", "current": "A", "traction": "N"},
    "sphere_contact": {"slip": "1", "load": "N", "traction": "N", "torque": "N m", "sinkage": "m"},
    "vehicle": {"time": "s", "drive_torque": "N m", "omega_fl": "rad/s", "speed": "m/s"},
    "wheel_contact": {"slip": "1", "load": "N", "traction": "N", "torque": "N m", "sinkage": "m"},
}
SOIL = "n = 1\ncohesion = 0\nfriction_angle = 0.6\nshear_modulus = 0.02\n"
NUMBERS = {
    "cmr": "f_o = 0.05\n",
    "cmr_slip": "f_o = 0.05\nmu = 0.4\ns_k = 0.1\n",
    "sphere_slip": "k_s = 2e6\n" + SOIL,
    "pendulum_sphere": "f_o = 0.05\n",
    "rolling_sphere": "radius = 0.2\ndrive_radius = 0.003\ntorque_constant = 0.04\ncoulomb = 0.6\nviscous = 0.05\n"
    "k_s = 2e6\nc1 = 0.2\nc2 = 0.3\n" + SOIL,
    "sphere_contact": "radius = 0.2\nk_s = 2e6\nc1 = 0.2\nc2 = 0.3\n" + SOIL,
    "vehicle": "k_s = 2e6\n" + SOIL,
    "wheel_contact": "radius = 0.1\nwidth = 0.05\nk_c = 0\nk_phi = 2e6\n" + SOIL,
}


def plainly(base: str) -> str:
    """A case of one of the other bases, in which nothing is fitted but the effect."""
    columns = "".join(f'{name} = {{ column = "{name}", unit = "{unit}" }}\n' for name, unit in COLUMNS[base].items())
    return (
        f'[model]\nbase = "{base}"\neffects = ["mine"]\n[parameters]\n{NUMBERS[base]}'
        f'[data]\nfiles = ["runs.csv"]\nrun = "run"\n[data.columns]\n{columns}'
    )


CASES = {"equation": EQUATION, "ode": ODE, "rolling_steady": ROLLING.replace("effects = []", 'effects = ["mine"]')}
CASES |= {base: plainly(base) for base in MORE}
EACH = [
    (base, target, formula, units, good)
    for base, targets in FORMULAS.items()
    for target, formulas in targets.items()
    for formula, units in formulas.items()
    for good in (True, False)
]


def small(base: str) -> str:
    names = list(COLUMNS[base])
    rows = (f"r{run},{','.join('0.3' if n != 'time' else f'{0.1 * row:.1f}' for n in names)}"
            for run in range(4) for row in range(4))  # fmt: skip
    return "\n".join([f"run,{','.join(names)}", *rows]) + "\n"


def written(folder: Path, base: str, target: str, formula: str, units: dict[str, str], more: str = "") -> Path:
    if base == "rolling_steady":
        rolling(folder, 1, runs=4, rows=4)
    else:
        folder.mkdir()
        (folder / "runs.csv").write_text(small(base) if base in MORE else TABLE, encoding="utf-8")
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


def test_sixty_of_each_kind_over_every_base() -> None:
    assert FORMULAS.keys() == BASES.keys()
    assert sum(good for *_, good in EACH) >= 60
    assert sum(not good for *_, good in EACH) >= 60


def test_nothing_is_converted_where_formulas_take_numbers_as_they_stand(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="expected A"):
        load_case(written(tmp_path / "milli", "equation", "i", "k*x", {"k": "mA/m"}))
    with pytest.raises(UserError, match="expected A"):
        load_case(written(tmp_path / "rad", "equation", "i", "k*w", {"k": "A s/rad"}))


@pytest.mark.parametrize("unit", ["degF", "degC", "K", "degRe"])
def test_a_formula_in_a_temperature_is_checked_on_any_scale(tmp_path: Path, unit: str) -> None:
    """In degF the check ended in a traceback of pint."""
    for name, own, wrong in (("good", f"A/m/{unit}", ""), ("bad", "A/m/V", "comes out in"), ("open", "", "")):
        folder = written(tmp_path / name, "equation", "i", "k*x*temp", {"k": own})
        text = (folder / "case.toml").read_text(encoding="utf-8").replace('"degC"', f'"{unit}"')
        (folder / "case.toml").write_text(text.replace(', unit = "" }', " }"), encoding="utf-8")
        with pytest.raises(UserError, match=wrong) if wrong else nullcontext():
            assert load_case(folder).effects == ("mine",)


def test_what_cannot_be_checked_is_said(tmp_path: Path) -> None:
    folder = written(tmp_path / "case", "equation", "i", "k*x*q", {"k": "N m"}, "[parameters]\nq = 2.0\n")
    story = told(analyse(load_case(folder)))
    assert "The units of mine are not checked: q has none." in story.notes


def test_a_fitted_value_on_a_scale_with_another_zero_is_refused(tmp_path: Path) -> None:
    """No factor takes 68 degF to kelvin; it came out as 17403 K."""
    folder = written(tmp_path / "case", "ode", "derivative.v", "k*x", {"k": "rad/s^2/m"})
    text = (folder / "case.toml").read_text(encoding="utf-8")
    fitted = 'c = { value = 0.1, min = 0, max = 5, unit = "1/s" }'
    warm = text.replace(fitted, f'{fitted}\nwarm = {{ value = 68, unit = "degF" }}')
    (folder / "case.toml").write_text(warm, encoding="utf-8")
    with pytest.raises(
        UserError, match=r"fit\.warm\.unit: found 'degF', whose zero is not that of SI, expected degC, or K"
    ):
        load_case(folder)
