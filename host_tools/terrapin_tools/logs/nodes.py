"""Frames of several controllers on one bus, taken for one of them: its identifiers become those of node 0, whose DBC
then decodes them."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Index
from terrapin_hil.nodes import Node, node_count
from terrapin_tools.logs.frames import ERROR, EXTENDED, REMOTE, Frames

__all__ = ["ELSEWHERE", "dbc_of_node", "of_node", "others", "renamed"]

IDENTIFIERS = 0x800  # of classic CAN
ELSEWHERE = 1 << 16  # added to what would otherwise pass for a message of ours


@cache
def _names(node: int) -> Index:
    """Identifier on the bus -> that of node 0, or, of another node, one that no DBC has."""
    own = Node(node)
    names = np.arange(IDENTIFIERS, dtype=np.int64)
    names[_owners() >= 0] += ELSEWHERE
    for identifier in range(IDENTIFIERS):
        found = own.from_bus((identifier, b""))
        if found is not None:
            names[identifier] = found[0]
    return names


@cache
def _shifts(node: int) -> npt.NDArray[np.uint8]:
    """Identifier on the bus -> what the CRC of a protected message of the node changes by."""
    own = Node(node)
    moved = [own.from_bus((identifier, bytes(8))) for identifier in range(IDENTIFIERS)]
    return np.array([frame[1][7] if frame else 0 for frame in moved], dtype=np.uint8)


@cache
def _owners() -> npt.NDArray[np.int64]:
    """Identifier -> the node that it belongs to; -1: to all, or to none."""
    owners = np.full(IDENTIFIERS, -1, dtype=np.int64)
    shared = [i for i in range(IDENTIFIERS) if all(Node(n).from_bus((i, b"")) for n in range(min(2, node_count())))]
    for number in range(node_count()):
        own = Node(number)
        owners[[i for i in range(IDENTIFIERS) if own.from_bus((i, b"")) is not None]] = number
    owners[shared] = -1
    return owners


def _usual(block: Frames) -> npt.NDArray[np.bool_]:
    usual: npt.NDArray[np.bool_] = (block.flags & (EXTENDED | REMOTE | ERROR)) == 0
    return usual & (block.identifiers < IDENTIFIERS)


def renamed(block: Frames, node: int) -> Frames:
    """All frames in their places; those of the node have the identifiers of node 0, those of others ones that no DBC
    has."""
    names, usual = block.identifiers.copy(), _usual(block)
    names[usual] = _names(node)[names[usual]]
    return replace(block, identifiers=names)


def of_node(block: Frames, node: int) -> Frames:
    """The frames of the node and of all nodes, as node 0 would have sent and got them; error frames stay."""
    names, usual = renamed(block, node), _usual(block)
    whole = usual & (block.lengths == 8)
    data = block.data.copy()
    data[whole, 7] ^= _shifts(node)[block.identifiers[whole]]
    return replace(names, data=data).pick((names.identifiers < ELSEWHERE) | ~usual)


def others(block: Frames, node: int) -> Counter[int]:
    """How many frames the controllers of other nodes sent or were sent, by node number."""
    owners = _owners()[block.identifiers[_usual(block)]]
    return Counter(owners[(owners >= 0) & (owners != node)].tolist())


def dbc_of_node(text: str, node: int) -> str:
    """The DBC `text` of node 0 as that of another."""
    own = Node(node)
    lines = r'^(BO_|CM_ BO_|CM_ SG_|BA_ "GenMsgCycleTime" BO_|VAL_) (\d+)\b'
    return re.sub(lines, lambda m: f"{m[1]} {own.to_bus((int(m[2]), b''))[0]}", text, flags=re.MULTILINE)
