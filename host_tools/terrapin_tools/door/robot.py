"""A robot: the constants of its file, as a value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, final

from terrapin_tools.door.named import Named
from terrapin_tools.errors import UserError, for_programs

if TYPE_CHECKING:
    from terrapin_interface.robot import Robot as Inner

__all__ = ["Robot"]


@final
class Robot:
    """A shipped robot by its name, or that of a file (docs/robots.md): an immutable value, SI.

    >>> robot = Robot("cylinder")
    >>> robot.kind, robot.constants["radius"], round(robot.weight, 3)
    ('cylinder', 0.08, 18.639)

    Raises
    ------
    errors.InputError : there is no such robot, or its file has a wrong value.
    """

    __slots__ = ("_given", "_robot")

    @for_programs
    def __init__(self, name: str = "cylinder") -> None:
        from terrapin_interface.robot import RobotError, find_robot, load_robot

        try:
            self._robot: Inner = load_robot(find_robot(name))
        except RobotError as error:
            raise UserError(str(error)) from None
        self._given = name

    @property
    def name(self) -> str:
        """As its file says it."""
        return self._robot.name

    @property
    def title(self) -> str:
        """In a few words."""
        return self._robot.title

    @property
    def kind(self) -> str:
        """Of the body: cylinder or sphere."""
        return self._robot.kind

    @property
    def constants(self) -> Mapping[str, float]:
        """Of the simulated body and its motor by name (docs/robots.md), SI."""
        return Named(self._robot.plant, "constants")

    @property
    def weight(self) -> float:
        """[N]."""
        return self._robot.weight

    @property
    def supply(self) -> float:
        """[V]."""
        return self._robot.supply

    @for_programs
    def use(self) -> Robot:
        """Makes it the robot of this process: before the first Session or Link. InputError when its controller is not
        built and cannot be."""
        from terrapin_hil.robots import select

        select(self._given)
        return self

    def __reduce__(self) -> Any:
        return Robot, (self._given,)

    def __eq__(self, other: object) -> bool:
        return self._robot == other._robot if isinstance(other, Robot) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._robot.name)

    def __repr__(self) -> str:
        return f"Robot({self._given!r})"
