"""A case: the folder's case.toml and measurements, checked and in canonical units. See docs/cases.md for the contract.

Anything wrong is a UserError of one line: file, line or row, field, what was found, what was expected.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.physics.effects import Effect, catalogue
from hil.physics.expression import Expression
from hil.reading import ReadingError, parse_toml, shorten
from host_tools.errors import UserError
from host_tools.workbench.bases import BASES, ROLES, Base, formula_name
from host_tools.workbench.places import locate

__all__ = ["Case", "Complaint", "Estimate", "load_case", "parse_case", "read_case_text", "read_document"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Complaint = Callable[..., UserError]


_POSITIVE = (1e-30, np.inf, "more than 0")
RANGES = {  # known constants: lowest, what they stay below, in words
    **dict.fromkeys(("radius", "drive_radius", "torque_constant", "width", "n", "shear_modulus", "load"), _POSITIVE),
    "cohesion": (0.0, np.inf, "0 or more"),
    "friction_angle": (0.0, np.pi / 2, "0 to less than 90 deg"),
}


@dataclass(frozen=True)
class Estimate:
    """A parameter to be fitted: start value and bounds, in `unit`."""

    name: str
    value: float
    minimum: float
    maximum: float
    unit: str


@dataclass(frozen=True)
class Case:
    """Everything a model and a fit need. Arrays have one entry a row; roles and channels are in canonical units."""

    folder: Path
    text: str  # of case.toml
    title: str
    notes: str  # Markdown, "" for none
    base: Base
    effects: tuple[str, ...]
    parameters: Mapping[str, float]  # known constants, SI
    parameter_units: Mapping[str, str]  # as far as they are known
    options: Mapping[str, str]
    fit: Mapping[str, Estimate]
    library: Mapping[
        str, Effect
    ]  # effects that this base may take: catalogue with the case's bounds, and the user's own
    equations: Mapping[str, Expression]
    scales: Mapping[str, float]  # equation with all units given: what takes a name's number to SI; else empty
    roles: Mapping[str, Array]
    channels: Mapping[str, Array]
    sigma: Mapping[str, float | None]
    units: Mapping[str, str]  # canonical unit of each role and channel
    extra: Mapping[str, Array]  # numeric columns that are not mapped, in the file's own units
    column_of: Mapping[str, str]  # role or channel -> column of the file
    run_names: tuple[str, ...]  # sorted
    run: npt.NDArray[np.int64]  # index into run_names
    train: Mask
    test: Mask
    place: Callable[[int], str] = field(repr=False)  # row -> "runs.csv:17"
    limits: Mapping[str, tuple[float, float]] = field(
        default_factory=dict
    )  # what the rig can set: role -> lowest, highest

    @property
    def rows(self) -> int:
        return len(self.run)

    @cached_property
    def inputs(self) -> dict[str, Array]:
        """What formulas may use: roles and unmapped columns by their names in formulas."""
        extra = {name: values for name, values in self.extra.items() if name.isidentifier()}
        return {**extra, **{formula_name(name): values for name, values in self.roles.items()}}

    def missing_role(self, effect: Effect) -> str | None:
        """The role that an effect needs and the case does not map; None when it could be added."""
        for group in effect.needs:
            if not any(
                formula_name(role) in self.inputs or role in self.parameters or role in self.base.provides
                for role in group
            ):
                return " or ".join(group)
        return next((name for name in effect.constants if name not in self.parameters), None)


def load_case(folder: Path) -> Case:
    """Read a case folder. UserError when anything in it is wrong."""
    return parse_case(folder, read_case_text(folder))


def read_case_text(folder: Path) -> str:
    """The text of case.toml, its line ends as they are. UserError when it cannot be read."""
    file = folder / "case.toml"
    try:
        with file.open(encoding="utf-8-sig", newline="") as opened:
            return opened.read()
    except (FileNotFoundError, NotADirectoryError):
        raise UserError(f"{file}: no such file, expected a case folder with a case.toml, or a folder of such") from None
    except (UnicodeDecodeError, IsADirectoryError):
        raise UserError(f"{file}: found something that is not UTF-8 text, expected TOML") from None
    except OSError as error:
        raise UserError(f"{file}: {error.strerror}, expected a readable file") from None


def read_document(file: Path, text: str) -> dict[str, Any]:
    """TOML as a dictionary. UserError with file and line when it is none."""
    try:
        return parse_toml(text, file)
    except ReadingError as error:
        raise UserError(str(error)) from None


def parse_case(folder: Path, text: str) -> Case:
    """Read a case whose case.toml has `text`; the measurements come from `folder`."""
    from host_tools.workbench.limits import read_limits  # keeps each file to one idea
    from host_tools.workbench.measurements import read_measurements
    from host_tools.workbench.user_effects import read_library, sound

    def complain(message: str, *path: str) -> UserError:
        return UserError(f"{folder / 'case.toml'}:{locate(text, *path)}: {'.'.join(path)}: {message}")

    tables = _Tables(read_document(folder / "case.toml", text), complain)
    if tables.get("model", "base") == "driven_wheel":  # its case.toml has more tables
        raise complain("found 'driven_wheel', which is for terrapin soil tactile", "model", "base")
    tables.allow((), "case", "model", "parameters", "fit", "effect", "limits", "data")
    tables.allow(("case",), "title", "notes", "source", "comment", "license", "date")
    tables.allow(("model",), "base", "effects", "effects_folder", "equation")
    title = tables.text("case", "title", default=folder.resolve().name)
    base_name = tables.text("model", "base")
    if base_name not in BASES:
        raise complain(f"found {base_name!r}, expected one of {', '.join(BASES)}", "model", "base")
    base = BASES[base_name]
    effects = tuple(tables.texts("model", "effects", default=[]))
    measured = read_measurements(folder, tables, base)
    if base.name == "equation":
        base = Base("equation", measured.channel_names, {}, ())
    library, effect_names = read_library(folder, tables, base)
    parameters, parameter_units, options = _constants(tables, base, library, effect_names)
    fit = _estimates(tables, base, parameters)
    for name, value in base.defaults.items():
        if name not in fit and name not in parameters:
            parameters[name], parameter_units[name] = value, base.parameters[name]
    case = Case(
        folder=folder,
        text=text,
        title=title,
        notes=_notes(folder, tables),
        base=base,
        effects=effects,
        parameters=parameters,
        parameter_units=parameter_units,
        options=options,
        fit=fit,
        library=sound(tables, base, library, {**measured.units, **parameter_units, **_fit_units(fit)}),
        equations=measured.equations,
        scales=_scales(measured.equations, {**parameter_units, **_fit_units(fit), **measured.units}, complain),
        limits=read_limits(tables, base, measured.units, measured.extra, measured.column_of),
        **measured.case_fields(),
    )
    _check_names(case, complain)
    return case


class _Tables:
    """A TOML document and the way to complain about it."""

    def __init__(self, document: dict[str, Any], complain: Complaint) -> None:
        self.document = document
        self.complain = complain

    def get(self, *path: str, default: Any = None) -> Any:
        value: Any = self.document
        for depth, key in enumerate(path):
            if not isinstance(value, dict):
                raise self.complain(f"found {shorten(value)}, expected a table", *path[:depth])
            if key not in value:
                return default
            value = value[key]
        return value

    def table(self, *path: str) -> dict[str, Any]:
        value = self.get(*path, default={})
        if not isinstance(value, dict):
            raise self.complain(f"found {shorten(value)}, expected a table", *path)
        return value

    def allow(self, path: tuple[str, ...], *names: str) -> None:
        for name in self.table(*path) if path else self.document:
            if name not in names:
                raise self.complain(f"unknown name, expected one of {', '.join(names)}", *path, name)

    def text(self, *path: str, default: str | None = None) -> str:
        value = self.get(*path, default=default)
        if value is None:
            raise self.complain("missing, expected text", *path)
        if not isinstance(value, str):
            raise self.complain(f"found {shorten(value)}, expected text", *path)
        return value

    def texts(self, *path: str, default: list[str] | None = None) -> list[str]:
        value = self.get(*path, default=default)
        if value is None:
            raise self.complain("missing, expected a list of names", *path)
        if not isinstance(value, list) or any(isinstance(v, bool) or not isinstance(v, (str, int)) for v in value):
            raise self.complain(f"found {shorten(value)}, expected a list of names", *path)
        names = [str(v) for v in value]
        for name in names:
            if names.count(name) > 1:
                raise self.complain(f"found {name!r} twice, expected it once", *path)
        return names

    def number(self, unit: str, *path: str) -> float:
        from host_tools.workbench.units import quantity

        try:
            return quantity(self.get(*path), unit)
        except ValueError as error:
            raise self.complain(str(error), *path) from None


Tables = _Tables


def _notes(folder: Path, tables: Tables) -> str:
    name = tables.text("case", "notes", default="")
    if not name:
        return ""
    try:
        return (folder / name).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        raise tables.complain(f"found {name!r}, expected a readable text file in the case", "case", "notes") from None


def _constants(
    tables: Tables, base: Base, library: Mapping[str, Effect], effect_names: frozenset[str]
) -> tuple[dict[str, float], dict[str, str], dict[str, str]]:
    """[parameters]: numbers in SI, their units as far as known, and the options."""
    known = {**{formula_name(role): unit for role, unit in ROLES.items()}, **base.parameters}
    flags: set[str] = set()
    for effect in library.values():
        known.update(effect.constants)
        flags.update(effect.options)
    found = tables.table("parameters")
    values, units, options = {}, {}, {}
    for name, value in found.items():
        path = ("parameters", name)
        if name in base.options:
            if value not in base.options[name]:
                raise tables.complain(f"found {value!r}, expected one of {', '.join(base.options[name])}", *path)
            options[name] = str(value)
        elif name in flags:
            truth = {"true": True, "false": False}.get(str(value).lower())
            if truth is None:
                raise tables.complain(f"found {value!r}, expected true or false", *path)
            values[name] = float(truth)
        elif name in known:
            unit = known[name].replace("^n", f"^{_exponent(tables)}")
            values[name], units[name] = tables.number(unit, *path), unit
        elif base.name == "equation" or name in effect_names:
            values[name], unit_text = _free_number(tables, *path)
            if unit_text:
                units[name] = unit_text
        else:
            names = sorted({*known, *base.options, *flags})
            raise tables.complain(f"unknown name, expected one of {', '.join(names)}", *path)
    for name, (low, high, expected) in RANGES.items():
        if name in known and name in values and base.name != "equation" and not low <= values[name] < high:
            shown = "" if units[name] == "1" else f" {units[name]}"
            raise tables.complain(f"found {values[name]:g}{shown}, expected {expected}", "parameters", name)
    return values, units, options


def _exponent(tables: Tables) -> float:
    value = tables.get("parameters", "n", default=tables.get("fit", "n", "value", default=1.0))
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise tables.complain(f"found {shorten(value)}, expected a number", "parameters", "n") from None


def _free_number(tables: Tables, *path: str) -> tuple[float, str]:
    """A constant of the user's own: a number is SI; text carries its unit and is taken to SI."""
    from hil.units import read_unit, units
    from host_tools.workbench.units import quantity

    value = tables.get(*path)
    if isinstance(value, str):
        _, _, unit = value.strip().partition(" ")
        try:
            base_unit = str(units().Quantity(1.0, read_unit(unit)).to_base_units().units)
            return quantity(value, base_unit), base_unit
        except (TypeError, ValueError, ArithmeticError) as error:
            raise tables.complain(str(error), *path) from None
    return tables.number("1", *path), ""


