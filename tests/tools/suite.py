"""Tests: the C tests in every build, the fuzz corpus, pytest, coverage of the core; then what cannot run here.

    suite.py [--tier test|rest]   all of them, or a tier: what `make test` runs, or the rest, for `make test-all`
    suite.py --changed            of the first tier those that the last commit and the working tree reach (reach.py)

Run after tests/setup/setup.sh test. The tiers of pytest are in tests/tools/tiers.toml, those of the builds in BUILDS.
Exit status 1 when anything failed.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path

import tiers
from reach import of_change
from steps import LOGS, ROOT, TOOLS, Result, report, run

CLOSING = r"% tests passed|^\d+: core on Cortex-M4"
BUILDS = {
    "test": ("host",),
    "rest": ("m32", "asan", "fuzz", "coverage", "cortex-m4"),
}
COVERED = r"firmware/core/.*\.c"
FOLDERS = ["tests", "hil", "host_tools", "firmware/terrapin_interface"]  # that hold tests
NO_TESTS = 5  # pytest's exit status
# Examples of the door run in tests/python/test_door.py, with its names at hand and in a folder of their own.
DOOR = "--ignore=host_tools/terrapin_tools/door"
# No test needs the plugin of schemathesis, which each worker would import.
PYTEST = ["-q", "-p", "no:schemathesis", "--doctest-modules", DOOR, "--durations=20", "--durations-min=5"]


def probe(function: str) -> bool:
    """Ask a probe of tests/setup/system.sh, the same that the set-up asked."""
    command = ["bash", "-c", f". tests/setup/system.sh && {function}"]
    return subprocess.run(command, cwd=ROOT, check=False, capture_output=True).returncode == 0


def missing_tools() -> dict[str, str]:
    """What this machine lacks: preset -> reason. The set-up has already tried to install it."""
    missing = {}
    if platform.machine() != "x86_64":
        missing["m32"] = f"needs x86-64, this is {platform.machine()}"
    elif not probe("has_m32"):
        missing["m32"] = "cc cannot compile with -m32: gcc-multilib"
    if not probe("has_fuzzer"):
        missing["fuzz"] = "clang with libFuzzer not found: clang libclang-rt-dev"
    if not probe("has_arm"):
        missing["cortex-m4"] = "ARM cross compiler not found: gcc-arm-none-eabi libnewlib-arm-none-eabi"
    return missing


def find_unity() -> str | None:
    done = subprocess.run(["tests/setup/unity.sh"], cwd=ROOT, check=False, stdout=subprocess.PIPE, text=True)
    return done.stdout.strip() if done.returncode == 0 else None


def build_and_test(preset: str, unity: str | None, programs: Sequence[str] | None = None) -> Result:
    """Build a preset and run its C tests, or those of `programs`."""
    configure = ["cmake", "--preset", preset, f"-DPython3_EXECUTABLE={sys.executable}"]
    if unity and preset != "cortex-m4":
        configure.append(f"-DUNITY_ROOT={unity}")
    verbose = ["-V"] if preset == "cortex-m4" else []  # the size of the core is worth seeing on every run
    for counts in (ROOT / "build" / preset).rglob("*.gcda"):  # counts of an earlier run
        counts.unlink()
    chosen = [] if programs is None else ["-R", f"^({'|'.join(programs)})$"]
    tests = ["ctest", "--preset", preset, "--no-tests=error", "-j", str(os.cpu_count()), *verbose, *chosen]
    steps = [configure, ["cmake", "--build", "--preset", preset], tests]
    return run(preset, *(steps if programs is None or programs else steps[:-1]))


def scenarios() -> Result:
    """Every shipped scenario with all its checks, on the build that counts lines."""
    return run(
        "scenarios",
        [sys.executable, "-m", "pytest", "-q", "tests/python/test_scenarios.py"],
        env={"TERRAPIN_BUILD": str(ROOT / "build/coverage")},
    )


def coverage() -> Result:
    """Line coverage of the core by the C tests and the shipped scenarios: 100 %."""
    return run(
        "coverage-of-core",
        ["gcovr", "--root", ".", "--filter", COVERED, "--txt-metric", "line", "--fail-under-line", "100",
         "--gcov-ignore-parse-errors=negative_hits.warn", "build/coverage"],
    )  # fmt: skip


def _places(tier: str | None) -> list[str]:
    """Where the tests of a tier are: each worker reads all of it before it runs any."""
    return FOLDERS if tier != "rest" else sorted({name.partition("::")[0].partition("[")[0] for name in tiers.rest()})


def pytest(
    workers: int, waits: Path | None, tier: str | None, files: Sequence[str] | None = None
) -> tuple[Result, list[str], dict[str, int]]:
    """All Python tests and doctests, or those of a tier, or of its `files`, a file at a time in each worker (tiers.py).

    Also what they skipped, with the reason, and how many blocks of the pages ran and how many need hardware.
    """
    start = time.monotonic()
    junit = ROOT / LOGS / "pytest.xml"
    noting = ["-p", "tests.tools.waits", "--waits-to", str(waits)] if waits else []
    noting += ["-p", "tests.tools.tiers", *(["--tier", tier] if tier else [])]
    command = [
        str(TOOLS / "python"),
        "-m",
        "pytest",
        *PYTEST,
        *(_places(tier) if files is None else files),
        f"-n{workers}",
        "--no-loadscope-reorder",  # as the folders are: the examples of modules come last, which are short
        f"--junitxml={junit}",
        *noting,
    ]
    status = subprocess.run(command, cwd=ROOT, check=False, stdin=subprocess.DEVNULL).returncode
    if files is not None and status == NO_TESTS:  # all that is reached is of the other tier
        status = 0
    skipped = []
    examples = {"examples_ran": 0, "examples_hardware": 0}
    if junit.is_file():
        for case in ElementTree.parse(junit).iter("testcase"):
            skipped += [f"{case.get('name')}: {skip.get('message')}" for skip in case.iter("skipped")]
            for entry in case.iter("property"):
                if entry.get("name") in examples:
                    examples[str(entry.get("name"))] += int(str(entry.get("value")))
    return Result("pytest", status == 0, "", time.monotonic() - start), skipped, examples


def changed(workers: int) -> int:
    """Of `make test`: what the last commit and the working tree reach."""
    start = time.monotonic()
    build = build_and_test("host", find_unity(), ())  # first, so that what C tests are built of is known
    found = of_change()
    ran = found.programs if build.passed else ()
    results = [build_and_test("host", find_unity(), ran)] if ran else [build]
    report(results[-1], CLOSING)
    if found.tests and build.passed:
        results.append(pytest(workers, None, "test", found.tests)[0])
    passed = all(result.passed for result in results)
    size = f"{len(found.changed)} changed files reach {len(found.programs)} C tests and {len(found.tests)} test files"
    print(f"\n== make test CHANGED=1: {time.monotonic() - start:.0f} s; {size}")
    for name in found.by_none:
        print(f"  {name}: reached by no test, run `make test`")
    print("all that ran has passed; `make test` runs the rest" if passed else "failed")
    return 0 if passed else 1


def main() -> int:
    parser = argparse.ArgumentParser(description="All tests.")
    parser.add_argument(
        "--workers",
        type=int,
        default=2 * (os.cpu_count() or 1),
        help="of pytest: two a core, for tests with servers and buses wait as long as they compute",
    )
    parser.add_argument("--waits-to", type=Path, help="note in this folder which tests wait (tests/tools/waits.py)")
    parser.add_argument("--tier", choices=BUILDS, help="only this tier: what `make test` runs, or the rest")
    parser.add_argument("--changed", action="store_true", help="of `make test` what a change reaches (reach.py)")
    options = parser.parse_args()
    tiers = (options.tier,) if options.tier else tuple(BUILDS)
    os.environ.pop("TERRAPIN_BUILD", None)  # what is tested is what is built here
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # else each of some thousand processes compiles all that it imports
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the commands compute; a worker a core leaves none for more
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell runs us in its background
    if options.changed:
        return changed(options.workers)
    start = time.monotonic()
    results: list[Result] = []
    missing = missing_tools()
    unity = find_unity()
    builds = [preset for tier in tiers for preset in BUILDS[tier]]
    absent = [f"{name} build and its tests ({reason})" for name, reason in missing.items() if name in builds]
    if unity is None:
        absent.append("C unit tests and the coverage of the core (Unity could not be fetched)")
    for preset in builds:
        if preset in missing or (preset == "coverage" and unity is None):
            continue
        results.append(build_and_test(preset, unity))
        report(results[-1], CLOSING)
    if unity is not None and "rest" in tiers:
        results.append(scenarios())
        report(results[-1], r"passed")
        results.append(coverage())
        report(results[-1], r"^firmware|^TOTAL")
    python, skipped, examples = pytest(options.workers, options.waits_to, options.tier)
    results.append(python)
    absent += skipped
    failed = [result.name for result in results if not result.passed]

    name = {"test": "make test", "rest": "make test-all", None: "all tests"}[options.tier]
    print(f"\n== {name}: {time.monotonic() - start:.0f} s")
    for result in results:
        report(Result(result.name, result.passed, "", result.seconds))
    ran, hardware = examples.values()
    if "rest" in tiers:
        print(f"examples of README.md, CONTRIBUTING.md and docs/: {ran} blocks ran, {hardware} need hardware")
    print("not run here: " + ("nothing, all of it ran" if not absent else ""))
    for line in absent:
        print(f"  {line}")
    print(f"failed: {', '.join(failed)}" if failed else "all that ran has passed")
    return 1 if failed else 0


if __name__ == "__main__":
    if shutil.which("bash") is None:
        sys.exit("suite: bash not found")
    sys.exit(main())
