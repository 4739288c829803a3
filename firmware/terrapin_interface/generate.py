"""Turn controller.toml into everything that is derived from it.

    python -m terrapin_interface.generate --out build/host/generated [--robot NAME|FILE] [--description FILE]
        [--header FILE ...]
    python -m terrapin_interface.generate --board [--robot NAME|FILE]

Writes terrapin_interface.h and .c and terrapin_pack.h (codec and tables), terrapin_scaling.h (the core's units to raw
numbers), terrapin.dbc, interface.md, interface.json, robot.toml and board.toml (the files as they were),
terrapin_board.h (pins and constants of the robot's board) and terrapin_cdef.h (the declarations of the given headers
and of the codec, for cffi). With --board it prints the name of the robot's board and the board's file instead. A file
whose text has not changed is left alone, so that a build does not run again for nothing.
Standard library only.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

if __package__ in (None, ""):  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from terrapin_interface.board_header import board_header
from terrapin_interface.cdef import cdef
from terrapin_interface.codec import header, pack_header, source
from terrapin_interface.dbc import dbc
from terrapin_interface.description import CONTROLLER_TOML, load
from terrapin_interface.entries import DescriptionError
from terrapin_interface.reference import as_json, markdown
from terrapin_interface.robot import DEFAULT, Robot, RobotError, find_robot, load_robot
from terrapin_interface.scaling import scaling_header

__all__ = ["generate", "main"]


def generate(description: Path, headers: list[Path], out: Path, robot: Robot | None = None) -> list[Path]:
    """Write all files for a robot (the cylinder by default) into the folder `out`; those that were written anew.

    DescriptionError, RobotError, OSError.
    """
    d = load(description, robot)
    interface = header(d)
    of = (DEFAULT if robot is None else robot.name).encode("ascii", "replace").decode()
    texts = {
        "terrapin_interface.h": interface,
        "terrapin_interface.c": source(d),
        "terrapin_pack.h": pack_header(d),
        "terrapin_scaling.h": scaling_header(d),
        "terrapin.dbc": dbc(d, of),
        "interface.md": markdown(d, of),
        "interface.json": as_json(d),
    }
    if robot is not None:
        texts |= {"robot.toml": robot.text, "board.toml": robot.board.text}
        if "board" in d.enums:
            texts["terrapin_board.h"] = board_header(robot, d)
    if headers:
        first, *others = [path.read_text(encoding="utf-8") for path in headers]
        texts["terrapin_cdef.h"] = cdef([first, interface, *others])
    out.mkdir(parents=True, exist_ok=True)
    written = []
    for name, text in texts.items():
        path = out / name
        data = text.encode("cp1252" if name.endswith(".dbc") else "utf-8")  # cp1252: what readers of DBC expect
        if not path.exists() or path.read_bytes() != data:
            path.write_bytes(data)
            written.append(path)
    return written


def main(arguments: list[str] | None = None) -> int:
    """Command line; 0 when all is well, 1 with one line on standard error otherwise."""
    parser = argparse.ArgumentParser(description="Generate codec, tables, DBC and reference from controller.toml.")
    parser.add_argument("--description", type=Path, default=CONTROLLER_TOML)
    parser.add_argument("--header", type=Path, action="append", default=[], help="headers for cffi, terrapin.h first")
    parser.add_argument("--robot", default=DEFAULT, help="a shipped robot, or the file of one")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--out", type=Path)
    what.add_argument("--board", action="store_true", help="print name and file of the robot's board")
    options = parser.parse_args(arguments)
    try:
        robot = load_robot(find_robot(options.robot))
        if options.board:
            print(f"{robot.board.name};{robot.board.file.resolve()}", end="")
            return 0
        generate(options.description, options.header, options.out, robot)
    except UnicodeEncodeError as error:
        print(
            f"generate: {options.description.name}: no place in a DBC for {error.object[error.start]!r}",
            file=sys.stderr,
        )
        return 1
    except (DescriptionError, RobotError, OSError) as error:
        print(f"generate: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
