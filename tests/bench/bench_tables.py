"""`terrapin discover` on tables of 1e5 and 1e6 rows, from the start of the command to its answer.

python tests/bench/bench_tables.py [ROWS ...]

One effect, motor heating, is missing; the noise of the rows goes together within a run, has tails and an offset in each
run. For each table: median wall time of three, the most memory of the command and its workers (what they share counted
once), the longest silence between two lines of progress, and how long it takes to end after Ctrl-C, early, in the midst
and late. Bounds: 10 s and 0.5 GB for 1e5 rows, 60 s and 1.5 GB for 1e6; a line each second; an end within 2 s.
"""

from __future__ import annotations

import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))  # runs as a script

from casekit import ROLLING, driven

BOUNDS = {100_000: (10.0, 0.5), 1_000_000: (60.0, 1.5)}  # rows: s, GB
SILENCE = 1.5  # s: a line each second, and half of one for the machine
CANCEL = 2.0  # s
ROUNDS = 3
LONGEST = 600.0  # s, after which a command is ended
RUNS = 50


def table(folder: Path, rows: int) -> Path:
    """A case of `rows` rows in RUNS runs, whose motor heats up: 0.4 % of its torque a kelvin."""
    random = np.random.default_rng(rows)
    each = rows // RUNS
    run = np.repeat(np.arange(RUNS), each)
    speed = random.uniform(2, 10, RUNS) * np.where(np.arange(RUNS) % 3, 1.0, -1.0)
    omega = speed[run] * (1 + 0.1 * random.standard_normal(run.size))
    load = np.clip(random.uniform(15, 40, RUNS)[run] + random.standard_normal(run.size), 5.0, None)
    celsius = random.uniform(20, 35, RUNS)[run] + 30.0 * np.tile(np.arange(each) / each, RUNS)
    noise = lfilter([0.6], [1.0, -0.8], random.standard_t(3, run.size)) / 1.7 + 0.5 * random.standard_normal(RUNS)[run]
    current = driven(omega, load, celsius, heating=0.004) + 0.004 * noise
    humidity = random.normal(50, 5, run.size)
    columns = np.column_stack([run, omega * 30 / np.pi, load, celsius * 1.8 + 32, 1000 * current, humidity])
    folder.mkdir()
    np.savetxt(folder / "runs.csv", columns, "%.7g", ",", header="run,w,W,temp,i,humidity", comments="")
    (folder / "case.toml").write_text(ROLLING.replace(", sigma = 4.0", ""))
    return folder


def family(pid: int) -> list[int]:
    """A process and all that it started."""
    found = [pid]
    for one in found:
        try:
            for task in Path(f"/proc/{one}/task").iterdir():
                found.extend(int(child) for child in (task / "children").read_text().split())
        except OSError:
            continue
    return found


def held(pid: int) -> float:
    """Memory of a process and all that it started, what they share counted once [GB]."""
    total = 0
    for one in family(pid):
        try:
            rollup = Path(f"/proc/{one}/smaps_rollup").read_text()
        except OSError:
            continue
        total += sum(int(line.split()[1]) for line in rollup.splitlines() if line.startswith("Pss:"))
    return total / 1e6


class Command:
    """`terrapin discover` on a case: its lines of progress with their times, and its memory while it runs."""

    def __init__(self, case: Path) -> None:
        terrapin = Path(sys.executable).with_name("terrapin")
        command = [str(terrapin), "discover", str(case), "--json", "-", "--jobs", str(min(2, os.cpu_count() or 1))]
        self.begin = time.perf_counter()
        self.process = subprocess.Popen(
            command,
            env={**os.environ, "TERRAPIN_PROGRESS": "lines"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.told = [self.begin]
        self.lines: list[str] = []
        self.memory = 0.0
        self._readers = [threading.Thread(target=one, daemon=True) for one in (self._progress, self._watch)]
        for reader in self._readers:
            reader.start()

    def _progress(self) -> None:
        assert self.process.stderr
        for line in self.process.stderr:
            self.told.append(time.perf_counter())
            self.lines.append(line.rstrip())

    def _watch(self) -> None:
        while self.process.poll() is None:
            self.memory = max(self.memory, held(self.process.pid))
            if time.perf_counter() - self.begin > LONGEST:
                self.process.kill()
            time.sleep(0.1)

    def ended(self) -> tuple[float, str]:
        """Seconds until it ended, and its standard output."""
        assert self.process.stdout
        output = self.process.stdout.read()
        self.process.wait(LONGEST)
        took = time.perf_counter() - self.begin
        for reader in self._readers:
            reader.join()
        return took, output

    def silence(self) -> float:
        """The longest time without a line of progress [s]."""
        return float(max(np.diff([*self.told, time.perf_counter()])))


def cancelled(case: Path, after: float) -> float:
    """Seconds from Ctrl-C, given `after` so many, to the end of the command."""
    command = Command(case)
    time.sleep(after)
    asked = time.perf_counter()
    for pid in family(command.process.pid):  # a terminal sends it to all of them
        os.kill(pid, signal.SIGINT)
    command.ended()
    took = time.perf_counter() - asked
    if command.process.returncode == 0:
        raise RuntimeError(f"the answer was there within {after:.1f} s: nothing was cancelled")
    return took


def measured(rows: int, folder: Path) -> bool:
    """Prints the line of one table; whether it is within its bounds."""
    case = table(folder, rows)
    walls, memory, silence = [], 0.0, 0.0
    for _ in range(ROUNDS):
        command = Command(case)
        took, output = command.ended()
        if command.process.returncode:
            raise RuntimeError(f"discover ended with {command.process.returncode}: {' | '.join(command.lines[-3:])}")
        walls.append(took)
        memory, silence = max(memory, command.memory), max(silence, command.silence())
    answer = json.loads(output)
    wall = statistics.median(walls)
    cancel = max(cancelled(case, share * wall) for share in (0.3, 0.7, 0.9))
    seconds, gigabytes = BOUNDS.get(rows, (float("inf"), float("inf")))
    told = [
        f"{rows:,} rows: {wall:.1f} s (bound {seconds:g} s), {memory:.2f} GB ({gigabytes:g})",
        f"silent for {silence:.1f} s at most ({SILENCE:g})",
        f"ended {cancel:.1f} s after Ctrl-C ({CANCEL:g})",
        f"{answer['verdict']}: {' + '.join(answer['missing'])}",
    ]
    print(", ".join(told), flush=True)
    return wall < seconds and memory < gigabytes and silence < SILENCE and cancel < CANCEL


def main() -> int:
    """1 where a table misses a bound."""
    asked = [int(float(argument)) for argument in sys.argv[1:]] or list(BOUNDS)
    with tempfile.TemporaryDirectory() as folder:
        held_all = [measured(rows, Path(folder) / str(rows)) for rows in asked]  # each is told, whatever the others are
    return 0 if all(held_all) else 1


if __name__ == "__main__":
    sys.exit(main())
