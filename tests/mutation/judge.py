"""Builds a mutant and runs tests until one of them fails.

    with Bench() as bench:
        bench.judge(mutant)      # ("killed", "test_core_supervisor_blackbox") or ("survived", "") or ("equal", "") ...

A mutant is one object compiled and one library linked; the test programs are linked against that library once. Core,
link layer, store and boot loader are in it, with all their functions visible. Tests that include a mutated .c file are
compiled again with it. What these leave alive goes through the shipped scenarios (core, link, store) or through
tests/boot (boot loader), in a child of this process. The test that killed a mutant of a file last comes first for its
next one; so do the scenario and the test of tests/boot. A test fails when it takes some times longer than without a
mutant.
"""

from __future__ import annotations

import json
import math
import os
import re
import resource
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
import tomllib
from collections.abc import Callable, Sequence
from fnmatch import fnmatch
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

from terrapin_hil.paths import ROOT
from tests.mutation.operators import Mutant

__all__ = ["BITS", "Bench", "NotReady", "in_a_child", "ports_tested"]

BUILD = ROOT / "build" / "host"
PARTS = ("core_objects", "link_objects", "boot_objects")
ALSO = ("firmware/store/flash_emulated.c", "firmware/ports/host/flash_file.c")
# The black-box tests that can see a library at all; `python -m tests.mutation --map` counts who kills what.
SEEN_BY = {
    "core": "test_(?!store)",
    "link": "test_(link|f405|codec|assertions)",
    "store": "test_(store|f405|assertions)",
    "boot": "test_(boot|f405)",
    "ports": "test_f405_(port|trial)",
}
LOGIC = "f405_logic"  # what the F405's port decides: part of its black-box tests
LOOKED_IN = ("core", "link", "store", "boot")  # as the C tests do, in this order
NOT_THESE = re.compile(r"test_(linux|f405_(parts|hardware|can|imu|key)|flash_file)_")  # they test ports alone
BITS = "tests/python/data/same_bits.toml"
BOOT_TESTS = ("test_boot.py", "test_ed25519.py", "test_identity.py", "test_images.py", "test_power_cut.py")
NOT_OF_THE_LOADER = (
    "test_run_", "test_the_monitor_", "test_the_command_asks", "never_writes_over", "release_build_wants", "imgtool",
)  # fmt: skip  # tests of tests/boot that load no library
# What the build with sanitizers sees ends a test here too, without their library.
STRICT = ("-Wall", "-Wextra", "-Werror")  # of what the build asks of these files, what finds a slip
TRAPS = ("-fsanitize=undefined", "-fsanitize-undefined-trap-on-error", "-fno-sanitize=alignment,vptr")
# A test that takes LONGER times the processor's time that it takes without a mutant, and SPARE_S more, has failed.
LONGER, SPARE_S = 3.0, 2.0
FIRST_S = 60.0  # for that first time
ONE_S = 8.0  # of one scenario, and of one test of tests/boot; the longest takes 2
WAITED = 600.0  # s by the clock, on a machine however busy
SLOWED = 10.0  # times the processor's time that a test may take, where that is longer: a niced run gets little of it


class NotReady(Exception):
    """The host build with its tests is not there, or what is not mutated fails already."""


class _Refused(Exception):
    """What the compiler or the linker said."""


