"""docs/python_reference.md from the docstrings of the public names of terrapin_tools.

python_reference.py            status 1 when the page is not as it would be made now
python_reference.py --renew    write the page
"""

from __future__ import annotations

import argparse
import inspect
import sys

from steps import ROOT

PAGE = ROOT / "docs" / "python_reference.md"
HEAD = """# Reference of `import terrapin_tools`

Made by `tests/tools/python_reference.py --renew` from the docstrings, whose examples run in the tests. What is not here
may change. [Python](python.md) has the guide.
"""


def _text(doc: str) -> list[str]:
    """A docstring; what has indent or is an example, as a block of output."""
    lines: list[str] = []
    block: list[str] = []
    for line in [*inspect.cleandoc(doc).splitlines(), "."]:
        special = line.startswith((" ", ">>>", "...", "---")) or (block and line.strip() and line != ".")
        if special and not line.startswith("---"):
            if not block and lines and lines[-1] and not line.startswith(">>>"):
                block.append(lines.pop())
            block.append(line)
            continue
        if line.startswith("---"):
            block.append(lines.pop())
            continue
        if block:
            lines += ["", "<!-- shows: output -->", "```text", *block, "```"]
            block = []
        lines.append(line)
    return lines[:-1]


def page() -> str:
    import terrapin_tools

    lines = [HEAD.rstrip()]
    for name in terrapin_tools.__all__:
        found = getattr(terrapin_tools, name)
        if inspect.ismodule(found):
            lines += ["", f"## {name}", "", *_text(found.InputError.__doc__ or "")]
            continue
        signature = str(inspect.signature(found)).partition(" -> ")[0].replace("'", "")
        call = "" if name in ("Answer", "Case") else signature
        lines += ["", f"## {name}", "", f"`{name}{call}`", "", *_text(found.__doc__ or "")]
        members = {key: m for kind in reversed(found.__mro__) for key, m in vars(kind).items()
                   if kind.__module__.startswith("terrapin_")}  # fmt: skip
        for key, member in members.items():
            if key.startswith("_") or not (callable(member) or isinstance(member, property | classmethod)):
                continue
            bound = getattr(found, key)
            doc = inspect.getdoc(bound) or ""
            call = key if isinstance(member, property) else f"{key}{inspect.signature(bound)}".replace("'", "")
            lines += [
                "",
                f"### {name}.{key}",
                "",
                f"`{call.replace('(self, ', '(').replace('(self)', '()')}`",
                "",
                *_text(doc),
            ]
    text = "\n".join(lines) + "\n"
    while "\n\n\n" in text:
        text = text.replace("\n\n\n", "\n\n")
    return text


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--renew", action="store_true", help="write the page")
    if parser.parse_args().renew:
        PAGE.write_text(page(), encoding="utf-8")
        return 0
    if not PAGE.is_file() or PAGE.read_text(encoding="utf-8") != page():
        print("docs/python_reference.md: not as it would be made now: tests/tools/python_reference.py --renew")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
