"""A controller with a link key, from the page: changed with the key that the server was given, refused without."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from serving import Server

from terrapin_hil.links.seal import LinkKey
from terrapin_hil.links.slcan import ControllerProcess

WRITE = {"name": "slip_limit", "value": 0.25}


@pytest.fixture
def key(tmp_path: Path) -> Path:
    path = tmp_path / "robot.key"
    path.touch(0o600)
    path.write_text(LinkKey.new().text(), encoding="utf-8")
    return path


@pytest.fixture
def watching(tmp_path: Path, key: Path) -> Iterator[Callable[..., Server]]:
    """A server that watches a controller with the key; its options follow the link."""
    with ExitStack() as stack:

        def start(*options: str) -> Server:
            process = ControllerProcess(None, ("--link-key", str(key)))
            link = f"serial:{process.start()}"
            stack.callback(process.stop)
            server = Server(tmp_path, "--link", link, *options)
            stack.callback(server.stop)
            assert server.ask("POST", "/api/live", {"source": link}).status == 200
            return server

        yield start


def test_with_the_key_the_page_changes_it(watching: Callable[..., Server], key: Path) -> None:
    server = watching("--link-key", str(key))
    done = server.ask("POST", "/api/live/parameters", WRITE)
    assert done.status == 200, done.body
    assert "slip_limit is 0.25" in done.json["done"]
    told = {one["name"]: one["value"] for one in server.get("/api/live/parameters")["parameters"]}
    assert told["slip_limit"] == pytest.approx(0.25)
    assert server.ask("POST", "/api/live/command", {"request": "clear"}).status == 200
    secret = LinkKey.read(key).key.hex()
    everything = [server.ask("GET", path).body for path in ("/api/live", "/api/links", "/api/status")]
    assert not any(secret.encode() in body or b"robot.key" in body for body in everything)


def test_without_it_one_line_says_what_to_do(watching: Callable[..., Server]) -> None:
    server = watching()
    for body, path in (({"request": "clear"}, "command"), (WRITE, "parameters")):
        refused = server.ask("POST", f"/api/live/{path}", body)
        assert refused.status >= 400
        assert "has a link key" in refused.detail
        assert "--link-key FILE" in refused.detail
    assert server.ask("POST", "/api/live/command", {"request": "idle"}).status == 200  # a stop needs none
    assert server.ask("POST", "/api/live/command", {"request": "release"}).status == 200


def test_another_key_is_told(watching: Callable[..., Server], tmp_path: Path) -> None:
    other = tmp_path / "other.key"
    other.touch(0o600)
    other.write_text(LinkKey.new().text(), encoding="utf-8")
    refused = watching("--link-key", str(other)).ask("POST", "/api/live/parameters", WRITE)
    assert "wrong link key" in refused.detail
