"""The wire of an update over any bus that python-can knows."""

from __future__ import annotations

from terrapin_hil.links.names import BIT_RATE, LinkName
from terrapin_hil.links.pythoncan import PythonCan
from terrapin_hil.nodes import Node
from terrapin_tools.flash.layout import ANSWERS

__all__ = ["CanWire"]


class CanWire(PythonCan):
    """A bus, for the answers of an update (see terrapin_tools.flash.wires.Wire). LinkError when it does not open."""

    def __init__(self, link: LinkName, bit_rate: int = BIT_RATE) -> None:
        first, _ = Node(link.node).to_bus((ANSWERS.start, b""))
        filters = [{"can_id": first, "can_mask": 0x7F8, "extended": False}]
        super().__init__(link, 2.0, ANSWERS, bit_rate, can_filters=filters)

    def wake(self) -> None:
        pass  # a bus is always open
