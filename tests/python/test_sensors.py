"""Sensor models and random numbers, one by one and through whole runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from terrapin_hil.library import ffi, library
from terrapin_hil.robot.plant import TERRAINS, Ground, Segment
from terrapin_hil.robot.sensors import Sensors, kit
from terrapin_hil.scenario.scenario import Order, Scenario
from terrapin_hil.simulation import Simulation

CURRENT, SUPPLY, TEMPERATURE, MOTOR, WHEEL, SWING = range(6)


class Bench:
    """Sensors without a robot: true values in, readings out."""

    def __init__(self, seed: int = 1, **channels: dict[str, float]) -> None:
        self.f, self.lib = ffi(), library()
        self.sensors = self.f.new("hil_sensors *")
        self.state = self.f.new("hil_sensor_state *")
        for i in range(3):
            self.sensors.adc[i] = {"lsb": 1e-3, "zero": 2048.0, "inl_cycles": 1.0, **channels.get("adc", {})}
        for i in range(2):
            self.sensors.encoder[i] = {"counts_per_turn": 2048.0, **channels.get("encoder", {})}
        for i in range(4):
            self.sensors.digital[i] = {
                "present": True, "resolution": 1e-3, "largest": 4095.0, **channels.get("digital", {})
            }  # fmt: skip
        self.lib.hil_sensors_start(self.state, seed)
        self.values = self.f.new("double[9]")

    def push(self, channel: int, value: float) -> None:
        self.values[channel] = value
        self.lib.hil_sensors_push(self.state, self.values)

    def adc(self, value: float) -> int:
        self.push(CURRENT, value)
        return int(self.lib.hil_adc_read(self.sensors, self.state, 0))

    def encoder(self, angle: float, loss: float = 0.0) -> int:
        self.push(MOTOR, angle)
        return int(self.lib.hil_encoder_read(self.sensors, self.state, 0, loss))

    def digital(self, value: float) -> int:
        self.push(SWING, value)
        return int(self.lib.hil_digital_read(self.sensors, self.state, 0))


# ------------------------------------------------------------------ random numbers


def normals(seed: int, stream: int, count: int) -> np.ndarray:
    f, lib = ffi(), library()
    random = f.new("hil_random *", lib.hil_random_split(seed, stream))
    return np.array([lib.hil_random_normal(random) for _ in range(count)])


def test_normals_are_normal_and_streams_independent() -> None:
    a, b = normals(1, 0, 20000), normals(1, 1, 20000)
    assert stats.kstest(a, "norm").pvalue > 1e-3
    assert stats.kstest(normals(2, 0, 20000), "norm").pvalue > 1e-3
    for x, y in ((a, b), (a, normals(2, 0, 20000)), (a[:-1], a[1:]), (a**2, b**2)):
        assert abs(np.corrcoef(x, y)[0, 1]) < 4 / np.sqrt(len(x))


def test_same_seed_same_bits() -> None:
    assert np.array_equal(normals(7, 3, 100), normals(7, 3, 100))
    assert not np.any(normals(7, 3, 100) == normals(8, 3, 100))


# ------------------------------------------------------------------ converters


@given(st.floats(-3.0, 3.0))
def test_ideal_converter_rounds_and_clips(current: float) -> None:
    code = Bench().adc(current)
    assert 0 <= code <= 4095
    assert abs(code - np.clip(2048 + current / 1e-3, 0, 4095)) <= 0.5 + 1e-9


def test_offset_gain_and_non_linearity() -> None:
    assert Bench(adc={"offset": 2.0}).adc(0.0) == 2050
    assert Bench(adc={"gain_error": 0.005}).adc(1.0) == 2048 + 1005
    inl = {"inl": 8.0, "inl_cycles": 1.0}
    assert [Bench(adc=inl).adc(i) for i in (-1.024, 0.0, 1.024)] == [1024 + 8, 2048, 3072 - 8]
    bow = {"inl": 8.0, "inl_cycles": 0.5}
    assert [Bench(adc=bow).adc(i) for i in (-2.048, 0.0, 2.047)] == [0, 2056, 4095]


def test_noise_dithers_the_rounding_away() -> None:
    bench = Bench(adc={"noise": 0.5})
    codes = np.array([bench.adc(0.1003) for _ in range(20000)])
    assert np.mean(codes) - 2048 == pytest.approx(100.3, abs=0.02)
    assert np.std(codes) == pytest.approx(np.sqrt(0.25 + 1 / 12), abs=0.02)


# ------------------------------------------------------------------ encoders


@given(st.floats(-1e4, 1e4))
def test_encoder_counts_and_wraps(angle: float) -> None:
    assert Bench().encoder(angle) == int(np.floor(angle * 2048 / (2 * np.pi))) % 65536


def test_misalignment_errs_once_a_turn_and_not_over_whole_turns() -> None:
    bench = Bench(encoder={"misalignment": 0.01})
    turns = np.linspace(0, 4 * np.pi, 4097)
    error = np.array([bench.encoder(a) for a in turns]) - turns * 2048 / (2 * np.pi)
    assert np.max(error) == pytest.approx(0.01 * 2048 / (2 * np.pi), abs=1.1)
    assert abs(error[2048] - error[0]) <= 1
    assert abs(error[4096] - error[2048]) <= 1


def test_lost_counts() -> None:
    bench = Bench()
    steps = np.arange(0, 20 * np.pi, 0.01)
    sound = bench.encoder(float(steps[-1]))
    bench = Bench()
    for angle in steps:
        count = bench.encoder(float(angle), loss=0.1)
    assert sound - count == pytest.approx(0.1 * sound, rel=0.1)


def test_counts_are_lost_in_both_directions() -> None:
    """Each loss shortens the way that is counted, whichever way it goes: there and back the losses do not add up."""
    bench = Bench()
    steps = np.arange(0, 20 * np.pi, 0.01)
    there = [bench.encoder(float(angle), loss=0.1) for angle in steps][-1]
    back = [bench.encoder(float(angle), loss=0.1) for angle in steps[::-1]][-1]
    signed = (back + 0x8000) % 0x10000 - 0x8000
    assert there - signed == pytest.approx(0.9 * 20480, rel=0.02)
    assert abs(signed) < 300


# ------------------------------------------------------------------ digital sensors, delay


def test_digital_sensor_rounds_and_saturates() -> None:
    bench = Bench()
    assert [bench.digital(v) for v in (0.0004, 0.0006, 99.0, -99.0)] == [0, 1, 4095, -4096]


def test_delay_is_whole_ticks() -> None:
    bench = Bench()
    bench.sensors.delay[SWING] = 3
    assert [bench.digital(0.001 * i) for i in range(7)] == [0, 0, 0, 0, 1, 2, 3]


# ------------------------------------------------------------------ in a run


def frames(sensors: Sensors, seed: int = 1, ticks: int = 300, prepare: Callable[[Any], None] | None = None) -> Any:
    scenario = Scenario(
        "test", ticks / 1000, Ground((Segment(TERRAINS["sand"]),)), (Order(0.0, "run"),), seed=seed, sensors=sensors
    )
    simulation = Simulation(scenario)
    if prepare is not None:
        prepare(simulation)
    simulation.drive(6.0, ticks)
    simulation.write_frames(0)
    return simulation.records


def words(records: Any, index: int) -> np.ndarray:
    data: np.ndarray = records["host"]["data"][:, index].copy().view("<u8")
    return data.reshape(-1)


def test_sampling_order() -> None:
    """SENSORS_SLOW (0x101) or, at every 50th tick, COMMAND (0x080); then SENSORS_FAST (0x100); slow ones alternate."""
    records = frames(kit("exact"))
    first, second = records["host"]["id"][:, 0], records["host"]["id"][:, 1]
    ticks = np.arange(len(records))
    assert np.all(first == np.where(ticks % 50 == 0, 0x080, 0x101))
    assert np.all(second == 0x100)
    slow = ticks % 50 != 0
    channel = (words(records, 0)[slow] >> np.uint64(12)) & np.uint64(1)
    assert np.all(channel == ticks[slow] % 2)
    assert np.all((words(records, 1) >> np.uint64(48)) & np.uint64(0xFFFF) == ticks)
    supply = words(records, 0)[slow & (ticks % 2 == 0)] & np.uint64(0xFFF)
    assert np.all(supply == 3000)  # 12 V at 4 mV a code
    temperature = words(records, 0)[slow & (ticks % 2 == 1)] & np.uint64(0xFFF)
    assert temperature[0] == 1500  # 25 degC at 0.05 K a code from -50 degC
    assert np.max(temperature) <= 1502  # it warms a little


def test_seed_makes_the_noise_and_only_the_noise() -> None:
    sensors = kit("real")
    a, b, c = frames(sensors, 1), frames(sensors, 1), frames(sensors, 2)
    assert np.array_equal(a["host"]["data"], b["host"]["data"])
    assert not np.array_equal(a["host"]["data"], c["host"]["data"])
    assert np.array_equal(a["truth"], c["truth"])


def test_streams_do_not_touch_each_other() -> None:
    sensors = kit("real")
    quiet = replace(sensors, pitch=replace(sensors.pitch, present=False))
    current = [words(frames(s), 1) & np.uint64(0xFFF) for s in (sensors, quiet)]
    assert np.array_equal(*current)


def test_an_encoder_with_play_follows_through_its_gap() -> None:
    bench = Bench(encoder={"play": 0.2})
    there = [bench.encoder(a) for a in np.linspace(0.0, 1.0, 11)]
    back = [bench.encoder(a) for a in np.linspace(1.0, 0.0, 11)]
    per = 2048 / (2 * np.pi)
    assert there[0] == 0
    assert there[-1] == int(np.floor(0.9 * per))
    assert back[1] == back[2] == there[-1]  # crossing the gap
    assert back[-1] == int(np.floor(0.1 * per))
