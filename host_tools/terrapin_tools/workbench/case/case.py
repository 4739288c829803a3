"""A case: the folder's case.toml and measurements, checked and in canonical units. See docs/cases.md for the contract.

Anything wrong is a UserError of one line: file, line or row, field, what was found, what was expected.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics.effects import Effect, catalogue
from terrapin_hil.physics.expression import Expression, is_name, parse
from terrapin_hil.physics.mechanics import mechanics
from terrapin_hil.reading import shorten
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases import BASES, ELSEWHERE, ROLES, Base, formula_name
from terrapin_tools.workbench.bases.kinds.base import GAIN, Dynamics
from terrapin_tools.workbench.case.columns import Measurements, read_measurements
from terrapin_tools.workbench.case.dynamics import check_dynamics, read_dynamics, with_states
from terrapin_tools.workbench.case.effect_units import contradiction
from terrapin_tools.workbench.case.effects import OWN, read_library, sound
from terrapin_tools.workbench.case.goal import read_goal
from terrapin_tools.workbench.case.groups import read_shares
from terrapin_tools.workbench.case.instruments import channel_delays, zero_points
from terrapin_tools.workbench.case.intake import beyond, differences, guesses
from terrapin_tools.workbench.case.mechanics import Told, mechanics_of
from terrapin_tools.workbench.case.rig_limits import read_limits
from terrapin_tools.workbench.files.tables import Table
from terrapin_tools.workbench.files.toml_tables import (
    Complaint,
    Estimate,
    Tables,
    case_tables,
    read_case_text,
    read_estimate,
)
from terrapin_tools.workbench.files.units import CELSIUS, in_si, quantity, same_kind, shifted, si_factor

__all__ = ["Case", "load_case", "parse_case", "require_effect"]


_POSITIVE = (1e-30, np.inf, "more than 0")
RANGES = {  # known constants: lowest, what they stay below, in words
    **dict.fromkeys(("radius", "drive_radius", "torque_constant", "width", "n", "shear_modulus", "load"), _POSITIVE),
    "cohesion": (0.0, np.inf, "0 or more"),
    "friction_angle": (0.0, np.pi / 2, "0 to less than 90 deg"),
}


@dataclass(frozen=True, kw_only=True)
class Case(Measurements):
    """Everything a model and a fit need: the measurements, and what case.toml says about them."""

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
    library: Mapping[str, Effect]  # that this base may take: the catalogue with the case's bounds, and the user's own
    scales: Mapping[str, float]  # equation with all units given: what takes a name's number to SI; else empty
    limits: Mapping[str, tuple[float, float]]  # what the rig can set: role -> lowest, highest
    goal: Mapping[str, float]  # the rms error of a channel that is good enough, where the user says so
    guessed: tuple[str, ...]  # what nobody has confirmed, as TABLE.KEY
    dynamics: Dynamics | None  # of the user's own
    by: Mapping[str, str]  # fitted parameter -> the grouping of which each group has its own value
    held: Mapping[str, Table] = field(repr=False)  # tables that stand in no file, by their names in data.files

    def changed(self, text: str) -> Case:
        """The case whose case.toml has `text`. UserError as `parse_case`."""
        return parse_case(self.folder, text, self.held)

    @property
    def intake(self) -> tuple[str, ...]:
        """What a reader has to know of the numbers before the answer."""
        return (*self.remarks, *beyond(self.parameters), *guesses(self.guessed))

    @property
    def stated(self) -> dict[str, tuple[float, str]]:
        """Constants in SI, each with the unit that an estimate of it in [fit] needs: "" where the base knows it."""
        own = self.parameter_units if self.base.own_names else {}
        return {name: (value, own.get(name, "")) for name, value in self.parameters.items()}

    @property
    def rows(self) -> int:
        return len(self.run)

    @cached_property
    def inputs(self) -> dict[str, Array]:
        """What formulas may use: roles and unmapped columns by their names in formulas."""
        extra = {name: values for name, values in self.extra.items() if is_name(name)}
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


def parse_case(folder: Path, text: str, held: Mapping[str, Table] | None = None) -> Case:
    """Read a case whose case.toml has `text`; the measurements come from `folder`, or are `held` by their names."""
    held = held or {}
    tables = case_tables(folder, text)
    complain = tables.complain
    name = tables.get("model", "base")
    if isinstance(name, str) and name in ELSEWHERE:  # its case.toml has more tables
        raise complain(f"found {name!r}, which is for {ELSEWHERE[name]}", "model", "base")
    tables.allow((), "case", "model", "parameters", "fit", "effect", "limits", "data", "groups", "goal")
    tables.allow(("case",), "title", "notes", "source", "comment", "license", "date", "guessed")
    tables.allow(
        ("model",), "base", "effects", "effects_folder", "equation", "states", "derivative", "measured", "inputs"
    )
    title = tables.text("case", "title", default=folder.resolve().name)
    base_name = tables.text("model", "base")
    if base_name not in BASES:
        raise complain(f"found {base_name!r}, expected one of {', '.join(BASES)}", "model", "base")
    base = BASES[base_name]
    effects = tuple(tables.texts("model", "effects", default=[]))
    measured = read_measurements(folder, tables, base, held)
    if measured.equations:
        base = replace(base, channels={name: measured.units[name] for name in measured.channels})
    base = base.with_formulas(measured.equations, tables.table("fit"))
    dynamics = read_dynamics(tables, base, measured)
    base = with_states(base, dynamics)
    library, effect_names = read_library(folder, tables, base, _mechanics(tables, measured, base))
    formulas = _formulas(measured, dynamics, library)
    on_scale = _on_scale(tables, measured, dynamics)
    beside = {name for formula in formulas if formula.names & on_scale for name in formula.names}
    parameters, parameter_units, options = _constants(tables, base, library, effect_names, beside)
    fit = _estimates(tables, base, parameters)
    for name, known in base.parameters.items():
        if known.default is not None and name not in fit and name not in parameters:
            parameters[name], parameter_units[name] = known.default, known.unit
    measured = _without(measured, {*tables.table("parameters"), *fit})
    units = {**measured.units, **parameter_units, **_fit_units(fit)}
    if dynamics is not None:
        names = {*measured.roles, *measured.extra, *parameters, *fit}
        check_dynamics(dynamics, base, measured, units, names, complain)
        units |= {name: state.unit for name, state in dynamics.states.items() if state.unit}
    if base.own_names:  # last: a name that is none in a formula explains one that stands in none
        _check_own(measured, parameters, fit, formulas, complain)
    scales = {**measured.units, **parameter_units}
    _check_celsius({("model", "measured" if dynamics else "equation"): measured.equations}, scales, complain)
    if dynamics is not None:
        _check_celsius({("model", "derivative"): dynamics.derivative}, scales, complain)
    limits = read_limits(tables, base, measured.units, measured.extra, measured.column_of)
    more = {} if dynamics is None else {**{n: s.unit for n, s in dynamics.states.items()}, **base.forces}
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
        library=sound(tables, base, library, units),
        scales={}
        if dynamics
        else _scales(measured.equations, {**parameter_units, **_fit_units(fit)}, measured.units, complain),
        limits=limits,
        goal=read_goal(tables, {name: measured.units[name] for name in measured.channels}, measured.channels),
        dynamics=dynamics,
        by=read_shares(tables, measured.groups),
        guessed=_guessed(tables),
        held=held,
        **{
            **vars(measured),
            "units": {**more, **measured.units},
            "remarks": (*measured.remarks, *differences(formulas, units, on_scale)),
        },
    )
    _check_names(case, complain)
    return case


def _mechanics(tables: Tables, measured: Measurements, base: Base) -> dict[str, Effect]:
    """What the roles and columns of an equation's inputs bring. UserError when its time does not rise within a run."""
    told = {r: Told(formula_name(n), measured.units[n] or "1", measured.roles[n]) for r, n in measured.told.items()}
    if "time" in told:
        falls = (np.diff(told["time"].values) <= 0.0) & (np.diff(measured.run) == 0)
        if falls.any():
            name, row = measured.told["time"], int(np.flatnonzero(falls)[0]) + 1
            value = told["time"].values[row]
            raise UserError(
                f"{measured.place(row)}: column {measured.column_of[name]}: found {value:g} after "
                f"{told['time'].values[row - 1]:g}, expected a time that rises within a run"
            )
    names = {name for formula in measured.equations.values() for name in formula.names}
    known = {*tables.table("parameters"), *tables.table("fit")}
    columns = {formula_name(n): values for n, values in {**measured.roles, **measured.extra}.items()}
    units = {formula_name(n): unit or "1" for n, unit in measured.units.items()}
    formulas = {} if base.own_dynamics else measured.equations
    zeros = zero_points(formulas, columns, {**dict.fromkeys(columns, "1"), **units})
    if base.own_dynamics and "time" in measured.roles:
        zeros |= channel_delays(list(measured.channels), measured.roles["time"], measured.run)
    return zeros | mechanics_of(told, {n: measured.units[n] or "1" for n in measured.channels}, names & known)


