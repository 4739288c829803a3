"""How deep the stack of an image can get, from its instructions.

    stack_report.py --nm NM --objdump OBJDUMP --su FOLDER IMAGE...

A function takes what its instructions push; no function of the image may push in a loop or by a variable, which the
compiler's own figures (-fstack-usage, in FOLDER) must confirm. From reset and each exception of the vector table the
deepest chain of calls is followed. Interrupts never preempt each other, for no port sets a priority; a HardFault may
come upon one and an NMI upon that: the bound is the sum of the four, with the frames that the processor stacks.

Refused, with status 1: recursion, a call through a pointer or a set stack pointer that is not listed below, a frame of
variable size or other than the compiler says, a bound above what the linker script sets aside. Standard library only.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

EXCEPTION = 36  # bytes: 8 registers, and a word that aligns them (Arm DDI 0403, B1.5.7); no floating point
GUARD = 32  # bytes at the stack's end that belong to nobody (processor.h)
HARD_FAULT, NMI, OTHERS = 3, 2, 4  # in the vector table

# Calls through a pointer: to the flash driver (firmware/store/flash.h), to what keeps the node number (link/node.h). An
# image without one has none to call.
FLASH = ("erase", "write", "read")
INDIRECT = {
    "read_unit": FLASH,
    "terrapin_store_work": FLASH,
    "terrapin_image_read": FLASH,
    "terrapin_image_verify": FLASH,
    "append": FLASH,
    "find": FLASH,
    "clear_slot": FLASH,
    "terrapin_update_accept": FLASH,
    "store_number": ("store_node",),
    "terrapin_identity_accept": ("store_node",),
    "start_image": (),  # leaves for another image, which begins its own stack
}
SETS_STACK = {"fault", "start_image"}  # to the stack's end, from where everything begins anew

HEADER = re.compile(r"([0-9a-f]+) <(.+)>:")
LINE = re.compile(r"\s*([0-9a-f]+):\t(\S+)(?:\t(.*))?")
TARGET = re.compile(r"(?:\w+, )?([0-9a-f]+) <([^>+]+)(?:\+0x([0-9a-f]+))?>")
BRANCH = re.compile(r"(b|bl|blx|b(eq|ne|cs|cc|mi|pl|vs|vc|hi|ls|ge|lt|gt|le)|cbn?z)(\.[nw])?")
PUSHED_WORD = re.compile(r"(push(\.w)?\t|stmdb(\.w)?\tsp!, )\{([^}]*)\}")
PUSHED_BYTES = re.compile(r"(?:str\S*\t.*\[sp, #-(\d+)\]!|subw?(?:\.w)?\tsp, (?:sp, )?#(\d+))")
STACK_SET = re.compile(r"((mov|sub|ldr)\S*\tsp,|add\S*\tsp, (sp, )?(?!sp\b)[a-z]|msr\tMSP|v?(push|stm)\S*\t.*\{d)")


class Refused(Exception):
    """No bound can be given, or it is too high."""


@dataclass
class Function:
    name: str
    pushed: int = 0  # bytes
    callees: set[int] = field(default_factory=set)  # addresses
    indirect: bool = False
    sets_stack: bool = False

    @property
    def source_name(self) -> str:
        """Without what the compiler appends to a copy's name."""
        return re.sub(r"(\.(isra|constprop|part|cold|lto_priv))*(\.\d+)*$", "", re.sub(r"\.\d+\b", "", self.name))


def functions(disassembly: Iterable[str]) -> dict[int, Function]:
    """Of `objdump -d --no-show-raw-insn`, by address."""
    found: dict[int, Function] = {}
    here, at, before = Function(""), 0, ""
    for line in disassembly:
        if header := HEADER.match(line):
            at = int(header[1], 16)
            here = found[at] = Function(header[2])
        elif instruction := LINE.match(line):
            text = f"{instruction[2]}\t{instruction[3] or ''}"
            read(here, at, text, before)
            before = text
    return found


def read(function: Function, start: int, text: str, before: str) -> None:
    """Adds what one instruction does."""
    name, operands = text.split("\t", 1)
    if BRANCH.fullmatch(name):
        target = TARGET.match(operands)
        if target is None:
            function.indirect = True
        elif (address := int(target[1], 16) - int(target[3] or "0", 16)) != start or name == "bl":
            function.callees.add(address)
    elif words := PUSHED_WORD.match(text):
        function.pushed += 4 * len(words[4].split(","))
    elif count := PUSHED_BYTES.match(text):
        function.pushed += int(count[1] or count[2])
    elif STACK_SET.match(text):
        function.sets_stack = True
    elif re.match(r"bx\t(?!lr)", text) or (re.match(r"(mov|add|ldr)\S*\tpc, ", text) and "[sp], #" not in text):
        # `add rN, pc` and `ldr pc, [rN, rM, lsl #2]` behind it is the table of a switch.
        table = re.match(r"ldr\.w\tpc, \[(\w+), \w+, lsl #2\]", text)
        function.indirect |= table is None or not before.startswith(f"add\t{table[1]}, pc, ")


LIBRARY = frozenset(("memcpy", "memset"))  # the boot loader has its own, other images the C library's


