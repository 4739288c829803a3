"""`terrapin param`: the controller's parameters over any link, in their units, kept in its flash."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from terrapin_hil.links import LinkName, open_link
from terrapin_hil.links.identity import refuse_another
from terrapin_hil.links.names import INPROCESS, able
from terrapin_hil.messages import Interface, interface
from terrapin_tools.command_options import (
    Json,
    LinkKeyFile,
    NodeNumber,
    ThisRobot,
    deliver,
    link_option,
)
from terrapin_tools.errors import UserError
from terrapin_tools.param.files import raw_of, read_file, text_of, to_toml
from terrapin_tools.param.nodes import require_one
from terrapin_tools.param.session import ORIGINS, Session, Store
from terrapin_tools.workbench.files.writing import write_whole

__all__ = ["SUBCOMMANDS"]

FLASH_SIZE = 49152  # bytes, of ports/host/flash_file.h
FLASH_SIZES = (0, *range(32768, FLASH_SIZE + 1))  # from before it held a node number; then it grows
Link = Annotated[LinkName, link_option("parameters", "where the controller is")]
Flash = Annotated[
    Path | None,
    typer.Option("--flash", metavar="FILE", help="flash of the controllers inprocess and pty, made if absent"),
]
Timeout = Annotated[float, typer.Option("--timeout", help="s that an answer may take")]
Volatile = Annotated[bool, typer.Option("--volatile", help="until the next reset only: not kept in flash")]
Names = Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="parameters; all when none is named")]


@contextmanager
def _session(link: LinkName, flash: Path | None, timeout: float, key: Path | None = None) -> Iterator[Session]:
    if not 0 < timeout <= 3600:
        raise UserError(f"--timeout: found {timeout:g}, expected more than 0 and at most 3600 s")
    if flash is not None and "flash file" not in link.row.jobs:
        files = " and ".join(kind.form for kind in able("flash file"))
        raise UserError(f"--flash: {link} keeps its parameters itself; a file is for {files}")
    if flash is not None and flash.exists() and flash.stat().st_size not in FLASH_SIZES:
        raise UserError(f"{flash}: not a file of flash: expected one of {FLASH_SIZE} bytes, or none yet")
    with open_link(link, timeout, key, **({"flash": flash} if flash else {})) as opened:
        if "listen" in link.row.jobs:  # a bus, that others may share
            require_one(opened, link.node)
            refuse_another(opened.name, opened.ask)  # whose parameters have other numbers, ranges and defaults
        yield Session(opened)


def _entry(session: Session, name: str, raw: int) -> dict[str, Any]:
    parameter = session.interface.parameters[name]
    low, high, default = (
        value * parameter.scale for value in (parameter.minimum, parameter.maximum, parameter.default)
    )
    return {
        "value": raw * parameter.scale,
        "unit": parameter.unit,
        "raw": raw,
        "default": default,
        "minimum": low,
        "maximum": high,
        "protected": bool(parameter.protects),
        "meaning": parameter.meaning,
    }


def _table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Columns in line, as wide as they need to be: the terminal's width when there is one."""
    import io

    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="")
    for column in columns:
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    width = None if sys.stdout.isatty() else 240
    console = Console(file=io.StringIO(), width=width, color_system=None)
    console.print(table)
    assert isinstance(console.file, io.StringIO)
    return "\n".join(line.rstrip() for line in console.file.getvalue().splitlines())


def _store_words(store: Store) -> str:
    if store.result == "no_store":
        return "this controller has no parameter store: values last until its reset"
    words = f"set {store.sequence} is stored" if store.origin == "stored" else ORIGINS[store.origin]
    if store.changed:
        words += "; the values above are not the stored ones"
    if store.remains:
        words += "; a save was cut short some time, the set before it counts"
    return words


def _shown(session: Session, values: Mapping[str, int]) -> str:
    rows = []
    for name, raw in values.items():
        p = session.interface.parameters[name]
        mark = "*" if raw != p.default else ""
        span = f"{text_of(p, p.minimum)} to {text_of(p, p.maximum)}"
        unit = "" if p.unit == "1" else p.unit
        rows.append(
            (name + mark, text_of(p, raw), unit, text_of(p, p.default), span, "yes" if p.protects else "", p.meaning)
        )
    return _table(("name", "value", "unit", "default", "range", "protected", "meaning"), rows)


