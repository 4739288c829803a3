"""[model.states], [model.derivative] and [model.measured]: differential equations of the user's own."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

from terrapin_hil.physics.expression import Operation, is_name
from terrapin_hil.units import read_unit, unit_in_formula
from terrapin_tools.workbench.bases import Base
from terrapin_tools.workbench.bases.kinds.base import GAIN, Dynamics, State
from terrapin_tools.workbench.case.columns import Measurements, read_formulas
from terrapin_tools.workbench.case.effect_units import contradiction, plain
from terrapin_tools.workbench.files.toml_tables import Complaint, Tables
from terrapin_tools.workbench.files.units import in_si, quantity

__all__ = ["check_dynamics", "read_dynamics", "with_states"]

BETWEEN = ("linear", "held")  # inputs between rows


def read_dynamics(tables: Tables, base: Base, measured: Measurements) -> Dynamics | None:
    """The states and their derivatives; None for a base that has its own. UserError names file, line and field."""
    if not base.own_dynamics:
        for name in ("states", "derivative", "measured", "inputs"):
            if tables.get("model", name) is not None:
                raise tables.complain(f'expected only with base = "ode", found base {base.name}', "model", name)
        return None
    derivative = read_formulas(tables, "model", "derivative", expected="STATE = FORMULA for each state")
    states = {name: _state(tables, measured, name) for name in tables.table("model", "states")}
    for name in derivative:
        if name not in states:
            expected = ", ".join(states) or "a state in [model.states]"
            raise tables.complain(f"no state has this name, expected one of {expected}", "model", "derivative", name)
    for name in states:
        if name not in derivative:
            raise tables.complain("has no line in [model.derivative], expected one", "model", "states", name)
    between = tables.text("model", "inputs", default=BETWEEN[0])
    if between not in BETWEEN:
        raise tables.complain(f"found {between!r}, expected one of {', '.join(BETWEEN)}", "model", "inputs")
    return Dynamics(states, derivative, between == "held", between == "held")


def _state(tables: Tables, measured: Measurements, name: str) -> State:
    path = ("model", "states", name)
    if not is_name(name):
        raise tables.complain("found a name that formulas cannot use, expected letters a to z, digits and _", *path)
    tables.entry(path, "initial", "unit")
    for table in (("parameters",), ("fit",)):
        if name in tables.table(*table):
            raise tables.complain(f"stands in [{table[0]}] too, expected another name", *path)
    if name in measured.roles:
        raise tables.complain("is a mapped column that is no channel too, expected another name", *path)
    given = tables.unit(*path, "unit", default="")
    unit = in_si(given)
    initial = tables.get(*path, "initial")
    if initial is None:
        raise tables.complain('missing, expected a number, "fit" or the name of a column', *path, "initial")
    columns = {**measured.extra, **measured.roles, **measured.channels}
    if initial == "fit":
        return State(unit, None)
    if isinstance(initial, str) and initial in columns:
        return State(unit, initial)
    try:
        number = quantity(f"{initial} {given}" if given and not isinstance(initial, str) else initial, unit or "1")
    except ValueError:
        expected = f'a number, "fit" or one of {", ".join(columns)}'
        raise tables.complain(f"found {initial!r}, expected {expected}", *path, "initial") from None
    return State(unit, number)


def with_states(base: Base, dynamics: Dynamics | None) -> Base:
    """The base whose effects know the states and may act on their derivatives."""
    if dynamics is None:
        return base
    forces = {f"derivative.{name}": _per_second(state.unit) for name, state in dynamics.states.items()}
    # what is a state itself, or a number, is a definition: no law that might go with a column
    laws = [name for name, formula in dynamics.derivative.items() if isinstance(formula.tree, Operation)]
    return replace(base, provides=tuple(dynamics.states), forces=forces, further=tuple(GAIN + name for name in laws))


def _per_second(unit: str) -> str:
    return plain(unit_in_formula(unit) / read_unit("s")) if unit else ""


def check_dynamics(
    dynamics: Dynamics, base: Base, measured: Measurements, units: Mapping[str, str], known: Collection[str],
    complain: Complaint,
) -> None:  # fmt: skip
    """Every name of the formulas is known (`known`: columns, constants, fitted), and the units that are given agree.

    `units` are those of columns, constants and fitted parameters.
    """
    every = {*known, *dynamics.states}
    for table, formulas in (("derivative", dynamics.derivative), ("measured", measured.equations)):
        for name, formula in formulas.items():
            for unknown in sorted(formula.names - every):
                what = "no state, column, parameter or fitted name"
                raise complain(f"{unknown} is {what}", "model", table, name)
    given = {**units, **{name: state.unit for name, state in dynamics.states.items()}}
    wanted = {("derivative", name): base.forces[f"derivative.{name}"] for name in dynamics.derivative}
    wanted |= {("measured", name): measured.units[name] for name in measured.equations}
    for (table, name), unit in wanted.items():
        formula = (dynamics.derivative if table == "derivative" else measured.equations)[name]
        if unit and (problem := contradiction(formula, given, unit)) is not None:
            raise complain(problem, "model", table, name)
