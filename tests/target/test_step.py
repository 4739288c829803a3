"""The step's cost on the emulated Cortex-M4, held within the budget: every shipped scenario, with everything switched
on too, the moment at which the bridge is set, and what a search finds that wants it long. Every tick's answer is the
host's, bit for bit."""

from __future__ import annotations

import shutil
import struct
import tomllib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from terrapin_hil import paths
from terrapin_hil.firmware import Firmware
from terrapin_hil.messages import Frame, Sender, interface
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from tests.target.replay import FRAME, TICK, Counts, Recording, count_all, emulate, image, on_host, record
from tests.target.worst import bases, build, load, search

BUDGET = tomllib.loads((Path(__file__).parent / "budget.toml").read_text())["step"]
SCENARIOS = sorted(path.stem for path in paths.SCENARIOS.glob("*.toml"))
# Raw values with which every compensation works, none so large that C_t leaves its range.
COMPENSATIONS = {
    "comp_speed_squared": 20_000, "comp_viscous": 20_000, "comp_coulomb": 2_000, "comp_stribeck": 3_000,
    "comp_stribeck_speed": 3_000, "comp_heating": 2_000, "comp_current_offset": 5_000, "comp_slope": 10_000,
    "comp_inertia": 5_000, "comp_imbalance": 4_000, "comp_imbalance_phase": 10_000,
}  # fmt: skip

pytestmark = [
    pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="qemu-system-arm is not installed"),
    pytest.mark.skipif(not image().is_file(), reason="the ARM images are not built (no ARM cross compiler)"),
]


def compensated(recording: Recording, firmware: Firmware) -> Recording:
    """The same inputs for a controller with every compensation set."""
    values = list(recording.values)
    for name, value in COMPENSATIONS.items():
        values[firmware.interface.parameters[name].index] = value
    return Recording(tuple(values), recording.inputs)


@pytest.fixture(scope="module")
def firmware() -> Firmware:
    return Firmware.open()


@pytest.fixture(scope="module")
def recordings(firmware: Firmware) -> dict[str, Recording]:
    return {name: record(load_scenario(find_scenario(name)), firmware=firmware) for name in SCENARIOS}


@pytest.fixture(scope="module")
def plain(recordings: Mapping[str, Recording], firmware: Firmware) -> dict[str, Counts]:
    return dict(zip(recordings, count_all(recordings.values(), firmware), strict=True))


@pytest.fixture(scope="module")
def everything(recordings: Mapping[str, Recording], firmware: Firmware) -> dict[str, Counts]:
    switched_on = [compensated(recording, firmware) for recording in recordings.values()]
    return dict(zip(recordings, count_all(switched_on, firmware), strict=True))


def whole(counted: Counts) -> np.ndarray:
    return counted["drive"].astype(np.int64) + counted["think"]


def test_compensations_are_all_there(firmware: Firmware) -> None:
    assert set(COMPENSATIONS) == {name for name in firmware.interface.parameters if name.startswith("comp_")}


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_worst_step_and_its_distance_from_the_median(name: str, plain: Mapping[str, Counts]) -> None:
    steps = whole(plain[name])
    assert 300 < steps.min() < steps.max() <= BUDGET["worst"]
    assert steps.max() <= BUDGET["worst_over_median"] * np.median(steps)


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_worst_step_with_every_compensation(
    name: str, plain: Mapping[str, Counts], everything: Mapping[str, Counts]
) -> None:
    steps = whole(everything[name])
    assert steps.max() <= BUDGET["extreme"]
    assert steps.sum() > whole(plain[name]).sum()  # they are at work


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_tick_is_the_hosts(
    name: str,
    firmware: Firmware,
    recordings: Mapping[str, Recording],
    plain: Mapping[str, Counts],
    everything: Mapping[str, Counts],
) -> None:
    """Duty, enable, faults and frames; with the compensations in two scenarios, where a run on the host is short."""
    pairs = [(recordings[name], plain[name])]
    if name in ("steady_sand", "slope_limiter"):
        pairs.append((compensated(recordings[name], firmware), everything[name]))
    for recording, counted in pairs:
        here, there = on_host(recording, firmware), counted["outputs"]
        for field in ("duty", "enable", "faults", "count"):
            assert (here[field] == there[field]).all(), field
        for i in range(2):
            sent = here["count"] > i
            for field in ("id", "length", "data"):
                assert (here["frames"][field][sent, i] == there["frames"][field][sent, i]).all(), field


