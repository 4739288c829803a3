"""A session that writes its log as `terrapin run` does, and whose complaints are those of the front door."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

from terrapin_hil.run import session
from terrapin_hil.scenario.scenario import Scenario
from terrapin_tools.door.link import Link
from terrapin_tools.door.named import Named
from terrapin_tools.errors import for_programs

__all__ = ["Session"]


class Session(session.Session):
    """A robot in lockstep with its controller, moved on by a program, tick by tick.

    >>> with Session("steady_sand", seed=3) as s:
    ...     _ = s.until("GROUND.valid", timeout=20.0)
    ...     abs(s["GROUND.torque"] - s.truth["contact_torque"]) < 4 * s["GROUND.torque_sd"]
    True

    Parameters
    ----------
    scenario : the name of a shipped one, a file, or one that was made (terrapin_hil.scenario).
    link : where the controller is (docs/links.md), or an open `Link`, which is left open.
    seed : in place of the scenario's.
    robot : a shipped one or a file; it becomes that of this process.
    parameters : of the controller, in their units, over the scenario's.
    changes : fields of the scenario in place of the file's, {"path.1.slope": "3deg"}.
    plant : Python in the place of the simulated body, or the file of an FMU (docs/simulators.md).
    log : folder into which the log goes, as `terrapin run --out` writes it.

    Raises
    ------
    errors.InputError : scenario, change or parameter is wrong; OSError : the controller cannot be had.
    """

    @for_programs
    def __init__(
        self,
        scenario: str | Path | Scenario,
        link: str | Link = "inprocess",
        *,
        seed: int | None = None,
        robot: str = "",
        parameters: Mapping[str, float] | None = None,
        changes: Mapping[str, Any] | None = None,
        plant: session.Plant | str | Path | None = None,
        log: str | Path | None = None,
    ) -> None:
        from terrapin_hil.messages import interface
        from terrapin_tools.logs.folder import RunFolder

        if isinstance(plant, str | Path):
            from terrapin_hil.fmi.plant import FmuPlant

            plant = FmuPlant(Path(plant))
        opened = link.opened if isinstance(link, Link) else link
        chosen = session.chosen_scenario(scenario, robot, changes)
        if seed is not None and seed >= 0:
            chosen = replace(chosen, seed=seed)
        self._folder = None
        if log is not None:
            name = opened if isinstance(opened, str) else opened.name
            self._folder = RunFolder(Path(log), chosen, name, dict(parameters or {}), interface())
        observers = [self._folder] if self._folder else []
        try:
            super().__init__(chosen, opened, seed=seed, parameters=parameters, plant=plant, observers=observers)
        except BaseException:
            if self._folder:
                self._folder.close()
            raise

    @property
    def truth(self) -> dict[str, float]:
        return Named(super().truth, "truth" if self.ticks else "truth before the first step")

    @property
    def signals(self) -> dict[str, float]:
        return Named(super().signals, "signals")

    @for_programs
    def get(self, name: str) -> float:
        return super().get(name)

    @for_programs
    def step(self, seconds: float = 1e-3) -> Self:
        return super().step(seconds)

    @for_programs
    def until(self, condition: str | Callable[[Self], object], timeout: float) -> Self:
        return super().until(condition, timeout)

    @for_programs
    def __getitem__(self, name: str) -> float:
        return super().__getitem__(name)

    @for_programs
    def inject(self, kind: str, channel: str = "", value: float | None = None, *, lasting: float | None = None) -> Self:
        return super().inject(kind, channel, value, lasting=lasting)

    @for_programs
    def order(self, request: str, setpoint: float = 0.0, control: str = "voltage", limiter: bool | None = None) -> Self:
        return super().order(request, setpoint, control, limiter)

    @for_programs
    def checkpoint(self) -> Any:
        return super().checkpoint()

    @for_programs
    def restore(self, kept: Any) -> Self:
        return super().restore(kept)

    def close(self) -> None:
        folder = getattr(self, "_folder", None)
        try:
            super().close()
        finally:
            if folder is not None:
                folder.close()
