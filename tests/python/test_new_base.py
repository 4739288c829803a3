"""A base model or a terrain is added in one file, and no base is known by name outside its own file.

What is added stands in a scratch copy of the program, whose other files stay as they are.
"""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from terrapin_hil import paths
from terrapin_tools.workbench.bases import BASES, ELSEWHERE

TOPS = ("hil", "host_tools", "firmware")
BASE_FOLDER = "host_tools/terrapin_tools/workbench/bases"
MOST = 3  # comparisons with a base's name in all of host_tools and hil

PAGE = (paths.ROOT / "docs" / "bases.md").read_text()
WINCH, _, MARSH = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
SCENARIO = """title = "Steady rolling on a marsh at 6 V"
duration = "3 s"
checks = ["abs(mean(contact_torque[2:]) - 0.11) < 0.02"]

[[path]]
terrain = "marsh"

[[operator]]
at = "0 s"
request = "run"
setpoint = "6 V"
"""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the program's sources, and a folder to work in beside it."""
    for top in TOPS:
        target = tmp_path / "program" / top
        shutil.copytree(paths.ROOT / top, target, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "work").mkdir()
    return tmp_path / "program"


def changed(copy: Path) -> set[str]:
    """Files of the copy that are not as in the program."""
    found = set()
    for file in (path for top in TOPS for path in (copy / top).rglob("*") if path.is_file()):
        name = file.relative_to(copy)
        original = paths.ROOT / name
        if "__pycache__" not in name.parts and (not original.is_file() or original.read_bytes() != file.read_bytes()):
            found.add(name.as_posix())
    return found


def run(copy: Path, *arguments: object) -> str:
    """What `terrapin` of the copy prints."""
    path = os.pathsep.join(str(copy / top) for top in TOPS)
    environment = {**os.environ, "PYTHONPATH": path, "TERRAPIN_BUILD": str(paths.build())}
    command = [sys.executable, "-c", "from terrapin_tools.cli import main; main()", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=copy.parent / "work")
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def lifted(file: Path) -> None:
    """Lifts and lowerings of a winch whose magnets lose 0.3 % a kelvin."""
    random = np.random.default_rng(4)
    rows = ["run,w_drum [rad/s],load [N],temp [degC],i_motor [A],rope_pull [N]"]
    for number in range(10):
        load, speed, first = random.uniform(20, 80), random.uniform(1, 6), random.uniform(20, 40)
        for row in range(12):
            celsius, omega = first + 3.0 * row, speed if row % 2 else -speed
            torque = load * 0.05 + 0.3 * np.sign(omega)
            current = torque / (0.1 * (1 - 0.003 * (celsius - 25))) + 0.05 * random.standard_normal()
            values = (omega, load, celsius, current, load + 0.2 * random.standard_normal())
            rows.append(",".join([f"r{number}", *(f"{value:.8g}" for value in values)]))
    file.write_text("\n".join(rows) + "\n")


def test_a_base_in_a_file_of_its_own_is_found_compared_and_named(copy: Path) -> None:
    (copy / BASE_FOLDER / "winch.py").write_text(WINCH)
    work = copy.parent / "work"
    lifted(work / "lifts.csv")
    said = run(copy, "case", "lifts.csv", "--to", "lifts")
    assert "lifts/case.toml: winch, 10 runs" in said
    case = (work / "lifts" / "case.toml").read_text()
    assert 'drum_radius = "50 mm"' in case
    assert 'rope_pull = { column = "rope_pull [N]", unit = "N" }' in case
    run(copy, "compare", "lifts", "--json", "compared.json")
    compared = json.loads((work / "compared.json").read_text())
    assert compared["model"]["base"] == "winch"
    assert compared["adequacy"]["p_value"] < 0.05
    run(copy, "discover", "lifts", "--json", "found.json")
    found = json.loads((work / "found.json").read_text())
    assert found["missing"] == ["motor_heating"]
    run(copy, "add", "lifts", "motor_heating", "--json", "added.json")
    assert json.loads((work / "added.json").read_text())["adequacy"]["p_value"] > 0.05
    assert changed(copy) == {f"{BASE_FOLDER}/winch.py"}


def test_a_terrain_is_one_line_of_one_file(copy: Path) -> None:
    plant = copy / "hil/terrapin_hil/robot/plant.py"
    text = plant.read_text()
    plant.write_text(text.replace('    "sand": Terrain(', f'{MARSH}    "sand": Terrain('))
    (copy.parent / "work" / "marsh.toml").write_text(SCENARIO)
    ran = json.loads(run(copy, "run", "marsh.toml", "--json"))
    assert ran["passed"]
    assert changed(copy) == {"hil/terrapin_hil/robot/plant.py"}


# ---------------------------------------------------------------- names of bases