def spread(runs: Mapping[str, Counts]) -> tuple[int, int]:
    """Sample to bridge over all runs: the largest difference within a control mode, and the most in a tick that changes
    it. A mode is what firmware/ports/replay/main.c tells: state, phase, control, limiter and what slip is made from."""
    low: dict[int, int] = {}
    high: dict[int, int] = {}
    changing = 0
    for counted in runs.values():
        mode, drive, on = counted["mode"], counted["drive"], counted["outputs"]["enable"]
        steady = np.concatenate([[False], (mode[1:] == mode[:-1]) & on[1:] & on[:-1]])
        changing = max(changing, int(drive[~steady].max()))
        for one in np.unique(mode[steady]):
            here = drive[steady & (mode == one)]
            low[int(one)] = min(low.get(int(one), 1 << 30), int(here.min()))
            high[int(one)] = max(high.get(int(one), 0), int(here.max()))
    assert len(low) > 8  # modes
    return max(high[one] - low[one] for one in low), changing


def test_the_bridge_is_set_at_the_same_moment(plain: Mapping[str, Counts], everything: Mapping[str, Counts]) -> None:
    for runs, bound in ((plain, BUDGET["bridge_spread"]), (everything, BUDGET["bridge_spread_compensated"])):
        found, changing = spread(runs)
        assert 0 < found <= bound
        assert changing <= BUDGET["bridge_change"]


def test_a_search_finds_none_that_is_longer(firmware: Firmware) -> None:
    """A short one, and what a long one found (tests/target/worst.py --out), which stays the longest known."""
    longest = load(Path(__file__).parent / "longest.json")
    [counted] = count_all([build(longest, bases(firmware, (longest.base,)), firmware)], firmware)
    assert BUDGET["worst"] < whole(counted).max() <= BUDGET["extreme"]
    found = search(3, 11, firmware)
    assert 1000 < found.instructions <= BUDGET["extreme"]


def flood(frames: list[Frame], recording: Recording, ticks: int) -> tuple[int, int]:
    """The longest step, and the longest frame, with 8 of `frames` before each of the last ticks."""
    records = [struct.pack(f"<I{len(recording.values)}i", 1, *recording.values)]
    per_tick = []
    for i, row in enumerate(recording.inputs[:ticks]):
        here = [frames[(8 * i + k) % len(frames)] for k in range(8)] if i >= ticks // 2 else []
        per_tick.append(len(here))
        records += [struct.pack("<IHB8sx", FRAME, f[0], len(f[1]), f[1].ljust(8, b"\0")) for f in here]
        records.append(struct.pack("<I", TICK) + row.tobytes())
    answer, at, together, longest = emulate(b"".join(records)), 4, 0, 0
    width = (len(answer) - 4 - 8 * sum(per_tick)) // len(per_tick)
    for count in per_tick:
        taken = [struct.unpack_from("<I", answer, at + 8 * k)[0] for k in range(count)]
        at += 8 * count
        together = max(together, sum(taken) + sum(struct.unpack_from("<II", answer, at)))
        longest = max([longest, *taken])
        at += width
    return together, longest


def test_a_flood_of_frames_while_it_drives(recordings: Mapping[str, Recording]) -> None:
    """Every kind of frame, 8 a tick, the bridge on: intake and step together."""
    sender, description = Sender(), interface()
    parameters = list(description.parameters.values())
    kinds = [
        [sender.frame("PARAMETER_WRITE", {"index": p.index, "value": p.default}) for p in parameters],
        [sender.frame("PARAMETER_READ", {"index": p.index}) for p in parameters],
        [sender.frame("STORE_COMMAND", {"action": 1 + i % 2}) for i in range(15)],
        [sender.frame("STORE_READ", {"part": i % 2}) for i in range(2)],
        [sender.frame("COMMAND", {"request": 2, "setpoint": 5000}) for _ in range(15)],
        [(0x7DF, bytes(8)), (0x080, bytes(8)), (0x081, bytes(3))],
    ]
    mixture = [frame for kind in kinds for frame in kind[:15]]
    for frames in [*kinds, mixture]:
        together, longest = flood(frames, recordings["slope_limiter"], 3400)
        assert 0 < longest < together <= BUDGET["flood"]
