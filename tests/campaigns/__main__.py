"""Is discovery as good as it must be? `python -m tests.campaigns`, or `make campaigns`: a table; status 1 on a miss.

    python -m tests.campaigns                              everything, the counts of pools.py (many hours)
    python -m tests.campaigns --cases 200                  a tenth of it
    python -m tests.campaigns --rows alarms,single --jobs 2
    python -m tests.campaigns --rows practice --practice DIR
    python -m tests.campaigns --show                       the table of what is there already

Results are kept as JSON lines, one file a pool and seed; a rerun goes on where the last one stopped. They lie in a
folder named by what the engine and the campaign were when it began, since figures of two programs do not mix.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import time
from collections import Counter
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from tests.campaigns import commands, mutants, practice
from tests.campaigns.pools import POOLS, run
from tests.campaigns.resumed import engine_files
from tests.campaigns.table import ROWS, Line, show

ROOT = Path(__file__).resolve().parents[2]
OTHERS = ("time", "same", "mutants", "practice")
OWN = ("formulas", "designs", "drawn", "followup", "truth", "pools")


def fingerprint() -> str:
    """Eight digits that change with the engine or with the way cases are drawn."""
    files = engine_files() + [ROOT / "tests" / "campaigns" / f"{name}.py" for name in OWN]
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:8]


def stored(folder: Path, pools: list[str], seed: int) -> list[dict[str, Any]]:
    """Records of earlier runs; a line that a kill cut short is left out."""
    records = []
    for pool in pools:
        path = folder / f"{pool}-{seed}.jsonl"
        for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
            try:
                records.append(json.loads(line))
            except ValueError:
                continue
    return records


def campaign(folder: Path, counts: dict[str, int], seed: int, jobs: int) -> None:
    """Run what is not stored yet, the pools side by side so that a campaign cut short has some of each."""
    done = {(r["pool"], r["number"]) for r in stored(folder, list(counts), seed)}
    todo = [(pool, number) for pool, count in counts.items() for number in range(count) if (pool, number) not in done]
    todo.sort(key=lambda task: (task[1] / counts[task[0]], task[0]))
    folder.mkdir(parents=True, exist_ok=True)
    for pool in counts:
        path = folder / f"{pool}-{seed}.jsonl"
        if path.exists() and not path.read_bytes().endswith(b"\n"):
            path.write_bytes(path.read_bytes() + b"\n")  # ends the line that a kill cut short
    seconds: Counter[str] = Counter()
    finished: Counter[str] = Counter()
    left = Counter(pool for pool, _ in todo)
    waiting: dict[Any, tuple[str, int, float]] = {}
    with ProcessPoolExecutor(jobs, initializer=threadpool_limits, initargs=(1,)) as workers:
        while todo or waiting:
            while todo and len(waiting) < jobs:
                pool, number = todo.pop(0)
                task = workers.submit(run, pool, seed, number)
                waiting[task] = (pool, number, time.monotonic())
            for task in wait(waiting, return_when=FIRST_COMPLETED).done:
                pool, number, began = waiting.pop(task)
                record = task.result()
                with (folder / f"{pool}-{seed}.jsonl").open("a", encoding="utf-8") as file:
                    file.write(json.dumps(record) + "\n")
                seconds[pool] += time.monotonic() - began  # type: ignore[assignment]
                finished[pool] += 1
                left[pool] -= 1
                progress(left, seconds, finished, jobs)
    print(file=sys.stderr)


def progress(left: Counter[str], seconds: Counter[str], finished: Counter[str], jobs: int) -> None:
    mean = sum(seconds.values()) / max(1, sum(finished.values()))
    rest = sum(count * (seconds[p] / finished[p] if finished[p] else mean) for p, count in left.items()) / jobs
    text = f"{sum(finished.values())} done, {sum(left.values())} left, about {rest / 60:.0f} min"
    end = "\r" if sys.stderr.isatty() else "\n"
    if sys.stderr.isatty() or sum(finished.values()) % 50 == 0:
        print(f"{text:60}", end=end, file=sys.stderr, flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.campaigns", description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=2000, help="of the largest pools; the others in proportion")
    parser.add_argument("--rows", default="", help=f"of {', '.join((*ROWS, *OTHERS))}; all unless given")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "campaigns")
    parser.add_argument("--name", help="folder of the results, instead of one named by what the program is")
    parser.add_argument("--practice", type=Path, help="folder of practice cases with answers.json")
    parser.add_argument("--show", action="store_true", help="run nothing, show what is stored")
    parser.add_argument("--brief", action="store_true", help="the table without what is under it")
    arguments = parser.parse_args()
    chosen = arguments.rows.split(",") if arguments.rows else [*ROWS, "same", "time", "mutants"]
    if not arguments.rows and arguments.practice:
        chosen.append("practice")
    unknown = sorted(set(chosen) - {*ROWS, *OTHERS})
    if unknown or arguments.cases < 1 or arguments.jobs < 1:
        parser.error(f"unknown rows: {', '.join(unknown)}" if unknown else "--cases and --jobs: expected 1 or more")
    if "practice" in chosen and arguments.practice is None:
        parser.error("row practice: expected --practice DIR")
    folder = arguments.out / (arguments.name or fingerprint())
    pools = [pool for pool in POOLS if any(pool in ROWS[row][0] for row in chosen if row in ROWS)]
    counts = {pool: max(1, round(POOLS[pool] * arguments.cases / 2000)) for pool in pools}
    if not arguments.show and counts:
        try:
            campaign(folder, counts, arguments.seed, arguments.jobs)
        except KeyboardInterrupt:
            print("stopped; the same command goes on from here", file=sys.stderr)
    records = stored(folder, pools, arguments.seed)
    lines: list[Line] = [line for row in chosen if row in ROWS for line in ROWS[row][1](records)]
    if not arguments.show:
        lines += [line for row in OTHERS[:2] if row in chosen for line in commands.LINES[row](arguments.seed)]
        lines += practice.lines(arguments.practice) if "practice" in chosen else []
        lines += mutants.lines() if "mutants" in chosen else []  # the last: it makes way for others on this machine
    failed = [r for r in records if "failed" in r]
    print(show(lines, not arguments.brief))
    print(f"\nresults in {folder}; {len(records)} cases, {len(failed)} of them the engine could not answer")
    for record in failed[:10]:
        print(f"  {record['pool']} {record['number']}: {record['failed']}")
    return 0 if all(line.verdict == "met" for line in lines) else 1


if __name__ == "__main__":
    sys.exit(main())