class Bench:
    """A place where mutants are built and tested. NotReady when the tests do not pass without any mutant.

    `switched_off`: tests that are not run, to see what goes unseen without them; with * as in file names.
    """

    def __init__(self, switched_off: Sequence[str] = ()) -> None:
        self._switched_off = switched_off
        self.folder = Path(tempfile.mkdtemp(prefix="mutants-"))
        self._library = self.folder / "libterrapin.so"
        self._commands = _commands()
        self._objects: dict[str, Path] = {}  # by the source's path in the project
        self._bytes: dict[str, bytes] = {}
        self._programs: dict[str, list[str]] = {}  # by name: the .c files that it includes, none for what is linked
        self._order: dict[str, list[str]] = {}
        (self.folder / "src").mkdir()
        for source in sorted(self._commands):
            if self._commands[source][1] in PARTS or source in ALSO:
                self._objects[source] = self._compile(source, (ROOT / source).read_text(encoding="utf-8"), "base")
                self._bytes[source] = self._objects[source].read_bytes()
        self._link(self._objects)
        unity = BUILD / "libunity.a"
        self._unity = str(unity) if unity.is_file() else str(next(BUILD.rglob("unity.c.o")))
        self._of_ports: dict[str, tuple[str, list[str]]] = {}  # built when a port's mutant is there
        for source, (_, part) in sorted(self._commands.items()):
            if source.startswith("tests/firmware/test_") and not self._is_off(part):
                white = part.endswith("_whitebox")
                inside = [name for name, _ in _included(ROOT / source, expanded(ROOT / source))] if white else []
                if NOT_THESE.match(part):
                    self._of_ports[part] = source, inside
                else:
                    self._programs[part] = inside
                    self._build_program(source, part, {})
        shutil.copytree(BUILD / "generated", self.folder / "generated")
        (self.folder / "libterrapin_boot.so").symlink_to(self._library)
        self._seconds: dict[str, float] = {}  # of processor time that a test may take, once it passed without a mutant
        self._first: dict[str, list[str]] = {}  # by the mutated file: scenarios, or tests of tests/boot, that killed
        failing = [name for name in self._programs if not self._sound(name)]
        if failing:
            raise NotReady(f"{', '.join(failing)}: failed without a mutant, expected to pass first")

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        shutil.rmtree(self.folder)

    def judge(self, mutant: Mutant) -> tuple[str, str]:
        """What became of it, and the test that killed it: killed, survived, equal (the same machine code) or invalid
        (no C, or of those that no test kills, one with a warning: the build refuses it)."""
        source = mutant.path.as_posix()
        if source not in self._order:
            self._link(self._objects)
            self._order[source] = self._tests(source)
        order = self._order[source]
        made: Path | None = None
        try:
            if source in self._commands:
                if source not in self._bytes:  # of a port
                    text = mutant.source
                    self._bytes[source] = self._compile(source, text, "base").read_bytes()
                made = self._compile(source, mutant.text(), "mutant")
        except _Refused:
            return "invalid", ""
        if made is not None and made.read_bytes() == self._bytes[source]:
            return "equal", ""
        of_a_port = Path(source).parts[1] == "ports"
        if made is not None and not of_a_port:
            self._link({**self._objects, source: made})
        if made is None:
            self._copy(source).parent.mkdir(parents=True, exist_ok=True)
            self._copy(source).write_text(mutant.text(), encoding="utf-8")
        for name in order:
            try:
                if source in self._programs.get(name, []):
                    self._build_program(source_of(self._commands, name), name, {source: self._copy(source)})
                elif of_a_port and made is not None:
                    self._build_program(source_of(self._commands, name), name, {}, (source, made))
            except _Refused:
                return "invalid", ""
            by = self._killer(name, source)
            if by is not None:
                order.remove(name)
                order.insert(0, name)
                return "killed", by
        if source in self._commands:
            warns = self._warns(source, mutant.text())
        else:  # of the chip alone: as part of a test
            warns = any(self._warns_in(name) for name in order if source in self._programs[name])
        return ("invalid", "warnings") if warns else ("survived", "")

    def _is_off(self, name: str) -> bool:
        return any(fnmatch(name, pattern) for pattern in self._switched_off)

    def _tests(self, source: str) -> list[str]:
        """The tests that may see a mutant of this file."""
        library = Path(source).parts[1]
        if library == "ports":
            return self._tests_of_ports(source)
        found = [
            program
            for program, included in self._programs.items()
            if source in included or (not included and re.match(SEEN_BY[library], program))
        ]
        slow = "tests/boot" if library == "boot" else "scenarios"
        if self._is_off(slow):
            return found
        if slow == "tests/boot":
            _import_once()
        if slow not in self._seconds and not self._sound(slow):  # the library is still as it is without a mutant
            raise NotReady(f"{slow}: failed without a mutant, expected to pass first")
        return [*found, slow]

    def _tests_of_ports(self, source: str) -> list[str]:
        logic = self._commands.get(source, ([], ""))[1] == LOGIC
        for part, (test, inside) in self._of_ports.items():
            if source in inside and part not in self._programs:
                self._programs[part] = inside
                self._build_program(test, part, {})
                if not self._sound(part):
                    raise NotReady(f"{part}: failed without a mutant, expected to pass first")
        return [
            name
            for name, inside in self._programs.items()
            if source in inside or (logic and not inside and re.match(SEEN_BY["ports"], name))
        ]

    def _sound(self, name: str) -> bool:
        """Whether this test passes; how long it may take from now on."""
        failed, _, took = self._run_test(name, "", FIRST_S)
        self._seconds[name] = LONGER * took + SPARE_S
        return not failed

    def _killer(self, name: str, source: str) -> str | None:
        """What failed of this test, which is asked first next time; None when nothing did."""
        failed, what, _ = self._run_test(name, source, self._seconds[name])
        if what:
            first = self._first.setdefault(source, [])
            if what in first:
                first.remove(what)
            first.insert(0, what)
        return f"{name} {what}".strip() if failed else None

    def _copy(self, source: str) -> Path:
        return self.folder / "src" / source

    def _compile(self, source: str, text: str, kind: str) -> Path:
        words = self._commands[source][0]
        copy, made = self._copy(source), self.folder / f"{kind}-{source.replace('/', '-')}.o"
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_text(text, encoding="utf-8")
        here = [f"-I{(ROOT / source).parent}", f"-fmacro-prefix-map={self.folder}/src/="]
        self._run([*words, "-w", *TRAPS, "-fPIC", "-fvisibility=default", *here, "-c", str(copy), "-o", str(made)])
        return made

    def _warns(self, source: str, text: str) -> bool:
        """Whether the project's own build, in which a warning is an error, refuses it."""
        copy = self._copy(source)
        copy.write_text(text, encoding="utf-8")
        words = [*self._commands[source][0], *STRICT, f"-I{(ROOT / source).parent}", "-c", str(copy), "-o", os.devnull]
        return subprocess.run(words, cwd=BUILD, check=False, capture_output=True, timeout=WAITED).returncode != 0

    def _warns_in(self, name: str) -> bool:
        """The same of a test's program, as it was built last."""
        source = source_of(self._commands, name)
        where = [f"-I{(ROOT / source).parent}", f"-I{ROOT / 'firmware/link'}", f"-I{ROOT / 'firmware/boot'}"]
        where += [f"-I{(ROOT / one).parent}" for one in self._programs[name]]
        copy = str(self.folder / "src" / Path(source).name)
        words = [*self._commands[source][0], *STRICT, *where, "-fsyntax-only", copy]
        return subprocess.run(words, cwd=BUILD, check=False, capture_output=True, timeout=WAITED).returncode != 0

    def _link(self, objects: dict[str, Path]) -> None:
        made = self._library.with_suffix(".new")
        self._run(["cc", "-shared", "-Wl,-Bsymbolic", *map(str, objects.values()), "-o", str(made), "-lm"])
        made.replace(self._library)  # a new file: what runs still maps the old one

    def _build_program(
        self, source: str, name: str, mutated: dict[str, Path], object_of: tuple[str, Path] | None = None
    ) -> None:
        """`mutated`: files that the test includes, by path; `object_of`: one of the port's that it is linked with."""
        words = self._commands[source][0]
        place = ROOT / source
        if mutated:  # a copy of the test that includes the mutant's file
            text = expanded(place)
            for included, spelt in _included(place, text):
                path = mutated.get(included, ROOT / included)
                text = text.replace(f'#include "{spelt}"', f'#include "{path}"', 1)
            place = self.folder / "src" / Path(source).name
            place.write_text(text, encoding="utf-8")
        where = [f"-I{(ROOT / source).parent}", f"-I{ROOT / 'firmware/link'}", f"-I{ROOT / 'firmware/boot'}"]
        where += [f"-I{(ROOT / one).parent}" for one in mutated]
        library = [] if self._programs[name] else [str(self._library), f"-Wl,-rpath,{self.folder}"]
        if name.startswith("test_f405_") and library:  # which has what these ask of the hardware
            objects = {path.name: path for path in BUILD.glob(f"CMakeFiles/{LOGIC}.dir/**/*.o")}
            if object_of is not None:
                objects[Path(object_of[0]).name + ".o"] = object_of[1]
            library = [*(str(objects[one]) for one in sorted(objects)), *library]
        self._run([*words, "-w", *where, str(place), self._unity, *library, "-lm", "-o", str(self.folder / name)])

    def _run(self, command: list[str]) -> None:
        done = subprocess.run(command, cwd=BUILD, check=False, capture_output=True, text=True, timeout=WAITED)
        if done.returncode:
            raise _Refused(done.stderr.strip()[:1000])

    def _run_test(self, name: str, source: str, seconds: float) -> tuple[bool, str, float]:
        first = self._first.get(source, [])
        if name == "scenarios":
            return in_a_child(lambda: _scenarios(self.folder, first), seconds)
        if name == "tests/boot":
            return in_a_child(lambda: _boot_tests(self.folder / "libterrapin_boot.so", first), seconds)
        return in_a_child(lambda: os.execv(self.folder / name, [name]), seconds)