def list_(
    link: Link = INPROCESS,
    node: NodeNumber = None,
    flash: Flash = None,
    timeout: Timeout = 1.0,
    json: Json = "",
    robot: ThisRobot = "",
) -> None:
    """Every parameter with value, unit, default and range; * marks those that are not at their default.

    Protected ones, and saving, need the bridge to be off.

    Example: terrapin param list --link serial:/dev/ttyACM0
    """
    link = link.at_node(node)
    with _session(link, flash, timeout) as session:
        values, store, found = session.all(), session.store(), session.found()
    answer = {
        "link": str(link),
        "parameters": {name: _entry(session, name, raw) for name, raw in values.items()},
        "store": {**vars(store), **found},
    }
    counts = ", ".join(f"{n} {what}" for what, n in found.items() if n and store.origin == "stored")
    words = _store_words(store) + (f"; of it {counts}" if counts else "")
    deliver(answer, f"{_shown(session, values)}\n{words}", json)


def get(
    names: Annotated[list[str], typer.Argument(metavar="NAME...", help="parameters")],
    link: Link = INPROCESS,
    node: NodeNumber = None,
    flash: Flash = None,
    timeout: Timeout = 1.0,
    json: Json = "",
    robot: ThisRobot = "",
) -> None:
    """Values of parameters, one a line.

    Example: terrapin param get torque_constant armature_resistance --link socketcan:can0
    """
    link = link.at_node(node)
    parameters = [interface().parameter(name) for name in names]
    with _session(link, flash, timeout) as session:
        values = {parameter.name: session.get(parameter) for parameter in parameters}
    lines = [f"{p.name} = {text_of(p, values[p.name])}" + ("" if p.unit == "1" else f" {p.unit}") for p in parameters]
    deliver({name: _entry(session, name, raw) for name, raw in values.items()}, "\n".join(lines), json)


def _keep(session: Session, volatile: bool) -> tuple[Store | None, str]:
    """Saves unless `volatile`; what became of it, in words."""
    if volatile:
        return None, "until the next reset (--volatile)"
    store = session.save()
    if store.result == "no_store":
        return store, "until the next reset: this controller has no parameter store"
    return store, f"kept in flash as set {store.sequence}"


def _write(
    change: Callable[[Session], Mapping[str, int]],
    link: LinkName,
    flash: Path | None,
    timeout: float,
    link_key: Path | None,
    volatile: bool,
    json: str,
) -> None:
    with _session(link, flash, timeout, link_key) as session:
        before = session.all()
        written = change(session)
        store, kept = _keep(session, volatile)
    if flash is None and "flash file" in link.row.jobs:
        kept = f"gone now: {link} was started for this command; --flash FILE keeps them, --link names a controller"
    rows = []
    for name, raw in written.items():
        p = session.interface.parameters[name]
        unit = "" if p.unit == "1" else f" {p.unit}"
        was = "" if before[name] == raw else f" (was {text_of(p, before[name])})"
        rows.append(f"{name} = {text_of(p, raw)}{unit}{was}")
    shown = rows if len(rows) <= 20 else [row for row in rows if "(was" in row]
    changed = sum(before[name] != raw for name, raw in written.items())
    words = [*shown, f"{len(written)} written, {changed} changed; {kept}"]
    answer = {
        "link": str(link),
        "written": {name: {**_entry(session, name, raw), "before_raw": before[name]} for name, raw in written.items()},
        "store": vars(store) if store else None,
    }
    deliver(answer, "\n".join(words), json)


def set_(
    name: Annotated[str, typer.Argument(metavar="NAME", help="parameter")],
    value: Annotated[list[str], typer.Argument(metavar="VALUE", help="in its unit, or with a unit: 120 mohm")],
    raw: Annotated[bool, typer.Option("--raw", help="VALUE is the raw integer")] = False,
    volatile: Volatile = False,
    link: Link = INPROCESS,
    node: NodeNumber = None,
    flash: Flash = None,
    link_key: LinkKeyFile = None,
    timeout: Timeout = 1.0,
    json: Json = "",
    robot: ThisRobot = "",
) -> None:
    """Write one parameter and keep it in flash. A negative value comes after --.

    Examples: terrapin param set armature_resistance 120 mohm --link serial:/dev/ttyACM0

    terrapin param set comp_coulomb --flash robot.flash -- -0.5 "mN m"
    """
    link = link.at_node(node)
    parameter = interface().parameter(name)

    def change(session: Session) -> Mapping[str, int]:  # whose robot it is comes before what its range is
        return session.set_all({name: raw_of(parameter, " ".join(value), raw)})

    _write(change, link, flash, timeout, link_key, volatile, json)


