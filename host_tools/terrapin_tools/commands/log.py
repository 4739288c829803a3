"""`terrapin log`: record, convert, look into and replay logs of a CAN bus."""

from __future__ import annotations

import shutil
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from terrapin_hil.links.names import EMPTY_BUS, PTY, LinkName
from terrapin_tools.command_options import BitRate, Json, LinkKeyFile, NodeNumber, ThisRobot, deliver, link_option
from terrapin_tools.errors import UserError
from terrapin_tools.progress import bar

if TYPE_CHECKING:
    from terrapin_tools.logs.decoding import Decoder
    from terrapin_tools.logs.frames import Frames

__all__ = ["SUBCOMMANDS"]

LogFile = Annotated[Path, typer.Argument(metavar="LOG", help="of any kind (docs/logs.md), or a run's")]
Dbc = Annotated[
    Path | None,
    typer.Option("--dbc", help="DBC, ARXML, KCD or SYM; default: terrapin.dbc beside the log"),
]

FLUSH = 0.5  # s between flushes of a recording: what a kill -9 may cost


def _decoder(log: Path, dbc: Path | None) -> Decoder | None:
    from terrapin_tools.logs.decoding import Decoder

    if dbc is None:
        beside = (log if log.is_dir() else log.parent) / "terrapin.dbc"
        dbc = beside if beside.is_file() else None
    return Decoder(dbc) if dbc is not None else None


def _dbc_beside(log: Path) -> Path:
    """Puts the DBC of this process's robot where the other commands look for that of a log."""
    from terrapin_hil import paths
    from terrapin_hil.robots import selected
    from terrapin_tools.workbench.files.writing import write_whole

    beside, text = log.parent / "terrapin.dbc", paths.dbc().read_bytes()
    if beside.exists() and beside.read_bytes() != text:
        raise UserError(
            f"{beside}: is there and another than that of the {selected().name}, expected another folder or --dbc"
        )
    write_whole(beside, text)
    return beside


def _warn(log: Path, cut: str, lost: str = "") -> None:
    if cut:
        print(f"terrapin: {log}: read up to where it was cut off: {cut}", file=sys.stderr)
    if lost:
        print(f"terrapin: {log}: {lost}", file=sys.stderr)


def _taken(block: Frames, node: int | None) -> Frames:
    """A node's frames with the identifiers of node 0, which all that reads logs knows; all frames without one."""
    from terrapin_hil.nodes import node_number
    from terrapin_tools.logs.nodes import of_node

    return block if node is None else of_node(block, node_number(str(node), "--node"))


def info(
    log: LogFile,
    dbc: Dbc = None,
    node: NodeNumber = None,
    json: Json = "",
    robot: ThisRobot = "",
) -> None:
    """What a log holds: how long, which frames how often, errors, gaps in time, whether its end is missing.

    Example: terrapin log info out/slope/telemetry.log
    """
    from terrapin_tools.logs.info import Summary, describe
    from terrapin_tools.logs.reading import LogReader

    reader, decoder = LogReader(log), _decoder(log, dbc)
    summary = Summary(decoder)
    with bar("reading", reader.size) as shown:
        for block in reader.blocks(lambda done: shown(completed=done)):
            summary.take(_taken(block, node))
    answer = {"log": str(reader.path), "bytes": reader.size, "cut": reader.cut, "lost": reader.lost}
    answer |= {"assumed": reader.assumed, "buses": reader.buses, **summary.answer()}
    deliver(answer, describe(answer), json)


