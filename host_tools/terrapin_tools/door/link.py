"""A controller over a link, asked and set by a program."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self, final

from terrapin_tools.door.named import Named
from terrapin_tools.errors import UserError, for_programs

if TYPE_CHECKING:
    from terrapin_hil.links.link import Link as Opened
    from terrapin_tools.param.session import Session

__all__ = ["Link"]


@final
class Link:
    """An open link to a controller (docs/links.md); let go at the end of a with-block.

    >>> with Link("inprocess") as link:
    ...     _ = link.write("window", 500.0)
    ...     link.read("window"), link.unit("window")
    (500.0, 'ms')

    Parameters
    ----------
    name : inprocess, pty, serial:DEVICE, socketcan:CHANNEL, can:INTERFACE:CHANNEL, ...
    timeout : that an answer may take [s].
    link_key : file of the controller's link key, if it has one.

    Raises
    ------
    errors.InputError : no link has that name; OSError : it does not open, or leads to another robot.
    """

    @for_programs
    def __init__(self, name: str, *, timeout: float = 2.0, link_key: str | Path | None = None) -> None:
        from terrapin_hil.links import LinkName, open_link
        from terrapin_hil.links.identity import refuse_another
        from terrapin_tools.param.session import Session

        if not 0.0 < timeout <= 3600.0:
            raise UserError(f"timeout: found {timeout!r}, expected more than 0 and at most 3600 s")
        key = Path(link_key) if link_key is not None else None
        link = LinkName.parse(name)
        self._opened: Opened = open_link(link, timeout, key)
        if "listen" in link.row.jobs:  # on a bus may be another robot's
            try:
                refuse_another(self._opened.name, self._opened.ask)
            except BaseException:
                self._opened.close()
                raise
        self._session: Session = Session(self._opened)

    @property
    def opened(self) -> Opened:
        """The link itself, for `terrapin_hil`."""
        return self._opened

    @property
    def parameters(self) -> Mapping[str, str]:
        """Names of the controller's parameters -> their units."""
        found = {name: one.unit for name, one in self._session.interface.parameters.items()}
        return Named(found, "parameters")

    @for_programs
    def unit(self, parameter: str) -> str:
        """Of a parameter. InputError when there is none of that name."""
        return self._session.interface.parameter(parameter).unit

    @for_programs
    def read(self, parameter: str) -> float:
        """A parameter's value, in its unit. InputError when there is none of that name; OSError without an answer."""
        known = self._session.interface.parameter(parameter)
        return float(self._session.get(known) * known.scale)

    @for_programs
    def write(self, parameter: str, value: float | str) -> Self:
        """Sets a parameter, in its unit or as "500 ms", until the next reset. InputError when it is out of range or
        locked."""
        known = self._session.interface.parameter(parameter)
        self._session.set(known, known.raw(known.number(value)))
        return self

    @for_programs
    def save(self) -> Self:
        """The controller keeps the values that stand. InputError when it cannot."""
        self._session.save()
        return self

    def close(self) -> None:
        """Lets go of the controller. Closing twice is allowed."""
        self._opened.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Link({self._opened.name!r})"
