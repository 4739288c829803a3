"""Instructions of one controller step on Cortex-M4, counted in QEMU's virtual time: the same in every run and machine.

    python tests/bench/bench_step.py

Exit status 1 beyond the budget of tests/target/budget.toml, which tests hold too. The aim is printed, met or not.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # runs as a script too

from terrapin_hil.links.qemu import open_qemu
from terrapin_hil.paths import ROOT
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario

SCENARIOS = ("floor_calibration", "slope_limiter", "steady_sand")
SECONDS = 4.0  # of each: past start and calibration
AIM = {"step": 800, "step-without-telemetry": 500}  # instructions, worst step
AIM_SPREAD = 2.0  # maximum / median


def verdict(met: bool) -> str:
    return "met" if met else "not met"


def main() -> int:
    """Prints a line for each scenario and kind of step; 1 when one is beyond the budget."""
    for tool in ("arm-none-eabi-gcc", "qemu-system-arm"):
        if shutil.which(tool) is None:
            print(f"not run here: instructions of one step on Cortex-M4 ({tool} is not installed)")
            return 0
    subprocess.run([ROOT / "tests" / "tools" / "build.sh", "cortex-m4"], check=True)
    budget = tomllib.loads((ROOT / "tests" / "target" / "budget.toml").read_text())
    worst, spread, within = dict.fromkeys(AIM, 0), 0.0, True
    print("instructions of one step on Cortex-M4 -Os   minimum  median  maximum")
    for scenario in SCENARIOS:
        link = open_qemu(count=True)
        with link:
            run(replace(load_scenario(find_scenario(scenario)), duration=SECONDS, checks=()), link)
        for name in AIM:
            counted = link.machine.instructions[name]
            worst[name] = max(worst[name], counted.maximum)
            print(
                f"{scenario:18} {name:23} {counted.minimum:9d} {counted.median:7d} {counted.maximum:8d}"
                f"   of {counted.steps} steps"
            )
        whole = link.machine.instructions["step"]
        spread = max(spread, whole.maximum / whole.median)
        within &= whole.maximum <= budget["step_maximum"] and whole.median <= budget["step_median"]
    print(f"budget, with telemetry: median {budget['step_median']}, worst {budget['step_maximum']}: {verdict(within)}")
    for name, aim in AIM.items():
        print(f"aim, {name}: worst {worst[name]}, at most {aim}: {verdict(worst[name] <= aim)}")
    print(f"aim, maximum / median of the step: {spread:.2f}, at most {AIM_SPREAD:g}: {verdict(spread <= AIM_SPREAD)}")
    return 0 if within else 1


if __name__ == "__main__":
    sys.exit(main())
