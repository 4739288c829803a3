"""Files that are flipped, cut and mixed, at each reader of a binary format: as damage.py, so many of each."""

from __future__ import annotations

from tests.attack import Result
from tests.attack.damage import READERS, told, tried
from tests.attack.forked import counted

COUNT, SHORT = 400, 1  # of each reader
TEXTS = (".log", ".asc")
EACH = tuple(
    reader for reader in READERS if not reader.text and not (reader.file.endswith(TEXTS) or "convert" in reader.command)
)


def attack(count: int, seed: int) -> Result:
    """`count` damaged files of each binary reader: no traceback, one line, at most 1 GB and 10 s of the processor."""
    name = "damaged files of each binary reader"
    return counted(name, told(tried(count * len(EACH), seed, EACH), seed))
