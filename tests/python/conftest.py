"""Fixtures that several files of tests share."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from terrapin_hil.reading import ReadingError
from terrapin_hil.scenario.scenario import load_scenario

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


@pytest.fixture
def refused_scenario(tmp_path: Path) -> Callable[[str], str]:
    """The one line with which the text of a scenario is refused."""

    def refused(text: str) -> str:
        file = tmp_path / "wrong.toml"
        file.write_text(text, encoding="utf-8")
        with pytest.raises(ReadingError) as found:
            load_scenario(file)
        assert "\n" not in str(found.value)
        return str(found.value)

    return refused
