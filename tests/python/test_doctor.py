"""`terrapin doctor` says what is there and what is not, and the command that mends it; it changes nothing."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from terrapin_tools import doctor

COMMAND = [sys.executable, "-c", "from terrapin_tools.cli import main; main()", "doctor"]


def asked(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *words], env={**os.environ, **environment}, capture_output=True, text=True, check=False, timeout=120
    )


def test_it_finds_what_this_machine_has() -> None:
    done = asked("--json", "-")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    found = {one["name"]: one for one in answer["found"]}
    assert tuple(found) == doctor.NAMES
    assert found["build"]["there"]
    for name, program in (("arm", "arm-none-eabi-gcc"), ("qemu", "qemu-system-arm"), ("can-utils", "candump")):
        assert found[name]["there"] == (shutil.which(program) is not None)
    for one in found.values():
        assert one["found"]
        assert bool(one["mend"]) != one["there"], one


def test_without_anything_on_path_it_names_what_mends_it(tmp_path: Path) -> None:
    done = asked("--json", "-", PATH=str(tmp_path))
    found = {one["name"]: one for one in json.loads(done.stdout)["found"]}
    mends = {"compiler": "gcc libc6-dev", "cmake": "pip install cmake ninja", "arm": "gcc-arm-none-eabi",
             "qemu": "qemu-system-arm", "browser": "chromium", "can-utils": "can-utils"}  # fmt: skip
    for name, mend in mends.items():
        assert not found[name]["there"]
        assert mend in found[name]["mend"]


def test_a_tree_that_is_not_built_is_no_healthy_one(tmp_path: Path) -> None:
    done = asked(TERRAPIN_BUILD=str(tmp_path))
    assert done.returncode == 1
    assert "libterrapin.so, libterrapin_hil.so, terrapin.dbc not built; mend: make setup" in done.stdout
    assert done.stdout.rstrip().endswith("needed and not there: build")


def test_what_is_needed_decides_the_status(tmp_path: Path) -> None:
    assert asked("--need", "qemu", PATH=str(tmp_path)).returncode == 1
    assert asked("--need", "build", PATH=str(tmp_path)).returncode == 0
    done = asked("--need", "luck")
    assert done.returncode == 2
    assert done.stderr.startswith("terrapin: --need: found 'luck', expected one of build, compiler")


def test_a_compiler_without_its_library_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake = tmp_path / "cc"
    fake.write_text("#!/bin/sh\necho 'fatal error: math.h: No such file or directory' >&2\nexit 1\n")
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    there, found, mend = doctor._compiler()
    assert (there, found) == (False, "fatal error: math.h: No such file or directory")
    assert "libc6-dev" in mend


def test_a_program_that_hangs_costs_its_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake = tmp_path / "qemu-system-arm"
    fake.write_text("#!/bin/sh\nexec /bin/sleep 30\n")
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(doctor, "LIMIT", 0.3)
    began = time.monotonic()
    there, found, _ = doctor._program("qemu-system-arm", "qemu-system-arm")
    assert not there
    assert "timed out" in found
    assert time.monotonic() - began < 10.0


def test_ports_that_this_user_may_not_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    port = tmp_path / "ttyUSB0"
    port.touch()
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    there, found, mend = doctor._devices((str(tmp_path / "ttyUSB*"),), "serial adapter", "dialout", "plug one in")
    assert not there
    assert found == f"{port}: not for this user"
    assert "usermod -aG dialout" in mend
