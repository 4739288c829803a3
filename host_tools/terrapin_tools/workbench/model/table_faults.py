"""Faults of the table as suspects: a column that is scaled, has lost its sign, or is late by a row.

Each changes what the model reads, or what is recorded of what it predicts; nothing is fitted, so what it explains is
weighed against its prior alone. The measurements stay as they are: dividing a channel by 1000 must not make its misfit
small.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from terrapin_hil.arrays import Array, Index, Mask
from terrapin_hil.physics.effects import Effect
from terrapin_hil.physics.signals import row_steps
from terrapin_tools.workbench.bases import formula_name
from terrapin_tools.workbench.bases.kinds.base import Dynamics
from terrapin_tools.workbench.case.case import Case
from terrapin_tools.workbench.case.changes import TABLE
from terrapin_tools.workbench.case.intake import BOTH_WAYS
from terrapin_tools.workbench.files.units import same_kind

__all__ = [
    "UNUSUAL",
    "Fault",
    "at_fault",
    "fault_of",
    "faults",
    "faults_over_time",
    "held",
    "read",
    "recorded",
    "scalable",
    "usual_scales",
]

ANGLES = ("rad", "rad/s", "rad/s^2", "")  # units of a role or channel; "" : none is stated
FORCES = ("N", "N m", "Pa", "")
# What a column must be multiplied by where its unit was taken for another one, and the inverse of each: the factor, and
# the units of columns to which it happens. Elsewhere it costs UNUSUAL, as numbers may be wrong without a reason.
FACTORS = {
    "a mistaken direction": (-1.0, None),
    "turns a minute": (np.pi / 30.0, ANGLES),
    "degrees": (np.pi / 180.0, ANGLES),
    "kilograms of force": (9.80665, FORCES),
    "thousandths": (1e-3, None),
}
# The same, only where the unit of the column is one of these.
OF_UNIT = {
    "turns": (2.0 * np.pi, ("rad/s", "rad", "")),
    "minutes": (60.0, ("rad/s", "s", "")),
    "km/h": (1.0 / 3.6, ("m/s", "")),
    "hundredths": (1e-2, ("m", "1", "")),
    "tenths": (0.1, ("m", "mm", "cm")),
    "metric horsepower": (75.0 * 9.80665, ("W",)),
    "horsepower": (745.69987, ("W",)),
}
RARE = ("minutes",)  # of those: an angular speed is counted in radians a minute by hardly anybody
UNUSUAL = float(np.log(20.0))  # log evidence; chosen by hand
LATE = 1  # rows


@dataclass(frozen=True)
class Fault(Effect):
    """An effect without parameters that stands for a change of the column `column` (a role's or a channel's name).

    `factor`: what its numbers have to be multiplied by. `sign_of`: role or channel whose sign they lack. `late`: rows
    by which they come after the others of their run. `held`: inputs of the user's own equations, of which `column` is
    the first, keep each value until the next row. `cost`: log evidence that it takes to be told: a sign that is read
    off what is predicted is fitted, once for each stretch in which it stays; and some factors are rare.
    """

    column: str = ""
    factor: float = 1.0
    sign_of: str = ""
    late: int = 0
    held: bool = False
    cost: float = 0.0

    @property
    def mend(self) -> dict[str, float | str | int]:
        """What puts the column right, as an entry of [data.columns] says it (case/mends.py)."""
        found: dict[str, float | str | int] = {}
        if self.factor != 1.0:
            found["factor"] = float(f"{self.factor:.9g}")
        if self.sign_of:
            found["sign_of"] = self.sign_of
        if self.late:
            found["delay"] = self.late
        if self.held:
            found["inputs"] = "held"
        return found


def faults(case: Case) -> list[Fault]:
    """Every fault that the mapped columns of a case may have; none where a model integrates over a run."""
    if case.base.whole_runs:
        return []
    columns = {**case.roles, **{name: case.channels[name] for name in case.base.channels if name in case.channels}}
    signed = [name for name, values in columns.items() if _reverses(values)]
    found = []
    for name, values in columns.items():
        found += _scales(case, name)
        if not _reverses(values):
            lacks = {other: f"lacks the sign of {other}" for other in signed}
            found += [_fault(case, name, "sign", t, sign_of=o, cost=_cost(case, o)) for o, t in lacks.items()]
        if _varies(values, case.run):
            found.append(_fault(case, name, "delay", f"comes {LATE} row late", late=LATE))
    return found


def _scales(case: Case, name: str) -> list[Fault]:
    """Every factor by which a column may be wrong."""
    unit, found = case.units[name] or "", []
    for about, (factor, units) in {**FACTORS, **{a: f for a, f in OF_UNIT.items() if unit in f[1]}}.items():
        inverse = () if factor == -1.0 else (1.0 / factor,)
        fits = units is None or unit in units or any(other and same_kind(unit, other) for other in units)
        usual = about not in RARE and fits
        for f in (factor, *inverse):
            title = _scaled(about, f, factor) if fits else f"is wrong by a factor of {f:.4g}"
            found.append(_fault(case, name, "scale", title, factor=f, cost=0.0 if usual else UNUSUAL))
    return found


def faults_over_time(case: Case, misfit: Callable[[Fault | None], float]) -> list[Fault]:
    """Scales of the channels of a model that integrates over a run, where each refit takes long, and of the inputs of
    the user's own equations: of each column the one that takes most of the misfit, if it halves it. `misfit`: that of
    a fit with a fault, or without one, on some of the rows."""
    found, driven = [], _driven(case)
    for name in scalable(case):
        usual = usual_scales(case, name)
        left = [misfit(fault) for fault in usual]
        if min(left) < 0.5 * misfit(None):
            found.append(usual[int(np.argmin(left))])
    if driven and case.dynamics is not None and not case.dynamics.held:
        several = "and the other inputs keep their values" if len(driven) > 1 else "keeps its value"
        found.append(_fault(case, driven[0], "held", f"{several} until the next row", held=True))
    return found


def scalable(case: Case) -> list[str]:
    """Columns of a model that integrates over a run that may be in another unit."""
    return [*case.channels, *_driven(case)]


def usual_scales(case: Case, name: str) -> list[Fault]:
    """Factors that a column of its unit is usually wrong by; the choice among them is what each costs."""
    usual = [fault for fault in _scales(case, name) if not fault.cost]
    return [replace(fault, cost=float(np.log(len(usual)))) for fault in usual]


def _driven(case: Case) -> list[str]:
    """Inputs that drive the user's own equations: they vary within a run."""
    if case.dynamics is None:
        return []
    names = set().union(*(one.names for one in (*case.dynamics.derivative.values(), *case.equations.values())))
    return [n for n, v in case.roles.items() if n != "time" and formula_name(n) in names and _varies(v, case.run)]