def _estimates(tables: Tables, base: Base, constants: Mapping[str, float]) -> dict[str, Estimate]:
    from host_tools.workbench.units import check

    estimates = {}
    for name, entry in tables.table("fit").items():
        path = ("fit", name)
        if name in constants:
            raise tables.complain("stands in [parameters] too, expected in one of the two", *path)
        if base.name != "equation" and name not in base.parameters:
            raise tables.complain(f"unknown name, expected one of {', '.join(base.parameters)}", *path)
        if not isinstance(entry, dict):
            raise tables.complain(f"found {entry!r}, expected {{ value = , min = , max = }}", *path)
        if base.name == "equation":
            tables.allow(path, "value", "min", "max", "unit")
            unit = tables.text(*path, "unit", default="")
            try:
                check(unit)
            except ValueError as error:
                raise tables.complain(str(error), *path, "unit") from None
        else:
            tables.allow(path, "value", "min", "max")
            unit = base.parameters[name].replace("^n", f"^{_exponent(tables)}")
        estimates[name] = read_estimate(tables, path, unit)
    return estimates


def read_estimate(tables: Tables, path: tuple[str, ...], unit: str, standard: Estimate | None = None) -> Estimate:
    """{ value, min, max } at `path`, in `unit`; what is missing comes from `standard`."""
    limits = {"value": None, "min": -np.inf, "max": np.inf}
    if standard is not None:
        limits = {"value": standard.value, "min": standard.minimum, "max": standard.maximum}
    numbers = {}
    for key, default in limits.items():
        if tables.get(*path, key) is None:
            if default is None:
                raise tables.complain("missing, expected a start value", *path, key)
            numbers[key] = float(default)
        else:
            numbers[key] = tables.number(unit, *path, key)
    value, low, high = numbers["value"], numbers["min"], numbers["max"]
    if low >= high:
        raise tables.complain(f"found min {low:g} and max {high:g}, expected min below max", *path)
    if tables.get(*path, "value") is None:
        value = min(max(value, low), high)
    if not low <= value <= high:
        raise tables.complain(f"found value {value:g}, expected between min {low:g} and max {high:g}", *path)
    return Estimate(path[-1], value, low, high, unit)


