"""What a data sheet says of a drive, and what is known of the robot around it: names, units, questions.

    read({"radius": "110 mm", "kv": "100 rpm/V", ...})  # SI; UserError with the option of what is wrong or missing

`FIGURES` is the one list of them: options of `terrapin robot new --from-sheet` and its questions come from it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from terrapin_interface.quantity import QuantityError, parse_quantity
from terrapin_interface.robot import KINDS
from terrapin_tools.errors import UserError

__all__ = ["FIGURES", "Figure", "Figures", "lacking", "option", "read"]

Figures = Mapping[str, float | str]  # by name; SI, or a word


@dataclass(frozen=True)
class Figure:
    """One of them. `unit`: in which it is given, "1" for a number, "" for one of `words`."""

    unit: str
    meaning: str
    example: str = ""
    words: tuple[str, ...] = ()
    default: str = ""
    needed: str = ""  # always, or the word of `kind` with which it is needed
    sheet: bool = True  # of the drive, not of the robot


def _robot(unit: str, meaning: str, example: str, needed: str = "", default: str = "") -> Figure:
    return Figure(unit, meaning, example, needed=needed, default=default, sheet=False)


def _words(meaning: str, *words: str, default: str = "") -> Figure:
    return Figure("", meaning, words[0], words, default or words[0], sheet=False)


FIGURES: Mapping[str, Figure] = {
    "kind": _words("body of the robot", *KINDS),
    "radius": _robot("m", "R, of the shell", "110 mm", "always"),
    "shell_mass": _robot("kg", "of the shell", "0.6 kg", "always"),
    "body_mass": _robot("kg", "of the inner body; of a sphere: its bob", "0.8 kg", "always"),
    "drive_mass": _robot("kg", "of drive wheel, motor and gear", "0.9 kg", "cylinder"),
    "frame_mass": _robot("kg", "of a sphere's frame", "1 kg", "sphere"),
    "drive_radius": _robot("m", "r, of the drive wheel inside a cylinder's shell", "25 mm"),
    "arm": _robot("m", "axle to the centre of the inner body or bob", "80 mm"),
    "supply": _robot("V", "of the robot", "12 V", "always"),
    "at": _words("the shaft of the sheet's speeds and torques: the motor's, or the gear's output", "motor", "output"),
    "sheet_voltage": Figure("V", "at which the sheet has no-load and stall; the supply where it says none", "12 V"),
    "kv": Figure("rpm/V", "K_v, speed constant", "100 rpm/V"),
    "torque_constant": Figure("N m/A", "K_t", "25.9 mN m/A"),
    "no_load_speed": Figure("rpm", "without load", "8810 rpm"),
    "no_load_current": Figure("A", "without load", "164 mA"),
    "stall_current": Figure("A", "at stall", "39.3 A"),
    "stall_torque": Figure("N m", "at stall", "1.02 N m"),
    "resistance": Figure("ohm", "of the winding, between two terminals", "0.611 ohm"),
    "inductance": Figure("H", "of the winding, between two terminals", "0.119 mH"),
    "rated_current": Figure("A", "continuous, or nominal", "3.4 A"),
    "rotor_inertia": Figure("kg m^2", "of the rotor", "33.3 g cm^2", needed="sphere"),
    "gear": Figure("1", "turns of the motor for one of its output", "14:1", default="1"),
    "gear_efficiency": Figure("1", "of the gear, a share or in %", "75 %"),
    "encoder_counts": Figure("1", "a turn, after quadrature: four times the lines", "2000", needed="always"),
    "encoder_at": _words("which shaft the encoder is on", "motor", "output"),
    "driver": _words("what the driver does when it is switched off", "coast", "brake"),
    "driver_current": Figure("A", "that the driver takes, peak", "13 A"),
    "shunt": Figure("ohm", "of the current sensor; the board's where it is not given", "10 mohm"),
    "amplification": Figure("1", "of the current sensor's amplifier", "20"),
    "wheel_radius": _robot("m", "of the trailing wheel that measures the ground speed", "30 mm", default="30 mm"),
    "wheel_counts": _robot("1", "of the trailing wheel's encoder, a turn, after quadrature", "4096"),
    "board": _robot("", "of the controller: a shipped one, or the file of one", "f405_h_bridge"),
}  # fmt: skip


def option(name: str) -> str:
    """How a figure is named on the command line.

    >>> option("stall_current")
    '--stall-current'
    """
    return "--" + name.replace("_", "-")


def lacking(given: Mapping[str, str]) -> list[str]:
    """Names of the figures that are needed and not given."""
    kind = given.get("kind") or FIGURES["kind"].default
    return [name for name, figure in FIGURES.items() if figure.needed in ("always", kind) and not given.get(name)]


def read(given: Mapping[str, str], *, alone: bool = False) -> dict[str, float | str]:
    """The figures in SI, with their defaults; `alone`: others may be missing. UserError: one line that names the option
    and what was expected."""
    found: dict[str, float | str] = {}
    for name, figure in FIGURES.items():
        text = (given.get(name) or figure.default).strip()
        if not text:
            continue
        if figure.words and text not in figure.words:
            raise UserError(f"{option(name)}: found {text[:60]!r}, expected one of {', '.join(figure.words)}")
        found[name] = text if not figure.unit else _number(name, text, figure)
    if not alone and (missing := lacking(given)):
        raise UserError(
            f"{option(missing[0])} is missing, expected {_shown(FIGURES[missing[0]])}"
            + (f"; so are {', '.join(map(option, missing[1:]))}" if missing[1:] else "")
        )
    return found


def _shown(figure: Figure) -> str:
    return f"{figure.meaning}, like {figure.example!r}"


def _number(name: str, text: str, figure: Figure) -> float:
    plain = re.sub(TURNS, "rpm", text) if figure.unit.startswith("rpm") else text
    share = name == "gear_efficiency" and plain.endswith("%")
    if name == "gear":
        plain = re.sub(TO_ONE, "", plain)
    elif share:
        plain = plain[:-1]
    try:
        value = parse_quantity(plain, "1" if figure.unit == "1" else SI[figure.unit]) / (100.0 if share else 1.0)
    except QuantityError as error:
        said = str(error).replace(repr(plain), repr(text))
        raise UserError(f"{option(name)}: {said}: {_shown(figure)}") from None
    if not 0.0 < value < 1e9:
        raise UserError(f"{option(name)}: found {text!r}, expected more than 0: {_shown(figure)}")
    return value


SI = {unit: unit for unit in ("m", "kg", "V", "A", "ohm", "H", "N m", "N m/A", "kg m^2")}
SI |= {"rpm": "rad/s", "rpm/V": "rad/V s"}
TURNS = r"\b1/min\b|\bmin\^?-1"  # as sheets print rpm,
TO_ONE = r"\s*:\s*1$"  # and a gear's ratio
