"""The wire of an update over any bus that python-can knows."""

from __future__ import annotations

from collections.abc import Sequence

from terrapin_hil.links.names import BIT_RATE, LinkName
from terrapin_hil.links.pythoncan import PythonCan
from terrapin_hil.messages import Frame
from terrapin_hil.nodes import Node
from terrapin_tools.flash.wire import Wire, heard

__all__ = ["CanWire"]


class CanWire(Wire):
    """A bus, for the answers of an update (see terrapin_tools.flash.wire.Wire). LinkError when it does not open."""

    def __init__(self, link: LinkName, bit_rate: int = BIT_RATE) -> None:
        self.name = str(link)
        node = Node(link.node)
        places = [node.to_bus((identifier, b""))[0] for identifier in sorted(heard())]
        filters = [{"can_id": place, "can_mask": 0x7FF, "extended": False} for place in places]
        self._bus = PythonCan(link, 2.0, heard(), bit_rate, can_filters=filters)

    def send_plain(self, frames: Sequence[Frame]) -> None:
        self._bus.send(frames)

    def receive(self, wait: float) -> list[Frame]:
        return self._bus.receive(wait)

    def wake(self) -> None:
        pass  # a bus is always open

    def close(self) -> None:
        self._bus.close()
