"""Fuzzing that goes on: every parser and the step, with sanitizers, as long as one likes (`make fuzz MINUTES=10`).

    fuzz.py [--minutes 10] [TARGET...]     each target so long; the next run goes on where this one ended
    fuzz.py --lines                        which lines of the parsers the kept inputs reach, without searching
    fuzz.py --planted [TARGET...]          a bug planted in a copy of what each target reads: is it found in that time?

What was found worth keeping stays in out/fuzz/TARGET/corpus. An input that makes a target fail is written to
out/fuzz/TARGET/found and named; put it into tests/firmware/fuzz/corpus/TARGET once the fault is mended: `make test-all`
runs every input there, in all builds. Status 1 when something was found, too few lines were reached, or a planted bug
was not found. The search for a planted bug begins with the inputs that do not show it.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from steps import ROOT

CORPUS = ROOT / "tests" / "firmware" / "fuzz" / "corpus"
KEPT = ROOT / "out" / "fuzz"


@dataclass(frozen=True)
class Target:
    """What a target is there to reach, and a bug: its file below firmware, what stands there, what becomes of it."""

    reaches: tuple[str, ...]
    bug: tuple[str, str, str]


TARGETS = {
    "slcan": Target(
        ("link/slcan.c",),
        ("link/slcan.c", "parser->length < TERRAPIN_SLCAN_LINE_MAX", "parser->length <= TERRAPIN_SLCAN_LINE_MAX"),
    ),
    "can": Target(
        ("link/dispatch.c", "link/command.c", "link/genuine.c"),
        ("link/dispatch.c", "if (link->test_mode) {", "if (true) {"),
    ),
    "intake": Target(
        ("link/intake.c",),
        (
            "link/intake.c",
            "(intake->first + intake->count) % TERRAPIN_INTAKE_SIZE",
            "intake->first + intake->count",
        ),
    ),
    "step": Target(
        tuple(f"core/{path.name}" for path in sorted((ROOT / "firmware" / "core").glob("*.c"))),
        ("core/supervisor.c", "causes |= fault_bit(TERRAPIN_FAULT_ESTOP);", ""),
    ),
    "readers": Target(
        ("boot/records.c", "boot/image.c", "boot/boot.c", "store/parameters.c", "store/crc32.c"),
        ("boot/records.c", "(record->confirmed <= (uint8_t)TERRAPIN_UPDATE_SLOT_B) &&\n           (", "("),
    ),
    "update": Target(
        ("boot/update.c", "boot/update_requests.c"),
        ("boot/update.c", " || (size != expected)", ""),
    ),
}
SHARE = 0.95  # of the lines of these
LONGEST_INPUT = 4096  # bytes
ONE_INPUT = 20  # s that one input may take


def build(
    target: str,
    folder: Path,
    program: Path,
    *flags: str,
    planted: bool = False,
    compiler: str = "clang",
    driver: bool = False,
    objects: Path | None = None,
) -> None:
    """Compile a target with assertions, its bug in it or not, all of it with these flags; `driver` runs it elsewhere
    than under libFuzzer.

    `folder` takes the copy with the bug; `objects` what was compiled without it, for other targets with the same flags.
    """
    firmware, generated = ROOT / "firmware", ROOT / "build" / "host" / "generated"
    objects = objects or folder / "objects"
    objects.mkdir(parents=True, exist_ok=True)
    parts = [path for part in ("core", "link", "boot") for path in sorted((firmware / part).glob("*.c"))]
    parts += [firmware / "store/parameters.c", firmware / "store/crc32.c", generated / "terrapin_interface.c"]
    parts += [] if target == "can" else [firmware / "store/flash_emulated.c"]  # which includes it
    include = [*(firmware / part for part in ("core", "link", "store", "boot")), generated]

    def compiled(source: Path, to: Path, *more: Path) -> Path:
        words = [*flags, *(f"-I{path}" for path in (*more, *include)), "-c", str(source), "-o", str(to)]
        command = [compiler, "-std=c11", "-O1", "-g", "-w", "-DTERRAPIN_ASSERTIONS", *words]
        subprocess.run(command, check=True, timeout=600)
        return to

    own = [f"fuzz_{target}", *(["driver"] if driver else [])]
    linked = [compiled(ROOT / f"tests/firmware/fuzz/{name}.c", folder / f"{name}.o") for name in own]
    for path in parts:
        if planted and path == firmware / TARGETS[target].bug[0]:
            linked.append(compiled(_with_bug(target, folder), folder / "planted.o", path.parent))
        else:
            kept = objects / f"{path.parent.name}-{path.stem}.o"
            linked.append(kept if kept.exists() else compiled(path, kept))
    subprocess.run([compiler, *flags, *map(str, linked), "-o", str(program)], check=True, timeout=600)


def _with_bug(target: str, folder: Path) -> Path:
    """A copy, in folder, of the file that the target's bug is planted in."""
    name, good, bad = TARGETS[target].bug
    text = (ROOT / "firmware" / name).read_text(encoding="utf-8")
    if good not in text:
        raise SystemExit(f"{name} no longer has {good!r}: plant another bug (TARGETS in {Path(__file__).name})")
    copy = folder / Path(name).name
    copy.write_text(text.replace(good, bad), encoding="utf-8")
    return copy


