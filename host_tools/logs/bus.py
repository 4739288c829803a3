"""Listening to a bus: what python-can receives, as blocks of frames."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import can

from host_tools.errors import UserError
from host_tools.logs.frames import Frames, frames
from host_tools.logs.reading import message_flags

__all__ = ["LISTENABLE", "open_bus", "receive"]

LISTENABLE = "socketcan:CHANNEL, serial:DEVICE, can:INTERFACE:CHANNEL"
MOST = 100_000  # frames of a block


def open_bus(link: str, bitrate: int = 500_000) -> can.BusABC:
    """A bus by its link name (see LISTENABLE). UserError when there is none, or it cannot be opened (status 1)."""
    kind, _, where = link.partition(":")
    interface, channel = {"socketcan": ("socketcan", where), "serial": ("slcan", where)}.get(
        kind, (where.partition(":")[0], where.partition(":")[2])
    )
    if kind not in ("socketcan", "serial", "can") or not interface or not channel:
        raise UserError(f"--link: found {link!r}, expected one of {LISTENABLE}")
    options: dict[str, Any] = {"sleep_after_open": 0.0} if interface == "slcan" else {}
    try:
        return can.Bus(interface=interface, channel=channel, bitrate=bitrate, **options)
    except Exception as error:  # each adapter's driver has its own way of not being there
        reason = next(iter(str(error).splitlines()), "") or type(error).__name__
        raise UserError(f"{link}: cannot open the bus: {reason}", status=1) from None


def receive(bus: can.BusABC, seconds: float) -> Frames:
    """What comes within `seconds`. UserError (status 1) when the bus goes away."""
    end = time.monotonic() + seconds
    times: list[float] = []
    names: list[int] = []
    payloads: list[bytes] = []
    flags: list[int] = []
    try:
        while (left := end - time.monotonic()) > 0 and len(times) < MOST:
            message = bus.recv(left)
            if message is None:
                continue
            times.append(message.timestamp)
            names.append(message.arbitration_id)
            payloads.append(b"" if message.is_remote_frame else bytes(message.data))
            flags.append(message_flags(message))
    except (can.CanError, OSError, ValueError, TypeError) as error:
        raise UserError(f"{bus.channel_info}: the bus went away ({error})", status=1) from None
    return frames(Path("bus"), times, names, payloads, flags)
