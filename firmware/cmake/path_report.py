"""How many instructions a step can take at most, from the instructions of an image.

    path_report.py --objdump OBJDUMP IMAGE FUNCTION...

The longest path through the control flow of each function, with everything that it calls. A loop takes its bound,
listed below, times the longest path through its body; what chooses between cases takes the longest case, whether or not
two choices can meet. So no run can take more, and none takes as much.

Refused, with status 1: a loop without a bound or with two entries, a bound of no loop, recursion, a call through a
pointer, a jump that is not understood. Standard library only.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

# How often a loop is entered or gone round at most, its last look at the condition counted: of each function its loops
# in the order of their first instruction. Assertions in the source hold the same numbers, or the loop counts to them.
LOOPS = {
    "sense_update": (8,),  # SENSED_FAULTS
    "quotient": (3, 3),  # each of its two digits: twice
    "integer_divide": (12,),  # denominators below 2^40: ground.c, calibration.c
    "calibration_work": (9, 9),  # TERRAPIN_LIMIT_CALIBRATE_SPEEDS
    "ground_nearest": (6,),  # TERRAINS
}

HEADER = re.compile(r"([0-9a-f]+) <(.+)>:")
LINE = re.compile(r"\s*([0-9a-f]+):\t(\S+)(?:\t(.*))?")
CONDITIONS = "eq|ne|cs|cc|mi|pl|vs|vc|hi|ls|ge|lt|gt|le"
JUMP = re.compile(rf"b({CONDITIONS})?(\.[nw])?|cbn?z")
TARGET = re.compile(r"(?:\w+, )?([0-9a-f]+) <")
RETURN = re.compile(
    rf"(bx({CONDITIONS})?\tlr|(pop|ldmia|ldm)({CONDITIONS})?(\.w)?\t.*pc|ldr({CONDITIONS})?(\.w)?\tpc, \[sp\], #)"
)
CONDITIONAL = re.compile(rf"(bx|pop|ldmia|ldr)({CONDITIONS})(\.w)?\t")


class Refused(Exception):
    """No bound can be given."""


@dataclass
class Node:
    """One instruction: what it costs, calls, and where it goes on."""

    callee: int | None = None
    follow: list[int] = field(default_factory=list)  # addresses within the function
    leaves: list[int | None] = field(default_factory=list)  # returns (None) or jumps to another function


@dataclass
class Function:
    name: str
    start: int
    nodes: dict[int, Node] = field(default_factory=dict)
    refused: str = ""  # why no bound can be given, should it be reached

    @property
    def source_name(self) -> str:
        """Without what the compiler appends to a copy's name."""
        return re.sub(r"\.(isra|constprop|part|cold)\b.*$", "", self.name)


def functions(disassembly: Iterable[str]) -> dict[int, Function]:
    """Of `objdump -d --no-show-raw-insn -z`, by address."""
    texts: dict[int, tuple[str, list[tuple[int, str]]]] = {}
    here: list[tuple[int, str]] = []
    for line in disassembly:
        if header := HEADER.match(line):
            here = []
            texts[int(header[1], 16)] = (header[2], here)
        elif instruction := LINE.match(line):
            words = (instruction[3] or "").split("@")[0].split(";")[0].strip()
            here.append((int(instruction[1], 16), f"{instruction[2]}\t{words}"))
    return {start: _function(name, start, rows) for start, (name, rows) in texts.items()}


def _function(name: str, start: int, rows: list[tuple[int, str]]) -> Function:
    function = Function(name, start)
    try:
        _read(function, rows)
    except Refused as why:
        function.refused = str(why)
    return function


