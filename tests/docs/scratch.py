"""A copy of the tree to try things in: what git tracks or would track, and how programs run on the copy."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def copy_tree(to: Path) -> Path:
    """Copy the tree to a new folder, and return it."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout.split("\0")
    for name in names:
        if name and (ROOT / name).is_file():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, to / name)
    return to


def in_copy(copy: Path, *command: str, build: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command with the packages of a copy and a build (the real one by default). AssertionError if it fails."""
    packages = os.pathsep.join(str(copy / name) for name in ("hil", "host_tools", "firmware"))
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": packages,
        "TERRAPIN_BUILD": str(build or os.environ.get("TERRAPIN_BUILD", ROOT / "build" / "host")),
    }
    for name in [name for name in environment if name.startswith(("PYTEST_", "COV_"))]:
        del environment[name]  # of the run that this is part of
    done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, timeout=1200, check=False)
    assert done.returncode == 0, f"{' '.join(command)}:\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done
