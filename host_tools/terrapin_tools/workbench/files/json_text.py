"""JSON as every answer is written: numbers that are not finite become null."""

from __future__ import annotations

import json
import math
from typing import Any

__all__ = ["finite", "to_json"]


def to_json(answer: dict[str, Any]) -> str:
    """The answer as JSON text: two spaces of indent, a line feed at the end, null for a number that is not finite."""
    return json.dumps(finite(answer), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def finite(value: Any) -> Any:
    """The value with null for every number in it that is not finite, which JSON does not know."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
