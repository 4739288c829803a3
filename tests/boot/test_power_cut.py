"""Power fails in every single write and erase of an update, in five ways each: never a brick, always old or new.

After each cut the next start is cut too, at each of its own writes and erases, before one is left alone. What is
counted is printed; a case is named (cut, way), so that it can be run again.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest
from bootlib import CUTS, Chip, send
from kit import KEY, NEXT_KEY, NEXT_PUBLIC, PUBLIC, image

REVOKING = image("b", "1.1.0", counter=2, size=64, key=NEXT_KEY, revokes=KEY)
OLD, NEW = image("a", "1.0.0", counter=1, size=64), image("b", "1.1.0", counter=2, size=64)


def before_update(records: int = 0) -> Chip:
    """A chip that runs 1.0.0 from A, with so many records more in its log."""
    chip = Chip(PUBLIC)
    chip.put("a", OLD)
    assert chip.start() == "a"
    assert chip.confirm()
    for _ in range(records):
        assert chip.lib.terrapin_records_append(chip.flash, chip.record())
    return chip


def life(chip: Chip) -> None:
    """The update, the start, the confirmation; power may fail anywhere in it."""
    if send(chip, NEW, "b") == "ok" and chip.start() == "b":
        chip.confirm()


def fails_at(chip: Chip, cut: int, way: int) -> None:
    chip.memory.operations, chip.memory.cut_at, chip.memory.cut = 0, cut, way
    chip.memory.random = 1 + (cut * 2654435761 + way) % 0xFFFFFFFE


def check_whole(chip: Chip, name: object) -> str:
    """Start with power that stays: the old or the new runs, confirms itself, and takes the update (again)."""
    chip.power_on()
    started = chip.start()
    assert started in ("a", "b"), name
    version = chip.choice.image.version
    assert (started, version.major, version.minor) in (("a", 1, 0), ("b", 1, 1)), name
    assert chip.confirm(), name
    assert chip.start() == started, name
    if started == "a":
        assert send(chip, NEW, "b") == "ok", name
        assert chip.start() == "b", name
        assert chip.confirm(), name
    assert chip.start() == "b", name
    return started


def every_cut(
    chip: Chip, way: int, act: Callable[[Chip], None], check: Callable[[Chip, object], str]
) -> dict[str, int]:
    """How many lives end with the old image ("a") and the new ("b"), power failing at each write and erase of `act`."""
    fresh = chip.contents()
    fails_at(chip, 0xFFFFFFFF, way)
    act(chip)
    operations = chip.memory.operations
    ended = {"a": 0, "b": 0}
    for cut in range(operations):
        chip.restore(fresh)
        assert chip.start() == "a"
        fails_at(chip, cut, way)
        act(chip)
        assert chip.memory.off, cut
        ended[check(chip, (cut, way))] += 1
    print(f"{CUTS[way]}: {operations} cuts, {ended['a']} ended with the old image, {ended['b']} with the new, 0 bricks")
    return ended


@pytest.mark.parametrize("way", range(len(CUTS)), ids=CUTS)
def test_every_write_and_erase(way: int) -> None:
    ended = every_cut(before_update(), way, life, check_whole)
    assert sum(ended.values()) > 170  # the erase, the image's words, three records of eight words
    assert ended["a"] > 100
    assert ended["b"] > 0


@pytest.mark.parametrize("way", [CUTS.index("torn"), CUTS.index("noise")], ids=["torn", "noise"])
def test_the_start_after_a_cut_is_cut_too(way: int) -> None:
    """Cuts in the records (before and after the image's words), and in each operation of the start that follows."""
    chip = before_update()
    fresh = chip.contents()
    life(chip)
    chip.restore(fresh)
    chip.start()
    fails_at(chip, 0xFFFFFFFF, way)
    life(chip)
    operations = chip.memory.operations
    seconds = 0
    for cut in range(operations - 25, operations):
        for second in range(64):
            chip.restore(fresh)
            assert chip.start() == "a"
            fails_at(chip, cut, way)
            life(chip)
            chip.power_on()
            fails_at(chip, second, way)
            if chip.start() in ("a", "b"):
                chip.confirm()
            if not chip.memory.off:
                break
            seconds += 1
            check_whole(chip, (cut, second, way))
    assert seconds > 100
    print(f"{CUTS[way]}: {seconds} second cuts, 0 bricks")


@pytest.mark.parametrize("way", range(len(CUTS)), ids=CUTS)
@pytest.mark.parametrize("used", [503, 504, 505, 508, 511])
def test_a_page_of_records_is_full(used: int, way: int) -> None:
    """The change of pages is cut at its erase and at each of its words; the state is the one before."""
    chip = before_update(used - 1)
    full = chip.contents()
    chip.memory.operations = 0
    chip.start()
    for cut in range(chip.memory.operations):
        chip.restore(full)
        fails_at(chip, cut, way)
        chip.start()
        assert chip.memory.off
        check_whole(chip, (used, cut, way))


@pytest.mark.parametrize("confirms", [True, False], ids=["confirmed at its last try", "given up"])
@pytest.mark.parametrize("way", range(len(CUTS)), ids=CUTS)
def test_every_write_of_three_tries(way: int, confirms: bool) -> None:
    """A trial's three starts and its confirmation, or its end: each of their writes is cut."""

    def tries(chip: Chip) -> None:
        started = [chip.start() for _ in range(3 if confirms else 4)]
        if confirms and started[-1] == "b":
            chip.confirm()

    chip = before_update()
    assert send(chip, NEW, "b") == "ok"
    fresh = chip.contents()
    fails_at(chip, 0xFFFFFFFF, way)
    tries(chip)
    operations = chip.memory.operations
    assert operations == 4 * 8  # four records of eight words
    for cut in range(operations):
        chip.restore(fresh)
        fails_at(chip, cut, way)
        tries(chip)
        assert chip.memory.off, cut
        check_whole(chip, (cut, way))


def before_revocation(sent: bool = False) -> Chip:
    """A chip with two keys that runs 1.0.0 of the first from A; `sent`: the image that revokes it waits in B."""
    chip = Chip(PUBLIC, NEXT_PUBLIC)
    chip.put("a", OLD)
    assert chip.start() == "a"
    assert chip.confirm()
    assert not sent or send(chip, REVOKING, "b") == "ok"
    return chip


def tried(chip: Chip) -> None:
    """The trial, the confirmation, and the start that revokes."""
    if chip.start() == "b" and chip.confirm():
        chip.start()


def check_revoked(chip: Chip, name: object) -> str:
    """Start with power that stays: the old key counts until the new image is confirmed, and never again once it is
    revoked; in the end it is."""
    chip.power_on()
    revoked = chip.record().revoked
    started = chip.start()
    assert started in ("a", "b"), name
    assert (chip.check("a") == "revoked_key") == (chip.record().revoked == 1), name
    if revoked:
        assert started == "b", name
    if started == "a":
        assert chip.record().revoked == 0, name
        assert send(chip, REVOKING, "b") == "ok", name
        assert chip.start() == "b", name
    assert chip.confirm(), name
    assert chip.start() == "b", name
    assert chip.record().revoked == 1, name
    assert chip.check("a") == "revoked_key", name
    assert chip.start() == "b", name
    return started


@pytest.mark.parametrize("way", range(len(CUTS)), ids=CUTS)
def test_every_write_of_a_revocation(way: int) -> None:
    """From the update's erase to the record that revokes the key of the image before."""

    def revocation(chip: Chip) -> None:
        if send(chip, REVOKING, "b") == "ok":
            tried(chip)
            assert chip.memory.off or chip.record().revoked == 1

    ended = every_cut(before_revocation(), way, revocation, check_revoked)
    assert sum(ended.values()) > 180  # as an update, and one record more
    assert ended["a"] > 100
    assert ended["b"] >= 24


@pytest.mark.parametrize("record", range(3), ids=["trial", "confirmed", "revoked"])
@pytest.mark.parametrize("way", [CUTS.index("torn"), CUTS.index("noise")], ids=["torn", "noise"])
def test_the_start_after_a_cut_revocation_is_cut_too(way: int, record: int) -> None:
    chip = before_revocation(sent=True)
    fresh = chip.contents()
    fails_at(chip, 0xFFFFFFFF, way)
    tried(chip)
    assert chip.memory.operations == 3 * 8
    seconds = 0
    for cut in range(8 * record, 8 * record + 8):
        for second in range(64):
            chip.restore(fresh)
            fails_at(chip, cut, way)
            tried(chip)
            chip.power_on()
            fails_at(chip, second, way)
            tried(chip)
            if not chip.memory.off:
                break
            seconds += 1
            check_revoked(chip, (cut, second, way))
    assert seconds > 50
    print(f"{CUTS[way]}: {seconds} second cuts, 0 bricks")
