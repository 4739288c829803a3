"""The step's cost on the emulated Cortex-M4, held within the budget: every shipped scenario, with everything switched
on too, the moment at which the bridge is set, and what a search finds that wants it long. Every tick's answer is the
host's, bit for bit."""

from __future__ import annotations

import shutil
import struct
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from terrapin_hil import paths
from terrapin_hil.firmware import Firmware
from terrapin_hil.messages import Frame, Sender, interface
from terrapin_hil.nodes import Node, node_count
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from tests.target.replay import (
    COMPENSATIONS,
    FRAME,
    NODE,
    RESET,
    TICK,
    Counts,
    Recording,
    compensated,
    count_all,
    emulate,
    image,
    on_host,
    output_type,
    record,
    whole,
)
from tests.target.worst import bases, build, load, search

BUDGET = tomllib.loads((Path(__file__).parent / "budget.toml").read_text())["step"]
SCENARIOS = sorted(path.stem for path in paths.SCENARIOS.glob("*.toml"))
pytestmark = [
    pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="qemu-system-arm is not installed"),
    pytest.mark.skipif(not image().is_file(), reason="the ARM images are not built (no ARM cross compiler)"),
]


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


Tick = tuple[int, int, int, int, bool, int]  # what came, what was taken [instructions], how many, step, bridge, duty


def flood(
    per_tick: Sequence[Sequence[Frame]], recording: Recording, begin: int, firmware: Firmware, node: int = 0
) -> list[Tick]:
    """The ticks of a recording from `begin` on, before each of which these frames come, with the identifiers of this
    node. The bridge is as it was when they came."""
    inputs = recording.inputs[: begin + len(per_tick)]
    words = [(name, "<u4") for name in ("drive", "think", "intake", "taken", "mode")]
    kind = np.dtype([*words, ("outputs", output_type(firmware))], align=True)
    records = [struct.pack("<II", NODE, node), struct.pack(f"<I{len(recording.values)}i", RESET, *recording.values)]
    to_bus = Node(node).to_bus
    for i, row in enumerate(inputs):
        here = [to_bus(frame) for frame in per_tick[i - begin]] if i >= begin else []
        records += [struct.pack("<IHB8sx", FRAME, f[0], len(f[1]), f[1].ljust(8, b"\0")) for f in here]
        records.append(struct.pack("<I", TICK) + row.tobytes())
    answer, at, ticks, on = emulate(b"".join(records)), 4, [], False
    for i in range(len(inputs)):
        count = len(per_tick[i - begin]) if i >= begin else 0
        came = sum(struct.unpack_from(f"<{count}I", answer, at))
        tick = np.frombuffer(answer, kind, 1, at + 4 * count)[0]
        step = int(tick["drive"]) + int(tick["think"])
        ticks.append((came, int(tick["intake"]), int(tick["taken"]), step, on, int(tick["outputs"]["duty"])))
        on = bool(tick["outputs"]["enable"])
        at += 4 * count + kind.itemsize
    assert at == len(answer)
    return ticks[begin:]


def frame_kinds() -> dict[str, list[Frame]]:
    """Every kind of frame, those of a kind in the order of their counters, and a random mixture of all."""
    sender, rng = Sender(), np.random.default_rng(1)
    parameters = list(interface().parameters.values())
    kinds = {
        "write": [sender.frame("PARAMETER_WRITE", {"index": p.index, "value": p.default}) for p in parameters],
        "read": [sender.frame("PARAMETER_READ", {"index": p.index}) for p in parameters],
        "save": [sender.frame("STORE_COMMAND", {"action": 1}) for _ in range(120)],
        "defaults": [sender.frame("STORE_COMMAND", {"action": 2}) for _ in range(120)],
        "store": [sender.frame("STORE_READ", {"part": 0})],
        "run": [sender.frame("COMMAND", {"request": 2, "setpoint": 5000}) for _ in range(120)],
        "idle": [sender.frame("COMMAND", {"request": 2 * (i % 3), "setpoint": 5000}) for i in range(120)],
        "wrong key": [sender.frame("TEST_MODE", {"key": 5}) for _ in range(120)],
        "sensors": [(0x100 + i, bytes(8)) for i in range(3)],
        "damaged": [(0x080, bytes(8)), (0x081, bytes(8)), (0x084, bytes(8)), (0x081, bytes(3))],
        "foreign": [(0x7DF, bytes(8))],
    }
    every = [frame for kind in kinds.values() for frame in (kind * 120)[:120]]
    kinds["mixture"] = [every[i] for i in rng.integers(0, len(every), 2400)]
    # What is dearest: a frame that is taken at any price, commands that are looked at, and two IDLEs before all others.
    run, idle = kinds["run"], [sender.frame("COMMAND", {"request": 0}) for _ in range(120)]
    kinds["stop at last"] = [
        frame
        for i in range(40)
        for frame in (kinds["save"][i], *(run[(5 * i + k) % 120] for k in range(5)), idle[2 * i], idle[2 * i + 1])
    ]
    # Apart from the mixture: in test mode a tick is one of the frames, and only frames that switch it wait.
    kinds["test mode"] = [frame for _ in range(60) for frame in sender.test_mode()]
    return kinds


