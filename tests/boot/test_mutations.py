"""10,000 mutated images, all refused; the same under the sanitizers where that build is there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import campaign
import pytest
from bootlib import Chip, send
from kit import PUBLIC, image

from terrapin_hil import paths


def test_the_image_that_is_mutated_is_good() -> None:
    chip = Chip(PUBLIC)
    chip.put("a", image("a", "1.1.0", counter=2))
    assert chip.start() == "a"
    assert chip.confirm()
    assert send(chip, campaign.GOOD, "b") == "ok"
    assert chip.start() == "b"


def test_ten_thousand_mutants() -> None:
    kinds, reasons, taken = campaign.campaign(10_000)
    assert taken == []
    assert kinds.total() == 10_000
    assert min(kinds.values()) >= 900  # every kind had its share
    assert len(kinds) == 9
    assert set(reasons) >= {
        "not_an_image", "corrupted", "bad_signature", "wrong_key", "wrong_slot", "version_too_old", "counter_too_low",
        "too_large",
    }  # fmt: skip


def test_mutants_under_the_sanitizers() -> None:
    library = paths.ROOT / "build" / "asan" / "libterrapin_boot.so"
    if not library.is_file():
        pytest.skip("build/asan is not built (make test-all builds it)")
    runtime = subprocess.run(["cc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=True)
    environment = {
        **os.environ, "BOOT_LIBRARY": str(library), "LD_PRELOAD": runtime.stdout.strip(),
        "ASAN_OPTIONS": "detect_leaks=0", "UBSAN_OPTIONS": "halt_on_error=1",
    }  # fmt: skip
    script = Path(__file__).with_name("campaign.py")
    done = subprocess.run(
        [sys.executable, str(script), "--cases", "450", "--seed", "2"],
        env=environment, cwd=paths.ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-500:] + done.stderr[-2000:]
    assert re.search(r"^450 mutated images", done.stdout)
