"""What a rig says about a board: how fast its e-stop is, and that the bridge stays off in test mode."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from terrapin_hil.messages import Frame, Sender, interface
from terrapin_hil.run.rig import Rig, RigError
from terrapin_hil.scenario.checks import Outcome

__all__ = ["Talking", "bridge_stays_off", "estop_outcome", "measure_estop"]

PRESSES = 5
ENABLE_LIMIT = 5.0  # s for a controller to enable its bridge: self test, or a clear and the hold of an IDLE
COMMAND_CYCLE = 0.02  # s


class Talking(Protocol):
    """A link to a controller that steps by itself."""

    def talk(self, frames: Sequence[Frame], wait: float) -> list[Frame]: ...


class _Operator:
    """Commands with their counters."""

    def __init__(self, link: Talking) -> None:
        self._link = link
        self._sender = Sender()
        self._requests = interface().enums["request"]
        self._status = interface().messages["STATUS"]
        self._states = {number: name for name, number in interface().enums["state"].items()}
        self.last = "it sends no STATUS"

    def leave_test_mode(self) -> None:
        self._link.talk(self._sender.test_mode(False), COMMAND_CYCLE)

    def ask(self, request: str) -> None:
        """One command, at 0 V; keeps what the controller says of itself."""
        values = {"request": self._requests[request], "control": 0, "setpoint": 0}
        for identifier, data in self._link.talk([self._sender.frame("COMMAND", values)], COMMAND_CYCLE):
            if identifier == self._status.id:
                said = self._status.decode(data)
                self.last = f"its state is {self._states.get(said['state'], said['state'])}, faults {said['faults']:#x}"


def _until(condition: Callable[[], bool], act: Callable[[], None], seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        act()
    return True


def measure_estop(rig: Rig, link: Talking, presses: int = PRESSES) -> list[float]:
    """Seconds from each press of the e-stop to the enable line off, with the bridge enabled at 0 V out of test mode.

    RigError when the bridge does not come on, or does not go off. The e-stop is released, and the bridge off, after it.
    """
    operator = _Operator(link)
    reactions = []
    rig.set("estop", False)
    operator.leave_test_mode()
    try:
        for _ in range(presses):
            for request in ("clear", "idle"):  # a latched fault goes with `clear`; it is an IDLE that permits a start
                for _ in range(3):
                    operator.ask(request)
            if not _until(rig.enabled, lambda: operator.ask("run"), ENABLE_LIMIT):
                raise RigError(f"the enable line did not come on within {ENABLE_LIMIT:g} s; {operator.last}")
            reactions.append(rig.press_estop())
            rig.set("estop", False)
            time.sleep(0.1)  # longer than its release is debounced
    finally:
        rig.set("estop", False)
        operator.ask("idle")
    return reactions


def estop_outcome(rig: Rig, link: Talking) -> Outcome:
    """The slowest of some presses against the limit of the rig's file. RigError as measure_estop."""
    slowest = max(measure_estop(rig, link))
    limit = rig.config.estop_limit
    return Outcome(
        f"e-stop to enable line off <= {limit * 1e3:g} ms",
        slowest <= limit,
        f"{slowest * 1e3:.3g} ms, the slowest of {PRESSES}",
    )


@contextmanager
def bridge_stays_off(rig: Rig, outcomes: list[Outcome]) -> Iterator[None]:
    """Watches the enable line while a run in test mode lasts; what it saw is added to `outcomes`."""
    rig.enable_edges()
    begun_off = not rig.enabled()
    yield
    rises = sum(active for _, active in rig.enable_edges())
    outcomes.append(
        Outcome("enable line off in test mode", begun_off and rises == 0, f"it came on {rises + (not begun_off)} times")
    )
