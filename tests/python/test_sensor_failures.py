"""A broken sensor moves nothing that nobody asked for: tests/campaigns/sensors.py in short, and its planted defect."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from terrapin_hil.robot.sensors import CHANNELS
from tests.campaigns.sensor_reasons import REASONS
from tests.campaigns.sensors import (
    BEGIN,
    END,
    PAGE,
    SITUATIONS,
    WAYS,
    Outcome,
    bound,
    fail,
    failures,
    planted,
    unnamed,
)

QUICK = ("stuck", "zero", "full scale", "dropout", "sign", "scale 2", "delay", "intermittent")


@pytest.mark.parametrize("name", SITUATIONS)
def test_a_ground_wheel_that_fails_is_named_and_moves_nothing(name: str) -> None:
    for way in WAYS:
        outcome = fail(name, "wheel", way)
        assert outcome.unasked <= bound(), outcome
        if way in QUICK:
            assert outcome.named, outcome
            assert "ground_wheel" in outcome.faults, outcome


def test_failures_drawn_at_random_move_nothing() -> None:
    draw = random.Random(35)
    everything = [(name, channel, way) for name in SITUATIONS for channel in CHANNELS for way in WAYS]
    for name, channel, way in draw.sample(everything, 25):
        outcome = fail(name, channel, way)
        assert outcome.unasked <= bound(), outcome


def test_a_loose_contact_of_the_motor_encoder_is_found() -> None:
    outcome = fail("floor", "motor", "intermittent")
    assert outcome.faults == ("motor_encoder",), outcome
    assert outcome.after < 0.8, outcome
    assert outcome.unasked < 0.1, outcome


def test_every_way_is_a_fault_of_its_channel() -> None:
    for channel in CHANNELS:
        told = [failures(channel, way, 1.0) for way in WAYS]
        assert all(faults and all(fault.channel == channel for fault in faults) for faults in told)
        assert len(set(told)) == len(WAYS) - (told[1] == told[4])


def test_without_the_checks_the_robot_backs_out_of_nowhere(tmp_path: Path) -> None:
    outcome = fail("sand", "wheel", "stuck", firmware=planted(tmp_path))
    assert outcome.unasked > bound(), outcome
    assert outcome.ended == "extricate", outcome


def test_what_is_not_named_has_a_reason_and_what_is_has_none() -> None:
    def outcome(channel: str, way: str, after: float) -> Outcome:
        return Outcome("cylinder", "floor", channel, way, 0.0, 0.0, ("one",), after, "run")

    late = outcome("pitch", "zero", 0.6)
    assert "| pitch | zero | 0 of 1 | 1 | no second sensor" in unnamed([late])
    assert "named (50%)" in unnamed([late, outcome("pitch", "zero", 0.5)])
    with pytest.raises(SystemExit, match="pitch, zero: a reason is given"):
        unnamed([outcome("pitch", "zero", 0.5)])
    with pytest.raises(SystemExit, match="wheel, zero: no reason is given"):
        unnamed([outcome("wheel", "zero", 0.6)])


def test_the_page_lists_every_reason_once() -> None:
    listed = PAGE.read_text(encoding="utf-8").split(BEGIN.format("list"))[1].split(END.format("list"))[0]
    rows = [tuple(row.split(" | ")) for row in listed.splitlines() if row.startswith("| ")][1:]
    assert {(row[0].removeprefix("| "), row[1]): row[4].removesuffix(" |") for row in rows} == dict(REASONS)
    assert len(rows) == len(REASONS)
