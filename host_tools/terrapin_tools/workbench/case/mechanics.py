"""The mechanics that an `equation` gets from columns whose role is told: the templates of physics/mechanics, in the
names and units of the case.

A column says `is = "speed"`. Once one column does, the units of the others tell too, where only one could be meant.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.effects import Effect, Parameter
from terrapin_hil.physics.expression import parse
from terrapin_hil.physics.mechanics import ROLES, mechanics
from terrapin_hil.units import read_unit
from terrapin_hil.units import units as registry
from terrapin_tools.workbench.bases import free_name
from terrapin_tools.workbench.files.units import convert, convert_difference, same_kind

__all__ = ["Told", "is_of", "mechanics_of", "role_of_unit"]

BY_UNIT = ("speed", "acceleration", "temperature", "current", "torque")  # a length, an angle, a time may be anything
RATE, PLAYED = "rate", "played"  # what the equation computes from columns (bases/equation.py)


@dataclass(frozen=True)
class Told:
    """An input of a case and its role."""

    name: str  # in formulas
    unit: str  # "1" where none is stated
    values: Array  # (rows,)


def is_of(unit: str, role: str) -> bool:
    """Whether a column of that unit may have the role: an angle is no plain number, and degC no difference.

    >>> is_of("rpm", "speed"), is_of("Hz", "speed"), is_of("K", "temperature")
    (True, False, True)
    """
    return any(_root(unit) == _root(known) for known in ROLES[role])


def _root(unit: str) -> str:
    """A unit in root units, in which an angle is a radian."""
    if unit in ("degC", "celsius", "degree_Celsius"):
        return "kelvin"
    return str(registry().Quantity(1.0, read_unit(unit)).to_root_units().units)


def role_of_unit(units: Mapping[str, str], told: Iterable[str]) -> dict[str, str]:
    """Role -> input, for roles that no input is told to have and one alone could have by its unit.

    `units` are those of the inputs without a told role.
    """
    found = {}
    for role in BY_UNIT:
        likely = [name for name, unit in units.items() if is_of(unit, role)]
        if role not in told and len(likely) == 1:
            found[role] = likely[0]
    return found


def mechanics_of(told: Mapping[str, Told], channels: Mapping[str, str], parameters: Iterable[str]) -> dict[str, Effect]:
    """The effects that the roles of a case's inputs bring, by name.

    Where there are several channels (for what acts on a parameter: several parameters) the name says which.

    Parameters
    ----------
    told : inputs by role; without any there are no effects.
    channels : names and units.
    parameters : of the formulas.
    """
    found: dict[str, Effect] = {}
    if not told:
        return found
    on = {"channel": list(channels), "parameter": sorted(parameters)}
    for template in mechanics().values():
        for target in on[template.target]:
            if template.target == "channel" and not _on_such(template, channels[target]):
                continue
            name = template.name if len(on[template.target]) == 1 else f"{template.name}_on_{target}"
            effect = _effect(replace(template, name=name, target=target), told, channels.get(target, "1"))
            if effect is not None:
                found[name] = effect
    return found


def _on_such(template: Effect, unit: str) -> bool:
    """Whether a template is one of a channel in that unit."""
    return any(same_kind(unit, kind) if kind else not same_kind(unit, "W") for kind in template.channels)


def _effect(template: Effect, told: Mapping[str, Told], channel: str) -> Effect | None:
    """A template in the names and units of the case; None when a role is missing."""
    columns: dict[str, Told] = {}
    text, needs, transform = template.expression, [], template.transform
    units = {"channel": channel}
    if "position" in told and _root(told["position"].unit) == "radian":
        told = {**told, "angle": told["position"]}
    for group in template.needs:
        role = next((one for one in group if one in told), "")
        if role:
            columns[group[0]] = told[role]
            units[group[0]] = told[role].unit
            needs.append((told[role].name,))
        elif group == ("acceleration",) and {"speed", "time"} <= told.keys():
            transform, units["acceleration"] = "rate", f"({told['speed'].unit})/({told['time'].unit})"
            needs += [(told["speed"].name,), (told["time"].name,)]
            text = text.replace("acceleration", RATE)
        else:
            return None
    for role in template.reverses:
        values = columns[role].values
        if not (values.min() < 0.0 < values.max()) and "direction" not in told:
            return None
    taken = {one.name for one in (*columns.values(), *told.values())} | {RATE, PLAYED}
    parameters = []
    for parameter in template.parameters:
        name = free_name(parameter.name, taken)
        if name != parameter.name:
            text = re.sub(rf"\b{parameter.name}\b", name, text)
        parameters.append(_parameter(replace(parameter, name=name), columns, units))
    if "direction" in told and ("speed" in columns or transform == "rate"):
        way = f"sign({told['direction'].name})"  # a speed may be recorded without its sign
        text = text.replace("sign(speed)", way).replace("*speed", f"*abs(speed)*{way}").replace(RATE, f"{RATE}*{way}")
        needs.append((told["direction"].name,))
    for role, column in columns.items():
        text = re.sub(rf"\b{role}\b", _spelt(role, column), text)
    return replace(
        template,
        parameters=tuple(parameters),
        needs=tuple(needs),
        expression=text,
        transform=transform,
        reverses=(),
    )


def _spelt(role: str, column: Told) -> str:
    """A column as the template's formula takes it: an angle in radians, a temperature in degC."""
    if (
        role in ("position", "angle")
        and _root(column.unit) == "radian"
        and (factor := convert(1.0, column.unit, "rad")) != 1.0
    ):
        return f"{factor:.12g}*{column.name}"
    if role == "temperature" and column.unit != "1":
        zero, factor = convert(0.0, "degC", column.unit), convert_difference(1.0, column.unit, "degC")
        if (zero, factor) != (0.0, 1.0):
            return f"({column.name} - {zero:.12g})*{factor:.12g}" if factor != 1.0 else f"{column.name} - {zero:.12g}"
    return column.name


