"""Equations of the user's own: a stated constant that is wrong, states in degC, derivatives that are none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from casekit import terrapin
from scipy.integrate import solve_ivp

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.model.fitting import covariance
from terrapin_tools.workbench.noise.kinds import NODES

RUNS, ROWS = 6, 60
DRIVE = """
[case]
title = "drive"
[model]
base = "ode"
[model.states]
w = { initial = 0, unit = "rad/s" }
[model.derivative]
w = "(ke*(U - ke*w)/Rm - b*w)/J"
[model.measured]
omega = "w"
amps = "(U - ke*w)/Rm"
[parameters]
ke = "0.12 V s/rad"
Rm = "1.2 ohm"
[fit]
J = { value = 0.02, min = 0.0001, max = 1, unit = "kg m^2" }
b = { value = 0.005, min = 0, max = 0.2, unit = "N m s/rad" }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
time = { column = "t", unit = "s" }
omega = { column = "omega", unit = "rad/s", sigma = 0.2 }
amps = { column = "amps", unit = "A", sigma = 0.05 }
U = { column = "U", unit = "V" }
"""
WINDING = """
[case]
title = "winding"
[model]
base = "ode"
[model.states]
T = { initial = "fit", unit = "degC" }
[model.derivative]
T = "(R*I**2 - g*(T - Ta))/C"
[model.measured]
winding = "T"
[parameters]
R = "1.25 ohm"
[fit]
C = { value = 60, min = 1, max = 1000, unit = "J/K" }
g = { value = 0.5, min = 0, max = 10, unit = "W/K" }
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
time = { column = "t", unit = "s" }
winding = { column = "winding", unit = "degC", sigma = 0.2 }
I = { column = "I", unit = "A" }
Ta = { column = "Ta", unit = "degC" }
"""


def write(folder: Path, text: str, columns: dict[str, Array]) -> Path:
    folder.mkdir()
    lines = ["run," + ",".join(columns)]
    table = np.array(list(columns.values())).T
    lines += [f"r{n // ROWS}," + ",".join(f"{v:.9g}" for v in row) for n, row in enumerate(table)]
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(text)
    return folder


def drive(folder: Path, resistance: float) -> Path:
    random, time = np.random.default_rng(3), np.linspace(0.0, 3.0, ROWS)
    columns: dict[str, list[Array]] = {"t": [], "omega": [], "amps": [], "U": []}
    for volts in np.linspace(4.0, 14.0, RUNS):
        w = solve_ivp(lambda _, w, u=volts: (0.12 * (u - 0.12 * w) / resistance - 0.004 * w) / 0.015, (0.0, 3.0), [0.0],
                      t_eval=time, rtol=1e-9, atol=1e-9).y[0]  # fmt: skip
        columns["t"].append(time)
        columns["omega"].append(w + 0.2 * random.standard_normal(ROWS))
        columns["amps"].append((volts - 0.12 * w) / resistance + 0.05 * random.standard_normal(ROWS))
        columns["U"].append(np.full(ROWS, volts))
    return write(folder, DRIVE, {name: np.concatenate(parts) for name, parts in columns.items()})


def test_a_wrong_constant_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = drive(tmp_path / "wrong", 0.9)
    found = discover(load_case(folder))
    assert (found.verdict, found.missing) == ("missing", ("constant.Rm",))
    value = next(
        v for f, v in zip(found.candidates[0].fit.model.fitted, found.candidates[0].fit.theta, strict=True) if f.effect
    )
    assert 1.2 * (1.0 + value) == np.clip(1.2 * (1.0 + value), 0.89, 0.91)
    status, _, err = terrapin(capsys, "add", folder, "constant.Rm")
    assert status == 0, err
    freed = load_case(folder).fit["Rm"]
    assert (freed.value, freed.unit) == (1.2, "ohm")
    sound = discover(load_case(drive(tmp_path / "sound", 1.2)))
    assert sound.verdict == "adequate"


def winding() -> dict[str, Array]:
    """A winding of 50 J/K and 0.45 W/K that is heated with 1 to 4 A at 22 degC."""
    random, time = np.random.default_rng(3), np.linspace(0.0, 300.0, ROWS)
    columns: dict[str, list[Array]] = {"t": [], "winding": [], "I": [], "Ta": []}
    for current in np.linspace(1.0, 4.0, RUNS):
        final = 22.0 + 1.25 * current**2 / 0.45
        columns["t"].append(time)
        columns["winding"].append(
            final + (22.0 - final) * np.exp(-0.45 * time / 50.0) + 0.2 * random.standard_normal(ROWS)
        )
        columns["I"].append(np.full(ROWS, current))
        columns["Ta"].append(np.full(ROWS, 22.0))
    return {name: np.concatenate(parts) for name, parts in columns.items()}


def test_a_state_in_celsius(tmp_path: Path) -> None:
    folder = write(tmp_path / "x", WINDING, winding())
    analysis = analyse(load_case(folder))
    values = {f.key: float(v) for f, v in zip(analysis.fit.model.fitted, analysis.fit.theta, strict=True)}
    assert abs(values["C"] - 50.0) < 2.0
    assert abs(values["g"] - 0.45) < 0.02
    assert not analysis.missing


def test_rows_in_which_the_sensor_stuck_say_nothing_of_a_start(tmp_path: Path) -> None:
    """They are left out; but the start of the run had still been fitted to them."""
    columns = winding()
    stuck = slice(2 * ROWS + 8, 2 * ROWS + 20)
    columns["winding"][stuck] = columns["winding"][stuck.start]
    analysis = analyse(load_case(write(tmp_path / "x", WINDING, columns)))
    assert analysis.stuck[stuck.start + 1 : stuck.stop].all()
    assert not analysis.missing
    mine = analysis.case.run[analysis.rows] == 2
    assert float(np.sqrt(np.mean(analysis.residual[0, mine] ** 2))) < 0.25


def test_what_has_no_derivative_is_not_determined(tmp_path: Path) -> None:
    """A column of nan in the Jacobian had ended the program."""
    case = load_case(drive(tmp_path / "x", 1.2))
    fit = analyse(case).fit
    broken = fit.jacobian.copy()
    broken[0, 3, 1] = np.nan
    sound, loose = (
        covariance(replace(fit, jacobian=j), case.run[case.train], NODES[0])[0] for j in (fit.jacobian, broken)
    )
    assert loose[1, 1] > 1e6 * sound[1, 1]
    assert loose[0, 0] <= sound[0, 0]
