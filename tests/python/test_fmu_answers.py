"""What an FMU's status means, without an FMU (test_fmu.py has some, which are compiled)."""

from __future__ import annotations

from pathlib import Path

import pytest

from terrapin_hil.fmi.unit import Unit
from terrapin_tools.errors import UserError


@pytest.mark.parametrize(
    ("status", "words", "failed", "freed"),
    [(2, "discard", False, True), (3, "error", True, True), (4, "fatal error", True, False)],
)
def test_from_discard_on_a_status_is_an_error(status: int, words: str, failed: bool, freed: bool) -> None:
    """After an error an FMU may only be freed, after a fatal one not even that (FMI 3.0, 2.2.3)."""
    unit = Unit.__new__(Unit)
    unit.path, unit.instance, unit._said, unit.failed = Path("a.fmu"), object(), "out of range", False
    for well in (0, 1):
        unit.require(well, "step")
    with pytest.raises(UserError, match=f"^a.fmu: {words} at step: out of range$"):
        unit.require(status, "step")
    assert (unit.failed, unit.instance is not None) == (failed, freed)
