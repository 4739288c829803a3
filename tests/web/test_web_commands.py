"""The command lines that the page shows, as they are: typed into a shell where the server works, they do the same."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from serving import START, Server
from test_web_uploads import HEATED, good, made, order

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.new_case.options import arguments, read
from tests.waiting import wait_for

ROOT = Path(__file__).resolve().parents[2]


def typed(server: Server, command: str, status: int = 0) -> str:
    """What a shell says to a command line, where `terrapin` is this one."""
    bin_folder = server.folder / "bin"
    bin_folder.mkdir(exist_ok=True)
    script = bin_folder / "terrapin"
    script.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -c {shlex.quote(START)} "$@"\n')
    script.chmod(0o755)
    path = f"{bin_folder}:{os.environ['PATH']}"
    done = subprocess.run(
        ["sh", "-c", command], cwd=server.folder, capture_output=True, text=True, timeout=300,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == status, done.stderr
    return done.stdout + done.stderr


def test_the_mappers_command_makes_the_same_case(server: Server) -> None:
    upload = good(server, "day%27s%20runs.csv", HEATED)
    body = order(
        "mapped_here", upload["id"], title="Day's runs: 'warm'", every=2, train=["r01", "r02"], test=["r03"],
        limits={"omega": {"min": 1.0, "max": "20 rad/s", "unit": ""}},
    )  # fmt: skip
    told = server.ask("POST", "/api/command", body).json["command"]
    job = made(server, body)
    assert job["command"] == told
    assert job["state"] == "done", job["error"]
    said = typed(server, told.replace("ws/cases/mapped_here", "by_hand"))
    assert "by_hand/case.toml: rolling_steady, " in said
    here, there = server.workspace / "cases" / "mapped_here", server.folder / "by_hand"
    assert sorted(p.name for p in there.iterdir()) == sorted(p.name for p in here.iterdir())
    for path in here.iterdir():
        assert (there / path.name).read_bytes() == path.read_bytes()
    assert tomllib.loads((there / "case.toml").read_text())["data"]["test"] == ["r03"]
    assert "by_hand: exists" in typed(server, told.replace("ws/cases/mapped_here", "by_hand"), status=2)


def test_what_cannot_be_a_case_leaves_nothing(server: Server) -> None:
    upload = good(server, "runs.csv", HEATED)
    command = server.ask("POST", "/api/command", order("broken_here", upload["id"], base="nonsense")).json["command"]
    before = {p.name for p in server.folder.iterdir()}
    said = typed(server, command.replace("ws/cases/broken_here", "broken"), status=2)
    assert said.startswith("terrapin: broken/case.toml:")
    assert "model.base: found 'nonsense'" in said
    assert said.count("\n") == 1
    assert {p.name for p in server.folder.iterdir()} - {"bin"} == before - {"bin"}


def test_an_example_is_copied(server: Server) -> None:
    typed(server, "terrapin case example heated_motor --to an_example")
    assert (server.folder / "an_example" / "runs.csv").read_bytes() == HEATED
    assert "expected one of" in typed(server, "terrapin case example nobody --to other", status=2)


def test_making_a_case_is_cancelled_and_leaves_nothing(server: Server) -> None:
    lines = "".join(f"r{i // 4000},{2.0 + i % 7},{100 + i % 11}\n" for i in range(800_000))
    upload = good(server, "long.csv", f"run,shell_speed,motor_current\n{lines}".encode())
    body = order(
        "cancelled", upload["id"], effects=[],
        columns={
            "omega": {"column": "shell_speed", "unit": "rad/s"}, "current": {"column": "motor_current", "unit": "mA"},
        },
    )  # fmt: skip
    before = {path for path in server.files() if not path.startswith("jobs")}
    job = server.ask("POST", "/api/cases", body).json["id"]
    assert server.ask("POST", "/api/cases", body).status == 409
    wait_for(lambda: "reading the case ..." in server.get(f"/api/jobs/{job}")["progress"])
    assert server.ask("DELETE", f"/api/jobs/{job}").json["state"] == "cancelled"
    assert {path for path in server.files() if not path.startswith("jobs")} == before
    assert server.ask("DELETE", f"/api/uploads/{upload['id']}").status == 200


def test_more_rows_than_a_case_may_have_are_refused_before_they_are_read(server: Server) -> None:
    upload = good(server, "huge.csv", b"w,i\n" + b"1,2\n" * 2_000_100)
    columns = {"omega": {"column": "w", "unit": "rad/s"}, "current": {"column": "i", "unit": "mA"}}
    job = made(server, order("huge", upload["id"], run="", effects=[], columns=columns))
    assert "expected at most 2000000: take one of 2 (--every 2)" in job["error"]
    assert "reading the case ..." not in job["progress"]
    server.ask("DELETE", f"/api/uploads/{upload['id']}")


def test_a_mapping_that_is_half_done_is_kept_until_its_case_is_made(server: Server) -> None:
    upload = good(server, "runs.csv", HEATED)
    draft = {
        "uploads": [upload["id"]], "base": "rolling_steady", "fields": {"name": "kept_draft"},
        "columns": [{"column": "winding", "name": "temperature", "unit": "degC", "sigma": "0,1"}],
        "constants": {"load": "18."},
    }  # fmt: skip
    path = f"/api/uploads/{upload['id']}/draft"
    assert server.ask("PUT", path, draft).status == 200
    assert server.get("/api/uploads?drafts=true")[0]["draft"] == draft
    assert server.ask("PUT", path, {**draft, "more": 1}).status == 422
    assert server.ask("PUT", "/api/uploads/0123456789ab/draft", draft).status == 404
    assert made(server, order("kept_draft", upload["id"], base="nonsense"))["state"] == "failed"
    assert server.get(f"/api/uploads/{upload['id']}/preview")["draft"] == draft
    assert made(server, order("kept_draft", upload["id"]))["state"] == "done"
    assert upload["id"] not in [one["id"] for one in server.get("/api/uploads?drafts=true")]

    file = server.workspace / "cases" / "kept_draft" / "case.toml"
    case = file.read_bytes()
    assert server.get("/api/cases/kept_draft/steps") == {"undo": 0, "redo": 0, "map": 1}
    held = server.wait(server.start("kept_draft", do="hold", runs=["r01"]))
    assert held["state"] == "done", held
    assert server.get("/api/cases/kept_draft/steps") == {"undo": 1, "redo": 0, "map": 0}
    assert server.ask("POST", "/api/cases/kept_draft/unmap").status == 409
    assert server.wait(server.start("kept_draft", do="undo"))["state"] == "done"
    assert server.ask("POST", "/api/cases/kept_draft/unmap").status == 200  # the making of it is taken back
    assert not file.parent.exists()
    assert server.get(f"/api/uploads/{upload['id']}/preview")["draft"] == draft
    assert server.ask("POST", "/api/cases/kept_draft/unmap").status == 404
    assert made(server, order("kept_draft", upload["id"]))["state"] == "done"
    assert file.read_bytes() == case
    assert server.ask("DELETE", f"/api/uploads/{upload['id']}").status == 200
    assert server.get("/api/cases/kept_draft/steps")["map"] == 0  # of what was uploaded nothing is left


NAMES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True)
LINES = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1, max_size=12)
UNITS = st.sampled_from(["", "N m", "rad/s", "m/s^2"])
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
LIMITS = st.one_of(NUMBERS, st.sampled_from(["80 mm", "-1 N m"]))
ORDERS = st.fixed_dictionaries(
    {
        "title": LINES, "base": NAMES, "effects": st.lists(NAMES, max_size=2),
        "columns": st.dictionaries(
            NAMES,
            st.fixed_dictionaries(
                {
                    "column": LINES, "unit": UNITS,
                    "sigma": st.none() | st.floats(min_value=1e-300, max_value=1e300) | st.just("5 mA"),
                }
            ),
            min_size=1, max_size=3,
        ),
        "parameters": st.dictionaries(NAMES, st.booleans() | LIMITS, max_size=3),
        "fit": st.dictionaries(
            NAMES,
            st.fixed_dictionaries(
                {"value": NUMBERS, "min": st.none() | NUMBERS, "max": st.none() | NUMBERS, "unit": UNITS}
            ),
            max_size=3,
        ),
        "equation": st.dictionaries(NAMES, LINES, max_size=2),
        "states": st.dictionaries(
            NAMES, st.fixed_dictionaries({"initial": st.sampled_from(["fit", "x_0"]) | NUMBERS, "unit": UNITS}),
            max_size=2,
        ),
        "derivative": st.dictionaries(NAMES, LINES, max_size=2), "measured": st.dictionaries(NAMES, LINES, max_size=2),
        "limits": st.dictionaries(
            NAMES, st.fixed_dictionaries({"min": LIMITS, "max": LIMITS, "unit": UNITS}), max_size=2
        ),
        "run": st.just("") | LINES, "train": st.lists(LINES, max_size=2), "test": st.lists(LINES, max_size=2),
        "every": st.integers(1, 1_000_000), "period": st.sampled_from(["10 ms", "0.5 s"]),
        "read": st.dictionaries(NAMES, LINES, max_size=2),
    }
)  # fmt: skip
OPTIONS = {
    "title": "title", "base": "base", "effect": "effects", "column": "columns", "unit": "units", "noise": "noises",
    "constant": "constants", "fit": "fits", "equation": "equations", "state": "states",
    "derivative": "derivatives", "measured": "measured", "limit": "limits", "run": "run",
    "train": "train", "test": "test", "every": "every", "period": "period", "read": "readings",
}  # fmt: skip


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(ORDERS)
def test_an_order_survives_the_command_line(wanted: dict[str, Any]) -> None:
    given_: dict[str, Any] = {
        "title": "", "base": "", "run": "", "period": "10 ms", "every": 1,
        **{key: [] for key in OPTIONS.values() if key not in ("title", "base", "run", "period", "every")},
    }  # fmt: skip
    first, file, to, *options = arguments(wanted, ["a.csv"], "", "my_case")
    assert (first, file, to) == ("case", "a.csv", "--to=my_case")
    for option in options:
        name, _, value = option.removeprefix("--").partition("=")
        key = OPTIONS[name]
        given_[key] = (
            [*given_[key], value] if isinstance(given_[key], list) else int(value) if key == "every" else value
        )
    found = read(**given_)
    assert json.loads(json.dumps(found)) == json.loads(json.dumps(wanted))


@pytest.mark.parametrize(
    ("option", "text", "words"),
    [
        ("columns", "omega", "--column: found 'omega', expected NAME=VALUE"),
        ("columns", "o m=w", "--column: found 'o m=w'"),
        ("columns", "omega=v", "--column: found omega twice"),
        ("units", "load=N", "--unit: found load, expected one of omega"),
        ("noises", "omega=1,5", "--noise: found 1,5, expected a number above 0"),
        ("noises", "omega=-1", "--noise: found -1, expected a number above 0"),
        ("noises", "omega=-1 rpm", "--noise: found -1, expected a number above 0"),
        ("fits", "k=1:2", "--fit: found k=1:2, expected k=START[:MIN:MAX[:UNIT]]"),
        ("fits", "k=one", "expected numbers in k=START"),
        ("fits", "k=nan", "expected numbers in k=START"),
        ("fits", "k=::1", "expected k=START"),
        ("limits", "omega=1", "--limit: found omega=1, expected omega=MIN:MAX[:UNIT]"),
        ("states", "x=:m", "--state: found x=:m, expected x=INITIAL[:UNIT]"),
        ("every", 0, "--every: found 0"),
    ],
)
def test_what_is_wrong_in_an_option_is_said_of_it(option: str, text: Any, words: str) -> None:
    given_: dict[str, Any] = {
        "title": "", "base": "equation", "run": "", "period": "10 ms", "every": 1, "columns": ["omega=w"],
        **{key: [] for key in ("effects", "units", "noises", "constants", "fits", "equations", "limits")},
        "train": [], "test": [], "readings": [], "states": [], "derivatives": [], "measured": [],
    }  # fmt: skip
    given_[option] = [*given_[option], text] if isinstance(given_[option], list) else text
    with pytest.raises(UserError) as found:
        read(**given_)
    assert words in str(found.value)
