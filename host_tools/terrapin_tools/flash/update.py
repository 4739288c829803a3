"""The host's side of an update through the project's own boot loader (firmware/boot/update.h), over any wire.

An application answers queries and resets into the boot loader; that takes the image into the slot that is not
confirmed, verifies it, starts it on trial, and the application confirms itself. One block of 256 bytes is under way at
a time; what is lost, or whose answer is lost, is sent again.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from terrapin_hil import paths
from terrapin_hil.links.seal import LinkKey, seal_link, takes_changes
from terrapin_hil.messages import Frame, Sender, interface
from terrapin_interface.robot import identity_of, robots
from terrapin_tools.errors import UserError
from terrapin_tools.flash.image import Image, Version
from terrapin_tools.flash.wire import Told, Wire

__all__ = ["Controller", "Outcome", "SignedFile", "query", "update"]


BLOCK = 256
PROTOCOL = 2  # 1: older boot loaders, which asked for no signature before they erased
ANNOUNCED = 144  # bytes at the end of an image: SHA-256, key, signature
ASK_EVERY = 0.03  # s, so that the boot loader's 100 ms are not missed
ANSWER = 3.0  # s for a controller to answer at all
ERASE = 8.0  # s: 128 kB take 2 s at most, and as much again when another slot's record is dropped first
BLOCK_ANSWER = 1.0  # s; writing takes 7 ms at most
VERIFY = 12.0  # s: on 16 MHz, and an erase when it fails
START = 1.0  # s in which the boot loader, just reset, is not asked: it would stay
CONFIRM = 10.0  # s; 5 s of health, and the start
LATE = 0.02  # s in which an answer to what was sent twice comes
TRIES = 8  # of one block
REQUESTS = 3  # of any other request that is not answered
ALONE = 0.1  # s in which all answers to one query come; the first takes 15 ms at most

REASONS = {
    "motor_on": "the motor is on; stop it first",
    "slot_in_use": "the slot is in use: its image runs or is confirmed",
    "too_large": "the image does not fit the slot",
    "version_too_old": "the version is older than the one confirmed before the present one",
    "flash": "the flash refused to be written",
    "sequence": "blocks came out of order",
    "not_an_image": "what arrived is no image for this boot loader",
    "wrong_slot": "the image is linked for the other slot",
    "wrong_key": "the image is signed with a key that the boot loader does not know",
    "revoked_key": "the image is signed with a key that is revoked; `terrapin image sign --key` with the other one",
    "corrupted": "the image arrived damaged",
    "bad_signature": "the image is not signed, or its signature is forged",
    "counter_too_low": "the security counter is lower than that of the image confirmed before the present one",
    "desk_image": "a desk image, which this release refuses; expected a production image, or one signed with --unit",
    "busy": "a slot was erased just now; wait 10 s (or, after 20 times, reset the controller)",
    "wrong_robot": "the image is made for another robot, and not signed to replace this one",
    "wrong_board": "the image is made for another board",
    "wrong_interface": "the image has another version of the interface than the boot loader",
    "boot_loader_only": "the application leaves updates to the boot loader",
}


@dataclass(frozen=True)
class SignedFile:
    """An image and where it came from."""

    name: str
    image: Image
    data: bytes


@dataclass(frozen=True)
class Controller:
    """What a controller answers to a query. Slots are "a", "b" or "" (running: the boot loader; others: none)."""

    running: str
    confirmed: str
    candidate: str
    phase: str
    version: Version  # that an update needs at least
    security_counter: int
    keys: tuple[bytes, ...]  # first two bytes of the hash of each key that the boot loader takes
    revoked: bytes = b""  # and of the one that it takes no more
    protocol: int = PROTOCOL


@dataclass(frozen=True)
class MadeFor:
    """Whose images a boot loader takes: robot_identity (0: of whichever is confirmed first), board, interface."""

    robot: int
    board: int
    interface: int


@dataclass(frozen=True)
class Outcome:
    """Of an update: the slot, and what is known of the start after it."""

    slot: str
    state: str  # "confirmed", "on trial", "silent": no answer that tells
    revoked: bool = False  # the key that the image revokes counts no more


def _slot(number: int) -> str:
    return {1: "a", 2: "b"}.get(number, "")


def _heard(wire: Wire, seconds: float) -> Iterator[Frame]:
    """What comes within `seconds`, and after them what has come already."""
    end = time.monotonic() + seconds
    while frames := wire.receive(max(0.0, end - time.monotonic())):
        yield from frames


def _ask(wire: Wire, sender: Sender, seconds: float) -> Controller | None:
    """Ask until there is an answer, `seconds` at most."""
    messages, enums = interface().messages, interface().enums
    info: dict[str, int] = {}
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        wire.wake()
        wire.send([sender.frame("UPDATE_QUERY", {"protocol": PROTOCOL})])
        for identifier, data in _heard(wire, ASK_EVERY):
            if identifier == messages["UPDATE_INFO"].id and len(data) == messages["UPDATE_INFO"].length:
                info = messages["UPDATE_INFO"].decode(data)
            elif identifier == messages["UPDATE_FLOOR"].id and info and len(data) == 8:
                least = messages["UPDATE_FLOOR"].decode(data)
                if not 1 <= info["protocol"] <= PROTOCOL:
                    raise UserError(
                        f"{wire.name}: speaks update protocol {info['protocol']}, expected 1 to {PROTOCOL}; a newer "
                        "`terrapin flash` knows it"
                    )
                phases = {number: name for name, number in enums["update_phase"].items()}
                names = [(least[name] & 0xFFFF).to_bytes(2, "little") for name in ("key", "next_key")]
                counting = [name for place, name in enumerate(names, 1) if place != info["revoked"]]
                return Controller(
                    running=_slot(info["running"]),
                    confirmed=_slot(info["confirmed"]),
                    candidate=_slot(info["candidate"]),
                    phase=phases.get(info["phase"], "none"),
                    version=Version(info["major"], info["minor"], info["revision"]),
                    security_counter=least["security_counter"],
                    keys=tuple(dict.fromkeys(counting)),
                    revoked=names[info["revoked"] - 1] if info["revoked"] in (1, 2) else b"",
                    protocol=info["protocol"],
                )
    return None


def query(wire: Wire, seconds: float = ANSWER) -> Controller:
    """What the controller says of itself. UserError when it does not answer."""
    sender = Sender()
    found = _ask(wire, sender, seconds)
    if found is None:
        # A running motor leaves no time to answer a query; a block out of turn is refused with the reason.
        answer = _request(wire, [sender.frame("UPDATE_BLOCK", {})], "block", min(seconds, BLOCK_ANSWER))
        if answer is not None and answer[0] == "motor_on":
            raise UserError(f"{wire.name}: {REASONS['motor_on']}")
        raise UserError(
            f"{wire.name}: no controller answers; expected one with power and its boot loader or an application that "
            f"serves updates, at this bit rate",
            status=1,
        )
    return found


def _require_alone(wire: Wire, sender: Sender) -> None:
    """UserError when two controllers answer to one node number: both would take each block.

    A query that is sent once has one answer of each. Two of three queries decide: an answer may be lost, or come twice.
    """
    identifier = interface().messages["UPDATE_INFO"].id
    counts: list[int] = []
    for _ in range(REQUESTS):
        for _ in _heard(wire, LATE):
            pass  # answers to the queries before
        wire.send([sender.frame("UPDATE_QUERY", {"protocol": PROTOCOL})])
        counts.append(sum(frame[0] == identifier for frame in _heard(wire, ALONE)))
        if sum(count > 1 for count in counts) == 2:
            raise UserError(
                f"{wire.name}: found {max(counts)} controllers with this node number, expected one; `terrapin node "
                "set` gives one another, and one without an application is taken off the bus"
            )
        if sum(count <= 1 for count in counts) == 2:
            return


def _request(
    wire: Wire, frames: Sequence[Frame], request: str, seconds: float, beyond: int = -1
) -> tuple[str, int] | None:
    """Send frames whose last is answered: the result's name and the block that is expected next; None: no answer.

    An `ok` that expects no block after `beyond` answers an earlier request, which was sent twice, and is passed over.
    """
    status, enums = interface().messages["UPDATE_STATUS"], interface().enums
    wire.send(frames)
    for identifier, data in _heard(wire, seconds):
        if identifier == status.id and len(data) == status.length:
            values = status.decode(data)
            if values["request"] == enums["update_request"][request]:
                names = {number: name for name, number in enums["update_result"].items()}
                result = names.get(values["result"], f"result {values['result']}")
                if result != "ok" or values["next"] > beyond:
                    return result, values["next"]
    return None


def _asked(wire: Wire, frames: Sequence[Frame], request: str, seconds: float, name: str) -> bool:
    """A request, the last of the frames, that must not be refused; whether it was answered, and arrived whole."""
    answer = _request(wire, frames, request, seconds)
    if answer is not None and answer[0] == "again":
        return False
    if answer is not None and answer[0] != "ok":
        raise UserError(f"{name}: refused: {REASONS.get(answer[0], answer[0])}")
    return answer is not None


def _silent(wire: Wire, request: str) -> UserError:
    return UserError(f"{wire.name}: the controller stopped answering ({request})", status=1)


def _demand(
    wire: Wire,
    sender: Sender,
    request: str,
    values: dict[str, int],
    seconds: float,
    name: str,
    before: Sequence[Frame] = (),
) -> None:
    """BEGIN, with what comes `before` it, or END, which must succeed. Sent again when the answer does not come: the
    boot loader knows it again."""
    for _ in range(REQUESTS):
        if _asked(wire, [*before, sender.frame(f"UPDATE_{request.upper()}", values)], request, seconds, name):
            return
        wire.wake()
    raise _silent(wire, request)


def _reset(wire: Wire, sender: Sender, values: dict[str, int], name: str, done: Callable[[Controller], bool]) -> None:
    """RESET. Without an answer the controller is asked first whether it is `done`: another reset of an image on trial
    would end its trial."""
    key = int(sender.interface.constants["update_reset_key"])
    for _ in range(REQUESTS):
        if _asked(wire, [sender.frame("UPDATE_RESET", {"key": key} | values)], "reset", BLOCK_ANSWER, name):
            return
        found = _ask(wire, sender, ANSWER)
        if found is not None and done(found):
            return
    if wire.session is None and not takes_changes(wire):
        raise UserError(
            f"{wire.name}: the controller takes no reset without its link key; expected --link-key LINK.key", status=1
        )
    raise _silent(wire, "reset")


def _reset_application(
    wire: Wire,
    sender: Sender,
    values: dict[str, int],
    name: str,
    done: Callable[[Controller], bool],
    key: LinkKey | None,
) -> None:
    """RESET of an application, which wants it sealed when it has a link key. What answers after it is unsealed: the
    boot loader, or another session's application."""
    if key is not None:
        seal_link(wire, key)
    try:
        _reset(wire, sender, values, name, done)
    finally:
        wire.session = None


