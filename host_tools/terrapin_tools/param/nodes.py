"""Which controllers are on a bus, by node number: asked, given another, and noticed when two have one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from terrapin_hil.links.link import Link, LinkError
from terrapin_hil.links.names import no_image
from terrapin_hil.messages import Frame, Sender, interface, protect
from terrapin_tools.errors import UserError

__all__ = ["NodeAnswer", "clear", "controllers", "require_one", "store_node"]

WAIT = 0.1  # s in which all controllers of a number answer
ATTEMPTS = 3  # a frame may be lost, and the first may carry the counter with which an earlier host ended


@dataclass(frozen=True)
class NodeAnswer:
    """What a controller says of its node number."""

    unique: int  # 0: it has none
    node: int  # in use
    stored: int  # from the next reset on
    result: str  # node_result of controller.toml


def _talk(link: Any, frames: Sequence[Frame]) -> list[Frame]:
    """What comes in answer, by whichever way the link has."""
    talk = getattr(link, "talk", None)
    return list(talk(frames, WAIT) if talk is not None else link.exchange(frames))


def _ask(link: Link, sender: Sender, values: dict[str, int]) -> list[NodeAnswer]:
    status = interface().messages["NODE_STATUS"]
    results = {value: word for word, value in interface().enums["node_result"].items()}
    found: dict[int, NodeAnswer] = {}
    for identifier, data in _talk(link, [sender.frame("NODE_REQUEST", values)]):
        if identifier == status.id and len(data) == 8 and protect(status.id, data, data[6] & 0xF) == data:
            answer = status.decode(data)
            unique = answer["unique"] & 0xFFFFFFFF
            word = results.get(answer["result"], str(answer["result"]))
            found[unique] = NodeAnswer(unique, answer["node"], answer["stored"], word)
    return list(found.values())


def controllers(link: Link) -> list[NodeAnswer]:
    """The controllers that answer to the link's node number; more than one is one too many. LinkError."""
    sender, found = Sender(), dict[int, NodeAnswer]()
    for _ in range(ATTEMPTS):
        found |= {answer.unique: answer for answer in _ask(link, sender, {})}
        if found:
            break
    return list(found.values())


def require_one(link: Link, node: int) -> None:
    """LinkError when two controllers answer to one node number. None may be one that does not know the question."""
    found = controllers(link)
    if len(found) > 1:
        names = ", ".join(f"{answer.unique:08x}" for answer in found)
        raise LinkError(
            f"{link.name}: found {len(found)} controllers with node number {node} ({names}), expected one; "
            "`terrapin node set` gives one another number"
        )


def clear(link: Link) -> None:
    """Tells the controller `clear`. LinkError when it says after it that a STOP_ALL still holds, or says nothing
    on a bus, where its STATUS comes a hundred times a second."""
    sender, status = Sender(), interface().messages["STATUS"]
    request = {"request": interface().enums["request"]["clear"]}
    stopped = 1 << interface().faults["stop_all"]
    heard: list[bool] = []
    for _ in range(ATTEMPTS):  # of an unknown sender the second COMMAND is the first that is taken
        answers = _talk(link, [sender.frame("COMMAND", request)])
        heard += [bool(status.decode(data)["faults"] & stopped) for name, data in answers if name == status.id]
    if not heard and no_image(link.name):
        raise LinkError(f"{link.name}: no controller answers{no_image(link.name)}")
    if heard and heard[-1]:
        raise LinkError(
            f"{link.name}: STOP_ALL still holds: somebody sends it again, or the controller takes no clear without its "
            "link key; expected --link-key FILE (a key that is lost: `terrapin flash --via swd` writes a new one)"
        )


def store_node(link: Link, number: int, unique: int | None) -> NodeAnswer:
    """Gives the controller, with several of one number that with `unique`, another number; its answer.

    LinkError when none answers; UserError, status 1, when it refuses; UserError when it must be said which is meant.
    """
    found = controllers(link)
    if unique is None:
        if len(found) > 1:
            names = ", ".join(f"{answer.unique:08x}" for answer in found)
            raise UserError(
                f"{link.name}: {len(found)} controllers have this node number: choose with --unique: {names}"
            )
        unique = found[0].unique if found else 0
    sender = Sender()
    for _ in range(ATTEMPTS):
        values = {"unique": unique, "node": number, "action": interface().enums["node_action"]["write"]}
        answers = [answer for answer in _ask(link, sender, values) if answer.unique == unique]
        if answers:
            break
    else:
        if unique in {answer.unique for answer in found}:
            raise LinkError(
                f"{link.name}: the controller takes no change without its link key; expected --link-key FILE"
            )
        which = f"no controller {unique:08x} answers to this node number" if found else "no controller answers"
        raise LinkError(f"{link.name}: {which}{'' if found else no_image(link.name)}")
    reasons = {
        "locked": "locked while the bridge is on; stop the motor first (request idle)",
        "no_store": "it has no place to keep a node number",
        "failed": "its flash does not take it; the old number stands",
    }
    [answer] = answers
    if answer.result != "ok":
        raise UserError(f"{link.name}: node number: {reasons.get(answer.result, answer.result)}", status=1)
    return answer
