"""Identifiers of the controllers on one bus: those of node 0, which everything else here speaks, and a node's own.

    node = Node(3)
    bus.send(node.to_bus(frame))
    own = node.from_bus(received)            # None: another node's

The plan stands in controller.toml ([identifiers]); firmware/link/node.c is the controller's side of it.
"""

from __future__ import annotations

from functools import cache

from terrapin_hil.errors import UserError
from terrapin_hil.messages import Frame, crc8, interface

__all__ = ["Node", "node_count", "node_number"]


def node_count() -> int:
    """Controllers that one bus may have."""
    return int(interface().json["node_count"])


def node_number(text: str, where: str) -> int:
    """The node number that a text says. UserError that begins with `where`."""
    if not (text.isascii() and text.isdecimal() and len(text) < 4 and int(text) < node_count()):
        raise UserError(f"{where}: found {text!r}, expected a node number from 0 to {node_count() - 1}")
    return int(text)


@cache
def _plan() -> tuple[dict[int, tuple[int, int]], ...]:
    """For each node: identifier on the bus -> (that of node 0, what the CRC of a protected message changes by)."""
    messages = interface().by_id
    plan = []
    for node in range(node_count()):
        own = {}
        for block in interface().json["blocks"]:
            first = block["node_1"] + (node - 1) * block["step"] if node else block["first"]
            for offset in range(block["size"]):
                base = block["first"] + offset
                message = messages.get(base)
                # The CRC is linear: other bits of the identifier change it by the same, whatever the data.
                bits = (base ^ (first + offset)).to_bytes(2, "little") + bytes(7)
                shift = crc8(bits) ^ crc8(bytes(9)) if message is not None and message.e2e else 0
                own[first + offset] = base, shift
        plan.append(own)
    return tuple(plan)


def _shifted(identifier: int, data: bytes, shift: int) -> Frame:
    if shift and len(data) == 8:
        return identifier, data[:7] + bytes([data[7] ^ shift])
    return identifier, data


class Node:
    """One controller's place on a bus. UserError for a number that no node has."""

    def __init__(self, number: int = 0) -> None:
        self.number = node_number(str(number), "node")
        self._from = _plan()[self.number]
        self._to = {base: (own, shift) for own, (base, shift) in self._from.items()}

    def to_bus(self, frame: Frame) -> Frame:
        """A frame of node 0 as this node's. One that is in no block of the plan stays as it is."""
        found = self._to.get(frame[0])
        return _shifted(found[0], frame[1], found[1]) if found else frame

    def from_bus(self, frame: Frame) -> Frame | None:
        """A frame from the bus as node 0's; None when it is not this node's. What was damaged stays so."""
        found = self._from.get(frame[0])
        return _shifted(found[0], frame[1], found[1]) if found else None

    def identifier(self, name: str) -> int:
        """The identifier on the bus of the message `name`."""
        return self._to[interface().messages[name].id][0]

    @property
    def answers(self) -> list[int]:
        """Identifiers on the bus of what this controller sends, sorted."""
        return sorted(self._to[m.id][0] for m in interface().messages.values() if m.sender == "controller")
