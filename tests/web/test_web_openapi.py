"""The server against its own description: schemathesis makes requests from it, right ones and wrong ones."""

from __future__ import annotations

import os
from typing import Any

import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.config import SchemathesisConfig
from schemathesis.specs.openapi.checks import positive_data_acceptance
from serving import Server

EXAMPLES = int(os.environ.get("TERRAPIN_WEB_EXAMPLES", "2"))  # a route and kind; more by hand
LIVE = "/api/live"  # these act on what is watched
# A description cannot say what makes a file a table, which buses and logs there are, what fits a scenario.
CONTENT = ("POST /api/uploads", "POST /api/live", "POST /api/simulate", "POST /api/batches")
MACHINE = ("POST /api/live",)  # a bus that cannot be opened: 500 is described, and is no error of the server's


def described(server: Server) -> Any:
    document = server.get("/api/openapi.json")
    schema = schemathesis.openapi.from_dict(document, config=SchemathesisConfig.from_dict({"seed": 1}))
    schema.config.update(base_url=f"http://127.0.0.1:{server.port}")
    return schema


def test_description_is_complete(server: Server) -> None:
    """Every route says what it takes, what it gives, and how it refuses."""
    document = server.get("/api/openapi.json")
    assert document["security"]
    for path, methods in document["paths"].items():
        assert path.startswith("/api/"), path
        for method, operation in methods.items():
            where = f"{method} {path}"
            assert operation.get("summary"), where
            assert {"401", "403", "413", "422"} <= operation["responses"].keys(), where
            assert len([code for code in operation["responses"] if code.startswith("2")]) == 1, where
    for name in ("NewCase", "ExpressionRequest", "Compare", "Add"):
        assert document["components"]["schemas"][name]["additionalProperties"] is False, name


def asked(server: Server, operation: Any, mode: GenerationMode, excluded: list[Any]) -> None:
    """EXAMPLES requests of one kind to one route, each answer held against the description."""

    @settings(
        max_examples=EXAMPLES, derandomize=True, deadline=None, database=None, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(operation.as_strategy(mode))
    def ask(case: Any) -> None:
        headers = {"Authorization": f"Bearer {server.token}"}
        answer = case.call_and_validate(headers=headers, excluded_checks=excluded, timeout=300)
        assert b"internal error" not in answer.content

    ask()


def leave(server: Server) -> None:
    server.ask("POST", "/api/live/command", {"request": "release"})  # held in, it would keep what is watched
    assert server.ask("DELETE", "/api/live").status == 200


def watch_again(server: Server) -> None:
    """The simulator, from its start: there is something to record, to stop, to leave."""
    leave(server)
    assert server.ask("POST", "/api/live", {"source": "simulator:steady_sand"}).status == 200


def test_requests_made_from_the_description(server: Server) -> None:
    """No answer but those that are described, no error of the server's own, nothing wrong accepted."""
    operations = [result.ok() for result in described(server).get_all_operations()]
    assert len(operations) > 15
    before = len(server.errors())  # a library tells what other tests sent it
    for operation in operations:
        route = f"{operation.method.upper()} {operation.path}"
        excluded = [positive_data_acceptance] if route in CONTENT else []
        excluded += [not_a_server_error] if route in MACHINE else []
        for mode in (GenerationMode.POSITIVE, GenerationMode.NEGATIVE):
            if operation.path.startswith(LIVE):
                watch_again(server)
            asked(server, operation, mode, excluded)
    leave(server)
    assert server.process.poll() is None
    assert "Traceback" not in server.errors()[before:]
