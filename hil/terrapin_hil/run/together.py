"""Several robots on one bus: each its own scenario and controller, all of their frames heard by all.

    results, _ = run_together({0: scenario, 1: other})                    # in lockstep
    results, report = run_together({0: scenario, 1: other}, 500_000)      # on a bus of 500 kbit/s in time
    results[1].output_hash                                                # that of `other` alone, in lockstep

In lockstep the sensors travel on the bus too, as in any run, and nothing takes time. On a bus in time each controller
has its own sensors, as a robot has; commands, ACTUATE and all telemetry are frames that win or wait
(terrapin_hil.links.bus_model), and a command reaches its controller at the tick after its last bit.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from terrapin_hil.errors import UserError
from terrapin_hil.links.bus_model import Arrival, BusModel
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.links.link import LinkError
from terrapin_hil.messages import AnswerError, Frame, interface
from terrapin_hil.nodes import Node
from terrapin_hil.run.run import Observer, Result, Timing
from terrapin_hil.scenario.scenario import Scenario
from terrapin_hil.simulation import TICK, Simulation

__all__ = ["BusReport", "NodeReport", "run_together"]

CHUNK = 500  # ticks between looks at progress and log


@dataclass
class NodeReport:
    """What the bus did with one robot's frames. `*_late`: from sending to the tick that takes it, the longest [s]."""

    commands: int = 0  # that its host sent
    commands_taken: int = 0
    command_late: float = 0.0
    telemetry: int = 0  # frames that it sent
    telemetry_arrived: int = 0


@dataclass
class BusReport:
    """A bus over a run: its bit rate [bit/s], the share of the time in which it was busy, each node."""

    bit_rate: int
    load: float
    nodes: Mapping[int, NodeReport]

    def __str__(self) -> str:
        rows = [f"bus at {self.bit_rate} bit/s: load {100 * self.load:.0f} %"]
        for number, node in self.nodes.items():
            lost, gave_way = node.commands - node.commands_taken, node.telemetry - node.telemetry_arrived
            rows.append(
                f"  node {number}: COMMAND late by {1e3 * node.command_late:.2f} ms at most, "
                f"{lost} of {node.commands} lost; {gave_way} of {node.telemetry} frames of telemetry gave way to newer"
            )
        return "\n".join(rows)


@dataclass
class _Robot:
    node: Node
    link: InProcess
    simulation: Simulation
    observers: tuple[Observer, ...]
    report: NodeReport = field(default_factory=NodeReport)
    written: int = 0
    on_the_way: list[tuple[float, Frame]] = field(default_factory=list)  # commands: when sent, frame of node 0

    @property
    def name(self) -> str:
        return f"node {self.node.number}"

    @property
    def running(self) -> bool:
        return self.simulation.done < len(self.simulation.records)

    def own(self, frames: Iterable[Frame]) -> list[Frame]:
        return [own for frame in frames if (own := self.node.from_bus(frame)) is not None]

    def flush(self) -> None:
        if self.observers:
            self.simulation.write_frames(self.written)
        for observer in self.observers:
            observer.write(self.simulation.records[self.written : self.simulation.done])
        self.written = self.simulation.done


def _lockstep_tick(robots: list[_Robot], heard: list[Frame]) -> list[Frame]:
    """One tick of all; `heard` is what the controllers said in the one before."""
    running = [robot for robot in robots if robot.running]
    bus = [*heard, *(robot.node.to_bus(frame) for robot in running for frame in robot.simulation.sense())]
    said = [frame for robot in running for frame in robot.link.hear(bus)]
    for robot in running:
        robot.simulation.answer(robot.own(said))
    return said


def _count(robots: list[_Robot], arrived: list[Arrival]) -> None:
    for robot in robots:
        robot.report.telemetry_arrived += sum(sender == robot.name for _, sender, _ in arrived)


