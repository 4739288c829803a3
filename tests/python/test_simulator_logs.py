"""The circle on the simulator's own logs, in short: two effects named, added, exported and taken out of C_t's error.

All effects: python -m tests.campaigns.simulator_logs
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from casekit import terrapin

from terrapin_hil.messages import interface
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
from terrapin_tools.contact_error import contact_error
from tests.campaigns.simulator_logs import DESIGNS, look


@pytest.mark.parametrize("name", ["viscous_friction", "shell_imbalance"])
def test_an_effect_of_the_simulator_is_found_in_its_logs(name: str, tmp_path: Path) -> None:
    outcome = look(name, tmp_path)
    assert outcome.named, outcome
    assert outcome.before > 2.0
    assert outcome.after < 1.2  # the noise floor is 1.0
    assert outcome.size == pytest.approx(1.0, abs=DESIGNS[name].tolerance)
    assert outcome.contact is not None
    before, after = outcome.contact
    assert after < 0.5 * before


def test_a_run_with_parameters_prints_the_error_before_and_after(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parameters = tmp_path / "firmware.toml"
    parameters.write_text("[parameters]\ncomp_heating = 0.002\n")
    status, out, _ = terrapin(capsys, "run", "heated_winding", "--parameters", parameters)
    assert status == 0
    scenario = load_scenario(find_scenario("heated_winding"))
    plain = contact_error(run(replace(scenario, checks=()), "inprocess"))
    mended = contact_error(run(scenario, "inprocess", parameters={"comp_heating": 0.002}))
    assert plain is not None
    assert mended is not None
    assert mended.rms < 0.5 * plain.rms
    assert f"C_t error {1e3 * plain.rms:.3g} -> {1e3 * mended.rms:.3g} mN m rms" in out
    _, out, _ = terrapin(capsys, "run", "heated_winding")
    assert "C_t error" not in out


def test_contact_error_is_what_it_says() -> None:
    """Against the truth by hand: the rms over valid windows, each held against the mean truth of its 300 ms."""
    result = run(load_scenario(find_scenario("steady_sand")), "inprocess")
    found = contact_error(result)
    assert found is not None
    assert found.valid
    truth, total, count = result.truth["contact_torque"], 0.0, 0
    ground = result.telemetry["GROUND"]
    length = interface().parameters["window"].default
    for time, torque, valid in zip(ground["time"], ground["torque"], ground["valid"], strict=True):
        end = round(time * 1000) + 1
        if valid and end > length:
            total += (torque - truth[end - length : end].mean()) ** 2
            count += 1
    assert count == found.windows
    assert found.rms == pytest.approx((total / count) ** 0.5, rel=1e-9)
