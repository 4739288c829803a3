"""Another robot than the cylinder in the tests' own process."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from terrapin_hil import paths
from terrapin_hil.robots import Robot, select

__all__ = ["taken"]


@contextmanager
def taken(name: str, *presets: str) -> Iterator[Robot]:
    """The robot of this name or file as that of the process, its controller built for these presets, `host` first."""
    build = ["tests/tools/build.sh", f"robot={name}", "host", *presets]
    done = subprocess.run(build, cwd=paths.ROOT, capture_output=True, text=True, check=False, timeout=1200)
    assert done.returncode == 0, done.stderr
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(paths.ROBOT_VARIABLE, "")  # so that the end undoes what select sets
        yield select(name)