def expanded(test: Path) -> str:
    """A test's text, with those headers beside it that include .c files themselves."""
    text = test.read_text(encoding="utf-8")
    for spelt in re.findall(r'^#include "(\w+\.h)"', text, re.MULTILINE):
        header = test.parent / spelt
        inside = header.read_text(encoding="utf-8") if header.is_file() else ""
        if re.search(r'^#include "[^"]+\.c"', inside, re.MULTILINE):
            text = text.replace(f'#include "{spelt}"', inside, 1)
    return text


@cache
def ports_tested(root: Path) -> frozenset[str]:
    """Files of the ports that a C test includes, or is linked with."""
    tests = sorted((root / "tests" / "firmware").glob("test_*.c"))
    found = {name for test in tests for name, _ in _included(test, expanded(test))}
    cmake = root / "firmware" / "cmake" / "tests.cmake"
    line = (
        re.search(rf"add_library\({LOGIC} OBJECT (.*)\)", cmake.read_text(encoding="utf-8"))
        if cmake.is_file()
        else None
    )
    for word in line[1].split() if line else []:
        found.add("firmware/ports/stm32f405/" + word.rpartition("/")[2])
    return frozenset(name for name in found if name.startswith("firmware/ports/"))


def _included(test: Path, text: str) -> list[tuple[str, str]]:
    """The .c files of the firmware that a test includes: path in the project, and as it is spelt there."""
    found = []
    for spelt in re.findall(r'^#include "([^"]+\.c)"', text, re.MULTILINE):
        places = [(test.parent / spelt).resolve(), *(ROOT / "firmware" / part / spelt for part in LOOKED_IN)]
        place = next((place for place in places if place.is_file()), None)
        if place is not None and place.is_relative_to(ROOT / "firmware"):
            found.append((place.relative_to(ROOT).as_posix(), spelt))
    return found


