"""The fuzz targets can find something: one planted bug each, in a copy of the sources."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from terrapin_hil.paths import ROOT

sys.path.insert(0, str(ROOT / "tests" / "tools"))

import fuzz

MUTATIONS = 10_000


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What all targets have in common is compiled once."""
    return tmp_path_factory.mktemp("objects")


def test_every_target_has_inputs_and_a_planted_bug() -> None:
    assert set(fuzz.TARGETS) == {path.name for path in fuzz.CORPUS.iterdir() if path.is_dir()}
    assert set(fuzz.TARGETS) == {p.stem.removeprefix("fuzz_") for p in (ROOT / "tests/firmware/fuzz").glob("fuzz_*.c")}


@pytest.mark.parametrize("target", fuzz.TARGETS)
@pytest.mark.parametrize("planted", [True, False])
def test_a_planted_bug_is_found(target: str, planted: bool, tmp_path: Path, objects: Path) -> None:
    """By the corpus and mutations of it, without libFuzzer; `fuzz.py --planted` searches as `make fuzz` does."""
    program = tmp_path / "target"
    sanitizers = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    fuzz.build(target, tmp_path, program, *sanitizers, planted=planted, compiler="cc", driver=True, objects=objects)
    mutations = str(MUTATIONS if target != "step" else MUTATIONS // 200)  # an input of it is 16,384 ticks
    done = subprocess.run(
        [str(program), mutations, str(fuzz.CORPUS / target)], env={**os.environ, "ASAN_OPTIONS": "detect_leaks=0"},
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    assert (done.returncode != 0) == planted, done.stderr[-500:]