def _guessed(tables: Tables) -> tuple[str, ...]:
    """[case] guessed: places in case.toml that hold a placeholder."""
    places = tables.texts("case", "guessed", default=[])
    for place in places:
        if tables.get(*place.split(".")) is None:
            raise tables.complain(f"{place} is not there, expected TABLE.KEY of this file", "case", "guessed")
    return tuple(places)


def _notes(folder: Path, tables: Tables) -> str:
    name = tables.text("case", "notes", default="")
    if not name:
        return ""
    try:
        return (folder / name).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        raise tables.complain(f"found {name!r}, expected a readable text file in the case", "case", "notes") from None


def _formulas(measured: Measurements, dynamics: Dynamics | None, library: Mapping[str, Effect]) -> list[Expression]:
    """All formulas that the user wrote."""
    own = (parse(effect.expression) for effect in library.values() if effect.source == OWN)
    return [*measured.equations.values(), *(dynamics.derivative.values() if dynamics else ()), *own]


def _on_scale(tables: Tables, measured: Measurements, dynamics: Dynamics | None) -> set[str]:
    """Columns, states and fitted names, as formulas call them, that are temperatures in degC."""
    units = {formula_name(name): unit for name, unit in measured.units.items()}
    units |= {name: state.unit for name, state in (dynamics.states if dynamics else {}).items()}
    units |= {name: str(tables.get("fit", name, "unit", default="")) for name in tables.table("fit")}
    return {name for name, unit in units.items() if unit in CELSIUS}


