"""`terrapin flash`: put a signed image on a controller."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from terrapin_hil.links.names import BIT_RATE, SET_OUTSIDE, LinkName
from terrapin_tools.command_options import NodeNumber, RobotName, link_option
from terrapin_tools.errors import UserError, about
from terrapin_tools.progress import bar

if TYPE_CHECKING:  # cryptography, which `terrapin flash --help` does not need
    from terrapin_tools.flash.update import SignedFile
    from terrapin_tools.flash.wire import Told, Wire

__all__ = ["flash"]

VIAS = ("swd", "stm32", "can", "serial")


def _told(shown: Callable[..., None]) -> Told:
    return lambda what, done, total: shown(description=what, completed=done, total=total)


def _files(images: Sequence[Path]) -> list[SignedFile]:
    """The images, read; one a slot."""
    from terrapin_tools.flash.image import ImageError, intact, parse, read_start
    from terrapin_tools.flash.update import SignedFile

    files: list[SignedFile] = []
    for path in images:
        data = read_start(path)
        with about(path, ImageError):
            image = parse(data)
            intact(image)
        if image.signature is None:
            raise UserError(f"{path}: not signed; `terrapin image sign` does it")
        same = [file.name for file in files if file.image.slot == image.slot]
        if same:
            raise UserError(f"{path}: for slot {image.slot} like {same[0]}, expected one image a slot")
        files.append(SignedFile(str(path), image, data))
    return files


def _require_robot(files: Sequence[SignedFile], name: str) -> None:
    """UserError unless the images are made for this robot and its board."""
    from terrapin_interface.robot import RobotError, find_robot, load_robot
    from terrapin_tools.flash.update import robot_name

    try:
        robot = load_robot(find_robot(name))
    except RobotError as error:
        raise UserError(str(error)) from None
    for file in files:
        if file.image.robot != robot.identity:
            made = robot_name(file.image.robot) if file.image.robot else "no robot that it names"
            raise UserError(f"{file.name}: made for {made}, expected {robot.name}, which --robot names")
        if file.image.board != robot.board.number:
            raise UserError(
                f"{file.name}: made for board number {file.image.board}, expected {robot.board.number}, "
                f"{robot.board.name}, which {robot.name}.toml names"
            )


def _serial_port(port: str, via: str) -> str:
    from terrapin_tools.flash.listing import serial_ports

    if port:
        return port
    found = [device for device, _ in serial_ports()]
    if len(found) != 1:
        raise UserError(f"--via {via}: choose the serial port with --port; found: {', '.join(found) or 'none'}")
    return found[0]


def _controller(link: LinkName | None, via: str, port: str, baud: int, bitrate: int) -> LinkName:
    """The link to a controller that runs: as it is named, or by --via can or serial and its --port."""
    if link is None:
        serial = via == "serial"
        name = f"serial:{_serial_port(port, via)}" if serial else port or "socketcan:can0"
        link = LinkName.parse(name, "update")
    if bitrate and link.interface == "socketcan":
        raise UserError(f"--bitrate: {SET_OUTSIDE}")
    return replace(link, baud=link.baud or baud)


def _update(files: Sequence[SignedFile], wire: Wire, change_robot: bool, link_key: Path | None) -> str:
    from terrapin_hil.links.seal import LinkKey
    from terrapin_tools.flash.update import update

    with closing(wire), bar("", None) as shown:
        key = LinkKey.read(link_key) if link_key else None
        outcome = update(wire, files, _told(shown), change_robot, key)
    after = {
        "confirmed": "started and confirmed",
        "on trial": "started; not confirmed yet: without that the old image comes back at the next reset",
        "silent": "verified by the boot loader; the application does not say whether it started",
    }
    revokes = next(file.image.revokes for file in files if file.image.slot == outcome.slot).hex()
    counts = "counts no more" if outcome.revoked else "counts until a start after the image is confirmed"
    return f"slot {outcome.slot}: {after[outcome.state]}{f'; key {revokes} {counts}' if revokes else ''}"


def _whole(
    files: Sequence[SignedFile], via: str, port: str, baud: int, loader: Path | None, node: int, link_key: Path | None
) -> str:
    from terrapin_hil.links.seal import LinkKey
    from terrapin_tools.flash import plan as plans
    from terrapin_tools.flash.layout import BASE
    from terrapin_tools.flash.stm32 import Stm32
    from terrapin_tools.flash.swd import Swd

    data = plans.boot_loader(loader) if loader else None
    if data is not None:
        plans.check_starts(data, str(loader), files)
    key = LinkKey.read(link_key) if link_key else None
    revoked = 0
    programmer = Swd(port or None) if via == "swd" else Stm32(_serial_port(port, via), baud or 115_200)
    with closing(programmer), bar("", None) as shown:
        told = _told(shown)
        if isinstance(programmer, Stm32):
            programmer.connect()
        if data is None:
            there = plans.read(programmer, BASE, plans.BOOT_SIZE, told)
            if not plans.begins(there):
                raise UserError(
                    f"{programmer.name}: the chip has no boot loader to start an image, expected --boot-loader"
                )
            plans.check_starts(there, "the chip's boot loader", files)
            revoked = plans.revoked_place(programmer, told)
        else:  # its sector is erased, and what was sealed stays so: the key that is there goes with it
            there = key.block() if key else plans.read(programmer, BASE + plans.LINK_KEY, plans.LINK_KEY_SIZE, told)
            data = plans.with_link_key(data, there)
        plans.perform(programmer, plans.plan(files, data, node, revoked), told)
    written = ", ".join(f"slot {file.image.slot}" for file in files)
    stays = (
        f"; its {('first', 'second')[revoked - 1]} key stays revoked: an image of it does not start" if revoked else ""
    )
    return f"{'boot loader, ' if loader else ''}{written}: written and read back, started{stays}"


def _protect(port: str, key: Path | None, yes: bool) -> str:
    from terrapin_hil import paths
    from terrapin_tools.flash import plan as plans
    from terrapin_tools.flash.keys import public_key
    from terrapin_tools.flash.layout import BASE
    from terrapin_tools.flash.protect import protect, refuse_bench_key
    from terrapin_tools.flash.swd import Swd

    if key is None:
        raise UserError("--protect: expected --key, the public key whose images the boot loader starts")
    owner = public_key(key)
    bench = paths.development_key()
    with closing(Swd(port or None)) as chip, bar("", None) as shown:
        loader = plans.read(chip, BASE, plans.BOOT_SIZE, _told(shown))
        refuse_bench_key(chip.name, loader, owner, public_key(bench) if bench.is_file() else None)
        if not yes:
            raise UserError(
                f"{chip.name}: would protect the boot loader from writing and the chip from reading (level 1): a debug "
                "probe then sees nothing, and going back erases the whole chip. Say --yes to do it"
            )
        done = protect(chip)
    return f"{chip.name}: " + ("protected; takes effect at the next power-on" if done else "was protected already")


def flash(
    images: Annotated[
        list[Path] | None,
        typer.Argument(metavar="IMAGE...", help="signed; one a slot, the right one is taken"),
    ] = None,
    link: Annotated[LinkName | None, link_option("update", "to a controller that runs")] = None,
    via: Annotated[
        str,
        typer.Option(
            "--via", help="swd, stm32 (the chip's own boot loader); can, serial with --port instead of --link"
        ),
    ] = "",
    port: Annotated[str, typer.Option("--port", help="a probe's id, a serial port, or with --via can a link")] = "",
    baud: Annotated[int, typer.Option("--baud", min=0, help="of the serial port; default 1000000, stm32: 115200")] = 0,
    bitrate: Annotated[int, typer.Option("--bitrate", min=0, help="of the CAN adapter, bit/s; default 500000")] = 0,
    loader: Annotated[
        Path | None, typer.Option("--boot-loader", metavar="FILE.bin", help="swd, stm32: write this, too")
    ] = None,
    link_key: Annotated[
        Path | None,
        typer.Option(
            "--link-key",
            metavar="LINK.key",
            help="over a link: the controller's, if it has one; with --boot-loader: put it beside that, else the chip "
            "keeps its own",
        ),
    ] = None,
    node: NodeNumber = None,
    change_robot: Annotated[
        bool, typer.Option("--change-robot", help="the controller becomes that of the image's robot")
    ] = False,
    protect: Annotated[
        bool, typer.Option("--protect", help="swd: read and write protection, brown-out reset; asks for --yes")
    ] = False,
    key: Annotated[
        Path | None, typer.Option("--key", metavar="PUBLIC.pem", help="--protect: of the boot loader")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="--protect: do it")] = False,
    robot: RobotName = "",
    listed: Annotated[bool, typer.Option("--list", help="probes, serial ports and CAN interfaces")] = False,
) -> None:
    """Write a signed image, read it back or have it verified, and start it.

    Over a link it updates a controller that runs, with its motor off, through its boot loader: the running image stays
    until the new one has started well. --via swd and stm32 write an empty or a broken one, and forget what was there:
    --node is then the number that it gets.

    Example: terrapin flash robot-a.bin robot-b.bin --link socketcan:can0
    """
    if listed:
        from terrapin_tools.flash.listing import listing

        print(listing())
        return
    if protect:
        if via != "swd" or images or link is not None:
            raise UserError("--protect: expected with --via swd, and without images")
        print(_protect(port, key, yes))
        return
    if key is not None or yes:
        raise UserError("--key, --yes: expected with --protect")
    if link is not None:
        if via or port:
            raise UserError("--link: expected without --via and --port")
        via = "can" if link.interface else "serial"
    if via not in VIAS:
        raise UserError(f"--via: found {via!r}, expected one of {', '.join(VIAS)}, or --link")
    if link_key and not loader and via in ("swd", "stm32"):
        raise UserError("--link-key: expected with --boot-loader, whose sector it shares")
    if loader and via in ("can", "serial"):
        raise UserError(f"--boot-loader: cannot be written via {via}, expected --via swd or stm32")
    if baud and via not in ("serial", "stm32"):
        raise UserError(f"--baud: --via {via} has none, expected it with serial or stm32")
    if bitrate and via != "can":
        raise UserError(f"--bitrate: --via {via} has none, expected it with can")
    if not images:
        raise UserError("no IMAGE; `terrapin image sign` makes one")
    controller = None if via in ("swd", "stm32") else _controller(link, via, port, baud, bitrate)
    files = _files(images)
    if robot:
        _require_robot(files, robot)
    if controller is None:
        from terrapin_hil.nodes import node_number

        print(_whole(files, via, port, baud, loader, node_number(str(node or 0), "--node"), link_key))
    else:
        from terrapin_tools.flash.wires import open_wire

        print(_update(files, open_wire(controller.at_node(node), bitrate or BIT_RATE), change_robot, link_key))
