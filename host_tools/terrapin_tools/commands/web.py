"""`terrapin web`: the workbench, live telemetry and the simulator in a browser on this machine."""

from __future__ import annotations

import socket
import sys
from pathlib import Path
from typing import Annotated

import typer

from terrapin_hil.links import LinkName
from terrapin_tools.command_options import LinkKeyFile, NodeNumber, ThisRobot, link_option
from terrapin_tools.errors import UserError

__all__ = ["web"]


def web(
    port: Annotated[int, typer.Option("--port", help="on loopback; 0 takes one that is free")] = 0,
    no_open: Annotated[bool, typer.Option("--no-open", help="do not open a browser")] = False,
    workspace: Annotated[
        Path, typer.Option("--workspace", metavar="DIR", help="where cases, jobs and uploads are kept; made if absent")
    ] = Path("terrapin-workspace"),
    link: Annotated[LinkName | None, link_option("listen", "a bus that the live view offers first")] = None,
    node: NodeNumber = None,
    robot: ThisRobot = "",
    link_key: LinkKeyFile = None,
) -> None:
    """Serve the workbench as a page on this machine only; it prints the address with its token. Ctrl-C ends it.

    Example: terrapin web --port 8765 --workspace my-work
    """
    if node is not None and link is None:
        raise UserError("--node: of a bus, expected --link as well")
    if link_key is not None and link is None:
        raise UserError("--link-key: of the controller on a bus, expected --link as well")
    link = link.at_node(node) if link else None
    if not 0 <= port <= 65535:
        raise UserError(f"--port: found {port}, expected 0 to 65535")
    import asyncio
    import secrets

    from terrapin_hil.links.seal import LinkKey
    from terrapin_tools.web.serve import NamedBus, serve

    key = LinkKey.read(link_key) if link_key is not None else None
    listening = _listen(port)
    token = secrets.token_urlsafe(24)
    address = f"http://127.0.0.1:{listening.getsockname()[1]}/?token={token}"

    def ready() -> None:
        print(address, flush=True)
        if not no_open:
            import webbrowser

            if not webbrowser.open(address):
                print("terrapin: found no browser; open the address above", file=sys.stderr)

    with listening:
        asyncio.run(serve(listening, workspace, token, NamedBus(str(link or ""), key, link_key), ready))


def _listen(port: int) -> socket.socket:
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    # asyncio sets it on sockets that name their protocol alone: without it each further answer of a connection takes
    # the 40 ms for which the browser's kernel keeps its acknowledgement back. Connections have it from this socket.
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    try:
        listening.bind(("127.0.0.1", port))
    except OSError as error:
        listening.close()
        raise UserError(f"--port: {port}: {error.strerror}, expected one that is free", 1) from None
    return listening
