"""`terrapin keys`: keys that sign images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["SUBCOMMANDS"]


def new(
    path: Annotated[Path, typer.Argument(metavar="KEY.pem", help="the file to make; never replaced")],
) -> None:
    """Make an Ed25519 key in a PEM file that its owner alone may read. Its public half goes into the boot loader:
    cmake --preset cortex-m4 -DTERRAPIN_KEY=KEY.pem

    Example: terrapin keys new robot.pem
    """
    from terrapin_tools.flash.keys import key_hash, new_key

    print(f"{path}: private key, public half {key_hash(new_key(path))[:4].hex()}; keep it, and keep it secret")


SUBCOMMANDS = (new,)
