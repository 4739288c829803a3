"""The bound of the stack: no image of a toy that lacks one passes, and each real image's holds what was measured."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from terrapin_hil import paths
from terrapin_hil.links.qemu import MACHINE, image, open_qemu
from terrapin_hil.links.qemu_usart import QemuUsart
from terrapin_hil.links.qemu_usart import image as board_image
from terrapin_hil.messages import Sender, interface
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from terrapin_tools.flash.image import Version, sign
from terrapin_tools.flash.keys import development_key, private_key
from terrapin_tools.flash.layout import SLOT_SIZE, SLOTS
from tests.target.scripts import path_of, script
from tests.waiting import BOUND

PATTERN = 0x5AFE57AC  # of processor.h
report = script("stack_report")

built = pytest.mark.skipif(not image().is_file(), reason="the ARM images are not built (no ARM cross compiler)")
emulated = pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="qemu-system-arm is not installed")

# reset > work > leaf takes 8 + (20 + 24) + 4 bytes; the tick 16, the fault 8.
TOY = """
08000010 <reset>:
 8000010:\tpush\t{r3, lr}
 8000012:\tbls.n\t8000010 <reset>
 8000014:\tbl\t8000020 <work>
 8000018:\tb.n\t8000010 <reset>

08000020 <work>:
 8000020:\tstmdb\tsp!, {r4, r5, r6, r7, lr}
 8000024:\tsub\tsp, #24
 8000026:\tadd\tr3, pc, #4\t@ (adr r3, 8000030 <work+0x10>)
 8000028:\tldr.w\tpc, [r3, r6, lsl #2]
 800002c:\tbeq.n\t8000040 <leaf>
 800002e:\tldmia.w\tsp!, {r4, r5, r6, r7, pc}

08000040 <leaf>:
 8000040:\tstr.w\tlr, [sp, #-4]!
 8000044:\tldr.w\tpc, [sp], #4

08000050 <tick>:
 8000050:\tpush\t{r4, r5, r6, lr}
 8000052:\tpop\t{r4, r5, r6, pc}

08000060 <fault>:
 8000060:\tpush\t{r4, lr}
 8000062:\tbx\tlr
"""
FIGURES = "work.c:1:6:reset\t8\tstatic\nwork.c:5:6:work\t44\tstatic\nwork.c:9:6:leaf\t4\tstatic\n"
VECTORS = [0x20001000, 0x8000011, 0x8000061, 0x8000061, 0, 0x8000051, 0]  # the end, reset, NMI, HardFault, tick


def toy(folder: Path, code: str = TOY, figures: str = FIGURES) -> tuple[int, int, list[str]]:
    (folder / "work.c.su").write_text(figures)
    found = report.bound(report.functions(code.splitlines()), VECTORS, report.compiler_figures(folder))
    return found.main, found.exceptions, found.chain


def test_a_toy_has_the_bound_that_is_counted_by_hand(tmp_path: Path) -> None:
    assert toy(tmp_path) == (8 + 44 + 4, (36 + 8) + (36 + 8) + (36 + 16), ["reset", "work", "leaf"])


@pytest.mark.parametrize(
    ("line", "instead", "why"),
    [
        ("bx\tlr", "b.w\t8000060 <fault>\n 8000064:\tbl\t8000060 <fault>", "recursion: fault > fault"),
        ("ldr.w\tpc, [sp], #4", "bl\t8000020 <work>", "recursion: work > leaf > work"),
        ("ldr.w\tpc, [sp], #4", "b.n\t8000024 <work+0x4>", "recursion: work > leaf > work"),
        ("ldr.w\tpc, [sp], #4", "blx\tr3", "leaf calls through a pointer"),
        ("ldr.w\tpc, [sp], #4", "bx\tip", "leaf calls through a pointer"),
        ("add\tr3, pc, #4", "ldr\tr3, [r0, #4]", "work calls through a pointer"),
        ("sub\tsp, #24", "sub\tsp, r3", "work sets the stack pointer"),
        ("sub\tsp, #24", "mov\tsp, r3", "work sets the stack pointer"),
        ("bl\t8000020 <work>", "bl\t8000022 <work>", "a call to 0x8000022, where no function is"),
        ("sub\tsp, #24", "nop", r"work pushes 20 bytes, but the compiler says \[\(44, 'static'\)\]"),
    ],
)
def test_what_has_no_bound_is_refused(tmp_path: Path, line: str, instead: str, why: str) -> None:
    assert line in TOY
    with pytest.raises(report.Refused, match=f"^{why}$"):
        toy(tmp_path, TOY.replace(line, instead))


def test_frames_of_variable_size_and_missing_figures_are_refused(tmp_path: Path) -> None:
    with pytest.raises(report.Refused, match="leaf: a frame of variable size"):
        toy(tmp_path, figures=FIGURES.replace("4\tstatic", "4\tdynamic"))
    with pytest.raises(report.Refused, match="of no function"):
        toy(tmp_path, figures="")


TOOLS = ["--nm", "arm-none-eabi-nm", "--objdump", "arm-none-eabi-objdump", "--su", str(image().parent)]


def bounds(*programs: Path) -> tuple[int, list[tuple[int, int]]]:
    """The script's status; of each image its bound and the bytes set aside."""
    command = [sys.executable, "-B", str(path_of("stack_report")), *TOOLS, *map(str, programs)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    rows = re.findall(r"stack +(\d+) bytes at most .*; (\d+) set aside", done.stdout)
    assert len(rows) == len(programs), done.stdout + done.stderr
    return done.returncode, [(int(bound), int(aside)) for bound, aside in rows]


@built
def test_every_image_keeps_what_is_set_aside() -> None:
    programs = sorted(image().parent.glob("terrapin-*.elf"))
    assert len(programs) == 15  # qemu, two boards in three places and of two kinds, their boot loaders
    status, rows = bounds(*programs)
    assert status == 0
    assert all(400 < bound < aside for bound, aside in rows)


@built
def test_too_deep_a_chain_fails(tmp_path: Path) -> None:
    """The emulator's image, its script's symbols changed: it fits when its bound and the guard are set aside."""
    [(bound, _)] = bounds(image())[1]
    names = subprocess.run(["arm-none-eabi-nm", image()], capture_output=True, text=True, check=True).stdout
    found = re.search(r"^([0-9a-f]+) . image_stack_end$", names, re.MULTILINE)
    assert found is not None
    for missing in (0, 4):
        aside = bound + report.GUARD - missing
        changed = ["-N", "image_stack", "--add-symbol", f"image_stack={int(found[1], 16) - aside:#x}"]
        subprocess.run(["arm-none-eabi-objcopy", *changed, image(), tmp_path / "image.elf"], check=True)
        assert bounds(tmp_path / "image.elf") == (1 if missing else 0, [(bound, aside)])


@built
@emulated
@pytest.mark.parametrize("name", ["floor_calibration", "slope_limiter"])
def test_the_bound_holds_what_was_measured(name: str) -> None:
    _, [(bound, aside)] = bounds(image())
    with open_qemu() as link:
        run(replace(load_scenario(find_scenario(name)), duration=2.0, checks=()), link)
    assert link.machine.stack is not None
    assert 0.5 * bound < link.machine.stack <= bound < aside


@built
@emulated
def test_the_bound_holds_what_the_board_says() -> None:
    _, [(bound, aside)] = bounds(board_image())
    message, used, end = interface().messages["PORT_IDENTITY"], 0, time.monotonic() + BOUND
    machine = QemuUsart()
    try:
        with machine.start() as port:
            while not used and time.monotonic() < end:
                heard = port.exchange_frames([Sender().frame("PARAMETER_READ", {"index": 0})])
                used = max((4 * message.decode(data)["stack_used"] for i, data in heard if i == message.id), default=0)
    finally:
        machine.stop()
    assert 0.25 * bound < used <= bound < aside


@built
@emulated
def test_the_bound_holds_what_the_boot_loader_takes(tmp_path: Path) -> None:
    """It verifies an image whose signature is another's by one bit, which takes it deepest, and stays."""
    loader = image().with_name("terrapin-boot-emulated.elf")
    _, [(bound, aside)] = bounds(loader)
    application = board_image(place="slot-a").with_suffix(".bin").read_bytes()
    data = bytearray(sign(application, private_key(development_key()), Version(1, 0, 0), 1, "a"))
    data[-40] ^= 1  # in the point R, the first half of the 64 bytes
    slot = tmp_path / "slot.bin"
    slot.write_bytes(bytes(data).ljust(SLOT_SIZE, b"\xff"))
    command = ["qemu-system-arm", "-M", MACHINE, "-nodefaults", "-display", "none", "-monitor", "stdio"]
    command += ["-device", f"loader,file={slot},addr=0x{SLOTS['a']:08x},force-raw=on", "-kernel", str(loader)]
    used, end = 0, time.monotonic() + BOUND
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            while used <= 0.5 * bound and time.monotonic() < end:
                time.sleep(0.5)
                words = stack_words(process, aside // 4)
                used = aside - 4 * next((i for i, word in enumerate(words) if word != PATTERN), len(words))
        finally:
            process.kill()
    assert 0.5 * bound < used <= bound < aside


def stack_words(process: subprocess.Popen[str], count: int) -> list[int]:
    """Words from the beginning of RAM, where the stack stands, by QEMU's monitor."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(f"xp /{count}xw 0x20000000\n")
    process.stdin.flush()
    words: list[int] = []
    while len(words) < count:
        line = process.stdout.readline()
        assert line, "the emulator has ended"
        if row := re.match(r"[0-9a-f]{16}: (.*)", line):
            words += [int(word, 16) for word in row[1].split()]
    return words


def test_no_port_sets_a_priority() -> None:
    """Else interrupts could preempt each other, which the bound excludes."""
    sources = [*(paths.ROOT / "firmware" / "ports").glob("stm32f405*/*.[ch]")]
    assert len(sources) > 20
    assert not [path for path in sources if re.search(r"->\s*SHPR|NVIC_IPR|BASEPRI", path.read_text(), re.IGNORECASE)]
