"""Two at one case at the same moment, of a shell and of the page: what each says it did is in it, or it was refused."""

from __future__ import annotations

import random
import shutil
import tempfile
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.attack import Result
from tests.attack.forked import Outcome, learn, run, together
from tests.python import table_files
from tests.web.serving import Server

COUNT, SHORT = 100, 2  # of each pair
SECONDS = 5.0  # that one may begin before the other, at most
MADE = ("case", "map", "x.csv", "--to", "made", "--base", "equation", "--column", "f=torque [mN m]", "--unit", "f=N m",
        "--column", "w=speed [rpm]", "--unit", "w=rpm", "--equation", "f=k*w", "--fit", "k=1",
        "--train", "x")  # fmt: skip
EFFECTS = {"square": ("a*w**2", "N m/rpm^2"), "offset": ("a", "N m")}
CASE = Path("ws", "cases", "made")


@dataclass(frozen=True)
class Said:
    """What one of the two said: nothing when it did it, else why not."""

    refused: str = ""
    wrong: str = ""  # of how it was said


def _words(effect: str) -> list[object]:
    expression, unit = EFFECTS[effect]
    return ["add", CASE, effect, "--expression", expression, "--parameter", f"a=0:-1:1:{unit}"]


def _of_a_shell(outcome: Outcome) -> Said:
    return Said(outcome.err if outcome.status else "", outcome.wrong(seconds=60.0))


def _apart(draw: random.Random) -> float:
    return draw.choice([0.0, 0.1, draw.uniform(0.0, SECONDS)])


def two_of_a_shell(folder: Path, server: Server, draw: random.Random) -> list[Said]:
    del server
    apart = _apart(draw)
    return [_of_a_shell(outcome) for outcome in together([_words(effect) for effect in EFFECTS], folder, apart=apart)]


def a_shell_and_the_page(folder: Path, server: Server, draw: random.Random) -> list[Said]:
    """Either begins first; who writes first is the scheduler's."""
    first, second = EFFECTS
    expression, unit = EFFECTS[first]
    parameters = {"a": {"value": 0, "min": -1, "max": 1, "unit": unit}}
    page_first, apart, jobs = draw.random() < 0.5, _apart(draw), list[str]()

    def page() -> None:
        time.sleep(0.0 if page_first else apart)
        body = {"effects": [first], "expression": expression, "parameters": parameters}
        jobs.append(server.start(CASE.name, do="add", **body))

    if page_first:
        page()
        time.sleep(apart)
        shell = _of_a_shell(run(_words(second), folder))
    else:
        shell = _of_a_shell(together([_words(second)], folder, then=page)[0])
    ended = server.wait(jobs[0])
    error = str(ended["error"] or "")
    right = (ended["state"] == "done") == (not error) and "\n" not in error
    return [Said(error, "" if right else f"{ended['state']}: {error!r}"), shell]


def wrong(folder: Path, said: list[Said]) -> str:
    """What is wrong with how they said it, or with the case after it; "" when nothing is."""
    if of_words := next((one.wrong for one in said if one.wrong), ""):
        return of_words
    done = {effect for effect, one in zip(EFFECTS, said, strict=True) if not one.refused}
    has = set(tomllib.loads((folder / CASE / "case.toml").read_text(encoding="utf-8"))["model"].get("effects", []))
    return "" if done and has == done else f"said {sorted(done)}, has {sorted(has)}"


PAIRS = (two_of_a_shell, a_shell_and_the_page)


def tried(count: int, seed: int) -> Iterator[tuple[str, str, int]]:
    """Which two, what is wrong, and how many of the two did it: `count` times each pair."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        table_files.csv(folder / "x.csv", table_files.numbers(1))
        made = learn(MADE, folder)
        if made.status:
            raise RuntimeError(made.err)
        server = Server(folder)
        try:
            shutil.copytree(folder / "made", folder / CASE)
            learn(_words("offset"), folder)
            for number in range(len(PAIRS) * count):
                draw = random.Random(f"{seed} {number}")
                shutil.rmtree(folder / CASE)
                shutil.copytree(folder / "made", folder / CASE)
                pair = PAIRS[number % len(PAIRS)]
                said = pair(folder, server, draw)
                yield pair.__name__.replace("_", " "), wrong(folder, said), sum(not one.refused for one in said)
        finally:
            server.process.terminate()
            server.process.wait(60)


def attack(count: int, seed: int) -> Iterator[Result]:
    """`count` times each pair, 0 to SECONDS apart; the rest of the draws is the scheduler's."""
    found = list(tried(count, seed))
    for pair in dict.fromkeys(pair for pair, *_ in found):
        mine = [(bad, did) for name, bad, did in found if name == pair]
        first = next((f"; first: {bad}" for bad, _ in mine if bad), "")
        both = sum(did == 2 for _, did in mine)
        taken = sum(bool(bad) for bad, _ in mine)
        yield Result(f"{pair} at one case", len(mine), taken, f"both in {both} times, else one refused{first}")