def _read(function: Function, rows: list[tuple[int, str]]) -> None:
    name, start = function.name, function.start
    code = [(at, text) for at, text in rows if not text.startswith(".")]
    data = {at: text for at, text in rows if text.startswith(".")}
    last = rows[-1][0] if rows else start
    for i, (at, text) in enumerate(code):
        node = function.nodes[at] = Node()
        following = code[i + 1][0] if i + 1 < len(code) else None
        mnemonic, operands = text.split("\t", 1)
        if mnemonic in ("bl", "blx") or re.fullmatch(rf"bl({CONDITIONS})?", mnemonic):
            target = TARGET.match(operands)
            node.callee = int(target[1], 16) if target else -1
        elif JUMP.fullmatch(mnemonic):
            target = TARGET.match(operands)
            if target is None:
                raise Refused(f"{name}: a jump that is not understood: {text}")
            to = int(target[1], 16)
            (node.follow if start <= to <= last else node.leaves).append(to)  # type: ignore[arg-type]
            if re.fullmatch(r"b(\.[nw])?", mnemonic):
                continue
        elif mnemonic in ("tbb", "tbh"):
            node.follow = _table(name, at, mnemonic, operands, code[:i], data)
            continue
        elif RETURN.match(text):
            node.leaves.append(None)
            if not CONDITIONAL.match(text):
                continue
        elif re.match(r"(mov|add|ldr|bx)\S*\tpc|bx\t", text):
            raise Refused(f"{name}: a jump that is not understood: {text}")
        if following is not None:
            node.follow.append(following)


def _table(
    name: str, at: int, mnemonic: str, operands: str, before: list[tuple[int, str]], data: Mapping[int, str]
) -> list[int]:
    """Targets of a jump by a table, whose length the comparison before it has."""
    register = re.match(r"\[pc, (\w+)", operands)
    assert register
    compare = next(
        (m for _, text in reversed(before[-8:]) if (m := re.match(rf"cmp(?:\.w)?\t{register[1]}, #(\d+)", text))), None
    )
    if compare is None:
        raise Refused(f"{name}: a table of unknown length")
    size, count = (1, int(compare[1]) + 1) if mnemonic == "tbb" else (2, int(compare[1]) + 1)
    raw = bytearray()
    place = at + 4
    while len(raw) < size * count:
        if place not in data:
            raise Refused(f"{name}: a table without its numbers")
        kind, number = data[place].split("\t")
        width = {".byte": 1, ".short": 2, ".word": 4}[kind]
        raw += int(number.split()[0], 0).to_bytes(width, "little")
        place += width
    entries = [int.from_bytes(raw[size * i : size * (i + 1)], "little") for i in range(count)]
    return [at + 4 + 2 * entry for entry in entries]


def _components(nodes: set[int], follow: Mapping[int, list[int]]) -> list[list[int]]:
    """Strongly connected ones, each after all that it leads to (Tarjan)."""
    index: dict[int, int] = {}
    low: dict[int, int] = {}
    stack: list[int] = []
    done: list[list[int]] = []
    for root in sorted(nodes):
        work = [(root, iter(follow[root]))] if root not in index else []
        if work:
            index[root] = low[root] = len(index)
            stack.append(root)
        while work:
            at, rest = work[-1]
            for to in rest:
                if to not in nodes:
                    continue
                if to not in index:
                    index[to] = low[to] = len(index)
                    stack.append(to)
                    work.append((to, iter(follow[to])))
                    break
                if to in stack:
                    low[at] = min(low[at], index[to])
            else:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[at])
                if low[at] == index[at]:
                    place = stack.index(at)
                    done.append(stack[place:])
                    del stack[place:]
    return done


