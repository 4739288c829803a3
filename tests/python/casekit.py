"""Cases made up for the tests: true models with noise of a fixed seed, written as a user would write them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from terrapin_tools.workbench.noise.covariance import WALKED, WAVES, Runs
from terrapin_tools.workbench.noise.kinds import Node

R, DRIVE, K_T, A, B = 0.08, 0.018, 0.1, 0.012, 1e-3

ROLLING = """# a comment that must stay
[case]
title = "Rolling"          # and this one

[model]
base = "rolling_steady"
effects = []               # none yet

[parameters]
radius = "80 mm"
drive_radius = "18 mm"
torque_constant = 0.1
coulomb = "12 mN m"
viscous = 1e-3

[fit]
f_o = { value = 0.05, min = 0.0, max = 0.5 }

[data]
files = ["runs.csv"]
run = "run"

[data.columns]
omega = { column = "w", unit = "rpm" }
load = { column = "W", unit = "N" }
temperature = { column = "temp", unit = "degF" }
current = { column = "i", unit = "mA", sigma = 4.0 }
"""


def ar1(random: np.random.Generator, count: int, rho: float) -> npt.NDArray[np.float64]:
    """Noise of unit variance with the correlation rho from row to row."""
    noise = random.standard_normal(count)
    for i in range(1, count):
        noise[i] = rho * noise[i - 1] + np.sqrt(1 - rho * rho) * noise[i]
    return noise


def dense(runs: Runs, node: Node) -> npt.NDArray[np.float64]:
    """The covariance of the rows of one channel (rows, rows) written out, in file order, s = 1."""
    lag = np.abs(runs.position[:, None] - runs.position[None, :])
    own = (1.0 - node.share) * (lag == 0) + (node.share * node.rho**lag if node.share else 0.0)
    sd = np.sqrt(1.0 - node.grow + node.grow * runs.sorted_reading[np.argsort(runs.order)] ** 2)
    own = own * np.outer(sd, sd) + node.offset**2 + node.drift**2 * np.outer(runs.line, runs.line)
    own = own + node.gain**2 * np.outer(runs.level[0], runs.level[0])
    own = np.where(runs.run[:, None] == runs.run[None, :], own, 0.0)
    if node.walk and runs.runs >= WALKED:
        place = (np.argsort(np.argsort(runs.run, kind="stable")) + 0.5) / runs.rows
        k = np.arange(1, WAVES + 1)
        waves = np.cos(np.pi * np.outer(place, k)) / k * np.sqrt(2.0 / (1.0 / k**2).sum())
        own = own + node.walk**2 * waves @ waves.T
    return own


def driven(
    omega: npt.ArrayLike, load: npt.ArrayLike, celsius: npt.ArrayLike, heating: float
) -> npt.NDArray[np.float64]:
    """Current [A] of a wheel with f_o = 0.09 that rolls steadily at omega [rad/s] under a load [N], its motor at a
    temperature [degC]; `heating` is the loss of torque constant a kelvin."""
    omega, load, celsius = (np.asarray(one, dtype=np.float64) for one in (omega, load, celsius))
    torque = 0.09 * R * load * np.sign(omega) + A * np.sign(omega) + B * omega
    return np.asarray(torque * DRIVE / (R * K_T * (1 - heating * (celsius - 25))))


def rolling(
    folder: Path,
    seed: int,
    *,
    runs: int = 10,
    rows: int = 12,
    rho: float = 0.0,
    sigma: float = 0.004,
    heating: float = 0.0,
    text: str = ROLLING,
) -> Path:
    """A case of rolling_steady with f_o = 0.09; `heating` is the true loss of torque constant a kelvin."""
    random = np.random.default_rng(seed)
    lines = ["run,w,W,temp,i,humidity"]
    for run in range(runs):
        speed = random.uniform(2, 10) * (1 if run % 3 else -1)
        load = random.uniform(15, 40)
        first = random.uniform(20, 35)
        noise = ar1(random, rows, rho)
        for row in range(rows):
            omega = speed * (1 + 0.02 * random.standard_normal())
            celsius = first + 2.5 * row
            current = driven(omega, load, celsius, heating) + sigma * noise[row]
            values = (omega * 30 / np.pi, load, celsius * 1.8 + 32, 1000 * current, random.normal(50, 5))
            lines.append(",".join([f"r{run:02d}", *(f"{v:.8g}" for v in values)]))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(text)
    return folder


SHAFT = """[model]
base = "equation"
[model.equation]
torque = "b*v"
[fit]
b = { value = 0.1, unit = "N m s/rad" }
[data]
files = ["d.csv"]
run = "run"
[data.columns]
v = { column = "v", unit = "rad/s", is = "speed" }
torque = { column = "torque", unit = "N m", sigma = 0.01 }
"""


def of_formula(formula: str, fit: str, columns: str) -> str:
    """case.toml of y over the columns of runs.csv by a formula; `fit` and `columns` as their tables have them."""
    return (
        f'[model]\nbase = "equation"\n[model.equation]\ny = "{formula}"\n[fit]\n{fit}\n'
        f'[data]\nfiles = ["runs.csv"]\nrun = "run"\n[data.columns]\n{columns}\n'
    )


def shaft(folder: Path, seed: int, *, dry: float = 0.0, more: str = "") -> Path:
    """Ten runs of a shaft with viscous and dry friction, against a model with the former; `more` begins case.toml."""
    random = np.random.default_rng(seed)
    lines = ["run,v,torque"]
    for run in range(10):
        for v in random.uniform(-10.0, 10.0, 12):
            torque = 0.05 * v + dry * np.sign(v) + 0.01 * random.standard_normal()
            lines.append(f"r{run},{v:.6g},{torque:.6g}")
    folder.mkdir()
    (folder / "d.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(more + SHAFT)
    return folder


def terrapin(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Run the command in this process: exit status, standard output, standard error."""
    from terrapin_tools.cli import main

    before = sys.argv
    sys.argv = ["terrapin", *map(str, arguments)]
    try:
        main()
    except SystemExit as stop:
        code: Any = stop.code
    else:
        code = 0
    finally:
        sys.argv = before
    captured = capsys.readouterr()
    return int(code or 0), captured.out, captured.err


def one_line(err: str, expected: list[str]) -> None:
    """Standard error holds one printable line of the program's, with all of `expected` in it."""
    assert err.startswith("terrapin: ")
    assert err.count("\n") == 1, err
    assert err.rstrip("\n").isprintable()
    for text in expected:
        assert text in err
