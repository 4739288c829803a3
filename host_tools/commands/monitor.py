"""`terrapin monitor`: live telemetry in a terminal."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from host_tools.errors import UserError

__all__ = ["register"]


def monitor(
    source: Annotated[
        str, typer.Argument(metavar="[SOURCE]", help="a log or a run's folder, or a scenario's name")
    ] = "steady_sand",
    link: Annotated[
        str, typer.Option("--link", help="a bus instead: socketcan:can0, serial:/dev/ttyACM0, can:...")
    ] = "",
    dbc: Annotated[Path | None, typer.Option("--dbc", help="names of signals; default: the controller's")] = None,
    speed: Annotated[float, typer.Option("--speed", help="of a log: times its own pace")] = 1.0,
    bitrate: Annotated[int, typer.Option("--bitrate", help="bit/s")] = 500_000,
    controller: Annotated[
        str, typer.Option("--controller", help="of a scenario: inprocess, pty, qemu or any other link of `run`")
    ] = "inprocess",
) -> None:
    """Watch a controller: state, faults and what they mean, slip, C_t, currents, the bus, any signal as a plot.

    Keys: q quit, space pause, m mark, / filter, p plot the signal under the cursor.

    Example: terrapin monitor --link socketcan:can0
    """
    from hil import paths
    from hil.messages import interface
    from host_tools.logs.decoding import Decoder
    from host_tools.monitor.live import Live
    from host_tools.monitor.sources import Bus, LogFile, Simulator

    if not 0.0 < speed <= 1000.0:
        raise UserError(f"--speed: found {speed:g}, expected more than 0, at most 1000")
    if not 1 <= bitrate <= 10_000_000:
        raise UserError(f"--bitrate: found {bitrate}, expected 1 to 10000000 bit/s")
    if not sys.stdout.isatty():
        raise UserError("monitor needs a terminal; `terrapin log record` and `log info` do without")
    own = paths.dbc()
    live = Live(Decoder(dbc or own), interface() if dbc is None else None, bitrate)
    path = Path(source)
    opened = Bus(link, bitrate) if link else LogFile(path, speed) if path.exists() else Simulator(source, controller)
    from host_tools.monitor.app import MonitorApp

    limit = interface().parameter("slip_limit")
    app = MonitorApp(live, opened, limit.default * limit.scale)
    try:
        app.run()
    finally:
        opened.close()
    print(f"{live.total} frames seen, {opened.lost} lost" + (f"; {opened.note}" if opened.note else ""))
    if app.failed is not None:
        raise app.failed


def register(app: typer.Typer) -> None:
    app.command()(monitor)