def _check_own(
    measured: Measurements, parameters: Collection[str], fit: Collection[str], formulas: Collection[Expression],
    complain: Complaint,
) -> None:  # fmt: skip
    """A name of a formula means one thing, and each fitted one stands in a formula."""
    for table, names in (("parameters", parameters), ("fit", fit)):
        if twice := next((name for name in names if name in {*measured.roles, *measured.channels}), None):
            raise complain("is a mapped column too, expected another name", table, twice)
    read = {name for formula in formulas for name in formula.names}
    if idle := next((name for name in fit if name not in read), None):
        raise complain("stands in no formula, so nothing tells its value; expected it in one", "fit", idle)


def _without(measured: Measurements, stated: Collection[str]) -> Measurements:
    """Without unmapped columns of a name that case.toml gives to a number: a formula means that."""
    taken = sorted(measured.extra.keys() & {*stated})
    if not taken:
        return measured
    remark = f"Not looked at, as a constant or a fitted value has the name: {', '.join(taken)}."
    extra = {name: values for name, values in measured.extra.items() if name not in taken}
    return replace(measured, extra=extra, remarks=(*measured.remarks, remark))


def _constants(
    tables: Tables, base: Base, library: Mapping[str, Effect], effect_names: frozenset[str], beside: Collection[str]
) -> tuple[dict[str, float], dict[str, str], dict[str, str]]:
    """[parameters]: numbers in SI, their units as far as known, and the options. A temperature is in degC where it
    stands `beside` one that is, else in K."""
    known = {**{formula_name(role): unit for role, unit in ROLES.items()}, **base.units}
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
            values[name] = tables.truth(*path)
        elif name in known:
            unit = known[name].replace("^n", f"^{_exponent(tables)}")
            values[name], units[name] = tables.number(unit, *path), unit
        elif base.own_names or name in effect_names:
            values[name], unit_text = _free_number(tables, "degC" if name in beside else "kelvin", *path)
            if unit_text:
                units[name] = unit_text
        else:
            names = sorted({*known, *base.options, *flags})
            raise tables.complain(f"unknown name, expected one of {', '.join(names)}", *path)
    for name, (low, high, expected) in RANGES.items():
        if name in known and name in values and not base.own_names and not low <= values[name] < high:
            shown = "" if units[name] == "1" else f" {units[name]}"
            raise tables.complain(f"found {values[name]:g}{shown}, expected {expected}", "parameters", name)
    return values, units, options


