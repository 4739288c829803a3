"""Derived columns: a known motion comes out of its counts with the noise that is told; formulas keep units."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from casekit import one_line, terrapin

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.case.case import load_case
from terrapin_tools.workbench.derived.windows import COUNT_NOISE, mean, slope, unwrapped

PER_TURN, WRAP = 4096, 65536
CASE = """
[case]
title = "derived"
[model]
base = "equation"
[model.equation]
torque = "a + b*omega + c*slip"
[fit]
a = { value = 0.0, min = -1.0, max = 1.0, unit = "N m" }
b = { value = 0.0, min = -1.0, max = 1.0, unit = "N m s/rad" }
c = { value = 0.0, min = -1.0, max = 1.0, unit = "N m" }
[data]
files = ["x.csv"]
run = "run"
train = ["1", "2"]
[data.derived]
omega = { counts = "enc", counts_per_turn = 4096, wrap = 65536, reverse = true, time = { column = "t_ms", unit = "ms" }, window = "100 ms", unit = "rad/s" }
torque = { formula = "k*i", with = { i = { column = "i_mA", unit = "mA" }, k = "31 mN m/A" }, unit = "N m" }
slip = { formula = "(r*w - v)/(r*w)", with = { r = "80 mm", w = { column = "omega", unit = "rad/s" }, v = { column = "v", unit = "mm/s" } }, unit = "1" }
steady = { mean = { column = "v", unit = "mm/s" }, time = { column = "t_ms", unit = "ms" }, window = "50 ms", unit = "m/s" }
[data.columns]
omega = { column = "omega", unit = "rad/s" }
torque = { column = "torque", unit = "N m" }
slip = { column = "slip", unit = "1" }
"""  # noqa: E501


def motion(rows: int = 400, speed: float = 7.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], speed [rad/s] and angle [rad] of three smooth runs."""
    time = np.arange(rows) * 0.01
    omega = speed * (1 + 0.3 * np.sin(time))
    return time, omega, speed * (time + 0.3 * (1 - np.cos(time)))


def write(folder: Path, text: str = CASE) -> Path:
    lines = ["run,t_ms,enc,i_mA,v"]
    for run, speed in (("1", 5.0), ("2", 7.0), ("3", 9.0)):
        time, omega, angle = motion(speed=speed)
        counts = np.floor(-angle * PER_TURN / (2 * np.pi)) % WRAP
        for t, c, w in zip(time, counts, omega, strict=True):
            lines.append(f"{run},{1000 * t:.0f},{c:.0f},{100 * w:.6f},{60 * w:.6f}")
    (folder / "x.csv").write_text("\n".join(lines) + "\n")
    (folder / "case.toml").write_text(text)
    return folder


def test_speed_torque_slip_and_mean(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = load_case(write(tmp_path))
    omega = np.concatenate([motion(speed=speed)[1] for speed in (5.0, 7.0, 9.0)])
    inside = np.tile((np.arange(400) > 10) & (np.arange(400) < 390), 3)
    np.testing.assert_allclose(case.roles["omega"][inside], omega[inside], rtol=0, atol=0.02)
    np.testing.assert_allclose(case.channels["torque"], 0.031 * 0.1 * omega, rtol=1e-6)
    np.testing.assert_allclose(case.roles["slip"][inside], 0.25, rtol=0, atol=0.003)
    said = " ".join(case.intake)
    assert (
        "omega [rad/s] is derived: the speed of enc, 4096 counts a turn, which begin again after 65536, reversed"
        in said
    )
    assert "the slope over 100 ms; sd of its noise 0.00422 rad/s." in said
    assert "torque [N m] is derived: k*i." in said
    assert "steady [m/s] is derived: the mean of v over 50 ms (5 rows" in said
    np.testing.assert_allclose(case.extra["steady"][inside], 0.06 * omega[inside], rtol=2e-4)
    status, out, _ = terrapin(capsys, "compare", tmp_path, "--json", "-")
    assert status == 0
    assert any("omega [rad/s] is derived" in line for line in json.loads(out)["intake"]["remarks"])
    terrapin(capsys, "report", tmp_path, "--no-discover", "-o", tmp_path / "page.html")
    assert "is derived: the speed of enc" in (tmp_path / "page.html").read_text()


def test_the_noise_is_the_one_that_is_told() -> None:
    """Of a uniform rounding at many phases and of white noise: within 15 % of what the factor says."""
    random = np.random.default_rng(2)
    time, run = np.arange(2000) * 0.01, np.zeros(2000, np.int64)
    for width in (0.05, 0.2):
        angle = 3.3 * time + random.uniform(0, 1, 2000)  # the phase of each row's rounding
        rate, gain = slope(np.floor(1000 * angle) - 1000 * (angle - 3.3 * time), time, run, width)
        assert (rate - 3300)[50:-50].std() == pytest.approx(COUNT_NOISE * np.median(gain), rel=0.15)
        noise = random.normal(0, 2, 2000)
        smooth, factor = mean(noise, time, run, width)
        assert smooth[50:-50].std() == pytest.approx(2 * np.median(factor), rel=0.15)


def test_runs_and_gaps_stay_apart() -> None:
    time = np.array([0.0, 0.1, 0.2, 0.3, 0.0, 0.1, 0.2])
    run = np.array([0, 0, 0, 0, 1, 1, 1])
    values = np.array([0.0, 1.0, np.nan, 3.0, 100.0, 99.0, 98.0])
    rate, _ = slope(values, time, run, 0.2)
    np.testing.assert_allclose(rate, [10, 10, np.nan, 10, -10, -10, -10], atol=1e-9)
    assert np.isnan(mean(values, time, run, 0.2)[0]).tolist() == [False, False, True, False, False, False, False]
    counts = np.array([250.0, 255.0, 3.0, 250.0])
    assert unwrapped(counts, np.zeros(4, np.int64), 256.0).tolist() == [250.0, 255.0, 259.0, 250.0]
    alone, _ = slope(np.array([1.0, 2.0]), np.array([0.0, 1.0]), np.array([0, 1]), 1.0)
    assert np.isnan(alone).all()


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (
            'unit = "N m" }\nslip',
            'unit = "N" }\nslip',
            ["case.toml:", "data.derived.torque.unit", "found 'N', but k*i gives"],
        ),
        ('column = "i_mA"', 'column = "amps"', ["data.derived.torque.with.i", "'amps' is not in x.csv", "i_mA"]),
        (', k = "31 mN m/A" }', " }", ["data.derived.torque", "k is not given"]),
        ('formula = "k*i"', 'formula = "k*(i"', ["data.derived.torque.formula"]),
        ("wrap = 65536", "wrap = 0", ["data.derived.omega.wrap", "expected more than 0"]),
        ('window = "100 ms"', 'window = "100 mm"', ["data.derived.omega.window"]),
        ('counts = "enc"', 'counts = "encoder"', ["data.derived.omega", "'encoder' is not in x.csv"]),
        ('counts = "enc"', 'count = "enc"', ["data.derived.omega", "expected one"]),
        ("\nsteady =", "\nv =", ["data.derived.v", "found a column of the files"]),
        (
            'column = "t_ms", unit = "ms" }, window = "50 ms"',
            'column = "run" }, window = "50 ms"',
            ["data.derived.steady.time"],
        ),
    ],
)
def test_bad_input_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], before: str, after: str, expected: list[str]
) -> None:
    assert before in CASE
    write(tmp_path, CASE.replace(before, after))
    status, out, err = terrapin(capsys, "compare", tmp_path)
    assert (status, out) == (2, "")
    one_line(err, expected)


