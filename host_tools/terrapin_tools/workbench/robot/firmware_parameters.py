"""The effects of a fitted model as parameters of the controller, in its fixed-point formats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from terrapin_hil.messages import Parameter, interface
from terrapin_hil.physics.effects import Effect, catalogue
from terrapin_hil.physics.expression import parse
from terrapin_tools.errors import UserError
from terrapin_tools.workbench.bases import BASES
from terrapin_tools.workbench.compare.comparison import Analysis

__all__ = ["Exported", "export_parameters", "parameters_toml", "torque_cost", "why_not"]


@dataclass(frozen=True)
class Exported:
    """One controller parameter: what the fit says, what the controller can hold."""

    name: str
    effect: str
    unit: str
    value: float
    raw: int
    scale: float

    @property
    def held(self) -> float:
        return self.raw * self.scale

    @property
    def rounding(self) -> float:
        return self.held - self.value


def why_not(effect: Effect) -> str:
    """Why the controller does not compensate an effect."""
    if effect.bases == ("equation",):
        return "acts in an equation of your own, which the controller does not compute"
    if effect.name not in catalogue():
        return "a formula of your own, and the controller computes only those that it has parameters for"
    if effect.where == "ground" and effect.plant:
        return "acts on the shell from outside: it is part of C_t, which is what the controller measures"
    if all(BASES[name].of_soil for name in effect.bases):
        return "belongs to the model of the soil or of the test rig; the controller computes neither"
    return "the controller has no parameter for it"


def _within(value: float, parameter: Parameter) -> float:
    """An angle that is outside the parameter's range, a whole number of turns nearer to zero."""
    if parameter.unit == "rad" and abs(value) > np.pi:
        return float(np.remainder(value + np.pi, 2.0 * np.pi) - np.pi)
    return value


def _constants(analysis: Analysis) -> dict[str, float]:
    """What formulas of controller parameters name beside the effect's own: means over the rows, and the model's."""
    roles = {role: float(np.mean(values[analysis.rows])) for role, values in analysis.case.roles.items()}
    return {**roles, **analysis.case.parameters}


def export_parameters(analysis: Analysis) -> tuple[list[Exported], list[str]]:
    """Parameters for the effects that the controller can compensate, and the names of those that it cannot.

    UserError when none can be, or a value is outside the controller's range.
    """
    description = interface()
    constants = _constants(analysis)
    values = dict(zip((f.key for f in analysis.model.fitted), analysis.fit.theta, strict=True))
    exported, refused = [], []
    for effect in analysis.model.effects:
        if not effect.firmware:
            refused.append(effect.name)
        for name, formula in effect.firmware.items():
            own = {p.name: float(values[f"{effect.name}.{p.name}"]) for p in effect.parameters}
            value = float(parse(formula).evaluate({**constants, **own}))
            parameter = description.parameter(name)
            value = _within(value, parameter)
            try:
                raw = parameter.raw(value)
            except ValueError as error:
                raise UserError(f"{effect.name}: {error}: the controller cannot hold it") from None
            exported.append(Exported(name, effect.name, parameter.unit, value, raw, parameter.scale))
    if not exported:
        refusals = [f"{e.name} ({why_not(e)})" for e in analysis.model.effects]
        found = "; ".join(refusals) or "none"
        raise UserError(
            f"{analysis.case.folder}: effects in the model: {found}; expected one that the controller compensates"
        )
    return exported, refused


def torque_cost(analysis: Analysis, exported: list[Exported]) -> float:
    """Largest change of the predicted torque on the shell [N m], over the case's rows, that rounding costs."""
    theta = analysis.fit.theta.copy()
    constants = _constants(analysis)
    effects = {effect.name: effect for effect in analysis.model.effects}
    for entry in exported:
        rule = parse(effects[entry.effect].firmware[entry.name])
        own = {f.name: t for f, t in zip(analysis.model.fitted, theta, strict=True) if f.effect == entry.effect}
        for i, fitted in enumerate(analysis.model.fitted):
            if fitted.effect == entry.effect and fitted.name in rule.names:
                step = 1e-4 * (abs(theta[i]) or 1.0)
                near = (float(rule.evaluate({**constants, **own, fitted.name: theta[i] + by})) for by in (step, -step))
                theta[i] += entry.rounding * 2.0 * step / (next(near) - next(near))
                break
    if "current" not in analysis.model.channels:
        raise UserError(
            f"{analysis.case.folder}: channel current is not mapped, expected it: it tells what rounding costs"
        )
    at = analysis.model.channels.index("current")
    bound = analysis.model.bind(analysis.case.inputs, analysis.rows)
    change = bound.predict(theta) - bound.predict(analysis.fit.theta)
    p = analysis.case.parameters
    return float(np.abs(change[at]).max() * p["torque_constant"] * p["radius"] / p["drive_radius"])


def parameters_toml(analysis: Analysis, exported: list[Exported], refused: list[str]) -> str:
    """The file that `terrapin run --parameters` reads: values in the parameters' units."""
    lines = [f"# Compensation found in the case {analysis.case.title!r}; made by `terrapin export`."]
    lines += [f"# Not compensated: {e.name}: {why_not(e)}." for e in analysis.model.effects if e.name in refused]
    lines += ["", "[parameters]"]
    for entry in exported:
        digits = f"{entry.held:.12g}"
        lines.append(f"{entry.name} = {digits}  # {entry.unit}; {entry.effect}, raw {entry.raw}, fit {entry.value:.6g}")
    return "\n".join(lines) + "\n"
