"""Files of robots and boards for tests: the shipped ones with fields changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import tomlkit

from terrapin_interface.robot import find_robot

__all__ = ["BOARD", "Change", "set_fields", "with_board"]

Change = dict[str, Any]
BOARD = find_robot("cylinder").parent / "boards" / "f405_h_bridge.toml"


def set_fields(path: Path, source: Path, changes: Change) -> Path:
    """A copy of a TOML file with fields set, or taken out (None)."""
    document: Any = tomlkit.parse(source.read_text(encoding="utf-8"))
    for key, value in changes.items():
        *tables, last = key.split(".")
        table = document
        for part in tables:
            if part not in table:
                table[part] = tomlkit.table()
            table = table[part]
        if value is None:
            del table[last]
        else:
            table[last] = value
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
    return path


def with_board(folder: Path, board: Change, robot: Change | None = None, like: str = "cylinder") -> Path:
    """A robot's file on the shipped board changed, as a board of its own: mine.toml, number 100."""
    set_fields(folder / "mine.toml", BOARD, {"number": 100, **board})
    return set_fields(folder / "robot.toml", find_robot(like), {"board": "mine.toml", **(robot or {})})
