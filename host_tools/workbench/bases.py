"""Roles, channels and base models of the contract: their names, units and what each model needs.

What the models compute stands in models.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from hil.physics.dynamic import MODELS, DynamicModel

__all__ = ["BASES", "CHANNELS", "ROLES", "RUNNING", "Base", "formula_name"]

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
    "drive_torque": "N m",
}

CHANNELS: Mapping[str, str] = {
    "current": "A",
    "traction": "N",
    "torque": "N m",
    "sinkage": "m",
    **{name: unit for model in MODELS.values() for name, unit in model.channels.items() if name not in ROLES},
}

# Repeated settings may differ in these: they run on while the setting stays
RUNNING = ("time", "angle", "acceleration")


@dataclass(frozen=True)
class Base:
    """A base model: parameters with their SI units, channels it predicts, roles (or constants) that it needs."""

    name: str
    channels: tuple[str, ...]
    parameters: Mapping[str, str]
    needs: tuple[str, ...]
    options: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # the first is the default
    defaults: Mapping[str, float] = field(default_factory=dict)  # of parameters that a case need not state
    provides: tuple[str, ...] = ()  # roles and names that the model itself gives to effects
    dynamic: DynamicModel | None = None  # integrates over time within a run


_SOIL = {"n": "1", "cohesion": "Pa", "friction_angle": "rad", "shear_modulus": "m"}
_STRESS = {"stress": ("full", "linear")}


def _dynamic(model: DynamicModel) -> Base:
    return Base(
        model.name,
        tuple(model.channels),
        {name: unit for name, (unit, _) in model.parameters.items()},
        ("time", *model.inputs),
        defaults={name: value for name, (_, value) in model.parameters.items() if value is not None},
        provides=(*model.states, *model.aliases, "gear", *(("pass",) if model.name == "vehicle" else ())),
        dynamic=model,
    )


BASES: Mapping[str, Base] = {
    base.name: base
    for base in (
        Base(
            "rolling_steady",
            ("current",),
            {
                "radius": "m",
                "drive_radius": "m",
                "torque_constant": "N m/A",
                "coulomb": "N m",
                "viscous": "N m s/rad",
                "f_o": "1",
            },
            ("omega", "load"),
        ),
        Base(
            "sphere_contact",
            ("traction", "torque", "sinkage"),
            {"radius": "m", "k_s": "Pa/m^n", **_SOIL, "c1": "1", "c2": "1"},
            ("slip", "load"),
            _STRESS,
        ),
        Base(
            "wheel_contact",
            ("traction", "torque", "sinkage"),
            {"radius": "m", "width": "m", "k_c": "Pa", "k_phi": "Pa/m", **_SOIL},
            ("slip", "load"),
            _STRESS,
        ),
        Base("equation", (), {}, ()),
        *map(_dynamic, MODELS.values()),
    )
}


def formula_name(name: str) -> str:
    """The name of a role or column inside formulas: `pass` is a word of Python's, so formulas say `pass_`."""
    return "pass_" if name == "pass" else name