def by_eights(frames: list[Frame], ticks: int) -> list[list[Frame]]:
    return [[frames[(8 * i + k) % len(frames)] for k in range(8)] for i in range(ticks)]


@pytest.fixture(scope="module")
def longest(firmware: Firmware) -> Recording:
    found = load(Path(__file__).parent / "longest.json")
    return build(found, bases(firmware, (found.base,)), firmware)


KINDS = list(frame_kinds())
ENDS = (0, node_count() - 1)  # node 0 takes frames as they are; the others are alike


@pytest.mark.parametrize("node", ENDS)
@pytest.mark.parametrize("name", KINDS)
def test_a_flood_of_frames_while_it_drives(
    name: str, node: int, recordings: Mapping[str, Recording], longest: Recording, firmware: Firmware
) -> None:
    """8 frames a tick, the bridge on: intake and step together, and the intake with the longest step that is known."""
    [counted] = count_all([longest], firmware)
    for recording, begin in ((recordings["slope_limiter"], 3000), (longest, 2400)):
        ticks = [
            tick for tick in flood(by_eights(frame_kinds()[name], 300), recording, begin, firmware, node) if tick[4]
        ]
        assert len(ticks) > 0
        assert max(came + taken + step for came, taken, _, step, _, _ in ticks) <= BUDGET["flood"]
        most = max(came + taken for came, taken, *_ in ticks)
        assert 100 < most <= BUDGET["flood"] - whole(counted).max()


@pytest.mark.parametrize("node", ENDS)
@pytest.mark.parametrize("name", KINDS)
def test_a_flood_of_frames_with_the_bridge_off(
    name: str, node: int, recordings: Mapping[str, Recording], plain: Mapping[str, Counts], firmware: Firmware
) -> None:
    """The same with the bridge off: the intake with the longest of all scenarios' steps that leave it off."""
    off = max(int(whole(counted)[~counted["outputs"]["enable"]].max()) for counted in plain.values())
    ticks = flood(by_eights(frame_kinds()[name], 100), recordings["slope_limiter"], 4, firmware, node)
    most = max(came + taken for came, taken, _, _, on, _ in ticks if not on)
    assert 100 < most <= BUDGET["flood_off"] - off


@pytest.mark.parametrize("node", ENDS)
@pytest.mark.parametrize("kind", ["defaults", "test mode"])
def test_a_flood_that_resets_parameters_anywhere(
    kind: str, node: int, recordings: Mapping[str, Recording], plain: Mapping[str, Counts], firmware: Firmware
) -> None:
    """The gains are worked out anew; how long that takes depends on the parameters."""
    rng = np.random.default_rng(5)
    off = max(int(whole(counted)[~counted["outputs"]["enable"]].max()) for counted in plain.values())
    for _ in range(8):
        values = tuple(int(rng.integers(p.minimum, p.maximum + 1)) for p in firmware.interface.parameters.values())
        recording = Recording(values, recordings["slope_limiter"].inputs)
        ticks = flood(by_eights(frame_kinds()[kind], 20), recording, 4, firmware, node)
        assert 5000 < max(came + taken for came, taken, *_ in ticks) <= BUDGET["flood_off"] - off


def test_idle_behind_seven_others_is_taken_in_the_same_tick(
    recordings: Mapping[str, Recording], plain: Mapping[str, Counts], firmware: Firmware
) -> None:
    """An IDLE shorts the motor, which brakes."""
    sender = Sender()
    begin = int(np.flatnonzero(plain["slope_limiter"]["outputs"]["duty"] > 1000)[500])
    others = [sender.frame("STORE_READ", {"part": 0}) for _ in range(7)]
    idle = sender.frame("COMMAND", {"request": 0})
    [without] = flood([others], recordings["slope_limiter"], begin, firmware)
    [stopped] = flood([[*others, idle]], recordings["slope_limiter"], begin, firmware)
    assert without[4] is stopped[4] is True  # the bridge was on
    assert without[2] == stopped[2] == 1  # of the seven
    assert without[5] > 1000
    assert stopped[5] == 0


def test_what_waits_is_taken_in_the_next_ticks(recordings: Mapping[str, Recording], firmware: Firmware) -> None:
    """8 reads before every second tick are taken in two, and none is lost."""
    reads = by_eights(frame_kinds()["read"], 100)
    per_tick = [reads[i // 2] if i % 2 == 0 else [] for i in range(200)]
    ticks = flood(per_tick, recordings["slope_limiter"], 3000, firmware)
    assert all(on for *_, on, _ in ticks)
    assert [taken for _, _, taken, *_ in ticks] == [4] * 200