def _fit_units(fit: Mapping[str, Estimate]) -> dict[str, str]:
    return {name: estimate.unit for name, estimate in fit.items() if estimate.unit}


def _scales(equations: Mapping[str, Expression], units: Mapping[str, str], complain: Complaint) -> dict[str, float]:
    """Check the units of equations whose names all have one; their numbers then go through SI.

    Where a unit is missing the formula works on the numbers as they stand in the file.
    """
    from host_tools.workbench.units import same_kind, si_factor

    if not equations or not all(e.names <= units.keys() for e in equations.values()):
        return {}
    for channel, expression in equations.items():
        path = ("model", "equation", channel)
        try:
            found = str(expression.unit(units)) or "1"
        except ValueError as error:
            raise complain(str(error), *path) from None
        if not same_kind(found, units[channel]):
            raise complain(f"{expression} is in {found}, expected {units[channel]}", *path)
    names = {*equations, *(name for e in equations.values() for name in e.names)}
    return {name: si_factor(units[name]) for name in names}


def _check_names(case: Case, complain: Complaint) -> None:
    """Every effect exists and has what it needs; every parameter of the model is known or fitted."""
    for name in case.effects:
        require_effect(case, name, complain)
    for name in case.base.parameters:
        if name not in case.parameters and name not in case.fit:
            raise complain(f"{name} is missing, expected it here or in [fit]", "parameters")
    for role in case.base.needs:
        if role not in case.roles and role not in case.parameters:
            raise complain(f"role {role} is not mapped, expected it (or a constant in [parameters])", "data", "columns")
    if not any(channel in case.channels for channel in case.base.channels):
        expected = ", ".join(case.base.channels)
        raise complain(f"no channel is mapped, expected one of {expected}", "data", "columns")
    known = {*case.inputs, *case.parameters, *case.fit}
    for channel, expression in case.equations.items():
        unknown = sorted(expression.names - known)
        if unknown:
            raise complain(f"{unknown[0]} is no column, parameter or fitted name", "model", "equation", channel)


