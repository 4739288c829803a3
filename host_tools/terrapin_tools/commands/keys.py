"""`terrapin keys`: keys that sign images, and link keys that seal commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from terrapin_tools.errors import UserError

__all__ = ["SUBCOMMANDS"]

PEM_LIMIT = 10_000  # bytes of a file that are looked at


def new(
    path: Annotated[Path, typer.Argument(metavar="KEY.pem", help="the file to make; never replaced")],
) -> None:
    """Make an Ed25519 key in a PEM file that its owner alone may read. Its public half goes into the boot loader:
    cmake --preset cortex-m4 -DTERRAPIN_KEY=KEY.pem

    Example: terrapin keys new robot.pem
    """
    from terrapin_tools.flash.keys import key_hash, new_key

    print(f"{path}: private key, public half {key_hash(new_key(path))[:4].hex()}; keep it, and keep it secret")


LinkKeyFile = Annotated[Path, typer.Argument(metavar="LINK.key", help="the file to make; never replaced")]


def link(path: LinkKeyFile) -> None:
    """Make a link key: a controller that has it takes commands and changes only from who has it, too. It goes onto the
    chip beside the boot loader, with a debug probe: terrapin flash ... --boot-loader FILE.bin --link-key LINK.key

    Example: terrapin keys link robot.key
    """
    from terrapin_hil.links.seal import LinkKey
    from terrapin_tools.flash.keys import write_secret

    key = LinkKey.new()
    write_secret(path, key.text().encode())
    print(f"{path}: link key {key.fingerprint}, generation 1; keep it secret")


def renew(
    old: Annotated[Path, typer.Argument(metavar="OLD.key", help="the link key that shall count no more")],
    path: LinkKeyFile,
) -> None:
    """Make the link key of the next generation. Once it is on the controller, the old one opens no session there.

    Example: terrapin keys renew robot.key robot-2.key
    """
    from terrapin_hil.links.seal import LinkKey
    from terrapin_tools.flash.keys import write_secret

    key = LinkKey.new(LinkKey.read(old).generation + 1)
    write_secret(path, key.text().encode())
    print(
        f"{path}: link key {key.fingerprint}, generation {key.generation}; {old} counts until it is on the controller"
    )


def show(path: Annotated[Path, typer.Argument(metavar="KEY", help="a PEM or a link key")]) -> None:
    """Say which key a file holds, by its fingerprint. Nothing of the key itself is shown.

    Example: terrapin keys show robot.pem
    """
    from terrapin_hil.links.seal import LinkKey
    from terrapin_tools.flash.keys import key_hash, public_key

    try:
        with path.open("rb") as file:
            pem = b"-----BEGIN" in file.read(PEM_LIMIT)
    except OSError as error:
        raise UserError(f"{path}: cannot read the key: {error.strerror}") from None
    if pem:
        print(f"{path}: signs images, public half {key_hash(public_key(path))[:4].hex()}")
    else:
        key = LinkKey.read(path)
        print(f"{path}: link key {key.fingerprint}, generation {key.generation}")


SUBCOMMANDS = (new, link, renew, show)
