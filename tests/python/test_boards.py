"""Boards: what terrapin_board.h takes from a board's file and a robot's, and what contradicts another."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from robot_files import Change, with_board

from terrapin_interface.board_header import board_header
from terrapin_interface.description import load
from terrapin_interface.generate import main
from terrapin_interface.robot import RobotError, find_robot, load_robot


def header(path: Path) -> str:
    robot = load_robot(path)
    return board_header(robot, load(robot=robot))


def defined(text: str) -> dict[str, str]:
    return dict(re.findall(r"^#define (BOARD_\w+) ([^\\\n]+?)(?: /\*.*)?$", text, re.MULTILINE))


def scales(text: str) -> tuple[int, int]:
    found = dict(re.findall(r"\{TERRAPIN_PARAMETER_(\w+), (\d+)\}", text))
    return int(found["CURRENT_SCALE"]), int(found["SUPPLY_SCALE"])


@pytest.mark.parametrize(
    ("robot", "expected"),
    # by hand: 3.3 V / (4096 * 0.8 V/A), * 0.1, * 0.25; 3.3 V * 57 / 10 / 4096, * 110 / 10
    [("cylinder", (1007, 4592)), ("sphere", (8057, 8862)), ("roller", (3223, 4592))],
)
def test_a_code_is_what_shunt_and_divider_make_it(robot: str, expected: tuple[int, int]) -> None:
    assert scales(header(find_robot(robot))) == expected


def test_every_field_of_the_board_is_in_its_header(tmp_path: Path) -> None:
    """A field changed changes the header; it alone."""
    plain = header(with_board(tmp_path, {}))
    changes: dict[str, tuple[object, str]] = {
        "number": (101, "BOARD_NUMBER 101"),
        "clock.crystal": ("25 MHz", "BOARD_CRYSTAL_HZ 25000000U"),
        "links.baud": ("460800 bit/s", "BOARD_BAUD 460800U"),
        "bridge.pwm": ("16 kHz", "BOARD_PWM_HZ 16000U"),
        "bridge.dead_time": ("1.2 us", "BOARD_DEAD_TIME_NS 1200U"),
        "bridge.motor_reversed": (True, "BOARD_MOTOR_REVERSED true"),
        "bridge.ground_reversed": (True, "BOARD_GROUND_REVERSED true"),
        "analog.reference": ("3.35 V", "CURRENT_SCALE, 1022}"),
        "pins.gate_a_low": ("PB13 TIM1_CH1N", "{1U, 13U, PIN_FUNCTION, PIN_DOWN, 1U}, /* gate_a_low */"),
        "pins.break": ("PB12 TIM1_BKIN", "{1U, 12U, PIN_FUNCTION, PIN_DOWN, 1U}, /* break */"),
        "pins.enable": ("PD3 output", "BOARD_ENABLE {3U, 3U, PIN_OUTPUT, PIN_DOWN, 0U}"),
        "pins.estop": ("PD4 input", "BOARD_ESTOP {3U, 4U, PIN_INPUT, PIN_UP, 0U}"),
        "pins.current": ("PC5 ADC", "BOARD_CHANNELS {15U, 11U, 12U}"),
        "pins.temperature": ("PA3 ADC", "BOARD_CHANNELS {10U, 11U, 3U}"),
        "pins.motor_a": ("PB4 TIM3_CH1", "{1U, 4U, PIN_FUNCTION, PIN_UP, 2U}, /* motor_a */"),
        "pins.ground_b": ("PD13 TIM4_CH2", "{3U, 13U, PIN_FUNCTION, PIN_UP, 2U}, /* ground_b */"),
        "pins.can_receive": ("PD0 CAN1_RX", "{3U, 0U, PIN_FUNCTION, PIN_UP, 9U}, /* can_receive */"),
        "pins.can_transmit": ("PD1 CAN1_TX", "{3U, 1U, PIN_FUNCTION, PIN_FLOATING, 9U}, /* can_transmit */"),
    }
    for key, (value, expected) in changes.items():
        text = header(with_board(tmp_path, {key: value}, {"sensors.current.code": None}))
        assert expected in text, key
        assert expected not in plain, key
    fast = header(with_board(tmp_path, {}, {"can.bit_rate": "1 Mbit/s"}))
    assert defined(fast)["BOARD_CAN_BIT_S"] == "1000000U"
    own = header(with_board(tmp_path, {}, {"sensors.current.code": None, "sensors.current.shunt": "19 mohm"}))
    assert scales(own)[0] == 1060


PAGE = (Path(__file__).parents[2] / "docs" / "stm32f405.md").read_text(encoding="utf-8")
(SHOWN,) = re.findall(r"<!-- built: tests/python/test_boards\.py -->\n```toml\n(.*?)```", PAGE, re.DOTALL)
FITTED = tomllib.loads(SHOWN)  # what the page adds to a board's file
IMU: Change = {"imu": FITTED["imu"], **{f"pins.{role}": pin for role, pin in FITTED["pins"].items()}}
NO_WHEEL: Change = {"pins.ground_a": None, "pins.ground_b": None}


def test_an_imu_and_a_ground_wheel_are_fitted_or_not(tmp_path: Path) -> None:
    plain, full = (header(with_board(tmp_path, each)) for each in ({}, IMU))
    assert defined(plain)["BOARD_IMU"] == "false"
    assert defined(full)["BOARD_IMU"] == "true"
    assert "imu" not in plain
    assert "{0U, 5U, PIN_FUNCTION, PIN_FLOATING, 5U}, /* imu_clock */" in full
    assert "{0U, 6U, PIN_FUNCTION, PIN_UP, 5U}, /* imu_in */" in full
    assert defined(full)["BOARD_IMU_SELECT"] == "{0U, 4U, PIN_OUTPUT, PIN_UP, 0U}"
    none = header(with_board(tmp_path, NO_WHEEL))
    assert (defined(plain)["BOARD_GROUND_WHEEL"], defined(none)["BOARD_GROUND_WHEEL"]) == ("true", "false")
    assert "ground_a" not in none
    board = load_robot(with_board(tmp_path, {**IMU, **NO_WHEEL}, {}, "sphere")).board
    assert (board.swing, board.ground_wheel) == (True, False)


@pytest.mark.parametrize("forward", ["+x", "-x", "+y", "-y", "+z", "-z"])
@pytest.mark.parametrize("up", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_the_axle_is_forward_cross_up(forward: str, up: str, tmp_path: Path) -> None:
    change = {**IMU, "imu": {"chip": "icm42688p", "forward": forward, "up": up}}
    if forward[1] == up[1]:
        with pytest.raises(RobotError, match=r"imu\.up: found .*, expected another axis, .*imu\.forward"):
            header(with_board(tmp_path, change))
        return
    axes = np.vstack([np.eye(3), -np.eye(3)])
    names = ["+x", "+y", "+z", "-x", "-y", "-z"]
    right = np.cross(axes[names.index(forward)], axes[names.index(up)])
    found = defined(header(with_board(tmp_path, change)))
    for name, vector in (("FORWARD", axes[names.index(forward)]), ("UP", axes[names.index(up)]), ("RIGHT", right)):
        axis = int(np.flatnonzero(vector)[0])
        assert found[f"BOARD_IMU_{name}"] == f"{{{axis}U, {round(vector[axis])}}}"


CONTRADICTIONS: list[tuple[Change, Change, tuple[str, str]]] = [  # of the board, of the robot, both places
    ({"pins.led": "PE14 output"}, {}, ("pins.led", "pins.enable (line ")),
    ({"pins.estop": "PE9 input"}, {}, ("pins.estop", "pins.gate_a_high (line ")),
    ({"pins.gate_a_high": "PA9 TIM1_CH1"}, {}, ("pins.gate_a_high", "PE9, PA8")),
    ({"pins.motor_a": "PC7 TIM3_CH1"}, {}, ("pins.motor_a", "PC6, PA6, PB4")),
    ({"pins.motor_a": "PB6 TIM4_CH1"}, {}, ("pins.motor_a", "TIM3_CH1")),
    ({"pins.current": "PD0 ADC"}, {}, ("pins.current", "PA0, PA1")),
    ({"bridge.off": ["coast", "brake"]}, {}, ("bridge.off", "stm32f405 opens all transistors")),
    ({"pins.led": "PA13 output"}, {}, ("pins.led", "the debug probe's")),
    ({"bridge.pwm": "1.2 kHz"}, {}, ("bridge.pwm", "at least 1282 Hz for TIM1")),
    ({"bridge.pwm": "60 kHz"}, {}, ("bridge.pwm", "clock.internal (line ")),
    ({"bridge.dead_time": "2.9 us"}, {}, ("bridge.dead_time", "bridge.pwm (line ")),
    ({"clock.crystal": "8.5 MHz"}, {}, ("clock.crystal", "a whole number of MHz for the PLL")),
    ({"number": 1}, {}, ("board", "number of ")),
    ({"links.can": "250 kbit/s"}, {}, ("can.bit_rate", "links.can of board mine")),
    ({}, {"can.bit_rate": "800 kbit/s"}, ("can.bit_rate", "divides 42 MHz")),
    ({"analog.shunt": "21 mohm"}, {"sensors.current.code": None}, ("limits.over_current", "analog.shunt of board")),
    ({"analog.upper": "30 kohm"}, {}, ("limits.supply_high", "analog.upper of board mine")),
    ({"pins.ground_b": None}, {}, ("pins.ground_a", "pins.ground_b", "both or none")),
    ({"pins.imu_clock": "PA5 SPI1_SCK"}, {}, ("pins.imu_clock", "[imu]")),
    ({**IMU, "pins.imu_in": "PB5 SPI1_MISO"}, {}, ("pins.imu_in", "PA6, PB4")),
    ({**IMU, "pins.motor_a": "PA6 TIM3_CH1"}, {}, ("pins.imu_in", "pins.motor_a (line ")),
    ({**IMU, "imu": {"chip": "mpu6500", "forward": "+x", "up": "+z"}}, {}, ("imu.chip", "icm42688p")),
    ({"sensors": {"swing": True}}, {}, ("sensors.swing", "[imu]")),
    ({**IMU, "sensors": {"swing": False}}, {}, ("sensors.swing", "imu.chip (line ")),
    ({"sensors": {"pitch": True}}, {}, ("sensors.pitch", "no driver")),
    ({"analog.shunt": "5 mohm"}, {}, ("sensors.current.code", "analog.shunt of board mine")),
    ({"analog.upper": "80 kohm"}, {}, ("sensors.supply.code", "analog.upper of board mine")),
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(CONTRADICTIONS)))
def test_a_contradiction_is_refused_with_both_places(number: int, tmp_path: Path) -> None:
    board, robot, places = CONTRADICTIONS[number]
    with pytest.raises(RobotError) as found:
        header(with_board(tmp_path, board, robot))
    message = str(found.value)
    assert "\n" not in message
    assert message.startswith(str(tmp_path)), message
    for place in (*places, "found", "expected"):
        assert place in message, message


def test_a_board_of_ones_own_is_known_by_its_name(tmp_path: Path) -> None:
    """Bus and tools name it as they name the shipped ones; the interface of robots on these stays as it was."""
    own = load(robot=load_robot(with_board(tmp_path, {})))
    assert own.enums["board"]["mine"] == 100
    assert load().enums["board"] == load(robot=load_robot(find_robot("cylinder"))).enums["board"]


def test_the_build_asks_for_the_boards_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--board", "--robot", str(with_board(tmp_path, {}))]) == 0
    assert capsys.readouterr().out == f"mine;{(tmp_path / 'mine.toml').resolve()}"
