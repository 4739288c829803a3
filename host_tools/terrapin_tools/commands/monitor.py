"""`terrapin monitor`: live telemetry in a terminal."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from terrapin_hil.links.names import INPROCESS, LinkName
from terrapin_tools.command_options import BitRate, LinkKeyFile, NodeNumber, ThisRobot, link_option
from terrapin_tools.errors import UserError

if TYPE_CHECKING:
    from terrapin_tools.logs.decoding import Decoder
    from terrapin_tools.monitor.sources import Source

__all__ = ["monitor"]

PORT = 8765  # that Foxglove offers
POLL = 0.02  # s between looks at the source of --serve


def monitor(
    source: Annotated[
        str, typer.Argument(metavar="[SOURCE]", help="a log or a run's folder, or a scenario's name or file")
    ] = "steady_sand",
    link: Annotated[LinkName | None, link_option("listen", "a bus instead")] = None,
    dbc: Annotated[
        Path | None,
        typer.Option("--dbc", help="names of signals; default: terrapin.dbc beside a log, else the robot's"),
    ] = None,
    speed: Annotated[float, typer.Option("--speed", help="of a log: times its own pace")] = 1.0,
    bitrate: BitRate = 500_000,
    node: NodeNumber = None,
    robot: ThisRobot = "",
    drive: Annotated[bool, typer.Option("--drive", help="keys arm, run, set and stop the controller")] = False,
    link_key: LinkKeyFile = None,
    controller: Annotated[LinkName, link_option("lockstep", "of a scenario", "--controller")] = INPROCESS,
    serve: Annotated[bool, typer.Option("--serve", help="to Foxglove, in the terminal's place, until Ctrl-C")] = False,
    port: Annotated[
        int | None, typer.Option("--port", help="of --serve, on loopback: 8765; 0 takes one that is free")
    ] = None,
) -> None:
    """Watch a controller: state, faults and what they mean, slip, C_t, currents, the bus, any signal as a plot.

    Keys: q quit, space pause, m mark, / filter, p plot the signal under the cursor. With --drive: a arm, r run or halt,
    + and - setpoint, v voltage or speed, l limiter, c clear; space then stops.

    Example: terrapin monitor --link socketcan:can0

    terrapin monitor --serve --link serial:robot
    """
    from terrapin_hil import paths
    from terrapin_hil.links.seal import LinkKey
    from terrapin_hil.messages import interface
    from terrapin_hil.scenario.scenario import take_scenario
    from terrapin_tools.extras import need
    from terrapin_tools.logs.decoding import Decoder, description_of, in_steps_of
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
    if link_key is not None and not drive:
        raise UserError("--link-key: seals what is sent, expected it with --drive")
    if drive and serve:
        raise UserError("--drive: has keys in the terminal, expected it without --serve")
    if port is not None and not serve:
        raise UserError("--port: of a server, expected --serve as well")
    port = PORT if port is None else port
    if not 0 <= port <= 65535:
        raise UserError(f"--port: found {port}, expected 0 to 65535")
    key = LinkKey.read(link_key) if link_key is not None else None
    number = link.at_node(node).node if link else INPROCESS.at_node(node).node
    bitrate = link.bit_rate(bitrate) if link else bitrate
    if not serve and not sys.stdout.isatty():
        raise UserError("monitor needs a terminal; `terrapin log record`, `log info` and `monitor --serve` do without")
    if serve:
        need("--serve", "foxglove", "foxglove")
    opened = Bus(link, bitrate) if link else Simulator(source, controller) if simulated else LogFile(path, speed)
    if dbc is None and isinstance(opened, LogFile) and not robot:
        found, own = description_of(path)
        opened.name += "" if own else f", {in_steps_of()}"
    else:
        found = dbc or paths.dbc()
    decoder = Decoder(found)
    if isinstance(opened, Bus) and dbc is None:
        try:
            opened.require_fitting()
        except BaseException:
            opened.close()
            raise
    if serve:
        _serve(opened, decoder, number if dbc is None else None, port)
        return
    live = Live(decoder, interface() if dbc is None else None, bitrate, number)
    from terrapin_tools.monitor.app import MonitorApp

    limit = interface().parameter("slip_limit")
    driving = None
    if drive and isinstance(opened, Bus):
        from terrapin_hil.nodes import Node
        from terrapin_tools.monitor.controls import Controls
        from terrapin_tools.monitor.driving import Driving

        on = lambda: live.values.get("ACTUATE.enable") == 1.0  # noqa: E731
        driving = Driving(Controls(opened, interface(), Node(number), bridge_on=on, key=key))
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


def _serve(opened: Source, decoder: Decoder, node: int | None, port: int) -> None:
    """Frames of the source, those of one `node` by its names, to Foxglove until it ends or Ctrl-C."""
    from terrapin_tools.logs.nodes import renamed
    from terrapin_tools.monitor.serving import FoxgloveServer

    total = 0
    try:
        with FoxgloveServer(decoder, port, opened.name) as server:
            print(f"{opened.name}: {server.address}; in Foxglove: Open connection; Ctrl-C ends it", flush=True)
            while True:
                over = opened.over  # looked at first: what came before it is given before it
                block = opened.poll()
                total += len(block)
                server.write(block if node is None else renamed(block, node))
                if over and not len(block):
                    break
                time.sleep(POLL)
    except KeyboardInterrupt:
        pass
    finally:
        opened.close()
    print(f"{total} frames served, {opened.lost} lost" + (f"; {opened.note}" if opened.note else ""))
