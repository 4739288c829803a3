"""A case of the user's own differential equations by POST /api/cases: what case.toml says, and how it is refused."""

from __future__ import annotations

import json
import tomllib
from copy import deepcopy
from typing import Any

import pytest
from carts import ORDER, cart
from serving import Server
from test_web_commands import typed
from test_web_uploads import good, made


def body(name: str, upload: str, **changes: Any) -> dict[str, Any]:
    return {"name": name, "uploads": [upload], **deepcopy(ORDER), **changes}


@pytest.fixture(scope="module")
def upload(server: Server) -> str:
    return str(good(server, "cart.csv", cart(4, 60))["id"])


def test_own_equations_become_a_case_that_is_compared(server: Server, upload: str) -> None:
    ordered = body("cart", upload)
    told = server.ask("POST", "/api/command", ordered).json["command"]
    assert "'--derivative=v=(force - d*v)/m' --measured=position=x" in told
    job = made(server, ordered)
    assert job["state"] == "done", job["error"]
    text = (server.workspace / "cases" / "cart" / "case.toml").read_text()
    model = tomllib.loads(text)["model"]
    assert model == {
        "base": "ode", "effects": [], "derivative": ordered["derivative"], "measured": {"position": "x"},
        "states": {"x": {"initial": "fit", "unit": "m"}, "v": {"initial": 0.0, "unit": "m/s"}},
    }  # fmt: skip
    typed(server, told.replace("ws/cases/cart", "cart_by_hand"))
    assert (server.folder / "cart_by_hand" / "case.toml").read_text() == text
    assert server.wait(server.start("cart", do="compare"))["state"] == "done"
    assert server.get("/api/cases/cart")["answer"]["verdict"] == "missing"


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"states": {f"x_{i}": {} for i in range(9)}}, "states"),
        ({"states": {"x y": {}}}, "states"),
        ({"states": {"x": {"initial": "the first"}}}, "states.x.initial"),
        ({"states": {"x": {"start": 1.0}}}, "states.x.start"),
        ({"derivative": {"x": "v\nw"}}, "derivative.x"),
        ({"measured": {"position": ""}}, "measured.position"),
    ],
)
def test_what_the_request_cannot_be_is_refused_where_it_stands(
    server: Server, upload: str, changes: dict[str, Any], where: str
) -> None:
    answer = server.ask("POST", "/api/cases", body("refused", upload, **changes))
    assert answer.status == 422
    assert where in answer.json["detail"]
    assert "\n" not in json.loads(answer.body)["detail"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"base": "equation", "equation": {"position": "d*force"}}, 'model.states: expected only with base = "ode"'),
        ({"columns": {k: v for k, v in ORDER["columns"].items() if k != "time"}}, "time"),
        ({"states": {"x": {}}}, "model.derivative.v: no state has this name, expected one of x"),
        (
            {"states": {"x": {"initial": "nobody"}, "v": {}}},
            "model.states.x.initial: found 'nobody', expected a number",
        ),
        ({"derivative": {"x": "v", "v": "(force - c*v)/m"}}, "model.derivative.v: c is no state, column, parameter"),
        ({"measured": {}}, "model.measured: missing, expected one line CHANNEL = FORMULA"),
        ({"measured": {"position": "v"}}, "model.measured.position:"),
    ],
)
def test_what_cannot_be_a_case_is_said_in_one_line(
    server: Server, upload: str, changes: dict[str, Any], words: str
) -> None:
    job = made(server, body("broken", upload, **changes))
    assert job["state"] == "failed"
    assert words in job["error"]
    assert "\n" not in job["error"]
    assert not (server.workspace / "cases" / "broken").exists()
