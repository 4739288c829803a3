"""A plugin of pytest: which tests wait, spawn or speak to another, as they do it; and those alone.

    python -m pytest -p tests.tools.waits --waits-to FOLDER ...    each worker notes the names of such tests there
    python -m pytest -p tests.tools.waits --waits-of FOLDER ...    only the tests that are noted there

A test waits that sleeps, or whose file imports what threads, clocks and events come from. What Python tells its audit
hooks shows the rest, in the test and in its fixtures: a process or thread that starts, a socket that connects or
listens. A browser, a compiler, QEMU and the simulator's firmware are such processes.
"""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import SupportsIndex

import pytest

SLEEP = time.sleep
EVENTS = {
    "_thread.start_new_thread", "os.exec", "os.fork", "os.forkpty", "os.posix_spawn", "os.spawn", "os.system",
    "pty.spawn", "socket.bind", "socket.connect", "subprocess.Popen", "time.sleep",
}  # fmt: skip
WAITING = re.compile(
    r"^\s*(import|from) (asyncio|concurrent|multiprocessing|playwright|pty|select|signal|tests\.waiting|threading"
    r"|time)\b",
    re.MULTILINE,
)


class Waits:
    """Notes the tests that wait, where asked."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.file = folder / f"{os.environ.get('PYTEST_XDIST_WORKER', 'main')}.txt"
        self.file.write_text("")
        self.running = False
        self.seen = False
        self.waiting: dict[Path, bool] = {}
        sys.addaudithook(self.heard)
        if sys.version_info < (3, 13):  # which tells its hooks of a sleep
            time.sleep = self.slept

    def heard(self, event: str, _arguments: object) -> None:
        if self.running and event in EVENTS:
            self.seen = True

    def slept(self, seconds: SupportsIndex | float) -> None:
        self.heard("time.sleep", ())
        SLEEP(seconds)

    def waits(self, path: Path) -> bool:
        if path not in self.waiting:
            self.waiting[path] = bool(WAITING.search(path.read_text(encoding="utf-8"))) and path.name.startswith(
                "test_"
            )
        return self.waiting[path]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self.running, self.seen = True, self.waits(item.path)
        result = yield
        self.running = False
        if self.seen:
            with self.file.open("a", encoding="utf-8") as file:
                file.write(item.nodeid.encode("unicode_escape").decode() + "\n")
        return result


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("waits")
    group.addoption("--waits-to", type=Path, help="note here which tests wait, spawn or speak to another")
    group.addoption("--waits-of", type=Path, help="run only the tests noted here")


def pytest_configure(config: pytest.Config) -> None:
    folder = config.getoption("waits_to")
    if folder is not None and not (config.getoption("numprocesses", None) and "PYTEST_XDIST_WORKER" not in os.environ):
        config.pluginmanager.register(Waits(folder), "waits-notes")


def noted(folder: Path) -> set[str]:
    """The names of the tests that the workers of a run have noted."""
    return {line for file in sorted(folder.glob("*.txt")) for line in file.read_text(encoding="utf-8").splitlines()}


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    folder = config.getoption("waits_of")
    if folder is None:
        return
    wanted = noted(folder)
    chosen = [item for item in items if item.nodeid.encode("unicode_escape").decode() in wanted]
    config.hook.pytest_deselected(
        items=[item for item in items if item.nodeid.encode("unicode_escape").decode() not in wanted]
    )
    items[:] = chosen