def _exponent(tables: Tables) -> float:
    value = tables.get("parameters", "n", default=tables.get("fit", "n", "value", default=1.0))
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise tables.complain(f"found {shorten(value)}, expected a number", "parameters", "n") from None


def _free_number(tables: Tables, scale: str, *path: str) -> tuple[float, str]:
    """A constant of the user's own: a number is SI; text carries its unit and is taken to SI, what is in degC to
    `scale`."""
    value = tables.get(*path)
    if isinstance(value, str):
        _, _, unit = value.strip().partition(" ")
        try:
            base_unit = in_si(unit) or "1"
            base_unit = scale if base_unit == "degC" else base_unit
            return quantity(value, base_unit), base_unit
        except (TypeError, ValueError, ArithmeticError) as error:
            raise tables.complain(str(error), *path) from None
    return tables.number("1", *path), ""


def _estimates(tables: Tables, base: Base, constants: Mapping[str, float]) -> dict[str, Estimate]:
    estimates = {}
    for name in tables.table("fit"):
        path = ("fit", name)
        if name in constants:
            raise tables.complain("stands in [parameters] too, expected in one of the two", *path)
        if not base.own_names and name not in base.parameters:
            raise tables.complain(f"unknown name, expected one of {', '.join(base.parameters)}", *path)
        tables.entry(path, "value", "min", "max", also=("unit", "by") if base.own_names else ("by",))
        if base.own_names:
            unit = tables.unit(*path, "unit", default="")
        else:
            unit = base.units[name].replace("^n", f"^{_exponent(tables)}")
        estimates[name] = read_estimate(tables, path, unit)
        if unit and shifted(unit):
            expected = "degC, or K for a difference"
            raise tables.complain(f"found {unit!r}, whose zero is not that of SI, expected {expected}", *path, "unit")
        if base.own_dynamics and unit:
            estimates[name] = _taken_to_si(estimates[name])
    return estimates


def _taken_to_si(estimate: Estimate) -> Estimate:
    factor = si_factor(estimate.unit)
    value, low, high = (factor * one for one in (estimate.value, estimate.minimum, estimate.maximum))
    return Estimate(estimate.name, value, low, high, in_si(estimate.unit))


def _fit_units(fit: Mapping[str, Estimate]) -> dict[str, str]:
    return {name: estimate.unit for name, estimate in fit.items() if estimate.unit}


def _scales(
    equations: Mapping[str, Expression], stated: Mapping[str, str], columns: Mapping[str, str], complain: Complaint
) -> dict[str, float]:
    """Check the units of equations whose names all have one; their numbers then go through SI.

    A constant or fitted name without a unit is a pure number if others have one and the formulas are sound so. Where
    none has one, the formulas work on the numbers as they stand in the file.

    Parameters
    ----------
    stated : units of constants and fitted names.
    columns : units of roles and channels.

    Raises
    ------
    UserError : the units do not fit, or some are missing and numbers that are not SI would meet some that are.
    """
    if not equations:
        return {}
    units = {**stated, **columns}
    read = {name for e in equations.values() for name in e.names}
    if bare := sorted(read - units.keys()):
        if not read & stated.keys():
            return {}
        units |= dict.fromkeys(bare, "1")
        if any(_unsound(e, units, channel) for channel, e in equations.items()):
            other = next((n for n in sorted({*read, *equations} & columns.keys()) if si_factor(columns[n]) != 1.0), "")
            if not other:
                for channel, e in equations.items():
                    if wrong := contradiction(e, {n: units[n] for n in e.names - {*bare}}, units[channel]):
                        raise complain(wrong, "model", "equation", channel)
                return {}
            first = min(read & stated.keys())
            why = next(why for c, e in equations.items() if (why := _unsound(e, units, c)))
            pure = "a pure number" if len(bare) == 1 else "pure numbers"
            raise complain(
                f"{first} has a unit and {bare[0]} has none, so {other} would be read in {columns[other]} beside it; "
                f"expected units for {', '.join(bare)} too (as {pure}, as every number in a "
                f"formula is: {why})",
                "model", "equation", next(iter(equations)),
            )  # fmt: skip
    for channel, expression in equations.items():
        path = ("model", "equation", channel)
        try:
            found = str(expression.unit(units)) or "1"
        except ValueError as error:
            raise complain(str(error), *path) from None
        if not same_kind(found, units[channel]):
            raise complain(f"{expression} is in {found}, expected {units[channel]}", *path)
    names = {*equations, *(name for e in equations.values() for name in e.names)}
    if odd := next((name for name in sorted(names) if shifted(units[name])), None):
        raise complain(
            f"{odd} is in {units[odd]}, whose zero no factor takes to SI, expected degC (an entry of [data.derived] "
            "converts a column)",
            "model", "equation", next(iter(equations)),
        )  # fmt: skip
    return {name: si_factor(units[name]) for name in names}


