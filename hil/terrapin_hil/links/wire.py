"""The controller at the other end of SLCAN: a process on a pty of its own, or a board on a serial port."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from terrapin_hil.firmware import ParameterError
from terrapin_hil.links.link import Link, LinkError, refuse_production
from terrapin_hil.links.names import LinkName
from terrapin_hil.links.slcan import ControllerProcess, SlcanPort
from terrapin_hil.messages import Frame, Interface, Sender, interface
from terrapin_hil.nodes import Node

__all__ = ["BY_ITSELF", "SlcanLink", "open_link", "write_parameters"]

BY_ITSELF = "a controller goes on by itself, out of test mode: is its bridge on, or is it a robot of `terrapin sim`?"
QUIET = 0.03  # s after the arming of test mode in which a controller by itself sends nothing more
Exchange = Callable[[Sequence[Frame]], Sequence[Frame]]


def write_parameters(
    sender: Sender, description: Interface, parameters: Mapping[str, float], exchange: Exchange
) -> None:
    """Sets parameters by PARAMETER_WRITE, each confirmed by PARAMETER_VALUE. ParameterError when one is refused."""
    reply = description.messages["PARAMETER_VALUE"]
    for name, physical in parameters.items():
        parameter = description.parameter(name)
        raw = parameter.raw(physical)
        frame = sender.frame("PARAMETER_WRITE", {"index": parameter.index, "value": raw})
        answers = [data for identifier, data in exchange([frame]) if identifier == reply.id]
        if not answers:
            raise LinkError(f"parameter {name}: the controller does not confirm it")
        answer = reply.decode(answers[-1])
        if answer["status"] != 0 or answer["index"] != parameter.index or answer["value"] != raw:
            reasons = {1: "it does not know it", 2: "out of range", 3: "locked while the bridge is on"}
            reason = reasons.get(answer["status"], "another value came back")
            raise ParameterError(f"parameter {name}: the controller refuses {physical:g}: {reason}")


class SlcanLink(Link):
    """Lockstep over an SLCAN port. The controller is in test mode from `start` on: its physical bridge stays off."""

    def __init__(self, name: str, port: SlcanPort, machine: Any = None, node: int = 0) -> None:
        """`machine`: what the controller runs in; its `stop` is called when the link is closed. `node`: its number."""
        self.name = name
        self.machine = machine
        self._port = port
        self._sender = Sender()
        self.node = Node(node)  # whom it speaks to; another may take its place

    @classmethod
    def of_process(
        cls, program: Path | None = None, arguments: Sequence[str] = (), timeout: float = 2.0, node: int = 0
    ) -> SlcanLink:
        """Starts a controller (the host build's by default) on a pty. LinkError when it does not start."""
        process = ControllerProcess(program, ("--node", str(node), *arguments))
        path = process.start()
        try:
            return cls("pty", SlcanPort.open(path, timeout), process, node)
        except BaseException:
            process.stop()
            raise

    def start(self, parameters: Mapping[str, float]) -> None:
        self.exchange(self._sender.test_mode(False))
        self.exchange(self._sender.test_mode())
        if not isinstance(self.machine, ControllerProcess) and self.talk((), QUIET):  # that one has no clock of its own
            refuse_production(self.name, lambda seconds: self.talk((), seconds))
            if self.talk((), QUIET):  # not the last frames from before it was armed
                raise LinkError(f"{self.name}: {BY_ITSELF}")
        write_parameters(self._sender, interface(), parameters, self.exchange)

    def _own(self, frames: Sequence[Frame]) -> list[Frame]:
        """Those of the controller, of all that an adapter brings."""
        return [own for frame in frames if (own := self.node.from_bus(frame)) is not None]

    def exchange(self, frames: Sequence[Frame]) -> list[Frame]:
        answers: list[Frame] = []
        for piece in self.outgoing(frames):
            answers += self._own(self._port.exchange_frames(map(self.node.to_bus, piece)))
        return answers

    def talk(self, frames: Sequence[Frame], wait: float) -> list[Frame]:
        """Sends frames to a controller that steps by itself; what it sends within `wait` seconds."""
        heard = self.exchange(frames)
        time.sleep(wait)
        heard += self._own(self._port.exchange(b"F\r"))  # all that has come stands before the answer to this
        return self.incoming(heard)

    def close(self) -> None:
        self._port.close()
        if self.machine is not None:
            self.machine.stop()


def open_link(name: LinkName, timeout: float, flash: Path | None = None, link_key: Path | None = None) -> SlcanLink:
    """The controller on a serial port or pty that exists, or, without a device, this build's on a pty of its own, which
    keeps its parameters in the file `flash` and has the link key in the file `link_key`. LinkError when it does not
    answer."""
    if not name.channel:
        files = {"--flash": flash, "--link-key": link_key}
        words = [word for option, path in files.items() if path is not None for word in (option, str(path))]
        return SlcanLink.of_process(arguments=words, timeout=timeout, node=name.node)
    port = SlcanPort.open(name.channel, timeout, name.baud, name.bit_rate())
    return SlcanLink(str(name), port, node=name.node)
