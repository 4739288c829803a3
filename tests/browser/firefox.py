"""Firefox, driven by WebDriver BiDi over its own port: Playwright's Firefox is a build that no package serves.

with Firefox(folder) as firefox:
    firefox.open("http://127.0.0.1:8765/")
    firefox.until("document.querySelector('h1') !== null")
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from websockets.sync.client import connect

__all__ = ["FIREFOX", "Firefox"]

FIREFOX = next((found for name in ("firefox-esr", "firefox") if (found := shutil.which(name))), None)
SECONDS = 300.0  # after which something hangs, on a machine however busy


class Firefox:
    """Without a window, with a profile in `folder`. `said`: what its console said as warning or error."""

    def __init__(self, folder: Path) -> None:
        assert FIREFOX is not None
        self.said: list[str] = []
        self._number = 0
        command = [FIREFOX, "--headless", "--no-remote", "--profile", str(folder), "--remote-debugging-port", "0"]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        assert self._process.stderr is not None
        address = None
        while address is None and (line := self._process.stderr.readline()):
            address = re.search(r"WebDriver BiDi listening on (ws://\S+)", line)
        assert address is not None
        self._stack = ExitStack()
        self._stack.callback(self._end)
        self._socket = self._stack.enter_context(connect(f"{address[1]}/session", max_size=None))
        self.ask("session.new", capabilities={})
        self.ask("session.subscribe", events=["log.entryAdded"])
        self._page = self.ask("browsingContext.getTree")["contexts"][0]["context"]

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to a command of WebDriver BiDi."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            told = json.loads(self._socket.recv(timeout=SECONDS))
            if told.get("method") == "log.entryAdded" and told["params"]["level"] in ("warn", "error"):
                self.said.append(told["params"]["text"])
            if told.get("id") == self._number:
                assert told["type"] == "success", told
                return dict(told["result"])

    def size(self, width: int, height: int) -> None:
        self.ask("browsingContext.setViewport", context=self._page, viewport={"width": width, "height": height})

    def open(self, address: str) -> None:
        self.ask("browsingContext.navigate", context=self._page, url=address, wait="complete")

    def evaluate(self, expression: str) -> Any:
        """The value of an expression of the page: a text, a number, or whether something is so."""
        found = self.ask("script.evaluate", expression=expression, target={"context": self._page}, awaitPromise=True)
        assert found["type"] == "success", found
        return found["result"].get("value")

    def until(self, expression: str) -> None:
        end = time.monotonic() + SECONDS
        while not self.evaluate(f"Boolean({expression})"):
            assert time.monotonic() < end, (expression, self.said)
            time.sleep(0.1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _end(self) -> None:
        self._process.terminate()
        self._process.communicate()
