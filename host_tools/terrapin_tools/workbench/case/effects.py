"""The effects that a case may have: the catalogue with the case's start values and bounds, and the user's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from terrapin_hil.effect_files import known_effects, read_effect_folder
from terrapin_hil.physics.effects import Effect, Parameter, catalogue
from terrapin_hil.physics.expression import parse
from terrapin_hil.units import read_unit
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases import BASES, CHANNELS, ROLES, Base, formula_name
from terrapin_tools.workbench.bases.kinds.base import GAIN
from terrapin_tools.workbench.case.effect_units import open_units, plain, unit_problem
from terrapin_tools.workbench.case.instruments import INSTRUMENTS
from terrapin_tools.workbench.files import units
from terrapin_tools.workbench.files.toml_tables import Estimate, Tables, read_estimate

__all__ = ["OWN", "read_library", "sound", "without_unit"]

OWN = "case.toml"  # source of an effect that stands there
OPEN = ""  # unit of a parameter that states none: `sound` gives it the one that makes the expression sound


def _from_files(folder: Path, tables: Tables, base: Base) -> dict[str, Effect]:
    """The catalogue, the user's own effects, and those of the case's folders `effects` and model.effects_folder."""
    folders = [folder / "effects"]
    named = tables.text("model", "effects_folder", default="")
    if named:
        folders.append(folder / named)
        if not folders[-1].is_dir():
            raise tables.complain(f"found {named!r}, expected a folder of effects", "model", "effects_folder")
    found = known_effects()
    for one in dict.fromkeys(path.resolve() for path in folders):
        found.update(read_effect_folder(one, found))
    for name in found.keys() - catalogue().keys():
        _check_terms(found[name], base)
    return found


def _check_terms(effect: Effect, base: Base) -> None:
    """UserError when an effect from a file speaks of bases, roles or targets that there are not."""
    for name in effect.bases:
        if name not in BASES:
            raise UserError(f"effect {effect.name}: bases: found {name!r}, expected some of {', '.join(BASES)}")
    for role in {role for group in effect.needs for role in group} | set(effect.positive):
        if role not in ROLES and not base.own_names:
            raise UserError(f"effect {effect.name}: needs: found {role!r}, expected some of {', '.join(ROLES)}")
    if base.takes(effect) and effect.target not in base.acts_on():
        expected = ", ".join(base.acts_on())
        raise UserError(
            f"effect {effect.name}: target: found {effect.target!r}, which {base.name} does not have; expected one of "
            f"{expected} (target=, or on={{{base.name!r}: ...}}, of the effect's file)"
        )


def read_library(
    folder: Path, tables: Tables, base: Base, more: Mapping[str, Effect]
) -> tuple[dict[str, Effect], frozenset[str]]:
    """Effects by name, and every name that a user's own expression uses (constants of theirs may have those names).

    `more` are effects that only this case has.
    """
    known = _from_files(folder, tables, base)
    library = {**more, **{name: effect for name, effect in known.items() if base.takes(effect)}}
    names: set[str] = set()
    for name, entry in tables.table("effect").items():
        path = ("effect", name)
        if not isinstance(entry, dict):
            raise tables.complain(f"found {entry!r}, expected a table", *path)
        if "expression" in entry:
            if name in known or name in more:
                kind = "a catalogued effect" if name in {**catalogue(), **more} else "an effect of a file"
                raise tables.complain(f"is the name of {kind}, expected another for your own expression", *path)
            library[name] = _own(tables, base, name)
            names |= parse(library[name].expression).names
        elif name in library:
            library[name] = _with_bounds(tables, library[name])
        elif name not in known:  # an effect of another base may keep its bounds here
            expected = ", ".join(library) or "a name with an expression"
            raise tables.complain(f"unknown effect without an expression, expected one of {expected}", *path)
    return library, frozenset(names)


def _with_bounds(tables: Tables, effect: Effect) -> Effect:
    path = ("effect", effect.name)
    tables.allow(path, *(p.name for p in effect.parameters), *effect.options)
    options = dict(effect.options)
    for name in effect.options:
        if tables.get(*path, name) is not None:
            options[name] = tables.truth(*path, name)
    parameters = []
    for parameter in effect.parameters:
        at = (*path, parameter.name)
        if tables.get(*at) is None:
            parameters.append(parameter)
            continue
        tables.entry(at, "value", "min", "max")
        standard = Estimate(parameter.name, parameter.start, parameter.minimum, parameter.maximum, parameter.unit)
        found = read_estimate(tables, at, parameter.unit, standard)
        grid = tuple(v for v in (*parameter.grid, found.value) if found.minimum <= v <= found.maximum)
        parameters.append(
            replace(parameter, start=found.value, minimum=found.minimum, maximum=found.maximum, grid=grid)
        )
    return replace(effect, parameters=tuple(parameters), options=options)


def _own(tables: Tables, base: Base, name: str) -> Effect:
    path = ("effect", name)
    with tables.about(*path, "expression"):
        expression = parse(tables.text(*path, "expression"))
    target = tables.text(*path, "target", default=base.targets()[0][0])
    if target not in base.acts_on():
        raise tables.complain(f"found {target!r}, expected one of {', '.join(base.acts_on())}", *path, "target")
    parameters = []
    for key in tables.table(*path):
        if key not in ("expression", "target"):
            tables.entry((*path, key), "value", "min", "max", "unit")
            parameters.append(_own_parameter(tables, base, (*path, key)))
    unused = sorted({parameter.name for parameter in parameters} - expression.names)
    if unused:
        raise tables.complain(f"{unused[0]} does not occur in the expression", *path, unused[0])
    return Effect(
        name=name,
        title="own expression",
        equation=expression.to_latex(),
        source=OWN,
        bases=(base.name,),
        parameters=tuple(parameters),
        needs=(),
        expression=expression.text,
        target=target,
    )


def _own_parameter(tables: Tables, base: Base, path: tuple[str, ...]) -> Parameter:
    """A parameter of the user's own; under a base model whose formulas are in SI it is taken to SI."""
    unit = tables.text(*path, "unit", default=OPEN)
    with tables.about(*path, "unit"):
        units.check(unit)
        if unit and units.shifted(unit):
            raise ValueError(f"found {unit!r}, whose zero is not that of SI, expected degC, or K for a difference")
        if (base.own_names and not base.own_dynamics) or not unit:
            factor, spelt = 1.0, unit or OPEN
        else:
            factor = units.si_factor(unit)
            spelt = unit if factor == 1.0 else plain(read_unit(unit))
    found = read_estimate(tables, path, unit or "1")
    return Parameter(path[-1], spelt, factor * found.value, factor * found.minimum, factor * found.maximum)


