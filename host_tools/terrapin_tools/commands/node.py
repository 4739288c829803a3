"""`terrapin node`: the controllers on a bus, and their node numbers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from terrapin_hil.links import LinkName, open_link
from terrapin_hil.links.names import INPROCESS, no_image
from terrapin_tools.command_options import Json, LinkKeyFile, NodeNumber, deliver, link_option
from terrapin_tools.errors import UserError

if TYPE_CHECKING:
    from terrapin_tools.param.nodes import NodeAnswer

__all__ = ["SUBCOMMANDS"]

Link = Annotated[LinkName, link_option("parameters", "where the controllers are")]
Flash = Annotated[
    Path | None,
    typer.Option("--flash", metavar="FILE", help="flash of the controllers inprocess and pty, made if absent"),
]
LISTED = 1.0  # s that a bus without any such controller may take to say nothing


def list_(link: Link = INPROCESS, json: Json = "") -> int:
    """Which node numbers are taken, and by which controllers. Exit status 1 when two have one number, or none answers.

    Example: terrapin node list --link socketcan:can0
    """
    found = dict(_found(link))
    rows = [
        f"node {n}: controller {answer.unique:08x}"
        + (f", node {answer.stored} from its next reset on" if answer.stored != n else "")
        + (f"; one of {len(answers)} with this number, expected one" if len(answers) > 1 else "")
        for n, answers in found.items()
        for answer in answers
    ]
    entries = [asdict(answer) for answers in found.values() for answer in answers]
    nobody = f"{link}: no controller answers{no_image(str(link))}"
    deliver({"link": str(link), "controllers": entries}, "\n".join(rows) or nobody, json)
    return 1 if not rows or any(len(answers) > 1 for answers in found.values()) else 0


def _found(link: LinkName) -> Iterator[tuple[int, list[NodeAnswer]]]:
    """Node number -> the controllers that answer to it."""
    from terrapin_hil.links.wire import SlcanLink
    from terrapin_hil.nodes import Node, node_count
    from terrapin_tools.param.nodes import controllers

    numbers = range(node_count()) if "listen" in link.row.jobs else [link.node]
    with closing(open_link(link, LISTED)) as first:
        if isinstance(first, SlcanLink):  # a controller behind a port may end when the port is closed
            for number in numbers:
                first.node = Node(number)
                yield number, controllers(first)
            return
    for number in numbers:
        with closing(open_link(replace(link, node=number), LISTED)) as opened:
            yield number, controllers(opened)


def _unique(text: str) -> int | None:
    if not text:
        return None
    try:
        number = int(text, 16)
    except ValueError:
        number = -1
    if not 0 <= number <= 0xFFFFFFFF:
        raise UserError(f"--unique: found {text!r}, expected up to 8 hexadecimal digits, as `terrapin node list` shows")
    return number


def set_(
    number: Annotated[str, typer.Argument(metavar="NUMBER", help="that the controller is to have, 0 to 7")],
    link: Link = INPROCESS,
    node: NodeNumber = None,
    unique: Annotated[str, typer.Option("--unique", help="which one, where several have the same number")] = "",
    flash: Flash = None,
    link_key: LinkKeyFile = None,
    json: Json = "",
) -> None:
    """Give a controller another node number, from its next reset on. Its bridge must be off.

    Example: terrapin node set 3 --link socketcan:can0
    """
    from terrapin_hil.nodes import node_number
    from terrapin_tools.param.nodes import store_node

    link = link.at_node(node)
    if flash is not None and "flash file" not in link.row.jobs:
        raise UserError(f"--flash: {link} keeps its node number itself")
    wanted = node_number(number, "node set")
    with open_link(link, LISTED, link_key, **({"flash": flash} if flash else {})) as opened:
        answer = store_node(opened, wanted, _unique(unique))
    words = f"controller {answer.unique:08x}: node {answer.stored} from its next reset on; it is node {answer.node} now"
    deliver({"link": str(link), **asdict(answer)}, words, json)


def clear(
    link: Link = INPROCESS, node: NodeNumber = None, link_key: LinkKeyFile = None, flash: Flash = None, json: Json = ""
) -> None:
    """End a STOP_ALL, and every latched fault whose cause is gone. Where there is a link key it is needed.
    Nothing starts by it: the next RUN counts once an IDLE came.

    Example: terrapin node clear --link socketcan:can0 --link-key robot.key
    """
    from terrapin_tools.param.nodes import clear as clear_one

    link = link.at_node(node)
    if flash is not None and "flash file" not in link.row.jobs:
        raise UserError(f"--flash: {link} keeps a STOP_ALL itself")
    with open_link(link, LISTED, link_key, **({"flash": flash} if flash else {})) as opened:
        clear_one(opened)
    deliver({"link": str(link), "cleared": True}, f"{link}: told clear; it starts nothing before an IDLE", json)


SUBCOMMANDS = (list_, set_, clear)
