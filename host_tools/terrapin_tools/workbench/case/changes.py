"""Changes to case.toml that keep the user's comments and order, written whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import tomlkit

from terrapin_tools.errors import UserError

__all__ = [
    "MENDS",
    "SUSPECT",
    "SUSPECTED",
    "TABLE",
    "OwnEffect",
    "OwnParameter",
    "add_effects",
    "extended",
    "hold_out",
    "inline_tables",
    "parse_parameter",
    "remove_effect",
    "set_constant",
    "without_own",
]

SUSPECT = "constant."  # before the name of a constant that may be wrong
MENDS = ("factor", "sign_of", "delay")  # of an entry of [data.columns]
TABLE = "table."  # before the name of a column that may be at fault
SUSPECTED = (-0.8, 4.0)  # of its relative error; beyond, a unit is wrong rather than a number


@dataclass(frozen=True)
class OwnParameter:
    """A parameter of the user's own expression."""

    value: float
    minimum: float | None = None
    maximum: float | None = None
    unit: str = "1"


@dataclass(frozen=True)
class OwnEffect:
    """An expression that becomes an effect; or `mend`, which puts a column right: factor, sign_of, delay; or inputs, as
    those of equations of the user's own are read between rows."""

    expression: str
    target: str | None
    parameters: Mapping[str, OwnParameter] = field(default_factory=dict)
    mend: Mapping[str, float | str | int] = field(default_factory=dict)


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


def extended(
    text: str, stated: Mapping[str, tuple[float, str]], names: Sequence[str], own: Mapping[str, OwnEffect]
) -> str:
    """case.toml with effects added, with the constants freed that suspects (constant.NAME) are about, and with the
    columns put right that faults of the table (table.NAME.KIND) are about.

    UserError when such a constant is not stated, or nobody said how a column is wrong; `stated` are the numbers of
    [parameters], in SI, and the units that [fit] has to give with them ("" for none).
    """
    for name in names:
        constant = name.removeprefix(SUSPECT)
        if constant != name:
            if constant not in stated:
                raise UserError(
                    f"found {name}, expected a constant of [parameters]: one of {', '.join(sorted(stated))}"
                )
            value, unit = stated[constant]
            low, high = sorted(float(f"{value * (1.0 + error):.6g}") for error in SUSPECTED)
            text = _free(text, constant, {"value": value, "min": low, "max": high, **({"unit": unit} if unit else {})})
        elif name.startswith(TABLE):
            if name not in own or not own[name].mend:
                raise UserError(f"found {name}, expected what terrapin discover named last (its answer says how much)")
            text = _mend(text, name.split(".")[1], own[name].mend)
    effects = [name for name in names if not name.startswith((SUSPECT, TABLE))]
    added = {name: one for name, one in own.items() if not one.mend}
    return add_effects(text, effects, added) if effects else text


def _mend(text: str, column: str, mend: Mapping[str, float | str | int]) -> str:
    """An entry of [data.columns] with factor, sign_of or delay; a factor that stands there is multiplied. `inputs` goes
    into [model]."""
    document = tomlkit.parse(text)
    if "inputs" in mend:
        document["model"]["inputs"] = mend["inputs"]
        return tomlkit.dumps(document)
    entry = document["data"]["columns"][column]
    for key, value in mend.items():
        entry[key] = float(f"{entry[key] * value:.9g}") if key == "factor" and key in entry else value
    return tomlkit.dumps(document)


def _free(text: str, constant: str, estimate: Mapping[str, float | str]) -> str:
    """A constant of [parameters] becomes an entry of [fit]."""
    document = tomlkit.parse(text)
    document["parameters"].remove(constant)
    if "fit" not in document:
        document["fit"] = tomlkit.table()
    entry = tomlkit.inline_table()
    entry.update(estimate)
    document["fit"][constant] = entry
    return tomlkit.dumps(document)


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


def hold_out(text: str, held: Sequence[str], runs: Sequence[str]) -> str:
    """case.toml in which exactly the runs `held` of all `runs` are held out, and the others trained on."""
    for run in held:
        if run not in runs:
            raise UserError(f"run {run!r} is not in the data, expected one of {', '.join(runs)}")
    document = tomlkit.parse(text)
    data = document["data"]
    assert isinstance(data, tomlkit.items.Table)
    data["test"] = list(held)
    if "train" in data:
        data["train"] = [run for run in runs if run not in held]
    return tomlkit.dumps(document)


def set_constant(text: str, name: str, value: str) -> str:
    """case.toml in which a constant of [parameters] has another value, as it is written there: `"80 mm"`, 0.08.

    Where it was guessed it no longer is.

    UserError when there is none of that name.
    """
    document = tomlkit.parse(text)
    table = document.get("parameters")
    if not isinstance(table, tomlkit.items.Table) or name not in table:
        known = ", ".join(table) if isinstance(table, tomlkit.items.Table) else "none"
        raise UserError(f"found {name!r}, expected a constant of [parameters]: {known}")
    try:
        table[name] = float(value)
    except ValueError:
        table[name] = value
    guessed = document["case"].get("guessed", [])
    if f"parameters.{name}" in guessed:
        guessed.remove(f"parameters.{name}")
    return tomlkit.dumps(document)


def without_own(text: str, name: str) -> str:
    """case.toml without an effect of the user's own: neither in the model nor with a table of its own."""
    document = tomlkit.parse(text)
    own = document.get("effect")
    if own is None or name not in own:
        raise UserError(f"found {name!r}, expected an effect of your own: {', '.join(own or {}) or 'none'}")
    effects = document["model"]["effects"]
    if name in effects:
        effects.remove(name)
    del own[name]
    return tomlkit.dumps(document)


def inline_tables(entries: Mapping[str, Mapping[str, Any]]) -> tomlkit.items.Table:
    """A table with one line an entry, as [data.columns] has them; what is None or empty is left out."""
    table = tomlkit.table()
    for name, entry in entries.items():
        line = tomlkit.inline_table()
        line.update({key: value for key, value in entry.items() if value not in (None, "")})
        table[name] = line
    return table