def robot_name(identity: int) -> str:
    """A robot by its identity: shipped, built in these sources, or with a file here; else the number.

    >>> robot_name(0x1ebf42), robot_name(1)
    ('cylinder', 'robot 0x000001')
    """
    sources = paths.firmware_sources()
    built = [] if sources is None else [folder.name for folder in (sources / "build" / "robots").glob("*")]
    names = (*(path.stem for path in Path().glob("*.toml")), *built, *robots())
    return {identity_of(name): name for name in names}.get(identity, f"robot 0x{identity:06x}")


def _made_for(wire: Wire, sender: Sender) -> MadeFor | None:
    """Whose images the boot loader takes. None: it knows nothing of robots."""
    answer = interface().messages["UPDATE_IDENTITY"]
    for _ in range(REQUESTS):
        wire.send([sender.frame("UPDATE_ROBOT", {})])
        for identifier, data in _heard(wire, BLOCK_ANSWER):
            if identifier == answer.id and len(data) == answer.length:
                found = answer.decode(data)
                return MadeFor(found["robot"], found["board"], found["interface"])
    return None


def _require_robot(file: SignedFile, robot: int, change_robot: bool, protocol: int) -> None:
    image = file.image
    made = robot_name(image.robot) if image.robot else "no robot that it names"
    begins = f"{file.name}: made for {made}, the controller is that of {robot_name(robot)}; "
    if not change_robot:
        raise UserError(begins + "--change-robot makes it another's")
    if protocol < PROTOCOL:
        raise UserError(begins + "its boot loader is too old for another robot's image; --via swd writes both")
    if image.replaces != robot:
        name = robot_name(robot).removeprefix("robot ")
        raise UserError(begins + f"expected an image that may take its place: `terrapin image sign --replaces {name}`")


