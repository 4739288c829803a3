"""What the commands keep of a case in its folder .terrapin: the last answer of discover, and what was added or removed.

An answer is kept with the state that it is about (a hash of case.toml, every file of data, and the program that found
it), so that nobody shows it for another.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
import tomllib
from pathlib import Path
from typing import Any

from terrapin_hil import paths
from terrapin_tools.workbench.files.json_text import to_json
from terrapin_tools.workbench.files.writing import write_whole

__all__ = ["case_state", "history", "keep", "recall", "remember"]

FOLDER = ".terrapin"
HISTORY = "history.jsonl"
HISTORY_LIMIT = 200  # entries


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
