"""The simulator's own loop beside that of the commit before: `python tests/bench/bench_loop.py [COMMIT]`.

In process, default ground, sensors, noise, log in memory. COMMIT (HEAD~1, or HEAD where the tree has changes) is built
in a worktree of its own under build/bench; rounds of the two alternate, so that whatever else the machine does meets
both. Times real time by processor time: median of the rounds. Instructions a tick, which are repeatable: of simulator
and C library by callgrind, where that is installed. The bound is 2,000 times real time for the tree at hand.
"""

from __future__ import annotations

import os
import re
import shutil
import statistics
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BEFORE = ROOT / "build" / "bench" / "before"
PACKAGES = ("hil", "host_tools", "firmware")
BOUND, ROUNDS, TICKS = 2000.0, 9, 20_000
SIMULATOR = ("libterrapin_hil.so", "libm.so")

LOOP = """
import sys, time
from terrapin_hil.links import open_link
from terrapin_hil.robot.plant import TERRAINS, Ground, Segment
from terrapin_hil.robot.sensors import kit
from terrapin_hil.scenario.scenario import Order, Scenario
from terrapin_hil.simulation import Simulation

scenario = Scenario(
    name="bench",
    duration=20.0,
    ground=Ground((Segment(TERRAINS["hard_floor"]), Segment(TERRAINS["sand"], 5.0))),
    operator=(Order(0.0, "run", "voltage", 8.0),),
    sensors=kit("real"),
)
with open_link("inprocess") as link:
    for _ in range(int(sys.argv[1])):
        simulation = Simulation(scenario)
        simulation.records.fill(0)
        link.start({})
        begin = time.process_time()
        link.advance(simulation, scenario.ticks)
        print(scenario.duration / (time.process_time() - begin))
"""


def environment(tree: Path) -> dict[str, str]:
    """That of a Python that takes Terrapin from `tree`."""
    path = os.pathsep.join(str(tree / package) for package in PACKAGES)
    return {**os.environ, "PYTHONPATH": path, "PYTHONHASHSEED": "0"}


def run(*command: str | Path, cwd: Path = ROOT, env: dict[str, str] | None = None) -> str:
    """What a command says. SystemExit with its complaint when it fails."""
    done = subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, command))}: {(done.stderr or done.stdout)[-500:]}")
    return done.stdout


def built(commit: str) -> Path:
    """The tree of a commit with its libraries."""
    if BEFORE.exists():
        run("git", "worktree", "remove", "--force", BEFORE)
    run("git", "worktree", "prune")
    run("git", "worktree", "add", "--detach", BEFORE, commit)
    env = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    run("cmake", "--preset", "host", f"-DPython3_EXECUTABLE={sys.executable}", cwd=BEFORE, env=env)
    run("cmake", "--build", "build/host", "--target", "terrapin", "terrapin_hil", cwd=BEFORE, env=env)
    return BEFORE


def speeds(tree: Path) -> list[float]:
    """Times real time of some runs in a process of their own; the first one fills the caches."""
    return [float(x) for x in run(sys.executable, "-c", LOOP, "4", env=environment(tree)).split()][1:]


def instructions(tree: Path) -> float:
    """Of simulator and C library, a tick."""
    out = ROOT / "build" / "bench" / "callgrind.out"
    command = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", sys.executable, "-c", LOOP, "1"]
    run(*command, env=environment(tree))
    told = run("callgrind_annotate", "--threshold=100", "--show-percs=no", out)
    found = re.findall(r"^\s*([\d,]+)\s.*\[(\S+)\]$", told, re.MULTILINE)
    mine = [int(count.replace(",", "")) for count, place in found if any(name in place for name in SIMULATOR)]
    return sum(mine) / TICKS


def main() -> int:
    """Prints a table; 1 when the tree at hand misses the bound."""
    changed = bool(run("git", "status", "--porcelain", "--untracked-files=no").strip())
    commit = sys.argv[1] if len(sys.argv) > 1 else "HEAD" if changed else "HEAD~1"
    before = built(commit)
    try:
        name = run("git", "log", "-1", "--format=%h", commit).strip()
        rounds = [(speeds(ROOT), speeds(before)) for _ in range(ROUNDS)]
        here = [speed for mine, _ in rounds for speed in mine]
        there = [speed for _, theirs in rounds for speed in theirs]
        pairs = [statistics.median(mine) / statistics.median(theirs) for mine, theirs in rounds]
        median = statistics.median(here)
        print(f"in process, times real time: median {median:.0f} (bound {BOUND:.0f}), best {max(here):.0f}")
        print(f"  {name}: median {statistics.median(there):.0f}, best {max(there):.0f}")
        print(f"  faster than {name}: {statistics.median(pairs):.3f} x, median of {ROUNDS} pairs")
        if shutil.which("valgrind"):
            mine, theirs = instructions(ROOT), instructions(before)
            print(f"  instructions a tick, simulator and C library: {mine:.0f}, {name}: {theirs:.0f}")
        else:
            print("  not run here: instructions a tick (valgrind not installed)")
    finally:
        run("git", "worktree", "remove", "--force", before)
    return 0 if median >= BOUND else 1


if __name__ == "__main__":
    sys.exit(main())
