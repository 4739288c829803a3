"""The tests of a robot: copy this file and `ci.yml` into your repository, and write your own beside these.

pytest                                    # the simulated robot, the controller in this process
pytest --terrapin-link pty                # the controller's own process
pytest --terrapin-link serial:/dev/ttyACM0 --terrapin-rig bench.toml      # your board
"""

import pytest


def test_it_measures_the_ground(terrapin_session):
    s = terrapin_session("steady_sand", seed=3)
    s.until("GROUND.valid", timeout=20.0)
    assert abs(s["GROUND.torque"] - s.truth["contact_torque"]) < 4 * s["GROUND.torque_sd"]


def test_the_emergency_stop_stops_it_at_once(terrapin_session):
    s = terrapin_session("steady_sand")
    assert s.step(3.0).state == "run"
    s.inject("estop_pressed").until("STATUS.faults", timeout=0.1)
    assert s.faults == {"estop"}
    assert s.state == "safe"


@pytest.mark.parametrize("encoder", ["motor", "wheel"])
def test_an_encoder_that_sticks_is_doubted(terrapin_session, encoder):
    s = terrapin_session("steady_sand").step(3.0)
    s.inject("stuck", encoder).step(2.0)
    assert s.faults or s["MOTION.slip_valid"] == 0.0


def test_a_parameter_stays_as_it_was_set(terrapin_link):
    before = terrapin_link.read("window")
    assert terrapin_link.write("window", 500.0).read("window") == 500.0
    terrapin_link.write("window", before)


@pytest.mark.terrapin_hardware
def test_the_wire_of_the_emergency_stop(terrapin_rig):
    assert terrapin_rig.press_estop() < 0.002
