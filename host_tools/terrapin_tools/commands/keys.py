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


def public(
    key: Annotated[Path, typer.Argument(metavar="KEY.pem", help="a key that signs images")],
    path: Annotated[Path, typer.Argument(metavar="PUBLIC.pem", help="the file to make; never replaced")],
) -> None:
    """Write the public half of a key into a file of its own: what a release boot loader is built with, and what
    `flash --protect` and `keys revoke` need of it.

    Example: terrapin keys public robot.pem robot.pub.pem
    """
    from terrapin_tools.flash.keys import key_hash, public_key, public_text, write_new

    half = public_key(key)
    write_new(path, public_text(half))
    print(f"{path}: public half {key_hash(half)[:4].hex()}, no secret")


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


def revoke(
    old: Annotated[
        Path, typer.Argument(metavar="OLD.pem", help="the key that shall count no more; its public half will do")
    ],
    images: Annotated[list[Path], typer.Argument(metavar="IMAGE...", help="signed with it; they stay as they are")],
    key: Annotated[
        Path, typer.Option("--key", metavar="NEXT.pem", help="the boot loader's other key (TERRAPIN_NEXT_KEY)")
    ],
    to: Annotated[Path, typer.Option("--out", metavar="DIR", help="where the new images go, under the same names")],
) -> None:
    """Sign images anew with a boot loader's other key, so that they revoke the old one: once such an image is on a
    controller (`terrapin flash`) and confirmed, no image that the old key signed starts there any more.

    Example: terrapin keys revoke robot.pem robot-a.bin robot-b.bin --key robot-2.pem --out revoking
    """
    from terrapin_tools.errors import about
    from terrapin_tools.flash.image import ImageError, intact, parse, read_start, sign_again
    from terrapin_tools.flash.keys import key_hash, private_key, public_key
    from terrapin_tools.workbench.files.writing import write_whole

    revoked, signer = public_key(old), private_key(key)
    made = []
    for path in images:
        data = read_start(path)
        with about(path, ImageError):
            intact(parse(data))
            made.append((to / path.name, sign_again(data, signer, revoked)))
        if (to / path.name).exists():
            raise UserError(f"{to / path.name}: exists already; expected another --out")
    for path, data in made:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, data)
        except OSError as error:
            raise UserError(f"{path}: cannot write: {error.strerror}") from None
        by = key_hash(signer.public_key())[:4].hex()
        print(f"{path}: signed with key {by}, revokes key {key_hash(revoked)[:4].hex()} once it is confirmed")


SUBCOMMANDS = (new, public, revoke, link, renew, show)
