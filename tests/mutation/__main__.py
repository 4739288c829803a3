"""Would the tests see a slip in core, link layer, store, boot loader, ports? `python -m tests.mutation`; status 1: no.

    python -m tests.mutation                      a seeded sample: 1,000 and more, 150 or more a library (an hour)
    python -m tests.mutation --whole              all of them (a day); goes on where it was stopped
    python -m tests.mutation --changed            those of functions changed by the last commit or since (make check)
    python -m tests.mutation --further 600        so many of the operators of neighbours.py alone, by seed
    python -m tests.mutation --match supervisor   those whose name has this
    python -m tests.mutation --library boot       those of the sample (or of --whole) that this library has
    python -m tests.mutation --show               the figures and the survivors of what was judged already
    python -m tests.mutation --map                which test killed how many mutants of which file
    python -m tests.mutation --keep               write what is known into judged.txt, for the next tree
    python -m tests.mutation --anew               what judged.txt says does not count

A mutant that survives is an accusation: a test must kill it, or tests/mutation/equivalent.toml must say why no test
can. Results are JSON lines in out/mutation, and letters in tests/mutation/judged.txt. A kill holds as long as the
mutant's function is as it was; a survivor is judged anew when a test has changed. The sample is of those whose names
have the lowest digests: a change of one function changes the sample there alone.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import random
import subprocess
import sys
import tomllib
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

from terrapin_hil.paths import ROOT
from tests.mutation.judge import BITS, Bench, NotReady, ports_tested
from tests.mutation.neighbours import further
from tests.mutation.operators import Mutant, mutants

LIBRARIES = {name: f"firmware/{name}/*.c" for name in ("core", "link", "store", "boot")} | {
    "ports": "firmware/ports/*/*.c"
}
NOT_IN_IMAGES = ("firmware/store/flash_emulated.c", "firmware/ports/host/flash_file.c")
WHOLE_FILES = ("firmware/core/supervisor.c",)  # all mutants of these, in every sample
NO_SURVIVOR = ("firmware/core/supervisor.c", "firmware/boot/", "firmware/ports/stm32f405/bridge.c")
SHARE, LISTED = 0.97, 0.05  # killed of those that are not equivalent; listed as equivalent of a file's mutants
SHARE_OF_PORTS = 0.95
SAMPLE = {
    "core": 300,
    "link": 170,
    "store": 165,
    "boot": 200,
    "ports": 165,
}  # 150 and more when equivalents are left out
TESTS = ("tests/firmware/*.[ch]", "tests/boot/*.py", "hil/terrapin_hil/scenario/scenarios/*.toml", BITS)
KEPT = Path(__file__).with_name("judged.txt")
LETTERS = {"k": "killed", "s": "survived", "e": "equal", "i": "invalid"}
HEAD = (
    "# What was judged: file, function, digest of its text, a letter for each mutant (k killed, s survived, e equal\n"
    "# machine code, i refused by the compiler, . not judged). Written by `python -m tests.mutation --keep`."
)
EQUIVALENT = Path(__file__).with_name("equivalent.toml")
NICE = 10  # others work on this machine
FURTHER_SHARE = 0.15  # of the other mutants of a change: `make check` may take 1.2 times what it took
MOST_CHANGED = 400  # mutants that `make check` judges: a spread of them when a commit changes more


def key(mutant: Mutant, again: int) -> str:
    """What names a mutant as long as its function is as it was. `again`: how many before it have the same name."""
    begin, end = extent(mutant)
    text = "\n".join(mutant.source.split("\n")[begin - 1 : end])
    return f"{hashlib.sha256(text.encode()).hexdigest()[:12]} {mutant.name} #{again}"


def everything() -> dict[str, Mutant]:
    """All mutants of the libraries and ports, by key."""
    found: dict[str, Mutant] = {}
    for pattern in LIBRARIES.values():
        for path in sorted(ROOT.glob(pattern)):
            name = path.relative_to(ROOT)
            seen: Counter[str] = Counter()
            if name.as_posix() in NOT_IN_IMAGES or not seen_by_a_test(name):
                continue
            for mutant in [*mutants(name, ROOT), *further(name, ROOT)]:  # judged.txt counts on this order
                found[key(mutant, seen[mutant.name])] = mutant
                seen[mutant.name] += 1
    return found


def seen_by_a_test(path: Path) -> bool:
    """Of a port what a C test is built of; the rest runs on the chip, in the emulator or as a process alone."""
    return path.parts[1] != "ports" or path.as_posix() in ports_tested(ROOT)


def a_part_of_the_further(chosen: dict[str, Mutant], seed: int) -> dict[str, Mutant]:
    """Those of operators.py, and FURTHER_SHARE as many of neighbours.py: `make check` takes the same time whatever is
    added there."""
    first = {m.name for path in {m.path for m in chosen.values()} for m in mutants(path, ROOT)}
    plain = {k: m for k, m in chosen.items() if m.name in first}
    rest = sorted((k for k in chosen if k not in plain), key=lambda k: hashlib.sha256(f"{seed} {k}".encode()).digest())
    return plain | {k: chosen[k] for k in rest[: math.ceil(FURTHER_SHARE * len(plain))]}


def only_further(all_of_them: dict[str, Mutant], count: int, seed: int) -> dict[str, Mutant]:
    """As many of neighbours.py of each library and port, those with the lowest digests."""
    first = {m.name for path in {m.path for m in all_of_them.values()} for m in mutants(path, ROOT)}
    rest = {k: m for k, m in all_of_them.items() if m.name not in first}
    parts = sorted({part(m) for m in rest.values()})
    found = {}
    for name in parts:
        mine = sorted(
            (k for k, m in rest.items() if part(m) == name),
            key=lambda k: hashlib.sha256(f"{seed} {k}".encode()).digest(),
        )
        found |= {k: rest[k] for k in mine[: math.ceil(count / len(parts))]}
    return found


def part(mutant: Mutant) -> str:
    """A library, or one port of them."""
    return "/".join(mutant.path.parts[1:-1])


def library(mutant: Mutant) -> str:
    """core, link, store, boot or ports."""
    return mutant.path.parts[1]


def sample(all_of_them: dict[str, Mutant], seed: int) -> dict[str, Mutant]:
    """All of WHOLE_FILES, and SAMPLE of each library beside them."""
    chosen = {k: m for k, m in all_of_them.items() if m.path.as_posix() in WHOLE_FILES}
    for name, count in SAMPLE.items():
        rest = [k for k, m in all_of_them.items() if library(m) == name and k not in chosen]
        picked = sorted(rest, key=lambda k: hashlib.sha256(f"{seed} {k}".encode()).digest())[:count]
        chosen |= {k: all_of_them[k] for k in picked}
    return chosen


def changed(all_of_them: dict[str, Mutant], since: str) -> dict[str, Mutant]:
    """Those of functions of which a line is not as it was at `since`."""
    command = ["git", "diff", "-U0", since, "--", *(pattern.rsplit("/", 1)[0] for pattern in LIBRARIES.values())]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=60.0)
    lines: dict[str, set[int]] = defaultdict(set)
    path = ""
    for line in done.stdout.splitlines():
        if line.startswith("+++ "):
            path = line[6:]
        elif line.startswith("@@"):
            first, _, count = line.split("+")[1].split(" ")[0].partition(",")
            lines[path] |= set(range(int(first), int(first) + max(1, int(count or 1))))
    touched = set()
    for mutant in all_of_them.values():
        where = mutant.path.as_posix()
        if where in lines:
            begin, end = extent(mutant)
            if lines[where] & set(range(begin, end + 1)):
                touched.add((where, mutant.function))
    return {k: m for k, m in all_of_them.items() if (m.path.as_posix(), m.function) in touched}


def extent(mutant: Mutant) -> tuple[int, int]:
    """First and last line of the mutant's function."""
    begin = mutant.source.rfind("\n\n", 0, mutant.begin) if mutant.function in ("enum", "table") else -1
    if begin < 0:
        begin = mutant.source.rfind(f"{mutant.function}(", 0, mutant.source.find("\n}", mutant.begin))
        at = mutant.source.rfind("\n}", 0, mutant.begin)
        begin = max(begin if begin < mutant.begin else 0, at + 2)
    end = mutant.source.find("\n}", mutant.begin)
    return mutant.source.count("\n", 0, begin) + 1, mutant.source.count("\n", 0, end) + 2


