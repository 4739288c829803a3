"""What a new case is to be made of, as options of `terrapin case` and back.

    arguments(order, ["day_1.csv"], "", "my_case")   the words after `terrapin` that make the case
    read(...)                                        what those words ask for

An order is the body of POST /api/cases (web/new_case.py) as plain values: what case.toml is to say, without the files.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from terrapin_tools.errors import UserError

__all__ = ["arguments", "halves", "pairs", "read"]


def arguments(order: dict[str, Any], files: Sequence[str], dbc: str, to: str) -> list[str]:
    """The command line that makes the case `to`; what has its default is left out."""
    columns = order["columns"]
    options = [
        ("title", order["title"]),
        ("base", order["base"]),
        *(("effect", name) for name in order["effects"]),
        *(("column", f"{name}={entry['column']}") for name, entry in columns.items()),
        *(("unit", f"{name}={entry['unit']}") for name, entry in columns.items() if entry["unit"]),
        *(("noise", f"{name}={_spelt(entry['sigma'])}") for name, entry in columns.items() if entry["sigma"]),
        *(("constant", f"{name}={_spelt(value)}") for name, value in order["parameters"].items()),
        *(("fit", f"{name}={_fit(entry)}") for name, entry in order["fit"].items()),
        *(("equation", f"{name}={formula}") for name, formula in order["equation"].items()),
        *(("state", f"{name}={_joined(entry, 'initial')}") for name, entry in order["states"].items()),
        *(("derivative", f"{name}={formula}") for name, formula in order["derivative"].items()),
        *(("measured", f"{name}={formula}") for name, formula in order["measured"].items()),
        *(("limit", f"{name}={_joined(entry, 'min', 'max')}") for name, entry in order["limits"].items()),
        ("run", order["run"]),
        *(("train", run) for run in order["train"]),
        *(("test", run) for run in order["test"]),
        ("every", "" if order["every"] == 1 else str(order["every"])),
        ("dbc", dbc),
        *(("read", f"{key}={value}") for key, value in order.get("read", {}).items()),
        ("period", "" if order["period"] == "10 ms" else _spelt(order["period"])),
    ]
    return ["case", *files, f"--to={to}", *(f"--{name}={value}" for name, value in options if value)]


def _spelt(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)


def _fit(entry: dict[str, Any]) -> str:
    bare = entry["min"] is None and entry["max"] is None and not entry["unit"]
    return _spelt(entry["value"]) if bare else _joined(entry, "value", "min", "max")


def _joined(entry: dict[str, Any], *keys: str) -> str:
    words = ["" if entry[key] is None else _spelt(entry[key]) for key in keys]
    return ":".join([*words, entry["unit"]] if entry["unit"] else words)


def read(
    *,
    title: str,
    base: str,
    effects: Sequence[str],
    columns: Sequence[str],
    units: Sequence[str],
    noises: Sequence[str],
    constants: Sequence[str],
    fits: Sequence[str],
    equations: Sequence[str],
    states: Sequence[str],
    derivatives: Sequence[str],
    measured: Sequence[str],
    limits: Sequence[str],
    run: str,
    train: Sequence[str],
    test: Sequence[str],
    every: int,
    period: str,
    readings: Sequence[str],
) -> dict[str, Any]:
    """The order that the options ask for. UserError names the option that is wrong."""
    mapped: dict[str, dict[str, Any]] = {
        name: {"column": column, "unit": "", "sigma": None} for name, column in pairs("--column", columns).items()
    }
    if not mapped:
        raise UserError("--column: found none, expected at least one NAME=COLUMN")
    for option, key, texts in (("--unit", "unit", units), ("--noise", "sigma", noises)):
        for name, text in pairs(option, texts).items():
            if name not in mapped:
                raise UserError(f"{option}: found {name}, expected one of {', '.join(mapped)}")
            mapped[name][key] = _sd(option, text) if key == "sigma" else text
    if not 1 <= every <= 1_000_000:
        raise UserError(f"--every: found {every}, expected 1 to 1000000")
    shape = "START[:MIN:MAX[:UNIT]]"
    return {
        "title": title,
        "base": base,
        "effects": list(effects),
        "columns": mapped,
        "parameters": {name: _constant(text) for name, text in pairs("--constant", constants).items()},
        "fit": _entries("--fit", fits, ("value", "min", "max"), _number, shape),
        "equation": pairs("--equation", equations),
        "states": {name: _state(name, text) for name, text in pairs("--state", states).items()},
        "derivative": pairs("--derivative", derivatives),
        "measured": pairs("--measured", measured),
        "limits": _entries("--limit", limits, ("min", "max"), _constant, "MIN:MAX[:UNIT]"),
        "run": run,
        "train": list(train),
        "test": list(test),
        "every": every,
        "period": period,
        "read": pairs("--read", readings),
    }


def halves(option: str, text: str) -> tuple[str, str]:
    """COLUMN=COLUMN: of a first and a second file."""
    first, equals, second = text.partition("=")
    if not equals or not first or not second:
        raise UserError(f"{option}: found {text!r}, expected COLUMN=COLUMN, of the first file and of the second")
    return first, second


def pairs(option: str, texts: Iterable[str]) -> dict[str, str]:
    """NAME=REST, each name once."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, rest = text.partition("=")
        if not equals or not name.isidentifier() or not rest:
            raise UserError(f"{option}: found {text!r}, expected NAME=VALUE")
        if name in found:
            raise UserError(f"{option}: found {name} twice, expected it once")
        found[name] = rest
    return found


