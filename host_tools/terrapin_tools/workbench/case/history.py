"""What the commands keep of a case in its folder .terrapin: the last answer of discover, what was added or removed, and
each case.toml that a command changed, to step back to.

An answer is kept with the state that it is about (a hash of case.toml, every file of data, and the program that found
it), so that nobody shows it for another.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

from terrapin_hil import paths
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.json_text import to_json
from terrapin_tools.workbench.files.writing import write_changed, write_whole

__all__ = ["case_state", "history", "keep", "recall", "remember", "rewrite", "step", "steps"]

FOLDER = ".terrapin"
HISTORY = "history.jsonl"
HISTORY_LIMIT = 200  # entries
VERSIONS = "versions"
VERSIONS_LIMIT = 100  # that can be stepped back to, and as many forward


def case_state(folder: Path) -> str:
    """Hash of case.toml, the measurements that it names, and this program. OSError when one cannot be read."""
    text = (folder / "case.toml").read_bytes()
    data = tomllib.loads(text.decode("utf-8-sig")).get("data", {})
    digest = hashlib.sha256(text)
    digest.update(paths.program_hash(Path(__file__).parents[1], paths.PHYSICS).encode())
    names = [*data.get("files", []), *([data["dbc"]] if "dbc" in data else [])]
    for name in names:
        with (folder / str(name)).open("rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()


def keep(folder: Path, answer: dict[str, Any]) -> None:
    """Keep the answer of discover; a case on media that cannot be written is told of on standard error and goes on."""
    place = folder / FOLDER
    try:
        place.mkdir(exist_ok=True)
        write_whole(place / "discover.json", to_json(answer))
        write_whole(place / "discover.state", case_state(folder) + "\n")
    except OSError as error:
        reason = error.strerror or str(error)
        print(f"terrapin: {place}: {reason}; terrapin add will not know this answer", file=sys.stderr)


def recall(folder: Path) -> dict[str, Any] | None:
    """The last answer of discover if it is about the case as it stands now; a broken file is as good as none."""
    place = folder / FOLDER
    try:
        if (place / "discover.state").read_text(encoding="ascii").strip() != case_state(folder):
            return None
        answer = json.loads((place / "discover.json").read_text(encoding="utf-8"))
        return answer if isinstance(answer, dict) and "verdict" in answer and "candidates" in answer else None
    except (OSError, ValueError):
        return None


def remember(folder: Path, action: str, effects: list[str], answer: dict[str, Any]) -> None:
    """Append what `terrapin add` or `remove` did and the errors before and after; nothing when it cannot be written."""
    entry = {"action": action, "effects": effects, "before": answer["before"], "after": answer["after"]}
    place = folder / FOLDER
    try:
        place.mkdir(exist_ok=True)
        kept = _lines(folder)[1 - HISTORY_LIMIT :]  # as they are: what is damaged may be mended by hand
        write_whole(place / HISTORY, b"".join(line + b"\n" for line in [*kept, json.dumps(entry).encode()]))
    except OSError as error:
        reason = error.strerror or str(error)
        print(f"terrapin: {place}: {reason}; the report will not show this step", file=sys.stderr)


def history(folder: Path) -> list[dict[str, Any]]:
    """What was added and removed, oldest first; damaged lines are left out, and told on standard error."""
    lines = _lines(folder)
    found = [entry for line in lines if (entry := _entry(line)) is not None]
    if left := len(lines) - len(found):
        where = folder / FOLDER / HISTORY
        print(f"terrapin: {where}: {left} of {len(lines)} lines are damaged and left out", file=sys.stderr)
    return found


def _lines(folder: Path) -> list[bytes]:
    try:
        return (folder / FOLDER / HISTORY).read_bytes().splitlines()
    except OSError:
        return []


def _entry(line: bytes) -> dict[str, Any] | None:
    """A line as `remember` writes it; None for any other."""
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if not isinstance(entry, dict):
        return None
    effects = entry.get("effects")
    if not isinstance(entry.get("action"), str) or not isinstance(effects, list):
        return None
    sides = [entry.get(side) for side in ("before", "after")]
    right = all(isinstance(side, dict) and _is_error(side.get("heldout_error", "")) for side in sides)
    return entry if right and all(isinstance(name, str) for name in effects) else None


def _is_error(value: object) -> bool:
    return value is None or (isinstance(value, int | float) and math.isfinite(value))


# ---------------------------------------------------------------- back and forward


def rewrite(folder: Path, seen: str, text: str) -> None:
    """Gives a case another case.toml, made from `seen`, and keeps the one of before. UserError as `write_changed`."""
    before, lost = (folder / "case.toml").read_bytes(), ""
    try:
        _push(folder, "undo", before)
    except OSError as error:
        lost = error.strerror or str(error)
    write_changed(folder / "case.toml", seen, text)
    with suppress(OSError):
        for path in _versions(folder, "redo"):  # only now: a change that was refused takes no step away
            _drop(path)
    if lost:  # said of a step that was done
        print(f"terrapin: {folder / FOLDER}: {lost}; this step cannot be undone", file=sys.stderr)


def steps(folder: Path) -> dict[str, int]:
    """How many changes can be undone, and how many that were undone can be done again."""
    try:
        now = (folder / "case.toml").read_bytes()
        return {way: sum(path.read_bytes() != now for path in _versions(folder, way)) for way in ("undo", "redo")}
    except OSError:
        return {"undo": 0, "redo": 0}


def step(folder: Path, way: str) -> None:
    """`undo`: case.toml as it was before the last change, byte for byte, with the history of then; `redo`: as it was
    before the last undo. What stood there is kept for the way back. UserError when there is nothing of the kind."""
    now = (folder / "case.toml").read_bytes()
    found = _versions(folder, way)
    while found and found[-1].read_bytes() == now:  # of a change that was cancelled
        _drop(found.pop())
    if not found:
        raise UserError(f"{folder / 'case.toml'}: nothing to {way}, expected a change by a command before")
    text = found[-1].read_bytes()
    past = found[-1].with_suffix(".jsonl")
    lines = past.read_bytes() if past.is_file() else b""
    _push(folder, "redo" if way == "undo" else "undo", now)
    write_changed(folder / "case.toml", now, text)
    write_whole(folder / FOLDER / HISTORY, lines)
    _drop(found[-1])


def _versions(folder: Path, way: str) -> list[Path]:
    """Oldest first."""
    return sorted((folder / FOLDER / VERSIONS).glob(f"{way}-[0-9]*.toml"))


def _push(folder: Path, way: str, text: bytes) -> None:
    place = folder / FOLDER / VERSIONS
    place.mkdir(parents=True, exist_ok=True)
    there = _versions(folder, way)
    number = int(there[-1].stem.removeprefix(f"{way}-")) + 1 if there else 1
    write_whole(place / f"{way}-{number:09d}.jsonl", b"".join(line + b"\n" for line in _lines(folder)))
    write_whole(place / f"{way}-{number:09d}.toml", text)
    for path in there[: 1 - VERSIONS_LIMIT]:
        _drop(path)


def _drop(path: Path) -> None:
    path.unlink(missing_ok=True)
    path.with_suffix(".jsonl").unlink(missing_ok=True)
