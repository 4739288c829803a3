"""The gate of `make check` is tested by planting violations: a gate that lets one through is no gate."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
GATE = ROOT / "tests" / "tools" / "gate.py"
PAGE = Path(sys.prefix) / "page" / "node_modules"

CLEAN_PYTHON = '''"""A module."""


def double(value: float) -> float:
    """Return twice the value."""
    return 2.0 * value
'''
CLEAN_H = """#ifndef CLEAN_H
#define CLEAN_H
#include <stdint.h>

int32_t terrapin_double(int32_t value);

#endif
"""
CLEAN_C = '#include "clean.h"\n\nint32_t terrapin_double(int32_t value) {\n    return value * 2;\n}\n'
SCRIPT = "host_tools/terrapin_tools/web/static/clean.js"
CLEAN_SCRIPT = """/** Twice a number. @param {number} value */
export function double(value) {
  const two = 2;
  return two * value;
}
"""
PLANTED = {
    "ruff-check": ("hil/terrapin_hil/clean.py", CLEAN_PYTHON.replace("\n\n\n", "\n\nimport os\n\n\n", 1)),
    "ruff-format": ("hil/terrapin_hil/clean.py", CLEAN_PYTHON.replace("2.0 * value", "2.0*value")),
    "mypy": ("hil/terrapin_hil/clean.py", CLEAN_PYTHON.replace("2.0 * value", "str(value)")),
    "clang-format": ("firmware/core/clean.c", CLEAN_C.replace("    return", "  return")),
    "clang-tidy": (
        "firmware/core/clean.c",
        CLEAN_C.replace("    return value * 2;", "    int32_t zero = 0;\n    return value / zero;"),
    ),
    "cppcheck": ("firmware/core/clean.c", CLEAN_C.replace("value * 2", "value * 02")),  # MISRA 7.1: octal
    "page-types": (SCRIPT, CLEAN_SCRIPT.replace("two * value", "two * value.length")),
    "page-lint": (SCRIPT, CLEAN_SCRIPT.replace("two * value", "2 * value")),  # an unused variable
}
IN_SCRIPTS = {  # what a reader of the page's scripts would trip over, and the step that finds it
    "an undefined name": ("page-types", CLEAN_SCRIPT.replace("two * value", "three * value")),
    "a misspelt method": ("page-types", CLEAN_SCRIPT.replace("two * value", "value.toFixd(2)")),
    "a parameter without a type": ("page-types", CLEAN_SCRIPT.replace(" @param {number} value", "")),
    "an undefined name, for the linter": ("page-lint", CLEAN_SCRIPT.replace("two * value", "three * two * value")),
    "a function that nobody can overlook": (
        "page-lint",
        CLEAN_SCRIPT.replace("  const two = 2;\n", "  let two = 2;\n" + "  two += 1;\n" * 78),
    ),
}


def unit(name: str, calls: str = "") -> str:
    """A C unit that defines one function, which calls one of another unit."""
    words = [f"int {word}(int v);" for word in (name, calls) if word]
    return "\n".join([*words, f"int {name}(int v) {{", f"    return {calls}(v);", "}", ""])


# Two ports define one() each, one of them takes half() from an archive; a test has a stand-in for below() that calls
# back into the core.
SOURCES = {
    "CMakeLists.txt": """
