"""Formulas, units, and scripts in names and titles: no code runs, no page has them as they are, no terminal obeys."""

from __future__ import annotations

import random
import shutil
import tempfile
from pathlib import Path

from tests.attack import Result
from tests.attack.forked import run

COUNT, SHORT = 300, 20
ROOT = Path(__file__).resolve().parents[2]
MARK = "owned"
FORMULAS = (
    f"__import__('os').system('touch {MARK}')",
    f"open('{MARK}', 'w')",
    "().__class__.__base__.__subclasses__()",
    f"exec(\"open('{MARK}', 'w')\")",
    "slip.__class__",
    "slip.tofile('owned')",
    "9**9**9**9",
    "(" * 3000 + "1" + ")" * 3000,
    "-" * 5000 + "1",
    "1 if slip else 2",
    "lambda: 1",
    "[slip for slip in (1, 2)]",
    "max(slip, key=print)",
    "f'{slip}'",
    "slip; slip",
    "print(slip)",
    "eval('1')",
    "globals()",
    "max(*[1] * 10**9)",
    "'a' * 10**10",
    "1e999 * 1e999",
    "x" * 70000,
)
UNITS = (
    "m!",
    "10**9**9",
    "m" * 5000,
    "(" * 2000 + "m" + ")" * 2000,
    f"__import__('os').system('touch {MARK}')",
    "m**99999999999",
    "m.__class__",
    "kilo" * 200 + "m",
    "%s%n",
    "\x1b]0;owned\x07",
    "m/0",
    "s**-1e308",
    "open('owned','w')",
    "lambda: m",
)
SCRIPTS = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "</title><script>1</script>",
    "\x1b[2J\x1b]0;owned\x07",
    "javascript:alert(1)",
    "<svg/onload=alert(1)>",
    "{{ 7*7 }}",
    "{% raw %}",
    "\u202eevil",
    "</script><script>1</script>",
)
RAW = ("<script>alert", "<img src=x", "<svg/onload", "</title><script>1", "</script><script>1")


def _toml(text: str) -> str:
    return '"' + "".join(c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in text) + '"'


def _scenario(path: Path, check: str, duration: str) -> None:
    path.write_text(
        f'duration = {_toml(duration)}\nseed = 1\nchecks = [{_toml(check)}]\n[sensors]\nkit = "ideal"\n[[path]]\n'
        'terrain = "sand"\n[[operator]]\nat = "0 s"\nrequest = "run"\nsetpoint = "8 V"\n',
        encoding="utf-8",
    )


def _mixed(draw: random.Random, words: tuple[str, ...]) -> str:
    """One as it is, or within, behind or before another."""
    one = draw.choice(words)
    return draw.choice(
        [one, one, f"{one} < 2", f"max(abs({one})) < 2", one + draw.choice(words), f"max(abs(slip)) < {one}"]
    )


def _title(folder: Path, words: str) -> str:
    """What is wrong when a case has that title and those names of runs; "" when nothing is."""
    case = folder / "case"
    shutil.copytree(ROOT / "cases" / "heated_motor", case)
    text = (case / "case.toml").read_text(encoding="utf-8")
    head, _, rest = text.partition("title = ")
    (case / "case.toml").write_text(f"{head}title = {_toml(words)}\n{rest.partition(chr(10))[2]}", encoding="utf-8")
    done = run(["report", "case", "--output", "page.html"], folder)
    if "\x1b" in done.out + done.err:
        return "an escape on the terminal"
    page = folder / "page.html"
    if page.is_file() and any(raw in page.read_text(encoding="utf-8") for raw in RAW):
        return f"{words!r} as it is in the page"
    return done.wrong(seconds=60.0)


def attack(count: int, seed: int) -> Result:
    """`count` words: a tenth of them titles, the others formulas and units."""
    taken, first = 0, ""
    with tempfile.TemporaryDirectory() as name:
        for number in range(count):
            draw, folder = random.Random(f"{seed} {number}"), Path(name, str(number))
            folder.mkdir()
            if number % 10 == 9:
                wrong = _title(folder, draw.choice(SCRIPTS))
            else:
                check, duration = (
                    (_mixed(draw, FORMULAS), "0.1 s") if number % 3 else ("max(slip) < 2", f"0.1 {draw.choice(UNITS)}")
                )
                _scenario(folder / "x.toml", check, duration)
                done = run(["run", "x.toml", "--out", "made"], folder)
                wrong = "an escape on the terminal" if "\x1b" in done.out + done.err else done.wrong()
                if done.status == 1 and done.err == "":
                    wrong = ""  # a check that did not hold
                if not wrong and done.status == 0 and number % 2 == 0:
                    wrong = f"unit of {duration!r} taken"
            if any(folder.rglob(MARK)):
                wrong = "code ran"
            if wrong:
                taken += 1
                first = first or f"first: number {number} (seed {seed}): {wrong}"
            shutil.rmtree(folder)
    return Result("formulas, units and scripts in names", count, taken, first)
