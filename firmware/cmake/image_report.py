"""What the images for the chip take of its flash and RAM.

    image_report.py [--text BYTES] [--ram BYTES] --size SIZE IMAGE...

Prints for each image its text (code, constants, initial values) and its RAM (data, bss, the stack that is set aside);
status 1 when one takes more than the limits. Standard library only.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

TEXT = (".text", ".ARM.exidx", ".data")
RAM = (".stack", ".data", ".bss")


def sections(size: str, image: str) -> dict[str, int]:
    """Bytes of each section."""
    done = subprocess.run([size, "-A", image], check=True, capture_output=True, text=True)
    return {name: int(count) for name, count in re.findall(r"^(\.\S+) +(\d+)", done.stdout, re.MULTILINE)}


def main() -> int:
    parser = argparse.ArgumentParser(description="Flash and RAM that images take.")
    parser.add_argument("--text", type=int, default=40_000)
    parser.add_argument("--ram", type=int, default=16_384)
    parser.add_argument("--size", required=True)
    parser.add_argument("image", nargs="+")
    options = parser.parse_args()
    good = True
    for image in options.image:
        found = sections(options.size, image)
        text, ram = (sum(found.get(name, 0) for name in names) for names in (TEXT, RAM))
        good = good and 0 < text <= options.text and 0 < ram <= options.ram
        print(f"{Path(image).name:36} text {text:6d} bytes (limit {options.text}), RAM {ram:6d} (limit {options.ram})")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
