"""Size and symbols of the linked core for the chip.

    size_report.py [--check] --nm NM --size SIZE IMAGE

Prints the text (code and constants) in bytes and its largest parts. With --check, status 1 when the text is not below
the limit, when a symbol of heap, floating point or assertions was linked in, or when the core is not there. Standard
library only.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys

TEXT_LIMIT = 16_384  # bytes, with helpers of the compiler and memcpy; the sphere's is 140 longer than the cylinder's
# Run-time helpers of the ARM EABI for float and double, and their kin in libgcc; what allocates; what assertions call.
FORBIDDEN = re.compile(
    r"__aeabi_(c?[fd]|(ui|i|ul|l|h)2[fd]|[fd]2|h2f)\w*|__(add|sub|mul|div|neg|fix|float|extend|trunc)\w*[sdh]f\w*"
    r"|malloc|calloc|realloc|free|_sbrk|alloca|__assert\w*|abort"
)

CODEC = r"terrapin_(encode_|decode_|e2e_|crc8).*|layout_.*|encode|decode|fit|frame_crc"
TABLE = r"terrapin_parameter|(number|place)\.\d+"
HELPERS = r"__.*|mem(set|cpy|move|cmp)"


def run(*command: str) -> list[str]:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()


def main() -> int:
    parser = argparse.ArgumentParser(description="Size and symbols of the linked core.")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--nm", required=True)
    parser.add_argument("--size", required=True)
    parser.add_argument("image")
    options = parser.parse_args()

    text = int(run(options.size, options.image)[1].split()[0])
    symbols = [line.split() for line in run(options.nm, "-S", "--size-sort", "-r", options.image)]
    names = [line.split()[-1] for line in run(options.nm, options.image)]

    # By symbols: the linker's padding of empty sections is no variable.
    data, bss = (sum(int(s[1], 16) for s in symbols if s[2] in kinds) for kinds in ("dD", "bBcC"))

    def part(pattern: str) -> int:
        return sum(int(s[1], 16) for s in symbols if re.fullmatch(pattern, s[3]))

    print(f"core on Cortex-M4 -Os: text {text} bytes (limit {TEXT_LIMIT}), data {data}, bss {bss}; of it")
    print(f"  {part(CODEC):6d} codec, {part(TABLE)} parameter table, {part(HELPERS)} helpers of compiler and C library")
    for symbol in symbols[:10]:
        print(f"  {int(symbol[1], 16):6d} {symbol[3]}")
    bad = sorted({name for name in names if FORBIDDEN.fullmatch(name)})
    if bad:
        print(f"forbidden symbols: {' '.join(bad)}")
    empty = "terrapin_step_drive" not in names  # nothing linked is nothing measured
    if empty:
        print("no terrapin_step_drive in the image: expected the whole core")
    if text >= TEXT_LIMIT:
        print(f"the core is too large: {text} bytes of text, expected less than {TEXT_LIMIT}")
    if data or bss:
        print(f"the core has variables: {data} and {bss} bytes of data and bss, expected none")
    return 1 if options.check and (text >= TEXT_LIMIT or data or bss or bad or empty) else 0


if __name__ == "__main__":
    sys.exit(main())
