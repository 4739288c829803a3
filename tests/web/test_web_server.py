"""The server as the page uses it: start, page, token, cases, jobs, events."""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from serving import START, Server
from websockets.sync.client import connect

from terrapin_hil.nodes import node_count
from terrapin_tools.commands.web import _listen
from terrapin_tools.web.server import STATIC
from tests.waiting import wait_for

ROOT = Path(__file__).resolve().parents[2]
HEATED = ROOT / "cases" / "heated_motor"


def case(server: Server, name: str) -> Path:
    """A copy of heated_motor in the workspace under another name."""
    folder = server.workspace / "cases" / name
    shutil.copytree(HEATED, folder, ignore=shutil.ignore_patterns(".terrapin"))
    return folder


def command_line(folder: Path, *arguments: str) -> Any:
    """The JSON of `terrapin ARGUMENTS --json -`, run as from a shell."""
    done = subprocess.run(
        [sys.executable, "-c", START, *arguments, "--json", "-"], cwd=folder, capture_output=True, check=True
    )
    return json.loads(done.stdout)


def without_seconds(answer: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in answer.items() if key != "seconds"}


def test_start_prints_the_address_with_a_token(server: Server) -> None:
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[A-Za-z0-9_-]{32}", server.line)
    status = server.get("/api/status")
    assert status["workspace"] == "ws"
    assert status["version"] == "0.1.0"
    assert status["nodes"] == node_count()


def test_page_and_static_files_need_no_token_and_keep_to_themselves(server: Server) -> None:
    index = server.ask("GET", "/", token=False)
    assert index.status == 200
    assert index.headers["content-type"].startswith("text/html")
    assert "set-cookie" not in index.headers
    assert "default-src 'self'" in index.headers["content-security-policy"]
    assert "unsafe" not in index.headers["content-security-policy"]
    assert index.headers["x-content-type-options"] == "nosniff"
    assert index.headers["referrer-policy"] == "no-referrer"
    assert not any(name.startswith("access-control") for name in index.headers)
    names = re.findall(rb'(?:src|href)="([^"#:]+\.(?:js|css|svg))"', index.body)
    assert names
    for name in names:
        path = name.decode()
        answer = server.ask("GET", path if path.startswith("/") else f"/{path}", token=False)
        assert answer.status == 200, name
        again = server.ask(
            "GET", path if path.startswith("/") else f"/{path}", headers={"If-None-Match": answer.headers["etag"]}
        )
        assert again.status == 304


def test_token_in_the_address_becomes_a_cookie(server: Server) -> None:
    index = server.ask("GET", f"/?token={server.token}", token=False)
    cookie = index.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert cookie.startswith(f"terrapin_token_{server.port}=")  # another server on this machine has one of its own
    value = cookie.partition(";")[0]
    assert server.ask("GET", "/api/status", token=False, headers={"Cookie": value}).status == 200
    wrong = server.ask("GET", "/?token=nonsense", token=False)
    assert wrong.status == 200
    assert "set-cookie" not in wrong.headers


def test_examples_are_copied_once_and_never_changed(server: Server) -> None:
    names = [entry["name"] for entry in server.get("/api/examples")]
    assert names == [
        "car_on_soft_soil",
        "cylinder_over_time",
        "forced_slip_sand",
        "heated_motor",
        "plates_in_soil",
        "sphere_on_sand",
        "wheel_on_soil",
    ]  # driven_rig_sand is for terrapin soil tactile
    assert server.ask("POST", "/api/examples/heated_motor").json == {"name": "heated_motor"}
    copied = server.workspace / "cases" / "heated_motor" / "case.toml"
    copied.write_text(copied.read_text().replace("the winding warms", "changed"))
    assert server.ask("POST", "/api/examples/heated_motor").status == 200
    assert "changed" in copied.read_text()
    assert "changed" not in (HEATED / "case.toml").read_text()
    assert server.ask("POST", "/api/examples/none").status == 404


def test_list_and_detail_of_cases(server: Server) -> None:
    case(server, "listed")
    broken = case(server, "broken")
    (broken / "case.toml").write_text("[case]\ntitle = 3\n")
    lines = {line["name"]: line for line in server.get("/api/cases")}
    assert lines["listed"]["runs"] == 12
    assert lines["listed"]["rows"] == 72
    assert lines["listed"]["channels"] == ["current"]
    assert lines["listed"]["verdict"] is None
    assert lines["broken"]["error"].startswith("case.toml:")
    detail = server.get("/api/cases/listed")
    assert detail["columns"]["current"] == {"column": "motor_current", "unit": "A", "channel": True}
    assert detail["parameters"]["radius"] == {"value": 0.08, "unit": "m"}
    assert len(detail["runs"]["train"]) + len(detail["runs"]["test"]) == 12
    assert detail["toml"] == (HEATED / "case.toml").read_text()
    assert server.ask("GET", "/api/cases/broken").status == 422
    assert server.ask("GET", "/api/cases/none").status == 404
    assert server.ask("DELETE", "/api/cases/broken").status == 200
    assert not broken.exists()
    assert "broken" not in [line["name"] for line in server.get("/api/cases")]


