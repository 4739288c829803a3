"""Chaskey-12 of the firmware against that of the tools: the published vector, and ten thousand random blocks."""

from __future__ import annotations

import random
import struct
import subprocess

import pytest

from terrapin_hil import paths
from terrapin_hil.links.seal import chaskey

PROGRAM = paths.build() / "test_link_seal_blackbox"
KEY = struct.pack("<4I", 0x833D3433, 0x009F389F, 0x2398E64F, 0x417ACF39)


def test_the_published_vector() -> None:
    """Nicky Mouha, chaskey12.c: the message of bytes 0 to 15."""
    assert chaskey(KEY, bytes(range(16))) == struct.pack("<4I", 0x5DD0E2A9, 0xFB5EAC8C, 0x633A392E, 0x500C36F3)


@pytest.mark.skipif(not PROGRAM.is_file(), reason="the C tests are not built (no Unity)")
def test_ten_thousand_random_blocks() -> None:
    blocks = random.Random(1).randbytes(32 * 10_000)
    done = subprocess.run([PROGRAM, "--tags"], input=blocks, check=True, capture_output=True, timeout=60)
    expected = b"".join(chaskey(blocks[i : i + 16], blocks[i + 16 : i + 32]) for i in range(0, len(blocks), 32))
    assert done.stdout == expected
