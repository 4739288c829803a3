"""The controller answers the bits that are kept; whoever changes one on purpose renews them."""

from __future__ import annotations

from dataclasses import replace

from same_bits import DIGITS, differing, kept

from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario


def test_the_same_bits_in_every_scenario() -> None:
    found = differing()
    assert not found, f"other bits in {', '.join(found)}: on purpose? python tests/python/same_bits.py --renew"


def test_another_parameter_is_other_bits() -> None:
    scenario = load_scenario(find_scenario("steady_sand"))
    other = replace(scenario, firmware={**scenario.firmware, "viscous": 0.00101})
    assert run(other).output_hash[:DIGITS] != kept()["steady_sand"]
