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
from pathlib import Path
from typing import TYPE_CHECKING, Any

from terrapin_hil.links.names import LinkName, LinkNameError

if TYPE_CHECKING:
    from terrapin_hil.links.link import Link

__all__ = ["LinkName", "LinkNameError", "open_link"]


def open_link(name: str | LinkName, timeout: float = 2.0, link_key: Path | None = None, **more: Any) -> Link:
    """The link of that name, open. `timeout` [s] bounds each wait for an answer.

    `link_key` is the file of the controller's link key: all that needs a seal is then sent with one. A controller that
    is started here (pty without a device) has that key. `more` is what a kind of link takes by itself: `flash`, the
    file in which inprocess and pty keep parameters.
    LinkNameError; LinkError when it does not open, or when the controller has no key or another; ReadingError for a
    file without a key.
    """
    from terrapin_hil.links.seal import LinkKey, seal_link

    found = LinkName.parse(name) if isinstance(name, str) else name
    key = LinkKey.read(link_key) if link_key is not None else None
    if key is not None and found.kind == "pty" and not found.channel:
        more["link_key"] = link_key
    link: Link = import_module(f"{__name__}.{found.row.module}").open_link(found, timeout, **more)
    if key is not None:
        try:
            seal_link(link, key)
        except BaseException:
            link.close()
            raise
    return link
