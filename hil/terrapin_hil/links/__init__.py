"""Links to a controller: in this process, over SLCAN on a pty or serial port, over any bus that python-can knows.

A link is opened, started (reset, parameters), advanced by ticks, closed:

    with open_link("pty") as link:
        link.start({"supply_compensation": 1.0})
        link.advance(simulation, 1000)

Names: `inprocess`, `pty`, `qemu` (the ARM core on an emulated Cortex-M4), `qemu-usart` (the STM32F405's image over its
emulated USART), `serial:DEVICE`, `socketcan:CHANNEL`, `can:INTERFACE:CHANNEL`; see terrapin_hil.links.names.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from terrapin_hil.links.names import LinkName, LinkNameError

if TYPE_CHECKING:
    from terrapin_hil.links.link import Link

__all__ = ["LinkName", "LinkNameError", "open_link"]


def open_link(name: str | LinkName, timeout: float = 2.0, **more: Any) -> Link:
    """The link of that name, open. `timeout` [s] bounds each wait for an answer.

    `more` is what a kind of link takes by itself: `flash`, the file in which inprocess and pty keep parameters;
    `link_key`, the file of the link key that pty has.
    LinkNameError, or LinkError when it does not open.
    """
    found = LinkName.parse(name) if isinstance(name, str) else name
    link: Link = import_module(f"{__name__}.{found.row.module}").open_link(found, timeout, **more)
    return link
