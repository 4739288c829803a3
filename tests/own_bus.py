"""A UDP multicast bus of a test's own: whoever listens on a port hears all groups of the machine that send to it."""

from __future__ import annotations

import socket
from pathlib import Path

__all__ = ["own_multicast", "unread"]


def own_multicast() -> tuple[str, int]:
    """A group and a port that nobody else has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port = int(probe.getsockname()[1])
    return f"239.74.{port >> 8}.{port & 0xFF}", port


def unread(port: int) -> int:
    """Bytes that the kernel holds for the sockets of a port: nothing is lost while they stay few."""
    rows = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
    return sum(int(row[4].partition(":")[2], 16) for row in rows if row[1].endswith(f":{port:04X}"))