def libfuzzer(program: Path, folder: Path, minutes: float, *corpora: Path) -> tuple[int, int | None]:
    """Search, what is found into folder/found; the status of the search, and how many inputs it tried."""
    (folder / "found").mkdir(parents=True, exist_ok=True)
    command = [
        str(program), f"-max_total_time={max(1, round(60 * minutes))}", f"-timeout={ONE_INPUT}",
        f"-report_slow_units={ONE_INPUT}", f"-max_len={LONGEST_INPUT}", f"-artifact_prefix={folder / 'found'}/",
        "-print_final_stats=1", *map(str, corpora),
    ]  # fmt: skip
    with (folder / "log.txt").open("wb") as log:
        done = subprocess.run(
            command, stdout=log, stderr=subprocess.STDOUT, check=False, timeout=60 * minutes + 30 * ONE_INPUT
        )
    runs = re.search(r"number_of_executed_units: (\d+)", (folder / "log.txt").read_text("utf-8", errors="replace"))
    return done.returncode, int(runs[1]) if runs else None


def search(target: str, minutes: float) -> list[Path]:
    """Fuzz one target; the inputs that made it fail, of this run and before."""
    folder = KEPT / target
    (folder / "corpus").mkdir(parents=True, exist_ok=True)
    status, runs = libfuzzer(
        ROOT / "build" / "fuzz" / f"fuzz_{target}", folder, minutes, folder / "corpus", CORPUS / target
    )
    found = sorted((folder / "found").iterdir())
    count = sum(1 for _ in (folder / "corpus").iterdir())
    print(f"{target}: {runs or 'no count of'} inputs in {minutes:g} min, {count} kept, {len(found)} found", flush=True)
    if status and not found:
        print(f"{target}: ended with status {status}, see {folder / 'log.txt'}")
        return [folder / "log.txt"]
    return found


def find_planted(target: str, minutes: float) -> bool:
    """Whether the search finds the target's planted bug, beginning with inputs that do not show it."""
    folder = KEPT / target / "planted"
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "seeds").mkdir(parents=True)
    program = folder / "target"
    build(target, folder, program, "-fsanitize=fuzzer,address,undefined", "-fno-sanitize-recover=all", planted=True)
    seeds = sorted((CORPUS / target).iterdir())
    for path in seeds:
        done = subprocess.run([str(program), str(path)], capture_output=True, check=False, timeout=10 * ONE_INPUT)
        if done.returncode == 0:
            shutil.copy(path, folder / "seeds")
    silent = sum(1 for _ in (folder / "seeds").iterdir())
    start = time.monotonic()
    status, runs = libfuzzer(program, folder, minutes, folder / "seeds")
    took = f"{time.monotonic() - start:.0f} s, {runs or 'no count of'} inputs"
    found = any((folder / "found").glob("crash-*"))
    told = "found" if found else f"NOT found (status {status}, see {folder / 'log.txt'})"
    print(
        f"{target}: planted bug {told} after {took}, from the {silent} of {len(seeds)} inputs that do not show it",
        flush=True,
    )
    return found