def source_of(commands: dict[str, tuple[list[str], str]], part: str) -> str:
    """The source of a test program; "" for what is none."""
    return next((source for source, (_, name) in commands.items() if name == part), "")


def _commands() -> dict[str, tuple[list[str], str]]:
    """Compiler and flags of each source, without warnings, output and input; and the CMake target it is part of."""
    place = BUILD / "compile_commands.json"
    if not place.is_file():
        raise NotReady(f"{place}: no such file, expected the host build (tests/tools/build.sh host)")
    found: dict[str, tuple[list[str], str]] = {}
    for entry in json.loads(place.read_text(encoding="utf-8")):
        words = shlex.split(entry["command"])
        output = words[words.index("-o") + 1]
        part = output.partition("CMakeFiles/")[2].partition(".dir/")[0]
        kept = [word for word in words[: words.index("-o")] if not word.startswith("-W") and "visibility" not in word]
        source = Path(entry["file"])
        if not source.is_relative_to(ROOT):
            continue
        name = source.relative_to(ROOT).as_posix()
        if name not in found or part in PARTS:
            found[name] = (kept, part)
    if not any(name.startswith("tests/firmware/test_") for name in found):
        raise NotReady(f"{place}: found no C test, expected the build that `make test` makes (Unity)")
    return found


