"""The application: routes, static files, the answers to errors, and the description of the API.

Each module of ROUTES has a `router`, and may have `async def begin(context)` and `async def end(context)`, awaited when
the server starts and ends.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse
from starlette.exceptions import HTTPException

from terrapin_tools.errors import UserError
from terrapin_tools.web.cases import cases_api, jobs_api, new_case, view_api
from terrapin_tools.web.live import live_api
from terrapin_tools.web.service import events, uploads
from terrapin_tools.web.service.bounds import Sockets
from terrapin_tools.web.service.context import Context
from terrapin_tools.web.service.events import Events
from terrapin_tools.web.service.jobs import Jobs
from terrapin_tools.web.service.security import COOKIE, Door
from terrapin_tools.web.service.warm import Busy, Warm
from terrapin_tools.web.service.workspace import NotThere, Taken, Workspace
from terrapin_tools.web.simulate import batch_api, simulate_api

__all__ = ["application"]

ROUTES = (cases_api, new_case, jobs_api, uploads, events, view_api, live_api, simulate_api, batch_api)
STATUS = {NotThere: 404, Taken: 409, Busy: 503, uploads.TooLarge: 413, uploads.NoSpace: 507}
STATIC = Path(__file__).parent / "static"
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".ico": "image/x-icon",
    ".woff2": "font/woff2",
    ".json": "application/json",
}


def application(workspace: Workspace, token: str, link: str, port: int) -> Door:
    """The whole server as an ASGI application behind its door."""
    cookie = f"{COOKIE}_{port}"  # two servers on this machine do not overwrite each other's

    @asynccontextmanager
    async def life(app: FastAPI) -> AsyncIterator[None]:
        told = Events()
        warm = Warm([workspace.lock])
        await warm.ready()  # nobody's first request waits for imports
        context = Context(workspace, Jobs(workspace, warm, told), told, warm, link)
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

    async def user(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, UserError)
        status = STATUS.get(type(error), 500 if error.status == 1 else 422)
        return say(status, str(error), {"retry-after": "1"} if status == 503 else None)

    async def invalid(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, RequestValidationError)
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"] if part != "body") or "body"
        return say(422, f"{place}: {first['msg']}"[:300])

    async def refused(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, HTTPException)
        return say(error.status_code, f"{request.url.path[:200]}: {error.detail}", error.headers)

    async def system(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, OSError)
        return say(507 if error.errno in (28, 122) else 500, f"{error.strerror or error}")

    async def other(request: Request, error: Exception) -> JSONResponse:
        return say(500, f"internal error: {type(error).__name__}; the server's terminal says more")

    app.add_exception_handler(UserError, user)
    app.add_exception_handler(RequestValidationError, invalid)
    app.add_exception_handler(HTTPException, refused)
    app.add_exception_handler(OSError, system)
    app.add_exception_handler(Exception, other)


def _static(app: FastAPI, token: str, cookie: str) -> None:
    """The page and its files. A path is looked up among the files that are there and never becomes part of a path."""

    @app.get("/", include_in_schema=False)
    async def index(request: Request) -> Response:
        response = _file("index.html", request)
        if any(hmac.compare_digest(v.encode(), token.encode()) for v in request.query_params.getlist("token")):
            response.set_cookie(cookie, token, httponly=True, samesite="strict", path="/")
        return response

    @app.get("/static/{path:path}", include_in_schema=False)
    async def static(path: str, request: Request) -> Response:
        return _file(path, request)

    @app.get("/{path}", include_in_schema=False)
    async def beside(path: str, request: Request) -> Response:
        return _file(path, request)


def _file(name: str, request: Request) -> Response:
    files = {path.relative_to(STATIC).as_posix(): path for path in STATIC.rglob("*") if path.suffix in KINDS}
    if name not in files:
        raise HTTPException(404, "found nothing of that name")
    path = files[name]
    stat = path.stat()
    tag = '"' + hashlib.sha256(f"{stat.st_mtime_ns}-{stat.st_size}".encode()).hexdigest()[:24] + '"'
    headers = {"etag": tag, "cache-control": "no-cache"}
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=headers)
    return FileResponse(path, media_type=KINDS[path.suffix], headers=headers)
