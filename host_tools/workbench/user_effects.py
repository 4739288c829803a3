"""The effects that a case may have: the catalogue with the case's start values and bounds, and the user's own."""

from __future__ import annotations

from dataclasses import replace

from hil.physics.effects import Effect, Parameter, catalogue
from hil.physics.expression import parse
from host_tools.workbench import units
from host_tools.workbench.bases import Base
from host_tools.workbench.case import Estimate, Tables, read_estimate

__all__ = ["default_target", "read_library", "targets"]


def targets(base: Base) -> tuple[str, ...]:
    """What an expression may act on under this base model."""
    if base.dynamic is not None:
        return (*base.channels, "resistance", "rolling_resistance", *base.dynamic.inputs, *base.parameters)
    torque = {"rolling_steady": ("resistance",), "equation": ()}.get(base.name, ("drag",))
    stiffness = ("k_s",) if base.name == "wheel_contact" else ()
    return (*base.channels, *torque, *base.parameters, *stiffness)


def default_target(base: Base) -> str:
    """The target of an expression that names none: resistance, else the only (or first) channel."""
    return "resistance" if base.name == "rolling_steady" or base.dynamic is not None else base.channels[0]


def read_library(tables: Tables, base: Base) -> tuple[dict[str, Effect], frozenset[str]]:
    """Effects by name, and every name that a user's own expression uses (constants of theirs may have those names)."""
    library = {name: effect for name, effect in catalogue().items() if base.name in effect.bases}
    names: set[str] = set()
    for name, entry in tables.table("effect").items():
        path = ("effect", name)
        if not isinstance(entry, dict):
            raise tables.complain(f"found {entry!r}, expected a table", *path)
        if "expression" in entry:
            library[name] = _own(tables, base, name)
            names |= parse(library[name].expression).names
        elif name in library:
            library[name] = _with_bounds(tables, library[name])
        elif name not in catalogue():  # an effect of another base may keep its bounds here
            expected = ", ".join(library) or "a name with an expression"
            raise tables.complain(f"unknown effect without an expression, expected one of {expected}", *path)
    return library, frozenset(names)


def _with_bounds(tables: Tables, effect: Effect) -> Effect:
    path = ("effect", effect.name)
    tables.allow(path, *(p.name for p in effect.parameters), *effect.options)
    options = dict(effect.options)
    for name in effect.options:
        value = tables.get(*path, name)
        if value is not None:
            truth = {"true": 1.0, "false": 0.0}.get(str(value).lower())
            if truth is None:
                raise tables.complain(f"found {value!r}, expected true or false", *path, name)
            options[name] = truth
    parameters = []
    for parameter in effect.parameters:
        at = (*path, parameter.name)
        if tables.get(*at) is None:
            parameters.append(parameter)
            continue
        _only(tables, at, "value", "min", "max")
        standard = Estimate(parameter.name, parameter.start, parameter.minimum, parameter.maximum, parameter.unit)
        found = read_estimate(tables, at, parameter.unit, standard)
        grid = tuple(v for v in (*parameter.grid, found.value) if found.minimum <= v <= found.maximum)
        parameters.append(
            replace(parameter, start=found.value, minimum=found.minimum, maximum=found.maximum, grid=grid)
        )
    return replace(effect, parameters=tuple(parameters), options=options)


def _own(tables: Tables, base: Base, name: str) -> Effect:
    path = ("effect", name)
    if name in catalogue():
        raise tables.complain("is the name of a catalogued effect, expected another for your own expression", *path)
    try:
        expression = parse(tables.text(*path, "expression"))
    except ValueError as error:
        raise tables.complain(str(error), *path, "expression") from None
    target = tables.text(*path, "target", default=default_target(base))
    if target not in targets(base):
        raise tables.complain(f"found {target!r}, expected one of {', '.join(targets(base))}", *path, "target")
    parameters = []
    for key, entry in tables.table(*path).items():
        if key in ("expression", "target"):
            continue
        if not isinstance(entry, dict):
            raise tables.complain(f"found {entry!r}, expected {{ value = , min = , max = , unit = }}", *path, key)
        _only(tables, (*path, key), "value", "min", "max", "unit")
        unit = tables.text(*path, key, "unit", default="1")
        try:
            units.check(unit)
        except ValueError as error:
            raise tables.complain(str(error), *path, key, "unit") from None
        found = read_estimate(tables, (*path, key), unit)
        parameters.append(Parameter(key, unit, found.value, found.minimum, found.maximum))
    unused = sorted({parameter.name for parameter in parameters} - expression.names)
    if unused:
        raise tables.complain(f"{unused[0]} does not occur in the expression", *path, unused[0])
    return Effect(
        name=name,
        title="own expression",
        equation=expression.to_latex(),
        source="case.toml",
        bases=(base.name,),
        parameters=tuple(parameters),
        needs=(),
        expression=expression.text,
        target=target,
    )


def _only(tables: Tables, path: tuple[str, ...], *names: str) -> None:
    if not isinstance(tables.get(*path), dict):
        raise tables.complain(
            f"found {tables.get(*path)!r}, expected {{ {', '.join(f'{n} = ' for n in names)} }}", *path
        )
    tables.allow(path, *names)