def _port_frames(tick: int) -> list[Frame]:
    """What a port adds to the controller's telemetry in this tick: its state, with nothing to say."""
    own = [m for m in interface().messages.values() if m.telemetry and m.name.startswith("PORT_")]
    return [(m.id, bytes(m.length)) for i, m in enumerate(own) if tick % m.cycle_ms == i]


def _timed_tick(robots: list[_Robot], bus: BusModel, tick: int, phases: Mapping[int, float]) -> None:
    """One tick of all; each node's begins `phases` [s] after the host's."""
    now, command = tick * TICK, interface().messages["COMMAND"].id
    arrived = bus.run(now)
    for robot in (robot for robot in robots if robot.running):
        own, report = robot.node, robot.report
        to_controller = [f for _, sender, f in arrived if sender == f"host of {robot.name}"]
        taken = robot.own(to_controller)
        for frame in taken:
            index = next(i for i, (_, sent) in enumerate(robot.on_the_way) if sent == frame)
            sent, _ = robot.on_the_way.pop(index)
            report.commands_taken += 1
            report.command_late = max(report.command_late, now + phases[own.number] - sent)
        frames = robot.simulation.sense()
        for frame in frames:
            if frame[0] == command:
                report.commands += 1
                robot.on_the_way.append((now, frame))
                bus.send(f"host of {robot.name}", own.to_bus(frame), now)
        sensors = [frame for frame in frames if frame[0] != command]
        said = robot.link.exchange([*taken, *sensors])
        robot.simulation.answer(said)
        for frame in (*said, *_port_frames(tick)):
            report.telemetry += 1
            bus.send(robot.name, own.to_bus(frame), now + phases[own.number], replace=True)
    _count(robots, arrived)


def run_together(
    scenarios: Mapping[int, Scenario],
    bit_rate: int | None = None,
    *,
    parameters: Mapping[str, float] | None = None,
    observers: Mapping[int, Iterable[Observer]] | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[dict[int, Result], BusReport | None]:
    """Runs a scenario at each node number, in this process; their results, and what the bus did where it has a rate.

    Controllers tick one after another within a millisecond. LinkError when a frame goes astray, UserError for a number
    that no node has or a scenario of faults on the bus, which belong to one link; otherwise as terrapin_hil.run.run.
    """
    robots: list[_Robot] = []
    for number, scenario in scenarios.items():
        simulation = Simulation(scenario)
        if simulation.disturbed:
            raise UserError(
                f"{scenario.name}: its faults of the bus are those of a link of its own, expected none here"
            )
        link = InProcess(node=number)
        link.start({**scenario.firmware, **(parameters or {})})
        robots.append(_Robot(Node(number), link, simulation, tuple((observers or {}).get(number, ()))))
    bus = BusModel(bit_rate) if bit_rate else None
    phases = {robot.node.number: i * TICK / len(robots) for i, robot in enumerate(robots)}
    ticks, begin = max(robot.simulation.scenario.ticks for robot in robots), time.monotonic()
    heard: list[Frame] = []
    try:
        for tick in range(ticks):
            if bus is None:
                heard = _lockstep_tick(robots, heard)
            else:
                _timed_tick(robots, bus, tick, phases)
            if (tick + 1) % CHUNK == 0 and progress is not None:
                progress((tick + 1) / ticks)
    except AnswerError as error:
        raise LinkError(f"bus: {error}") from None
    finally:
        for robot in robots:
            robot.flush()
    if bus is not None:
        _count(robots, bus.run(math.inf))  # what still waits
    seconds = time.monotonic() - begin
    results = {}
    for robot in robots:
        scenario, values = robot.simulation.scenario, {**robot.simulation.scenario.firmware, **(parameters or {})}
        name = f"{robot.name} of a bus of {len(robots)}"
        result = Result(scenario, name, values, robot.simulation.records, interface(), timing=Timing(seconds))
        result.check()
        results[robot.node.number] = result
        robot.link.close()
    if bus is None or bit_rate is None:
        return results, None
    return results, BusReport(bit_rate, bus.load(ticks * TICK), {r.node.number: r.report for r in robots})
