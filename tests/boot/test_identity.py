"""Who takes what was made for another robot, board or interface: boot loader, flash, run and monitor refuse it."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from terrapin_hil import paths
from terrapin_hil.errors import UserError
from terrapin_hil.links import LinkName
from terrapin_hil.links.identity import require_fitting
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.link import LinkError
from terrapin_hil.links.slcan import ControllerProcess
from terrapin_hil.messages import Frame, Sender, crc8, interface
from terrapin_interface.robot import find_robot, identity_of, load_robot
from terrapin_tools.flash.image import MADE, ImageError, Version, parse, sign
from terrapin_tools.flash.layout import BASE
from terrapin_tools.flash.plan import plan
from terrapin_tools.flash.update import MadeFor, SignedFile, _require_fit, robot_name, update
from terrapin_tools.logs.frames import Frames, frames
from terrapin_tools.monitor import sources
from tests.boot.bootlib import SLOT, Chip, send
from tests.boot.kit import KEY, PUBLIC, code

CYLINDER, SPHERE = identity_of("cylinder"), identity_of("sphere")
BOARD = load_robot(find_robot("cylinder")).board.number
VERSION = interface().version
RIGHT = {"robot": CYLINDER, "board": BOARD, "interface": VERSION}
WRONG = {"robot": {"robot": SPHERE}, "board": {"board": BOARD + 1}, "interface": {"interface": VERSION + 1}}


def image(slot: str, version: str, robot: int, board: int, interface: int, replaces: int = 0) -> bytes:
    made = code(slot, 600, version) + MADE + struct.pack("<II", robot | board << 24, interface)
    return sign(made, KEY, Version.of(version), 1, slot, replaces=replaces)


def controller() -> Chip:
    """A cylinder's: its first image was confirmed, and the boot loader serves."""
    chip = Chip(PUBLIC)
    chip.boot.board = BOARD
    chip.put("a", image("a", "1.0.0", **RIGHT))
    assert chip.start() == "a"
    assert chip.record().robot == 0
    assert chip.confirm()
    assert chip.record().robot == CYLINDER
    chip.lib.terrapin_update_init(chip.update, chip.boot, 0)
    chip.running = 0
    return chip


def file(slot: str, version: str, **made: int) -> SignedFile:
    data = image(slot, version, **made)
    return SignedFile("new.bin", parse(data), data)


class ChipWire:
    """A wire to the boot loader of a chip."""

    name = "chip"

    def __init__(self, chip: Chip) -> None:
        self.chip, self.heard, self.sent = chip, list[Frame](), list[int]()

    def wake(self) -> None:
        pass

    def send(self, batch: Sequence[Frame]) -> None:
        for identifier, data in batch:
            self.sent.append(identifier)
            self.heard += self.chip.accept(identifier, data)

    def receive(self, seconds: float) -> list[Frame]:
        found, self.heard = self.heard, []
        return found

    def close(self) -> None:
        pass


@pytest.mark.parametrize("what", WRONG)
def test_the_boot_loader_refuses(what: str) -> None:
    chip = controller()
    wrong = image("b", "1.1.0", **{**RIGHT, **WRONG[what]})
    assert send(chip, wrong, "b") == f"wrong_{what}"
    chip.put("b", wrong)
    assert chip.check("b") == f"wrong_{what}"
    assert chip.start() == "a"


def test_the_boot_loader_accepts() -> None:
    chip = controller()
    assert send(chip, image("b", "1.1.0", **RIGHT), "b") == "ok"
    assert chip.start() == "b"
    assert chip.confirm()


def test_an_image_that_names_no_robot_is_for_a_controller_without_one() -> None:
    assert send(controller(), nameless(), "b") == "wrong_robot"
    blank = Chip(PUBLIC)
    assert send(blank, nameless(), "b") == "ok"


@pytest.mark.parametrize("what", WRONG)
def test_flash_refuses_before_anything_is_erased(what: str) -> None:
    chip = controller()
    wire = ChipWire(chip)
    with pytest.raises(
        UserError,
        match={
            "robot": "made for sphere, the controller is that of cylinder; --change-robot",
            "board": "made for board emulated, expected f405_h_bridge",
            "interface": f"interface version {VERSION + 1}, expected {VERSION}",
        }[what],
    ):
        update(wire, [file("b", "1.1.0", **{**RIGHT, **WRONG[what]})], lambda *_: None)  # type: ignore[arg-type]
    assert interface().messages["UPDATE_BEGIN"].id not in wire.sent


