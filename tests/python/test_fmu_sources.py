"""An FMU's sources are whole: no compiler, no FMPy, and so in every run of the tests."""

from __future__ import annotations

import re

import pytest

from terrapin_hil.fmi.export import _sources

MADE = {"model.h", "model.inc", "limits.inc"}  # written beside them


@pytest.mark.parametrize("kind", ["plant", "both"])  # a controller's has what it does not include as well
def test_every_header_that_is_included_is_there(kind: str) -> None:
    sources = _sources(kind)  # type: ignore[arg-type]
    there = {place.rsplit("/", 1)[-1] for place in sources} | MADE
    wanted = {
        name: place
        for place, path in sources.items()
        for name in re.findall(r'^#include "([^"]+)"', path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert len(wanted) > 10
    assert {name: place for name, place in wanted.items() if name not in there} == {}