def _require_fit(file: SignedFile, there: MadeFor, change_robot: bool, protocol: int) -> None:
    """UserError when the boot loader would not start the image: before anything is erased."""
    image = file.image
    if there.robot and image.robot != there.robot:
        _require_robot(file, there.robot, change_robot, protocol)
    if image.board and there.board and image.board != there.board:
        names = {number: name for name, number in interface().enums["board"].items()}
        found, expected = names.get(image.board, image.board), names.get(there.board, there.board)
        raise UserError(f"{file.name}: made for board {found}, expected {expected}")
    if image.interface and image.interface != there.interface:
        raise UserError(f"{file.name}: interface version {image.interface}, expected {there.interface}")


def _choose(files: Sequence[SignedFile], controller: Controller) -> SignedFile:
    """The file for the slot that may be written; UserError when it would be refused."""
    fitting = [file for file in files if file.image.slot != controller.confirmed]
    if not fitting:
        other = "b" if controller.confirmed == "a" else "a"
        raise UserError(
            f"{files[0].name}: linked for slot {controller.confirmed}, which is confirmed and stays; expected the "
            f"image for slot {other} (give both files and the right one is taken)"
        )
    file = fitting[0]
    image, least = file.image, controller.version
    if image.key_hash is None or image.signature is None:
        raise UserError(f"{file.name}: not signed; `terrapin image sign` does it")
    if image.key_hash[:2] not in controller.keys:
        taken = " and ".join(f"{name.hex()}..." for name in controller.keys)
        found = f"{file.name}: signed with key {image.key_hash[:4].hex()}"
        if image.key_hash[:2] == controller.revoked:
            raise UserError(f"{found}, which is revoked; `terrapin image sign --key` with the one that counts, {taken}")
        raise UserError(f"{found}, the boot loader knows {taken}")
    if (image.version.major, image.version.minor, image.version.revision) < (least.major, least.minor, least.revision):
        raise UserError(f"{file.name}: version too old: {image.version}, expected {least} or newer")
    if image.security_counter < controller.security_counter:
        raise UserError(
            f"{file.name}: security counter {image.security_counter}, expected {controller.security_counter} or more"
        )
    return file


