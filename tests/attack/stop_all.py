"""STOP_ALL, then every other frame, in every state of the controller: the bridge stays off until somebody says clear.

States are taken from scenarios that reach them. Each is stopped, then gets frames of each kind that a controller takes,
whole and broken, TEST_MODE among them, with an open and with a sealed controller, whose stranger may say clear as well.
"""

from __future__ import annotations

import random
from typing import Any

from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.messages import Frame, interface, protect
from terrapin_hil.paths import SCENARIOS
from terrapin_hil.scenario.scenario import load_scenario
from terrapin_hil.simulation import Simulation
from tests.attack import Result, run

__all__ = ["attack", "states"]

FROM = ("floor_calibration", "slope_limiter", "estop", "swing_guard", "carriage_limiter", "soft_sand", "slope_free")
STATES = interface().enums["state"]
REQUESTS = [m for m in interface().messages.values() if m.sender == "host" and m.name != "STOP_ALL"]
CLEAR = interface().enums["request"]["clear"]
_MOST = CLEAR - 1  # what a stranger asks of an open controller
TURNS = 40  # frames behind one STOP_ALL
AFTER = 5  # ticks behind each frame


def states() -> dict[str, tuple[bytes, bytes]]:
    """State of the controller -> its memory and inputs, as a scenario reached it first."""
    found: dict[str, tuple[bytes, bytes]] = {}
    names = {number: name for name, number in STATES.items()}
    message = interface().messages["ACTUATE"]
    for name in FROM:
        path = SCENARIOS / f"{name}.toml"
        if not path.is_file() or len(found) == len(STATES):
            continue
        simulation, link = Simulation(load_scenario(path)), InProcess()
        link.start({})
        for _ in range(round(simulation.scenario.duration * 1000)):
            answers = link.exchange(simulation.sense())
            simulation.answer(answers)
            state = names[message.decode(answers[0][1])["state"]]
            if state not in found:
                memory = bytes(link._ffi.buffer(link._state, link._lib.terrapin_state_size())[:])
                found[state] = memory, bytes(link._ffi.buffer(link._inputs)[:])
    return found


class _Stranger:
    """Frames of every kind with the right counters; a COMMAND that is whole never says clear to an open controller."""

    def __init__(self, rng: random.Random) -> None:
        self.rng, self.counter = rng, 0

    def frame(self, sealed: bool) -> Frame:
        rng, message = self.rng, self.rng.choice(REQUESTS)
        if rng.random() < 0.4:
            message = interface().messages["COMMAND"]
        values = {
            s.name: rng.randint(s.minimum, s.maximum) for s in message.signals if s.name not in ("counter", "crc")
        }
        if message.name == "COMMAND":
            values |= {"request": rng.randint(0, CLEAR if sealed else _MOST), "control": rng.randint(0, 1)}
        if message.name == "TEST_MODE" and rng.random() < 0.7:
            values["key"] = int(interface().constants["test_mode_key"])
        data, _ = message.encode(values)
        if message.e2e:
            self.counter += 1
            data = protect(message.id, data.ljust(8, b"\0"), self.counter)
        if rng.random() < 0.05:
            data = data[: rng.randrange(len(data))]
        return message.id, bytes(data)


def _stopped_with(link: InProcess, kept: tuple[bytes, bytes], key: Any) -> None:
    lib, ffi = link._lib, link._ffi
    lib.terrapin_link_init(link._link, link._state, link._inputs)
    lib.terrapin_link_seal(link._link, key, 1 if key else 0, 1)
    ffi.buffer(link._state, lib.terrapin_state_size())[:] = kept[0]
    ffi.buffer(link._inputs)[:] = kept[1]
    stop = interface().messages["STOP_ALL"]
    link.exchange([(stop.id, stop.encode({"request": 0})[0])])


def attack(count: int, seed: int) -> Result:
    """STOP_ALL, then other frames in every state, open and sealed: ms for which the bridge was on must be none."""
    rng, link, reached = random.Random(seed), InProcess(), states()
    lib, seal = link._lib, link._ffi.addressof(link._link, "seal")
    key = link._ffi.new("uint32_t[4]", [rng.getrandbits(32) for _ in range(4)])
    stranger, tried, on, lifted = _Stranger(rng), 0, 0, 0
    stop_bit = 1 << interface().faults["stop_all"]

    def ticks(number: int) -> int:
        driven = 0
        for _ in range(number):
            link._inputs.tick += 1
            lib.terrapin_link_step(link._state, link._inputs, link._outputs)
            driven += bool(link._outputs.enable) and not link._link.test_mode
        return driven

    while tried < count:
        for kept in reached.values():
            for sealed in (False, True):
                _stopped_with(link, kept, key if sealed else link._ffi.NULL)
                on += ticks(AFTER)
                for _ in range(TURNS):
                    lib.terrapin_seal_at(seal, seal.now_ms + AFTER)
                    link.exchange([stranger.frame(sealed)])
                    tried += 1
                    on += ticks(AFTER)
                    lifted += not lib.terrapin_latched(link._state) & stop_bit
    link._link.test_mode = False
    _stopped_with(link, reached["run"], link._ffi.NULL)
    ticks(AFTER)
    clear = interface().messages["COMMAND"]
    for counter in (1, 2):
        link.exchange(
            [(clear.id, protect(clear.id, bytes(clear.encode({"request": CLEAR})[0]).ljust(8, b"\0"), counter))]
        )
        ticks(1)
    cleared = not lib.terrapin_latched(link._state) & stop_bit
    missing = sorted(set(STATES) - set(reached))
    result = Result(
        "STOP_ALL, then every other frame", tried, on + lifted + (not cleared) + len(missing),
        f"{len(reached)} of {len(STATES)} states, open and sealed: bridge on {on} ms, lifted {lifted} times; a clear "
        f"ends it: {'yes' if cleared else 'no'}",
    )  # fmt: skip
    print(result)
    return result


if __name__ == "__main__":
    raise SystemExit(run(attack, 100_000))