def _entries(
    option: str, texts: Iterable[str], keys: tuple[str, ...], value: Callable[[str], Any], shape: str
) -> dict[str, dict[str, Any]]:
    """NAME=A:B:...[:UNIT] as entries of case.toml; the first of three may stand alone."""
    found = {}
    for name, text in pairs(option, texts).items():
        parts = text.split(":", len(keys))
        alone = len(parts) == 1 and len(keys) == 3
        if not alone and len(parts) < len(keys):
            raise UserError(f"{option}: found {name}={text}, expected {name}={shape}")
        try:
            values = [value(part) if part else None for part in parts[: len(keys)]]
        except ValueError:
            raise UserError(f"{option}: found {name}={text}, expected numbers in {name}={shape}") from None
        values += [None] * (len(keys) - len(values))
        if values[0] is None:
            raise UserError(f"{option}: found {name}={text}, expected {name}={shape}")
        unit = parts[len(keys)] if len(parts) > len(keys) else ""
        found[name] = {**dict(zip(keys, values, strict=True)), "unit": unit}
    return found


def _state(name: str, text: str) -> dict[str, Any]:
    """INITIAL[:UNIT] as an entry of [model.states]; what is no number is `fit` or a column, which the case knows."""
    initial, _, unit = text.partition(":")
    if not initial:
        raise UserError(f"--state: found {name}={text}, expected {name}=INITIAL[:UNIT]")
    try:
        return {"initial": _number(initial), "unit": unit}
    except ValueError:
        return {"initial": initial, "unit": unit}


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _constant(text: str) -> float | bool | str:
    """A number, true, false, or a quantity as it stands."""
    if text in ("true", "false"):
        return text == "true"
    try:
        return _number(text)
    except ValueError:
        return text


def _sd(option: str, text: str) -> float | str:
    """A number above 0, or a quantity with its own unit as it stands."""
    number, _, unit = text.strip().partition(" ")
    value = _above_0(option, number)
    return f"{number} {unit.strip()}" if unit else value


def _above_0(option: str, text: str) -> float:
    try:
        value = _number(text)
    except ValueError:
        value = 0.0
    if value <= 0.0:
        raise UserError(f"{option}: found {text}, expected a number above 0")
    return value
