"""GET /api/cases/{name}/view: what the Workbench tab draws of a case, kept while the files stay the same."""

from __future__ import annotations

import asyncio
import hashlib
import tomllib
from collections import OrderedDict
from pathlib import Path as File
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query

from terrapin_tools.errors import UserError
from terrapin_tools.web.cases.all_rows import Box, within
from terrapin_tools.web.cases.mapping import mapping_of
from terrapin_tools.web.service import models
from terrapin_tools.web.service.context import Context, Terrapin
from terrapin_tools.web.service.models import problems
from terrapin_tools.web.service.workspace import NAME
from terrapin_tools.workbench.case import history

__all__ = ["router", "state_of"]

KEPT = 24  # answers; one is at most some 2 MB
MOST_EFFECTS = 8  # of one preview
SECONDS = 300.0  # that a view may take

router = APIRouter()
_kept: OrderedDict[tuple[Any, ...], asyncio.Task[dict[str, Any]]] = OrderedDict()


def state_of(folder: File) -> tuple[tuple[str, int, int], ...]:
    """Names, times and sizes of the files that a view stands on. OSError or ValueError when case.toml is not read."""
    data = tomllib.loads((folder / "case.toml").read_text(encoding="utf-8-sig")).get("data", {})
    kept = (".terrapin/discover.json", ".terrapin/discover.state", ".terrapin/history.jsonl")
    names = ["case.toml", *map(str, data.get("files", [])), *kept]
    found = []
    for name in names:
        try:
            status = (folder / name).stat()
        except OSError:
            continue
        found.append((name, status.st_mtime_ns, status.st_size))
    return tuple(found)


async def _key(folder: File, function: str, *arguments: Any) -> tuple[Any, ...]:
    """What an answer is kept by; empty for a broken case, of which the function says in which line."""
    try:
        return (function, str(folder), *map(str, arguments), await asyncio.to_thread(state_of, folder))
    except (OSError, ValueError, TypeError, AttributeError):
        return ()


def _rows_of(context: Context, key: tuple[Any, ...]) -> File:
    """Where all rows of an answer are that thins them."""
    return context.workspace.folder("rows") / f"{hashlib.sha256(repr(key).encode()).hexdigest()[:24]}.npy"


async def _answer(context: Context, folder: File, function: str, *arguments: Any) -> dict[str, Any]:
    """What a function of view.py says of the case; whoever asks for the same at the same time waits for the same."""
    key = await _key(folder, function, *arguments)
    if key and function in ("draft", "view"):
        arguments = (str(_rows_of(context, key)),)
    task = _kept.get(key)
    if task is None:
        call = context.warm.call(f"terrapin_tools.web.cases.view:{function}", str(folder), *arguments, seconds=SECONDS)
        task = asyncio.create_task(call)
        if key:
            _kept[key] = task
            while len(_kept) > KEPT:
                _kept.popitem(last=False)
    else:
        _kept.move_to_end(key)
    try:
        return await asyncio.shield(task)
    except BaseException:
        if task.done() and _kept.get(key) is task:  # it failed: who asks again has another try
            del _kept[key]
        raise


@router.get("/api/cases/{name}/view", responses=problems(404))
async def case_view(
    context: Terrapin,
    name: Annotated[str, Path(pattern=NAME)],
    draft: bool = False,
    effect: Annotated[list[Annotated[str, Query(pattern=NAME)]] | None, Query(max_length=MOST_EFFECTS)] = None,
    whole: bool = False,
) -> dict[str, Any]:
    """Verdict, plots, ranking and ladder of a case; with `effect` (repeat for more) the curve with them added.

    With `draft` the plot alone, which is there sooner. With `whole` the effects are all that the model has: another
    model of the case, to be held against its own; with none of them the base model.
    """
    folder = context.workspace.case(name)
    if draft and not effect and not whole:
        return await _answer(context, folder, "draft")
    shown = await _answer(context, folder, "view")
    if not effect and not whole:
        return shown
    return await _answer(context, folder, "preview", effect or [], *_drawn(shown), whole)


def _drawn(shown: dict[str, Any]) -> tuple[dict[str, float], list[int]]:
    """Noise sd by channel, and the rows that a view draws."""
    noise = {channel: entry["noise_sd"] for channel, entry in shown["channels"].items()}
    return noise, [row - 1 for row in shown["plot"]["columns"]["row"]["values"]]


@router.get("/api/cases/{name}/rows", responses=problems(404))
async def case_rows(
    context: Terrapin, name: Annotated[str, Path(pattern=NAME)], box: Annotated[models.RowsQuery, Query()]
) -> dict[str, Any]:
    """The rows in a box of a plot that is thinned: all of them, or MOST_ROWS; what the page draws once it is zoomed."""
    folder, function = context.workspace.case(name), "draft" if box.draft else "view"
    wanted = Box(box.variable, box.times, box.channel, box.residual, (box.left, box.right), (box.bottom, box.top))
    for _ in range(2):
        shown = await _answer(context, folder, function)
        if shown["plot"]["kept"] == shown["plot"]["rows"]:
            raise UserError("rows: all of them are in the view, expected a plot that is thinned")
        key = await _key(folder, function)
        try:
            return await asyncio.to_thread(within, _rows_of(context, key), shown["plot"], wanted)
        except FileNotFoundError:
            _kept.pop(key, None)  # it has made way for others: made once more
    raise UserError("rows: they are gone, expected the page reloaded")


@router.post("/api/cases/{name}/draw", responses=problems(404))
async def draw(context: Terrapin, name: Annotated[str, Path(pattern=NAME)], body: models.DrawRequest) -> dict[str, Any]:
    """What the model would predict with an effect of one's own, fitted, before it is added; nothing is written."""
    folder = context.workspace.case(name)
    shown = await _answer(context, folder, "view")
    own = {**body.model_dump(), "effect": None}
    return await _answer(context, folder, "preview", [body.effect], *_drawn(shown), False, own)


@router.get("/api/cases/{name}/steps", responses=problems(404))
async def case_steps(context: Terrapin, name: Annotated[str, Path(pattern=NAME)]) -> dict[str, int]:
    """How many changes of the case can be undone, and how many that were undone can be done again; `map`: whether the
    making of it can be taken back (POST unmap)."""
    folder = context.workspace.case(name)
    found = await asyncio.to_thread(history.steps, folder)
    return {**found, "map": int(await asyncio.to_thread(mapping_of, context, folder) is not None)}
