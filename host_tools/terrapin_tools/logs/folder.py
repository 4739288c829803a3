"""The folder of a run: telemetry.log, truth.csv, run.toml, terrapin.dbc.

It is whole at any moment: the log is flushed as the run goes on, and run.toml says whether the run came to its end.
"""

from __future__ import annotations

import fcntl
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import numpy.typing as npt
import tomlkit

from terrapin_hil import paths
from terrapin_hil.messages import Interface
from terrapin_hil.robot.truth import TRUTH
from terrapin_hil.run.run import Result
from terrapin_hil.scenario.scenario import Scenario
from terrapin_tools.errors import UserError
from terrapin_tools.logs.candump import lines
from terrapin_tools.logs.frames import writing

__all__ = ["RunFolder"]

TRUTH_EVERY = 10  # ticks between rows of truth.csv


class RunFolder:
    """Writes the folder while a run goes on; an Observer of a run. UserError (status 1) when it cannot write."""

    def __init__(
        self, folder: Path, scenario: Scenario, link: str, parameters: Mapping[str, float], interface: Interface
    ) -> None:
        self.folder = folder
        self._ticks = 0
        self._scenario = scenario
        self._link = link
        self._parameters = _all_parameters(interface, {**scenario.firmware, **parameters})
        with writing(folder):
            if folder.exists() and not folder.is_dir():
                words = "found a file, expected a folder, or a name that is free"
                raise UserError(f"{folder}: cannot write the log: {words}", status=1)
            folder.mkdir(parents=True, exist_ok=True)
            self._log: TextIO = (folder / "telemetry.log").open("a", encoding="ascii")
            self._take()
            self._truth: TextIO = (folder / "truth.csv").open("w", encoding="ascii")
            self._truth.write(",".join(TRUTH) + "\n")
            shutil.copyfile(paths.dbc(), folder / "terrapin.dbc")
            self._describe({"complete": False})

    def _take(self) -> None:
        """Empties the log for this run. UserError when another run is writing it."""
        try:
            fcntl.flock(self._log, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(f"{self.folder}: another run is writing its log here", status=1) from None
        if (self.folder / "telemetry.log").is_file():  # not a device
            self._log.truncate(0)

    def write(self, records: npt.NDArray[Any]) -> None:
        """Appends rows of the log."""
        with writing(self.folder):
            self._log.write(lines(records, self._ticks))
            self._log.flush()
            first = -self._ticks % TRUTH_EVERY
            np.savetxt(self._truth, records["truth"][first::TRUTH_EVERY], fmt="%.9g", delimiter=",")
            self._truth.flush()
        self._ticks += len(records)

    def finish(self, result: Result) -> None:
        """Writes what came out of the run."""
        with writing(self.folder):
            self._describe(
                {
                    "complete": True,
                    "passed": result.passed,
                    "output_sha256": result.output_hash,
                    "wall_seconds": round(result.timing.seconds, 6),
                },
                [
                    {"check": o.text, "passed": o.passed, "found": o.found} | ({"missed": o.missed} if o.missed else {})
                    for o in result.outcomes
                ],
            )

    def close(self) -> None:
        """Closes the files. Closing twice is allowed."""
        with writing(self.folder):
            try:
                self._log.close()
            finally:
                self._truth.close()

    def _describe(self, result: Mapping[str, Any], checks: list[dict[str, Any]] | None = None) -> None:
        scenario = self._scenario
        document = tomlkit.document()
        document["run"] = {
            "scenario": scenario.name,
            "robot": scenario.design.name,
            "title": scenario.title,
            "seed": scenario.seed,
            "duration": f"{scenario.duration:g} s",
            "link": self._link,
            **result,
        }
        document["parameters"] = self._parameters
        if checks:
            document["checks"] = checks
        document["scenario"] = {"text": tomlkit.string(scenario.source, multiline=True)}
        temporary = self.folder / "run.toml.new"
        temporary.write_text(tomlkit.dumps(document), encoding="utf-8")
        temporary.replace(self.folder / "run.toml")


def _all_parameters(interface: Interface, changed: Mapping[str, float]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name, parameter in interface.parameters.items():
        value = changed.get(name, parameter.default * parameter.scale)
        shown = float(f"{value:.12g}")
        values[name] = shown if parameter.unit in ("", "1") else f"{shown!r} {parameter.unit}"
    return values
