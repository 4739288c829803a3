"""Seconds of the processor that a start takes: `terrapin --help`, and a run of carriage_limiter with its log.

The least of several starts that write no bytecode: with what `make setup` has compiled, as where Python may not write.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

STARTS = 5
COMMANDS = ((("--help",), 0.3), (("run", "carriage_limiter", "--out", "run"), 0.8))


def seconds(words: tuple[str, ...], folder: Path) -> float:
    """Of the processor, of a start that writes no bytecode."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-c", "from terrapin_tools.cli import main; main()", *words]
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    subprocess.run(command, cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL, timeout=60)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> int:
    """Prints a line for each command; 1 when one is beyond its bound."""
    good = True
    with tempfile.TemporaryDirectory(prefix="terrapin-start-") as folder:
        for words, bound in COMMANDS:
            least = min(seconds(words, Path(folder)) for _ in range(STARTS))
            good &= least <= bound
            print(f"terrapin {' '.join(words)}: {least:.2f} s of the processor (bound {bound} s)")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
