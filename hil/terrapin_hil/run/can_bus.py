"""A simulated robot as an interface of python-can, for every tool that is built on it.

    with can.Bus(interface="terrapin", channel="steady_sand") as bus:
        bus.recv(1.0)

`channel` is a scenario: the name of a shipped one, or a file. The robot lives in real time in a thread of this process;
`seed`, `robot` and `node` may be named beside it. A bus that nobody reads keeps the last frames and counts the rest as
lost. A COMMAND that a tool sends takes the operator's place, as on a robot (see terrapin_hil.run.living).
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import can

from terrapin_hil.errors import UserError
from terrapin_hil.messages import Frame
from terrapin_hil.run.living import Living
from terrapin_hil.run.ports import Heard
from terrapin_hil.run.session import chosen_scenario

__all__ = ["TerrapinBus"]

WAITING = 65_536  # frames that wait for who reads: 8 s of a robot that is heard whole
OF_TOOLS = {"bitrate", "data_bitrate", "fd", "receive_own_messages", "single_handle", "timing"}  # that any bus is given
END = 5.0  # s that the robot's thread may take to end
_open: set[str] = set()  # channels of this process
_guard = threading.Lock()


class _Ends:
    """The robot's end of the bus: what it says waits here for `recv`, what was sent waits for it."""

    def __init__(self, channel: str) -> None:
        self.name = self.attach = channel
        self.lost = 0
        self.said: deque[tuple[float, Frame]] = deque()
        self.told: deque[Frame] = deque(maxlen=WAITING)
        self.news = threading.Condition()
        self.failed: BaseException | None = None

    def fileno(self) -> int:
        return -1

    def send(self, frames: Sequence[Frame]) -> None:
        now = time.time()
        with self.news:
            for frame in frames:
                if len(self.said) == WAITING:
                    self.said.popleft()
                    self.lost += 1
                self.said.append((now, frame))
            self.news.notify_all()

    def read(self, heard: Heard) -> None:
        while self.told:
            heard(self, [self.told.popleft()])

    def close(self) -> None:
        pass


class TerrapinBus(can.BusABC):
    """See the module. CanInitializationError, one line, when the scenario is wrong or a robot lives on the channel."""

    def __init__(
        self,
        channel: Any = "steady_sand",
        can_filters: can.typechecking.CanFilters | None = None,
        *,
        seed: int | None = None,
        robot: str = "",
        node: int = 0,
        **more: Any,
    ) -> None:
        self._ends = _Ends(str(channel))
        self._over = threading.Event()
        self._thread: threading.Thread | None = None
        self.channel_info = f"simulated robot, scenario {channel}"
        self._can_protocol = can.CanProtocol.CAN_20
        unknown = set(more) - OF_TOOLS
        if unknown:
            raise can.CanInitializationError(
                f"terrapin: found option {sorted(unknown)[0]}, expected one of seed, robot, node"
            )
        with _guard:
            if self._ends.name in _open:
                raise can.CanInitializationError(
                    f"terrapin: a robot lives on channel {channel} in this process already, expected one bus a channel"
                )
            _open.add(self._ends.name)
        try:
            scenario = chosen_scenario(str(channel), robot)
            if seed is not None:
                scenario = replace(scenario, seed=int(seed))
            self._living = Living(scenario, [self._ends], int(node), told=lambda _: None)
        except (UserError, OSError, ValueError) as error:
            _open.discard(self._ends.name)
            raise can.CanInitializationError(f"terrapin: {error}") from None
        self._thread = threading.Thread(target=self._live, name=f"terrapin {channel}", daemon=True)
        self._thread.start()
        super().__init__(channel=channel, can_filters=can_filters)

    def _live(self) -> None:
        try:
            self._living.run(self._over.is_set)
        except BaseException as error:
            self._ends.failed = error
        with self._ends.news:
            self._ends.news.notify_all()

    @property
    def lost(self) -> int:
        """Frames that nobody read in time."""
        return self._ends.lost

    @property
    def living(self) -> Living:
        """The robot, for its truth (`living.state()`)."""
        return self._living

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        end = None if timeout is None else time.monotonic() + timeout
        with self._ends.news:
            while not self._ends.said:
                if self._ends.failed is not None:
                    raise can.CanOperationError(f"terrapin: {self._ends.failed}")
                left = 0.5 if end is None else end - time.monotonic()
                if left <= 0.0 or self._over.is_set():
                    return None, False
                self._ends.news.wait(min(left, 0.5))
            stamp, (identifier, data) = self._ends.said.popleft()
        return can.Message(timestamp=stamp, arbitration_id=identifier, data=data, is_extended_id=False), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self._over.is_set() or self._ends.failed is not None:
            raise can.CanOperationError("terrapin: the robot has ended, expected an open bus")
        if msg.is_extended_id or msg.is_remote_frame or msg.is_error_frame or msg.is_fd:
            raise can.CanOperationError("terrapin: expected a classic data frame with 11 bits of identifier")
        self._ends.told.append((msg.arbitration_id, bytes(msg.data)))

    def shutdown(self) -> None:
        """Ends the robot. Doing so twice is allowed."""
        super().shutdown()
        self._over.set()
        if self._thread is not None:
            self._thread.join(END)
            self._thread = None
            self._living.close()
            _open.discard(self._ends.name)

    @staticmethod
    def _detect_available_configs() -> list[can.typechecking.AutoDetectedConfig]:
        return [{"interface": "terrapin", "channel": "steady_sand"}]