def convert(
    log: LogFile,
    to: Annotated[
        Path,
        typer.Argument(metavar="TO", help="the kind is that of its suffix; also .csv (signals), .rosbag2 (a folder)"),
    ],
    dbc: Dbc = None,
    node: NodeNumber = None,
    period: Annotated[
        str, typer.Option("--period", help="signals on this grid instead of frames (.csv, .parquet)")
    ] = "",
    force: Annotated[bool, typer.Option("--force", help="replace TO if it exists")] = False,
    robot: ThisRobot = "",
) -> None:
    """Convert a log to another kind. Frames stay frames; to MCAP with a DBC, signals are added for plotting.

    Example: terrapin log convert out/slope/telemetry.log slope.mcap
    """
    from terrapin_tools.logs.reading import LogReader
    from terrapin_tools.logs.writing import BAG, WRITABLE, LogWriter

    kinds = (*WRITABLE, BAG, ".csv")
    if to.suffix.lower() not in kinds:
        raise UserError(f"{to}: unknown kind of log {to.suffix!r}, expected one of {' '.join(kinds)}")
    if to.exists() and not force:
        raise UserError(f"{to}: exists already; --force replaces it")
    if not to.parent.is_dir():
        raise UserError(f"{to}: there is no folder {to.parent}, expected one that exists")
    if to.is_dir() and not (to / "metadata.yaml").is_file():
        raise UserError(f"{to}: found a folder that is no bag, expected another name")
    reader, decoder = LogReader(log), _decoder(log, dbc)
    if to.exists() and to.samefile(reader.path):
        raise UserError(f"{to}: is the log itself, expected another file")
    temporary = to.with_name(f".{to.stem}.part{to.suffix}")
    count = 0
    try:
        if period or to.suffix.lower() == ".csv":
            if node is not None:
                raise UserError("--node: of frames; convert them to a log of the node first, then to signals")
            count = _signals(reader.path, decoder, period or "10 ms", temporary)
        else:
            with LogWriter(temporary, decoder) as writer, bar("converting", reader.size) as shown:
                for whole in reader.blocks(lambda done: shown(completed=done)):
                    block = _taken(whole, node)
                    writer.write(block)
                    count += len(block)
        if to.is_dir():
            shutil.rmtree(to)
        temporary.replace(to)
    except OSError as error:
        raise UserError(f"{to}: cannot write the log: {error.strerror or error}", status=1) from None
    finally:
        if temporary.is_dir():
            shutil.rmtree(temporary)
        temporary.unlink(missing_ok=True)
    _warn(reader.path, reader.cut, reader.lost)
    print(f"{count} {'rows' if period or to.suffix.lower() == '.csv' else 'frames'} in {to}")


def _signals(path: Path, decoder: Decoder | None, period: str, to: Path) -> int:
    """All signals on a grid, last value held, as CSV or Parquet; the number of rows."""
    import pyarrow.csv
    import pyarrow.parquet

    from terrapin_hil.reading import parse_quantity
    from terrapin_tools.logs.resample import as_arrow, signals_on_grid

    if decoder is None:
        raise UserError("signals need a DBC: --dbc FILE")
    if to.suffix.lower() not in (".csv", ".parquet"):
        raise UserError(f"--period: signals go to .csv or .parquet, found {to.suffix!r}")
    try:
        grid = parse_quantity(period, "s")
    except ValueError:
        raise UserError(f"--period: found {period!r}, expected a time such as '10 ms'") from None
    if not grid > 0:
        raise UserError(f"--period: found {period!r}, expected more than 0")
    columns = signals_on_grid(path, decoder, grid)
    if to.suffix.lower() == ".csv":
        pyarrow.csv.write_csv(pyarrow.table(columns), to, pyarrow.csv.WriteOptions(quoting_style="none"))
    else:
        pyarrow.parquet.write_table(as_arrow(columns, decoder), to)
    return len(columns["time"])


def record(
    to: Annotated[Path, typer.Argument(metavar="TO", help=".log, .blf, .mf4 or .mcap: kinds that survive a crash")],
    link: Annotated[LinkName, link_option("listen", "the bus")],
    duration: Annotated[float, typer.Option("--duration", help="seconds; 0: until Ctrl-C")] = 0.0,
    dbc: Dbc = None,
    bitrate: BitRate = 500_000,
    robot: ThisRobot = "",
) -> None:
    """Record a bus. It only listens. What came is in the file at least twice a second, so a crash costs little.

    With --robot its terrapin.dbc goes beside the log, so that the other commands read it in this robot's steps.

    Example: terrapin log record drive.blf --link socketcan:can0
    """
    from terrapin_tools.logs.bus import open_bus
    from terrapin_tools.logs.writing import GROWING, LogWriter

    if to.suffix.lower() not in GROWING:
        kinds = " ".join(GROWING)
        raise UserError(f"{to}: found {to.suffix!r}, expected one of {kinds}; `terrapin log convert` makes the others")
    if not 0.0 <= duration < 1e9:
        raise UserError(f"--duration: found {duration:g} s, expected 0 or more")
    if to.exists():
        raise UserError(f"{to}: exists already, expected a new file")
    if robot and dbc is None:
        dbc = _dbc_beside(to)
    bus = open_bus(link, bitrate)
    came = frames = 0
    begin = time.monotonic()
    shown = sys.stderr.isatty()
    try:
        with LogWriter(to, _decoder(to, dbc), growing=True) as writer:
            try:
                while not duration or time.monotonic() - begin < duration:
                    block = bus.receive(FLUSH if not duration else min(FLUSH, duration))
                    came += len(block)
                    writer.write(block)
                    writer.flush()
                    frames += len(block)
                    if shown:
                        rate = len(block) / FLUSH
                        print(f"\r{frames} frames, {rate:.0f}/s, Ctrl-C ends ", end="", file=sys.stderr, flush=True)
            except KeyboardInterrupt:
                pass
    finally:
        lost, damaged = bus.lost, bus.damaged
        bus.shutdown()
        if shown:
            print(file=sys.stderr)
        if to.exists():
            print(f"{frames} frames in {to}")
        if not came:
            print(f"{link}: nothing received: {EMPTY_BUS}", file=sys.stderr)
        if lost:
            print(f"{to}: {lost} frames lost before they could be read: this machine was too busy", file=sys.stderr)
        if damaged:
            print(f"{to}: {damaged} damaged lines left out", file=sys.stderr)