def at_fault(effect: str) -> bool:
    """Whether a name is that of a fault of the table.

    >>> at_fault("table.omega.scale"), at_fault("stribeck")
    (True, False)
    """
    return effect.startswith(TABLE)


def fault_of(case: Case, name: str, mend: Mapping[str, float | str | int]) -> Fault:
    """The fault of that name which is put right by `mend`."""
    column, kind = name.removeprefix(TABLE).rsplit(".", 1)
    factor, late = float(mend.get("factor", 1.0)), int(mend.get("delay", 0))
    sign_of, held = str(mend.get("sign_of", "")), mend.get("inputs") == "held"
    return _fault(case, column, kind, "is wrong", factor=factor, sign_of=sign_of, late=late, held=held)


def _scaled(about: str, factor: float, listed: float) -> str:
    return f"has {about}" if factor == -1.0 else f"is in {about}" if factor == listed else f"is taken for {about}"


def _fault(case: Case, column: str, kind: str, title: str, **change: float | str) -> Fault:
    return Fault(
        name=f"{TABLE}{column}.{kind}",
        title=f"{column} {title}",
        equation="",
        source="the measurements themselves",
        bases=(case.base.name,),
        parameters=(),
        needs=(),
        expression="0",
        target=column,
        plant=False,
        column=column,
        **change,  # type: ignore[arg-type]
    )


def _reverses(values: Array) -> bool:
    return bool(min((values > 0.0).mean(), (values < 0.0).mean()) > BOTH_WAYS)


def _cost(case: Case, sign_of: str) -> float:
    if sign_of not in case.channels:
        return 0.0
    sign = np.sign(case.channels[sign_of])
    order = np.argsort(case.run, kind="stable")
    return float(np.log(2.0) * (1 + ((np.diff(sign[order]) != 0.0) | (np.diff(case.run[order]) != 0)).sum()))


def _varies(values: Array, run: Index) -> bool:
    """Whether a column changes from row to row within a run."""
    steps = row_steps(values, run)
    return bool(steps.size and np.abs(steps).max() > 1e-9 * max(float(np.ptp(values)), 1e-300))


def read(found: Sequence[Fault], inputs: Mapping[str, Array], case: Case) -> dict[str, Array]:
    """The inputs as the model has to read them: (rows,) each, all rows of the case or settings that are proposed."""
    changed = dict(inputs)
    for fault in found:
        name = formula_name(fault.column)
        if name not in changed or fault.column in case.channels:
            continue
        values = changed[name]
        if len(values) != case.rows:
            continue  # a setting that is proposed is what it says
        if fault.sign_of:
            values = np.abs(values) * np.sign(_measured(case, fault.sign_of))
        changed[name] = fault.factor * (values[_shifted(case.run, -fault.late)] if fault.late else values)
    return changed


def held(dynamics: Dynamics | None, found: Sequence[Fault]) -> Dynamics | None:
    """The equations as the inputs drive them, with faults."""
    return replace(dynamics, held=True) if dynamics is not None and any(one.held for one in found) else dynamics


def recorded(
    found: Sequence[Fault], channels: Sequence[str], case: Case, rows: Mask | None
) -> Callable[[Array], Array] | None:
    """What the record shows of a prediction (..., channels, rows), or of its derivatives; None where it shows it as it
    is. `rows`: mask of the case's rows that are predicted, None for all."""
    mine = [fault for fault in found if fault.column in channels]
    if not mine:
        return None

    def change(predicted: Array) -> Array:
        shown = predicted.copy()
        for fault in mine:
            at = channels.index(fault.column)
            if fault.late:
                run = case.run if rows is None else case.run[rows]
                shown[..., at, :] = shown[..., at, _shifted(run, fault.late)]
            if fault.sign_of:
                sign = np.sign(_measured(case, fault.sign_of))
                shown[..., at, :] *= sign if rows is None else sign[rows]
            shown[..., at, :] /= fault.factor
        return shown

    return change


def _measured(case: Case, name: str) -> Array:
    return case.roles[name] if name in case.roles else case.channels[name]


def _shifted(run: Index, late: int) -> Index:
    """For each row the place `late` rows before it in its run, or its own where there is none."""
    order = np.argsort(run, kind="stable")
    at = np.arange(len(run))
    there = np.clip(at - late, 0, len(run) - 1)
    found = np.empty_like(order)
    found[order] = order[np.where(run[order][there] == run[order], there, at)]
    return found
