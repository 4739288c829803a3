"""Steps of a long job: each is a command with its log, timed, reported on one line, its log shown when it fails."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LOGS = Path("build", "log")  # in the folder where the steps run
TOOLS = Path(sys.prefix) / "bin"  # of the virtual environment


@dataclass(frozen=True)
class Result:
    name: str
    passed: bool
    output: str
    seconds: float


def run(name: str, *commands: Sequence[str], cwd: Path = ROOT, env: dict[str, str] | None = None) -> Result:
    """Run commands in `cwd` one after another until one fails; their output goes to build/log/NAME.log there."""
    logs = cwd / LOGS
    logs.mkdir(parents=True, exist_ok=True)
    start = time.monotonic()
    output, passed = "", True
    environment = {**os.environ, "PATH": f"{TOOLS}{os.pathsep}{os.environ['PATH']}", **(env or {})}
    environment["PWD"] = str(cwd)  # CMake believes it: by a symbolic link there, gcovr would look for other files
    for command in commands:
        done = subprocess.run(
            command, cwd=cwd, env=environment, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", check=False,
        )  # fmt: skip
        output += done.stdout
        if done.returncode != 0:
            output += f"exit status {done.returncode}: {' '.join(command)}\n"
            passed = False
            break
    (logs / f"{name}.log").write_text(output)
    return Result(name, passed, output, time.monotonic() - start)


def report(result: Result, closing: str = "", tail: int = 60) -> None:
    """One line for a step that passed, and the lines of its output that match `closing`; else the end of its log."""
    print(f"{'ok    ' if result.passed else 'FAILED'} {result.name:<22} {result.seconds:6.1f} s", flush=True)
    lines = result.output.splitlines()
    if result.passed:
        lines = [line for line in lines if closing and re.search(closing, line)]
    for line in lines[-tail:]:
        print(f"       {line}", flush=True)
