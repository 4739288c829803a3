"""Each fault of controller.toml is provoked by a scenario and answered as documented, in its stated time."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from terrapin_hil import paths
from terrapin_hil.links.wire import SlcanLink
from terrapin_hil.messages import interface
from terrapin_hil.run.reaction import reaction
from terrapin_hil.run.run import Result, run
from terrapin_hil.scenario.faults import KINDS, Fault, Provocation
from terrapin_hil.scenario.scenario import Scenario, find_scenario, load_scenario
from terrapin_hil.scenario.wire_faults import Disturbance
from terrapin_interface.description import load

FAULTS = {fault.name: fault for fault in load().faults}
SHIPPED = sorted(path.stem for path in paths.SCENARIOS.glob("*.toml"))
CASES = [(fault.name, name) for fault in FAULTS.values() for name in fault.scenarios]
ON_THE_BUS = ("babbling_idiot", "extremes_from_outside", "tick_repeated", "command_crc_bad", "command_counter_stuck")


@cache
def scenario(name: str) -> Scenario:
    return load_scenario(find_scenario(name))


@cache
def result(name: str) -> Result:
    return run(scenario(name))


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_has_a_scenario(name: str) -> None:
    assert FAULTS[name].scenarios, f"no scenario provokes {name}: name one in controller.toml"
    assert set(FAULTS[name].scenarios) <= set(SHIPPED)


def test_scenarios_and_description_name_each_other() -> None:
    """A scenario says which fault it is for and when; the description may name it for more faults, at the same time."""
    provoking = {(s.provokes.fault, name) for name in SHIPPED if (s := scenario(name)).provokes is not None}
    assert provoking <= set(CASES)
    assert {name for _, name in provoking} == {name for _, name in CASES}


@pytest.mark.parametrize(("fault", "name"), CASES, ids=[name for _, name in CASES])
def test_answered_as_documented_and_in_time(fault: str, name: str) -> None:
    outcomes = result(name).outcomes
    assert not [f"{outcome.text}: {outcome.found}" for outcome in outcomes if not outcome.passed]
    own = [outcome for outcome in outcomes if outcome.text.startswith(f"{fault}: ")]
    assert len(own) == (2 if not FAULTS[fault].latched else 3 + (scenario(name).provokes.at > 0))


def test_stated_times_are_those_of_the_requirements() -> None:
    """The e-stop within one tick; a lost COMMAND 200 ms after it, and the tick that acts."""
    timeout = interface().parameters["command_timeout"]
    assert FAULTS["estop"].within_ms == 1
    assert timeout.maximum * timeout.scale == pytest.approx(0.2)
    assert FAULTS["command_timeout"].within_ms == 201
    for name, fault in FAULTS.items():
        if fault.latched:
            assert "bridge off" in fault.reaction, name
            assert "state safe" in fault.reaction, name


@pytest.mark.parametrize(("fault", "name"), [("estop", "estop"), ("over_current", "over_current")])
def test_one_tick_too_late_is_found(fault: str, name: str) -> None:
    """The same run, had its cause come one tick earlier."""
    found = result(name)
    provoked = scenario(name).provokes
    assert provoked is not None
    late = reaction(Provocation(fault, provoked.at - 1e-3), interface(), found.held)
    assert [outcome.passed for outcome in late if "bridge off" in outcome.text] == [False]
    early = reaction(Provocation(fault, provoked.at + 0.05), interface(), found.held)
    assert [outcome.passed for outcome in early if "not before" in outcome.text] == [False]


def test_a_fault_that_never_comes_is_found() -> None:
    outcomes = reaction(Provocation("over_temperature", 3.0), interface(), result("estop").held)
    assert [outcome.found for outcome in outcomes if "flag within" in outcome.text] == ["never"]
    assert not all(outcome.passed for outcome in outcomes)


def test_a_run_that_ends_too_soon_proves_nothing() -> None:
    short = run(replace(scenario("estop"), duration=2.0, checks=()))
    assert [(outcome.passed, outcome.found) for outcome in short.outcomes] == [(False, "the run ends at 2 s")]


# ---------------------------------------------------------------- faults of the bus


@pytest.mark.parametrize("name", ON_THE_BUS)
def test_scenarios_of_the_bus_hold(name: str) -> None:
    assert not [f"{outcome.text}: {outcome.found}" for outcome in result(name).outcomes if not outcome.passed]


@pytest.mark.parametrize("name", ["babbling_idiot", "extremes_from_outside"])
def test_the_same_over_a_serial_line(name: str) -> None:
    short = replace(scenario(name), duration=2.5, checks=())
    with SlcanLink.of_process() as link:
        assert run(short, link).output_hash == run(short).output_hash


def test_foreign_traffic_at_full_load_changes_nothing() -> None:
    """8,000 frames a second, all that 1 Mbit/s carries: every tick is stepped, and every output is the same."""
    loaded = result("babbling_idiot")
    quiet = run(replace(scenario("babbling_idiot"), faults=()))
    assert quiet.output_hash == loaded.output_hash
    assert np.array_equal(loaded.telemetry["ACTUATE"]["tick"] % 65536, np.arange(len(loaded.records)))


def test_repeated_ticks_step_once() -> None:
    repeated = result("tick_repeated")
    assert repeated.output_hash == run(replace(scenario("tick_repeated"), faults=())).output_hash


def test_frames_or_inputs_are_the_same_run() -> None:
    """A run whose bus is looked at frame by frame, with nothing wrong on it, is the run through memory."""
    nothing = Fault("babble", value=1.0, begin=1e6, end=1e6 + 1)
    plain = replace(scenario("steady_sand"), duration=2.0, checks=())
    assert run(replace(plain, faults=(nothing,))).output_hash == run(plain).output_hash


@pytest.mark.parametrize("kind", ["command_crc", "command_counter", "babble", "tick_repeated", "extremes"])
def test_a_disturbance_changes_what_it_says_and_no_more(kind: str) -> None:
    from terrapin_hil.messages import Sender, protect

    sender = Sender()
    disturbance = Disturbance([Fault(kind, value=5.0, begin=0.01, end=0.02)], seed=1)
    names = interface().by_id
    for tick in range(40):
        frames = [
            sender.frame("COMMAND", {"request": 2, "setpoint": 100}),
            sender.frame("SENSORS_FAST", {"tick": tick}),
        ]
        found = disturbance.apply(tick, list(frames))
        if not 10 <= tick < 20:
            assert found == frames
            continue
        (command_id, _), fast = frames
        if kind == "babble":
            assert len(found) == 7
            rest = [frame for frame in found if frame not in frames]
            assert [frame for frame in found if frame in frames] == frames
            for identifier, data in rest:  # nothing among them that the controller may take
                known = names.get(identifier)
                good = known is not None and len(data) == known.length
                assert not good or (known.e2e and protect(identifier, data, data[6]) != data)
        elif kind == "tick_repeated":
            assert found == [*frames, fast]
        else:
            assert found[1] == fast
            damaged = found[0][1]
            intact = protect(command_id, damaged, damaged[6]) == damaged
            assert intact == (kind != "command_crc")
            if kind == "command_counter":
                assert damaged[6] & 0xF == 9  # that of the last good one
            if kind == "extremes":
                assert names[command_id].decode(damaged)["setpoint"] in (-32768, 32767)


def test_every_kind_of_fault_is_used() -> None:
    """A kind that no shipped scenario uses is tested by none. Lost counts are a sensor's error in cases' scenarios."""
    used = {fault.kind for name in SHIPPED for fault in scenario(name).faults}
    assert set(KINDS) - used <= {"absent", "lost_counts"}
