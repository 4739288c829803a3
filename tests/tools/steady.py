"""Whether the tests that wait, spawn, draw or time pass every time: again and again, beside other work.

    steady.py [--times 20] [--load 8] [--jobs N] [FILE...]   the files of such tests, or those that are named
    steady.py --suite [--times 3] [--load 0]                 all that `make test` runs, as often

Interrupted, it goes on where it was: what has run of the same sources stands in build/steady/runs.jsonl. The output of
a run that failed stays beside it. Prints `N passed, N failed`, of a file or the suite. Status 1 when one failed. A
file whose tests are all skipped here has passed, but its line says `nothing`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Lock

from hygiene import tracked
from steps import ROOT, TOOLS

# What a file of tests takes that waits for others, starts them, draws, or looks at a clock.
SUSPECT = re.compile(
    r"^(import|from) (asyncio|concurrent|multiprocessing|playwright|pty|select|serving|signal|slcan_feeder|subprocess"
    r"|tests\.waiting|threading|time)\b|\b(ControllerProcess|open_qemu|run_inside|usefixtures\(\"bounded\"\))",
    re.MULTILINE,
)
NOTHING = 5  # pytest's status where no test ran
BURN = "import os; parent = os.getppid()\nwhile os.getppid() == parent:\n    for _ in range(1_000_000): pass"


def suspects() -> list[Path]:
    """Files of tests that wait, spawn, draw or time."""
    found = [path for path in tracked(ROOT) if path.parts[0] == "tests" and path.match("test_*.py")]
    return [path for path in found if SUSPECT.search((ROOT / path).read_text(encoding="utf-8"))]


def sources() -> str:
    """A name for what is tested: all files of the repository as they are now."""
    digest = hashlib.sha256()
    for path in tracked(ROOT):
        digest.update(f"{path}\0".encode() + hashlib.sha256((ROOT / path).read_bytes()).digest())
    return digest.hexdigest()[:16]


@contextmanager
def burning(count: int) -> Iterator[None]:
    """So many processes that only compute; each ends with this one, too."""
    started = [subprocess.Popen([sys.executable, "-c", BURN]) for _ in range(count)]
    try:
        yield
    finally:
        for process in started:
            process.kill()
            process.wait()


class Runs:
    """What has run, kept in a file, so that an interrupted session goes on."""

    def __init__(self, folder: Path, key: str) -> None:
        self.folder, self.key = folder, key
        self.file = folder / "runs.jsonl"
        self.passed: dict[tuple[str, int], bool] = {}
        self._lock = Lock()
        folder.mkdir(parents=True, exist_ok=True)
        for line in self.file.read_text().splitlines() if self.file.is_file() else []:
            try:
                run = json.loads(line)
            except ValueError:  # interrupted in the middle of a line
                continue
            if run["sources"] == key:
                self.passed[run["name"], run["number"]] = run["passed"]

    def run(self, name: str, number: int, command: list[str]) -> None:
        """Run a command unless it has run, and note whether it passed."""
        if (name, number) in self.passed:
            return
        begin = time.monotonic()
        done = subprocess.run(
            command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            errors="replace", check=False,
        )  # fmt: skip
        passed, seconds = done.returncode in (0, NOTHING), time.monotonic() - begin
        what = "nothing" if done.returncode == NOTHING else "ok" if passed else "FAILED"
        with self._lock:
            self.passed[name, number] = passed
            if not passed:
                (self.folder / f"{name.replace('/', '-')}-{number}.log").write_text(done.stdout)
            with self.file.open("a") as file:
                line = {"sources": self.key, "name": name, "number": number, "passed": passed, "seconds": seconds}
                file.write(json.dumps(line) + "\n")
            print(f"{what:7} {number:3} {seconds:6.1f} s  {name}", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description="Tests that wait, spawn, draw or time, again and again.")
    parser.add_argument("--times", type=int, help="20, of the suite 3")
    parser.add_argument("--load", type=int, help="processes that compute beside it: 8, beside the suite 0")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="files at a time")
    parser.add_argument("--suite", action="store_true", help="all that `make test` runs")
    parser.add_argument("--list", action="store_true", help="list the files and run nothing")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "steady")
    parser.add_argument("file", nargs="*", type=Path)
    options = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell runs us in its background
    files = [str(path) for path in options.file or suspects()]
    if options.list:
        print("\n".join(files))
        return 0
    python = str(TOOLS / "python")
    pytest = [python, "-m", "pytest", "-q", "--durations=3"]
    commands = {"suite": [python, "tests/tools/suite.py"]} if options.suite else {f: [*pytest, f] for f in files}
    times = options.times or (3 if options.suite else 20)
    runs = Runs(options.out, sources())
    load = options.load if options.load is not None else 0 if options.suite else 8
    with burning(load), ThreadPoolExecutor(1 if options.suite else options.jobs) as pool:
        queued = [pool.submit(runs.run, n, i, command) for i in range(times) for n, command in commands.items()]
        try:
            for future in queued:
                future.result()
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)  # else all that is queued would run
            print("interrupted: what runs is waited for", flush=True)
            return 130
    asked = [runs.passed[name, number] for name in commands for number in range(times)]
    print(f"{sum(asked)} passed, {len(asked) - sum(asked)} failed")
    return 0 if all(asked) else 1


if __name__ == "__main__":
    sys.exit(main())
