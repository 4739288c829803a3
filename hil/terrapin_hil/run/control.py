"""How a command reaches a robot that lives in another process: one line of JSON over a local socket, one back.

server = Control("pty:robot")          # UserError where a robot lives there already
server.descriptor, server.serve(act)   # act(text) -> what was done; its UserError goes back to who asked
ask("ground = sand", "pty:robot")      # from another process
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from terrapin_hil.errors import UserError

__all__ = ["Control", "ask", "living"]

LONGEST = 1 << 16  # bytes of a question or an answer
PATIENCE = 5.0  # s


def _folder() -> Path:
    """Of this user alone."""
    folder = Path(tempfile.gettempdir()) / f"terrapin-sim-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.stat().st_uid != os.getuid():
        raise UserError(f"{folder}: belongs to another user")
    return folder


def _path(bus: str) -> Path:
    return _folder() / f"{quote(bus, safe='')[-20:]}.sock"


def _connected(path: Path) -> socket.socket | None:
    client = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    client.settimeout(PATIENCE)
    try:
        client.connect(str(path))
    except OSError:
        client.close()
        return None
    return client


def living() -> list[list[Path]]:
    """The sockets of the robots that live on this machine: of each robot, one a bus."""
    found: dict[int, list[Path]] = {}
    for path in sorted(_folder().glob("*.sock")):
        client = _connected(path)
        if client is not None:
            with client:
                whose = client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
            found.setdefault(struct.unpack("3i", whose)[0], []).append(path)
    return list(found.values())


class Control:
    """The socket of one robot."""

    def __init__(self, bus: str) -> None:
        self._at = _path(bus)
        client = _connected(self._at)
        if client is not None:
            client.close()
            raise UserError(f"{bus}: a robot lives there already; `terrapin sim --do stop --on {bus}` ends it")
        self._at.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.bind(str(self._at))
        except OSError as error:
            self._socket.close()
            raise UserError(
                f"{self._at}: {error.strerror or error}, expected a folder for the robot's socket"
            ) from None
        self._socket.listen(4)
        self.descriptor = self._socket.fileno()

    def serve(self, act: Callable[[str], dict[str, Any]]) -> None:
        """Answers one who waits."""
        client, _ = self._socket.accept()
        with client, contextlib.suppress(OSError):
            client.settimeout(0.05)  # the robot does not wait for who asks
            text = client.recv(LONGEST).decode("utf-8", "replace").strip()
            if not text:
                return
            try:
                answer: dict[str, Any] = {"answer": act(text)}
            except UserError as error:
                answer = {"error": str(error)}
            client.sendall(json.dumps(answer).encode() + b"\n")

    def close(self) -> None:
        self._socket.close()
        self._at.unlink(missing_ok=True)


def ask(text: str, bus: str = "") -> dict[str, Any]:
    """What the robot on `bus` answers; without one, the only robot there is. UserError where there is none."""
    robots = [[_path(bus)]] if bus else living()
    if len(robots) > 1:
        names = ", ".join(unquote(path.stem) for paths in robots for path in paths)
        raise UserError(f"--do: found {len(robots)} robots, expected --on with one of {names}")
    client = _connected(robots[0][0]) if robots else None
    if client is None:
        where = f" on {bus}" if bus else ""
        raise UserError(f"--do: no robot lives{where}; expected `terrapin sim` in another terminal")
    with client:
        try:
            client.sendall(text.encode() + b"\n")
            found = json.loads(client.makefile("rb").readline(LONGEST))
        except (OSError, ValueError):
            raise UserError("--do: the robot ended before it answered", status=1) from None
    if "error" in found:
        raise UserError(found["error"])
    return dict(found["answer"])
