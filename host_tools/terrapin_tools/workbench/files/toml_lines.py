"""Where a key stands in a TOML file, so that a complaint can name the line."""

from __future__ import annotations

import re

from terrapin_hil.reading import key_parts

__all__ = ["locate"]

_HEADER = re.compile(r"\s*\[{1,2}\s*([^\[\]]+?)\s*\]{1,2}\s*(?:#.*)?$")


def locate(text: str, *path: str) -> int:
    """Line (from 1) of the deepest part of `path` that the text has; 1 when it has none of it.

    >>> locate("[data]\\nrun = 'run'\\n[data.columns]\\nomega = { unit = 'rpm' }\\n", "data", "columns", "omega")
    4
    """
    best, best_depth = 1, 0
    table: tuple[str, ...] = ()
    for number, line in enumerate(text.splitlines(), 1):
        header = _HEADER.match(line)
        if header:
            table = key_parts(header.group(1))
            here = table
        else:
            key, equals, _ = line.partition("=")
            if not equals or key.lstrip().startswith("#"):
                continue
            here = (*table, *key_parts(key))
        depth = len(here) if here == path[: len(here)] else 0
        if depth > best_depth:
            best, best_depth = number, depth
    return best