def test_jobs_answer_as_the_command_line_does(server: Server, tmp_path: Path) -> None:
    """compare, add, discover, remove: same numbers, same files as from a shell."""
    folder = case(server, "asked")
    other = tmp_path / "asked"
    shutil.copytree(folder, other)
    steps: list[tuple[dict[str, Any], tuple[str, ...]]] = [
        ({"do": "compare", "seed": 3}, ("compare", "asked", "--seed", "3")),
        ({"do": "discover"}, ("discover", "asked")),
        ({"do": "add", "effects": ["motor_heating"]}, ("add", "asked", "motor_heating")),
        ({"do": "remove", "effect": "motor_heating"}, ("remove", "asked", "motor_heating")),
    ]
    for body, arguments in steps:
        job = server.wait(server.start("asked", **body))
        assert job["state"] == "done", job
        assert without_seconds(job["result"]) == without_seconds(command_line(tmp_path, *arguments))
        assert job["command"] == " ".join(["terrapin", *arguments]).replace("asked", "ws/cases/asked")
        assert (folder / "case.toml").read_bytes() == (other / "case.toml").read_bytes()
    assert [entry["action"] for entry in server.get("/api/cases/asked")["history"]] == ["added", "removed"]


def test_answer_stays_with_the_case_until_it_changes(server: Server) -> None:
    folder = case(server, "kept")
    job = server.wait(server.start("kept", do="compare"))
    assert job["state"] == "done", job
    detail = server.get("/api/cases/kept")
    assert detail["answer"] == job["result"]
    assert detail["ladder"] == job["result"]["ladder"]
    verdicts = {line["name"]: line["verdict"] for line in server.get("/api/cases")}
    assert verdicts["kept"] == "missing"
    (folder / "case.toml").write_text((folder / "case.toml").read_text() + "\n# another\n")
    assert server.get("/api/cases/kept")["answer"] is None


def test_own_effect_by_expression(server: Server) -> None:
    case(server, "own")
    ask = {"case": "own", "expression": "k*omega**3", "parameters": {"k": {"value": 0.0}}}
    sound = server.ask("POST", "/api/expression", ask).json
    assert sound["ok"]
    assert sound["unit"] == "m*N*s**3/rad**3"
    assert "<math" in sound["mathml"]
    wrong = server.ask("POST", "/api/expression", {**ask, "parameters": {"k": {"value": 0.0, "unit": "N m"}}}).json
    assert not wrong["ok"]
    assert "expected N m" in wrong["message"]
    unknown = server.ask("POST", "/api/expression", {**ask, "parameters": {}}).json
    assert unknown["unknown"] == ["k"]
    broken = server.ask("POST", "/api/expression", {**ask, "expression": "k*(omega"}).json
    assert not broken["ok"]
    body = {
        "do": "add",
        "effects": ["mine"],
        "expression": "k*omega**3",
        "parameters": {"k": {"value": 0, "unit": "N m s^3"}},
    }
    job = server.wait(server.start("own", **body))
    assert job["state"] == "done", job["error"]
    assert job["result"]["added"] == ["mine"]
    assert server.get("/api/cases/own")["effects"] == ["speed_squared", "mine"]


def test_a_job_that_fails_says_why_and_leaves_the_case(server: Server) -> None:
    folder = case(server, "fails")
    before = (folder / "case.toml").read_bytes()
    job = server.wait(server.start("fails", do="add", effects=["bulldozing"]))
    assert job["state"] == "failed"
    assert "bulldozing" in job["error"]
    assert (folder / "case.toml").read_bytes() == before
    twice = server.wait(server.start("fails", do="add", effects=["speed_squared"]))
    assert "in the model already" in twice["error"]


def test_report_and_export(server: Server) -> None:
    case(server, "shown")
    assert server.ask("GET", "/api/cases/shown/report").status == 404
    assert server.wait(server.start("shown", do="report", discover=False))["state"] == "done"
    page = server.ask("GET", "/api/cases/shown/report")
    assert page.status == 200
    assert page.headers["content-security-policy"].startswith("sandbox allow-scripts")
    assert b"<html" in page.body
    server.wait(server.start("shown", do="add", effects=["motor_heating"]))
    job = server.wait(server.start("shown", do="export", scenario="heated_winding"))
    assert job["state"] == "done", job["error"]
    exported, ran = job["result"]
    assert "comp_heating" in exported["parameters"]
    assert ran["contact_error"]["after"]["rms"] < ran["contact_error"]["before"]["rms"]
    assert "heated_winding: 100 %" in job["progress"]
    assert b"comp_heating" in server.ask("GET", "/api/cases/shown/export").body