def _parameter(parameter: Parameter, columns: Mapping[str, Told], units: Mapping[str, str]) -> Parameter:
    """A template's parameter with the case's unit, its numbers in it."""
    role = next((role for role in columns if parameter.unit in (role, f"rad/{role}")), None)
    if role is None:
        return replace(parameter, unit=_unit(parameter.unit, units))
    column = columns[role]
    if parameter.unit == role:
        return _scaled(parameter, float(np.abs(column.values).max()), column.unit)
    if _root(column.unit) == "radian":
        grid = tuple(value for value in parameter.grid if value >= 2.0)  # once a turn is an imbalance
        return replace(parameter, unit="1", start=grid[0], minimum=2.0, grid=grid)
    span = float(np.ptp(column.values))
    waves = _scaled(parameter, 2.0 * np.pi / span if span else 1.0, _unit(f"rad/{role}", units))
    return replace(waves, whole=False, minimum=0.5 * waves.minimum, maximum=1.1 * waves.maximum)


def _scaled(parameter: Parameter, factor: float, unit: str) -> Parameter:
    factor = factor or 1.0  # a column of zeros
    return replace(
        parameter,
        unit=unit,
        start=factor * parameter.start,
        minimum=factor * parameter.minimum,
        maximum=factor * parameter.maximum,
        grid=tuple(factor * value for value in parameter.grid),
    )


def _unit(formula: str, units: Mapping[str, str]) -> str:
    """A unit as a formula of those of channel and roles.

    >>> _unit("channel/speed**2", {"channel": "N m", "speed": "rad/s"})
    'm*N*s^2/rad^2'
    """
    if formula in ("1", "1/K", "rad", *units):
        return units.get(formula, formula)
    unit = parse(formula).unit({**units, "rad": "rad"})
    return f"{unit:~C}".replace("**", "^") or "1"
