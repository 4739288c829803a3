"""A wave along an angle or a position: its period is found, and where there is none nothing is made of noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from terrapin_hil.physics.expression import parse
from terrapin_tools.workbench.case.case import Case, load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.discover.discovery import discover
from terrapin_tools.workbench.experiment.hidden_period import hidden_period
from terrapin_tools.workbench.formulas.periods import waves
from terrapin_tools.workbench.story.told import told

CASE = """[model]
base = "equation"
[model.equation]
torque = "c + b*speed"
[fit]
c = {{ value = 0.3 }}
b = {{ value = 0.05 }}
[data]
files = ["runs.csv"]
run = "run"
[data.columns]
place = {{ column = "place", unit = "{unit}" }}
speed = {{ column = "speed", unit = "rad/s" }}
torque = {{ column = "torque", unit = "N m" }}
"""


def bench(folder: Path, unit: str, span: float, rate: float, size: float, seed: int) -> Case:
    """A friction bench whose torque has a ripple of `size` N m, `rate` rad per unit of place, in noise of 0.03."""
    random, lines = np.random.default_rng(seed), ["run,place,speed,torque"]
    for run in range(10):
        speed = random.uniform(1.0, 10.0)
        for place in np.sort(random.uniform(0.0, span, 50)):
            torque = 0.3 + 0.05 * speed + size * np.sin(rate * place + 0.9) + 0.03 * random.standard_normal()
            lines.append(f"r{run},{place:.6g},{speed:.6g},{torque:.6g}")
    folder.mkdir()
    (folder / "case.toml").write_text(CASE.format(unit=unit))
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    return load_case(folder)


@pytest.mark.parametrize(
    ("unit", "span", "rate", "formula", "true"),
    [
        ("rad", 9.4, 7.3, "k*sin(n*place + phase)", 7.3),
        ("mm", 800.0, 0.131, "k*sin(6.2832*place/p + phase)", 2 * np.pi / 0.131),
    ],
)
def test_a_ripple_is_named_with_its_period(
    tmp_path: Path, unit: str, span: float, rate: float, formula: str, true: float
) -> None:
    """It was told as noise of twice the sd: no shape of the vocabulary goes up and down so often."""
    found = discover(bench(tmp_path / "case", unit, span, rate, 0.07, seed=5))
    assert found.verdict == "missing"
    (one,) = [c for c in found.candidates if c.effect.name in found.missing]
    assert one.effect.expression == formula
    values = dict(zip((p.name for p in one.effect.parameters), one.fit.theta[-3:], strict=True))
    sds = dict(zip(values, one.sd[-3:], strict=True))
    scale = "n" if unit == "rad" else "p"
    assert values[scale] == pytest.approx(true, abs=4 * sds[scale])
    assert abs(values["k"]) == pytest.approx(0.07, abs=4 * sds["k"])
    assert found.around is not None
    assert found.around.sigma[0] == pytest.approx(0.03, rel=0.1)


def test_without_a_ripple_nothing_is_missing(tmp_path: Path) -> None:
    assert discover(bench(tmp_path / "case", "rad", 9.4, 7.3, 0.0, seed=6)).verdict == "adequate"


@pytest.mark.parametrize(("size", "waves"), [(0.05, 4.0), (0.0, None)])
def test_a_wave_along_an_angle_that_nobody_measured_is_told(tmp_path: Path, size: float, waves: float | None) -> None:
    """Four waves a turn in noise that is alike from row to row, each run from another angle on: no column can hold it,
    and the model would be called adequate without a word."""
    random, lines = np.random.default_rng(5), ["run,time,speed,torque"]
    for run in range(8):
        time = 0.02 * np.arange(150)
        speed = random.uniform(1.0, 10.0) + 1.5 * np.sin(1.1 * time + run)
        angle = random.uniform(0.0, 6.0) + np.cumsum(speed) * 0.02
        noise = lfilter([0.02], [1.0, -0.7], random.standard_normal(150))
        torque = 0.3 + 0.05 * speed + size * np.sin(4.0 * angle) + noise
        lines += [f"r{run},{t:.6g},{v:.6g},{m:.6g}" for t, v, m in zip(time, speed, torque, strict=True)]
    text = CASE.format(unit="s").replace("place", "time")
    (tmp_path / "case.toml").write_text(text)
    (tmp_path / "runs.csv").write_text("\n".join(lines) + "\n")
    analysis = analyse(load_case(tmp_path), 0)
    found = hidden_period(analysis)
    notes = [note for note in told(analysis).notes if "periodic" in note]
    if waves is None:
        assert (found, notes) == (None, [])
        return
    assert found is not None
    assert (found.speed, found.channel, found.per) == ("speed", "torque", "turn")
    assert found.rate == pytest.approx(waves, rel=0.02)
    assert len(notes) == 1
    assert "measure an angle" in notes[0]


@pytest.mark.parametrize("unit", ["rad", "mm"])
def test_a_wave_starts_where_it_is(unit: str) -> None:
    random = np.random.default_rng(2)
    place = np.sort(random.uniform(3.0, 40.0, 400))
    left = np.array([np.zeros(400), -1.5 * np.sin(4.1 * place - 2.0)]) + random.standard_normal((2, 400))
    (one,) = waves("x", place, unit, left, {"n", "p"})
    assert {"n", "p"}.isdisjoint(one.scales)
    assert all(s.low < s.start < s.high for s in one.scales.values())
    shape = parse(one.text).evaluate({"x": place, **one.starts})
    assert abs(np.corrcoef(shape, np.sin(4.1 * place - 2.0))[0, 1]) > 0.9


@pytest.mark.parametrize(("unit", "values"), [("m/s", np.linspace(0, 9, 90)), ("rad", np.repeat([0.0, 1.0, 2.0], 30))])
def test_what_is_no_place_or_has_few_values_has_no_period(unit: str, values: np.ndarray) -> None:
    assert waves("x", values, unit, np.random.default_rng(3).standard_normal((1, 90))) == []