@pytest.mark.parametrize("robot", ["cylinder", "sphere"])
def test_flash_accepts(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The right image; that of another robot with one option, if it is signed to replace this one."""
    monkeypatch.setattr("terrapin_tools.flash.update.START", 0.0)
    monkeypatch.setattr("terrapin_tools.flash.update._started", lambda *_: "confirmed")
    chip = controller()
    right = file("b", "1.1.0", **{**RIGHT, "robot": identity_of(robot)}, replaces=CYLINDER)
    outcome = update(ChipWire(chip), [right], lambda *_: None, robot != "cylinder")  # type: ignore[arg-type]
    assert outcome.slot == "b"
    assert chip.record().robot == CYLINDER
    assert chip.start() == "b"
    assert chip.confirm()
    assert chip.record().robot == identity_of(robot)
    assert chip.start() == "b"


def test_another_robot_needs_the_option_the_signature_and_a_boot_loader_that_knows_it() -> None:
    sphere = {**RIGHT, "robot": SPHERE}
    for replaces, change, expected in (
        (CYLINDER, False, "--change-robot makes it another's"),
        (0, True, "may take its place: `terrapin image sign --replaces cylinder`"),
        (7, True, "may take its place: `terrapin image sign --replaces cylinder`"),
    ):
        wire = ChipWire(controller())
        with pytest.raises(UserError, match=expected):
            update(wire, [file("b", "1.1.0", **sphere, replaces=replaces)], lambda *_: None, change)  # type: ignore[arg-type]
        assert interface().messages["UPDATE_BEGIN"].id not in wire.sent
    there = MadeFor(CYLINDER, BOARD, VERSION)
    with pytest.raises(UserError, match="boot loader is too old for another robot's image; --via swd writes both"):
        _require_fit(file("b", "1.1.0", **sphere, replaces=CYLINDER), there, True, 1)


@pytest.mark.parametrize("wrong", [{"replaces": 0}, {"replaces": SPHERE}, {"replaces": 1}, {"robot": 0}])
def test_only_what_replaces_this_robot_starts_in_its_place(wrong: dict[str, int]) -> None:
    chip = controller()
    made = {**RIGHT, "robot": SPHERE, "replaces": CYLINDER, **wrong}
    if made["robot"]:
        assert send(chip, image("b", "1.1.0", **made), "b") == "wrong_robot"
    chip.put("a", b"")  # not even when nothing else is left
    chip.put("b", image("b", "1.1.0", **made) if made["robot"] else nameless())
    assert chip.start() == ""


def nameless() -> bytes:
    return sign(code("b", 600, "1.1.0"), KEY, Version.of("1.1.0"), 1, "b")


def test_what_replaces_another_robot_says_which_it_is() -> None:
    with pytest.raises(ImageError, match="does not say which robot"):
        sign(code("b", 600, "1.1.0"), KEY, Version.of("1.1.0"), 1, "b", replaces=CYLINDER)


def test_a_robot_that_is_not_confirmed_leaves_the_old_one() -> None:
    """Three starts on trial, none confirmed: the cylinder's image and identity are as they were."""
    chip = controller()
    assert send(chip, image("b", "1.1.0", **{**RIGHT, "robot": SPHERE}, replaces=CYLINDER), "b") == "ok"
    assert [chip.start() for _ in range(4)] == ["b", "b", "b", "a"]
    assert (chip.record().robot, chip.record().confirmed) == (CYLINDER, SLOT["a"])


def test_the_robot_of_a_controller_survives_a_reset_and_its_updates() -> None:
    chip = controller()
    chip.lib.terrapin_records_set_node(chip.flash, 3)
    assert (chip.record().robot, chip.record().node) == (CYLINDER, 3)
    before = chip.contents()
    answer = chip.ask(written(SPHERE))
    assert (answer["robot"], answer["board"], answer["interface"]) == (CYLINDER, BOARD, VERSION)
    assert chip.contents() == before
    assert chip.start() == "a"


def written(robot: int) -> Frame:
    """UPDATE_ROBOT with `write`, as it once was taken."""
    identifier, data = Sender().frame("UPDATE_ROBOT", {})
    body = (robot | 1 << 24).to_bytes(6, "little") + data[6:7]
    return identifier, body + bytes([crc8(identifier.to_bytes(2, "little") + body)])


def identity(**changes: int) -> Frame:
    """What the firmware of this build says, with fields changed."""
    message = interface().messages["IDENTITY"]
    link = InProcess()
    found = link.ask(Sender().frame("IDENTITY_READ", {"part": 0}), lambda frame: frame[0] == message.id)
    link.close()
    assert found is not None
    return message.id, message.encode({**message.decode(found[1]), **changes})[0]


# What a controller says that is another robot's, on another board, of another interface
SAID: dict[str, tuple[dict[str, int], str]] = {
    "robot": ({"robot": SPHERE}, "the controller is that of sphere, expected cylinder; --robot says whose"),
    "board": ({"board": 77}, "the controller is on board 77, expected f405_h_bridge, which cylinder.toml names"),
    "interface": ({"interface": 7}, "the controller speaks interface .*000007, expected"),
}


@pytest.mark.parametrize("what", SAID)
def test_run_refuses(what: str) -> None:
    changes, expected = SAID[what]
    with pytest.raises(LinkError, match=expected):
        require_fitting("bus", lambda frame, wanted: identity(**changes))


@pytest.mark.parametrize("board", [0, BOARD])
def test_run_accepts(board: int) -> None:
    require_fitting("bus", lambda frame, wanted: identity(board=board))


def test_run_refuses_what_says_nothing() -> None:
    with pytest.raises(LinkError, match="does not say what it was built for"):
        require_fitting("bus", lambda frame, wanted: None)


def test_the_command_asks_a_real_controller() -> None:
    """The sphere's controller on a pty, and a command line that has the cylinder in mind."""
    from terrapin_tools.commands.run import _opened

    program = paths.simulator().parent / "robots" / "sphere" / "host" / "terrapin-controller"
    if not program.is_file():
        pytest.skip("the sphere's controller is not built (tests/tools/build.sh robot=sphere host)")
    process = ControllerProcess(program, ())
    path = process.start()
    try:
        link = LinkName.parse(f"serial:{path}", "lockstep")
        with pytest.raises(LinkError, match="that of sphere, expected cylinder"), _opened(link, None, None):
            pass
    finally:
        process.stop()


class Heard:
    """A bus on which a controller has answered."""

    lost = damaged = 0

    def __init__(self, answer: Frame | None) -> None:
        self.answer, self.sent = answer, list[int]()

    def receive(self, wait: float) -> Frames:
        if self.answer is None or not self.sent:
            return frames(Path("bus"), [], [], [], [])
        (identifier, data), self.answer = self.answer, None
        return frames(Path("bus"), [0.0], [identifier], [data], [0])

    def send(self, identifier: int, data: bytes) -> None:
        self.sent.append(identifier)

    def shutdown(self) -> None:
        pass


def watched(answer: Frame | None, monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    monkeypatch.setattr("terrapin_tools.logs.bus.open_bus", lambda link, bitrate, *more: Heard(answer))
    bus: Any = sources.Bus(LinkName.parse("socketcan:can0"), 500_000)

    def ask() -> None:
        try:
            bus.require_fitting()
        finally:
            bus.close()

    return ask


@pytest.mark.parametrize("what", SAID)
def test_the_monitor_refuses(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    changes, expected = SAID[what]
    with pytest.raises(LinkError, match=expected):
        watched(identity(**changes), monkeypatch)()


@pytest.mark.parametrize("silent", [False, True])
def test_the_monitor_accepts(silent: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    watched(None if silent else identity(board=BOARD), monkeypatch)()


def test_what_a_probe_writes_has_the_images_robot() -> None:
    """From the first start on, before an image is confirmed; with the node number beside it."""
    chip = Chip(PUBLIC)
    chip.boot.board = BOARD
    for address, data in plan([file("a", "1.0.0", **RIGHT)], None, node=5).write:
        chip.ffi.buffer(chip.bytes)[address - BASE : address - BASE + len(data)] = data
    assert (chip.record().robot, chip.record().node) == (CYLINDER, 5)
    assert chip.start() == "a"
    chip.lib.terrapin_update_init(chip.update, chip.boot, 0)
    chip.running = 0
    with pytest.raises(UserError, match="made for sphere, the controller is that of cylinder"):
        update(ChipWire(chip), [file("b", "1.1.0", **{**RIGHT, "robot": SPHERE})], lambda *_: None)  # type: ignore[arg-type]


@pytest.mark.parametrize("what", ["robot", "board"])
def test_images_of_two_robots_or_boards_are_not_written_together(what: str) -> None:
    with pytest.raises(UserError, match=r"made for another robot or board than new\.bin"):
        plan([file("a", "1.0.0", **RIGHT), file("b", "1.0.0", **(RIGHT | WRONG[what]))], None)


def test_a_robot_of_ones_own_is_named_where_its_file_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    number = identity_of("somebodys_rover")
    assert robot_name(number) == f"robot 0x{number:06x}"
    (tmp_path / "somebodys_rover.toml").touch()
    monkeypatch.chdir(tmp_path)
    assert robot_name(number) == "somebodys_rover"
