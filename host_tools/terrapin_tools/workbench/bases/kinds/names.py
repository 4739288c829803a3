"""Roles of the contract: the names and units of what a case's columns may be beside the channels."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Mapping

__all__ = ["ROLES", "RUNNING", "formula_name", "free_name", "in_letters"]

ROLES: Mapping[str, str] = {
    "time": "s",
    "omega": "rad/s",
    "acceleration": "rad/s^2",
    "angle": "rad",
    "slip": "1",
    "speed": "m/s",
    "load": "N",
    "slope": "rad",
    "temperature": "degC",
    "pass": "1",
    "moisture": "1",
    "voltage": "V",
    "joint_rate": "rad/s",
    "swing_angle": "rad",
    "drive_torque": "N m",
}

UMLAUTS = {"\u00e4": "ae", "\u00f6": "oe", "\u00fc": "ue", "\u00df": "ss"}

# Repeated settings may differ in these: they run on while the setting stays
RUNNING = ("time", "angle", "acceleration")


def formula_name(name: str) -> str:
    """The name of a role or column inside formulas: `pass` is a word of Python's, so formulas say `pass_`."""
    return "pass_" if name == "pass" else name


def in_letters(text: str) -> str:
    """A heading in the letters that formulas know: umlauts written out, Greek letters by their names, others without
    their marks, _ for what is none.

    >>> in_letters("\u00d6l-Temp."), in_letters("\u03c9_shell"), in_letters("d\u00e9bit")
    ('Oel_Temp', 'omega_shell', 'debit')
    """
    found = ""
    for letter in unicodedata.normalize("NFKC", text):
        if written := UMLAUTS.get(letter.lower()):
            found += written if letter.islower() else written.capitalize()
        elif unicodedata.name(letter, "").startswith("GREEK"):
            found += unicodedata.name(letter).partition(" WITH ")[0].split()[-1].lower()
        else:
            found += unicodedata.normalize("NFKD", letter)[0]
    return re.sub(r"\W+", "_", found, flags=re.ASCII).strip("_")


def free_name(name: str, taken: Collection[str]) -> str:
    """A name for a parameter that no column has.

    >>> free_name("k", {"k", "x"})
    'k_'
    """
    while name in taken:
        name += "_"
    return name
