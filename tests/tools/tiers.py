"""Two tiers of tests, also as a plugin of pytest: what `make test` runs, and the rest, which `make test-all` runs.

    python -m pytest -p tests.tools.tiers --tier test|rest ...

tests/tools/tiers.toml names the rest, each with its reason. Whatever is not named there is run by `make test`: so every
test is in one tier, and a new file is in the one that people run.

A file's tests stay in one process, so that they share what its fixtures made; those in SPREAD go where there is room.
"""

from __future__ import annotations

import gc
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

TIERS = ("test", "rest")
SPREAD = ("tests/docs/test_blocks.py",)  # long tests that share nothing
LIST = Path(__file__).with_name("tiers.toml")


@cache
def rest() -> dict[str, str]:
    """Folder, file or test of the rest, as pytest names it from the root -> why it is there."""
    listed: dict[str, str] = tomllib.loads(LIST.read_text(encoding="utf-8"))["rest"]
    return listed


def above(name: str) -> set[str]:
    """A test or file, by pytest's name of it, and all that it stands in: folders, file, test without its parameters."""
    return {name, *(name[: end.start()] for end in re.finditer(r"/|::|\[", name))}


@cache
def tier(name: str) -> str:
    """The tier of a test, or of all that a file holds, by pytest's name of it."""
    return "rest" if above(name) & rest().keys() else "test"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--tier", choices=TIERS, help="only the tests of this tier")


def together(name: str) -> str:
    """Tests with the same word run in one process."""
    file = name.partition("::")[0]
    return name if file in SPREAD else file


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Not --dist=loadgroup: with pytest 9.2 pytest-xdist 3.8 loses the groups without a word: all make everything."""
    from xdist.scheduler import LoadScopeScheduling  # type: ignore[import-untyped]  # xdist has no types

    class ByFile(LoadScopeScheduling):  # type: ignore[misc]
        def _split_scope(self, nodeid: str) -> str:
            return together(nodeid)

    return ByFile(config, log)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Read by each worker, run by none: files of the rest alone, and what is no test and has no examples."""
    if collection_path.suffix != ".py" or not collection_path.is_relative_to(LIST.parents[2]):
        return None
    if not collection_path.name.startswith("test_"):
        return b">>> " not in collection_path.read_bytes() or None
    name = collection_path.relative_to(LIST.parents[2]).as_posix()
    return (config.getoption("--tier") == "test" and tier(name) == "rest") or None


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """What was imported and collected stays until the end: the garbage collector goes over it in no round."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    asked = config.getoption("--tier")
    if asked is None:
        return
    others = [item for item in items if tier(item.nodeid) != asked]
    config.hook.pytest_deselected(items=others)
    items[:] = [item for item in items if tier(item.nodeid) == asked]