class Bounds:
    """Longest paths of the functions of an image."""

    def __init__(self, code: Mapping[int, Function], loops: Mapping[str, tuple[int, ...]]) -> None:
        self.code, self.loops = code, loops
        self.done: dict[int, int] = {}
        self.used: set[str] = set()
        self.open: list[int] = []

    def of(self, start: int) -> int:
        """Instructions of the function at an address, with all that it calls."""
        if start in self.done:
            return self.done[start]
        if start not in self.code:
            raise Refused(f"a call to 0x{start & 0xFFFFFFFF:x}, where no function is")
        function = self.code[start]
        if function.refused:
            raise Refused(function.refused)
        if start in self.open:
            raise Refused(f"recursion: {function.name}")
        self.open.append(start)
        follow = {at: node.follow for at, node in function.nodes.items()}
        cost = {at: 1 + self._calls(node) for at, node in function.nodes.items()}
        reached, todo = set[int](), [start]
        while todo:
            at = todo.pop()
            if at not in reached:
                reached.add(at)
                todo += follow[at]
        heads = self._heads(function, reached, follow)
        given = self.loops.get(function.source_name, ())
        if len(given) != len(heads):
            raise Refused(f"{function.name}: {len(heads)} loops, but bounds of {len(given)}")
        self.used.add(function.source_name)
        self.done[start] = self._longest(start, reached, follow, cost, dict(zip(sorted(heads), given, strict=True)))
        self.open.pop()
        return self.done[start]

    def _calls(self, node: Node) -> int:
        after = [self.of(to) for to in node.leaves if to is not None]
        return (self.of(node.callee) if node.callee is not None else 0) + max(after, default=0)

    def _heads(self, function: Function, nodes: set[int], follow: Mapping[int, list[int]]) -> set[int]:
        """Entries of all loops, those inside of others too."""
        found: set[int] = set()
        for component in _components(nodes, follow):
            inside = set(component)
            if len(inside) == 1 and component[0] not in follow[component[0]]:
                continue
            head = self._entry(function, inside, nodes, follow)
            found.add(head)
            without = {at: [to for to in follow[at] if to != head] for at in inside}
            found |= self._heads(function, inside, without)
        return found

    def _entry(self, function: Function, inside: set[int], nodes: set[int], follow: Mapping[int, list[int]]) -> int:
        entries = {to for at in nodes - inside for to in follow[at] if to in inside}
        if function.start in inside:
            entries.add(function.start)
        if (
            not entries
        ):  # of an inner loop, whose surroundings are one component: its lowest address that is jumped back to
            entries = {min(inside)}
        if len(entries) != 1:
            raise Refused(f"{function.name}: a loop with {len(entries)} entries")
        return entries.pop()

    def _longest(
        self,
        start: int,
        nodes: set[int],
        follow: Mapping[int, list[int]],
        cost: Mapping[int, int],
        bounds: Mapping[int, int],
    ) -> int:
        """The longest path from `start` through nodes, loops taken as often as their bounds say."""
        owner: dict[int, int] = {}
        weight: dict[int, int] = {}
        order = _components(nodes, follow)
        for number, component in enumerate(order):
            inside = set(component)
            for at in component:
                owner[at] = number
            if len(inside) == 1 and component[0] not in follow[component[0]]:
                weight[number] = cost[component[0]]
            else:
                head = next(
                    at for at in sorted(inside) if at in bounds and self._is_entry(at, inside, nodes, follow, start)
                )
                without = {at: [to for to in follow[at] if to != head] for at in inside}
                weight[number] = bounds[head] * self._longest(head, inside, without, cost, bounds)
        best: dict[int, int] = {}
        for number, component in enumerate(order):  # each after all that it leads to
            after = [best[owner[to]] for at in component for to in follow[at] if to in owner and owner[to] != number]
            best[number] = weight[number] + max(after, default=0)
        return best[owner[start]]

    def _is_entry(
        self, at: int, inside: set[int], nodes: set[int], follow: Mapping[int, list[int]], start: int
    ) -> bool:
        outside = any(at in follow[other] for other in nodes - inside)
        return outside or at == start or not any(to in inside for o in nodes - inside for to in follow[o])


def measure(disassembly: Iterable[str], names: Iterable[str], loops: Mapping[str, tuple[int, ...]]) -> dict[str, int]:
    """Bounds of the named functions."""
    code = functions(disassembly)
    starts = {function.name: start for start, function in code.items()}
    bounds = Bounds(code, loops)
    found = {name: bounds.of(starts[name]) for name in names}
    if unused := set(loops) - bounds.used:
        raise Refused(f"bounds of loops in functions that are not reached: {', '.join(sorted(unused))}")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(
        description="Bound of the instructions of functions, with all that they call.",
        epilog="Example: path_report.py --objdump arm-none-eabi-objdump image.elf terrapin_step_drive",
    )
    parser.add_argument("--objdump", required=True)
    parser.add_argument("image")
    parser.add_argument("function", nargs="+")
    options = parser.parse_args()
    dump = subprocess.run(
        [options.objdump, "-d", "-z", "--no-show-raw-insn", options.image], check=True, capture_output=True, text=True
    )
    try:
        found = measure(dump.stdout.splitlines(), options.function, LOOPS)
    except Refused as why:
        print(f"{Path(options.image).name}: instructions without bound: {why}")
        return 1
    for name, count in found.items():
        print(f"{Path(options.image).name:36} {name:24} {count:6d} instructions at most")
    return 0


if __name__ == "__main__":
    sys.exit(main())