def stored(path: Path) -> dict[str, dict[str, Any]]:
    """What was judged already, by key."""
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            entry = json.loads(line)
            found[entry["key"]] = entry
        except (ValueError, KeyError):  # cut short by a kill
            continue
    return found


def by_function(all_of_them: dict[str, Mutant]) -> dict[str, list[str]]:
    """Keys of the mutants of each function, in order; by "file function digest"."""
    found: dict[str, list[str]] = defaultdict(list)
    for k, m in all_of_them.items():
        found[f"{m.path.as_posix()} {m.function} {k.partition(' ')[0]}"].append(k)
    return found


def kept(all_of_them: dict[str, Mutant]) -> dict[str, dict[str, Any]]:
    """What judged.txt says of the functions that are as they were then."""
    functions, found, tests = by_function(all_of_them), {}, ""
    for line in KEPT.read_text(encoding="utf-8").splitlines() if KEPT.exists() else []:
        name, _, letters = line.rpartition(" ")
        if name == "tests":
            tests = letters
        for k, letter in zip(functions.get(name, []), letters, strict=False):
            if letter in LETTERS:
                found[k] = {"key": k, "verdict": LETTERS[letter], "by": "", "tests": tests}
    return found


def keep(all_of_them: dict[str, Mutant], done: dict[str, dict[str, Any]], now: str) -> None:
    """Writes judged.txt: a line a function, a letter a mutant, in the order of the file. Of the survivors, those that
    the present tests leave alive."""
    letter_of = {verdict: letter for letter, verdict in LETTERS.items()}
    lines = [HEAD, f"tests {now}"]
    for name, keys in by_function(all_of_them).items():
        entries = [done.get(k) for k in keys]
        letters = "".join(
            "." if e is None or (e["verdict"] == "survived" and e["tests"] != now) else letter_of[e["verdict"]]
            for e in entries
        )
        if set(letters) != {"."}:
            lines.append(f"{name} {letters}")
    KEPT.write_text("\n".join(lines) + "\n", encoding="utf-8")


