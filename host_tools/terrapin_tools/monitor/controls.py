"""What a page or a terminal sends to a bus: the stop that is held in, `clear`, and the commands of who drives.

One page drives at a time, and only while it is heard: commands end HEART after its last beat, and the controller's own
time-out then puts the bridge off. Nothing here goes on in the name of a page that is silent. A stop ends the driving.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from terrapin_hil.links.link import LinkError, Sealing
from terrapin_hil.links.seal import LinkKey, seal_link, takes_changes
from terrapin_hil.messages import Frame, Interface, Sender, protect
from terrapin_hil.nodes import Node
from terrapin_hil.scenario.scenario import LIMITS
from terrapin_tools.errors import UserError
from terrapin_tools.logs.frames import Frames
from terrapin_tools.monitor.sources import Bus
from terrapin_tools.param.session import Session as Parameters

__all__ = ["HEART", "LIMITS", "Controls", "NotNow", "Order", "reach"]

HEART = 0.4  # s after the last beat (one each 0.1 s) in which commands still go out
FIRST = 3.0  # s that a page has for its first beat, before which no command goes out
CYCLE = 0.05  # s between COMMANDs; the controller wants one in 0.2 s
REPEAT = 0.02  # s between stops while the stop button is held in
CLEARS = 5  # one may be lost, and a new sender's second is the first that is taken
HALT = 5.0  # s that a halt may take until the bridge is off: the firmware brakes for 4 s at most
ANSWER = 0.3  # s for a controller to answer a question
AT_ONCE, ATTEMPTS = 8, 3  # questions on their way; a frame may be lost


class NotNow(UserError):
    """Somebody else drives, or the stop is held in."""


@dataclass(frozen=True)
class Order:
    """What the page that drives wants. `setpoint`: V, or m/s of the shell's rim."""

    request: Literal["idle", "calibrate", "run"] = "idle"
    control: Literal["voltage", "speed"] = "speed"
    setpoint: float = 0.0
    limiter: bool = True


def reach(interface: Interface) -> dict[str, float]:
    """How far setpoints go either way with the robot that this is the description of, by control: to the most that its
    voltage_limit can be [V], and to the speed that this gives without load [m/s of the shell's rim]."""
    limit = interface.parameter("voltage_limit")
    arm, constant = (interface.parameter(name) for name in ("drive_radius", "torque_constant"))
    volts = limit.maximum * limit.scale
    speed = volts * (arm.default * arm.scale) / (constant.default * constant.scale)
    return {name: min(most, LIMITS[name][1]) for name, most in (("speed", speed), ("voltage", volts))}


