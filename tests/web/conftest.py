"""One server for all tests that leave it running."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from serving import Server


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server on a workspace with one case, shared: a test names its cases after itself."""
    running = Server(tmp_path_factory.mktemp("web"))
    assert running.ask("POST", "/api/examples/forced_slip_sand").status == 200
    yield running
    running.stop()


@pytest.fixture
def own_server(tmp_path: Path) -> Iterator[Server]:
    """A server of the test's own."""
    running = Server(tmp_path)
    yield running
    if running.process.poll() is None:
        running.stop()
