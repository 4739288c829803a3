"""`terrapin look`: what a file of measurements holds, on one screen."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from terrapin_tools.command_options import Json, Picture, Reading, deliver
from terrapin_tools.errors import UserError

__all__ = ["look"]


def look(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="tables, a folder of them, or logs of a bus")],
    dbc: Annotated[Path | None, typer.Option("--dbc", metavar="FILE", help="of a log; else the controller's")] = None,
    read: Reading = None,
    plot: Picture = None,
    json: Json = "",
) -> None:
    """Say what a file holds: columns, units, rate, gaps, what repeats, saturates, sticks or comes in steps; and where
    runs and steady states may be. The file is only read.

    Example: terrapin look day_1.csv --plot day_1.png

    What was assumed of a table is shown above its columns. --read says otherwise, as for `terrapin case table`:

    terrapin look logger.csv --read names=3 --read units=4
    """
    from terrapin_tools.workbench.files.format import Asked
    from terrapin_tools.workbench.intake import look as room
    from terrapin_tools.workbench.new_case.options import pairs
    from terrapin_tools.workbench.new_case.reading import files_of

    files = files_of(files)
    asked = Asked.of(pairs("--read", read or []), "--read")
    if plot is not None and len(files) > 1:
        raise UserError(f"--plot: found {len(files)} files, expected one")
    answers: list[dict[str, Any]] = []
    for file in files:
        answers.append(room.look(file, dbc, asked))
    if plot is not None:
        from terrapin_tools.workbench.intake.look_picture import draw

        table, _ = room.table_of(files[0], dbc, asked)
        if table is None:
            raise UserError(f"{files[0]}: found no signal, expected a description of its bus (--dbc)")
        draw(table, answers[0], plot)
    deliver({"files": answers}, "\n\n".join(map(room.describe, answers)), json)
