"""The bound of a step's instructions: a toy's is what is counted by hand, what has none is refused, and the image's
lies above every count, but not far."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from terrapin_hil.firmware import Firmware
from tests.target.replay import count_all, image
from tests.target.scripts import HALVES, bounds, disassembly, script
from tests.target.worst import bases, build, load

report = script("path_report")

TIMES = tomllib.loads((Path(__file__).parent / "budget.toml").read_text())["step"]["bound_over_found"]

# outer: 3, a loop of 4 (of which the inner one has 2), a choice of 2 or 3, 1; leaf 2; table: 2, then 1, 2 or 1, then 1
TOY = """
08000000 <outer>:
 8000000:\tpush\t{r4, lr}
 8000002:\tmovs\tr4, #5
 8000004:\tmovs\tr3, #0
 8000006:\tadds\tr3, #1
 8000008:\tadds\tr2, #1
 800000a:\tbne.n\t8000008 <outer+0x8>
 800000c:\tbne.n\t8000006 <outer+0x6>
 800000e:\tcbz\tr0, 8000016 <outer+0x16>
 8000010:\tbl\t8000020 <leaf>
 8000014:\tpop\t{r4, pc}
 8000016:\tbl\t8000030 <table>
 800001a:\tpop\t{r4, pc}

08000020 <leaf>:
 8000020:\tadds\tr0, #1
 8000022:\tbx\tlr

08000030 <table>:
 8000030:\tcmp\tr0, #2
 8000032:\ttbb\t[pc, r0]
 8000036:\t.short\t0x0302
 8000038:\t.byte\t0x05
 8000039:\t.byte\t0x00
 800003a:\tb.n\t8000040 <table+0x10>
 800003c:\tadds\tr0, #1
 800003e:\tadds\tr0, #1
 8000040:\tbx\tlr
"""
LOOPS = {"outer": (4, 7)}
OUTER = 3 + 4 * (1 + 7 * 2 + 1) + 1 + (1 + (2 + 3)) + 1  # by the table's longest case


def toy(code: str = TOY, loops: dict[str, tuple[int, ...]] | None = None) -> int:
    return int(report.measure(code.splitlines(), ["outer"], LOOPS if loops is None else loops)["outer"])


def test_a_toy_has_the_bound_that_is_counted_by_hand() -> None:
    assert toy() == OUTER


def test_a_longer_loop_and_a_longer_callee_raise_it() -> None:
    assert toy(loops={"outer": (5, 7)}) == OUTER + 16
    assert toy(loops={"outer": (4, 8)}) == OUTER + 4 * 2
    planted = TOY.replace(
        " 8000040:\tbx\tlr", " 8000040:\tsubs\tr1, #1\n 8000042:\tbne.n\t8000040 <table+0x10>\n 8000044:\tbx\tlr"
    )
    with pytest.raises(report.Refused, match="table: 1 loops, but bounds of 0"):
        toy(planted)
    assert toy(planted, {**LOOPS, "table": (100,)}) == OUTER + 200


@pytest.mark.parametrize(
    ("line", "instead", "why"),
    [
        ("bl\t8000020 <leaf>", "bl\t8000000 <outer>", "recursion: outer"),
        ("bl\t8000020 <leaf>", "blx\tr3", "where no function is"),
        ("bl\t8000020 <leaf>", "mov\tpc, r3", "a jump that is not understood"),
        ("cmp\tr0, #2", "nop", "table: a table of unknown length"),
        ("bne.n\t8000006", "bne.n\t8000004", None),
        ("bne.n\t8000006", "beq.n\t800000e", "outer: 1 loops, but bounds of 2"),
        ("movs\tr4, #5", "cbz\tr4, 8000008 <outer+0x8>", "outer: a loop with 2 entries"),
    ],
)
def test_what_has_no_bound_is_refused(line: str, instead: str, why: str | None) -> None:
    assert line in TOY
    changed = TOY.replace(line, instead)
    if why is None:
        assert toy(changed) == OUTER + 4 - 1  # one instruction more in the loop, one less before it
    else:
        with pytest.raises(report.Refused, match=why):
            toy(changed)


def test_what_is_not_reached_may_be_anything() -> None:
    assert toy(TOY + "\n08000050 <other>:\n 8000050:\tldr.w\tpc, [r2, r3, lsl #2]\n") == OUTER


def test_a_bound_of_no_loop_is_refused() -> None:
    with pytest.raises(report.Refused, match="gone"):
        toy(loops={**LOOPS, "gone": (3,)})


@pytest.mark.skipif(not image().is_file(), reason="the ARM images are not built (no ARM cross compiler)")
def test_the_images_bound_lies_above_what_was_found_but_not_far() -> None:
    found = bounds(image())
    firmware = Firmware.open()
    longest = load(Path(__file__).parent / "longest.json")
    [counted] = count_all([build(longest, bases(firmware, (longest.base,)), firmware)], firmware)
    assert counted["drive"].max() < found["terrapin_step_drive"]
    assert counted["think"].max() < found["terrapin_step_think"]
    steps = counted["drive"].astype(int) + counted["think"]
    assert sum(found.values()) <= TIMES * steps.max()
    more = {**report.LOOPS, "ground_nearest": (100,)}
    planted = report.measure(disassembly(image()), list(HALVES), more)
    assert planted["terrapin_step_think"] > found["terrapin_step_think"] + 500