def _check_celsius(
    formulas: Mapping[tuple[str, ...], Mapping[str, Expression]], units: Mapping[str, str], complain: Complaint
) -> None:
    """UserError where something is divided by a temperature in degC, or its logarithm or root is taken."""
    for path, each in formulas.items():
        for key, formula in each.items():
            for name in sorted(formula.divisors & units.keys()):
                if units[name] == "degC":
                    raise complain(
                        f"{name} is in degC, whose zero is no zero of temperature; "
                        f"expected ({name} + 273.15) where it divides, or stands in a logarithm or a root",
                        *path, key,
                    )  # fmt: skip


def _unsound(formula: Expression, units: Mapping[str, str], channel: str) -> str:
    """What is wrong with a formula's units, "" where nothing is."""
    try:
        found = str(formula.unit(units)) or "1"
    except ValueError as error:
        return str(error)
    return "" if same_kind(found, units[channel]) else f"{channel} would be in {found}"


def _check_names(case: Case, complain: Complaint) -> None:
    """Every effect exists and has what it needs; every parameter of the model is known or fitted."""
    for name in case.effects:
        require_effect(case, name, complain)
    for name in case.base.parameters:
        if name not in case.parameters and name not in case.fit:
            raise complain(f"{name} is missing, expected it here or in [fit]", "parameters")
    for role in case.base.needs:
        if role not in case.roles and (role == "time" or role not in case.parameters):
            also = "" if role == "time" else " (or a constant in [parameters])"
            raise complain(f"role {role} is not mapped, expected it{also}", "data", "columns")
    if not any(channel in case.channels for channel in case.base.channels):
        expected = ", ".join(case.base.channels)
        raise complain(f"no channel is mapped, expected one of {expected}", "data", "columns")
    known = {*case.inputs, *case.parameters, *case.fit}
    for law in sorted({*case.channels, *case.base.provides}):
        if GAIN + law in known and GAIN + law in case.base.further:
            raise complain(
                f"{GAIN + law} is what the formula of {law} is multiplied with, expected another name", "data"
            )
    for channel, expression in ({} if case.dynamics else case.equations).items():
        unknown = sorted(expression.names - known)
        if unknown:
            what = "is no column, parameter or fitted name"
            if unknown[0] in case.channels:
                what = "is predicted too, and formulas read inputs; expected it as an input, in a case of its own"
            raise complain(f"{unknown[0]} {what}", "model", "equation", channel)


def require_effect(case: Case, name: str, complain: Complaint) -> Effect:
    """The effect of that name, or a complaint about why this case cannot have it."""
    path = ("model", "effects")
    effect = case.library.get(name)
    if effect is None:
        if name in mechanics() and case.base.own_names:
            needs = " and ".join(" or ".join(group) for group in mechanics()[name].needs) or "role of any kind"
            needs = needs.replace("angle", "position, of an angle")
            hint = f"{name} needs a column that is told to be the {needs}"
            if case.told:
                hint += f", or the name of what it acts on: expected one of {', '.join(case.library)}"
            raise complain(f'{hint} (is = "...")', *path)
        if name in catalogue():
            bases = " or ".join(catalogue()[name].bases)
            raise complain(f"{name} acts on {bases}, found base {case.base.name}", *path)
        raise complain(f"unknown effect {name}, expected one of {', '.join(case.library) or '(none)'}", *path)
    role = case.missing_role(effect)
    if role:
        kind = "constant" if role in effect.constants else "role"
        raise complain(f"{name} needs the {kind} {role}, which the case does not have", *path)
    known = {*case.inputs, *case.parameters, *case.fit, *case.base.parameters, *effect.options}
    known |= {parameter.name for parameter in effect.parameters} | {"speed"}
    known |= {formula_name(name) for name in case.base.provides}
    known |= {"play": {"played"}, "rate": {"rate"}}.get(effect.transform, set())
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
