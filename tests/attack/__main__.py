"""`python -m tests.attack`: every attack of this folder, with what was tried and what was taken.

    --short             few of each, as `make test-all` does
    --count N           of each, instead of its own number
    --seed N            of the draws
    --only NAME         one module; may be repeated
    --keep              write the counts to held.toml, of which docs/safety.md is made

Each attack is a process of its own with a time limit. Status 1 when something was taken or an attack failed.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import pkgutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path

import tests.attack
from tests.attack import Result

COUNT, SHORT = 1_000_000, 60_000  # where a module has none of its own: frames
SECONDS, SHORT_SECONDS = 7200, 900  # of one attack; a busy machine has many others
HELD = Path(__file__).with_name("held.toml")


def attacks() -> list[str]:
    """The modules with `attack`, by their text: importing them is left to the process that runs them."""
    found = [info.name for info in pkgutil.iter_modules(tests.attack.__path__)]
    return [name for name in found if "\ndef attack(" in Path(__file__).with_name(f"{name}.py").read_text("utf-8")]


def one(name: str, count: int | None, seed: int, short: bool) -> list[Result]:
    """Carry out an attack, in this process."""
    module = importlib.import_module(f"tests.attack.{name}")
    own = getattr(module, "SHORT", SHORT) if short else getattr(module, "COUNT", COUNT)
    found: Result | Iterable[Result] = module.attack(own if count is None else count, seed)
    return [found] if isinstance(found, Result) else list(found)


def apart(name: str, options: argparse.Namespace) -> Iterator[Result]:
    """The same in a process of its own, which is ended with all that it started when its time is over."""
    command = [sys.executable, "-m", "tests.attack", "--one", name, "--seed", str(options.seed)]
    command += ["--short"] if options.short else []
    command += ["--count", str(options.count)] if options.count is not None else []
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
    limit = SHORT_SECONDS if options.short else SECONDS
    try:
        out, _ = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        yield Result(name, 0, 1, f"not done after {limit} s")
        return
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    if process.returncode:
        yield Result(name, 0, 1, f"failed with status {process.returncode}")
        return
    for entry in json.loads(out.splitlines()[-1]):
        yield Result(**entry)


def main() -> int:
    parser = argparse.ArgumentParser(prog="tests.attack", description="Attacks with counts, on this machine alone.")
    parser.add_argument("--short", action="store_true", help="few of each")
    parser.add_argument("--count", type=int, help="of each, instead of its own number")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", action="append", choices=attacks(), help="one module; may be repeated")
    parser.add_argument("--keep", action="store_true", help=f"write the counts to {HELD.name}")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps([asdict(result) for result in one(options.one, options.count, options.seed, options.short)]))
        return 0
    if options.count is not None and options.count < 1:
        parser.error("--count: expected at least 1")
    begin, results = time.monotonic(), []
    for name in options.only or attacks():
        for result in apart(name, options):
            results.append(result)
            print(f"{'TAKEN' if result.taken else 'held':6}{result.taken} of {result.tried:<8}{result.name}", end="")
            print(f": {result.note}" if result.note else "", flush=True)
    taken = sum(result.taken for result in results)
    tried = sum(result.tried for result in results)
    print(f"{len(results)} attacks, {tried} tries, {taken} taken, {time.monotonic() - begin:.0f} s")
    if options.keep:
        keep(results)
    return 1 if taken else 0


def keep(results: Iterable[Result]) -> None:
    """Write what was tried; what other attacks left there stays."""
    import tomllib

    before = tomllib.loads(HELD.read_text(encoding="utf-8")) if HELD.is_file() else {}
    entries = {**before, **{r.name: {"tried": r.tried, "taken": r.taken} for r in results}}
    lines = [f'"{name}" = {{ tried = {e["tried"]}, taken = {e["taken"]} }}' for name, e in sorted(entries.items())]
    head = "# What `python -m tests.attack --keep` last tried; docs/safety.md is made of it (tests/tools/safety.py).\n"
    HELD.write_text(head + "\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
