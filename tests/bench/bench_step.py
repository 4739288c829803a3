"""Instructions of one controller step on Cortex-M4, counted in QEMU's virtual time: the same in every run and machine.

    python tests/bench/bench_step.py [SCENARIO...]

Recorded inputs of the shipped scenarios, as they are and with every compensation set. Exit status 1 beyond the budget
of tests/target/budget.toml, which tests hold too.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # runs as a script too

from terrapin_hil.firmware import Firmware
from terrapin_hil.paths import ROOT
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from tests.target.replay import count_all, record
from tests.target.test_step import SCENARIOS, compensated, spread, whole


def verdict(met: bool) -> str:
    return "met" if met else "not met"


def main() -> int:
    """Prints a line for each scenario; 1 when one is beyond the budget."""
    parser = argparse.ArgumentParser(
        description="Instructions of one step on Cortex-M4.",
        epilog="Example: python tests/bench/bench_step.py steady_sand slope_limiter",
    )
    parser.add_argument("scenario", nargs="*", help="all of them by default")
    options = parser.parse_args()
    for tool in ("arm-none-eabi-gcc", "qemu-system-arm"):
        if shutil.which(tool) is None:
            print(f"not run here: instructions of one step on Cortex-M4 ({tool} is not installed)")
            return 0
    subprocess.run([ROOT / "tests" / "tools" / "build.sh", "cortex-m4"], check=True)
    budget = tomllib.loads((ROOT / "tests" / "target" / "budget.toml").read_text())["step"]
    firmware = Firmware.open()
    names = options.scenario or SCENARIOS
    recordings = {name: record(load_scenario(find_scenario(name)), firmware=firmware) for name in names}
    plain = dict(zip(names, count_all(recordings.values(), firmware), strict=True))
    switched_on = [compensated(recording, firmware) for recording in recordings.values()]
    everything = dict(zip(names, count_all(switched_on, firmware), strict=True))
    print(
        "instructions of one step, Cortex-M4 -Os median  worst  ratio  worst to the bridge  every compensation: worst"
    )
    longest, ratio, extreme = 0, 0.0, 0
    for name in names:
        steps, on = whole(plain[name]), whole(everything[name])
        median = float(np.median(steps))
        longest, ratio = max(longest, int(steps.max())), max(ratio, float(steps.max() / median))
        extreme = max(extreme, int(on.max()))
        print(
            f"{name:40} {median:9.0f} {steps.max():6d} {steps.max() / median:6.2f} {plain[name]['drive'].max():20d}"
            f" {on.max():26d}"
        )
    rows = [("worst step", longest, budget["worst"]),
            ("worst over median", round(ratio, 2), budget["worst_over_median"]),
            ("worst step with every compensation", extreme, budget["extreme"])]  # fmt: skip
    if not options.scenario:
        for runs, key in ((plain, "bridge_spread"), (everything, "bridge_spread_compensated")):
            found, changing = spread(runs)
            rows.append((f"sample to bridge, worst less best ({key})", found, budget[key]))
            rows.append((f"the same way at most, where the mode changes ({key})", changing, budget["bridge_change"]))
    for what, found, bound in rows:
        print(f"{what}: {found:g}, at most {bound:g}: {verdict(found <= bound)}")
    return 0 if all(found <= bound for _, found, bound in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
