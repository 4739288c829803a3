"""A real `terrapin web` for tests, and a plain HTTP client that sends exactly what it is told."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

__all__ = ["Answer", "Server"]

START = "import sys; from terrapin_tools.cli import main; sys.argv[0] = 'terrapin'; main()"
JOB_SECONDS = 300.0  # after which something hangs


class Answer:
    """Status, headers (lower case) and body of an answer."""

    def __init__(self, status: int, headers: dict[str, str], body: bytes) -> None:
        self.status, self.headers, self.body = status, headers, body

    @property
    def json(self) -> Any:
        return json.loads(self.body)

    @property
    def detail(self) -> str:
        text = self.json["detail"]
        assert isinstance(text, str)
        assert "\n" not in text
        return text


class Server:
    """`terrapin web` as a process of its own in `folder`."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder, self.workspace = folder, folder / "ws"
        command = [sys.executable, "-c", START, "web", "--no-open", "--workspace", "ws", *options]
        with (folder / "server.err").open("ab") as errors:
            self.process = subprocess.Popen(
                command, cwd=folder, stdout=subprocess.PIPE, stderr=errors, env={**os.environ, "PYTHONUNBUFFERED": "1"}
            )
        assert self.process.stdout is not None
        self.line = self.process.stdout.readline().decode().strip()
        assert self.line.startswith("http://127.0.0.1:"), (self.line, self.errors())
        self.port = int(self.line.split(":")[2].split("/")[0])
        self.token = self.line.partition("token=")[2]

    def errors(self) -> str:
        return (self.folder / "server.err").read_text()

    def ask(
        self,
        method: str,
        path: str,
        body: Any = None,
        headers: dict[str, str] | None = None,
        token: bool = True,
        host: str | None = None,
    ) -> Answer:
        """One request. A body that is no bytes goes as JSON."""
        sent = {
            "Host": host or f"127.0.0.1:{self.port}",
            **({"Authorization": f"Bearer {self.token}"} if token else {}),
        }
        if body is not None and not isinstance(body, bytes):
            body, sent["Content-Type"] = json.dumps(body).encode(), "application/json"
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=300)
        connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
        for name, value in {**sent, **(headers or {})}.items():
            connection.putheader(name, value)
        if body is not None:
            connection.putheader("Content-Length", str(len(body)))
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # refused before all of it was sent
            connection.endheaders(body)
        with connection.getresponse() as got:
            return Answer(got.status, {k.lower(): v for k, v in got.getheaders()}, got.read())

    def raw(self, data: bytes) -> bytes:
        """Bytes as they are; the first 65536 bytes of what comes back, b"" when the server hangs up."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=300) as line:
            line.sendall(data)
            return line.recv(65536)

    def get(self, path: str) -> Any:
        answer = self.ask("GET", path)
        assert answer.status == 200, (path, answer.status, answer.body)
        return answer.json

    def start(self, case: str, **body: Any) -> str:
        """Start a job on a case; its id."""
        answer = self.ask("POST", f"/api/cases/{case}/jobs", body)
        assert answer.status == 202, answer.body
        return str(answer.json["id"])

    def wait(self, job: str) -> dict[str, Any]:
        """The job when it has ended."""
        until = time.monotonic() + JOB_SECONDS
        while time.monotonic() < until:
            found = self.get(f"/api/jobs/{job}")
            if found["state"] in ("done", "failed", "cancelled"):
                return dict(found)
            time.sleep(0.02)
        raise AssertionError(f"job {job} is not done after {JOB_SECONDS} s")

    def upload(self, name: str, content: bytes) -> Answer:
        return self.ask("POST", f"/api/uploads?name={name}", content)

    def warm_live(self) -> None:
        """The first look at a source imports and compiles: on a busy machine longer than an answer may take."""
        for _ in range(4):
            with contextlib.suppress(TimeoutError):
                assert self.ask("POST", "/api/live", {"source": "simulator:steady_sand"}).status == 200
                break
        assert self.ask("DELETE", "/api/live").status == 200

    def files(self) -> dict[str, int]:
        """Every file of the workspace with its size: what was written, and what was not."""
        found = {}
        for path in self.workspace.rglob("*"):
            with contextlib.suppress(FileNotFoundError):  # a file that is written whole has another name until then
                found[path.relative_to(self.workspace).as_posix()] = path.stat().st_size
        return found

    def kill(self) -> None:
        """As a crash would: no chance to tidy up."""
        self.process.kill()
        self.process.wait()
        self._close()

    def stop(self) -> int:
        """Ctrl-C; the exit status."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        status = self.process.wait(timeout=300)
        self._close()
        return status

    def _close(self) -> None:
        if self.process.stdout is not None:
            self.process.stdout.close()
