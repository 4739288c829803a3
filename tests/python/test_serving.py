"""`terrapin monitor --serve`: what a client of Foxglove's protocol is told, over a loopback WebSocket."""

from __future__ import annotations

import json
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect

from terrapin_hil.messages import interface
from terrapin_hil.scenario.scenario import find_scenario
from terrapin_tools.errors import UserError

PROGRAM = "from terrapin_tools.cli import main; main()"
BOUND = 60.0  # s, of whatever is waited for


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The command over a simulated robot that goes on until it is stopped, and its address."""
    pytest.importorskip("foxglove")
    text = find_scenario("steady_sand").read_text(encoding="utf-8")
    assert 'duration = "10 s"' in text
    robot = tmp_path / "long.toml"
    robot.write_text(text.replace('duration = "10 s"', 'duration = "600 s"'), encoding="utf-8")
    words = ["monitor", str(robot), "--serve", "--port", "0"]
    process = subprocess.Popen([sys.executable, "-c", PROGRAM, *words], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert "ws://127.0.0.1:" in line
        yield process, line.partition("ws://")[2].partition(";")[0]
    finally:
        process.kill()
        process.communicate(timeout=BOUND)


def messages(client: Any) -> Iterator[tuple[dict[str, Any] | None, bytes]]:
    """Those of the server: text as JSON, or data."""
    until = time.monotonic() + BOUND
    while time.monotonic() < until:
        found = client.recv(timeout=BOUND)
        yield (json.loads(found), b"") if isinstance(found, str) else (None, found)


def test_topics_explain_themselves_and_have_data(served: tuple[subprocess.Popen[str], str]) -> None:
    process, address = served
    with connect(f"ws://{address}", subprotocols=["foxglove.sdk.v1"]) as client:
        known: dict[str, Any] = {}
        for told, _ in messages(client):
            if told and told["op"] == "serverInfo":
                assert told["capabilities"] == []  # nothing is taken from a client
            if told and told["op"] == "advertise":
                known |= {channel["topic"]: channel for channel in told["channels"]}
            if {"/can", "/GROUND", "/ACTUATE"} <= known.keys():
                break
        ground, actuate = (json.loads(known[topic]["schema"])["properties"] for topic in ("/GROUND", "/ACTUATE"))
        assert {known[topic]["schemaEncoding"] for topic in known} == {"jsonschema"}
        assert ground["torque"]["type"] == "number"
        assert ground["torque"]["description"].startswith("[N m]")
        words = {word["title"]: word["const"] for word in actuate["state"]["oneOf"]}
        assert words.items() >= {"run": interface().enums["state"]["run"]}.items()
        wanted = {"id": 7, "channelId": known["/ACTUATE"]["id"]}
        client.send(json.dumps({"op": "subscribe", "subscriptions": [wanted]}))
        data = next(data for _, data in messages(client) if data[:1] == b"\x01")
        subscription, stamp = struct.unpack_from("<IQ", data, 1)
        value = json.loads(data[13:])
        assert subscription == 7
        assert 0 <= stamp < 60e9  # the scenario's time
        assert value["state"] in words.values()
        assert isinstance(value["enable"], bool)
        assert isinstance(value["duty"], float)
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=BOUND)
    assert process.returncode == 0
    assert "frames served, 0 lost" in out


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--drive", "--link", "serial:/dev/null"], "--drive: has keys in the terminal, expected it without --serve"),
        (["--port", "70000"], "--port: found 70000, expected 0 to 65535"),
    ],
)
def test_what_does_not_go_is_a_line(words: list[str], line: str) -> None:
    call = [sys.executable, "-c", PROGRAM, "monitor", "--serve", *words]
    done = subprocess.run(call, capture_output=True, text=True, check=False, timeout=BOUND)
    assert (done.returncode, done.stderr) == (2, f"terrapin: {line}\n")


def test_a_port_without_a_server_is_a_line() -> None:
    call = [sys.executable, "-c", PROGRAM, "monitor", "--port", "8765"]
    done = subprocess.run(call, capture_output=True, text=True, check=False, timeout=BOUND)
    assert (done.returncode, done.stderr) == (2, "terrapin: --port: of a server, expected --serve as well\n")


def test_a_port_that_is_taken_is_a_line() -> None:
    pytest.importorskip("foxglove")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        call = [sys.executable, "-c", PROGRAM, "monitor", "--serve", "--port", str(port)]
        done = subprocess.run(call, capture_output=True, text=True, check=False, timeout=BOUND)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"terrapin: --port: {port}: Address already in use, expected one that is free\n"


def test_without_the_sdk_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    from terrapin_hil import paths
    from terrapin_tools.logs.decoding import Decoder
    from terrapin_tools.monitor.serving import FoxgloveServer

    monkeypatch.setattr("terrapin_tools.extras.installed", lambda package: package != "foxglove")
    with pytest.raises(UserError, match=r"--serve needs foxglove, .*terrapin-robot\[foxglove\]"):
        FoxgloveServer(Decoder(paths.dbc()), 0, "none")
