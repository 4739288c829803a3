"""Changes to case.toml that keep the user's comments and order, written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import tomlkit

from host_tools.errors import UserError

__all__ = ["OwnEffect", "OwnParameter", "add_effects", "parse_parameter", "remove_effect", "write_whole"]


@dataclass(frozen=True)
class OwnParameter:
    """A parameter of the user's own expression."""

    value: float
    minimum: float | None = None
    maximum: float | None = None
    unit: str = "1"


@dataclass(frozen=True)
class OwnEffect:
    """An expression that becomes an effect."""

    expression: str
    target: str | None
    parameters: Mapping[str, OwnParameter] = field(default_factory=dict)


def parse_parameter(text: str) -> tuple[str, OwnParameter]:
    """`k=START`, `k=START:MIN:MAX` or `k=START:MIN:MAX:UNIT`; MIN and MAX may be empty for none.

    >>> parse_parameter("k=1e-3:0:1:N m")
    ('k', OwnParameter(value=0.001, minimum=0.0, maximum=1.0, unit='N m'))
    """
    name, equals, rest = text.partition("=")
    parts = rest.split(":", 3)
    if not equals or not name.strip().isidentifier() or len(parts) == 2:
        raise UserError(f"--parameter: found {text!r}, expected NAME=START:MIN:MAX[:UNIT]")
    try:
        start = float(parts[0])
        limits = [float(part) if part.strip() else None for part in parts[1:3]] or [None, None]
    except ValueError:
        raise UserError(f"--parameter: found {text!r}, expected numbers in NAME=START:MIN:MAX[:UNIT]") from None
    return name.strip(), OwnParameter(start, limits[0], limits[1], parts[3].strip() if len(parts) == 4 else "1")


def add_effects(text: str, names: Sequence[str], own: Mapping[str, OwnEffect]) -> str:
    """case.toml with the effects appended to the model, and a table for each of the user's own."""
    document = tomlkit.parse(text)
    model = document["model"]
    assert isinstance(model, tomlkit.items.Table)
    if "effects" not in model:
        model["effects"] = tomlkit.array()
    for name in names:
        model["effects"].append(name)
    for name, effect in own.items():
        tables = document.get("effect")
        if tables is None:
            tables = tomlkit.table(is_super_table=True)
            document["effect"] = tables
        table = tomlkit.table()
        table["expression"] = effect.expression
        if effect.target is not None:
            table["target"] = effect.target
        for key, parameter in effect.parameters.items():
            entry = tomlkit.inline_table()
            entry["value"] = parameter.value
            for limit, value in (("min", parameter.minimum), ("max", parameter.maximum)):
                if value is not None:
                    entry[limit] = value
            if parameter.unit != "1":
                entry["unit"] = parameter.unit
            table[key] = entry
        tables[name] = table
    return tomlkit.dumps(document)


def remove_effect(text: str, name: str) -> str:
    """case.toml without the effect in the model; its own table stays, so that it can be added again by name."""
    document = tomlkit.parse(text)
    effects = document["model"]["effects"]
    effects.remove(name)
    return tomlkit.dumps(document)


def write_whole(path: Path, text: str | bytes) -> None:
    """Replace a file in one step: at every moment it holds the old text or the new. OSError when it cannot.

    A link is followed. What is no file (a device such as /dev/null, a pipe) is written to and never replaced.
    """
    path = path.resolve()
    try:
        _write_whole(path, text.encode() if isinstance(text, str) else text)
    except OSError as error:  # name the file that was asked for
        raise type(error)(error.errno, error.strerror, str(path)) from None


def _write_whole(path: Path, data: bytes) -> None:
    if path.exists() and not path.is_file():
        path.write_bytes(data)
        return
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name[:100]}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            os.chmod(name, path.stat().st_mode & 0o7777)
        else:
            mask = os.umask(0)
            os.umask(mask)
            os.chmod(name, 0o666 & ~mask)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise
