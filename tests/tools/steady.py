"""Whether the tests that wait, spawn, draw or time pass every time: again and again, beside other work.

    steady.py --suite [--times 3] [--workers N]               all tests of both tiers; notes which tests wait
    steady.py [--times 20] [--workers 8]                      rounds of those, each other's load
    steady.py [--times 20] [--load 8] [--jobs N] FILE...      files of tests, beside processes that only compute

Interrupted, it goes on where it was: what has run of the same sources stands in build/steady/runs.jsonl, each run with
the machine's median load. The output of a run that failed stays beside it. Prints `N passed, N failed`, of rounds,
files or suites. Status 1 when one failed. What is skipped here as a whole has passed, but its line says `nothing`.
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
from statistics import median
from threading import Event, Lock, Thread

from hygiene import tracked
from steps import ROOT, TOOLS
from suite import PYTEST

LAST = re.compile(r"^=* ?(\d+ (?:passed|failed).*?) ?=*$", re.MULTILINE)  # pytest's closing line
NOTHING = 5  # pytest's status where no test ran
BURN = "import os; parent = os.getppid()\nwhile os.getppid() == parent:\n    for _ in range(1_000_000): pass"


def sources() -> str:
    """A name for what is tested: all files of the repository as they are now, but what campaigns have found."""
    digest = hashlib.sha256()
    for path in tracked(ROOT):
        if path.is_relative_to("tests/campaigns/results"):
            continue
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


class Load(Thread):
    """The machine's load while something runs, each few seconds."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.seen = [os.getloadavg()[0]]
        self._ended = Event()

    def run(self) -> None:
        while not self._ended.wait(5):
            self.seen.append(os.getloadavg()[0])

    def __enter__(self) -> Load:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self.join()


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
        with Load() as load:
            done = subprocess.run(
                command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                text=True, errors="replace", check=False,
            )  # fmt: skip
        if done.returncode != 0 and "KeyboardInterrupt" in done.stdout:  # Ctrl-C reaches it, too: nothing has failed
            return
        passed, seconds = done.returncode in (0, NOTHING), time.monotonic() - begin
        what = "nothing" if done.returncode == NOTHING else "ok" if passed else "FAILED"
        with self._lock:
            self.passed[name, number] = passed
            if not passed:
                (self.folder / f"{name.replace('/', '-')}-{number}.log").write_text(done.stdout)
            with self.file.open("a") as file:
                line = {"sources": self.key, "name": name, "number": number, "passed": passed}
                line |= {"seconds": round(seconds, 1), "load": median(load.seen), "end": LAST.findall(done.stdout)[-1:]}
                file.write(json.dumps(line) + "\n")
            print(f"{what:7} {number:3} {seconds:6.1f} s  {name}, load {median(load.seen):.1f}", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description="Tests that wait, spawn, draw or time, again and again.")
    parser.add_argument("--times", type=int, help="20, of the suite 3")
    parser.add_argument("--load", type=int, help="processes that compute beside it: 8 beside files, else 0")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="files at a time")
    parser.add_argument("--workers", type=int, help="of pytest: 8, of the suite as many as there are cores")
    parser.add_argument("--suite", action="store_true", help="all tests of both tiers")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "steady")
    parser.add_argument("file", nargs="*", type=Path)
    options = parser.parse_args()
    if sys.prefix == sys.base_prefix:  # minutes of builds before the first test fails
        parser.error(f"{sys.executable} is of no virtual environment: use .venv/bin/python, which `make test` sets up")
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell runs us in its background
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # as in suite.py, both
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    python, notes = str(TOOLS / "python"), options.out / "waits"
    if options.suite:
        workers = ["--workers", str(options.workers)] if options.workers else []
        commands = {"suite": [python, "tests/tools/suite.py", "--waits-to", str(notes), *workers]}
    elif options.file:
        commands = {str(path): [python, "-m", "pytest", "-q", "--durations=3", str(path)] for path in options.file}
    elif any(notes.glob("*.txt")):
        from waits import noted  # and pytest with it, which a bare Python lacks

        rounds = ["-p", "tests.tools.waits", "--waits-of", str(notes), f"-n{options.workers or 8}"]
        files = sorted({name.partition("::")[0] for name in noted(notes)})  # each worker reads all that it is given
        commands = {"waiting": [python, "-m", "pytest", *PYTEST, *rounds, *files]}
    else:
        parser.error(f"which tests wait is not known yet in {notes}: run steady.py --suite first")
    times = options.times or (3 if options.suite else 20)
    load = options.load if options.load is not None else 8 if options.file else 0
    runs = Runs(options.out, sources())
    with burning(load), ThreadPoolExecutor(options.jobs if options.file else 1) as pool:
        queued = [pool.submit(runs.run, n, i, command) for i in range(times) for n, command in commands.items()]
        try:
            for future in queued:
                future.result()
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)  # else all that is queued would run
            print("interrupted: what runs is waited for", flush=True)
            return 130
    asked = [runs.passed.get((name, number), False) for name in commands for number in range(times)]
    print(f"{sum(asked)} passed, {len(asked) - sum(asked)} failed")
    return 0 if all(asked) else 1


if __name__ == "__main__":
    sys.exit(main())
