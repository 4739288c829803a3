"""Profile intervals: +-1.96 sd where the model is linear, those of a brute-force profile where it is not, or open."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import terrapin_tools
from terrapin_hil.arrays import Array, Mask
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.compare.comparison import analyse
from terrapin_tools.workbench.compare.intervals import Interval, intervals
from terrapin_tools.workbench.noise.estimate import Noise
from tests.python.casekit import of_formula, terrapin

SIGMA = 0.02
LINE = 'a = { value = 1.0, unit = "V" }\nb = { value = 0.1, unit = "V/s" }'
DECAY = 'a = { value = 1.0, min = 0, max = 10, unit = "V" }\nk = { value = 1.0, min = 0, max = 1e9, unit = "1/s" }'


def _text(formula: str, fit: str, sigma: float) -> str:
    columns = f't = {{ column = "t", unit = "s" }}\ny = {{ column = "y", unit = "V", sigma = {sigma} }}'
    return of_formula(formula, fit, columns)


def written(folder: Path, formula: str, fit: str, t: Array, y: Array, sigma: float = SIGMA) -> Path:
    folder.mkdir()
    rows = [f"r{i % 4},{one:.9g},{other:.12g}" for i, (one, other) in enumerate(zip(t, y, strict=True))]
    (folder / "runs.csv").write_text("\n".join(["run,t,y", *rows]) + "\n", encoding="utf-8")
    (folder / "case.toml").write_text(_text(formula, fit, sigma), encoding="utf-8")
    return folder


def asked(folder: Path) -> tuple[dict[str, Interval], Noise, Mask]:
    """The intervals, the noise that is told, and the rows that were fitted."""
    analysis = analyse(load_case(folder))
    return intervals(analysis), analysis.told, analysis.case.train


def test_a_linear_model_has_its_sds(tmp_path: Path) -> None:
    t = np.linspace(0.0, 4.0, 24)
    y = 1.0 + 0.3 * t + SIGMA * np.random.default_rng(1).standard_normal(t.size)
    found, noise, rows = asked(written(tmp_path / "case", "a + b*t", LINE, t, y))
    assert noise.node.words(("y",)) == "white"
    t, y = t[rows], y[rows]
    columns = np.stack([np.ones_like(t), t], axis=1)
    theta, matrix = np.linalg.lstsq(columns, y, rcond=None)[0], SIGMA**2 * np.linalg.inv(columns.T @ columns)
    correlation = matrix[0, 1] / np.sqrt(matrix[0, 0] * matrix[1, 1])
    for place, (key, partner) in enumerate((("a", "b"), ("b", "a"))):
        one, half = found[key], 1.96 * np.sqrt(matrix[place, place])
        assert one.ends == ("closes", "closes")
        assert one.low is not None
        assert one.high is not None
        assert theta[place] - one.low == pytest.approx(half, rel=0.02)
        assert one.high - theta[place] == pytest.approx(half, rel=0.02)
        assert (one.partner, one.unit) == (partner, ("V", "V/s")[place])
        assert one.correlation == pytest.approx(correlation, abs=0.01)


def _profile(t: Array, y: Array, sigma: float, rates: Array) -> Array:
    """Least cost at each rate of a*exp(-k*t), whose amplitude is a linear fit within 0 and 10."""
    shape = np.exp(-np.outer(rates, t))
    size = np.clip((shape @ y) / (shape**2).sum(axis=1), 0.0, 10.0)
    return np.asarray((((y - size[:, None] * shape) / sigma) ** 2).sum(axis=1))


def test_a_rate_of_few_points_has_unequal_sides_as_its_brute_force_profile(tmp_path: Path) -> None:
    t, sigma = np.array([0.4, 0.8, 1.2, 1.6, 2.0, 2.4, 2.8, 3.2]), 0.1
    y = np.exp(-1.2 * t) + sigma * np.random.default_rng(5).standard_normal(t.size)
    found, noise, rows = asked(written(tmp_path / "case", "a*exp(-k*t)", DECAY, t, y, sigma))
    assert noise.node.words(("y",)) == "white"
    assert noise.sigma == pytest.approx([sigma])
    rates = np.linspace(0.0, 20.0, 200_001)
    cost = _profile(t[rows], y[rows], sigma, rates)
    inside = rates[cost <= cost.min() + 1.959964**2]
    one = found["k"]
    assert one.ends == ("closes", "closes")
    assert one.low is not None
    assert one.high is not None
    assert [one.low, one.high] == pytest.approx([inside[0], inside[-1]], rel=0.01)
    assert one.high - one.value > 1.2 * (one.value - one.low)


def test_what_does_not_close_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All points lie where the exponential is over: the rate is at least so much, and no rate is too large."""
    t = np.linspace(2.0, 4.0, 16)
    y = 1.0 - np.exp(-2.2 * t) + SIGMA * np.random.default_rng(2).standard_normal(t.size)
    folder = written(tmp_path / "case", "a*(1 - exp(-k*t))", DECAY.replace(", max = 1e9", ""), t, y)
    one = asked(folder)[0]["k"]
    assert one.low is not None
    assert one.low > 0.5
    assert (one.high, one.ends[1]) == (None, "open")
    status, out, _ = terrapin(capsys, "compare", folder, "--intervals")
    assert status == 0
    (line,) = [line for line in out.splitlines() if line.startswith("  k ") and " to open 1/s" in line]
    assert "the upper side does not close" in line
    (folder / "case.toml").write_text(_text("a*(1 - exp(-k*t))", DECAY.replace("1e9", "60"), SIGMA))
    bounded = asked(folder)[0]["k"]
    assert (bounded.high, bounded.ends[1]) == (60.0, "bound")


def test_all_doors_say_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.linspace(0.0, 4.0, 24)
    y = 1.0 + 0.3 * t + SIGMA * np.random.default_rng(1).standard_normal(t.size)
    folder = written(tmp_path / "case", "a + b*t", LINE, t, y)
    told: list[str] = []
    case = terrapin_tools.Case.load(folder)
    found = case.compare(intervals=True, progress=told.append)
    assert told == ["interval of a", "interval of b"]
    assert not case.compare().intervals
    status, out, _ = terrapin(capsys, "compare", folder, "--intervals", "--json", "-")
    assert status == 0
    written_out = json.loads(out)["intervals"]
    assert written_out["b"]["low"] == pytest.approx(found.intervals["b"].low)
    assert written_out["b"]["ends"] == ["closes", "closes"]
    assert written_out["b"]["partner"] == "a"
    status, out, _ = terrapin(capsys, "compare", folder, "--json", "-")
    assert (status, "intervals" in json.loads(out)) == (0, False)
