"""The controller on any bus that python-can knows: slcan on a port, vendors' adapters, SocketCAN as well."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from typing import Any

import can

from hil.links.bus import BusLink
from hil.links.slcan import LinkError
from hil.messages import Frame, interface

__all__ = ["PythonCan", "open_pythoncan"]


logging.getLogger("can").addHandler(logging.NullHandler())  # what matters of its words comes as an error


def _reason(error: Exception) -> str:
    return next(iter(str(error).splitlines()), "") or type(error).__name__


class PythonCan:
    """An open bus of python-can (see hil.links.bus.Bus)."""

    def __init__(self, kind: str, channel: str, timeout: float = 2.0) -> None:
        self.name = f"{kind}:{channel}"
        self._timeout = timeout
        options: dict[str, Any] = {"sleep_after_open": 0.0} if kind == "slcan" else {}
        try:
            self._bus = can.Bus(interface=kind, channel=channel, bitrate=500_000, **options)
        except Exception as error:  # each adapter's driver has its own way of not being there
            raise LinkError(f"{self.name}: cannot open the link: {_reason(error)}") from None
        self._own = {m.id for m in interface().messages.values() if m.sender == "controller"}

    def send(self, frames: Sequence[Frame]) -> None:
        try:
            for identifier, data in frames:
                self._bus.send(
                    can.Message(arbitration_id=identifier, data=data, is_extended_id=False), timeout=self._timeout
                )
        except (can.CanError, OSError) as error:
            raise LinkError(f"{self.name}: {_reason(error)}") from None

    def receive(self, wait: float) -> list[Frame]:
        end = time.monotonic() + wait
        while True:
            try:
                message = self._bus.recv(max(0.0, end - time.monotonic()))
            except (can.CanError, OSError, ValueError, TypeError) as error:
                raise LinkError(f"{self.name}: the link disappeared ({error})") from None
            if message is None:
                return []
            plain = not (message.is_extended_id or message.is_remote_frame or message.is_error_frame)
            if plain and message.arbitration_id in self._own:
                return [(message.arbitration_id, bytes(message.data))]

    def close(self) -> None:
        self._bus.shutdown()


def open_pythoncan(kind: str, channel: str, timeout: float = 2.0) -> BusLink:
    """Link over a bus of python-can. LinkError when it does not open."""
    return BusLink(PythonCan(kind, channel, timeout), timeout)
