"""The gate of `make check` is tested by planting violations: a gate that lets one through is no gate."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
GATE = ROOT / "tests" / "tools" / "gate.py"

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
PLANTED = {
    "ruff-check": ("hil/clean.py", CLEAN_PYTHON.replace("\n\n\n", "\n\nimport os\n\n\n", 1)),
    "ruff-format": ("hil/clean.py", CLEAN_PYTHON.replace("2.0 * value", "2.0*value")),
    "mypy": ("hil/clean.py", CLEAN_PYTHON.replace("2.0 * value", "str(value)")),
    "clang-format": ("firmware/core/clean.c", CLEAN_C.replace("    return", "  return")),
    "clang-tidy": (
        "firmware/core/clean.c",
        CLEAN_C.replace("    return value * 2;", "    int32_t zero = 0;\n    return value / zero;"),
    ),
    "cppcheck": ("firmware/core/clean.c", CLEAN_C.replace("value * 2", "value * 02")),  # MISRA 7.1: octal
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
    for name in ("pyproject.toml", ".clang-format", ".clang-tidy", "firmware/misra-disapplied.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    for package in ("hil", "host_tools", "firmware", "firmware/interface"):
        (tmp_path / package).mkdir(exist_ok=True)
        (tmp_path / package / "__init__.py").write_text("")
    (tmp_path / ".gitignore").write_text("/build/\n.*_cache/\n")
    (tmp_path / "hil/clean.py").write_text(CLEAN_PYTHON)
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


def gate(project: Path, *steps: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(GATE), "--root", str(project), *steps]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


def test_clean_project_passes(project: Path) -> None:
    done = gate(project, *PLANTED, "hygiene")
    assert done.returncode == 0, done.stdout
    assert "0 failed" in done.stdout


@pytest.mark.parametrize("step", PLANTED)
def test_planted_violation_fails(project: Path, step: str) -> None:
    if step == "cppcheck" and shutil.which("cppcheck") is None:
        pytest.skip("cppcheck not installed")
    name, text = PLANTED[step]
    assert text not in (CLEAN_PYTHON, CLEAN_C)
    (project / name).write_text(text)
    done = gate(project, step)
    assert done.returncode == 1, done.stdout
    assert f"failed: {step}" in done.stdout
    assert Path(name).name in done.stdout  # the finding names its file


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