def require_effect(case: Case, name: str, complain: Complaint) -> Effect:
    """The effect of that name, or a complaint about why this case cannot have it."""
    path = ("model", "effects")
    effect = case.library.get(name)
    if effect is None:
        if name in catalogue():
            bases = " or ".join(catalogue()[name].bases)
            raise complain(f"{name} acts on {bases}, found base {case.base.name}", *path)
        raise complain(f"unknown effect {name}, expected one of {', '.join(case.library) or '(none)'}", *path)
    role = case.missing_role(effect)
    if role:
        kind = "constant" if role in effect.constants else "role"
        raise complain(f"{name} needs the {kind} {role}, which the case does not have", *path)
    known = {*case.inputs, *case.parameters, *case.fit, *case.base.parameters, *effect.options}
    known |= {parameter.name for parameter in effect.parameters} | {"bulldozing_resistance", "speed"}
    known |= {formula_name(name) for name in case.base.provides}
    from hil.physics.expression import parse

    unknown = sorted(parse(effect.expression).names - known)
    if unknown:
        raise complain(f"{name}: {unknown[0]} is no role, column or parameter", "effect", name, "expression")
    for role in effect.positive:
        values = case.roles.get(role)
        if values is not None and (values <= 0).any():
            row = int(np.flatnonzero(values <= 0)[0])
            raise UserError(
                f"{case.place(row)}: column {case.column_of[role]}: found {role} {values[row]:g}, "
                f"expected more than 0 ({name} needs it)"
            )
    return effect
