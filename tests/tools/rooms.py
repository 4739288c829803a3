"""The order of the rooms: no import runs upward, no files import or call each other in a circle, no folder overflows.

    rooms.py [--root DIR] [--build DIR]...   status 1 and a line for each finding

Python is read from its syntax tree, imports inside functions included. An arrow between rooms of one floor is no
finding as long as no circle comes of it.

C is read from a finished Ninja build, one program or library at a time, because two ports define the same names: its
objects, and of its archives the members that the linker would take. A unit stands on another when it needs a symbol
that the other defines. Programs of tests are left out: they hold stand-ins for what lies below. So are the linker's
wraps, which count instructions.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from steps import ROOT

PACKAGES = {
    "terrapin_interface": "firmware/terrapin_interface",
    "terrapin_hil": "hil/terrapin_hil",
    "terrapin_tools": "host_tools/terrapin_tools",
}
# From the ground up. A module belongs to the longest name here that begins its own, and imports nothing further down.
FLOORS: tuple[tuple[str, ...], ...] = (
    ("terrapin_interface",),
    ("terrapin_hil", "terrapin_hil.paths", "terrapin_hil.units"),
    ("terrapin_hil.physics", "terrapin_hil.reading", "terrapin_hil.messages"),
    (
        "terrapin_hil.effect_files",
        "terrapin_hil.library",
        "terrapin_hil.firmware",
        "terrapin_hil.nodes",
        "terrapin_hil.telemetry",
    ),
    ("terrapin_hil.robot",),
    ("terrapin_hil.scenario",),
    ("terrapin_hil.simulation",),
    ("terrapin_hil.links",),
    ("terrapin_hil.run",),
    ("terrapin_hil.fmi",),
    ("terrapin_tools", "terrapin_tools.errors", "terrapin_tools.extras", "terrapin_tools.figure_style"),
    ("terrapin_tools.bounded",),
    ("terrapin_tools.parquet_files",),
    ("terrapin_tools.logs",),
    ("terrapin_tools.workbench", "terrapin_tools.workbench.files", "terrapin_tools.workbench.bases"),
    ("terrapin_tools.command_options",),
    ("terrapin_tools.workbench.noise", "terrapin_tools.workbench.case"),
    ("terrapin_tools.workbench.model", "terrapin_tools.workbench.new_case"),
    ("terrapin_tools.workbench.compare",),
    ("terrapin_tools.workbench.experiment", "terrapin_tools.workbench.formulas"),
    ("terrapin_tools.workbench.discover", "terrapin_tools.workbench.robot"),
    ("terrapin_tools.workbench.story",),
    ("terrapin_tools.workbench.fleet", "terrapin_tools.workbench.intake"),
    (
        "terrapin_tools.soil",
        "terrapin_tools.param",
        "terrapin_tools.flash",
        "terrapin_tools.experiments",
        "terrapin_tools.sheet",
    ),
    (
        "terrapin_tools.monitor",
        "terrapin_tools.papers",
        "terrapin_tools.contact_error",
        "terrapin_tools.batch",
        "terrapin_tools.doctor",
    ),
    ("terrapin_tools.door",),
    ("terrapin_tools.web.service",),
    ("terrapin_tools.web.cases",),
    ("terrapin_tools.web.live", "terrapin_tools.web.simulate"),
    ("terrapin_tools.web",),
    ("terrapin_tools.demo",),
    ("terrapin_tools.commands",),
    ("terrapin_tools.command_line",),
    ("terrapin_tools.cli",),
    ("terrapin_tools.worker",),
)
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
MOST = 15  # modules, C units or scripts in one folder, each kind by itself
# One file an entry, however many.
CATALOGUES = ("physics/effects", "files/formats", "physics/mechanics", "terrapin_tools/commands", "scenario/scenarios")
Arrows = Mapping[str, set[str]]


def room(module: str) -> str:
    while module not in FLOOR:
        module, _, rest = module.rpartition(".")
        if not rest:
            raise KeyError(module)
    return module


def modules(root: Path) -> dict[str, Path]:
    found = {}
    for package, folder in PACKAGES.items():
        for path in sorted((root / folder).rglob("*.py")):
            parts = [package, *path.relative_to(root / folder).with_suffix("").parts]
            found[".".join(parts).removesuffix(".__init__")] = path
    return found


def imported(tree: ast.AST, known: Iterable[str]) -> set[tuple[str, int]]:
    """Modules of ours that a syntax tree imports, with their lines; `from package import module` is that module."""
    known = set(known)
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            while name and name not in known:
                name = name.rpartition(".")[0]
            if name:
                found.add((name, node.lineno))
    return found


def circles(arrows: Arrows) -> list[list[str]]:
    """Groups of two and more that reach each other (Tarjan's strongly connected components), sorted."""
    number: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(node: str) -> None:
        number[node] = low[node] = len(number)
        stack.append(node)
        for other in sorted(arrows.get(node, ())):
            if other not in number:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], number[other])
        if low[node] == number[node]:
            group = [stack.pop()]
            while group[-1] != node:
                group.append(stack.pop())
            if len(group) > 1:
                found.append(sorted(group))

    for node in sorted(arrows):
        if node not in number:
            visit(node)
    return sorted(found)


