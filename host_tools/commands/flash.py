"""`terrapin flash`: put a signed image on a controller."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from host_tools.errors import UserError

if TYPE_CHECKING:
    from host_tools.flash.update import SignedFile
    from host_tools.flash.wires import Wire

__all__ = ["register"]

VIAS = ("swd", "stm32", "can", "serial")
Told = Callable[[str, int, int], None]


@contextmanager
def _progress() -> Iterator[Told]:
    """A bar on standard error when that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda what, done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:9}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)
        yield lambda what, done, total: bar.update(task, description=what, completed=done, total=total)


def _files(images: Sequence[Path]) -> list[SignedFile]:
    """The images, read; one a slot."""
    from host_tools.flash.image import ImageError, intact, parse, read_start
    from host_tools.flash.update import SignedFile

    files: list[SignedFile] = []
    for path in images:
        data = read_start(path)
        try:
            image = parse(data)
            intact(image)
        except ImageError as error:
            raise UserError(f"{path}: {error}") from None
        if image.signature is None:
            raise UserError(f"{path}: not signed; `terrapin image sign` does it")
        same = [file.name for file in files if file.image.slot == image.slot]
        if same:
            raise UserError(f"{path}: for slot {image.slot} like {same[0]}, expected one image a slot")
        files.append(SignedFile(str(path), image, data))
    return files


def _serial_port(port: str, via: str) -> str:
    from host_tools.flash.listing import serial_ports

    if port:
        return port
    found = [device for device, _ in serial_ports()]
    if len(found) != 1:
        raise UserError(f"--via {via}: choose the serial port with --port; found: {', '.join(found) or 'none'}")
    return found[0]


def _wire(via: str, port: str, baud: int, bitrate: int) -> Wire:
    from host_tools.flash.wires import BAUD, BIT_RATE, CanWire, SerialWire

    if via == "serial":
        return SerialWire(_serial_port(port, via), baud or BAUD)
    kind, _, channel = (port or "socketcan:can0").partition(":")
    if kind == "can":
        kind, _, channel = channel.partition(":")
    if not kind or not channel:
        raise UserError(f"--port: found {port!r}, expected socketcan:CHANNEL or can:INTERFACE:CHANNEL")
    return CanWire(kind, channel, bitrate or BIT_RATE)


def _update(files: Sequence[SignedFile], wire: Wire) -> str:
    from host_tools.flash.update import update

    with closing(wire), _progress() as told:
        outcome = update(wire, files, told)
    after = {
        "confirmed": "started and confirmed",
        "on trial": "started; not confirmed yet: without that the old image comes back at the next reset",
        "silent": "verified by the boot loader; the application does not say whether it started",
    }
    return f"slot {outcome.slot}: {after[outcome.state]}"


def _whole(files: Sequence[SignedFile], via: str, port: str, baud: int, loader: Path | None) -> str:
    from host_tools.flash import plan as plans
    from host_tools.flash.layout import BASE
    from host_tools.flash.stm32 import Stm32
    from host_tools.flash.swd import Swd

    data = plans.boot_loader(loader) if loader else None
    if data is not None:
        plans.check_starts(data, str(loader), files)
    what = plans.plan(files, data)
    programmer = Swd(port or None) if via == "swd" else Stm32(_serial_port(port, via), baud or 115_200)
    with closing(programmer), _progress() as told:
        if isinstance(programmer, Stm32):
            programmer.connect()
        if data is None:
            there = plans.read(programmer, BASE, plans.BOOT_SIZE, told)
            if not plans.begins(there):
                raise UserError(
                    f"{programmer.name}: the chip has no boot loader to start an image, expected --boot-loader"
                )
            plans.check_starts(there, "the chip's boot loader", files)
        plans.perform(programmer, what, told)
    written = ", ".join(f"slot {file.image.slot}" for file in files)
    return f"{'boot loader, ' if loader else ''}{written}: written and read back, started"


def flash(
    images: Annotated[
        list[Path] | None,
        typer.Argument(metavar="IMAGE...", help="signed; one a slot, the right one is taken"),
    ] = None,
    via: Annotated[str, typer.Option("--via", help="swd, stm32 (the chip's own boot loader), can or serial")] = "",
    port: Annotated[
        str, typer.Option("--port", help="a probe's id, /dev/ttyUSB0, socketcan:can0, can:INTERFACE:CHANNEL")
    ] = "",
    baud: Annotated[int, typer.Option("--baud", help="of the serial port; default 1000000, stm32: 115200")] = 0,
    bitrate: Annotated[int, typer.Option("--bitrate", help="of the CAN adapter, bit/s; default 500000")] = 0,
    loader: Annotated[
        Path | None, typer.Option("--boot-loader", metavar="FILE.bin", help="swd, stm32: write this, too")
    ] = None,
    listed: Annotated[bool, typer.Option("--list", help="probes, serial ports and CAN interfaces")] = False,
) -> None:
    """Write a signed image, read it back or have it verified, and start it.

    can and serial update a controller that runs, with its motor off, through its boot loader: the running image stays
    until the new one has started well. swd and stm32 write an empty or a broken one, and forget what was there.

    Example: terrapin flash robot-a.bin robot-b.bin --via can --port socketcan:can0
    """
    if listed:
        from host_tools.flash.listing import listing

        print(listing())
        return
    if via not in VIAS:
        raise UserError(f"--via: found {via!r}, expected one of {', '.join(VIAS)}")
    if baud < 0 or bitrate < 0:
        raise UserError("--baud, --bitrate: expected more than 0")
    if loader and via in ("can", "serial"):
        raise UserError(f"--boot-loader: cannot be written via {via}, expected --via swd or stm32")
    if baud and via not in ("serial", "stm32"):
        raise UserError(f"--baud: --via {via} has none, expected it with serial or stm32")
    if bitrate and via != "can":
        raise UserError(f"--bitrate: --via {via} has none, expected it with can")
    if bitrate and (port or "socketcan:").removeprefix("can:").startswith("socketcan:"):
        raise UserError("--bitrate: socketcan's is set outside (ip link set can0 type can bitrate 500000)")
    if not images:
        raise UserError("no IMAGE; `terrapin image sign` makes one")
    files = _files(images)
    if via in ("swd", "stm32"):
        print(_whole(files, via, port, baud, loader))
    else:
        print(_update(files, _wire(via, port, baud, bitrate)))


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command()(flash)
