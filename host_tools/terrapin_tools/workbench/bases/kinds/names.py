"""Roles of the contract: the names and units of what a case's columns may be beside the channels."""

from __future__ import annotations

from collections.abc import Collection, Mapping

__all__ = ["ROLES", "RUNNING", "formula_name", "free_name"]

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

# Repeated settings may differ in these: they run on while the setting stays
RUNNING = ("time", "angle", "acceleration")


def formula_name(name: str) -> str:
    """The name of a role or column inside formulas: `pass` is a word of Python's, so formulas say `pass_`."""
    return "pass_" if name == "pass" else name


def free_name(name: str, taken: Collection[str]) -> str:
    """A name for a parameter that no column has.

    >>> free_name("k", {"k", "x"})
    'k_'
    """
    while name in taken:
        name += "_"
    return name
