"""Looks for the longest step: an evolution over shipped scenarios, parameters anywhere in their ranges, compensations,
and inputs that no sensor gave, whose fitness is the count of instructions on the emulated Cortex-M4.

    python tests/target/worst.py --generations 50 --seed 1 --robot sphere

A candidate is what a scenario's run recorded, with other parameters and edits of the inputs. The controller answers,
the world does not follow: so states are reached that no simulation would reach. The same seed finds the same.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # runs as a script too

from terrapin_hil import paths, reading
from terrapin_hil.firmware import Firmware
from terrapin_hil.robots import select
from terrapin_hil.scenario.scenario import load_scenario, read_scenario
from terrapin_interface.robot import DEFAULT
from tests.target.replay import Counts, Recording, count_all, record

__all__ = ["BASES", "Candidate", "Found", "bases", "build", "search"]

# What the edits start from: every control mode, the limiter, stuck, calibration, no swing sensor, each kind of fault.
BASES = ("slope_limiter", "carriage_limiter", "floor_calibration", "speed_control", "no_swing_sensor",
         "extremes_from_outside", "over_current")  # fmt: skip
TICKS = 7000  # of each recording, from its begin: past the slope's stuck robot and into the calibration
KEPT, TRIED = 12, 48  # candidates of a generation
# Fields of terrapin_inputs that an edit may take, with the bytes of each; `tick` jumps by a little.
FIELDS = {
    "current_code": 2, "supply_code": 2, "temperature_code": 2, "motor_count": 2, "ground_count": 2,
    "swing_angle_mrad": 2, "swing_rate_centirad_s": 2, "pitch_mrad": 2, "ground_speed_mm_s": 2, "heading_turn": 2,
    "swing_valid": 1, "pitch_valid": 1, "ground_speed_valid": 1, "heading_valid": 1, "estop": 1, "command_fresh": 1,
}  # fmt: skip
COMMAND = {"request": 1, "control": 1, "limiter": 1, "setpoint": 2}
FLAGS = {"swing_valid", "pitch_valid", "ground_speed_valid", "heading_valid", "estop", "command_fresh", "limiter"}


@dataclass(frozen=True)
class Edit:
    """`value` in a field from tick to tick: set, added (`shift`), added tick by tick (`ramp`), or random (`noise`)."""

    field: str
    begin: int
    end: int
    kind: str
    value: int


@dataclass(frozen=True)
class Candidate:
    """A base, raw values of some parameters, and edits."""

    base: str
    values: tuple[tuple[str, int], ...] = ()
    edits: tuple[Edit, ...] = ()


@dataclass(frozen=True)
class Found:
    """A candidate and its longest tick."""

    instructions: int
    drive: int
    tick: int  # row of the recording
    candidate: Candidate


def bases(firmware: Firmware, names: tuple[str, ...] = BASES) -> dict[str, Recording]:
    """Recordings of scenarios, cut to TICKS; a map from tests of theirs."""
    found = {}
    for name in names:
        file = paths.SCENARIOS / f"{name}.toml"
        try:
            scenario = load_scenario(file)
        except reading.ReadingError:  # its checks do not suit this robot: its inputs are inputs all the same
            scenario = read_scenario(reading.load(file), name)
        whole = record(scenario, firmware=firmware)
        found[name] = Recording(whole.values, whole.inputs[:TICKS])
    return found


def build(candidate: Candidate, recordings: Mapping[str, Recording], firmware: Firmware) -> Recording:
    """The recording that a candidate stands for."""
    base = recordings[candidate.base]
    places = {name: index for index, name in enumerate(firmware.interface.parameters)}
    values = list(base.values)
    for name, value in candidate.values:
        values[places[name]] = value
    inputs = base.inputs.copy()
    for i, edit in enumerate(candidate.edits):
        _edit(inputs, edit, firmware, i)
    return Recording(tuple(values), inputs)


def _place(field: str, firmware: Firmware) -> tuple[int, int]:
    if field in COMMAND:
        inside = firmware.ffi.offsetof("terrapin_command", field)
        return firmware.ffi.offsetof("terrapin_inputs", "command") + inside, COMMAND[field]
    return firmware.ffi.offsetof("terrapin_inputs", field), 4 if field == "tick" else FIELDS[field]


def _edit(inputs: npt.NDArray[np.uint8], edit: Edit, firmware: Firmware, seed: int) -> None:
    place, width = _place(edit.field, firmware)
    rows = slice(edit.begin, len(inputs) if edit.field == "tick" else edit.end)
    kind = {1: "<u1", 2: "<u2", 4: "<u4"}[width]
    before = np.ascontiguousarray(inputs[rows, place : place + width]).view(kind)[:, 0].astype(np.int64)
    if edit.kind == "set":
        after = np.full(len(before), edit.value, np.int64)
    elif edit.kind == "ramp":
        after = before + edit.value * np.arange(1, len(before) + 1)
    elif edit.kind == "shift":
        after = before + edit.value
    else:
        noise = np.random.default_rng((seed, abs(edit.value), edit.begin))
        after = before + noise.integers(-abs(edit.value) - 1, abs(edit.value) + 2, len(before))
    if edit.field in FLAGS:
        after &= 1
    wrapped = (after % (1 << (8 * width))).astype(kind)
    inputs[rows, place : place + width] = wrapped.view(np.uint8).reshape(-1, width)


def _draw_value(name: str, firmware: Firmware, draw: np.random.Generator) -> int:
    parameter = firmware.interface.parameters[name]
    low, high = parameter.minimum, parameter.maximum
    near = int(np.clip(parameter.default + draw.normal() * (abs(parameter.default) + 1), low, high))
    ends = (low, high, parameter.default, int(draw.integers(low, high, endpoint=True)), near)
    return ends[draw.integers(len(ends))]


def _draw_edit(firmware: Firmware, draw: np.random.Generator) -> Edit:
    names = [*FIELDS, *COMMAND, "tick"]
    field = names[draw.integers(len(names))]
    begin = int(draw.integers(TICKS))
    end = min(TICKS, begin + int(2 ** draw.uniform(0, 13)))
    if field == "tick":
        return Edit(field, begin, end, "shift", int(draw.integers(1, 20)))
    kind = ("set", "ramp", "noise", "shift")[draw.integers(4)] if field not in FLAGS else "set"
    if field in FLAGS:
        return Edit(field, begin, end, kind, int(draw.integers(2)))
    size = 2 ** draw.uniform(0, 15.9)
    value = int(draw.choice((-1, 1)) * size)
    if field in ("request", "control"):
        return Edit(field, begin, end, "set", int(draw.integers(4)))
    return Edit(field, begin, end, kind, int(value / 50) if kind == "ramp" else value)


def _change(candidate: Candidate, firmware: Firmware, draw: np.random.Generator) -> Candidate:
    values, edits = dict(candidate.values), list(candidate.edits)
    names = list(firmware.interface.parameters)
    for _ in range(int(draw.integers(1, 4))):
        what = draw.random()
        if what < 0.4:
            name = names[draw.integers(len(names))]
            values[name] = _draw_value(name, firmware, draw)
        elif what < 0.5 and values:
            values.pop(list(values)[draw.integers(len(values))])
        elif what < 0.85 or not edits:
            edits.append(_draw_edit(firmware, draw))
        elif what < 0.95:
            edits.pop(draw.integers(len(edits)))
        else:
            i = draw.integers(len(edits))
            moved = int(draw.integers(-20, 21))
            begin = int(np.clip(edits[i].begin + moved, 0, TICKS - 1))
            edits[i] = replace(edits[i], begin=begin, end=max(begin + 1, min(TICKS, edits[i].end + moved)))
    return replace(candidate, values=tuple(values.items()), edits=tuple(edits))


def _compensated(firmware: Firmware, draw: np.random.Generator) -> tuple[tuple[str, int], ...]:
    names = [name for name in firmware.interface.parameters if name.startswith("comp_")]
    return tuple(
        (name, int(firmware.interface.parameters[name].maximum // draw.integers(1, 50)) or 1) for name in names
    )


def _judge(candidate: Candidate, counted: Counts) -> Found:
    whole = counted["drive"].astype(np.int64) + counted["think"]
    tick = int(np.argmax(whole))
    return Found(int(whole[tick]), int(counted["drive"].max()), tick, candidate)


def search(
    generations: int,
    seed: int,
    firmware: Firmware | None = None,
    told: bool = False,
    program: Path | None = None,
    known: Sequence[Candidate] = (),
) -> Found:
    """The longest tick that this many generations find, which begin with what is known."""
    firmware = firmware or Firmware.open()
    draw = np.random.default_rng(seed)
    recordings = bases(firmware)
    names = list(recordings)
    tried = [*known, *(Candidate(name, _compensated(firmware, draw)) for name in names)]
    tried += [_change(tried[draw.integers(len(tried))], firmware, draw) for _ in range(TRIED)]
    best: list[Found] = []
    for generation in range(generations):
        counted = count_all([build(candidate, recordings, firmware) for candidate in tried], firmware, program)
        best += [_judge(candidate, counts) for candidate, counts in zip(tried, counted, strict=True)]
        longest = sorted(best, key=lambda found: (-found.instructions, -found.drive))[:KEPT]
        best = longest + sorted((f for f in best if f not in longest), key=lambda found: -found.drive)[: KEPT // 3]
        tried = [_change(best[draw.integers(len(best))].candidate, firmware, draw) for _ in range(TRIED)]
        if told:
            print(
                f"generation {generation}: {best[0].instructions} (drive at most {max(f.drive for f in best)})",
                flush=True,
            )
    return best[0]


def shorten(found: Found, firmware: Firmware, program: Path | None = None) -> Found:
    """The same without the values and edits that it does not need: without each, where the tick stays as long."""
    recordings = bases(firmware, (found.candidate.base,))
    going = True
    while going:
        c = found.candidate
        fewer = [replace(c, edits=c.edits[:i] + c.edits[i + 1 :]) for i in range(len(c.edits))]
        fewer += [replace(c, values=c.values[:i] + c.values[i + 1 :]) for i in range(len(c.values))]
        counted = count_all([build(candidate, recordings, firmware) for candidate in fewer], firmware, program)
        judged = [_judge(candidate, counts) for candidate, counts in zip(fewer, counted, strict=True)]
        best = max(judged, key=lambda other: other.instructions, default=found)
        going = best is not found and best.instructions >= found.instructions
        found = best if going else found
    return found


def save(found: Found, path: Path) -> None:
    """As JSON, which `load` reads."""
    path.write_text(json.dumps(asdict(found.candidate), indent=1) + "\n")


def load(path: Path) -> Candidate:
    """What `save` wrote."""
    read = json.loads(path.read_text())
    edits = tuple(Edit(**edit) for edit in read["edits"])
    return Candidate(read["base"], tuple((name, value) for name, value in read["values"]), edits)


def main() -> int:
    parser = argparse.ArgumentParser(
        description="The longest step that an evolution finds.",
        epilog="Example: python tests/target/worst.py --generations 50 --out longest.json",
    )
    parser.add_argument(
        "--robot", default=DEFAULT, help="a shipped robot, or its file; build.sh robot=NAME comes before"
    )
    parser.add_argument("--image", type=Path, help="the image that counts, instead of the robot's")
    parser.add_argument("--out", type=Path, help="file for what was found, without what it does not need")
    parser.add_argument("--known", type=Path, action="append", default=[], help="a file of --out to begin with")
    parser.add_argument("--generations", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    select(options.robot)
    firmware = Firmware.open()
    found = search(
        options.generations, options.seed, firmware, True, options.image, [load(path) for path in options.known]
    )
    found = shorten(found, firmware, options.image)
    print(f"{found.instructions} instructions in row {found.tick} of {found.candidate}")
    if options.out:
        save(found, options.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
