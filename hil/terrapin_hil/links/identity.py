"""Whether a controller was built for the robot, the board and the interface of this process: it says so when asked.

Messages travel in steps that are the robot's: what another robot's controller says would be misread, and not fail.
"""

from __future__ import annotations

from collections.abc import Callable

from terrapin_hil.links.link import LinkError
from terrapin_hil.links.names import no_image
from terrapin_hil.messages import Frame, Sender, interface
from terrapin_hil.robots import selected
from terrapin_interface.robot import identity_of, robots

__all__ = ["question", "refuse_another", "require_fit", "require_fitting"]

Ask = Callable[[Frame, Callable[[Frame], bool]], Frame | None]


def question() -> Frame:
    """The frame that asks."""
    return Sender().frame("IDENTITY_READ", {"part": 0})


def require_fit(name: str, data: bytes) -> None:
    """Takes IDENTITY's `data` from the link `name`. LinkError when the controller is another's, in one line."""
    own, answer = interface(), interface().messages["IDENTITY"]
    if len(data) != answer.length:
        raise LinkError(f"{name}: the controller's IDENTITY has {len(data)} bytes, expected {answer.length}")
    found, robot = answer.decode(data), selected()
    boards = {number: word for word, number in own.enums["board"].items()}
    if found["robot"] != own.constants["robot_identity"]:
        known = {identity_of(word): word for word in robots()}
        other = known.get(found["robot"], f"robot 0x{found['robot']:06x}")
        raise LinkError(f"{name}: the controller is that of {other}, expected {robot.name}; --robot says whose")
    if boards.get(found["board"]) not in ("none", "emulated", robot.board.name):  # neither of those two has a bridge
        raise LinkError(
            f"{name}: the controller is on board {boards.get(found['board'], found['board'])}, expected "
            f"{robot.board.name}, which {robot.name}.toml names"
        )
    if found["version"] != own.version or found["interface"] != own.constants["interface_identity"]:
        raise LinkError(
            f"{name}: the controller speaks interface {found['version']}, {found['interface']:06x}, expected "
            f"{own.version}, {int(own.constants['interface_identity']):06x}; build and flash it anew, or run the other"
        )


def refuse_another(name: str, ask: Ask) -> bool:
    """Asks the controller behind the link `name`; whether it said. LinkError when it is another's."""
    identifier = interface().messages["IDENTITY"].id
    found = ask(question(), lambda frame: frame[0] == identifier)
    if found is not None:
        require_fit(name, found[1])
    return found is not None


def require_fitting(name: str, ask: Ask) -> None:
    """Asks the controller behind the link `name`. LinkError when it is another's, or does not say."""
    if not refuse_another(name, ask):
        raise LinkError(
            f"{name}: the controller does not say what it was built for; expected this project's firmware"
            + no_image(name)
        )