def lines(target: str) -> tuple[int, int]:
    """Lines of the target's parsers that its kept inputs reach, and all of them."""
    folder = KEPT / target / "coverage"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    # A copy of every input in one folder: the driver without libFuzzer runs all files of one.
    every = folder / "inputs"
    every.mkdir()
    for number, path in enumerate([*sorted((CORPUS / target).iterdir()), *_kept(target)]):
        shutil.copyfile(path, every / f"{number:06d}")
    counting = ("-fprofile-instr-generate", "-fcoverage-mapping")
    # An assertion's way out would make the line behind it look as if nothing came there.
    flags = ("-UTERRAPIN_ASSERTIONS", "-DFILES_MAX=100000", *counting)
    build(target, folder, folder / "target", *flags, driver=True)
    subprocess.run(
        [str(folder / "target"), "0", str(every)], env={"LLVM_PROFILE_FILE": str(folder / "raw")}, check=True,
        capture_output=True, timeout=3600,
    )  # fmt: skip
    subprocess.run(["llvm-profdata", "merge", "-o", str(folder / "data"), str(folder / "raw")], check=True, timeout=600)
    shown = subprocess.run(
        ["llvm-cov", "show", str(folder / "target"), f"-instr-profile={folder / 'data'}",
         *(f"firmware/{name}" for name in TARGETS[target].reaches)],
        cwd=ROOT, check=True, capture_output=True, text=True, timeout=600,
    ).stdout  # fmt: skip
    counts = re.findall(r"^ *\d+\| +(\d[\d.]*[kMGTE]?)\|(.*)", shown, re.MULTILINE)
    missed = [line.strip() for count, line in counts if count == "0"]
    (folder / "missed.txt").write_text("\n".join(missed) + "\n", encoding="utf-8")
    return len(counts) - len(missed), len(counts)


def _kept(target: str) -> list[Path]:
    folder = KEPT / target / "corpus"
    return sorted(folder.iterdir()) if folder.is_dir() else []


def main() -> int:
    parser = argparse.ArgumentParser(description="Fuzz every parser and the step.")
    parser.add_argument("--minutes", type=float, default=10.0, help="of each target")
    parser.add_argument("--lines", action="store_true", help="count lines only")
    parser.add_argument("--planted", action="store_true", help="search for a bug that is planted in each target")
    parser.add_argument("target", nargs="*", choices=[[], *TARGETS], help="all when none is named")
    options = parser.parse_args()
    if shutil.which("clang") is None:
        print("not run here: fuzzing (clang not installed)")
        return 1
    subprocess.run([str(ROOT / "tests/tools/build.sh"), "host", "fuzz"], cwd=ROOT, check=True, timeout=1800)
    targets = options.target or list(TARGETS)
    if options.planted:
        found = [find_planted(target, options.minutes) for target in targets]
        return 0 if all(found) else 1
    passed = True
    for target in targets:
        for path in [] if options.lines else search(target, options.minutes):
            passed = False
            print(f"{target}: {path.relative_to(ROOT)}: run it with build/fuzz/fuzz_{target} {path.relative_to(ROOT)}")
        if shutil.which("llvm-cov") is None:
            print(f"not run here: lines that {target} reaches (llvm-cov not installed)")
            continue
        reached, every = lines(target)
        passed &= reached >= SHARE * every
        told = f"{reached} of {every} lines of {', '.join(TARGETS[target].reaches)} reached, {reached / every:.1%}"
        where = (KEPT / target / "coverage" / "missed.txt").relative_to(ROOT)
        print(f"{target}: {told} (at least {SHARE:.0%}); the others are in {where}", flush=True)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