def test_jobs_on_one_case_run_one_after_the_other(server: Server) -> None:
    case(server, "one")
    case(server, "two")
    with connect(f"ws://127.0.0.1:{server.port}/api/events?token={server.token}") as told:
        first = server.start("one", do="add", effects=["motor_heating"])
        second = server.start("one", do="add", effects=["viscous_friction"])
        third = server.start("two", do="compare")
        happened: list[tuple[str, str]] = []
        while not {(first, "done"), (second, "done"), (third, "done")} <= set(happened):
            event = json.loads(told.recv(timeout=300))
            assert event.get("error") is None
            if "line" not in event and "job" in event:
                happened.append((event["job"], event["state"]))
    order = [(first, "running"), (first, "done"), (second, "running"), (second, "done")]
    assert [one for one in happened if one in order] == order
    assert (second, "queued") in happened[: happened.index((first, "done"))]  # it did wait
    assert server.get("/api/cases/one")["effects"] == ["speed_squared", "motor_heating", "viscous_friction"]


def test_cancel_ends_the_process_and_leaves_the_case(server: Server) -> None:
    folder = case(server, "stopped")
    before = (folder / "case.toml").read_bytes()
    job = server.start("stopped", do="discover", bootstrap=1000)
    waiting = server.start("stopped", do="add", effects=["motor_heating"])
    assert server.ask("DELETE", "/api/cases/stopped").status == 409
    wait_for(lambda: server.get(f"/api/jobs/{job}")["progress"], "it works")
    assert server.ask("DELETE", f"/api/jobs/{waiting}").json["state"] == "cancelled"
    ended = server.ask("DELETE", f"/api/jobs/{job}").json
    assert ended["state"] == "cancelled"  # it answers when the process has ended, long before it would be done
    assert (folder / "case.toml").read_bytes() == before
    assert server.ask("DELETE", f"/api/jobs/{job}").json["state"] == "cancelled"
    assert server.ask("DELETE", "/api/cases/stopped").status == 200


def test_events_reach_every_browser(server: Server) -> None:
    case(server, "told")
    address = f"ws://127.0.0.1:{server.port}/api/events"
    with (
        connect(f"{address}?token={server.token}") as one,
        connect(address, additional_headers={"Cookie": f"terrapin_token_{server.port}={server.token}"}) as two,
    ):
        job = server.start("told", do="compare")
        for socket in (one, two):
            states = []
            while "done" not in states:
                event = json.loads(socket.recv(timeout=300))
                if event.get("job") == job and "line" not in event:
                    states.append(event["state"])
            assert states == ["queued", "running", "done"]


def test_bases_and_effects(server: Server) -> None:
    bases = {base["name"]: base for base in server.get("/api/bases")}
    assert {"rolling_steady", "sphere_contact", "equation"} <= bases.keys()
    needed = [role["name"] for role in bases["rolling_steady"]["roles"] if role["needed"]]
    assert needed == ["omega", "load"]
    effects = server.get("/api/effects?base=sphere_contact")
    assert "bulldozing" in [effect["name"] for effect in effects]
    assert all("<math" in effect["mathml"] and effect["source"] for effect in effects)
    assert all("sphere_contact" in effect["bases"] for effect in effects)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--port", "70000"), "--port: found 70000"),
        (("--link", "can:can0"), "expected one of socketcan:CHANNEL"),
        (("--workspace", "/dev/null/x"), "expected a folder"),
    ],
)
def test_wrong_options(tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", START, "web", "--no-open", *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_the_first_tab_is_fetched_at_once(server: Server) -> None:
    """Every module that the first tab imports, from module to module, is named in the page: none waits for another."""
    page = server.ask("GET", "/", token=False).body.decode()
    named = set(re.findall(r'rel="modulepreload" href="/static/([^"]+)"', page))
    needed, looked = {"app.js", "workbench.js"}, set[str]()
    while needed - looked:
        name = (needed - looked).pop()
        looked.add(name)
        text = (STATIC / name).read_text(encoding="utf-8")
        paths = re.findall(r"^(?:import|export)\b[^'\n]*from '(\.[^']+)'", text, re.MULTILINE)
        needed |= {os.path.normpath(Path(name).parent / path) for path in paths}
    assert named == needed - {"app.js"}


def test_answers_are_sent_at_once() -> None:
    """Not kept back by Nagle's algorithm until the browser's kernel acknowledges, 40 ms later."""
    with _listen(0) as listening:
        listening.listen()
        with socket.create_connection(listening.getsockname()), listening.accept()[0] as accepted:
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
