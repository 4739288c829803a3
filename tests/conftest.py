"""For all tests."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from terrapin_hil import paths


@pytest.fixture(autouse=True)
def robot_of_the_process() -> Iterator[None]:
    """Whatever robot a test takes (--robot in this process), the next one finds the one of before."""
    before = os.environ.get(paths.ROBOT_VARIABLE)
    yield
    if before is None:
        os.environ.pop(paths.ROBOT_VARIABLE, None)
    else:
        os.environ[paths.ROBOT_VARIABLE] = before