def known_by_name(tree: ast.AST, names: frozenset[str]) -> list[int]:
    """Lines that compare with a base's name, or look something up by it."""
    field = names - {"equation"}  # which is also a table of case.toml and a field of an effect
    lines = set()

    def among(nodes: list[ast.expr | None], wanted: frozenset[str]) -> bool:
        constants = [part for node in nodes if node is not None for part in ast.walk(node)]
        return any(isinstance(part, ast.Constant) and part.value in wanted for part in constants)

    for node in ast.walk(tree):
        found = False
        match node:
            case ast.Compare(left=left, comparators=right):
                found = among([left, *right], names)
            case ast.Dict(keys=keys):
                found = among(list(keys), field)
            case ast.Subscript(slice=key):
                found = among([key], field)
            case ast.BinOp(op=ast.BitAnd() | ast.BitOr() | ast.Sub(), left=left, right=right):
                found = among([left, right], field)
            case ast.Call(func=ast.Attribute(attr="get"), args=[ast.Constant(value=key), *_]):
                found = key in field
            case ast.MatchValue(value=ast.Constant(value=key)):
                found = key in names
        if found:
            lines.add(getattr(node, "lineno", 0) or node.value.lineno)  # type: ignore[attr-defined]
    return sorted(lines)


def comparisons(root: Path) -> list[str]:
    names = frozenset((*BASES, *ELSEWHERE))
    own = {f"{name}.py" for name in names}
    found = []
    for file in sorted([*(root / "hil").rglob("*.py"), *(root / "host_tools").rglob("*.py")]):
        home = file.parent.name in ("bases", "bodies") and file.name in own
        if not home and file.parent.name != "effects":  # an effect lists its bases: that is data
            lines = known_by_name(ast.parse(file.read_text()), names)
            found += [f"{file.relative_to(root)}:{line}" for line in lines]
    return found


def test_hardly_anything_compares_with_the_name_of_a_base() -> None:
    found = comparisons(paths.ROOT)
    assert len(found) <= MOST, found


PLANTED = (
    'if case.base.name == "rolling_steady":\n    pass',
    'steady = base.name in ("sphere_contact", "wheel_contact")',
    'free = "equation" != name',
    'step = {"vehicle": 1e-5}.get(name, 1e-6)',
    'start = STARTS["pendulum_sphere"]',
    'start = STARTS.get("cmr")',
    'soil = set(effect.bases) & {"wheel_contact"}',
    'match name:\n    case "driven_wheel":\n        pass',
)


@pytest.mark.parametrize("text", PLANTED)
def test_a_comparison_that_is_planted_is_found(tmp_path: Path, text: str) -> None:
    file = tmp_path / "host_tools" / "planted.py"
    file.parent.mkdir()
    file.write_text('order["equation"] = table.get("equation")\n')
    assert comparisons(tmp_path) == []
    file.write_text(text + "\n")
    assert len(comparisons(tmp_path)) == 1


def _package(folder: Path, base: str) -> dict[str, str]:
    """An installed package with the page's winch, and the environment in which it is found."""
    (entry,) = re.findall(r"```toml\n(\[project.entry-points.*?)```", PAGE, re.DOTALL)
    (points,) = tomllib.loads(entry)["project"]["entry-points"].items()
    package = folder / "site" / "my_bases"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "winch.py").write_text(base)
    information = folder / "site" / "my_bases-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: my_bases\nVersion: 1.0\n")
    lines = [f"[{points[0]}]", *(f"{name} = {value}" for name, value in points[1].items())]
    (information / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return {**os.environ, "PYTHONPATH": str(folder / "site")}


@pytest.mark.parametrize(
    ("base", "words"),
    [
        (WINCH, ""),
        ("BASE = 3\n", "found int, expected a base model"),
        ("import nothing_there\n", "ModuleNotFoundError: No module named 'nothing_there', expected a base model"),
        (WINCH.replace('name="winch"', 'name="cmr"'), "the name cmr is in use, expected another"),
    ],
)
def test_a_base_of_an_installed_package_is_found(base: str, words: str, tmp_path: Path) -> None:
    """Outside the tree, as the page says; what is none is told in one line that names the package."""
    environment = _package(tmp_path, base)
    lifted(tmp_path / "lifts.csv")

    def terrapin(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", "from terrapin_tools.cli import main; main()", *words]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    made = terrapin("case", "table", "lifts.csv", "--to", "lifts")
    if words:
        assert (made.returncode, made.stderr.count("\n")) == (2, 1), made.stderr
        assert "my_bases: terrapin.bases: winch = my_bases.winch:BASE: " in made.stderr
        assert words in made.stderr
        return
    assert "lifts/case.toml: winch, 10 runs" in made.stdout, made.stderr
    compared = terrapin("compare", "lifts", "--json", "compared.json")
    assert compared.returncode == 0, compared.stderr
    assert json.loads((tmp_path / "compared.json").read_text())["model"]["base"] == "winch"