def save(
    to: Annotated[
        Path, typer.Argument(metavar="FILE.toml", help="for terrapin param load and terrapin run --parameters")
    ],
    changed: Annotated[bool, typer.Option("--changed", help="those alone that are not at their default")] = False,
    link: Link = INPROCESS,
    node: NodeNumber = None,
    flash: Flash = None,
    timeout: Timeout = 1.0,
    robot: ThisRobot = "",
) -> None:
    """Write the controller's parameters into a TOML file, in their units.

    Example: terrapin param save robot7.toml --link serial:/dev/ttyACM0
    """
    link = link.at_node(node)
    with _session(link, flash, timeout) as session:
        values = session.all()
    defaults = session.interface.parameters
    chosen = {name: raw for name, raw in values.items() if not changed or raw != defaults[name].default}
    write_whole(to, to_toml(session.interface, chosen, f"read over {link} by `terrapin param save`"))
    print(f"{to}: {len(chosen)} parameters")


def load(
    file: Annotated[Path, typer.Argument(metavar="FILE.toml", help="with a table [parameters]")],
    volatile: Volatile = False,
    link: Link = INPROCESS,
    node: NodeNumber = None,
    flash: Flash = None,
    link_key: LinkKeyFile = None,
    timeout: Timeout = 1.0,
    json: Json = "",
    robot: ThisRobot = "",
) -> None:
    """Write the parameters in a TOML file and keep them in flash; those that it does not name stay.

    Nothing is written unless all of the file is good. Also takes what `terrapin export` makes.

    Example: terrapin param load robot7.toml --link socketcan:can0
    """
    link = link.at_node(node)
    values = read_file(file, interface())
    _write(lambda session: session.set_all(values), link, flash, timeout, link_key, volatile, json)


def _other(file: Path | None, description: Interface) -> dict[str, int]:
    if file is not None:
        return read_file(file, description)
    return {name: parameter.default for name, parameter in description.parameters.items()}


def diff(
    file: Annotated[Path | None, typer.Argument(metavar="[FILE.toml]", help="the defaults when none is named")] = None,
    link: Link = INPROCESS,
    node: NodeNumber = None,
    flash: Flash = None,
    timeout: Timeout = 1.0,
    json: Json = "",
    robot: ThisRobot = "",
) -> int:
    """What differs between the controller and a file, or the defaults. Exit status 1 when something does.

    Example: terrapin param diff robot7.toml --link serial:/dev/ttyACM0
    """
    link = link.at_node(node)
    description = interface()
    other = _other(file, description)
    with _session(link, flash, timeout) as session:
        here = {name: session.get(description.parameters[name]) for name in other}
    rows, answer = [], {}
    for name, raw in here.items():
        if raw != other[name]:
            p = description.parameters[name]
            rows.append((name, text_of(p, raw), text_of(p, other[name]), "" if p.unit == "1" else p.unit))
            answer[name] = {"controller": raw * p.scale, "other": other[name] * p.scale, "unit": p.unit}
    there = str(file) if file else "default"
    words = (
        _table(("name", "controller", there, "unit"), rows) if rows else f"no difference from {file or 'the defaults'}"
    )
    deliver({"link": str(link), "other": there, "differences": answer}, words, json)
    return 1 if rows else 0


def reset(
    names: Names = None,
    volatile: Volatile = False,
    link: Link = INPROCESS,
    node: NodeNumber = None,
    flash: Flash = None,
    link_key: LinkKeyFile = None,
    timeout: Timeout = 1.0,
    json: Json = "",
    robot: ThisRobot = "",
) -> None:
    """Put all parameters, or those named, back to their defaults and keep that in flash.

    Example: terrapin param reset --link serial:/dev/ttyACM0
    """
    link = link.at_node(node)
    chosen = [interface().parameter(name) for name in names or ()]
    values = {parameter.name: parameter.default for parameter in chosen}
    _write(
        lambda session: session.set_all(values) if values else session.defaults(),
        link,
        flash,
        timeout,
        link_key,
        volatile,
        json,
    )


SUBCOMMANDS = (list_, get, set_, save, load, diff, reset)
