"""`terrapin doctor`: what this machine can and cannot do, and the command that mends it."""

from __future__ import annotations

from typing import Annotated

import typer

from terrapin_tools.command_options import Json, deliver

__all__ = ["doctor"]


def doctor(
    json: Json = "",
    need: Annotated[
        list[str] | None, typer.Option("--need", metavar="NAME", help="exit status 1 without it; repeat for more")
    ] = None,
) -> int:
    """Look for compilers, emulator, buses, ports, browser and optional packages; say what each serves, what mends it.

    Nothing is changed, installed or sent. Exit status 1 when what always has to be there, or is asked for by --need,
    is not.

    Example: terrapin doctor --need qemu
    """
    from terrapin_tools.doctor import NAMES, examined
    from terrapin_tools.errors import UserError

    unknown = next((name for name in need or [] if name not in NAMES), None)
    if unknown is not None:
        raise UserError(f"--need: found {unknown!r}, expected one of {', '.join(NAMES)}")
    found = examined()
    width = max(map(len, NAMES))
    lines = []
    for one in found:
        lines.append(f"  {'yes' if one.there else 'no '}  {one.name:{width}}  {one.serves}")
        lines.append(f"       {'':{width}}  {one.found if one.there else f'{one.found}; mend: {one.mend}'}")
    lacking = [one.name for one in found if not one.there and (one.always or one.name in (need or []))]
    able = f"{sum(one.there for one in found)} of {len(found)} there"
    lines.append(f"{able}; {f'needed and not there: {chr(44).join(lacking)}' if lacking else 'all that is needed is'}")
    answer = {"able": not lacking, "lacking": lacking, "found": [one.as_dict() for one in found]}
    deliver(answer, "\n".join(lines), json)
    return 1 if lacking else 0
