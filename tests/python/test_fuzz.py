"""The fuzz targets can find something: one planted bug each, in a copy of the sources."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from terrapin_hil import paths
from terrapin_hil.paths import ROOT

sys.path.insert(0, str(ROOT / "tests" / "tools"))

import fuzz

CORPUS = ROOT / "tests" / "firmware" / "fuzz" / "corpus"
MUTATIONS = 10_000
BUGS = {
    "slcan": ("link/slcan.c", "parser->length < TERRAPIN_SLCAN_LINE_MAX", "parser->length <= TERRAPIN_SLCAN_LINE_MAX"),
    "can": ("link/dispatch.c", "if (link->test_mode) {", "if (true) {"),
    "intake": (
        "link/intake.c", "(intake->first + intake->count) % TERRAPIN_INTAKE_SIZE", "intake->first + intake->count",
    ),
    "step": ("core/supervisor.c", "causes |= fault_bit(TERRAPIN_FAULT_ESTOP);", ""),
    "readers": ("boot/records.c", "(record->confirmed <= (uint8_t)TERRAPIN_UPDATE_SLOT_B) &&\n           (", "("),
    "update": ("boot/update.c", " || (size != expected)", ""),
}  # fmt: skip


def test_every_target_has_inputs_and_a_planted_bug() -> None:
    assert set(BUGS) == set(fuzz.PARSERS) == {path.name for path in CORPUS.iterdir() if path.is_dir()}
    assert set(BUGS) == {p.stem.removeprefix("fuzz_") for p in (ROOT / "tests/firmware/fuzz").glob("fuzz_*.c")}


@pytest.mark.parametrize("target", BUGS)
def test_a_planted_bug_is_found(target: str, tmp_path: Path) -> None:
    name, good, bad = BUGS[target]
    source = (ROOT / "firmware" / name).read_text(encoding="utf-8")
    assert good in source, f"{name} no longer has {good!r}: plant another bug"
    for planted, text in ((True, source.replace(good, bad)), (False, source)):
        (tmp_path / Path(name).name).write_text(text, encoding="utf-8")
        done = build_and_run(target, ROOT / "firmware" / name, tmp_path / Path(name).name, tmp_path / "target")
        assert (done.returncode != 0) == planted, done.stderr[-500:]


def build_and_run(target: str, original: Path, copy: Path, program: Path) -> subprocess.CompletedProcess[str]:
    """The target with `copy` in place of `original`, over its corpus and mutations of it."""
    generated = paths.build() / "generated"
    parts = [p for part in ("core", "link", "boot") for p in sorted((ROOT / "firmware" / part).glob("*.c"))]
    parts += [ROOT / "firmware/store/parameters.c", ROOT / "firmware/store/crc32.c", generated / "terrapin_interface.c"]
    parts += [] if target == "can" else [ROOT / "firmware/store/flash_emulated.c"]  # which includes it
    include = [f"-I{ROOT / 'firmware' / part}" for part in ("core", "link", "store", "boot")]
    fuzz_dir = ROOT / "tests" / "firmware" / "fuzz"
    subprocess.run(
        ["cc", "-std=c11", "-O1", "-w", "-DTERRAPIN_ASSERTIONS", "-fsanitize=address,undefined",
         "-fno-sanitize-recover=all", f"-I{original.parent}", *include, f"-I{generated}",
         str(fuzz_dir / f"fuzz_{target}.c"), str(fuzz_dir / "driver.c"),
         *(str(copy if p == original else p) for p in parts), "-o", str(program)],
        check=True, timeout=600,
    )  # fmt: skip
    mutations = str(MUTATIONS if target != "step" else MUTATIONS // 200)  # an input of it is 16,384 ticks
    return subprocess.run(
        [str(program), mutations, str(CORPUS / target)], env={**os.environ, "ASAN_OPTIONS": "detect_leaks=0"},
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