def in_a_child(work: Callable[[], str | None], seconds: float) -> tuple[bool, str, float]:
    """Whether `work` fails in a process of its own: it names what failed, ends by a signal, or takes more than so many
    seconds of processor time; the name, and the time it took."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reader)
            os.setsid()
            silence = os.open(os.devnull, os.O_RDWR)
            for descriptor in (0, 1, 2):
                os.dup2(silence, descriptor)
            resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds), math.ceil(seconds) + 1))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            failed = work()
            os.write(writer, (failed or "").encode()[:1000])
            os._exit(1 if failed else 0)
        finally:
            os._exit(1)
    os.close(writer)
    end = time.monotonic() + max(WAITED, SLOWED * seconds)
    wait, done = 0.001, 0
    with os.fdopen(reader, "rb") as told:
        try:
            while True:
                done, status, used = os.wait4(child, os.WNOHANG)
                if not done and time.monotonic() > end:
                    os.killpg(child, signal.SIGKILL)
                    done, status, used = os.wait4(child, 0)
                if done:
                    what = told.read().decode(errors="replace") if os.WIFEXITED(status) else ""
                    return status != 0, what, used.ru_utime + used.ru_stime
                time.sleep(wait)
                wait = min(2.0 * wait, 0.05)
        finally:
            if not done:  # interrupted
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)


def _scenarios(folder: Path, first: Sequence[str]) -> str | None:
    """The shipped scenario that fails a check with the controller in `folder`, or answers other bits than are kept.

    `first`: those to begin with.
    """
    from terrapin_hil import paths
    from terrapin_hil.firmware import Firmware
    from terrapin_hil.links.inprocess import InProcess
    from terrapin_hil.run.run import run
    from terrapin_hil.scenario.scenario import load_scenario

    firmware = Firmware(folder)
    bits = tomllib.loads((ROOT / BITS).read_text(encoding="utf-8"))["bits"]
    for path in sorted(paths.SCENARIOS.glob("*.toml"), key=lambda path: (_place(path.stem, first), path)):
        _allow(ONE_S)
        result = run(load_scenario(path), InProcess(firmware))
        if not all(outcome.passed for outcome in result.outcomes) or not result.output_hash.startswith(bits[path.stem]):
            return path.stem
    return None


def _allow(seconds: float) -> None:
    """Ends this process when it takes so much more of the processor's time; its own limit stays."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (min(most, math.ceil(used.ru_utime + used.ru_stime + seconds)), most))


def _place(name: str, first: Sequence[str]) -> int:
    return first.index(name) if name in first else len(first)


class _Order:
    """Runs the tests that killed before first, and keeps the name of the one that failed."""

    def __init__(self, first: Sequence[str]) -> None:
        self._first = first
        self.failed = ""

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items[:] = [item for item in items if not any(word in item.name for word in NOT_OF_THE_LOADER)]
        items.sort(key=lambda item: _place(item.name, self._first))

    def pytest_runtest_logstart(self) -> None:
        _allow(ONE_S)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self.failed:
            self.failed = report.nodeid.partition("::")[2]


def _import_once() -> None:
    """What tests/boot need, for all the children of this process."""
    import cffi  # noqa: F401
    import hypothesis  # noqa: F401
    import pytest  # noqa: F401

    import terrapin_tools.flash.image
    import terrapin_tools.flash.update
    import terrapin_tools.monitor.sources  # noqa: F401
    from terrapin_hil.messages import interface

    interface()


def _boot_tests(library: Path, first: Sequence[str]) -> str | None:
    """The test of the boot loader that fails; `first`: those to begin with."""
    import pytest

    os.environ["BOOT_LIBRARY"] = str(library)
    os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = str(library.parent / "hypothesis")
    files = [str(ROOT / "tests" / "boot" / name) for name in BOOT_TESTS]
    order = _Order(first)
    without = [word for name in ("cacheprovider", "xdist", "schemathesis") for word in ("-p", f"no:{name}")]
    status = pytest.main(["-x", "-q", "--assert=plain", *without, *files], plugins=[order])
    return (order.failed or "no test ran") if status else None
