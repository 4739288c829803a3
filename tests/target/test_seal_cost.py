"""What the seal costs on a Cortex-M4: an upper bound of its instructions, from the object code, and its bytes."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from terrapin_hil import paths

OBJECTS = paths.ROOT / "build" / "cortex-m4" / "CMakeFiles" / "link_objects.dir" / "firmware" / "link"
PARTS = [OBJECTS / "seal.c.obj", OBJECTS / "chaskey.c.obj"]

pytestmark = [
    pytest.mark.skipif(shutil.which("arm-none-eabi-ld") is None, reason="no ARM cross compiler"),
    pytest.mark.skipif(not PARTS[0].is_file(), reason="the ARM images are not built (no ARM cross compiler)"),
]


def bound(function: str, image: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> int:
    """Instructions that the function can take at most, with what it calls (firmware/cmake/path_report.py)."""
    monkeypatch.syspath_prepend(str(paths.ROOT / "firmware" / "cmake"))
    import path_report

    monkeypatch.setattr(path_report, "LOOPS", {"terrapin_chaskey": (12,)})  # ROUNDS
    monkeypatch.setattr(sys, "argv", ["path_report.py", "--objdump", "arm-none-eabi-objdump", str(image), function])
    assert path_report.main() == 0
    found = re.search(r"(\d+) instructions at most", capsys.readouterr().out)
    assert found is not None
    return int(found[1])


def test_instructions_a_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Decoding and taking over a command come on top: some 60."""
    image = tmp_path / "seal.elf"
    link = ["arm-none-eabi-ld", "-e", "terrapin_seal_check", "-o", str(image), *map(str, PARTS)]
    subprocess.run(link, check=True, capture_output=True)
    assert bound("terrapin_chaskey", image, monkeypatch, capsys) <= 200
    assert bound("terrapin_seal_check", image, monkeypatch, capsys) <= 520  # with two sessions to look at
    assert bound("terrapin_seal_open", image, monkeypatch, capsys) <= 300


def test_bytes_of_code() -> None:
    done = subprocess.run(["arm-none-eabi-size", *map(str, PARTS)], check=True, capture_output=True, text=True)
    text = sum(int(line.split()[0]) for line in done.stdout.splitlines()[1:])
    assert 300 < text <= 800
