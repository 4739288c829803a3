"""Two builds of the controller, given the same inputs: in how many ticks they differ, and by how much.

    python tests/target/compare.py FOLDER [SCENARIO...]

FOLDER is the build folder of the older one (it holds libterrapin.so and generated/); the newer one is build/host. Each
scenario is run with the older controller, and its inputs are given to both. One row a scenario, for docs/step.md.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # runs as a script too

from terrapin_hil import paths
from terrapin_hil.firmware import Firmware
from terrapin_hil.messages import Interface
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from tests.target.replay import Counts, on_host, record


@dataclass(frozen=True)
class Difference:
    """Of one scenario."""

    ticks: int
    duty: int  # ticks whose duty differs,
    duty_most: int  # and by how much at most, of 32767
    switched: int  # ticks in which enable or a fault differs
    ground: int  # GROUND frames,
    ground_different: int  # those that differ in torque, f_r, valid or terrain,
    torque_most: int  # in torque by at most so many uN m,
    f_r_most: int  # and in f_r by so many 1e-5


def _decoded(outputs: Counts, name: str, interface: Interface) -> dict[int, dict[str, int]]:
    """Messages of this name by the row that sends them."""
    message = interface.messages[name]
    second = outputs["frames"][:, 1]
    rows = np.flatnonzero((outputs["count"] == 2) & (second["id"] == message.id))
    return {int(row): message.decode(second["data"][row].tobytes()) for row in rows}


def differences(older: Counts, newer: Counts, interface: Interface) -> Difference:
    """Of the outputs of the same ticks."""
    off: npt.NDArray[np.int64] = np.abs(older["duty"].astype(np.int64) - newer["duty"])
    switched = (older["enable"] != newer["enable"]) | (older["faults"] != newer["faults"])
    before, after = (_decoded(outputs, "GROUND", interface) for outputs in (older, newer))
    names = ("torque", "f_r", "valid", "terrain")
    other = [row for row in before if any(before[row][name] != after[row][name] for name in names)]
    torque, f_r = (
        max((abs(before[row][name] - after[row][name]) for row in other), default=0) for name in ("torque", "f_r")
    )
    differ = int(np.count_nonzero(off)), int(off.max()), int(switched.sum())
    return Difference(len(older), *differ, len(before), len(other), torque, f_r)


def main() -> int:
    parser = argparse.ArgumentParser(
        description="In how many ticks two builds of the controller differ.",
        epilog="Example: python tests/target/compare.py ../older/build/host steady_sand",
    )
    parser.add_argument("folder", type=Path, help="build folder of the older controller")
    parser.add_argument("scenario", nargs="*")
    options = parser.parse_args()
    if not (options.folder / "libterrapin.so").is_file():
        print(f"{options.folder}: found no libterrapin.so, expected a build folder such as build/host", file=sys.stderr)
        return 2
    older, newer = Firmware.open(options.folder), Firmware.open()
    names = options.scenario or sorted(path.stem for path in paths.SCENARIOS.glob("*.toml"))
    print(
        "| scenario | ticks | duty differs | by at most | enable, faults differ | GROUND | differs "
        "| C_t by at most [uN m] | f_r by at most [1e-5] |"
    )
    print("|" + "---|" * 9)
    for name in names:
        recording = record(load_scenario(find_scenario(name)), firmware=older)
        d = differences(on_host(recording, older), on_host(recording, newer), newer.interface)
        print(
            f"| {name} | {d.ticks} | {d.duty} | {d.duty_most} | {d.switched} | {d.ground} | {d.ground_different} "
            f"| {d.torque_most} | {d.f_r_most} |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