def sound(tables: Tables, base: Base, library: Mapping[str, Effect], given: Mapping[str, str]) -> dict[str, Effect]:
    """The library with the units of own effects checked against their targets and open ones filled in.

    `given` holds the units of the model's parameters and constants. An expression that uses a column or a constant
    without a unit is taken as it stands (`without_unit`).
    """
    known = _known(base, given)
    as_they_stand = base.own_names and not base.own_dynamics  # numbers, as the file has them
    checked = {}
    for name, effect in library.items():
        delay = effect.transform in INSTRUMENTS  # in s, whatever the target is in
        if name in catalogue() or delay or (as_they_stand and effect.source != OWN):
            checked[name] = effect
            continue
        expression = parse(effect.expression)
        own = {p.name: p.unit for p in effect.parameters if p.unit != OPEN}
        without = [p.name for p in effect.parameters if p.unit == OPEN]
        wanted = _wanted(effect, base, known)
        if not without_unit(effect, base, given) and wanted is not None:
            found = {**own, **open_units(expression, {**known, **own}, without, wanted)}
            problem = unit_problem(expression, {**known, **found}, wanted, exactly=as_they_stand and not without)
            if problem is not None:
                units_given = ", ".join(f"{key} [{unit}]" for key, unit in own.items())
                hint = f" (with {units_given})" if own and not without else ""
                if tables.get("effect", name, "expression") is None:
                    raise UserError(f"effect {name}: expression: {problem}{hint}")
                raise tables.complain(problem + hint, "effect", name, "expression")
        else:
            found = {**own, **dict.fromkeys(without, "1")}
        if as_they_stand:  # a number beside numbers, whose unit nobody told
            found |= dict.fromkeys(without, "1")
        parameters = tuple(replace(p, unit=found[p.name]) for p in effect.parameters)
        checked[name] = replace(effect, parameters=parameters)
    return checked


def without_unit(effect: Effect, base: Base, given: Mapping[str, str]) -> tuple[str, ...]:
    """Names in an own effect, or what it acts on, that have no unit: with them its units cannot be checked."""
    known, own = _known(base, given), {p.name for p in effect.parameters}
    names = sorted(name for name in parse(effect.expression).names - own if not known.get(name))
    return (*names, *([] if _wanted(effect, base, known) else [effect.target]))


def _known(base: Base, given: Mapping[str, str]) -> dict[str, str]:
    known = {} if base.own_names else {formula_name(role): unit for role, unit in ROLES.items()}
    known.update({**{name: unit for name, unit in base.units.items() if "^n" not in unit}, **given})
    known |= {"bulldozing_resistance": "N", "rut_resistance": "N/m"}
    return known


def _wanted(effect: Effect, base: Base, known: Mapping[str, str]) -> str | None:
    """The unit that an effect's expression has to come out in."""
    if effect.target in base.forces:
        return base.forces[effect.target] or None
    if effect.target.startswith(GAIN):
        return "1"
    if base.own_names:
        return (base.channels[effect.target] or None) if effect.target in base.channels else "1"
    channels = {**CHANNELS, **base.channels}  # which may have a role's name, as the vehicle's speed has
    if effect.target in channels:
        return "1" if effect.stage == "gain" else channels[effect.target]
    return known.get(effect.target) if effect.additive else "1"
