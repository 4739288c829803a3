"""Fuzzing that goes on: every parser and the step, with sanitizers, as long as one likes (`make fuzz MINUTES=10`).

    fuzz.py [--minutes 10] [TARGET...]     each target so long; the next run goes on where this one ended
    fuzz.py --lines                        which lines of the parsers the kept inputs reach, without searching

What was found worth keeping stays in out/fuzz/TARGET/corpus. An input that makes a target fail is written to
out/fuzz/TARGET/found and named; put it into tests/firmware/fuzz/corpus/TARGET once the fault is mended: `make test`
runs every input there, in all builds. Status 1 when something was found or too few lines were reached.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
from pathlib import Path

from steps import ROOT

CORPUS = ROOT / "tests" / "firmware" / "fuzz" / "corpus"
KEPT = ROOT / "out" / "fuzz"
# What each target is there to reach.
PARSERS = {
    "slcan": ("link/slcan.c",),
    "can": ("link/dispatch.c", "link/command.c", "link/genuine.c"),
    "intake": ("link/intake.c",),
    "step": ("core/sense.c", "core/supervisor.c", "core/step.c", "core/drive.c", "core/slip.c"),
    "readers": ("boot/records.c", "store/parameters.c", "store/crc32.c"),
    "update": ("boot/update.c", "boot/update_requests.c"),
}
SHARE = 0.95  # of the lines of these
LONGEST_INPUT = 4096  # bytes
ONE_INPUT = 20  # s that one input may take


def search(target: str, minutes: float) -> list[Path]:
    """Fuzz one target; the inputs that made it fail, of this run and before."""
    folder = KEPT / target
    for name in ("corpus", "found"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    command = [
        str(ROOT / "build" / "fuzz" / f"fuzz_{target}"),
        f"-max_total_time={max(1, round(60 * minutes))}",
        f"-timeout={ONE_INPUT}",
        f"-max_len={LONGEST_INPUT}",
        f"-artifact_prefix={folder / 'found'}/",
        "-print_final_stats=1",
        str(folder / "corpus"),
        str(CORPUS / target),
    ]
    with (folder / "log.txt").open("wb") as log:
        done = subprocess.run(
            command, stdout=log, stderr=subprocess.STDOUT, check=False, timeout=60 * minutes + 30 * ONE_INPUT
        )
    text = (folder / "log.txt").read_text(encoding="utf-8", errors="replace")
    runs = re.search(r"number_of_executed_units: (\d+)", text)
    found = sorted((folder / "found").iterdir())
    count = sum(1 for _ in (folder / "corpus").iterdir())
    print(f"{target}: {runs[1] if runs else 'no count of'} inputs in {minutes:g} min, {count} kept, {len(found)} found")
    if done.returncode and not found:
        print(f"{target}: ended with status {done.returncode}, see {folder / 'log.txt'}")
        return [folder / "log.txt"]
    return found


def lines(target: str) -> tuple[int, int]:
    """Lines of the target's parsers that its kept inputs reach, and all of them."""
    folder = KEPT / target / "coverage"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    sources = [f"firmware/{name}" for name in PARSERS[target]]
    others = [
        *(p for part in ("core", "link", "boot") for p in sorted((ROOT / "firmware" / part).glob("*.c"))),
        ROOT / "firmware/store/parameters.c", ROOT / "firmware/store/crc32.c",
        ROOT / "build/fuzz/generated/terrapin_interface.c",
    ]  # fmt: skip
    if target != "can":  # which includes it
        others.append(ROOT / "firmware/store/flash_emulated.c")
    include = [f"-I{ROOT / 'firmware' / part}" for part in ("core", "link", "store", "boot")]
    # A copy of every input in one folder: the driver without libFuzzer runs all files of one.
    every = folder / "inputs"
    every.mkdir()
    for number, path in enumerate([*sorted((CORPUS / target).iterdir()), *_kept(target)]):
        shutil.copyfile(path, every / f"{number:06d}")
    subprocess.run(
        ["clang", "-std=c11", "-O1", "-fprofile-instr-generate", "-fcoverage-mapping", "-DFILES_MAX=100000", *include,
         f"-I{ROOT / 'build/fuzz/generated'}", str(ROOT / f"tests/firmware/fuzz/fuzz_{target}.c"),
         str(ROOT / "tests/firmware/fuzz/driver.c"), *map(str, others), "-o", str(folder / "target")],
        check=True, timeout=600,
    )  # fmt: skip
    subprocess.run(
        [str(folder / "target"), "0", str(every)], env={"LLVM_PROFILE_FILE": str(folder / "raw")}, check=True,
        capture_output=True, timeout=3600,
    )  # fmt: skip
    subprocess.run(["llvm-profdata", "merge", "-o", str(folder / "data"), str(folder / "raw")], check=True, timeout=600)
    shown = subprocess.run(
        ["llvm-cov", "show", str(folder / "target"), f"-instr-profile={folder / 'data'}", *sources],
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
    parser.add_argument("target", nargs="*", choices=[[], *PARSERS], help="all when none is named")
    options = parser.parse_args()
    if shutil.which("clang") is None:
        print("not run here: fuzzing (clang not installed)")
        return 1
    subprocess.run([str(ROOT / "tests/tools/build.sh"), "fuzz"], cwd=ROOT, check=True, timeout=1800)
    passed = True
    for target in options.target or list(PARSERS):
        for path in [] if options.lines else search(target, options.minutes):
            passed = False
            print(f"{target}: {path.relative_to(ROOT)}: run it with build/fuzz/fuzz_{target} {path.relative_to(ROOT)}")
        if shutil.which("llvm-cov") is None:
            print(f"not run here: lines that {target} reaches (llvm-cov not installed)")
            continue
        reached, every = lines(target)
        passed &= reached >= SHARE * every
        told = f"{reached} of {every} lines of {', '.join(PARSERS[target])} reached, {reached / every:.1%}"
        where = (KEPT / target / "coverage" / "missed.txt").relative_to(ROOT)
        print(f"{target}: {told} (at least {SHARE:.0%}); the others are in {where}", flush=True)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