def python_findings(root: Path) -> list[str]:
    paths = modules(root)
    arrows: dict[str, set[str]] = defaultdict(set)
    findings = []
    for module, path in paths.items():
        where = path.relative_to(root)
        for other, line in sorted(imported(ast.parse(path.read_text(encoding="utf-8")), paths)):
            if other == module:
                continue
            arrows[module].add(other)
            if FLOOR[room(other)] > FLOOR[room(module)]:
                findings.append(f"{where}:{line}: {room(module)} imports {other}, which stands above it")
    between: dict[str, set[str]] = defaultdict(set)
    for module, others in arrows.items():
        between[room(module)] |= {room(other) for other in others} - {room(module)}
    findings += [f"circle of modules: {', '.join(group)}" for group in circles(arrows)]
    findings += [f"circle of rooms: {', '.join(group)}" for group in circles(between)]
    return findings


def folder_findings(root: Path) -> list[str]:
    counts: dict[tuple[Path, str], set[str]] = defaultdict(set)
    kinds = {".py": "modules", ".c": "C units", ".h": "C units", ".js": "scripts", ".sh": "scripts"}
    for top in ("hil", "host_tools"):
        for path in (root / top).rglob("*"):
            if path.suffix in kinds and path.name != "__init__.py":
                counts[path.parent.relative_to(root), kinds[path.suffix]].add(path.stem)
    return [
        f"{folder}: {len(names)} {kind}, expected at most {MOST} in one folder"
        for (folder, kind), names in sorted(counts.items())
        if len(names) > MOST and not folder.as_posix().endswith(CATALOGUES)
    ]


@dataclass
class Unit:
    """A compiled C unit: the symbols it defines, those that another unit may replace, and those it needs."""

    strong: set[str] = field(default_factory=set)
    weak: set[str] = field(default_factory=set)
    needed: set[str] = field(default_factory=set)


def linked(build: Path) -> dict[str, list[str]]:
    """What each program, library and archive of a build is linked from, as its build.ninja says."""
    text = (build / "build.ninja").read_text(encoding="utf-8").replace("$\n", " ")
    rule = r"^build (\S+)[^:\n]*: C_(?:EXECUTABLE|SHARED_LIBRARY|STATIC_LIBRARY)_LINKER\S* ([^\n]*)"
    return {
        target: [word for word in words.split(" || ")[0].split() if word.endswith((".o", ".obj", ".a"))]
        for target, words in re.findall(rule, text, re.MULTILINE)
    }


def source(member: str) -> str:
    """The C file of an object: CMakeFiles/core_objects.dir/firmware/core/slip.c.obj is firmware/core/slip.c."""
    return re.sub(r"^CMakeFiles/[^/]+\.dir/|\.(o|obj)$", "", member)


def symbols(build: Path, objects: Iterable[str]) -> dict[str, Unit]:
    """Every object's symbols, read by one call of the tool that belongs to the build's compiler."""
    cache = (build / "CMakeCache.txt").read_text(encoding="utf-8")
    tool = re.search(r"^CMAKE_NM:FILEPATH=(.+)$", cache, re.MULTILINE)
    command = [tool[1] if tool else "nm", "-A", "-g", *sorted(objects)]
    words = subprocess.run(command, cwd=build, capture_output=True, text=True, check=True).stdout
    units: dict[str, Unit] = defaultdict(Unit)
    for member, kind, name in re.findall(r"^(\S+):[0-9a-f ]* ([A-Za-z]) (\S+)$", words, re.MULTILINE):
        unit = units[member]
        (unit.needed if kind in "Uvw" else unit.weak if kind in "VWC" else unit.strong).add(name)
    return units


def owners(parts: Iterable[str], archives: Iterable[list[str]], units: Mapping[str, Unit]) -> dict[str, str]:
    """The object that each symbol comes from. An archive's member is taken when something is missing that it has."""
    owner: dict[str, str] = {}
    missing: set[str] = set()

    def take(member: str) -> None:
        unit = units[member]
        owner.update(dict.fromkeys(unit.strong, member))
        for name in unit.weak:
            owner.setdefault(name, member)
        missing.update(unit.needed)

    for part in parts:
        take(part)
    waiting = [member for archive in archives for member in archive]
    while True:
        missing -= owner.keys()
        member = next((member for member in waiting if units[member].strong & missing), None)
        if member is None:
            return owner
        waiting.remove(member)
        take(member)


def c_findings(build: Path) -> list[str]:
    """Circles of C units, one program or library of a build at a time."""
    if not (build / "build.ninja").is_file():
        return [f"{build}: no build.ninja, expected a finished Ninja build"]
    targets = linked(build)
    if not targets:
        return [f"{build}: no program or library of C, expected at least one"]
    parts = {target: [word for word in words if not word.endswith(".a")] for target, words in targets.items()}
    units = symbols(build, {member for members in parts.values() for member in members})
    findings = set()
    for target, members in parts.items():
        if target.endswith(".a") or any("/tests/" in member for member in members):
            continue
        owner = owners(members, [parts[word] for word in targets[target] if word in parts], units)
        arrows: dict[str, set[str]] = defaultdict(set)
        for member in {*members, *owner.values()}:
            needed = {source(owner[name]) for name in units[member].needed if name in owner}
            arrows[source(member)] |= needed - {source(member)}
        findings |= {f"circle of C units: {', '.join(group)}" for group in circles(arrows)}
    return sorted(findings)


def main() -> int:
    parser = argparse.ArgumentParser(description="The order of the rooms.")
    parser.add_argument("--root", type=Path, default=ROOT)
    parser.add_argument("--build", type=Path, action="append", default=[], help="of C, to look for circles in")
    options = parser.parse_args()
    findings = python_findings(options.root) + folder_findings(options.root)
    for build in options.build:
        findings += c_findings(build)
    for line in dict.fromkeys(findings):  # builds share the core
        print(line)
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
