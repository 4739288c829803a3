"""The emulated chip over semihosting, again and again: the same outputs in every run, and how many ticks a second.

    python tests/bench/bench_qemu.py [--runs 100] [--seconds 1]

Exit status 1 when a run differs. The rate is told beside the machine's load: it means little on a busy one.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # runs as a script too

from terrapin_hil.links.qemu import open_qemu
from terrapin_hil.paths import ROOT
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario

SCENARIO = "steady_sand"
AIM = 3000  # ticks a second


def main() -> int:
    """Prints what differed and the rates; 1 when a run differed from the host's."""
    parser = argparse.ArgumentParser(description="Repeated runs on the emulated chip.")
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=1.0)
    options = parser.parse_args()
    for tool in ("arm-none-eabi-gcc", "qemu-system-arm"):
        if shutil.which(tool) is None:
            print(f"not run here: repeated runs in QEMU ({tool} is not installed)")
            return 0
    subprocess.run([ROOT / "tests" / "tools" / "build.sh", "cortex-m4"], check=True)
    scenario = replace(load_scenario(find_scenario(SCENARIO)), duration=options.seconds, checks=())
    expected = run(scenario).output_hash
    different, rates = 0, []
    for _ in range(options.runs):
        with open_qemu() as link:
            begin = time.monotonic()
            result = run(scenario, link)
            rates.append(len(result.records) / (time.monotonic() - begin))
        different += result.output_hash != expected
    print(
        f"QEMU semihosting, {options.runs} runs of {scenario.ticks} ticks of {SCENARIO}: {different} different; "
        f"ticks a second: median {statistics.median(rates):.0f}, best {max(rates):.0f}, aim {AIM}; "
        f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors"
    )
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