class Controls:
    """Sends to `bus`, from a thread of its own. `told(text)` is called for what should be an event, `bridge_on()` says
    whether the controller's bridge is on. `failed`: why nothing can be sent any more. `key`: the controller's link key,
    if it has one."""

    def __init__(
        self,
        bus: Bus,
        interface: Interface,
        node: Node,
        told: Callable[[str], None] = lambda _: None,
        bridge_on: Callable[[], bool] = lambda: False,
        key: LinkKey | None = None,
    ) -> None:
        self.name = bus.name
        self.failed: UserError | None = None
        self.stop_held = False
        self.sent = 0  # COMMANDs
        self.session: Sealing | None = None  # that seals what is sent, from `secure` on
        self._bus, self._node, self._told, self._bridge_on, self._key = bus, node, told, bridge_on, key
        self._sealing = threading.RLock()  # a session that is renewed asks for the next one
        self._securing, self._secured = threading.Lock(), False
        self._status = node.to_bus((interface.messages["STATUS"].id, b""))[0]
        self._interface, self._sender = interface, Sender(interface)
        self._driver = ""  # the page that drives
        self._ended = ""  # why the one before does so no more
        self._order = Order()
        self._heard = self._due = self._left = 0.0
        self._leaving = False  # until the halt is over
        self._begun = False  # the page that drives has been heard
        self._clears = 0
        self._notes: list[str] = []
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._over = False
        self._asking = threading.Lock()
        self._found: list[Frame] = []  # answers
        self._wanted: Callable[[Frame], bool] | None = None
        self._answered = threading.Condition()
        self.parameters = Parameters(self, interface)
        bus.tap = self._take
        self._thread = threading.Thread(target=self._work, name="controls", daemon=True)
        self._thread.start()

    def secure(self) -> None:
        """Makes sure, once, that the controller takes commands: they are sealed from now on where there is a key.
        LinkError, one line with the remedy, when it has another key, or one and none was given here."""
        with self._securing:
            if self._secured:
                return
            if self._key is not None:
                seal_link(self, self._key)
            elif not takes_changes(self) and self._answers():
                raise LinkError(
                    f"{self.name}: the controller has a link key and takes no command without it, expected --link-key "
                    "FILE beside --link; stopping needs none"
                )
            self._secured = True

    @property
    def keyed(self) -> bool:
        """Whether a link key was given."""
        return self._key is not None

    def _answers(self) -> bool:
        """Whether the controller answers a question that needs no key."""
        value = self._interface.messages["PARAMETER_VALUE"].id
        return self.ask(self._sender.frame("PARAMETER_READ", {"index": 0}), lambda frame: frame[0] == value) is not None

    # ---------------------------------------------------------------- what pages ask for

    def arm(self, page: str) -> None:
        """This page drives from now on, with request idle. NotNow when another does, or the stop is held in."""
        with self._lock:
            if self._driver not in ("", page):
                raise NotNow("another page drives, expected one at a time; every page can stop the robot")
            if self.stop_held:
                raise NotNow("the stop button is held in, expected it released first")
            self._driver, self._order, self._leaving = page, Order(), False
            self._heard, self._begun = time.monotonic() + FIRST - HEART, False
            self._notes.append("armed: a page drives")
        self._wake.set()

    def beat(self, page: str, order: Order) -> None:
        """The page is there, and wants this. Of a page that does not drive it says nothing."""
        with self._lock:
            if page != self._driver:
                return
            self._heard, self._begun = time.monotonic(), True
            if self._leaving or order == self._order:
                return
            self._order, self._due = order, 0.0
        self._wake.set()

    def disarm(self, page: str) -> None:
        """Halts, and lets go when the bridge is off. NotNow when this page does not drive."""
        with self._lock:
            if page != self._driver:
                raise NotNow("this page does not drive, expected it armed first")
            self._order, self._leaving, self._left, self._due = Order(), True, time.monotonic(), 0.0
        self._wake.set()

    def gone(self, page: str) -> None:
        """The page was closed: not one command more for it."""
        with self._lock:
            if page != self._driver:
                return
            self._let_go("the page that drove is gone: no more commands")
        self._wake.set()

    def clear(self) -> None:
        """Tells the controller `clear`. NotNow while the stop is held in or a page drives it."""
        with self._lock:
            if self.stop_held:
                raise NotNow("the stop button is held in, expected it released first")
            self._clears = CLEARS
        self._wake.set()

    def hold_stop(self, held: bool) -> None:
        """STOP_ALL to all controllers, again and again, until it is let go, which clears the one that is watched."""
        with self._lock:
            self._clears = CLEARS if self.stop_held and not held else 0
            self.stop_held = held
            if held and self._driver:
                self._let_go("stopped: no page drives any more")
            self._due = 0.0
        self._wake.set()

    @property
    def driver(self) -> str:
        """The page that drives, "" for none."""
        return self._driver

    def answer(self) -> dict[str, Any]:
        """How it stands, for the page."""
        with self._lock:
            return {
                "driver": self._driver,
                "ended": self._ended,
                "leaving": self._leaving,
                "sent": self.sent,
                **asdict(self._order),
            }

    def end(self) -> None:
        """Sends no more from now on."""
        self._over = True
        with self._lock:
            self._driver = ""
        self._wake.set()

    def close(self) -> None:
        """Sends no more, and waits for what is on its way."""
        self.end()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=5.0)

    # ---------------------------------------------------------------- the thread

    def _let_go(self, note: str) -> None:
        self._driver, self._order, self._leaving = "", Order(), False
        self._ended = note
        self._notes.append(note)

    def _work(self) -> None:
        while not self._over:
            now = time.monotonic()
            with self._lock:
                frames = self._next(now)
                notes, self._notes = self._notes, []
                busy = bool(self._driver or self.stop_held or self._clears)
                due = self._due
            try:
                self._send(frames)
            except UserError as error:
                self.failed = error
                return
            for note in notes:
                self._told(note)
            self._wake.wait(max(0.0, due - time.monotonic()) if busy else None)
            self._wake.clear()

    def _send(self, frames: Sequence[Frame]) -> None:
        """Frames to the controller, sealed where it wants that."""
        if self.session is None or not frames:
            self._put(frames)
            return
        with self._sealing:
            for piece in self.session.batches(frames):
                self._put(piece)

    def _put(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            self._bus.send(*self._node.to_bus(frame))

    def _next(self, now: float) -> list[Frame]:
        """What is due, under the lock."""
        if self._driver and now - self._heard > HEART:
            self._let_go(f"nothing heard of the page that drove for {HEART:g} s: no more commands")
        if self._leaving and (not self._bridge_on() or now - self._left > HALT) and now - self._left > 4 * CYCLE:
            self._let_go("disarmed")
        if now < self._due:
            return []
        if self.stop_held:
            self._due = now + REPEAT
            return [self._sender.frame("STOP_ALL", {"request": self._number("request", "idle")})]
        if self._clears:
            self._due = now + REPEAT
            self._clears -= 1
            return [self._sender.frame("COMMAND", {"request": self._number("request", "clear")})]
        self._due = now + CYCLE
        if not self._driver or not self._begun:
            return []
        self.sent += 1
        order = self._order
        values = {
            "request": self._number("request", order.request),
            "control": self._number("control", order.control),
            "limiter": int(order.limiter),
            "setpoint": round(order.setpoint * 1e3),
        }
        return [self._sender.frame("COMMAND", values)]

    def _number(self, enum: str, word: str) -> int:
        return self._interface.enums[enum][word]

    # ---------------------------------------------------------------- questions and answers

    def ask(self, frame: Frame, wanted: Callable[[Frame], bool]) -> Frame | None:
        """Sends a question to the controller that is watched; the first frame that is `wanted`, or None."""
        found = self._ask([frame], wanted, 1)
        return found[0] if found else None

    def _ask(self, frames: Sequence[Frame], wanted: Callable[[Frame], bool], most: int) -> list[Frame]:
        """Sends questions; the answers that are `wanted`, until there are `most` or ANSWER is over."""
        if self.session is not None:  # sealed before its turn: a renewed session asks a question of its own
            with self._sealing:
                frames = [frame for piece in self.session.batches(frames) for frame in piece]
        with self._asking, self._answered:
            self._found, self._wanted = [], wanted
            try:
                self._put(frames)
                self._answered.wait_for(lambda: len(self._found) >= most, ANSWER)
                return self._found
            finally:
                self._wanted = None

    def _take(self, block: Frames) -> None:
        """Frames that came, in the thread that listens: an answer may be among them."""
        session = self.session
        if session is not None:
            rows = np.flatnonzero(block.identifiers == self._status)
            told = (self._node.from_bus((self._status, block.payload(row))) for row in rows.tolist())
            session.heard([frame for frame in told if frame is not None])
        if self._wanted is None:
            return
        with self._answered:
            for row in np.flatnonzero(block.identifiers < 0x800).tolist():
                own = self._node.from_bus((int(block.identifiers[row]), block.payload(row)))
                if own is not None and self._wanted is not None and self._wanted(own):
                    self._found.append(own)
                    self._answered.notify_all()

    def values(self) -> dict[str, int]:
        """Raw values of all parameters, AT_ONCE asked for at a time. LinkError when the controller does not answer."""
        message = self._interface.messages["PARAMETER_VALUE"]
        names = {parameter.index: name for name, parameter in self._interface.parameters.items()}
        found: dict[str, int] = {}

        def wanted(frame: Frame) -> bool:
            return frame[0] == message.id and protect(*frame, frame[1][6] & 0xF) == frame[1]

        for _ in range(ATTEMPTS):
            missing = [index for index, name in names.items() if name not in found]
            for begin in range(0, len(missing), AT_ONCE):
                some = missing[begin : begin + AT_ONCE]
                questions = [self._sender.frame("PARAMETER_READ", {"index": index}) for index in some]
                answers = [message.decode(data) for _, data in self._ask(questions, wanted, len(some))]
                if not answers and not found:
                    break  # nobody there: not tried for each
                found |= {names[a["index"]]: a["value"] for a in answers if a["index"] in names and a["status"] == 0}
        if len(found) < len(names):
            raise LinkError(f"{self.name}: the controller told {len(found)} of {len(names)} parameters")
        return {name: found[name] for name in self._interface.parameters}