def replay(
    log: LogFile,
    link: Annotated[LinkName, link_option("replay", "where the controller is")] = PTY,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="at the log's pace instead of as fast as it goes")
    ] = False,
    parameters: Annotated[
        Path | None, typer.Option("--parameters", help="TOML; default: run.toml beside the log")
    ] = None,
    link_key: LinkKeyFile = None,
    json: Json = "",
    robot: ThisRobot = "",
) -> None:
    """Send a recorded run to the firmware again and compare its answers with the recorded ones.

    Exit status 0 when all are the same, 1 when some differ.

    Example: terrapin log replay out/slope
    """
    import numpy as np

    from terrapin_hil.links import open_link
    from terrapin_hil.links.identity import require_fit
    from terrapin_hil.links.link import LinkError
    from terrapin_hil.messages import ParameterError, interface
    from terrapin_hil.robots import selected
    from terrapin_tools.logs.reading import LogReader, read_log
    from terrapin_tools.logs.replay import replay as again
    from terrapin_tools.param.files import read_parameters, require_own

    description = interface()
    path = LogReader(log).path
    beside = path.parent / "run.toml"
    source = parameters or (beside if beside.is_file() else None)
    if source:
        require_own(source)
    values = read_parameters(source, description) if source else {}
    frames, cut = read_log(path)
    _warn(path, cut)
    try:
        for row in np.flatnonzero(frames.identifiers == description.messages["IDENTITY"].id)[:1].tolist():
            require_fit(str(path), frames.payload(row))  # said on a bus, where each run begins by asking
    except LinkError as error:
        raise UserError(str(error)) from None
    try:
        with open_link(link, link_key=link_key) as opened:
            found = again(frames, opened, values, description, real_time, cut=bool(cut))
    except ParameterError as error:
        raise UserError(str(error), status=1) from None
    answer: dict[str, Any] = {
        "log": str(path),
        "ticks": found.ticks,
        "frames": found.frames,
        "different_ticks": found.different,
        "first": [vars(d) for d in found.differences],
        "seconds": found.seconds,
    }
    text = [f"{found.ticks} ticks, {found.frames} answers compared in {found.seconds:.2f} s"]
    if not source:
        text.append(
            f"no run.toml beside {path}: parameters at their defaults of robot {selected().name}; --parameters FILE "
            "says others, --robot another robot"
        )
    if found.different:
        differ = "1 tick differs" if found.different == 1 else f"{found.different} ticks differ; the first"
        text.append(f"{differ}:")
        for d in found.differences:
            said = f"{d.signal}: recorded {d.recorded:g}, now {d.now:g}" if d.signal else "another frame, or none"
            text.append(f"  {d.time:.3f} s  {d.message} {said}")
    else:
        text.append("every answer is the recorded one")
    deliver(answer, "\n".join(text), json)
    if found.different:
        raise typer.Exit(1)


def dbc_(
    to: Annotated[Path, typer.Argument(metavar="TO.dbc", help="a new file")],
    node: NodeNumber = None,
    robot: ThisRobot = "",
) -> None:
    """Write the DBC of a controller, with the identifiers of its node, for other tools.

    Example: terrapin log dbc node-3.dbc --node 3
    """
    from terrapin_hil import paths
    from terrapin_hil.nodes import node_number
    from terrapin_tools.logs.nodes import dbc_of_node
    from terrapin_tools.workbench.files.writing import write_whole

    if to.exists():
        raise UserError(f"{to}: exists already, expected a new file")
    number = node_number(str(node or 0), "--node")
    write_whole(to, dbc_of_node(paths.dbc().read_bytes().decode("cp1252"), number).encode("cp1252"))
    print(f"{to}: the messages of node {number}")


SUBCOMMANDS = (info, convert, record, replay, dbc_)