cmake_minimum_required(VERSION 3.22)
project(clean LANGUAGES C)
file(GLOB CORE firmware/core/*.c)
file(GLOB ONE firmware/ports/one/*.c)
add_library(core_objects OBJECT ${CORE})
add_library(store STATIC firmware/store/half.c)
add_executable(one ${ONE} $<TARGET_OBJECTS:core_objects>)
target_link_libraries(one PRIVATE store)
add_executable(two firmware/ports/two/one.c firmware/ports/two/main.c)
add_executable(test_one tests/firmware/test_one.c tests/firmware/main.c $<TARGET_OBJECTS:core_objects>)
""",
    "firmware/core/step.c": unit("step", "below"),
    "firmware/store/half.c": unit("half"),
    "firmware/ports/one/below.c": unit("below", "half"),
    "firmware/ports/one/one.c": unit("one"),
    "firmware/ports/one/main.c": "int step(int v);\nint one(int v);\nint main(void) { return step(one(0)); }\n",
    "firmware/ports/two/one.c": unit("one"),
    "firmware/ports/two/main.c": unit("one").splitlines()[0] + "\nint main(void) { return one(0); }\n",
    "tests/firmware/test_one.c": unit("below", "step"),
    "tests/firmware/main.c": "int step(int v);\nint main(void) { return step(0); }\n",
}
# Files of a violation, and the finding.
ROOMS = {
    "import upward": (
        {
            "hil/terrapin_hil/run/run.py": "",
            "hil/terrapin_hil/robot/plant.py": "def f():\n    from terrapin_hil.run import run\n",
        },
        "hil/terrapin_hil/robot/plant.py:2: terrapin_hil.robot imports terrapin_hil.run.run, which stands above it",
    ),
    "circle of modules": (
        {
            "hil/terrapin_hil/robot/a.py": "import terrapin_hil.robot.b\n",
            "hil/terrapin_hil/robot/b.py": "from terrapin_hil.robot import c\n",
            "hil/terrapin_hil/robot/c.py": "from terrapin_hil.robot.a import x\n",
        },
        "circle of modules: terrapin_hil.robot.a, terrapin_hil.robot.b, terrapin_hil.robot.c",
    ),
    "circle of rooms": (
        {
            "host_tools/terrapin_tools/param/a.py": "import terrapin_tools.soil.b\n",
            "host_tools/terrapin_tools/param/c.py": "",
            "host_tools/terrapin_tools/soil/b.py": "",
            "host_tools/terrapin_tools/soil/d.py": "import terrapin_tools.param.c\n",
        },
        "circle of rooms: terrapin_tools.param, terrapin_tools.soil",
    ),
    "16 modules in a folder": (
        {f"host_tools/terrapin_tools/soil/m{i}.py": "" for i in range(16)},
        "host_tools/terrapin_tools/soil: 16 modules, expected at most 15",
    ),
    "16 scripts in a folder": (
        {f"host_tools/terrapin_tools/web/s{i}.js": "" for i in range(16)},
        "host_tools/terrapin_tools/web: 16 scripts, expected at most 15",
    ),
    "circle of C units": (
        {"firmware/core/slip.c": unit("slip", "step"), "firmware/core/step.c": unit("step", "slip")},
        "circle of C units: firmware/core/slip.c, firmware/core/step.c",
    ),
    "circle of a port with the core": (
        {"firmware/ports/one/below.c": unit("below", "step")},
        "circle of C units: firmware/core/step.c, firmware/ports/one/below.c",
    ),
    "circle through an archive, beside a unit of the same name": (
        {"firmware/store/half.c": unit("half", "one"), "firmware/ports/one/one.c": unit("one", "half")},
        "circle of C units: firmware/ports/one/one.c, firmware/store/half.c",
    ),
}
HYGIENE = {
    "no newline at the end": ("docs/a.md", "text"),
    "white space at the end": ("docs/a.md", "text \n"),
    "unfinished business": ("docs/a.md", "TO" + "DO: write\n"),
    "path of one machine": ("docs/a.md", "see /ho" + "me/somebody/notes\n"),
    "address of a package index": ("docs/a.lock", "--index" + "-url https://example.org/simple\n"),
    "top level": ("notes/a.md", "text\n"),
    "generated file": ("docs/terrapin.dbc", "text\n"),
    "conflict marker": ("docs/a.md", "<" * 7 + " ours\n"),
}


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A small repository with this one's settings and nothing to complain of."""
    page = ("tests/tools/page/tsconfig.json", "tests/tools/page/oxlintrc.json")
    for name in ("pyproject.toml", ".clang-format", ".clang-tidy", "firmware/misra-disapplied.txt", *page):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    for package in ("hil/terrapin_hil", "host_tools/terrapin_tools", "firmware/terrapin_interface"):
        (tmp_path / package).mkdir(parents=True, exist_ok=True)
        (tmp_path / package / "__init__.py").write_text("")
    (tmp_path / ".gitignore").write_text("/build/\n.*_cache/\n")
    (tmp_path / "hil/terrapin_hil/clean.py").write_text(CLEAN_PYTHON)
    (tmp_path / SCRIPT).parent.mkdir(parents=True)
    (tmp_path / SCRIPT).write_text(CLEAN_SCRIPT)
    source = tmp_path / "firmware/core/clean.c"
    source.parent.mkdir()
    source.write_text(CLEAN_C)
    source.with_suffix(".h").write_text(CLEAN_H)
    database = tmp_path / "build/host/compile_commands.json"
    database.parent.mkdir(parents=True)
    command = f"cc -std=c11 -c {source}"
    database.write_text(json.dumps([{"directory": str(tmp_path), "command": command, "file": str(source)}]))
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    return tmp_path


@pytest.fixture
def built(project: Path) -> Path:
    """The same with programs of C."""
    (project / "firmware/core/clean.c").unlink()
    write(project, SOURCES)
    return project


def write(project: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (project / name).parent.mkdir(parents=True, exist_ok=True)
        (project / name).write_text(text)


def build(project: Path) -> None:
    for command in (["cmake", "-G", "Ninja", "-B", "build/host", "."], ["cmake", "--build", "build/host"]):
        subprocess.run(command, cwd=project, check=True, capture_output=True, timeout=120)


def gate(project: Path, *steps: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(GATE), "--root", str(project), *steps]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)


def test_clean_project_passes(project: Path) -> None:
    done = gate(project, *PLANTED, "hygiene")
    assert done.returncode == 0, done.stdout
    assert "0 failed" in done.stdout


@pytest.mark.parametrize("step", PLANTED)
def test_planted_violation_fails(project: Path, step: str) -> None:
    if step == "cppcheck" and shutil.which("cppcheck") is None:
        pytest.skip("cppcheck not installed")
    if step.startswith("page-") and not PAGE.is_dir():
        pytest.skip("type checker and linter of the page's scripts not installed")
    name, text = PLANTED[step]
    assert text not in (CLEAN_PYTHON, CLEAN_C, CLEAN_SCRIPT)
    (project / name).write_text(text)
    done = gate(project, step)
    assert done.returncode == 1, done.stdout
    assert f"failed: {step}" in done.stdout
    assert Path(name).name in done.stdout  # the finding names its file


def test_rooms_in_order_pass(built: Path) -> None:
    build(built)
    done = gate(built, "rooms")
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("violation", ROOMS)
def test_planted_disorder_fails(built: Path, violation: str) -> None:
    files, finding = ROOMS[violation]
    write(built, files)
    build(built)
    done = gate(built, "rooms")
    assert done.returncode == 1, done.stdout
    assert finding in done.stdout


def test_rooms_want_a_finished_build(project: Path) -> None:
    done = gate(project, "rooms")
    assert done.returncode == 1, done.stdout
    assert "build/host: no build.ninja" in done.stdout


@pytest.mark.skipif(not PAGE.is_dir(), reason="type checker and linter of the page's scripts not installed")
@pytest.mark.parametrize("finding", IN_SCRIPTS)
def test_planted_mistake_in_a_script_fails(project: Path, finding: str) -> None:
    step, text = IN_SCRIPTS[finding]
    assert text != CLEAN_SCRIPT
    (project / SCRIPT).write_text(text)
    done = gate(project, step)
    assert done.returncode == 1, done.stdout
    assert f"failed: {step}" in done.stdout
    assert "clean.js" in done.stdout


@pytest.mark.parametrize("name", ["hil.terrapin_hil", "host_tools.terrapin_tools", "firmware.terrapin_interface"])
def test_a_package_has_one_name(project: Path, name: str) -> None:
    """From the tree's root a package could also be imported through its folder, as a second copy."""
    (project / "hil/terrapin_hil/clean.py").write_text(f"import {name}\n\nprint({name})\n")
    done = gate(project, "ruff-check")
    assert done.returncode == 1
    assert f"TID251 `{name.split('.')[0]}` is banned: import {name.split('.')[1]}" in done.stdout


@pytest.mark.parametrize("finding", HYGIENE)
def test_planted_untidiness_fails(project: Path, finding: str) -> None:
    name, text = HYGIENE[finding]
    (project / name).parent.mkdir(exist_ok=True)
    (project / name).write_text(text)
    done = gate(project, "hygiene")
    assert done.returncode == 1, done.stdout
    assert finding in done.stdout


def test_misra_deviation_stands_in_the_code_with_its_reason(project: Path) -> None:
    if shutil.which("cppcheck") is None:
        pytest.skip("cppcheck not installed")
    deviation = "    // cppcheck-suppress misra-c2012-7.1 ; the protocol writes it so\n    return value * 02;"
    (project / "firmware/core/clean.c").write_text(CLEAN_C.replace("    return value * 2;", deviation))
    assert gate(project, "cppcheck").returncode == 0
