"""Two recordings of one test: the offset of their clocks comes back, or it is said that it cannot be told."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from casekit import one_line, terrapin

from terrapin_tools.workbench.intake.clock_offset import Offset, averaged, clock_offset

SLOW, FAST = np.arange(0, 40, 0.02), np.arange(0, 40, 0.001)  # 50 and 1,000 Hz
SAMPLE = 0.02
Signal = Callable[[np.ndarray], np.ndarray]


def wandering(random: np.random.Generator) -> Signal:
    """Sums of 40 sines up to 2 Hz."""
    f, phase = random.uniform(0.02, 2.0, 40)[:, None], random.uniform(0, 2 * np.pi, 40)[:, None]
    return lambda t: (np.sin(2 * np.pi * f * t + phase) / (0.3 + f)).sum(0) / 2


def steps(random: np.random.Generator) -> Signal:
    """Twelve changes of level in 70 s, each in 0.3 s."""
    begins, levels = np.sort(random.uniform(-10, 60, 12)), random.uniform(0, 5, 13)
    at = np.concatenate([[-20], np.repeat(begins, 2) + np.tile([0, 0.3], 12), [80]])
    return lambda t: np.interp(t, at, np.repeat(levels, 2))


def draw(kind: Callable[[np.random.Generator], Signal], seed: int, drift: float = 0.0) -> tuple[float, Offset]:
    """A true offset of 0 to 5 s, gains of 1 and 2, noise of a few per cent to a third of the motion."""
    random = np.random.default_rng(seed)
    true, noise, signal = random.uniform(0, 5), random.uniform(0.02, 0.5), kind(random)
    slow = 2 * signal(SLOW) + 1 + random.normal(0, 2 * noise, len(SLOW))
    fast = signal(FAST - true - drift * (FAST - 20)) + random.normal(0, 3 * noise, len(FAST))
    return true, clock_offset(SLOW, slow, FAST, fast, 10.0)


@pytest.mark.parametrize("kind", [wandering, steps])
def test_the_offset_within_two_samples_in_95_of_100(kind: Callable[[np.random.Generator], Signal]) -> None:
    """50 draws; those that it says cannot be told are few. What it says of its sd holds too."""
    drawn = [draw(kind, seed) for seed in range(50)]
    told = [(true, found) for true, found in drawn if not found.refused]
    off = np.array([found.offset - true for true, found in told])
    assert len(told) >= 45
    assert (np.abs(off) <= 2 * SAMPLE).mean() >= 0.95
    within = np.mean(np.abs(off) <= 2 * np.array([found.offset_sd for _, found in told]))
    assert within >= 0.8
    assert all(found.drift == 0.0 for _, found in told)


@pytest.mark.parametrize("kind", ["unrelated", "levels", "periodic", "noise", "ramp", "constant", "short"])
def test_what_cannot_be_told_is_not_told(kind: str) -> None:
    for seed in range(20):
        random = np.random.default_rng(1000 + seed)
        f = random.uniform(0.3, 2)
        one, two = {
            "unrelated": lambda r=random: (wandering(r), wandering(r)),
            "levels": lambda r=random: (steps(r), steps(r)),
            "periodic": lambda f=f: (lambda t: np.sin(2 * np.pi * f * t), lambda t: np.sin(2 * np.pi * f * (t - 1.3))),
            "noise": lambda: (np.zeros_like, np.zeros_like),
            "ramp": lambda: (lambda t: 1.0 * t, lambda t: 1.0 * (t - 1)),
            "constant": lambda: (np.zeros_like, np.zeros_like),
            "short": lambda r=random: (wandering(r),) * 2,
        }[kind]()
        sd, rows = (0.0, 2000) if kind == "constant" else (0.1, 20 if kind == "short" else 2000)
        slow = one(SLOW)[:rows] + random.normal(0, sd, rows)
        fast = two(FAST) + random.normal(0, sd, len(FAST))
        assert clock_offset(SLOW[:rows], slow, FAST, fast, 10.0).refused, (kind, seed)


def test_a_drift_is_seen() -> None:
    """500 us a second are; none is without one (above). Offset and drift give the times of the other clock."""
    random = np.random.default_rng(4)
    signal = wandering(random)
    fast = signal(FAST - 1.5 - 5e-4 * (FAST - 20)) + random.normal(0, 0.1, len(FAST))
    found = clock_offset(SLOW, signal(SLOW) + random.normal(0, 0.02, len(SLOW)), FAST, fast, 10.0)
    assert not found.refused
    assert found.drift == pytest.approx(5e-4, abs=4 * found.drift_sd)
    assert found.drift_sd < 5e-5
    true = (SLOW + 1.5 - 5e-4 * 20) / (1 - 5e-4)
    np.testing.assert_allclose(found.to_fast(SLOW), true, rtol=0, atol=0.005)


def test_means_leave_white_noise_white() -> None:
    """Of 20 rows each: sd / sqrt(20), neighbours do not go together; a straight line stays one."""
    random = np.random.default_rng(3)
    mean, count = averaged(FAST, random.normal(0, 1, len(FAST)), SLOW[1:-1], SAMPLE)
    assert (np.abs(count - 20) <= 1).all()
    assert mean.std() == pytest.approx(20**-0.5, rel=0.06)
    assert abs(np.corrcoef(mean[1:], mean[:-1])[0, 1]) < 0.06
    np.testing.assert_allclose(averaged(FAST, 3 * FAST, SLOW[1:-1], SAMPLE)[0], 3 * SLOW[1:-1], atol=0.002)


def files(folder: Path) -> tuple[Path, Path, float]:
    """A rig at 50 Hz whose clock counts from 0; a drive at 1,000 Hz that counts from 1970 and began 1.7 s later."""
    random = np.random.default_rng(8)
    signal, began = wandering(random), 1_700_000_000.0
    slow = np.stack([SLOW, signal(SLOW) + random.normal(0, 0.05, len(SLOW)), 3 * SLOW], 1)
    times = FAST[:30_000]
    true = times + 1.7
    fast = np.stack([began + times, signal(true) + random.normal(0, 0.1, len(true)), 5 * true, true > 10], 1)
    np.savetxt(folder / "rig.csv", slow, "%.9g", ",", header="time [s],speed [rad/s],force [N]", comments="")
    np.savetxt(folder / "drive.csv", fast, "%.13g", ",", header="t [s],w,current [A],state", comments="")
    return folder / "rig.csv", folder / "drive.csv", began - 1.7


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig, drive, offset = files(tmp_path)
    merged = tmp_path / "merged.csv"
    for first, second, match, sign in ((rig, drive, "speed [rad/s]=w", 1), (drive, rig, "w=speed [rad/s]", -1)):
        merged.unlink(missing_ok=True)
        status, out, _ = terrapin(
            capsys, "case", "merge", first, second, "--match", match, "--to", merged,
            "--plot", tmp_path / "m.png", "--json", "-",
        )  # fmt: skip
        assert status == 0
        answer = json.loads(out)
        assert answer["offset"] == pytest.approx(sign * offset, abs=2 * SAMPLE)
        assert answer["held"] == ["state"]
        assert answer["rows"] == pytest.approx(1500, abs=3)
        assert answer["columns"]["current [A]"]["noise_sd"] == pytest.approx(5 * answer["offset_sd"], rel=0.5)
        assert answer["columns"]["w"]["noise_sd"] == pytest.approx(0.1 / 20**0.5, rel=0.3)
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")
    table = np.genfromtxt(merged, delimiter=",", skip_header=2)
    np.testing.assert_allclose(table[:, 4], 5 * table[:, 0], rtol=0, atol=5 * 2 * SAMPLE)
    np.testing.assert_array_equal(
        table[:, 5][np.abs(table[:, 0] - 10) > 0.1], table[:, 0][np.abs(table[:, 0] - 10) > 0.1] > 10
    )
    status, _, err = terrapin(
        capsys, "case", "map", merged, "--to", tmp_path / "case", "--base", "equation", "--column", "f=force [N]",
        "--unit", "f=N", "--column", "i=current [A]", "--unit", "i=A", "--equation", "f=k*i", "--fit", "k=1:0:9:N/A",
        "--train", "merged",
    )  # fmt: skip
    assert status == 0, err
    status, out, _ = terrapin(capsys, "compare", tmp_path / "case", "--json", "-")
    assert status == 0
    remarks = " ".join(json.loads(out)["intake"]["remarks"])
    assert "the clock of rig.csv is -1.7e+09 s" in remarks
    assert "by correlation of w and speed [rad/s]" in remarks
    assert "means over 0.02 s of drive.csv" in remarks


@pytest.mark.parametrize("first", ["rig.csv", "drive.csv"])
def test_a_refusal_and_an_answer_tell_the_same_offset(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], first: str
) -> None:
    """Of a program that comes twice: near the first rows one offset fits, further off two do. A refusal told them as of
    clocks that both begin at 0: found 0.00 s where the answer was 101.70 s."""
    random = np.random.default_rng(3)
    once = wandering(random)
    twice = [(times, once(times % 20.0) + random.normal(0, 0.05, len(times))) for times in (SLOW, FAST[::5])]
    for name, clock, (times, values) in zip(("rig.csv", "drive.csv"), (0.0, 101.7), twice, strict=True):
        np.savetxt(tmp_path / name, np.stack([clock + times, values], 1), "%.6f", ",", header="t [s],w", comments="")
    second = {"rig.csv": "drive.csv", "drive.csv": "rig.csv"}[first]
    words = ["case", "merge", tmp_path / first, tmp_path / second, "--match", "w=w", "--to", tmp_path / "x.csv"]
    sign = "" if first == "rig.csv" else "-"
    status, _, err = terrapin(capsys, *words, "--within", "25")
    assert status == 2
    one_line(
        err, [f"{first}, {second}: the offset", f"{sign}101.70", "fits almost as well as", "--within looks less far"]
    )
    status, out, err = terrapin(capsys, *words, "--within", "5")
    assert status == 0, err
    assert f"the clock of {second} is {sign}101.7 s" in " ".join(out.split())


def test_bad_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig, drive, _ = files(tmp_path)
    words = ["case", "merge", rig, drive, "--to", tmp_path / "x.csv"]
    for more, expected in (
        (["--match", "velocity=w"], ["rig.csv: --match: found 'velocity'", "speed [rad/s]"]),
        (["--match", "force [N]=current [A]"], ["cannot be told from force [N] and current [A]"]),
        (
            ["--match", "speed [rad/s]=w", "--hold", "force [N]"],
            ["drive.csv: --hold: found force [N] of rig.csv, the slower one"],
        ),
        (["--match", "speed"], ["expected COLUMN=COLUMN"]),
        (["--match", "speed [rad/s]=w", "--within", "0"], ["--within"]),
        (["--match", "speed [rad/s]=w", "--to", rig], ["exists already"]),
    ):
        status, out, err = terrapin(capsys, *words, *more)
        assert (status, out) == (2, "")
        one_line(err, expected)
    assert not (tmp_path / "x.csv").exists()
    rig.write_text("time [s],speed\n0,1\n1,2\n0.5,3\n")
    status, _, err = terrapin(capsys, *words, "--match", "speed=w")
    assert status == 2
    one_line(err, ["rig.csv:4: column time [s]: expected times that rise: a file of one run"])
