"""A robot that lives on its buses in real time until it is stopped: plant, controller, and where they are, boot loader
and flash.

    robot = Living(scenario, [open_port("pty")])
    robot.run(lambda: stopped)                     # returns when stopped() is true; LinkError when a bus is gone

Tools attach and detach as they like. Sensor frames are not on the bus, as on a board: only what the controller says,
and what tools say to it. As soon as a tool sends COMMAND, the scenario's operator is silent, until none came for a
second.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.messages import Frame, interface
from terrapin_hil.nodes import Node
from terrapin_hil.run.boot_loader import BootLoader
from terrapin_hil.run.endless import Endless
from terrapin_hil.run.ports import Port
from terrapin_hil.scenario.faults import Fault
from terrapin_hil.scenario.scenario import Scenario
from terrapin_hil.simulation import TICK

__all__ = ["Living"]

OPERATOR_AWAY = 1.0  # s after the last COMMAND from outside
AT_ONCE = 20  # ticks between looks at the buses, where the robot is late
BEHIND = 0.2  # s that it makes up for; more is told as lag
CONFIRMED = 1.0  # s that an image has to run before it is confirmed
INTERNAL = ("TEST_MODE", "SENSORS_FAST", "SENSORS_SLOW", "SENSORS_HEADING")  # never taken from outside


class Living:
    """The robot of a scenario with the controller of this process's robot, on `ports`."""

    def __init__(
        self,
        scenario: Scenario,
        ports: Sequence[Port],
        node: int = 0,
        parameters: Path | None = None,
        loader: BootLoader | None = None,
        told: Callable[[str], None] = print,
    ) -> None:
        """`parameters`: the file in which the controller stores them; `loader`: None for a robot without one; `told`
        gets a line about each start."""
        self.scenario, self.ports, self.loader = scenario, list(ports), loader
        self.simulation = Endless(scenario)
        self.faults: list[Fault] = list(scenario.faults)
        self._told = told
        self._node = Node(node)
        self._link = InProcess(flash=parameters, node=node)
        names = interface().messages
        self._internal = {names[name].id for name in INTERNAL}
        self._command = names["COMMAND"].id
        self._actuate, self._status = names["ACTUATE"], names["STATUS"]
        self._said = b""  # the last STATUS since the start
        self._asked_at = -1e9  # when a tool last sent COMMAND [s of the simulation]
        self._started = 0.0
        self._confirmed = True
        self.alive = True
        self.lag = 0.0  # s that were given up
        self._late = [0] * 1001  # ticks by how late they were [0.1 ms], the last one: or more
        self.latest = 0.0
        self._start(first=True)

    def _start(self, stay: bool = False, first: bool = False) -> None:
        slot = self.loader.start(stay) if self.loader is not None else 0
        self._said = b""
        self._started = self.simulation.time
        self._confirmed = slot == 0
        self.alive = bool(slot) or self.loader is None or (first and not stay)
        if self.alive:
            self._link.power_on(self.scenario.firmware)
        if self.loader is None:
            return
        if slot:
            self._told(f"started slot {'AB'[slot - 1]}, version {self.loader.version}")
        else:
            self._told("flash is empty: started as by a probe" if self.alive else "the boot loader stays")

    def restart(self) -> None:
        """A reset by hand."""
        self._start(first=self.loader is None or not self.alive)

    @property
    def punctual(self) -> float:
        """[s] by which 99 % of all ticks were late at most."""
        rest = 0.99 * sum(self._late)
        for tenths, count in enumerate(self._late):
            rest -= count
            if rest <= 0.0:
                return (tenths + 1) * 1e-4
        return self.latest

    def state(self) -> dict[str, Any]:
        """What `status` tells, SI."""
        simulation = self.simulation
        truth = dict(zip(simulation.truth(), simulation.records["truth"][simulation.done - 1].tolist(), strict=True))
        row = simulation.records[simulation.done - 1]
        raw = self._actuate.decode(bytes(row["answer"][0]["data"])) if self.alive and row["answer_count"] else {}
        faults = self._status.decode(self._said)["faults"] if self.alive and self._said else 0
        states = {number: name for name, number in interface().enums["state"].items()}
        return {
            "robot": self.scenario.design.name,
            "scenario": self.scenario.name,
            "time": simulation.time,
            "state": states.get(raw.get("state", -1), "boot loader" if not self.alive else "unknown"),
            "faults": {f["name"]: f["cause"] for f in interface().json["faults"] if faults >> f["number"] & 1},
            "bridge_on": self.alive and self._link.bridge_on,
            "truth": truth,
            "late_p99": self.punctual,
            "latest": self.latest,
            "lag": self.lag,
            "lost": {port.name: port.lost for port in self.ports},
        }

    def _spread(self, frames: Sequence[Frame], but: Port | None = None) -> None:
        if frames:
            for port in self.ports:
                if port is not but:
                    port.send(frames)

    def _heard(self, port: Port, frames: Sequence[Frame]) -> None:
        """Frames from a tool: they go to the other ports, and to the controller or the boot loader."""
        self._spread(frames, port)
        for frame in frames:
            own = self._node.from_bus(frame)
            if own is None or own[0] in self._internal:
                continue
            if self.loader is not None and self.loader.wants(own[0]):
                motor_on = self.alive and self._link.bridge_on
                self._spread([self._node.to_bus(a) for a in self.loader.take(own, motor_on, self.simulation.time)])
                reset, stay = self.loader.reset
                if reset:
                    self._start(stay)
            elif self.alive:
                if own[0] == self._command:
                    self._asked_at = self.simulation.time
                self._spread(self._link.hear([frame]))

    def tick(self) -> None:
        """One tick of 1 ms, and what the controller says in it."""
        simulation = self.simulation
        if not self.alive:
            simulation.coast()
            return
        frames = simulation.sense()
        if simulation.time - self._asked_at < OPERATOR_AWAY:
            frames = [frame for frame in frames if frame[0] != self._command]
        answers = self._link.exchange(frames)
        simulation.answer(answers)
        for identifier, data in answers:
            if identifier == self._status.id:
                self._said = data
        self._spread([self._node.to_bus(answer) for answer in answers] if self._node.number else answers)
        if not self._confirmed and simulation.time - self._started > CONFIRMED and self.loader is not None:
            self._confirmed = True
            self.loader.confirm()

    def run(self, stopped: Callable[[], bool], more: Mapping[int, Callable[[], None]] | None = None) -> None:
        """Lives until `stopped`. `more`: descriptors that are looked at as well, and who reads them. LinkError when a
        bus is gone."""
        others = dict(more or {})
        due = time.monotonic() + TICK
        files = {port.fileno(): port for port in self.ports if port.fileno() >= 0}
        without = [port for port in self.ports if port.fileno() < 0]
        while not stopped():
            ready, _, _ = select.select([*files, *others], [], [], max(0.0, due - time.monotonic()))
            for file in ready:
                if file in others:
                    others[file]()
                else:
                    files[file].read(self._heard)
            for port in without:
                port.read(self._heard)
            done = 0
            while (late := time.monotonic() - due) >= 0.0 and done < AT_ONCE:
                if late > BEHIND:
                    self.lag += late
                    due += late
                    late = 0.0
                self._late[min(1000, int(late * 1e4))] += 1
                self.latest = max(self.latest, late)
                self.tick()
                due += TICK
                done += 1

    def close(self) -> None:
        """Leaves the buses."""
        for port in self.ports:
            port.close()
        self._link.close()