def compiler_figures(folder: Path) -> dict[str, set[tuple[int, str]]]:
    """Bytes and kind ("static", "dynamic") of each function, by its name in the source."""
    found: dict[str, set[tuple[int, str]]] = {}
    for path in folder.rglob("*.su"):
        for line in path.read_text().splitlines():
            where, count, kind = line.split("\t")
            found.setdefault(Function(where.rsplit(":", 1)[1]).source_name, set()).add((int(count), kind))
    return found


def confirm(reached: Iterable[Function], figures: dict[str, set[tuple[int, str]]]) -> None:
    """The compiler pushes no more than was read from the instructions. What it does not know is the C library's."""
    known = 0
    for function in reached:
        if function.source_name in LIBRARY or not (stated := figures.get(function.source_name)):
            continue
        known += 1
        if any(kind != "static" for _, kind in stated):
            raise Refused(f"{function.name}: a frame of variable size")
        if all(count > function.pushed for count, _ in stated):
            raise Refused(f"{function.name} pushes {function.pushed} bytes, but the compiler says {sorted(stated)}")
    if not known:
        raise Refused("the compiler's figures tell of no function of the image")


def callees(code: dict[int, Function], function: Function) -> set[int]:
    """All that it may call, through listed pointers too."""
    if not function.indirect:
        return function.callees
    if function.source_name not in INDIRECT:
        raise Refused(f"{function.name} calls through a pointer")
    listed = INDIRECT[function.source_name]
    return function.callees | {address for address, other in code.items() if other.source_name in listed}


def depths(code: dict[int, Function], roots: Iterable[int]) -> dict[int, tuple[int, list[str]]]:
    """Of each function that is reached from the roots: bytes and names of its deepest chain of calls. Refused when a
    chain has no bound."""
    done: dict[int, tuple[int, list[str]]] = {}

    def follow(address: int, path: tuple[int, ...]) -> tuple[int, list[str]]:
        if address in path:
            cycle = [code[a].name for a in (*path[path.index(address) :], address)]
            raise Refused(f"recursion: {' > '.join(cycle)}")
        if address in done:
            return done[address]
        if address not in code:
            raise Refused(f"a call to 0x{address:x}, where no function is")
        function = code[address]
        if function.sets_stack and function.source_name not in SETS_STACK:
            raise Refused(f"{function.name} sets the stack pointer")
        below = [follow(a, (*path, address)) for a in sorted(callees(code, function))]
        deepest = max(below, default=(0, []))
        done[address] = (function.pushed + deepest[0], [function.name, *deepest[1]])
        return done[address]

    for root in roots:
        follow(root, ())
    return done


@dataclass(frozen=True)
class Bound:
    main: int  # bytes
    exceptions: int
    chain: list[str]

    @property
    def total(self) -> int:
        return self.main + self.exceptions


def bound(code: dict[int, Function], vectors: list[int], figures: dict[str, set[tuple[int, str]]]) -> Bound:
    """Of an image with this vector table, its first word (the stack's end) included."""
    handlers = [address & ~1 for address in vectors]
    deep = depths(code, [a for a in handlers[1:] if a])
    confirm([code[a] for a in deep], figures)
    levels = ([handlers[NMI]], [handlers[HARD_FAULT]], [a for a in handlers[OTHERS:] if a])
    exceptions = sum(EXCEPTION + max(deep[a][0] for a in level) for level in levels if level)
    return Bound(deep[handlers[1]][0], exceptions, deep[handlers[1]][1])


def run(*command: str) -> list[str]:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()


def measure(image: str, nm: str, objdump: str, su: str) -> tuple[Bound, int]:
    """The bound of an image, and the bytes that are set aside for its stack."""
    symbols = {row[-1]: row for row in (line.split() for line in run(nm, "-S", image))}
    place = {name: int(row[0], 16) for name, row in symbols.items() if len(row) > 2}
    begin, size = place["vectors"], int(symbols["vectors"][1], 16)
    dump = run(objdump, "-s", "-j", ".text", f"--start-address={begin}", f"--stop-address={begin + size}", image)
    words = [word for line in dump if re.match(r" [0-9a-f]+ ", line) for word in line[:45].split()[1:5]]
    vectors = [int.from_bytes(bytes.fromhex(word), "little") for word in words]
    if len(vectors) * 4 != size or vectors[0] != place["image_stack_end"]:
        raise Refused("no vector table")
    code = functions(run(objdump, "-d", "--no-show-raw-insn", image))
    return bound(code, vectors, compiler_figures(Path(su))), place["image_stack_end"] - place["image_stack"]


def main() -> int:
    parser = argparse.ArgumentParser(description="Bound of the stack of images.")
    parser.add_argument("--nm", required=True)
    parser.add_argument("--objdump", required=True)
    parser.add_argument("--su", required=True, help="folder with the compiler's .su files")
    parser.add_argument("image", nargs="+")
    options = parser.parse_args()
    good = True
    for image in options.image:
        name = Path(image).name
        try:
            found, aside = measure(image, options.nm, options.objdump, options.su)
        except Refused as why:
            print(f"{name:36} stack without bound: {why}")
            good = False
            continue
        good = good and found.total + GUARD <= aside
        print(
            f"{name:36} stack {found.total:5d} bytes at most ({found.main} + {found.exceptions} of exceptions;"
            f" {aside} set aside, {GUARD} of them guard)"
        )
        print(f"{'':38}{' > '.join(found.chain)}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
