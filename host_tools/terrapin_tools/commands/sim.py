"""`terrapin sim`: a robot that lives on a bus until it is stopped."""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from terrapin_tools.command_options import NodeNumber, ThisRobot
from terrapin_tools.errors import UserError

if TYPE_CHECKING:
    from terrapin_hil.scenario.scenario import Scenario

__all__ = ["sim"]

STANDING = """
title = "Standing on the floor"
duration = "1 s"

[[path]]
terrain = "hard_floor"

[[operator]]
at = "0 s"
request = "idle"
"""


def sim(
    source: Annotated[
        str, typer.Argument(metavar="[SCENARIO|ROBOT]", help="a scenario, or a robot: it then stands on the floor")
    ] = "",
    on: Annotated[
        list[str] | None,
        typer.Option("--on", metavar="BUS", help="pty, pty:PATH, socketcan:CHANNEL, can:...; several are one bus"),
    ] = None,
    flash: Annotated[
        Path | None, typer.Option(help="file of the chip's flash, made if absent; kept in memory without it")
    ] = None,
    key: Annotated[
        Path | None, typer.Option(help="PEM of the key that images must be signed with; the bench's without it")
    ] = None,
    store: Annotated[Path | None, typer.Option(help="file in which the controller keeps its parameters")] = None,
    do: Annotated[
        list[str] | None,
        typer.Option("--do", metavar="CHANGE", help="to the robot that lives: ground = sand, status, stop, help"),
    ] = None,
    detach: Annotated[bool, typer.Option("--detach", help="come back as soon as it lives; --do stop ends it")] = False,
    node: NodeNumber = None,
    robot: ThisRobot = "",
) -> None:
    """Let a robot live on a bus, in real time, until Ctrl-C. Tools attach and detach as they like.

    Examples: terrapin sim steady_sand --on pty:robot --on pty:second

    terrapin sim --do "ground = sand" --do "voltage = 8 V"

    terrapin sim --do status
    """
    if do:
        if source or flash or key or store or robot or detach or len(on or ()) > 1:
            raise UserError("--do: changes a robot that lives, expected only --on beside it, once")
        from terrapin_hil.run.control import ask

        for text in do:
            print(_changes() if text == "help" else _words(ask(text, (on or [""])[0])))
        return
    _live(_scenario(source, robot), on or ["pty"], _Chip(flash, key, store, node or 0), detach)


def _scenario(source: str, robot: str) -> Scenario:
    from terrapin_hil.reading import Section, parse_toml
    from terrapin_hil.robots import select
    from terrapin_hil.scenario.scenario import load_scenario, read_scenario, take_scenario
    from terrapin_interface.robot import robots

    path = Path(source)
    own = path.suffix == ".toml" and path.is_file() and "\n[body]" in path.read_text(encoding="utf-8", errors="replace")
    if source in robots() or own:
        if robot:
            raise UserError(f"--robot: {source} is a robot, expected a scenario beside --robot")
        select(source)
    elif source:
        return load_scenario(take_scenario(source, robot))
    table = Section(parse_toml(STANDING, Path("standing")), "standing", STANDING)
    return read_scenario(table, "no scenario")  # what `status` calls it, also while it moves


@dataclass(frozen=True)
class _Chip:
    flash: Path | None
    key: Path | None
    store: Path | None
    node: int


def _boot_key(file: Path | None) -> tuple[bytes, int] | None:
    if file is None:
        return None
    from terrapin_tools.flash.keys import key_hash, public_key

    public = public_key(file)
    return public.public_bytes_raw(), int.from_bytes(key_hash(public)[:4], "little")


def _leave() -> bool:
    """Goes on as a process of its own; True in the one that is to end."""
    if os.fork():
        return True
    os.setsid()
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in range(3):
        os.dup2(nowhere, descriptor)
    return False


def _live(scenario: Scenario, on: list[str], chip: _Chip, detach: bool) -> None:
    from terrapin_hil.robots import robot_words
    from terrapin_hil.run.boot_loader import BootLoader
    from terrapin_hil.run.changes_live import change
    from terrapin_hil.run.control import Control
    from terrapin_hil.run.living import Living
    from terrapin_hil.run.ports import open_port

    told: list[str] = []

    def said(text: str) -> None:
        if detach:
            told.append(text)
        else:
            print(text, flush=True)

    over: list[bool] = []
    with contextlib.ExitStack() as stack:
        ports, controls = [], []
        for name in on:
            if name != "pty":  # before the bus is opened: a robot may live there
                controls.append(Control(name))
                stack.callback(controls[-1].close)
            ports.append(open_port(name))
            stack.callback(ports[-1].close)
            if name == "pty":
                controls.append(Control(ports[-1].name))
                stack.callback(controls[-1].close)
        loader: BootLoader | None = None
        try:
            loader = BootLoader(chip.flash, _boot_key(chip.key))
        except UserError as error:
            if chip.flash is not None or chip.key is not None:
                raise
            said(f"without a boot loader: {error}")
        living = Living(scenario, ports, chip.node, chip.store, loader, said)
        stack.callback(living.close)

        def act(text: str) -> dict[str, Any]:
            if text == "stop":
                over.append(True)
                return {"done": "stopped"}
            if text == "status":
                return living.state()
            return {"done": change(living, text)}

        for number in (signal.SIGTERM, signal.SIGINT):
            before = signal.signal(number, lambda *_: over.append(True))
            stack.callback(signal.signal, number, before)
        ends = "`terrapin sim --do stop`" if detach else "Ctrl-C"
        said(f"{scenario.design.name} lives: {scenario.title or scenario.name}; {ends} stops it")
        for port in ports:
            said(f"on {port.name}: {shlex.join(['terrapin', 'monitor', '--link', port.attach, *robot_words()])}")
        if detach and _leave():
            stack.pop_all()  # all of it is the other's now
            print("\n".join(told), flush=True)  # here, where a reader that has gone (| head -1) ends no robot
            os._exit(0)
        asked = {control.descriptor: partial(control.serve, act) for control in controls}
        living.run(lambda: bool(over), asked)
        said(_words(living.state()))


def _changes() -> str:
    """What may be changed while a robot lives, a line each."""
    from terrapin_hil.run.changes_live import CHANGES

    return "\n".join(f"{name} = {form}" for name, (_, form) in CHANGES.items())


def _words(answer: dict[str, Any]) -> str:
    """What a robot answered."""
    if "done" in answer:
        return str(answer["done"])
    truth = answer["truth"]
    lost = ", ".join(f"{count} on {name}" for name, count in answer["lost"].items() if count)
    lag = f"; {answer['lag']:.3g} s were given up" if answer["lag"] else ""
    return "\n".join(
        [
            f"{answer['robot']}, {answer['scenario']}: {answer['time']:.1f} s, state {answer['state']}, "
            f"bridge {'on' if answer['bridge_on'] else 'off'}",
            *(f"  fault {name}: {cause}" for name, cause in answer["faults"].items()),
            f"  at {truth['position']:.3f} m, {truth['speed']:.3f} m/s, slip {truth['slip']:.3f}",
            f"  real time: 99 % of ticks within {1e3 * answer['late_p99']:.3g} ms, the latest "
            f"{1e3 * answer['latest']:.3g} ms{lag}",
            f"  frames lost by slow tools: {lost or 'none'}",
        ]
    )
