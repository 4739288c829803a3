"""Fixtures that several files of tests share."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings

settings.register_profile("reproducible", derandomize=True)  # the same examples in every run
settings.load_profile("reproducible")

LIMIT = 20  # s: nothing in a file may keep the program busy


@pytest.fixture
def bounded() -> Iterator[None]:
    """Fails a test that is not done after LIMIT."""

    def late(number: int, frame: object) -> None:
        pytest.fail(f"not done after {LIMIT} s")

    signal.signal(signal.SIGALRM, late)
    signal.alarm(LIMIT)
    yield
    signal.alarm(0)
