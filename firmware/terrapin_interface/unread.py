"""What controller.toml states and no code uses: limits, constants, and signals that no C file fills or reads.

    python -m terrapin_interface.unread --sources firmware [--description FILE] [--stamp FILE]

A line for each on standard error and status 1; the build runs this, and touches the stamp when all is used. Names are
looked for in the text of the C files. A signal counts where its message's struct is filled (from the controller) or
read (to it): `.signal =` in an initialiser, or `variable.signal`, in a function that declares the struct. Counter and
CRC of a protected message are the protection's. Standard library only.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

if __package__ in (None, ""):  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from terrapin_interface.description import CONTROLLER_TOML, load
from terrapin_interface.entries import Description, DescriptionError, Message

__all__ = ["main", "unread"]

PROTECTION = ("counter", "crc")
DECLARATION = re.compile(
    r"\bterrapin_(\w+?)_(t|source)\s*\*?\s*(?:const\s+)?(\w+)\s*(?:=\s*\{(.*?)\};|[;=,)])", re.DOTALL
)


def unread(d: Description, texts: Iterable[str]) -> list[str]:
    """A line for each limit, constant and signal of `d` that none of the C `texts` uses, in the description's order."""
    # Comments say nothing; a function, or a declaration of a struct, ends with a brace at the beginning of a line.
    bare = [re.sub(r"/\*.*?\*/|//[^\n]*", "", text, flags=re.DOTALL) for text in texts]
    whole = "\n".join(bare)
    words = set(re.findall(r"\w+", whole))
    used = {name for text in bare for chunk in re.split(r"^\}", text, flags=re.MULTILINE) for name in _members(chunk)}
    found = [
        f"message {message.name}, signal {field}: no C file {'fills' if message.sender == 'controller' else 'reads'} it"
        for message in d.messages
        if not _bytes(message, words)
        for field in _unused(message, used)
    ]
    found += [
        f"limit {x.name}: no C file names it" for x in d.limits if f"TERRAPIN_LIMIT_{x.name.upper()}" not in words
    ]
    return found + [
        f"constant {x.name}: no C file names it" for x in d.constants if f"TERRAPIN_{x.name.upper()}" not in words
    ]


def _members(chunk: str) -> Iterator[tuple[str, str]]:
    """(message, member) for each member of a message's struct that a piece of C fills or reads."""
    for message, _, variable, filled in DECLARATION.findall(chunk):
        for member in re.findall(r"\.(\w+)\s*=", filled):
            yield message, member
        for member in re.findall(rf"\b{variable}(?:\.|->)(\w+)", chunk):
            yield message, member


def _bytes(message: Message, words: set[str]) -> bool:
    """A message all of whose bits are signals may be taken as the bytes that it is."""
    bits = sum(s.length for s in message.signals)
    return (
        bits == 64
        and f"TERRAPIN_ID_{message.name.upper()}" in words
        and f"terrapin_{message.name.lower()}_t" not in words
    )


def _unused(message: Message, used: set[tuple[str, str]]) -> Iterator[str]:
    for signal in message.signals:
        protection = message.e2e and signal.name in PROTECTION
        names = {signal.name, signal.source or signal.name}
        if not protection and not any((message.name.lower(), name) in used for name in names):
            yield signal.name


def main(arguments: list[str] | None = None) -> int:
    """Command line; 0 when everything is used, 1 with a line for each finding on standard error otherwise."""
    parser = argparse.ArgumentParser(description="Find what controller.toml states and no C file uses.")
    parser.add_argument("--description", type=Path, default=CONTROLLER_TOML)
    parser.add_argument("--sources", type=Path, required=True, help="folder of the C files")
    parser.add_argument("--stamp", type=Path, help="a file to touch when all is used")
    options = parser.parse_args(arguments)
    try:
        files = sorted(path for path in options.sources.rglob("*") if path.suffix in (".c", ".h"))
        found = unread(load(options.description), [path.read_text(encoding="utf-8") for path in files])
    except (DescriptionError, OSError) as error:
        found = [str(error)]
    for line in found:
        print(
            f"unread: {options.description.name}: {line}" if options.description.name not in line else line,
            file=sys.stderr,
        )
    if not found and options.stamp:
        options.stamp.touch()
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
