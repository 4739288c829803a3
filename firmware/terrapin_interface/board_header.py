"""terrapin_board.h: what the STM32F405's port knows of its board, from the board's file and the robot's."""

from __future__ import annotations

from terrapin_interface.board import ADC_CHANNELS, Board
from terrapin_interface.entries import Description
from terrapin_interface.robot import Robot

__all__ = ["board_header"]

# How each signal's pin is set up: mode and pull of pins.h. A pull-down keeps the bridge off while the chip is in reset
# or the wire broken; the emergency stop is a contact to ground that opens.
_SET_UP = {
    **{f"gate_{side}": ("FUNCTION", "DOWN") for side in ("a_low", "a_high", "b_low", "b_high")},
    "break": ("FUNCTION", "DOWN"),
    "enable": ("OUTPUT", "DOWN"),
    "estop": ("INPUT", "UP"),
    "led": ("OUTPUT", "FLOATING"),
    "can_transmit": ("FUNCTION", "FLOATING"),
    "imu_select": ("OUTPUT", "UP"),
    "imu_clock": ("FUNCTION", "FLOATING"),
    "imu_out": ("FUNCTION", "FLOATING"),
}
_ALTERNATES = {"TIM1": 1, "TIM3": 2, "TIM4": 2, "SPI1": 5, "USART1": 7, "CAN1": 9}  # DS8626, table 9
_OWN = ("enable", "estop", "led", "imu_select")  # which the port drives itself
_NOWHERE = "{0U, 0U, PIN_INPUT, PIN_FLOATING, 0U}"
ANALOG = ("current", "supply", "temperature")  # in the order of the samples


def _pin(board: Board, role: str) -> str:
    letter, number, function = board.pins[role]
    mode, pull = _SET_UP.get(role, ("ANALOG", "FLOATING") if function == "ADC" else ("FUNCTION", "UP"))
    alternate = _ALTERNATES[function.partition("_")[0]] if mode == "FUNCTION" else 0
    return f"{{{'ABCDE'.index(letter)}U, {number}U, PIN_{mode}, PIN_{pull}, {alternate}U}}"


def _axis(board: Board, name: str) -> str:
    axis, sign = getattr(board.imu, name) if board.imu else (0, 1)
    return f"{{{axis}U, {sign}}}"


def _code(robot: Robot, d: Description, name: str, code: float, part: str) -> int:
    """Raw value of a parameter: what one code of a converter is. RobotError when its range does not hold it."""
    parameter = next(p for p in d.parameters if p.name == name)
    raw = round(code / parameter.scale)
    if not parameter.minimum <= raw <= parameter.maximum:
        low, high = parameter.minimum * parameter.scale, parameter.maximum * parameter.scale
        raise robot.table.contradiction(
            f"sensors.{name.removesuffix('_scale')}.code",
            f"{code:.4g} {parameter.unit} a code",
            f"{low:.4g} to {high:.4g} {parameter.unit}",
            f"analog.{part} of board {robot.board.name}",
        )
    return raw


def board_header(robot: Robot, d: Description) -> str:
    """Text of terrapin_board.h for a robot and the board that it names, `d` being fitted to the robot."""
    board = robot.board
    channels = [ADC_CHANNELS[f"P{letter}{number}"] for letter, number, _ in (board.pins[role] for role in ANALOG)]
    current = _code(robot, d, "current_scale", robot.shunt_code, "shunt")
    supply = _code(robot, d, "supply_scale", robot.divider_code, "upper")
    pins = [f"        {_pin(board, role)}, /* {role} */ \\" for role in board.pins if role not in _OWN]
    values = {
        "NUMBER": f"{board.number}",
        "CRYSTAL_HZ": f"{round(board.crystal)}U",
        "INTERNAL_HZ": f"{round(board.internal)}U",
        "CAN_BIT_S": f"{round(robot.bit_rate)}U",
        "BAUD": f"{round(board.baud)}U",
        "PWM_HZ": f"{round(board.pwm)}U",
        "DEAD_TIME_NS": f"{round(board.dead_time * 1e9)}U",
        "MOTOR_REVERSED": str(board.motor_reversed).lower(),
        "GROUND_REVERSED": str(board.ground_reversed).lower(),
        "CHANNELS": "{" + ", ".join(f"{channel}U" for channel in channels) + "} /* current, supply, temperature */",
        **{role.upper(): _pin(board, role) if role in board.pins else _NOWHERE for role in _OWN},
        "GROUND_WHEEL": str(board.ground_wheel).lower(),
        "IMU": str(board.swing).lower(),
        **{f"IMU_{name.upper()}": _axis(board, name) for name in ("forward", "up", "right")},
    }
    lines = [
        f"/* Board {board.name} of the robot {robot.name}. Generated from their files: do not edit. */",
        "#ifndef TERRAPIN_BOARD_H",
        "#define TERRAPIN_BOARD_H",
        "",
        '#include "pins.h"',
        '#include "terrapin_interface.h"',
        "",
        *(f"#define BOARD_{name} {value}" for name, value in values.items()),
        "",
        "/* What one code of the converters is, raw; stored parameters come after these. */",
        "#define BOARD_PARAMETERS \\",
        "    { \\",
        f"        {{TERRAPIN_PARAMETER_CURRENT_SCALE, {current}}}, \\",
        f"        {{TERRAPIN_PARAMETER_SUPPLY_SCALE, {supply}}}, \\",
        "    }",
        "",
        "/* port (0 is A), number, mode, pull, function */",
        "#define BOARD_PINS \\",
        "    { \\",
        *pins,
        "    }",
        "",
        "#endif",
    ]
    return "\n".join(lines) + "\n"