def test_times_that_step_back_are_named(tmp_path: Path) -> None:
    write(tmp_path)
    lines = (tmp_path / "x.csv").read_text().splitlines()
    lines[5], lines[6] = lines[6], lines[5]
    (tmp_path / "x.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(UserError, match=r"data\.derived\.omega\.time: x\.csv:7 is not later than the row before"):
        load_case(tmp_path)


def test_a_division_by_zero_is_a_gap_that_is_told(tmp_path: Path) -> None:
    write(tmp_path)
    text = CASE.replace('w = { column = "omega", unit = "rad/s" }', 'w = { column = "still", unit = "rad/s" }')
    lines = (tmp_path / "x.csv").read_text().splitlines()
    rows = [f"{line},{0.0 if number % 100 == 7 else 9.0}" for number, line in enumerate(lines[1:])]
    (tmp_path / "x.csv").write_text("\n".join([f"{lines[0]},still", *rows]) + "\n")
    (tmp_path / "case.toml").write_text(text)
    case = load_case(tmp_path)
    assert case.rows == 1200 - 12
    said = " ".join(case.intake)
    assert "; no number in 12 rows (a division by 0, or the like)." in said
    assert "12 of 1200 rows left out: no number in a mapped column (slip 12)" in said


def test_of_a_log(tmp_path: Path) -> None:
    """Signals that only a derived column uses are waited for, too."""
    (tmp_path / "b.dbc").write_text(
        'VERSION ""\nBU_: A\nBO_ 272 M: 8 A\n SG_ enc : 0|16@1+ (1,0) [0|0] "1" A\n'
        'BO_ 273 N: 8 A\n SG_ f : 0|16@1+ (0.1,0) [0|0] "N" A\n'
    )
    rows = [f"({0.01 * i:.6f}) can0 111#{i % 50:02X}00\n" for i in range(300)]
    rows += [f"({0.01 * i + 0.001:.6f}) can0 110#{(i * 700) % 65536:04X}\n" for i in range(50, 300)]
    rows = sorted(row if "110#" not in row else f"{row[:-5]}{row[-3:-1]}{row[-5:-3]}\n" for row in rows)
    (tmp_path / "x.log").write_text("".join(rows))
    (tmp_path / "case.toml").write_text("""
[case]
title = "log"
[model]
base = "equation"
equation = { f = "a + b*w" }
[fit]
a = { value = 0.0, min = -99.0, max = 99.0, unit = "N" }
b = { value = 0.0, min = -99.0, max = 99.0, unit = "N s/turn" }
[data]
files = ["x.log"]
dbc = "b.dbc"
period = "10 ms"
train = ["x"]
derived = { w = { counts = "M.enc", counts_per_turn = 70000, wrap = 65536, time = { column = "time", unit = "s" }, window = "50 ms", unit = "turn/s" } }
columns = { f = { column = "N.f", unit = "N" }, w = { column = "w", unit = "turn/s" } }
""")  # noqa: E501
    case = load_case(tmp_path)
    assert case.rows == pytest.approx(249, abs=1)
    np.testing.assert_allclose(case.roles["w"][3:-3], 1.0, rtol=1e-9)
