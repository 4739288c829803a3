"""Links to a controller: in this process, over SLCAN on a pty or serial port, over any bus that python-can knows.

A link is opened, started (reset, parameters), advanced by ticks, closed:

    with open_link("pty") as link:
        link.start({"supply_compensation": 1.0})
        link.advance(simulation, 1000)

Names: `inprocess`, `pty`, `qemu` (the ARM core on an emulated Cortex-M4), `qemu-usart` (the STM32F405's image over its
emulated USART), `serial:DEVICE`, `socketcan:CHANNEL`, `can:INTERFACE:CHANNEL`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Protocol, Self

from hil.simulation import Simulation

__all__ = ["LINKS", "Link", "LinkNameError", "check_link_name", "open_link"]

LINKS = "inprocess, pty, qemu, qemu-usart, serial:DEVICE, socketcan:CHANNEL, can:INTERFACE:CHANNEL"


class LinkNameError(ValueError):
    """No link has that name."""


class Link(Protocol):
    """A controller that can be driven in lockstep. Failures are LinkError: one line that names the link."""

    name: str

    def start(self, parameters: Mapping[str, float]) -> None:
        """Resets the controller and sets parameters, in their units. ValueError for one that it refuses."""

    def advance(self, simulation: Simulation, ticks: int) -> None:
        """`ticks` ticks of lockstep; `simulation.done` says how far it came when it fails."""

    def close(self) -> None:
        """Lets go of the controller; its bridge is off then. Closing twice is allowed."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


def _inprocess(where: str) -> Link:
    from hil.links.inprocess import InProcess

    return InProcess()


def _pty(where: str) -> Link:
    from hil.links.wire import SlcanLink

    return SlcanLink.of_process()


def _qemu(where: str) -> Link:
    from hil.links.qemu import open_qemu

    return open_qemu()


def _qemu_usart(where: str) -> Link:
    from hil.links.qemu_usart import open_qemu_usart

    return open_qemu_usart()


def _serial(where: str) -> Link:
    from hil.links.wire import SlcanLink

    return SlcanLink.of_device(where)


def _can(where: str) -> Link:
    from hil.links.pythoncan import open_pythoncan

    interface, _, channel = where.partition(":")
    return open_pythoncan(interface, channel)


def _socketcan(where: str) -> Link:
    from hil.links.socketcan import open_socketcan

    return open_socketcan(where)


_OPEN: dict[str, Callable[[str], Link]] = {
    "inprocess": _inprocess,
    "pty": _pty,
    "qemu": _qemu,
    "qemu-usart": _qemu_usart,
    "serial": _serial,
    "socketcan": _socketcan,
    "can": _can,
}


def check_link_name(name: str) -> tuple[str, str]:
    """The name's kind and address. LinkNameError when no link can have that name."""
    kind, colon, where = name.partition(":")
    if kind not in _OPEN or (kind in ("serial", "socketcan", "can") and not where) or "\0" in name:
        raise LinkNameError(f"link {name!r}: expected one of {LINKS}")
    if kind == "inprocess" and colon:
        raise LinkNameError(f"link {name!r}: inprocess takes no address")
    if kind in ("qemu", "qemu-usart") and colon:
        raise LinkNameError(f"link {name!r}: {kind} takes no address")
    if kind == "pty" and colon:
        raise LinkNameError(f"link {name!r}: pty takes no address; for a device write serial:{where}")
    return kind, where


def open_link(name: str) -> Link:
    """The link of that name, open. LinkNameError, or LinkError when it does not open."""
    kind, where = check_link_name(name)
    return _OPEN[kind](where)
