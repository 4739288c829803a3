"""Torque constant, resistance and friction of a motor, from whichever figures its sheet has; each says from what.

The permanent-magnet motor of every sheet: U = R I + K omega, M = K (I - I_0). A figure that the others contradict is
refused. What a sheet means at the output of a gear is taken through the gear; that of a stall has the gear's losses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from terrapin_tools.errors import UserError
from terrapin_tools.sheet.figures import Figures, option

__all__ = ["Motor", "motor_of"]

AGREE = 0.15  # of each other, figures of one sheet: they are rounded, and of one winding at one temperature
WORST_GEAR = 0.3  # the least efficiency that a gear is believed to have


@dataclass(frozen=True)
class Motor:
    """At the motor's shaft, SI; with each value the words that say where it comes from."""

    torque_constant: float
    torque_constant_from: str
    resistance: float
    resistance_from: str
    no_load_current: float
    no_load_current_from: str
    efficiency: float  # of the gear
    efficiency_from: str


@dataclass(frozen=True)
class _Found:
    value: float
    words: str
    options: str


def motor_of(figures: Figures) -> Motor:
    """The motor. UserError where the sheet says too little, or contradicts itself: what was found and expected."""
    at_output = figures["at"] == "output"
    gear = _of(figures, "gear", 1.0)
    shaft = gear if at_output else 1.0  # turns of the motor for one of the shaft that the sheet means
    voltage = _of(figures, "sheet_voltage", _of(figures, "supply"))
    resistance = _resistance(figures, voltage)
    idle, idle_from = _idle(figures, voltage, resistance.value)
    constants = _torque_constants(figures, voltage, resistance.value, idle, shaft)
    if not constants:
        raise UserError(
            f"{option('kv')} is missing, expected it, {option('torque_constant')}, or {option('no_load_speed')}: "
            "the torque constant follows from one of them"
        )
    first = constants[0]
    for other in constants[1:]:
        _agree(first, other, "N m/A")
    efficiency, efficiency_from = _efficiency(figures, first, idle, shaft)
    return Motor(first.value, first.words, resistance.value, resistance.words, idle, idle_from, efficiency,
                 efficiency_from)  # fmt: skip


def _of(figures: Figures, name: str, default: float = 0.0) -> float:
    value = figures.get(name, default)
    return float(value)


def _agree(first: _Found, other: _Found, unit: str) -> None:
    if abs(math.log(other.value / first.value)) > math.log1p(AGREE):
        raise UserError(
            f"{other.options}: found {other.value:.4g} {unit}, which is {other.words}, "
            f"expected {first.value:.4g} {unit} within {AGREE:.0%}, which is {first.words} ({first.options})"
        )


def _resistance(figures: Figures, voltage: float) -> _Found:
    found = []
    if "resistance" in figures:
        found.append(_Found(_of(figures, "resistance"), "the sheet's", option("resistance")))
    if "stall_current" in figures:
        stall = _of(figures, "stall_current")
        words = f"{voltage:g} V over the {stall:g} A of a stall"
        found.append(_Found(voltage / stall, words, option("stall_current")))
    if not found:
        raise UserError(
            f"{option('resistance')} is missing, expected it or {option('stall_current')}: "
            "the resistance follows from one of them"
        )
    for other in found[1:]:
        _agree(found[0], other, "ohm")
    return found[0]


def _idle(figures: Figures, voltage: float, resistance: float) -> tuple[float, str]:
    stall = voltage / resistance
    if "no_load_current" not in figures:
        return 0.05 * stall, "assumed: a twentieth of the stall current"
    idle = _of(figures, "no_load_current")
    if idle >= 0.5 * stall:
        raise UserError(
            f"{option('no_load_current')}: found {idle:g} A, expected less than half of the {stall:.4g} A of a stall"
        )
    return idle, "the sheet's"


def _torque_constants(figures: Figures, voltage: float, resistance: float, idle: float, shaft: float) -> list[_Found]:
    """At the motor's shaft, the best first."""
    at = f", through the gear of {shaft:g}" if shaft != 1.0 else ""
    found = []
    if "torque_constant" in figures:
        found.append(_Found(_of(figures, "torque_constant") / shaft, f"the sheet's{at}", option("torque_constant")))
    if "no_load_speed" in figures:
        speed = _of(figures, "no_load_speed") * shaft
        words = f"({voltage:g} V - {resistance:.4g} ohm x {idle:.3g} A) over the speed without load{at}"
        found.append(_Found((voltage - resistance * idle) / speed, words, option("no_load_speed")))
    if "kv" in figures:
        found.append(_Found(1.0 / (_of(figures, "kv") * shaft), f"1/K_v{at}", option("kv")))
    return found


def _efficiency(figures: Figures, constant: _Found, idle: float, shaft: float) -> tuple[float, str]:
    """Of the gear: as it is given, or as the stall at its output shows. A stall at the motor's shaft has to agree."""
    given = _of(figures, "gear_efficiency")
    if given > 1.0:
        raise UserError(f"{option('gear_efficiency')}: found {given:g}, expected more than 0, at most 1")
    at_output = figures["at"] == "output"
    shown = 0.0
    if "stall_torque" in figures and "stall_current" in figures:
        torque, current = _of(figures, "stall_torque"), _of(figures, "stall_current")
        per_ampere = torque / max(current - idle, 1e-9) / shaft
        words = f"the torque at stall over {current:g} A less the {idle:.3g} A without load"
        stall = _Found(per_ampere, words, option("stall_torque"))
        if not at_output:
            _agree(constant, stall, "N m/A")
        elif not WORST_GEAR <= per_ampere / constant.value <= 1.0 + AGREE:
            low, high = (part * constant.value * shaft * (current - idle) for part in (WORST_GEAR, 1.0 + AGREE))
            raise UserError(
                f"{option('stall_torque')}: found {torque:.4g} N m, expected {low:.3g} to {high:.3g} N m "
                f"at {current:g} A: K_t is {constant.words} ({constant.options}), "
                f"and a gear passes on {WORST_GEAR:.0%} of it or more"
            )
        else:
            shown = min(1.0, per_ampere / constant.value)
    if given:
        if shown and abs(shown - given) > 0.25:
            raise UserError(
                f"{option('gear_efficiency')}: found {given:g}, expected {shown:.2g} within 0.25, as the torque "
                f"at stall shows ({option('stall_torque')})"
            )
        return given, "the sheet's"
    if shown:
        return shown, "torque at stall over K_t and the current of a stall"
    if _of(figures, "gear", 1.0) == 1.0:
        return 1.0, "no gear"
    return 0.8, "assumed"
