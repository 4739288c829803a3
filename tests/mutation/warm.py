"""Test files in a fork of this process, which has imported what no slip changes.

    known = record(runs, names)         # {node id: Seen}: what each test calls in the modules of these names
    prepare()
    failing(files, chosen, planted)     # the test that failed, "" when none did

A fork has pytest and what else takes long to import (HEAVY); modules of this tree it imports itself, with the slip's
text in place of the module's. So each slip costs its tests, and neither the start of Python nor that of pytest.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import runpy
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any

import hypothesis
import pytest

from terrapin_hil.paths import ROOT
from tests.mutation.judge import in_a_child

__all__ = ["Seen", "failing", "prepare", "record"]

NO_TESTS = 5  # of pytest: all that was chosen is of the other tier
INSIDE = Path(__file__).with_name("inside")
LONGER, SPARE_S = 3.0, 20.0  # of the processor, against what it took without a slip
RECORDED_S = 3600.0
MOST_S = 300.0  # of the processor, where it is not known what it takes
# Plain: where assertions are rewritten, pytest reads files of the command line itself.
OPTIONS = (
    "--assert=plain", "--doctest-modules", "-x", "-q", "--no-header", "--tb=no",
    *(word for name in ("cacheprovider", "xdist", "schemathesis") for word in ("-p", f"no:{name}")),
)  # fmt: skip
HEAVY = ("cffi", "numpy", "pint", "scipy.linalg", "scipy.optimize", "scipy.special", "scipy.stats")
STARTS = {"subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn"}  # events of sys.audit


@dataclass(frozen=True)
class Seen:
    """A test that passed: what it called, "path function", whether also in another process, and what it took."""

    calls: frozenset[str]
    elsewhere: bool
    seconds: float


def _of_this_tree(module: ModuleType) -> bool:
    places = [getattr(module, "__file__", None) or "", *map(str, getattr(module, "__path__", []))]
    return any(Path(p).is_relative_to(ROOT) and ".venv" not in Path(p).relative_to(ROOT).parts for p in places if p)


class _Chosen:
    """The tests of these names in this order (all, when there are none), and which failed."""

    def __init__(self, names: Sequence[str]) -> None:
        self._place = {name: i for i, name in enumerate(names)}
        self.failed = ""

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        if self._place:
            items[:] = [item for item in items if item.nodeid in self._place]
            items.sort(key=lambda item: self._place[item.nodeid])

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed and not self.failed:
            self.failed = report.nodeid

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self.failed:
            self.failed = report.nodeid


class _Recorder:
    """What each test calls, its fixtures of a wider scope included, also where another test had them made."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = {str(ROOT / name): name for name in names}
        self._calls: set[CodeType] = set()
        self._elsewhere = False
        self._fixtures: dict[str, tuple[set[str], bool]] = {}
        self.tests: dict[str, tuple[list[str], bool, float]] = {}
        sys.addaudithook(self._audit)
        threading.settrace(self._trace)

    def _audit(self, event: str, _: object) -> None:
        self._elsewhere = self._elsewhere or event in STARTS

    def _trace(self, frame: FrameType, event: str, arg: object) -> None:
        self._calls.add(frame.f_code)

    def _taken(self) -> tuple[set[str], bool]:
        codes = list(self._calls)  # other threads call on
        named = {f"{self._names[c.co_filename]} {c.co_name}" for c in codes if c.co_filename in self._names}
        spawned = any(c.co_name == "start" and c.co_filename.endswith("multiprocessing/process.py") for c in codes)
        return named, self._elsewhere or spawned

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Any:
        if fixturedef.scope == "function":
            return (yield)
        calls, elsewhere = self._calls, self._elsewhere
        self._calls, self._elsewhere = set(), False
        result = yield
        self._fixtures[fixturedef.argname] = self._taken()
        self._calls, self._elsewhere = self._calls | calls, self._elsewhere or elsewhere
        return result

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Any:
        self._calls, self._elsewhere = set(), False
        begin = _processor()
        sys.settrace(self._trace)
        result = yield
        sys.settrace(None)
        calls, elsewhere = self._taken()
        for name in item.fixturenames:
            more, also = self._fixtures.get(name, (set(), False))
            calls, elsewhere = calls | more, elsewhere or also
        self.tests[item.nodeid] = sorted(calls), elsewhere, _processor() - begin
        return result


def _processor() -> float:
    """Seconds that this process and those that it waited for took."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def _run(arguments: Sequence[str], plugins: list[Any], planted: Path | None) -> int:
    """pytest, in a fork: this tree's modules are imported anew."""
    for name in [
        name for name, module in sys.modules.items() if isinstance(module, ModuleType) and _of_this_tree(module)
    ]:
        del sys.modules[name]
    os.chdir(ROOT)
    sys.argv = ["pytest"]
    if planted is not None:
        os.environ["TERRAPIN_MUTANT"] = str(planted)
        os.environ["PYTHONPATH"] = os.pathsep.join([str(INSIDE), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
        runpy.run_path(str(INSIDE / "sitecustomize.py"))
    first = (hypothesis.Phase.explicit, hypothesis.Phase.generate)  # what fails is not made smaller: that takes minutes
    hypothesis.settings.register_profile("slips", phases=first, database=None)
    hypothesis.settings.load_profile("slips")
    return int(pytest.main([*OPTIONS, *arguments], plugins=plugins))


def record(runs: Sequence[Sequence[str]], names: Sequence[str]) -> dict[str, Seen]:
    """What the tests of these runs (arguments of pytest) call in the modules of these names, without a slip.

    Raises ValueError, with its name, for a test that fails.
    """
    found: dict[str, Seen] = {}
    for arguments in runs:
        with tempfile.TemporaryDirectory() as folder:
            told = Path(folder, "told.json")
            failed, what, _ = in_a_child(partial(_note, arguments, names, told), RECORDED_S)
            if failed:
                raise ValueError(what or arguments[0])
            tests = json.loads(told.read_text(encoding="utf-8"))
        found |= {name: Seen(frozenset(calls), elsewhere, took) for name, (calls, elsewhere, took) in tests.items()}
    return found


def _note(arguments: Sequence[str], names: Sequence[str], told: Path) -> str | None:
    recorder, chosen = _Recorder(names), _Chosen([])
    status = _run(arguments, [recorder, chosen], None)
    told.write_text(json.dumps(recorder.tests), encoding="utf-8")
    return None if status in (0, NO_TESTS) else chosen.failed or f"status {status}"


def prepare() -> None:
    """Imports what the forks then need not. Not all that tests import: some of it changes what others do."""
    for name in HEAVY:
        importlib.import_module(name)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell runs us in its background


def failing(
    entry: Sequence[str], chosen: Sequence[str] = (), planted: Path | None = None, seconds: float | None = None
) -> str:
    """The test that fails with the slip of the file `planted`; "" when none does. What takes too long has failed.

    `entry`: files, and further arguments of pytest; `chosen`: the tests to run, in this order, all when empty;
    `seconds`: of the processor, what they take without a slip.
    """
    most = MOST_S if seconds is None else LONGER * seconds + SPARE_S

    def work() -> str | None:
        plugin = _Chosen(chosen)
        status = _run(entry, [plugin], planted)
        return None if status in (0, NO_TESTS) else plugin.failed or f"{entry[0]}: status {status}"

    begin = time.monotonic()
    failed, what, _ = in_a_child(work, most)
    return (what or f"{entry[0]}: no end in {time.monotonic() - begin:.0f} s") if failed else ""
