"""Which tests a change can reach: `make test CHANGED=1`.

    reach.py [--since REV]   prints what changed, the C tests and the test files that it reaches

The change is what HEAD and the working tree have that REV, the commit before HEAD, has not. Python by imports, those
inside functions and of commands that a test names included, as far as NEAR steps from the test file: nearly every test
stands on nearly every module in the end, and `make test` runs those. C by what a test program is built of (the finished
build/host). A data file by tests that name it, else by the modules beside it. What no test reaches so is said.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from rooms import PACKAGES, imported, modules
from steps import ROOT, TOOLS

NEAR = 2  # imports between a test file and what changed: the module that it tests, and what that one stands on
# Each runs the whole controller, so any change of its C reaches them.
OF_FIRMWARE = ("tests/python/test_same_bits.py", "tests/python/test_scenarios.py")
GENERATED = "firmware/terrapin_interface/"  # what C is generated from


@dataclass(frozen=True)
class Reached:
    changed: tuple[str, ...]
    tests: tuple[str, ...]  # files for pytest
    programs: tuple[str, ...]  # for ctest
    by_none: tuple[str, ...]  # changed files that no test reaches


def changed_files(since: str, root: Path = ROOT) -> list[str]:
    """Files that differ from a commit, and those that git does not know yet; all where there is no such commit."""

    def said(*words: str) -> list[str]:
        done = subprocess.run(["git", *words], cwd=root, check=True, capture_output=True, text=True)
        return done.stdout.splitlines()

    known = ["git", "rev-parse", "-q", "--verify", f"{since}^{{commit}}"]
    there = subprocess.run(known, cwd=root, check=False, capture_output=True).returncode == 0
    tracked = said("diff", "--name-only", since) if there else said("ls-files")
    return sorted({*tracked, *said("ls-files", "--others", "--exclude-standard")})


class Imports:
    """What each test file stands on: modules of the packages and of tests/."""

    def __init__(self, root: Path = ROOT) -> None:
        self.root = root
        self.paths = modules(root)
        for path in (root / "tests").rglob("*.py"):
            parts = path.relative_to(root).with_suffix("").parts
            self.paths[".".join(parts).removesuffix(".__init__")] = path
        self.tests = {
            str(path.relative_to(root)): name for name, path in self.paths.items() if path.name.startswith("test_")
        }
        self._commands = {name.rpartition(".")[2]: name for name in self.paths if ".commands." in name}
        self._direct: dict[str, set[str]] = {}
        self._below: dict[str, set[str]] = {}

    def direct(self, module: str) -> set[str]:
        """What a module imports; of a test also the commands that it names, its helpers beside it and its fixtures."""
        if module not in self._direct:
            tree = ast.parse(self.paths[module].read_text(encoding="utf-8"))
            found = {name for name, _ in imported(tree, self.paths)}
            if module.startswith("tests."):
                nodes = list(ast.walk(tree))
                words = {n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)}
                found |= {self._commands[word] for word in words if word in self._commands}
                beside = {str(n.module) for n in nodes if isinstance(n, ast.ImportFrom)}
                beside |= {alias.name for n in nodes if isinstance(n, ast.Import) for alias in n.names}
                folder = module.rpartition(".")[0]
                found |= {f"{folder}.{name}" for name in [*beside, "conftest"] if f"{folder}.{name}" in self.paths}
            self._direct[module] = found - {module}
        return self._direct[module]

    def below(self, module: str) -> set[str]:
        """A module and what it stands on, NEAR imports away; a helper of the tests is no step."""
        if module not in self._below:
            self._below[module] = self._near(module)
        return self._below[module]

    def _near(self, module: str) -> set[str]:
        found, edge = {module}, {module}
        for _ in range(NEAR):
            reached: set[str] = set()
            while edge:
                new = {name for one in edge for name in self.direct(one)} - found
                found |= new
                reached |= new
                edge = {name for name in new if name.startswith("tests.")}
            edge = reached
        return found


def programs(root: Path = ROOT) -> dict[str, set[str]]:
    """C test or host program -> sources and headers that it is built of; empty without a finished build/host."""
    build = root / "build/host"
    if not (build / ".ninja_deps").is_file():
        return {}

    def ninja(*words: str) -> list[str]:
        command = [str(TOOLS / "ninja"), "-C", str(build), "-t", *words]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        return done.stdout.splitlines()

    headers: dict[str, set[str]] = {}
    current = ""
    for line in ninja("deps"):
        if line and not line.startswith(" "):
            current = line.split(":")[0]
        elif line:
            headers.setdefault(current, set()).add(line.strip())
    found = {}
    made = [*build.glob("test_*"), *build.glob("terrapin-*")]
    for program in sorted(path.name for path in made if path.is_file() and not path.suffix):
        inputs = set(ninja("inputs", program))
        places = {(build / name).resolve() for name in inputs.union(*(headers.get(name, ()) for name in inputs))}
        found[program] = {str(path.relative_to(root)) for path in places if path.is_relative_to(root)}
    return found


def reached(changed: Iterable[str], imports: Imports, built: Mapping[str, set[str]]) -> Reached:
    """The tests that a change of these files reaches."""
    changed = tuple(changed)
    module_of = {str(path.relative_to(imports.root)): name for name, path in imports.paths.items()}
    beside: dict[str, set[str]] = {}
    for name, module in module_of.items():
        beside.setdefault(str(Path(name).parent), set()).add(module)
    below = {test: imports.below(module) for test, module in imports.tests.items()}
    text = {test: (imports.root / test).read_text(encoding="utf-8") for test in below}
    tests: set[str] = set()
    of_c: set[str] = set()
    by_none = []
    for name in changed:
        path = Path(name)
        named = path.stem if path.suffix == ".toml" else path.name
        folder = next((str(up) for up in path.parents if str(up) in beside), "")
        if name in module_of:
            mine = {test for test, modules_below in below.items() if module_of[name] in modules_below}
        else:
            mine = {test for test in below if re.search(rf"(?<![\w.]){re.escape(named)}\b", text[test])}
        if not mine and folder.startswith(tuple(f"{place}/" for place in PACKAGES.values())):
            mine = {test for test, modules_below in below.items() if beside[folder] & modules_below}
        of_it = {program for program, sources in built.items() if name in sources}
        ran = {program for program in of_it if program.startswith("test_")}
        if not ran:  # no C test has it: those that start a program with it
            mine |= {test for test in below for program in of_it if program in text[test]}
        if name.startswith("firmware/") and (path.suffix in (".c", ".h") or name.startswith(GENERATED)):
            mine |= set(OF_FIRMWARE) & below.keys()
        if not mine and not ran:
            by_none.append(name)
        tests |= mine
        of_c |= ran
    return Reached(changed, tuple(sorted(tests)), tuple(sorted(of_c)), tuple(by_none))


def of_change(since: str = "HEAD~1", root: Path = ROOT) -> Reached:
    """The tests that the last commit and the working tree reach."""
    return reached(changed_files(since, root), Imports(root), programs(root))


def main() -> None:
    parser = argparse.ArgumentParser(
        description="Which tests a change can reach.", epilog="Example: reach.py --since main"
    )
    parser.add_argument("--since", default="HEAD~1", help="the commit that the change is counted from (%(default)s)")
    found = of_change(parser.parse_args().since)
    titles = ("changed", "test files", "C tests", "reached by no test")
    for title, names in zip(titles, (found.changed, found.tests, found.programs, found.by_none), strict=True):
        print(f"{title}: {len(names)}", *names, sep="\n  ")


if __name__ == "__main__":
    main()
