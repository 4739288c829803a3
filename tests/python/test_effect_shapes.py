"""`terrapin effects`: every effect explained with its shape, in the terminal and as a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from casekit import one_line, terrapin

from terrapin_hil.physics.effects import catalogue
from terrapin_tools.workbench.story.effect_picture import HEIGHT, shape_of


@pytest.mark.parametrize("name", catalogue())
def test_every_effect_shows_its_shape(capsys: pytest.CaptureFixture[str], name: str) -> None:
    status, out, _ = terrapin(capsys, "effects", name)
    assert status == 0
    plot = out[out.index("  shape ") :].splitlines()
    assert len(plot) == 1 + HEIGHT + 2
    assert max(map(len, plot[1:])) <= 80
    assert "*" in "".join(plot[1:-2])
    assert shape_of(catalogue()[name]).variable in plot[-1]


ACTS = {  # of an equation's first, where a name is of both
    "stribeck": ["is added to channel", "adds a resisting torque [N m]"],
    "gain": ["multiplies channel by 1 + it"],
    "heating": ["multiplies parameter by 1 + it"],
    "offset": ["is added to the measured channel"],
    "sensor_lag": ["sends the channel through a low-pass of first order with it as the time constant"],
    "backlash": ["is added to channel", "lets the encoder follow through a gap of it [rad]"],
    "input_delay": ["lets the inputs act later by it [s]"],
    "sensor_delay": ["makes every channel late by it [s]"],
    "encoder_misalignment": ["is the error [rad] of the angle that the encoder measures"],
    "split_ground": ["is added to encoder"],
    "motor_heating": ["multiplies torque_constant by 1 + it"],
}


@pytest.mark.parametrize("name", ACTS)
def test_it_says_what_an_effect_acts_on(capsys: pytest.CaptureFixture[str], name: str) -> None:
    _, out, _ = terrapin(capsys, "effects", name)
    assert [line[14:] for line in out.splitlines() if line.startswith("  acts ")] == ACTS[name]


def test_the_simulator_has_no_switch_for_an_effect_of_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = terrapin(capsys, "effects", "viscous_friction")
    said = [line[14:] for line in out.splitlines() if line.startswith("  simulator ")]
    assert said == ["has no switch for it", "can switch it on"]


def test_the_shape_is_the_formula() -> None:
    """Written out a second time."""
    stribeck = shape_of(catalogue()["stribeck"])
    assert stribeck.variable == "omega"
    np.testing.assert_allclose(stribeck.y, np.exp(-((stribeck.x / 2.0) ** 2)) * np.sign(stribeck.x))
    rate = shape_of(catalogue()["rate_effect"])
    assert rate.variable == "speed"
    assert rate.x.min() > 0.0
    np.testing.assert_allclose(rate.y, rate.x / 0.1 - 1)


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_a_picture_with_the_same_bytes_every_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    one, two = tmp_path / f"one.{kind}", tmp_path / f"two.{kind}"
    for target in (one, two):
        assert terrapin(capsys, "effects", "slip_sinkage", "--plot", target)[0] == 0
    assert one.read_bytes() == two.read_bytes()
    assert len(one.read_bytes()) > 3000
    if kind == "svg":
        assert "Resistance of slip sinkage" in one.read_text()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["slope", "--plot", "x.jpg"], ["--plot", "x.jpg", ".svg"]),
        (["--plot", "x.svg"], ["--plot", "name of an effect"]),
        (["gravity"], ["gravity", "slope"]),
        (["slope", "--case", "nowhere"], ["nowhere", "case.toml"]),
    ],
)
def test_wrong_options(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    expected: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = terrapin(capsys, "effects", *arguments)
    assert (status, out) == (2, "")
    one_line(err, expected)
    assert list(tmp_path.iterdir()) == []
