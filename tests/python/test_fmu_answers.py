"""What is no FMU, and what the status of one means, without one (test_fmu.py has some, which are compiled)."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from terrapin_hil.fmi.plant import FmuPlant
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


@pytest.mark.parametrize(
    ("xml", "reason"),
    [
        ("<a", "modelDescription.xml: "),
        ('<fmiModelDescription fmiVersion="2.0"/>', "found FMI 2.0, expected FMI 3.0"),
        ('<fmiModelDescription fmiVersion="3.0"/>', "found an FMU without co-simulation"),
        (
            '<fmiModelDescription fmiVersion="3.0"><CoSimulation modelIdentifier="m"/><ModelVariables>'
            '<Int32 name="voltage" causality="input" valueReference="1"/>'
            '<Float64 name="omega" causality="output" valueReference="2"/>'
            '<Float64 name="speed" causality="output" valueReference="3"/>'
            '<Float64 name="current" causality="output" valueReference="4"/>'
            "</ModelVariables></fmiModelDescription>",
            "voltage is Int32, expected Float64",
        ),
        (
            '<fmiModelDescription fmiVersion="3.0"><CoSimulation modelIdentifier="m" fixedInternalStepSize="0.0003"/>'
            '<ModelVariables><Float64 name="voltage" causality="input" valueReference="1"/>'
            '<Float64 name="omega" causality="output" valueReference="2"/>'
            '<Float64 name="speed" causality="output" valueReference="3"/>'
            '<Float64 name="current" causality="output" valueReference="4"/>'
            "</ModelVariables></fmiModelDescription>",
            "its steps are 0.0003 s, expected 1 ms",
        ),
    ],
)
def test_what_is_none_is_refused(tmp_path: Path, xml: str, reason: str) -> None:
    file = tmp_path / "bad.fmu"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("modelDescription.xml", xml)
    with pytest.raises(UserError, match=r"bad\.fmu") as refused:
        FmuPlant(file)
    assert reason in str(refused.value)
    assert "\n" not in str(refused.value)


def test_an_archive_that_writes_elsewhere_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "bad.fmu"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("../outside", "x")
    with pytest.raises(UserError, match="expected places within the archive"):
        FmuPlant(file)
    file.write_text("no archive")
    with pytest.raises(UserError, match="no archive that can be read"):
        FmuPlant(file)
