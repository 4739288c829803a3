"""What may not stand in the repository: addresses of package indexes, paths of one machine, generated or large files,
unfinished business, untidy text.

    hygiene.py [ROOT]   prints one line a finding, exit status 1 when there is one
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

LARGEST = 1_000_000  # bytes of one file
TOP = {
    "firmware", "hil", "host_tools", "tests", "docs", "cases", "zephyr",
    "CMakeLists.txt", "CMakePresets.json", "Makefile", "pyproject.toml", "requirements.lock", "requirements-dev.lock",
    "README.md", "CONTRIBUTING.md", "LICENSE", ".ci", ".gitignore", ".clang-format", ".clang-tidy",
}  # fmt: skip
GENERATED = re.compile(
    r"\.(o|a|so|pyc|elf|gcda|gcno|whl|egg-info)$|(^|/)(terrapin_interface\.[ch]|terrapin\.dbc|interface\.(json|md))$"
)
BINARY = {".png", ".parquet", ".blf", ".mf4", ".mcap", ".gz", ".bin"}
TEXT_RULES = {
    "address of a package index": re.compile(
        r"pypi[.]org|pythonhosted[.]org|crates[.]io|registry[.]npmjs|proxy[.]golang|repo1?[.]maven|(deb|ftp|archive|ports)"
        r"[.](debian|ubuntu)[.](org|com)|(^|\s)--(extra-)?index-url"
    ),
    "path of one machine": re.compile(r"(?<![\w.}/])/(work|root|home)/\w"),
    "unfinished business": re.compile(r"\b(TODO|FIXME|XXX|HACK)\b"),
    "conflict marker": re.compile(r"^(<{7}|>{7}) "),
    "white space at the end of the line": re.compile(r"[ \t\r]$(?<!^ )"),  # a patch's empty line is one space
}
THIS = Path("tests", "tools", "hygiene.py")  # it must spell what it looks for


def tracked(root: Path) -> list[Path]:
    """Files that git tracks or would track, relative to `root`, sorted."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=root, check=True, stdout=subprocess.PIPE, text=True).stdout.split("\0")
    return sorted({Path(name) for name in names if name and (root / name).is_file()})


def text_problems(path: Path, content: bytes) -> list[str]:
    try:
        text = content.decode()
    except UnicodeDecodeError:
        return [f"{path}: neither UTF-8 text nor a known kind of binary file"]
    problems = []
    if text and not text.endswith("\n"):
        problems.append(f"{path}: no newline at the end of the file")
    if text.endswith("\n\n"):
        problems.append(f"{path}: empty lines at the end of the file")
    for number, line in enumerate(text.split("\n"), 1):
        for name, pattern in TEXT_RULES.items():
            if pattern.search(line) and path != THIS:
                problems.append(f"{path}:{number}: {name}: {line.strip()[:80]}")
    return problems


def find_problems(root: Path) -> list[str]:
    problems = []
    for path in tracked(root):
        content = (root / path).read_bytes()
        if path.parts[0] not in TOP:
            problems.append(f"{path}: the top level holds no such thing")
        if GENERATED.search(path.as_posix()):
            problems.append(f"{path}: generated file")
        if len(content) > LARGEST:
            problems.append(f"{path}: {len(content)} bytes, at most {LARGEST}")
        if path.suffix not in BINARY and "corpus" not in path.parts:
            problems += text_problems(path, content)
    return problems


def main() -> int:
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[2]
    problems = find_problems(root)
    print("\n".join([*problems, f"{len(tracked(root))} files, {len(problems)} findings"]))
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
