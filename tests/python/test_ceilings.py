"""The board's ceilings: no parameter passes them, and with all parameters at them the protections still trip."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace

import pytest

from terrapin_hil.links.wire import SlcanLink
from terrapin_hil.messages import Sender, interface
from terrapin_hil.run.run import run
from terrapin_hil.scenario.faults import Fault
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from terrapin_interface.description import load, parse
from terrapin_interface.entries import DescriptionError

PARAMETERS = interface().parameters
CEILINGS = {p.name: p for p in load().parameters if p.ceiling}
# What each takes a protection away with, raw: the writes that were all accepted before there were ceilings.
WRITES = {
    "temperature_high": 200_000,
    "temperature_scale": 1,
    "temperature_zero": -100_000,
    "supply_high": 60_000,
    "supply_low": 0,
    "supply_scale": 500,
    "over_current": 2_040,
    "current_limit": 2_000,
    "voltage_limit": 16_000,
    "encoder_tolerance": 20_000,
    "speed_kp": 20_000,
}


def test_the_known_writes_are_refused() -> None:
    sender = Sender()
    status = interface().enums["parameter_status"]
    with SlcanLink.of_process() as link:
        for name, value in WRITES.items():
            frame = sender.frame("PARAMETER_WRITE", {"index": PARAMETERS[name].index, "value": value})
            answers = [m for m in link.talk([frame], 2.0) if m[0] == interface().messages["PARAMETER_VALUE"].id]
            said = interface().messages["PARAMETER_VALUE"].decode(answers[0][1])
            assert (said["status"], said["value"]) == (status["range"], PARAMETERS[name].default), name


def test_every_ceiling_names_its_part() -> None:
    assert set(WRITES) < set(CEILINGS)
    for name, parameter in CEILINGS.items():
        assert parameter.ceiling.startswith(("board: ", "motor: ")), name
        assert any(character.isdigit() for character in parameter.ceiling), f"{name}: no rating"


def ends(name: str) -> tuple[float, ...]:
    p = PARAMETERS[name]
    return p.minimum * p.scale, p.maximum * p.scale


def laxest() -> Mapping[str, float]:
    """Every limit where it protects least; of the other ceilings the upper end."""
    lax = {name: ends(name)[1] for name in CEILINGS}
    return {**lax, "supply_low": ends("supply_low")[0]}


SCALES = ("current_scale", "supply_scale", "temperature_scale", "temperature_zero")
CORNERS = [dict(zip(SCALES, corner, strict=True)) for corner in itertools.product(*(ends(name) for name in SCALES))]


@pytest.mark.parametrize(
    ("name", "cause", "faults"),
    [
        ("over_current", Fault("forced", channel="current", value=4094.0, begin=1.0), {"over_current"}),
        ("supply_high", Fault("supply", value=17.6, begin=1.0), {"supply_high", "supply_sensor"}),
        ("supply_drop", Fault("supply", value=4.5, begin=1.0), {"supply_low"}),
        ("over_temperature", None, {"over_temperature"}),
    ],
)
def test_faults_trip_with_everything_at_its_ceiling(name: str, cause: Fault | None, faults: set[str]) -> None:
    shipped = load_scenario(find_scenario(name))
    bits = sum(1 << fault.number for fault in load().faults if fault.name in faults)
    for corner in CORNERS:
        scenario = replace(shipped, duration=2.0, checks=(), provokes=None, firmware={**laxest(), **corner})
        if cause is None:
            hot = replace(shipped.winding, profile=((0.0, 25.0), (1.0, 25.0), (1.001, 154.0), (9.0, 154.0)))
            scenario = replace(scenario, winding=hot)
        else:
            scenario = replace(scenario, faults=(cause,))
        result = run(scenario)
        before, after = result.telemetry["ACTUATE"]["enable"][[900, -1]]
        assert (before, after) == (1, 0), corner
        assert int(result.telemetry["STATUS"]["faults"][-1]) & bits, corner


BEGIN = """
[controller]
name = "toy"
version = 1
tick_hz = 1000
[node]
host = "PC"
[parameter.heat]
default = 50
min = 0
max = 100
meaning = "heat"
"""


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[ceiling.cold]\nmax = 3\npart = 'motor'", "ceiling cold: there is no such parameter"),
        ("[ceiling.heat]\nmax = 101\npart = 'motor'", "ceiling heat: 'max' must be 50 to 100, found 101"),
        ("[ceiling.heat]\nmin = 51\npart = 'motor'", "ceiling heat: 'min' must be 0 to 50, found 51"),
        ("[ceiling.heat]\npart = 'motor'", "ceiling heat: expected 'min', 'max' or both"),
        ("[ceiling.heat]\nmax = 60", "ceiling heat: 'part' is missing"),
        ("[ceiling.heat]\nmax = 60\npart = ''", "ceiling heat: 'part' must name the part whose rating this is"),
        ("[ceiling.heat]\nmax = 60\npart = 'x'\nmost = 3", "ceiling heat: unknown key 'most'"),
    ],
)
def test_a_wrong_ceiling_is_named(text: str, expected: str) -> None:
    with pytest.raises(DescriptionError, match="^" + expected.replace("'", ".") + "$"):
        parse(BEGIN + text)


def test_a_ceiling_narrows_the_range() -> None:
    (parameter,) = parse(BEGIN + "[ceiling.heat]\nmax = 60\npart = 'motor: 60 degC'").parameters
    assert (parameter.minimum, parameter.maximum, parameter.ceiling) == (0, 60, "motor: 60 degC")
