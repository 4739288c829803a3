"""GET /api/cases/{name}/view on a running server: the same as the functions say, kept, and refused in one line."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator

import pytest
from serving import Server

from terrapin_tools.web.cases.view import draft, view


@pytest.fixture(scope="module")
def heated(server: Server) -> Iterator[str]:
    """A copy of the example under a name of this file's own."""
    name = "heated_for_view"
    server.ask("POST", "/api/examples/heated_motor")
    shutil.copytree(server.workspace / "cases" / "heated_motor", server.workspace / "cases" / name)
    yield name
    server.ask("DELETE", f"/api/cases/{name}")


def test_the_server_answers_what_the_functions_say(server: Server, heated: str) -> None:
    folder = server.workspace / "cases" / heated
    assert server.get(f"/api/cases/{heated}/view?draft=true") == draft(folder)
    assert server.get(f"/api/cases/{heated}/view") == view(folder)


def test_a_preview_falls_to_the_floor(server: Server, heated: str) -> None:
    found = server.get(f"/api/cases/{heated}/view?effect=motor_heating")
    assert found["heldout_error"] == pytest.approx(1.10, abs=0.01)
    assert len(found["channels"]["current"]) == 72


def test_another_model_of_the_case_and_an_own_effect_before_it_is_added(server: Server, heated: str) -> None:
    """The base model alone is the first rung; an own formula like a known effect predicts what that does."""
    ladder = server.get(f"/api/cases/{heated}/view")["plot"]["ladder"]
    base = server.get(f"/api/cases/{heated}/view?whole=true")
    assert base["heldout_error"] == pytest.approx(ladder[0]["heldout_error"], rel=1e-6)
    same = server.get(f"/api/cases/{heated}/view?whole=true&effect=speed_squared")
    assert same["heldout_error"] == pytest.approx(ladder[1]["heldout_error"], rel=1e-6)
    assert server.ask("GET", f"/api/cases/{heated}/view?whole=true&effect=motor_heating").status == 422
    known = server.get(f"/api/cases/{heated}/view?effect=viscous_friction")
    parameters = {"k": {"value": 0.0, "unit": "N m s/rad"}}
    body = {"effect": "drag", "expression": "k * omega", "target": "", "parameters": parameters}
    own = server.ask("POST", f"/api/cases/{heated}/draw", body)
    assert own.status == 200, own.body
    assert own.json["heldout_error"] == pytest.approx(known["heldout_error"], rel=1e-3)
    assert server.ask("POST", f"/api/cases/{heated}/draw", {**body, "expression": "k *"}).status == 422


def test_what_is_asked_for_again_is_not_computed_again(server: Server, heated: str) -> None:
    """Other numbers behind the server's back, in a file of the same size and time, are not noticed; its time is."""
    runs = server.workspace / "cases" / heated / "runs.csv"
    first, before, text = server.get(f"/api/cases/{heated}/view"), runs.stat(), runs.read_text()
    head, _, rows = text.partition("\n")
    try:
        runs.write_text(head + "\n" + rows.translate(str.maketrans("78", "87")))
        os.utime(runs, ns=(before.st_atime_ns, before.st_mtime_ns))
        assert server.get(f"/api/cases/{heated}/view") == first
        os.utime(runs)
        assert server.get(f"/api/cases/{heated}/view") != first
    finally:
        runs.write_text(text)
        os.utime(runs, ns=(before.st_atime_ns, before.st_mtime_ns))


def test_a_change_of_the_case_is_seen_at_once(server: Server, heated: str) -> None:
    job = server.wait(server.start(heated, do="add", effects=["motor_heating"]))
    assert job["state"] == "done"
    shown = server.get(f"/api/cases/{heated}/view")
    assert (shown["verdict"], shown["effects"]) == ("adequate", ["speed_squared", "motor_heating"])
    assert shown["history"][-1]["effects"] == ["motor_heating"]
    assert shown["plot"]["ladder"] == job["result"]["ladder"]
    server.wait(server.start(heated, do="remove", effect="motor_heating"))
    assert server.get(f"/api/cases/{heated}/view")["verdict"] == "missing"


@pytest.mark.parametrize(
    ("query", "status", "words"),
    [
        ("effect=speed_squared", 422, "found 'speed_squared', expected each once and of"),
        ("effect=../../etc", 422, "effect"),
        ("&".join(f"effect=e{i}" for i in range(9)), 422, "effect"),
        ("draft=perhaps", 422, "draft"),
    ],
)
def test_what_cannot_be_shown_is_one_line(server: Server, heated: str, query: str, status: int, words: str) -> None:
    answer = server.ask("GET", f"/api/cases/{heated}/view?{query}")
    assert answer.status == status
    assert words in answer.detail


def test_no_such_case(server: Server) -> None:
    assert server.ask("GET", "/api/cases/nobody/view").status == 404


def test_a_broken_case_says_where(server: Server, heated: str) -> None:
    folder = server.workspace / "cases" / "broken_for_view"
    shutil.copytree(server.workspace / "cases" / heated, folder)
    text = (folder / "case.toml").read_text(encoding="utf-8")
    (folder / "case.toml").write_text(text.replace('"rolling_steady"', '"rolling_unsteady"'), encoding="utf-8")
    for path in ("view", "view?draft=true", "view?effect=motor_heating"):
        answer = server.ask("GET", f"/api/cases/broken_for_view/{path}")
        assert answer.status == 422
        assert "model.base: found 'rolling_unsteady'" in answer.detail
    shutil.rmtree(folder)