def tests_now() -> str:
    """Twelve digits that change with the tests."""
    digest = hashlib.sha256()
    for path in sorted(path for pattern in TESTS for path in ROOT.glob(pattern)):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def listed(all_of_them: dict[str, Mutant]) -> tuple[set[str], list[str]]:
    """Keys of the mutants that equivalent.toml names, and what is wrong with that list."""
    entries = tomllib.loads(EQUIVALENT.read_text(encoding="utf-8")).get("equivalent", [])
    by_name: dict[tuple[str, ...], list[str]] = defaultdict(list)
    counts: Counter[str] = Counter()
    for k, m in all_of_them.items():
        by_name[m.path.as_posix(), m.function, m.line, m.change].append(k)
        counts[m.path.as_posix()] += 1
    found: set[str] = set()
    wrong = []
    for entry in entries:
        keys = by_name.get(tuple(entry.get(word, "") for word in ("file", "function", "line", "change")), [])
        keys = keys[entry["number"] - 1 : entry["number"]] if "number" in entry else keys
        if not keys or not entry.get("why"):
            told = "matches no mutant" if not keys else "gives no reason"
            wrong.append(f"equivalent.toml: {entry.get('file')} {entry.get('function')}: {entry.get('change')}: {told}")
        found |= set(keys)
    of_a_file = Counter(all_of_them[k].path.as_posix() for k in found)
    wrong += [
        f"equivalent.toml: {name}: found {count} of {counts[name]} mutants, expected at most {LISTED:.0%}"
        for name, count in of_a_file.items()
        if count > LISTED * counts[name]
    ]
    return found, wrong


