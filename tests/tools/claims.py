"""Claims about how often discovery is right, and whether the program is still the one that they were counted on.

    make claims                                    the table of docs/rates.md: fresh, or counted on another program
    python tests/tools/claims.py --write           puts it there
    python tests/tools/claims.py --counted NAME "18 of 20 (68 to 99 %)"     a new count, on the program as it stands

A claim (tests/claims.toml) is a sentence with its bound, the command that counts it, what was counted, and a digest of
the rooms that decide: of their syntax trees without docstrings and sentences, so a mended comment changes nothing and a
moved threshold does.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import re
import sys
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Claim", "claims", "digest", "of_source", "table"]

ROOT = Path(__file__).resolve().parents[2]
FILE, PAGE = ROOT / "tests" / "claims.toml", ROOT / "docs" / "rates.md"
BEGIN, END = "<!-- claims (make claims) -->", "<!-- end of claims -->"
WORKBENCH = "host_tools/terrapin_tools/workbench"
DECIDE = tuple(f"{WORKBENCH}/{room}/**/*.py" for room in ("bases", "compare", "discover", "formulas", "model", "noise"))
ROOMS: Mapping[str, tuple[str, ...]] = {
    "decision": (*DECIDE, "hil/terrapin_hil/physics/**/*.py", "hil/terrapin_hil/physics/**/*.c"),
    "proposal": (*DECIDE, f"{WORKBENCH}/experiment/**/*.py", "hil/terrapin_hil/physics/**/*.py"),
}


class _Bare(ast.NodeTransformer):
    """Without docstrings and sentences: texts with a space, and what stands between the values of an f-string."""

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        return ast.Constant("") if isinstance(node.value, str) and " " in node.value else node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        values = [self.visit(value) for value in node.values if not isinstance(value, ast.Constant)]
        return ast.JoinedStr(values)

    def _body(self, node: ast.Module | ast.ClassDef | ast.FunctionDef) -> ast.AST:
        if ast.get_docstring(node, clean=False) is not None:
            node.body = node.body[1:]
        return self.generic_visit(node)

    visit_Module = visit_ClassDef = visit_FunctionDef = _body


def of_source(text: str) -> str:
    """Of a Python source: what it does, without what it says."""
    return ast.dump(_Bare().visit(ast.parse(text)), annotate_fields=False)


def digest(room: str, root: Path = ROOT) -> str:
    """Eight digits that change with what a room's files do."""
    found = hashlib.sha256()
    for path in sorted({path for pattern in ROOMS[room] for path in root.glob(pattern)}):
        found.update(path.relative_to(root).as_posix().encode())
        found.update(of_source(path.read_text()).encode() if path.suffix == ".py" else path.read_bytes())
    return found.hexdigest()[:8]


@dataclass(frozen=True)
class Claim:
    """`counted` on the program of that digest of its room."""

    name: str
    says: str
    bound: str
    command: str
    counted: str
    room: str
    digest: str


def claims(text: str) -> list[Claim]:
    """Those of a file. ValueError names a claim that lacks something or names no room."""
    found = []
    for name, entry in tomllib.loads(text).items():
        try:
            one = Claim(name, **entry)
        except TypeError as error:
            raise ValueError(f"{name}: {error}") from None
        if one.room not in ROOMS:
            raise ValueError(f"{name}: room is {one.room!r}, expected one of {', '.join(ROOMS)}")
        found.append(one)
    return found


def table(listed: Iterable[Claim], now: Mapping[str, str]) -> str:
    """A table in Markdown; `now`: the digest of each room."""
    lines = ["| claim | bound | command | counted | of this program |", "|---|---|---|---|---|"]
    for one in listed:
        fresh = "yes" if one.digest == now[one.room] else "**no, of another**"
        lines.append(f"| {one.says} | {one.bound} | `{one.command}` | {one.counted} | {fresh} |")
    return "\n".join(lines)


def page(text: str, made: str) -> str:
    """docs/rates.md with the table between its marks."""
    before, _, rest = text.partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise ValueError(f"{PAGE.name}: expected the marks {BEGIN} and {END}")
    return f"{before}{BEGIN}\n{made}\n{END}{after}"


def counted(text: str, name: str, figure: str, now: Mapping[str, str]) -> str:
    """The file with a new count of a claim. KeyError: there is no such claim."""
    one = {claim.name: claim for claim in claims(text)}[name]
    begin = text.index(f"[{name}]")
    end = text.find("\n[", begin) % (len(text) + 1)
    part = re.sub(r'(?m)^counted = ".*"$', lambda _: f'counted = "{figure}"', text[begin:end])
    part = re.sub(r'(?m)^digest = ".*"$', f'digest = "{now[one.room]}"', part)
    return text[:begin] + part + text[end:]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", action="store_true", help="put the table into docs/rates.md")
    parser.add_argument(
        "--counted", nargs=2, metavar=("NAME", "FIGURE"), help="a new count, on the program as it stands"
    )
    options = parser.parse_args()
    now, text = {room: digest(room) for room in ROOMS}, FILE.read_text()
    if options.counted:
        if options.counted[0] not in {one.name for one in claims(text)}:
            print(f"{FILE.name}: no claim {options.counted[0]}", file=sys.stderr)
            return 2
        FILE.write_text(text := counted(text, options.counted[0], options.counted[1], now))
    listed = claims(text)
    if options.write or options.counted:
        PAGE.write_text(page(PAGE.read_text(), table(listed, now)))
    for one in listed:
        print(f"{'fresh' if one.digest == now[one.room] else 'STALE'}  {one.says}: {one.counted} ({one.bound})")
    stale = sum(one.digest != now[one.room] for one in listed)
    print(f"{len(listed) - stale} of {len(listed)} claims were counted on this program")
    return 0


if __name__ == "__main__":
    sys.exit(main())
