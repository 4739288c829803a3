"""The Linux controller against the real kernel's CAN and GPIO, in the sandbox (sandbox.py, kernel.sh).

Each file of inside/ runs once, in a kernel of its own; its tests are shown here one by one.
"""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from functools import cache
from pathlib import Path

import pytest
from sandbox import HERE, Done, kernel, run_inside

from terrapin_hil import paths

PROGRAM = paths.build() / "terrapin-controller"
PYTHON = sys.executable


def reason() -> str:
    """Why nothing of this can run here, or nothing."""
    if kernel()[0] is None:
        return kernel()[1]
    if not PROGRAM.is_file():
        return "terrapin-controller is not built"
    if shutil.which("ip") is None:
        return "ip (iproute2) is not installed"
    done = subprocess.run([PROGRAM, "--version"], capture_output=True, text=True, check=False)
    return "" if "interface" in done.stdout else "terrapin-controller is not that of Linux"


if reason():
    pytest.skip(reason(), allow_module_level=True)


def functions(name: str) -> list[str]:
    """Tests in a file of inside/, which is not imported here."""
    tree = ast.parse((HERE / "inside" / f"{name}.py").read_text())
    return [node.name for node in tree.body if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")]


@cache
def outcome(name: str) -> tuple[dict[str, list[ElementTree.Element]], str]:
    """Function -> its cases in the report of that file's run; and what the run said."""
    command = [PYTHON, "-m", "pytest", "-q", "-s", "-p", "no:cacheprovider", "-c", "/dev/null", "--rootdir"]
    command += [str(HERE / "inside"), f"--junitxml={{job}}/{name}.xml", str(HERE / "inside" / f"{name}.py")]
    done = run_inside(["sh", "-c", " ".join(command).format(job="$JOB")], limit=900)
    cases: dict[str, list[ElementTree.Element]] = {}
    if f"{name}.xml" in done.files:
        for case in ElementTree.fromstring(done.files[f"{name}.xml"]).iter("testcase"):
            cases.setdefault(str(case.get("name")).partition("[")[0], []).append(case)
    print(f"{name}: {done.seconds:.1f} s in the sandbox")
    return cases, done.output


@pytest.mark.parametrize(
    ("name", "function"), [(name, function) for name in ("bus", "lines", "hung") for function in functions(name)]
)
def test_inside(name: str, function: str) -> None:
    cases, output = outcome(name)
    assert function in cases, f"it did not run:\n{output[-4000:]}"
    skipped = [case.find("skipped") for case in cases[function]]
    for case in cases[function]:
        for kind in ("failure", "error"):
            if (found := case.find(kind)) is not None:
                pytest.fail(f"{case.get('name')}:\n{found.text}", pytrace=False)
    for said in re.findall(r"^.*(?:ticks/s|e-stop.s edge|slowest of|hung \().*$", output, re.MULTILINE):
        print(said)
    if all(skip is not None for skip in skipped):
        pytest.skip(str(skipped[0].get("message") if skipped[0] is not None else ""))


@pytest.mark.parametrize("what", ["stepping", "lockstep"])
def test_virtual_time_repeats_to_the_bit(what: str) -> None:
    """Two runs in kernels of their own: the same ticks at the same instants, the same candump log byte for byte."""
    program = str(HERE / "inside" / "virtual.py")
    first, second = (run_inside([PYTHON, program, what], virtual_time=True, limit=120) for _ in range(2))
    assert first.status == second.status == 0, first.output + second.output
    assert first.output == second.output
    if what == "lockstep":
        assert first.output.startswith("hash True ")
    else:
        assert re.search(r"^ticks \d{5} missed \d$", first.output, re.MULTILINE)  # some while it starts
        if "candump" in first.output:
            assert "gaps after the first 100 ms: 0\n" in first.output
    print(first.output)


def test_status_and_files_come_back() -> None:
    """The sandbox itself: exit status, output, files, the host's files not to be written."""
    done: Done = run_inside(["sh", "-c", "echo hello; echo kept >$JOB/file; touch /etc/nope; exit 7"], limit=60)
    assert (done.status, done.files["file"]) == (7, b"kept\n")
    assert done.output.startswith("hello\n")
    assert "Read-only file system" in done.output
    assert not Path("/etc/nope").exists()