def judge(
    chosen: dict[str, Mutant], equivalent: set[str], path: Path, done: dict[str, dict[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Judges what was not judged yet (`done`), into `path` as well; everything that is known then."""
    now = tests_now()
    left = {
        k: m
        for k, m in chosen.items()
        if k not in equivalent and (k not in done or (done[k]["verdict"] == "survived" and done[k]["tests"] != now))
    }
    if not left:
        return done
    path.parent.mkdir(parents=True, exist_ok=True)
    os.nice(max(0, NICE - os.nice(0)))
    with Bench() as bench, path.open("a", encoding="utf-8") as file:
        for number, (k, mutant) in enumerate(left.items(), 1):
            verdict, by = bench.judge(mutant)
            done[k] = {"key": k, "verdict": verdict, "by": by, "tests": now}
            file.write(json.dumps(done[k]) + "\n")
            file.flush()
            if verdict == "survived":
                print(f"  {mutant.path.as_posix()}:{mutant.number}: {mutant.line} | {mutant.change}", flush=True)
            elif number % 50 == 0:
                print(f"{number} of {len(left)}", file=sys.stderr, flush=True)
    return done


def told(chosen: dict[str, Mutant], equivalent: set[str], done: dict[str, dict[str, Any]], show: bool) -> int:
    """Prints the figures of each library; how many bounds are missed."""
    missed = 0
    for name in LIBRARIES:
        keys = [k for k, m in chosen.items() if library(m) == name]
        kinds = Counter(
            "listed" if k in equivalent else done.get(k, {"verdict": "not judged"})["verdict"] for k in keys
        )
        survivors = [chosen[k] for k in keys if k not in equivalent and done.get(k, {}).get("verdict") == "survived"]
        counted = kinds["killed"] + kinds["survived"]
        if not keys:
            continue
        share = kinds["killed"] / counted if counted else 1.0
        never = [m for m in survivors if m.path.as_posix().startswith(NO_SURVIVOR)]
        least = SHARE_OF_PORTS if name == "ports" else SHARE
        missed += (share < least) + (len(never) > 0)
        rest = ", ".join(
            f"{count} {kind}" for kind, count in sorted(kinds.items()) if kind not in ("killed", "survived")
        )
        print(
            f"{name}: {kinds['killed']} of {counted} killed, {share:.1%} (at least {least:.0%}); {rest or 'none equal'}"
        )
        for mutant in survivors if show else never:
            print(f"  survived: {mutant.path.as_posix()}:{mutant.number}: {mutant.line} | {mutant.change}")
    return missed


def main() -> int:
    """Judges the mutants that are asked for; 1 when a bound is missed or the list of equivalents is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description="Mutants of the firmware.")
    parser.add_argument("--whole", action="store_true")
    parser.add_argument("--changed", nargs="?", const="HEAD~1", metavar="COMMIT", help="since then; the last but one")
    parser.add_argument("--match", default="")
    parser.add_argument("--further", type=int, metavar="N", help="N of neighbours.py, as many of each library, by seed")
    parser.add_argument("--library", choices=LIBRARIES)
    parser.add_argument("--seed", type=int, default=1, help="of the sample")
    parser.add_argument("--show", action="store_true", help="no new ones")
    parser.add_argument("--keep", action="store_true", help="no new ones")
    parser.add_argument("--anew", action="store_true", help="do not believe judged.txt")
    parser.add_argument("--map", action="store_true", help="no new ones")
    options = parser.parse_args()
    all_of_them = everything()
    equivalent, wrong = listed(all_of_them)
    path = ROOT / "out" / "mutation" / "judged.jsonl"
    if options.changed is not None:
        chosen = a_part_of_the_further(changed(all_of_them, options.changed), options.seed)
        if len(chosen) > MOST_CHANGED:
            names = random.Random(options.seed).sample(sorted(chosen), MOST_CHANGED)
            print(f"a spread of {MOST_CHANGED} of {len(chosen)} mutants of changed functions")
            chosen = {k: chosen[k] for k in names}
    elif options.further is not None:
        chosen = only_further(all_of_them, options.further, options.seed)
    elif options.whole or options.match:
        chosen = {k: m for k, m in all_of_them.items() if options.match in m.name}
    else:
        chosen = sample(all_of_them, options.seed)
    if options.library is not None:
        chosen = {k: m for k, m in chosen.items() if library(m) == options.library}
    if options.map:
        killers = Counter(
            (all_of_them[k].path.as_posix(), e["by"]) for k, e in stored(path).items() if k in all_of_them
        )
        for (name, by), count in sorted(killers.items()):
            print(f"{name}: {by or 'equal, or survived'} {count}")
        return 0
    done = ({} if options.anew else kept(all_of_them)) | stored(path)
    if options.keep:
        keep(all_of_them, done, tests_now())
        return 0
    try:
        if not options.show:
            done = judge(chosen, equivalent, path, done)
    except NotReady as error:
        if options.changed is not None:  # one of many checks: those that cannot run are named, as gate.py does
            print(f"not run here: mutants of changed functions ({error})")
            return 0
        print(f"mutants: {error}", file=sys.stderr)
        return 2
    if not chosen:
        print("mutants: no function of core, link layer, store, boot loader or ports has changed")
    for line in wrong:
        print(line)
    missed = told(chosen, equivalent, done, options.show or options.changed is not None)
    return 1 if missed or wrong else 0


if __name__ == "__main__":
    sys.exit(main())
