"""Mechanics in anybody's equation: one file an effect, in the roles that a case gives to its columns.

These are templates. `expression` and `needs` name roles (ROLES), not columns; the case puts its own names there.
`target` is "channel" or "parameter": the expression is added to a channel, or a parameter is multiplied by
1 + expression. `channels` says on which units of channels it may act: "" stands for any but a power, of which a force
or a torque is no part. Units of parameters are formulas over `channel` and roles, which stand for the units of the
case. The numbers of a parameter that is measured in a role's unit alone are shares of the largest magnitude in that
column; those of one in waves a `position` are waves a turn, from 2 on, or for a length waves over its range. `angle`
is a position that is one.
"""

from __future__ import annotations

from functools import cache

from terrapin_hil.catalogues import entries
from terrapin_hil.physics.effects import Effect

__all__ = ["ROLES", "mechanics"]

ROLES = {  # role -> units that it may have
    "speed": ("m/s", "rad/s"),
    "position": ("m", "rad"),
    "acceleration": ("m/s^2", "rad/s^2"),
    "temperature": ("degC",),
    "current": ("A",),
    "torque": ("N m", "N"),
    "time": ("s",),
    "direction": ("1",),
}


@cache
def mechanics() -> dict[str, Effect]:
    """Every effect in this folder by name, sorted. Each module defines one `EFFECT`."""
    return entries(__name__, __path__, "EFFECT")
