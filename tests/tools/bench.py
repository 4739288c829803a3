"""Speed of simulator and link (tests/bench/bench_*.py), and instructions of one controller step (callgrind).

Run by `make bench`. Instructions are repeatable to the last one on a machine; seconds are not. Exit status 1 when a
measurement fails or misses its bound.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys

from steps import ROOT, run

SHORT, LONG = 10_000, 30_000  # ticks; both past the controller's start


def instructions(ticks: int) -> int:
    """Instructions of a whole run of step_count."""
    command = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", "build/bench/step_count", str(ticks)]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    if "enabled 1" not in done.stdout:
        raise RuntimeError(f"the controller does not run: {done.stdout.strip()}")
    found = re.search(r"Collected : (\d+)", done.stderr)
    if found is None:
        raise RuntimeError(f"callgrind gave no count: {done.stderr[-300:]}")
    return int(found.group(1))


def step_cost() -> bool:
    (ROOT / "build" / "bench").mkdir(parents=True, exist_ok=True)
    built = run(
        "bench-step-count",
        ["cc", "-std=c11", "-O2", "-Ifirmware/core", "-Ibuild/host/generated", "tests/bench/step_count.c",
         "build/host/libterrapin_core.a", "-o", "build/bench/step_count"],
    )  # fmt: skip
    if not built.passed:
        print(built.output)
        return False
    cost = (instructions(LONG) - instructions(SHORT)) / (LONG - SHORT)
    print(f"instructions of one step, this machine, -O2: {cost:.0f} on average over {LONG - SHORT} ticks", flush=True)
    return True


def main() -> int:
    passed = True
    for script in sorted((ROOT / "tests" / "bench").glob("bench_*.py")):
        print(f"== {script.stem}", flush=True)
        passed &= subprocess.run([sys.executable, str(script)], cwd=ROOT, check=False).returncode == 0
    print("== step_count", flush=True)
    if shutil.which("valgrind"):
        passed &= step_cost()
    else:
        print("not run here: instructions of one step (valgrind not installed)")
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
