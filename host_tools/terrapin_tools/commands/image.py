"""`terrapin image`: build, sign, verify and look into images for the boot loader."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from terrapin_tools.command_options import RobotName
from terrapin_tools.errors import UserError, about

if TYPE_CHECKING:
    from terrapin_tools.flash.image import Image

__all__ = ["SUBCOMMANDS"]

ImageFile = Annotated[Path, typer.Argument(metavar="IMAGE", help="a signed image")]
Key = Annotated[
    Path | None, typer.Option("--key", metavar="KEY.pem", help="default: the development key of this build")
]


def _read(path: Path) -> tuple[Image, bytes]:
    from terrapin_tools.flash.image import ImageError, parse, read_start

    data = read_start(path)
    with about(path, ImageError):
        return parse(data), data


def _made_for(image: Image) -> str:
    from terrapin_hil.messages import interface
    from terrapin_tools.flash.update import robot_name

    if not image.robot:
        return "any robot"
    boards = {number: name for name, number in interface().enums["board"].items()}
    board = boards.get(image.board, str(image.board))
    return f"{robot_name(image.robot)}, board {board}, interface version {image.interface}"


def _identity(robot: str) -> int:
    """A robot's number, by its name, its file or the number itself; 0 for none."""
    from terrapin_interface.robot import RobotError, find_robot, identity_of

    if re.fullmatch("0x[0-9a-f]{1,6}", robot):
        return int(robot, 16)
    with about("--replaces", RobotError):
        return identity_of(find_robot(robot).stem) if robot else 0


def build(
    to: Annotated[Path, typer.Option("--out", metavar="DIR", help="where boot loader and images go")],
    robot: RobotName = "cylinder",
    board: Annotated[
        str, typer.Option("--board", metavar="BOARD", help="another than the robot's: a shipped board, or a file")
    ] = "",
) -> None:
    """Build boot loader and images of a robot. Needs the sources, CMake and arm-none-eabi-gcc.

    Example: terrapin image build --robot sphere --out images
    """
    from terrapin_tools.flash.build import build_images
    from terrapin_tools.progress import bar

    with bar(f"building {robot}", None):
        made = build_images(robot, board, to)
    for path in made:
        print(f"{path}: {path.stat().st_size} bytes")


def sign(
    code: Annotated[Path, typer.Argument(metavar="CODE.bin", help="linked for slot A or B; begins at its vectors")],
    to: Annotated[Path, typer.Argument(metavar="IMAGE", help="the signed image")],
    version: Annotated[str, typer.Option("--version", help="MAJOR.MINOR.REVISION[+BUILD]")],
    key: Key = None,
    counter: Annotated[
        int, typer.Option("--counter", help="security counter: raise it when older images must never run again")
    ] = 0,
    unit: Annotated[
        str, typer.Option("--unit", help="chip (PORT_IDENTITY.unique) whose release boot loader takes this desk image")
    ] = "",
    revoke: Annotated[
        Path | None,
        typer.Option("--revoke", metavar="OLD.pem", help="a key that controllers take no more once this is confirmed"),
    ] = None,
    replaces: Annotated[
        str,
        typer.Option(
            "--replaces", metavar="ROBOT", help="a robot whose controller takes it, and is another robot's from then on"
        ),
    ] = "",
) -> None:
    """Put header, security counter and signature around code. The slot is that which the code is linked for.

    Example: terrapin image sign terrapin-f405-h-bridge-slot-a.bin robot-a.bin --version 1.2.0 --key robot.pem
    """
    from terrapin_tools.flash.image import ImageError, Version, code_slot, kind_of, read_start
    from terrapin_tools.flash.image import sign as make
    from terrapin_tools.flash.keys import development_key, private_key, public_key
    from terrapin_tools.flash.layout import HEADER_SIZE, SLOT_SIZE, SLOTS
    from terrapin_tools.workbench.files.writing import write_whole

    if not 0 <= counter < 2**32:
        raise UserError(f"--counter: found {counter}, expected 0 to 4294967295")
    with about("--version"):
        number = Version.of(version)
    try:
        chip = int(unit, 0) if unit else None
    except ValueError:
        chip = -1
    if chip is not None and not 0 < chip < 2**32:
        raise UserError(f"--unit: found {unit!r}, expected a number from 1 to 0xffffffff")
    data = read_start(code)
    for source, what in ((code, "code"), (key or development_key(), "key")):
        if to.exists() and source.exists() and to.samefile(source):
            raise UserError(f"{to}: is the {what} itself; expected another name for the image")
    with about(code, ImageError):
        slot = code_slot(data)
    if slot is None:
        starts = " or ".join(f"0x{start + HEADER_SIZE:08x}" for start in SLOTS.values())
        raise UserError(f"{code}: its reset vector is in no slot; expected code linked for {starts}")
    if len(data) > SLOT_SIZE:
        raise UserError(f"{code}: more than the {SLOT_SIZE} bytes of a slot")
    data += b"\xff" * (-len(data) % 4)
    with about(code, ImageError):
        revoked = public_key(revoke) if revoke else None
        image = make(
            data, private_key(key or development_key()), number, counter, slot, chip, revoked, _identity(replaces)
        )
    try:
        write_whole(to, image)
    except OSError as error:
        raise UserError(f"{to}: cannot write: {error.strerror}") from None
    kind = kind_of(data)
    print(f"{to}: {len(image)} bytes for slot {slot}, {kind}, version {number}, security counter {counter}")


def verify(path: ImageFile, key: Key = None) -> None:
    """Check digest, key and signature. Status 2 when one is not good.

    Example: terrapin image verify robot-a.bin --key robot.pem
    """
    from terrapin_tools.flash.image import ImageError
    from terrapin_tools.flash.image import verify as check
    from terrapin_tools.flash.keys import development_key, public_key

    image, _ = _read(path)
    with about(path, ImageError):
        check(image, public_key(key or development_key()))
    print(f"{path}: good, version {image.version}, slot {image.slot}")


def info(path: ImageFile) -> None:
    """What an image says about itself; nothing of it is verified.

    Example: terrapin image info robot-a.bin
    """
    from terrapin_tools.flash.update import robot_name

    image, data = _read(path)
    signed = f"Ed25519, key {image.key_hash[:4].hex()}" if image.key_hash else "not signed"
    print(
        f"{path}: {len(data)} bytes\n"
        f"  version           {image.version}\n"
        f"  slot              {image.slot}\n"
        f"  made for          {_made_for(image)}\n"
        f"  kind              {image.kind}{'' if image.unit is None else f', for the chip 0x{image.unit:08x}'}\n"
        f"  code              {image.code_size} bytes\n"
        f"  security counter  {image.security_counter}\n"
        f"  SHA-256           {image.digest.hex()}\n"
        f"  signature         {signed}"
        + (f"\n  replaces          {robot_name(image.replaces)}" if image.replaces else "")
        + (f"\n  revokes           key {image.revokes.hex()}" if image.revokes else "")
    )


SUBCOMMANDS = (build, sign, verify, info)
