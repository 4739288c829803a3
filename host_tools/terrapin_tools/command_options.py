"""What the commands on cases share: options and the way the answer goes out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from terrapin_hil.links.names import LinkName, helped
from terrapin_tools.errors import UserError, printable

__all__ = [
    "BitRate",
    "CaseFolder",
    "Cases",
    "Cluster",
    "Jobs",
    "Json",
    "Level",
    "NodeNumber",
    "Picture",
    "Reading",
    "RobotName",
    "Seed",
    "ThisRobot",
    "check_options",
    "deliver",
    "link_option",
]

CaseFolder = Annotated[Path, typer.Argument(metavar="CASE", help="folder that holds case.toml and measurements")]
Cases = Annotated[
    Path,
    typer.Argument(metavar="CASE", help="folder that holds case.toml and measurements, or a folder of such folders"),
]


def _take_robot(name: str) -> str:
    """Makes what `--robot` names the robot of this process. Not before `--help`, which needs none that is built."""
    if name:
        from terrapin_hil.robots import select

        select(name)
    return name


_ROBOT: dict[str, Any] = {
    "metavar": "ROBOT",
    "help": "a shipped robot, or the file of one; the cylinder where nothing is said",
}
RobotName = Annotated[str, typer.Option("--robot", **_ROBOT)]
ThisRobot = Annotated[str, typer.Option("--robot", **_ROBOT, callback=_take_robot)]  # of this process
Json = Annotated[str, typer.Option("--json", metavar="FILE", help="write the answer as JSON; - for standard output")]
Reading = Annotated[
    list[str] | None,
    typer.Option("--read", metavar="KEY=VALUE", help="how to read: sheet, range, names, decimal, dates, runs, ..."),
]
Seed = Annotated[int, typer.Option("--seed", help="of everything drawn at random; same seed, same answer")]
Jobs = Annotated[int, typer.Option("--jobs", help="processes to use at most")]
BitRate = Annotated[
    int, typer.Option("--bitrate", min=1, max=10_000_000, help="bit/s of the bus, where the link's name does not say")
]
NodeNumber = Annotated[
    int | None,
    typer.Option(
        "--node", metavar="N", help="number of the controller on its bus, 0 to 7 (0, or as the link's name says)"
    ),
]
Level = Annotated[float, typer.Option("--level", help="false alarm rate of the verdict")]
Cluster = Annotated[
    str, typer.Option("--cluster", metavar="ADDRESS", help="of a Dask scheduler that does the work, tcp://host:8786")
]


def _picture(name: str) -> Path:
    if not name.lower().endswith((".png", ".svg")):
        raise UserError(f"--plot: found {Path(name).name!r}, expected a name that ends in .png or .svg")
    from terrapin_tools.figure_style import need_pictures

    need_pictures("--plot")
    return Path(name)


Picture = Annotated[
    Path | None, typer.Option("--plot", metavar="FILE", parser=_picture, help="draw it, as .png or .svg")
]


def link_option(job: str, says: str, name: str = "--link") -> Any:
    """An option that names a link for a job (see terrapin_hil.links.names.JOBS); a LinkName comes of it."""

    return typer.Option(
        name, metavar="LINK", parser=lambda text: LinkName.parse(str(text), job), help=f"{says}: {helped(job)}"
    )


LinkKeyFile = Annotated[
    Path | None,
    typer.Option("--link-key", metavar="FILE", help="the controller's link key, if it has one (`terrapin keys link`)"),
]


def check_options(seed: int, jobs: int, level: float = 0.05) -> None:
    """UserError when an option is out of range."""
    if seed < 0:
        raise UserError(f"--seed: found {seed}, expected 0 or more")
    if jobs < 1:
        raise UserError(f"--jobs: found {jobs}, expected 1 or more")
    if not 0.0 < level < 1.0:
        raise UserError(f"--level: found {level:g}, expected between 0 and 1")


def deliver(answer: dict[str, Any], words: str, target: str) -> None:
    """Words to standard output; JSON to a file, or, for -, to standard output in their place."""
    from terrapin_tools.workbench.files.json_text import to_json
    from terrapin_tools.workbench.files.writing import write_whole

    if target == "-":
        sys.stdout.write(to_json(answer))
        return
    if target:
        write_whole(Path(target), to_json(answer))
    print(printable(words, keep="\n\t"))
