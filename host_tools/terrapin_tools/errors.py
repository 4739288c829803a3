"""The one way in which the tools say that what they were given is wrong: the simulator's own."""

from terrapin_hil.errors import UserError, about

__all__ = ["UserError", "about"]