def _enter_loader(wire: Wire, sender: Sender, name: str, key: LinkKey | None) -> Controller:
    _reset_application(wire, sender, {"stay": 1}, name, lambda found: not found.running, key)
    end = time.monotonic() + ANSWER
    while time.monotonic() < end:
        found = _ask(wire, sender, ANSWER)
        if found is not None and not found.running:
            return found
    raise UserError(f"{wire.name}: the controller did not come back in its boot loader", status=1)


def _data(block: bytes) -> list[Frame]:
    identifier = interface().messages["UPDATE_DATA"].id
    return [(identifier, block[at : at + 8].ljust(8, b"\xff")) for at in range(0, len(block), 8)]


def _announcement(sender: Sender, file: SignedFile) -> list[Frame]:
    """The image's digest and signature, without which nothing is erased. A block of nothing drops what came before."""
    size = file.image.size
    return [sender.frame("UPDATE_BLOCK", {}), *_data(file.data[size - ANNOUNCED : size])]


def _send_blocks(wire: Wire, sender: Sender, data: bytes, told: Told) -> None:
    count = -(-len(data) // BLOCK)
    index = tries = 0
    while index < count:
        block = data[BLOCK * index : BLOCK * (index + 1)]
        frames = _data(block)
        values = {"index": index, "size": len(block), "checksum": zlib.crc32(block)}
        last = index + 1 == count
        beyond = -1 if last else index  # the last one may be a part, which `next` does not count:
        while last and wire.receive(LATE):
            pass  # an answer to the block before, come twice, would be taken for its own
        answer = _request(wire, [*frames, sender.frame("UPDATE_BLOCK", values)], "block", BLOCK_ANSWER, beyond)
        if answer is not None and answer[0] == "ok":
            index, tries = index + 1, 0
            told("writing", min(len(data), BLOCK * index), len(data))
            continue
        tries += 1
        if answer is not None and answer[0] not in ("again", "sequence"):
            raise UserError(f"{wire.name}: refused: {REASONS.get(answer[0], answer[0])}")
        if tries == TRIES:
            reason = "no answer" if answer is None else REASONS.get(answer[0], "it arrives damaged")
            raise UserError(f"{wire.name}: block {index} was sent {TRIES} times: {reason}", status=1)
        if answer is not None and answer[0] == "sequence" and answer[1] != index:
            raise UserError(f"{wire.name}: refused: another host is updating it, or it was reset", status=1)


def update(
    wire: Wire,
    files: Sequence[SignedFile],
    told: Told,
    change_robot: bool = False,
    key: LinkKey | None = None,
) -> Outcome:
    """Put one of the files (one a slot) on the controller. UserError when it or they would not; LinkError for a `key`
    that is not the controller's.

    `change_robot`: an image that replaces the controller's robot may do so; once confirmed, it takes the images of the
    file's robot, and no other's. `key`: the link key
    of the application that runs.
    """
    sender = Sender()
    controller = query(wire)
    _require_alone(wire, sender)
    file = _choose(files, controller)
    if controller.running:
        controller = _enter_loader(wire, sender, file.name, key)
        file = _choose(files, controller)
    image = file.image
    there = _made_for(wire, sender)
    if there is not None:
        _require_fit(file, there, change_robot, controller.protocol)
    data = file.data[: image.size] + b"\xff" * (-image.size % 4)
    told("erasing", 0, len(data))
    begin = {"size": len(data) // 4, "slot": interface().enums["update_slot"][image.slot]}
    begin |= {"major": image.version.major, "minor": image.version.minor, "revision": image.version.revision}
    _demand(wire, sender, "begin", begin, ERASE, file.name, _announcement(sender, file))
    _send_blocks(wire, sender, data, told)
    told("verifying", len(data), len(data))
    _demand(wire, sender, "end", {"checksum": zlib.crc32(data)}, VERIFY, file.name)
    told("starting", len(data), len(data))
    _reset(wire, sender, {}, file.name, lambda found: bool(found.running))
    state = _started(wire, sender, image.slot, file.name)
    return Outcome(image.slot, state, state == "confirmed" and _revoked(wire, sender, file, key))


def _revoked(wire: Wire, sender: Sender, file: SignedFile, key: LinkKey | None) -> bool:
    """Whether the key that a confirmed image revokes counts no more: from its next start on, which is now."""
    name = file.image.revokes[:2]
    if not name:
        return False
    found = _ask(wire, sender, ANSWER)
    if found is not None and found.revoked != name:
        _reset_application(wire, sender, {}, file.name, lambda found: found.revoked == name, key)
        time.sleep(START)
        found = _ask(wire, sender, CONFIRM)
    return found is not None and found.revoked == name


def _started(wire: Wire, sender: Sender, slot: str, name: str) -> str:
    """What came of the start."""
    time.sleep(START)
    end = time.monotonic() + CONFIRM
    state = "silent"
    while time.monotonic() < end:
        found = _ask(wire, sender, 0.5)
        if found is None:
            continue
        if found.running != slot:
            what = f"slot {found.running} runs again" if found.running else "the boot loader stays"
            raise UserError(f"{name}: written and verified, but it did not start well: {what}", status=1)
        state = "confirmed" if found.confirmed == slot else "on trial"
        if state == "confirmed":
            break
        time.sleep(0.2)
    return state
