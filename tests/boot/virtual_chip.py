"""A chip with its boot loader on python-can's virtual bus, for updates end to end."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Iterator

import can
from bootlib import Chip
from kit import PUBLIC

from terrapin_hil.links import LinkName
from terrapin_hil.messages import Frame, interface
from terrapin_tools.flash.can_wire import CanWire

QUERY = interface().messages["UPDATE_QUERY"].id


class Node(threading.Thread):
    """A chip on python-can's virtual bus; `lose`: every so many-th frame, of both directions, is lost."""

    def __init__(self, channel: str, lose: int = 0, next_key: bytes = b"") -> None:
        super().__init__(daemon=True)
        self.bus = can.Bus(interface="virtual", channel=channel, receive_own_messages=False)
        self.chip = Chip(PUBLIC, next_key)
        self.chip.start()
        self.lose, self.count, self.resets = lose, 0, 0
        self.going = True
        self.mute: set[int] = set()  # identifiers that it does not hear
        self.answers = 1  # to each request but a query, as to one that was sent as often
        self.lose_once: list[int] = []  # identifiers of requests that are lost, once each,
        self.lose_answer: list[int] = []  # and of those whose answer is

    def lost(self) -> bool:
        self.count += 1
        return self.lose > 0 and self.count % self.lose == 0

    def answer(self, identifier: int, data: bytes) -> list[Frame]:
        """What it answers to a frame."""
        return self.chip.accept(identifier, data)

    def started(self) -> None:
        """After each reset."""

    def run(self) -> None:
        while self.going:
            message = self.bus.recv(0.05)
            if message is None or message.arbitration_id in self.mute or self.lost():
                continue
            if message.arbitration_id in self.lose_once:
                self.lose_once.remove(message.arbitration_id)
                continue
            replies = self.answer(message.arbitration_id, bytes(message.data))
            if message.arbitration_id in self.lose_answer:
                self.lose_answer.remove(message.arbitration_id)
                replies = []
            answers = 1 if message.arbitration_id == QUERY else self.answers
            for identifier, data in replies:
                for _ in range(0 if self.lost() else answers):
                    self.bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
            if self.chip.update.reset:
                self.resets += 1
                if self.chip.update.stay:
                    self.chip.lib.terrapin_update_init(self.chip.update, self.chip.boot, 0)
                elif self.chip.start():
                    self.chip.confirm()
                self.started()


@contextlib.contextmanager
def beside(node: Node) -> Iterator[Node]:
    """Another chip with the same node number on the bus of one."""
    other = Node(node.bus.channel_id)
    other.start()
    try:
        yield other
    finally:
        other.going = False
        other.join(5)
        other.bus.shutdown()


@contextlib.contextmanager
def on_bus(lose: int = 0, next_key: bytes = b"", kind: type[Node] = Node) -> Iterator[tuple[Node, CanWire]]:
    """A chip and a wire to it."""
    channel = f"flash-{os.getpid()}-{time.monotonic_ns()}"
    node = kind(channel, lose, next_key)
    node.start()
    wire = CanWire(LinkName("can", "virtual", channel))
    try:
        yield node, wire
    finally:
        wire.close()
        node.going = False
        node.join(5)
        node.bus.shutdown()
