"""The application: routes, static files, the answers to errors, and the description of the API.

Each module of ROUTES has a `router`, and may have `async def begin(context)` and `async def end(context)`, awaited when
the server starts and ends.
"""

from __future__ import annotations

import hmac
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import anyio.to_thread
from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException

from terrapin_tools.errors import UserError
from terrapin_tools.monitor.controls import NotNow
from terrapin_tools.web.cases import cases_api, jobs_api, new_case, view_api
from terrapin_tools.web.live import drive_api, flash_api, live_api
from terrapin_tools.web.service import events, uploads
from terrapin_tools.web.service.bounds import Sockets
from terrapin_tools.web.service.context import Context, NamedBus
from terrapin_tools.web.service.events import Events
from terrapin_tools.web.service.jobs import Jobs
from terrapin_tools.web.service.security import COOKIE, Door
from terrapin_tools.web.service.warm import Busy, Warm
from terrapin_tools.web.service.workspace import NotThere, Taken, Workspace
from terrapin_tools.web.simulate import batch_api, simulate_api

__all__ = ["application"]

ROUTES = (
    cases_api, new_case, jobs_api, uploads, events, view_api, live_api, drive_api, flash_api, simulate_api, batch_api,
)  # fmt: skip
STATUS = {NotThere: 404, Taken: 409, NotNow: 409, Busy: 503, uploads.TooLarge: 413, uploads.NoSpace: 507}
STATIC = Path(__file__).parent / "static"


def application(workspace: Workspace, token: str, bus: NamedBus, port: int) -> Door:
    """The whole server as an ASGI application behind its door."""
    cookie = f"{COOKIE}_{port}"  # two servers on this machine do not overwrite each other's

    @asynccontextmanager
    async def life(app: FastAPI) -> AsyncIterator[None]:
        told = Events()
        warm = Warm([workspace.lock])
        await warm.ready()  # nobody's first request waits for imports
        await anyio.to_thread.run_sync(int)  # nor for those of anyio, a fifth of a second
        context = Context(workspace, Jobs(workspace, warm, told), told, warm, bus)
        app.state.terrapin = context
        begun = []
        try:
            for part in ROUTES:
                if hasattr(part, "begin"):
                    await part.begin(context)
                begun.append(part)
            yield
        finally:
            told.close()
            for part in reversed(begun):
                if hasattr(part, "end"):
                    await part.end(context)
            await context.jobs.close()
            await warm.close()

    app = FastAPI(
        title="Terrapin",
        summary="The workbench in a browser: cases, jobs, uploads, live telemetry, simulation.",
        version="1",
        openapi_url="/api/openapi.json",
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
        lifespan=life,
    )
    for module in ROUTES:
        app.include_router(module.router)
    _describe(app, cookie)
    _complaints(app)
    _static(app, token, cookie)
    return Door(Sockets(app), token, uploads.STREAMED, cookie)


def _describe(app: FastAPI, cookie: str) -> None:
    """The OpenAPI description says how to show the token."""
    plain = app.openapi

    def described() -> dict[str, Any]:
        if not app.openapi_schema:
            schema = plain()
            schema.setdefault("components", {})["securitySchemes"] = {
                "token": {"type": "http", "scheme": "bearer", "description": "printed by `terrapin web`"},
                "cookie": {"type": "apiKey", "in": "cookie", "name": cookie},
            }
            schema["security"] = [{"token": []}, {"cookie": []}]
            app.openapi_schema = schema
        return app.openapi_schema

    app.openapi = described  # type: ignore[method-assign]


def _complaints(app: FastAPI) -> None:
    """Every error is {"detail": one line}."""

    def say(status: int, text: str, headers: Any = None) -> JSONResponse:
        line = "".join(c if c.isprintable() else c.encode("unicode_escape", "replace").decode() for c in text)
        line = line.encode("utf-8", "backslashreplace").decode()
        return JSONResponse({"detail": line[:2000]}, status, headers)

    async def complain(request: Request, error: Exception) -> JSONResponse:
        match error:
            case UserError():
                status = STATUS.get(type(error), 500 if error.status == 1 else 422)
                return say(status, str(error), {"retry-after": "1"} if status == 503 else None)
            case RequestValidationError():
                first = error.errors()[0]
                place = ".".join(str(part) for part in first["loc"] if part != "body") or "body"
                return say(422, f"{place}: {first['msg']}"[:300])
            case HTTPException():
                return say(error.status_code, f"{request.url.path[:200]}: {error.detail}", error.headers)
            case OSError():
                return say(507 if error.errno in (28, 122) else 500, f"{error.strerror or error}")
            case _:
                return say(500, f"internal error: {type(error).__name__}; the server's terminal says more")

    for kind in (UserError, RequestValidationError, HTTPException, OSError, Exception):
        app.add_exception_handler(kind, complain)


def _static(app: FastAPI, token: str, cookie: str) -> None:
    """The page and its files."""
    files = StaticFiles(directory=STATIC)
    app.mount("/static", files)

    @app.get("/", include_in_schema=False)
    async def index(request: Request) -> Response:
        response = await files.get_response("index.html", request.scope)
        if any(hmac.compare_digest(v.encode(), token.encode()) for v in request.query_params.getlist("token")):
            response.set_cookie(cookie, token, httponly=True, samesite="strict", path="/")
        return response
