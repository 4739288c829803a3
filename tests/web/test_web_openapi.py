"""The server against its own description: schemathesis makes requests from it, right ones and wrong ones."""

from __future__ import annotations

import os
from typing import Any

import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis import GenerationMode
from schemathesis.config import SchemathesisConfig
from schemathesis.specs.openapi.checks import positive_data_acceptance
from serving import Server

EXAMPLES = int(os.environ.get("TERRAPIN_WEB_EXAMPLES", "2"))  # a route and kind; more by hand
LONG = ("/api/live", "/api/simulate")  # what they begin goes on: tested by hand in their own files
CONTENT = ("POST /api/uploads",)  # a description cannot say what makes a file a table


def described(server: Server) -> Any:
    document = server.get("/api/openapi.json")
    document["paths"] = {path: item for path, item in document["paths"].items() if not path.startswith(LONG)}
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
        case.call_and_validate(headers=headers, excluded_checks=excluded, timeout=60)

    ask()


def test_requests_made_from_the_description(server: Server) -> None:
    """No answer but those that are described, no error of the server's own, nothing wrong accepted."""
    operations = [result.ok() for result in described(server).get_all_operations()]
    assert len(operations) > 15
    before = len(server.errors())  # a library tells what other tests sent it
    for operation in operations:
        excluded = [positive_data_acceptance] if f"{operation.method.upper()} {operation.path}" in CONTENT else []
        for mode in (GenerationMode.POSITIVE, GenerationMode.NEGATIVE):
            asked(server, operation, mode, excluded)
    assert server.process.poll() is None
    assert "Traceback" not in server.errors()[before:]
