"""What an installed Terrapin offers to other tools, for a process that a test starts: the tree's own entry points."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def environment(folder: Path, **more: str) -> dict[str, str]:
    """Of a process that finds the entry points of pyproject.toml, as tests/setup/link_project.py writes them."""
    site, scripts = folder / "site", folder / "bin"
    for one in (site, scripts):
        one.mkdir(parents=True, exist_ok=True)
    subprocess.run([sys.executable, ROOT / "tests/setup/link_project.py", site, scripts], check=True)
    packages = [str(site), *(str(ROOT / name) for name in ("hil", "host_tools", "firmware"))]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(packages), **more}
