"""A talk about parameters with one controller: values are raw integers here, physical = raw * scale.

Nothing here arms test mode or resets the controller: it may be at work.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from terrapin_hil.links.link import LinkError
from terrapin_hil.links.names import no_image
from terrapin_hil.messages import Frame, Interface, Parameter, Sender, interface, protect
from terrapin_tools.errors import UserError

__all__ = ["ORIGINS", "Session", "Store", "Unanswered"]

ATTEMPTS = 3  # a frame may be lost, and the first may carry the counter with which an earlier host ended
SAVE_LIMIT = 10.0  # s: a page of the F405's flash takes 0.5 s to erase, and waits for the bridge to go off
POLL = 0.0005  # s between looks at a save under way
ORIGINS = {
    "blank": "nothing was ever stored",
    "stored": "stored",
    "damaged": "what is stored cannot be read: defaults after a reset",
    "foreign": "what is stored is another robot's or board's: defaults after a reset",
}


class Port(Protocol):
    """Where a controller is: a link, or what asks over a bus that others use as well."""

    name: str

    def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        """Sends one frame; an answer that is `wanted`, None when there is none."""


class Unanswered(LinkError):
    """The controller does not answer."""


@dataclass(frozen=True)
class Store:
    """How the controller's store is."""

    result: str  # store_result of controller.toml
    origin: str  # store_origin
    sequence: int
    changed: bool
    remains: bool


class Session:
    """`get`, `set`, `set_all`, `defaults`, `save`: one parameter or the store at a time, each answer checked.

    LinkError (Unanswered) when the controller does not answer; UserError when it refuses, with status 1.
    """

    def __init__(self, port: Port, description: Interface | None = None) -> None:
        self.port = port
        self.interface = description or interface()
        self._sender = Sender(self.interface)
        self._value = self.interface.messages["PARAMETER_VALUE"]
        self._status = self.interface.messages["STORE_STATUS"]
        self._found = self.interface.messages["STORE_FOUND"]
        self._words = {
            name: {value: word for word, value in self.interface.enums[name].items()}
            for name in ("store_result", "store_origin", "parameter_status")
        }

    def _intact(self, frame: Frame, identifier: int) -> bool:
        data = frame[1]
        return frame[0] == identifier and len(data) == 8 and protect(identifier, data, data[6] & 0xF) == data

    def _ask(self, name: str, values: Mapping[str, int], answer: int, index: int | None = None) -> bytes:
        def wanted(frame: Frame) -> bool:
            if answer == self._found.id:
                return frame[0] == answer and len(frame[1]) == self._found.length
            return self._intact(frame, answer) and (index is None or self._value.decode(frame[1])["index"] == index)

        for _ in range(ATTEMPTS):
            frame = self.port.ask(self._sender.frame(name, values), wanted)
            if frame is not None:
                return frame[1]
        raise Unanswered(f"{self.port.name}: the controller does not answer to {name}{no_image(self.port.name)}")

    def _value_of(self, parameter: Parameter, name: str, values: Mapping[str, int]) -> int:
        answer = self._value.decode(self._ask(name, values, self._value.id, parameter.index))
        status = self._words["parameter_status"].get(answer["status"], str(answer["status"]))
        if status != "ok":
            reason = {
                "unknown": "the controller does not know it (firmware of another version?)",
                "range": "the controller refuses the value as out of range",
                "locked": "locked while the bridge is on; stop the motor first (request idle)",
            }.get(status, f"refused with status {status}")
            raise UserError(f"{self.port.name}: {parameter.name}: {reason}", status=1)
        return answer["value"]

    def get(self, parameter: Parameter) -> int:
        """Its raw value."""
        return self._value_of(parameter, "PARAMETER_READ", {"index": parameter.index})

    def set(self, parameter: Parameter, raw: int) -> None:
        """Writes a raw value, which the controller confirms."""
        found = self._value_of(parameter, "PARAMETER_WRITE", {"index": parameter.index, "value": raw})
        if found != raw:
            raise LinkError(f"{self.port.name}: {parameter.name}: raw {raw} was written, {found} came back")

    def set_all(self, values: Mapping[str, int]) -> Mapping[str, int]:
        """Writes raw values, all or none, and returns them: what was written before one is refused gets back what it
        was."""
        before: dict[str, int] = {}
        try:
            for name, raw in values.items():
                parameter = self.interface.parameters[name]
                was = self.get(parameter)
                self.set(parameter, raw)
                before[name] = was
            return values
        except UserError:
            for name, raw in before.items():
                self.set(self.interface.parameters[name], raw)
            raise
        except LinkError as error:
            if not before:
                raise
            raise LinkError(f"{error}; {len(before)} of {len(values)} parameters were written, and not kept") from None

    def all(self) -> dict[str, int]:
        """Raw values of all parameters."""
        return {name: self.get(parameter) for name, parameter in self.interface.parameters.items()}

    def _store(self, data: bytes) -> Store:
        values = self._status.decode(data)
        return Store(
            result=self._words["store_result"].get(values["result"], str(values["result"])),
            origin=self._words["store_origin"].get(values["origin"], str(values["origin"])),
            sequence=values["sequence"],
            changed=bool(values["changed"]),
            remains=bool(values["remains"]),
        )

    def store(self) -> Store:
        """How the store is now."""
        return self._store(self._ask("STORE_READ", {"part": 0}, self._status.id))

    def found(self) -> dict[str, int]:
        """What the last start made of the stored values: counts of `dropped`, `replaced`, `missing`."""
        return self._found.decode(self._ask("STORE_READ", {"part": 1}, self._found.id))

    def _command(self, action: str) -> Store:
        number = self.interface.enums["store_action"][action]
        store = self._store(self._ask("STORE_COMMAND", {"action": number}, self._status.id))
        if store.result == "locked":
            raise UserError(
                f"{self.port.name}: {action}: locked while the bridge is on; stop the motor first (request idle)",
                status=1,
            )
        return store

    def defaults(self) -> dict[str, int]:
        """All parameters to their defaults, and what they are then; not kept until `save`."""
        self._command("defaults")
        return self.all()

    def save(self) -> Store:
        """Keeps the values that stand; returns when they are. The result is `ok` or `no_store`."""
        store = self._command("save")
        end = time.monotonic() + SAVE_LIMIT
        while store.result == "busy":
            if time.monotonic() > end:
                raise Unanswered(f"{self.port.name}: the save is not done after {SAVE_LIMIT:g} s")
            time.sleep(POLL)
            store = self.store()
        if store.result not in ("ok", "no_store"):
            raise UserError(
                f"{self.port.name}: the controller could not save ({store.result}); what was stored before stands",
                status=1,
            )
        return store
