"""What a case was mapped from, kept with it, so that the making of it can be taken back."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from terrapin_tools.web.service.context import Context
from terrapin_tools.web.service.uploads import Draft, upload_file
from terrapin_tools.web.service.workspace import NotThere
from terrapin_tools.workbench.files.writing import write_whole

__all__ = ["keep_mapping", "mapping_of"]

MAPPED = Path(".terrapin") / "mapped.json"


def keep_mapping(case: Path, uploads: Sequence[str], draft: dict[str, Any] | None) -> None:
    """Keep what was typed, and what case.toml came of it; nothing where nothing was typed or it cannot be written."""
    if draft is None:
        return
    entry = {"case": _digest(case), "draft": {**draft, "uploads": list(uploads)}}
    try:
        (case / MAPPED).parent.mkdir(exist_ok=True)
        write_whole(case / MAPPED, json.dumps(entry) + "\n")
    except OSError:  # the case stands; its making cannot be taken back
        return


def mapping_of(context: Context, case: Path) -> Draft | None:
    """What was typed, while case.toml is what came of it and the files that it was made of are here."""
    try:
        entry = json.loads((case / MAPPED).read_text(encoding="utf-8"))
        if entry["case"] != _digest(case):
            return None
        draft = Draft(**entry["draft"])
        return draft if all(upload_file(context.workspace, one).is_file() for one in draft.uploads) else None
    except (OSError, ValueError, KeyError, TypeError, ValidationError, NotThere):
        return None


def _digest(case: Path) -> str:
    return hashlib.sha256((case / "case.toml").read_bytes()).hexdigest()
