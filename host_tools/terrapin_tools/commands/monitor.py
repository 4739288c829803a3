"""`terrapin monitor`: live telemetry in a terminal."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from terrapin_hil.links.names import INPROCESS, LinkName
from terrapin_tools.command_options import BitRate, NodeNumber, ThisRobot, link_option
from terrapin_tools.errors import UserError

__all__ = ["monitor"]


def monitor(
    source: Annotated[
        str, typer.Argument(metavar="[SOURCE]", help="a log or a run's folder, or a scenario's name or file")
    ] = "steady_sand",
    link: Annotated[LinkName | None, link_option("listen", "a bus instead")] = None,
    dbc: Annotated[Path | None, typer.Option("--dbc", help="names of signals; default: the controller's")] = None,
    speed: Annotated[float, typer.Option("--speed", help="of a log: times its own pace")] = 1.0,
    bitrate: BitRate = 500_000,
    node: NodeNumber = None,
    robot: ThisRobot = "",
    drive: Annotated[bool, typer.Option("--drive", help="keys arm, run, set and stop the controller")] = False,
    controller: Annotated[LinkName, link_option("lockstep", "of a scenario", "--controller")] = INPROCESS,
) -> None:
    """Watch a controller: state, faults and what they mean, slip, C_t, currents, the bus, any signal as a plot.

    Keys: q quit, space pause, m mark, / filter, p plot the signal under the cursor. With --drive: a arm, r run or halt,
    + and - setpoint, v voltage or speed, l limiter, c clear; space then stops.

    Example: terrapin monitor --link socketcan:can0
    """
    from terrapin_hil import paths
    from terrapin_hil.messages import interface
    from terrapin_hil.scenario.scenario import take_scenario
    from terrapin_tools.logs.decoding import Decoder
    from terrapin_tools.monitor.live import Live
    from terrapin_tools.monitor.sources import Bus, LogFile, Simulator

    if not 0.0 < speed <= 1000.0:
        raise UserError(f"--speed: found {speed:g}, expected more than 0, at most 1000")
    path = Path(source)
    if node is not None and link is None and (not path.exists() or path.suffix == ".toml"):
        raise UserError("--node: a scenario has one controller, expected --link or a log")
    if dbc is not None and node is not None:
        raise UserError("--node: the identifiers of a DBC are its own, expected it without --dbc")
    simulated = link is None and (not path.exists() or path.suffix == ".toml")
    if simulated:
        source = str(take_scenario(source, robot))
    if drive and (link is None or dbc is not None):
        raise UserError("--drive: expected it with --link, and without --dbc: there is nothing else to drive")
    number = link.at_node(node).node if link else INPROCESS.at_node(node).node
    bitrate = link.bit_rate(bitrate) if link else bitrate
    if not sys.stdout.isatty():
        raise UserError("monitor needs a terminal; `terrapin log record` and `log info` do without")
    own = paths.dbc()
    live = Live(Decoder(dbc or own), interface() if dbc is None else None, bitrate, number)
    opened = Bus(link, bitrate) if link else Simulator(source, controller) if simulated else LogFile(path, speed)
    if isinstance(opened, Bus) and dbc is None:
        try:
            opened.require_fitting()
        except BaseException:
            opened.close()
            raise
    from terrapin_tools.monitor.app import MonitorApp

    limit = interface().parameter("slip_limit")
    driving = None
    if drive and isinstance(opened, Bus):
        from terrapin_hil.nodes import Node
        from terrapin_tools.monitor.controls import Controls
        from terrapin_tools.monitor.driving import Driving

        on = lambda: live.values.get("ACTUATE.enable") == 1.0  # noqa: E731
        driving = Driving(Controls(opened, interface(), Node(number), bridge_on=on))
    app = MonitorApp(live, opened, limit.default * limit.scale, driving)
    try:
        app.run()
    finally:
        if driving is not None:
            driving.controls.close()
        opened.close()
    print(f"{live.total} frames seen, {opened.lost} lost" + (f"; {opened.note}" if opened.note else ""))
    if app.failed is not None:
        raise app.failed
