"""Batches on the page: started as jobs, seen as they fill, reported, removed, and what is refused."""

from __future__ import annotations

import shlex
import subprocess
import sys
from typing import Any

import pytest
from serving import Server

from tests.waiting import wait_for

BODY = {"scenario": "slope_limiter", "duration": 2.0, "seeds": "1:30", "vary": ["path.2.slope=2deg:16deg"]}


def test_a_batch_fills_and_is_removed(server: Server) -> None:
    answer = server.ask("POST", "/api/batches", BODY)
    assert answer.status == 202, answer.body
    started = answer.json
    job = server.wait(started["id"])
    assert job["state"] == "done", job
    assert job["result"]["runs"] == 30
    state = server.get(f"/api/batches/{started['batch']}")
    assert (state["done"], state["runs"], state["complete"]) == (30, 30, True)
    assert state["inputs"] == ["passed", "seed", "path.2.slope"]
    assert len(state["points"]) == len(state["outcomes"]) == 30
    assert "max(abs(slip))" in state["results"]
    bad = [i for i, point in enumerate(state["points"]) if not point[0]]
    number, why, *numbers = state["outcomes"][bad[0]]
    assert why
    assert len(numbers) == len(state["results"])
    one = server.ask("POST", f"/api/batches/{started['batch']}/runs/{number}")  # the same run, with its log
    assert one.status == 202, one.body
    assert server.wait(one.json["id"])["state"] == "done"
    run = server.get(f"/api/simulate/{one.json['run']}/signals")
    assert why.split("; ") == [check["missed"] for check in run["checks"] if not check["passed"]]  # told once
    assert server.ask("POST", f"/api/batches/{started['batch']}/runs/77777").status == 404
    assert (
        next(line for line in server.get("/api/batches") if line["name"] == started["batch"])["failed"]
        == state["failed"]
    )
    report = server.ask("GET", f"/api/batches/{started['batch']}/report")
    assert report.status == 200
    assert "script" not in report.headers["content-security-policy"]
    assert b"<svg" in report.body
    words = shlex.split(started["command"])
    again = subprocess.run(
        [sys.executable, "-c", "from terrapin_tools.cli import main; main()", *words[1:]],
        cwd=server.folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert again.returncode == 1  # the command on the page is the same batch: nothing is left to do
    assert "0 runs in" in again.stderr
    assert server.ask("DELETE", f"/api/batches/{started['batch']}").status == 200
    assert server.ask("GET", f"/api/batches/{started['batch']}").status == 404
    assert not [name for name in server.files() if name.startswith(f"batches/{started['batch']}")]


def test_a_batch_is_seen_while_it_fills_and_can_be_stopped(server: Server) -> None:
    started = server.ask("POST", "/api/batches", {**BODY, "duration": 60.0, "seeds": "1:2000"}).json

    def begun() -> Any:
        lines = [line for line in server.get("/api/batches") if line["name"] == started["batch"]]
        return lines and lines[0]["done"] > 0 and lines[0]

    line = wait_for(begun)
    assert line["done"] < line["runs"] == 2000
    assert not line["complete"]
    assert server.ask("DELETE", f"/api/batches/{started['batch']}").status == 409
    assert server.ask("DELETE", f"/api/jobs/{started['id']}").status == 200
    assert server.get(f"/api/jobs/{started['id']}")["state"] == "cancelled"
    assert server.ask("GET", f"/api/batches/{started['batch']}/report").status == 404
    assert server.ask("DELETE", f"/api/batches/{started['batch']}").status == 200


@pytest.mark.parametrize(
    ("changes", "status", "said"),
    [
        ({"scenario": "none"}, 404, "none"),
        ({"seeds": "5:1"}, 422, "lower one first"),
        ({"seeds": "1:1000000"}, 422, "at most 100000"),
        ({"vary": ["path.2.slope"]}, 422, "NAME=LOW:HIGH"),
        ({"vary": ["../x=1:2"]}, 422, "name of a field"),
        ({"ground": [{"terrain": "lava"}]}, 422, "terrain"),
        ({"out": "elsewhere"}, 422, "out"),
    ],
)
def test_refused_and_nothing_written(server: Server, changes: dict[str, Any], status: int, said: str) -> None:
    before = {name for name in server.files() if name.startswith("batches/")}
    answer = server.ask("POST", "/api/batches", {**BODY, **changes})
    assert answer.status == status, answer.body
    assert said in answer.detail
    assert {name for name in server.files() if name.startswith("batches/")} == before


def test_what_the_scenario_refuses_is_the_jobs_line(server: Server) -> None:
    started = server.ask("POST", "/api/batches", {**BODY, "vary": ["robot.coulomb=-1:1"]}).json
    job = server.wait(started["id"])
    assert job["state"] == "failed"
    assert "--vary robot.coulomb" in job["error"]
    assert "found -1" in job["error"]
