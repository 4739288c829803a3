"""Names of links, and what a link of each kind can do. Only this file takes such a name apart.

    >>> name = LinkName.parse("can:pcan:PCAN_USBBUS1?bitrate=250000&fd=true", "listen")
    >>> name.interface, name.channel, name.options
    ('pcan', 'PCAN_USBBUS1', {'bitrate': '250000', 'fd': 'true'})
    >>> str(name)
    'can:pcan:PCAN_USBBUS1?bitrate=250000&fd=true'

A new link is a module of this package and a row of KINDS. The module has a function `open_link(name, timeout)` that
returns a `terrapin_hil.links.link.Link`. What is listened to or updated is an interface of python-can, or speaks SLCAN
on a serial port: an interface that python-can does not know yet is best written as a plug-in of python-can.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from urllib.parse import parse_qsl, urlencode

from terrapin_hil.errors import UserError

__all__ = [
    "BIT_RATE",
    "EMPTY_BUS",
    "INPROCESS",
    "JOBS",
    "KINDS",
    "PTY",
    "SET_OUTSIDE",
    "Kind",
    "LinkName",
    "LinkNameError",
    "able",
    "helped",
    "no_image",
]

BIT_RATE = 500_000  # bit/s, of the controller's CAN
FASTEST = 10_000_000  # bit/s that a bus may be said to have
BYTES = "surrogatepass"  # what is no UTF-8 on a command line comes back as it was
OURS = {"interface", "channel", "can_filters"}  # of python-can's options: those that the name or the program says
EMPTY_BUS = "is the bus up, the bit rate right, another node there to acknowledge?"  # to ask where nothing comes
SET_OUTSIDE = "socketcan's is set outside (ip link set can0 type can bitrate 500000)"

JOBS = {  # what commands ask of a link, as it reads after "cannot"
    "lockstep": "run a scenario",
    "board": "have a rig around it",
    "listen": "be listened to",
    "parameters": "give its parameters",
    "flash file": "keep its parameters in a file",
    "update": "take an image",
    "replay": "have a log replayed to it",
}


class LinkNameError(UserError):
    """No link has that name, or the link cannot do what is asked of it."""


@dataclass(frozen=True)
class Kind:
    """One kind of link: how it is named, the module that opens it, and what it can do (words of JOBS)."""

    name: str
    module: str  # of this package
    jobs: frozenset[str]
    address: str = ""  # how the address is written, "" for none
    interface: str = ""  # python-can's, where the kind says it
    options: tuple[str, ...] | None = ()  # that may follow the address; None: whatever python-can's driver takes

    @property
    def form(self) -> str:
        """How a name of this kind is written."""
        return f"{self.name}:{self.address}" if self.address else self.name


HERE = frozenset({"lockstep", "parameters", "replay"})
ON_A_BUS = frozenset({"lockstep", "board", "listen", "parameters", "update"})
KINDS = {
    kind.name: kind
    for kind in (
        Kind("inprocess", "inprocess", HERE | {"flash file"}),
        Kind("pty", "wire", HERE | {"flash file"}),
        Kind("qemu", "qemu", HERE),
        Kind("qemu-usart", "qemu_usart", HERE),
        Kind("socketcan", "socketcan", ON_A_BUS, "CHANNEL", interface="socketcan"),
        Kind("serial", "wire", ON_A_BUS | {"replay"}, "DEVICE", options=("bitrate",)),
        Kind("can", "pythoncan", ON_A_BUS, "INTERFACE:CHANNEL", options=None),
    )
}


def able(job: str) -> list[Kind]:
    """The kinds of links that can do a job."""
    return [kind for kind in KINDS.values() if job in kind.jobs]


def helped(job: str) -> str:
    """The names that a link for a job may have, for a help text."""
    more = any(kind.options != () for kind in able(job))
    return ", ".join(kind.form for kind in able(job)) + (
        "; options may follow: ?bitrate=250000&node=1&..." if more else "; ?node=1 may follow"
    )


def no_image(name: str) -> str:
    """What ends the complaint about a link `name` on which no controller answers: where it can take an image, its boot
    loader may wait for one, and answers nothing else."""
    kind = KINDS.get(name.partition(":")[0])
    waits = kind is not None and "update" in kind.jobs
    return "; a boot loader that waits for an image (empty flash) answers `terrapin flash` alone" if waits else ""


@dataclass(frozen=True)
class LinkName:
    """A link by its name. `interface` is python-can's, or empty; `channel` is a channel, a device, or empty."""

    kind: str
    interface: str = ""
    channel: str = ""
    baud: int = 0  # bit/s of a serial line; 0 leaves it as it is
    node: int = 0  # number of the controller on its bus
    options: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: str, need: str = "lockstep") -> LinkName:
        """The link that `text` names, if it can do the job `need` (see JOBS). LinkNameError says what was expected."""
        named, _, options = text.partition("?")
        name, colon, address = named.partition(":")
        kind = KINDS.get(name)
        expected = f"expected one of {', '.join(kind.form for kind in able(need))}"
        if kind is None or "\0" in text:
            raise LinkNameError(f"link {text!r}: {expected}")
        if need not in kind.jobs:
            raise LinkNameError(f"link {text!r}: {name} cannot {JOBS[need]}; {expected}")
        if colon and not kind.address:
            hint = f"; for a device write serial:{address}" if name == "pty" else ""
            raise LinkNameError(f"link {text!r}: {name} takes no address{hint}")
        parts = address.split(":", kind.address.count(":"))
        if kind.address and ("" in parts or len(parts) <= kind.address.count(":")):
            raise LinkNameError(f"link {text!r}: {expected}")
        *interface, channel = parts
        line = re.fullmatch(r"(.+)@(\d{1,8})", channel) if kind.address == "DEVICE" else None
        channel, baud = line.groups() if line else (channel, "0")
        found = cls(name, "".join(interface) or kind.interface, channel, int(baud))
        words = _options(text, found, options)
        return replace(found, node=_node(text, words.pop("node", "0")), options=words)

    def at_node(self, number: int | None) -> LinkName:
        """The same link to the controller with this node number; None leaves that to the name. LinkNameError when the
        name says another."""
        if number is None:
            return self
        if self.node not in (0, number):
            raise LinkNameError(f"link {str(self)!r}: found node {self.node} in its name and {number} beside it")
        return replace(self, node=_node(str(self), str(number)))

    @property
    def row(self) -> Kind:
        """What a link of this kind can do."""
        return KINDS[self.kind]

    def bit_rate(self, default: int = BIT_RATE) -> int:
        """bit/s of the bus, where its name says them."""
        return int(self.options.get("bitrate", default))

    def __str__(self) -> str:
        address = f"{self.channel}@{self.baud}" if self.baud else self.channel
        interface = "" if self.interface == self.row.interface else self.interface
        words = {**({"node": str(self.node)} if self.node else {}), **self.options}
        options = f"?{urlencode(words, safe=':/,', errors=BYTES)}" if words else ""
        return ":".join(filter(None, (self.kind, interface, address))) + options


