"""Fixtures that several files of tests share."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings

settings.register_profile("reproducible", derandomize=True)  # the same examples in every run
settings.load_profile("reproducible")

LIMIT = 20.0  # s of the processor: nothing in a file may keep the program busy


@pytest.fixture
def bounded() -> Iterator[None]:
    """Fails a test that is not done after LIMIT, however long the machine takes for that."""

    def late(number: int, frame: object) -> None:
        pytest.fail(f"not done after {LIMIT:g} s of the processor")

    signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    yield
    signal.setitimer(signal.ITIMER_PROF, 0.0)
