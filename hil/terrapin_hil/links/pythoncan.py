"""The controller on any bus that python-can knows: slcan on a port, vendors' adapters, SocketCAN as well."""

from __future__ import annotations

import logging
import time
from collections.abc import Container, Sequence
from typing import Any

import can
from can.util import cast_from_string

from terrapin_hil.links.bus import BusLink
from terrapin_hil.links.link import LinkError, not_there
from terrapin_hil.links.names import BIT_RATE, LinkName
from terrapin_hil.messages import Frame, interface
from terrapin_hil.nodes import Node

__all__ = ["PythonCan", "open_link", "opened"]

logging.getLogger("can").addHandler(logging.NullHandler())  # what matters of its words comes as an error


def opened(link: LinkName, bit_rate: int = BIT_RATE, **more: Any) -> can.BusABC:
    """python-can's bus of that name. Its options win over `bit_rate` [bit/s] and `more`. LinkError when it does not
    open."""
    options = {"bitrate": bit_rate, **more, **{key: cast_from_string(word) for key, word in link.options.items()}}
    if link.interface == "slcan":
        options.setdefault("sleep_after_open", 0.0)
    try:
        return can.Bus(interface=link.interface, channel=link.channel, **options)
    except Exception as error:  # each adapter's driver has its own way of not being there
        raise LinkError(f"{link}: cannot open the link: {not_there(error)}") from None


class PythonCan:
    """An open bus of python-can (see terrapin_hil.links.bus.Bus), for frames with identifiers in `wanted`: by default
    those of the controller."""

    def __init__(
        self,
        link: LinkName,
        timeout: float = 2.0,
        wanted: Container[int] | None = None,
        bit_rate: int = BIT_RATE,
        **more: Any,
    ) -> None:
        self.name = str(link)
        self._timeout = timeout
        self._bus = opened(link, bit_rate, **more)
        self._node = Node(link.node)
        self._wanted = wanted or {m.id for m in interface().messages.values() if m.sender == "controller"}

    def send(self, frames: Sequence[Frame]) -> None:
        try:
            for identifier, data in map(self._node.to_bus, frames):
                message = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
                self._bus.send(message, timeout=self._timeout)
        except (can.CanError, OSError) as error:
            raise LinkError(f"{self.name}: cannot send: {error}") from None

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
            own = self._node.from_bus((message.arbitration_id, bytes(message.data))) if plain else None
            if own is not None and own[0] in self._wanted:
                return [own]

    def close(self) -> None:
        self._bus.shutdown()


def open_link(name: LinkName, timeout: float) -> BusLink:
    """The link. LinkError when it does not open."""
    return BusLink(PythonCan(name, timeout), timeout)