def _node(text: str, word: str) -> int:
    if word == "0":
        return 0
    from terrapin_hil.nodes import node_number  # reads the interface, which most names need not

    try:
        return node_number(word, f"link {text!r}: node")
    except UserError as error:
        raise LinkNameError(str(error)) from None


def _options(text: str, link: LinkName, words: str) -> dict[str, str]:
    """The options of a link's name, `words`."""
    try:
        pairs = parse_qsl(words, keep_blank_values=True, strict_parsing=True, errors=BYTES) if words else []
    except ValueError:
        raise LinkNameError(f"link {text!r}: found options {words!r}, expected NAME=VALUE joined by &") from None
    options, allowed = dict(pairs), link.row.options
    if link.interface == "socketcan" and "bitrate" in options:
        raise LinkNameError(f"link {text!r}: bitrate: {SET_OUTSIDE}")
    unknown = options.keys() & OURS if allowed is None else options.keys() - {"node", *allowed}
    if unknown or len(options) < len(pairs):
        expected = "options of python-can, and node" if allowed is None else ", ".join(("node", *allowed))
        raise LinkNameError(f"link {text!r}: found options {words!r}, expected {expected}, each once")
    rate = options.get("bitrate", "1")
    if not (rate.isascii() and rate.isdecimal() and 1 <= int(rate) <= FASTEST):
        raise LinkNameError(f"link {text!r}: bitrate: found {rate!r}, expected 1 to {FASTEST} bit/s")
    return options


INPROCESS, PTY = LinkName("inprocess"), LinkName("pty")
