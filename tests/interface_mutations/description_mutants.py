"""controller.toml with one number of one telemetry signal changed, and what must come of it.

Either the generator refuses, in one line that names the signal and the field, or everything that is made of it is
right for the new number (oracle.py).
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from pathlib import Path

from terrapin_interface.description import CONTROLLER_TOML
from terrapin_interface.entries import DescriptionError
from terrapin_interface.generate import generate
from tests.interface_mutations.oracle import compile_core, wrong
from tests.interface_mutations.reference import Message, Reference, Signal

__all__ = ["MUTANTS", "Mutant", "judge"]

TEXT = CONTROLLER_TOML.read_text(encoding="utf-8")
REFUSED = "refused by name"
RIGHT = "right in every decoder"


@dataclass(frozen=True)
class Mutant:
    message: str
    signal: str
    field: str
    old: str
    new: str

    @property
    def name(self) -> str:
        return f"{self.message}.{self.signal} {self.field} {self.old or 'none'} -> {self.new}"

    def text(self) -> str:
        """The whole description with it."""
        begin = TEXT.index(f"\n[message.{self.message}]\n")
        line = re.compile(rf'^( *\{{|signals = \[ \{{) name = "{self.signal}".*$', re.MULTILINE).search(TEXT, begin)
        assert line is not None
        entry = line[0]
        if self.old:
            changed, count = re.subn(
                rf"\b{self.field} = {re.escape(self.old)}(?=[, ])", f"{self.field} = {self.new}", entry
            )
        else:
            changed, count = re.subn(r"(length = \d+)", rf"\1, {self.field} = {self.new}", entry)
        assert count == 1, self.name
        return TEXT[: line.start()] + changed + TEXT[line.end() :]


def _mutants(m: Message, s: Signal) -> Iterator[Mutant]:
    entry = next(e for e in m.table["signals"] if e["name"] == s.name)
    scale = re.search(rf'name = "{s.name}".*?scale = ([\d.]+)', _block(m.name)) if "scale" in entry else None
    old = scale[1] if scale else ""
    for factor in ("2", "0.5", "10", "3", "1.5", "0.1") if old else ("2", "0.5"):
        new = Decimal(old or "1") * Decimal(factor)
        yield Mutant(m.name, s.name, "scale", old, f"{new:f}" if "." in f"{new:f}" else f"{new:f}.0")
    if not m.telemetry:
        return
    for offset in ("1", "-40.0"):
        yield Mutant(m.name, s.name, "offset", "", offset)
    for length in (s.length + 1, s.length - 1, s.length + 5, s.length - 3):
        if length > 0:
            yield Mutant(m.name, s.name, "length", str(s.length), str(length))
    taken = {bit for other in m.signals if other is not s for bit in range(other.start, other.start + other.length)}
    free = [b for b in range(65 - s.length) if b != s.start and not taken & set(range(b, b + s.length))]
    for start in {s.start + 1, s.start - 1, s.start + 8, *free[:1], *free[-1:]} - {s.start}:
        if start >= 0:
            yield Mutant(m.name, s.name, "start", str(s.start), str(start))


@cache
def _block(message: str) -> str:
    return TEXT[TEXT.index(f"\n[message.{message}]\n") :]


def _all() -> Iterator[Mutant]:
    for m in Reference(TEXT).messages:
        for s in m.signals:
            if m.telemetry or s.source:
                yield from _mutants(m, s)


MUTANTS: tuple[Mutant, ...] = tuple(_all())


@cache
def _workplace() -> tuple[Path, Path]:
    folder = Path(tempfile.mkdtemp(prefix="mutants-"))
    return folder, compile_core(folder)


def judge(mutant: Mutant) -> tuple[bool, str]:
    """Whether it is as it must be, and what came of it."""
    folder, integer = _workplace()
    text = mutant.text()
    file = folder / "controller.toml"
    file.write_text(text, encoding="utf-8")
    try:
        generate(file, [], folder / "generated")
    except DescriptionError as error:
        line = str(error)
        where = f"message {mutant.message}, signal "
        named = where in line and re.search(rf"\b{mutant.signal}\b", line) and f"'{mutant.field}'" in line
        return bool(named) and "\n" not in line, REFUSED if named else line
    found = wrong(text, folder / "generated", integer, mutant.message)
    return not found, found or RIGHT
