"""A board: chip, clock, pins, bridge and what its converters see. One file, boards/NAME.toml beside the robots'."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from terrapin_interface.robot_table import RobotTable

__all__ = ["ADC_CHANNELS", "Board", "Imu", "can_reaches", "find_board", "load_board"]

_PIN = re.compile(r"P([A-E])(\d{1,2}) (\w+)")
# What a signal's pin has to be able to do; of the chip's alternatives those that the port's drivers set up.
ROLES: Mapping[str, tuple[str, ...]] = {
    "gate_a_low": ("TIM1_CH1N",),
    "gate_a_high": ("TIM1_CH1",),
    "gate_b_low": ("TIM1_CH2N",),
    "gate_b_high": ("TIM1_CH2",),
    "break": ("TIM1_BKIN",),
    "enable": ("output",),
    "estop": ("input",),
    "led": ("output",),
    "usart_transmit": ("USART1_TX",),
    "usart_receive": ("USART1_RX",),
    "can_receive": ("CAN1_RX",),
    "can_transmit": ("CAN1_TX",),
    "motor_a": ("TIM3_CH1",),
    "motor_b": ("TIM3_CH2",),
    "ground_a": ("TIM4_CH1",),
    "ground_b": ("TIM4_CH2",),
    "current": ("ADC",),
    "supply": ("ADC",),
    "temperature": ("ADC",),
    "imu_select": ("output",),
    "imu_clock": ("SPI1_SCK",),
    "imu_in": ("SPI1_MISO",),
    "imu_out": ("SPI1_MOSI",),
}
IMU = tuple(role for role in ROLES if role.startswith("imu_"))
GROUND = ("ground_a", "ground_b")  # of a wheel that a board may do without
# Channels of ADC1: data sheet DS8626, table 7.
ADC_CHANNELS: Mapping[str, int] = {
    **{f"PA{n}": n for n in range(8)},
    "PB0": 8,
    "PB1": 9,
    **{f"PC{n}": 10 + n for n in range(6)},
}
# Data sheet DS8626, table 9: the pins of LQFP100 that have a function.
FUNCTIONS: Mapping[str, tuple[str, ...]] = {
    "TIM1_CH1N": ("PE8", "PA7", "PB13"),
    "TIM1_CH1": ("PE9", "PA8"),
    "TIM1_CH2N": ("PE10", "PB0", "PB14"),
    "TIM1_CH2": ("PE11", "PA9"),
    "TIM1_BKIN": ("PE15", "PA6", "PB12"),
    "TIM3_CH1": ("PC6", "PA6", "PB4"),
    "TIM3_CH2": ("PC7", "PA7", "PB5"),
    "TIM4_CH1": ("PB6", "PD12"),
    "TIM4_CH2": ("PB7", "PD13"),
    "USART1_TX": ("PA9", "PB6"),
    "USART1_RX": ("PA10", "PB7"),
    "CAN1_RX": ("PB8", "PA11", "PD0"),
    "CAN1_TX": ("PB9", "PA12", "PD1"),
    "SPI1_SCK": ("PA5", "PB3"),
    "SPI1_MISO": ("PA6", "PB4"),
    "SPI1_MOSI": ("PA7", "PB5"),
    "ADC": tuple(ADC_CHANNELS),
}
DEBUG = ("PA13", "PA14")  # SWD: the probe's, from the reset on
TIMER = 168e6  # [Hz] of TIM1, which counts up and down in a period,
LONGEST = 65535  # to this at most
CONVERSION = 3 * (15 + 12) * 4  # clocks of the bus for three samples (analog.c)
QUANTA = range(8, 19)  # of a bit on CAN (can.c)
BUS = 42e6  # [Hz] of CAN


Axis = tuple[int, int]  # of a chip: 0 is x; 1 or -1


@dataclass(frozen=True)
class Imu:
    """An IMU on the inner body: which of its axes point forward and away from the bob when that hangs at rest."""

    chip: str
    forward: Axis
    up: Axis

    @property
    def right(self) -> Axis:
        """Forward cross up: the axle, about which a positive rate swings the bob forward."""
        axis = 3 - self.forward[0] - self.up[0]
        even = (self.forward[0] + 1) % 3 == self.up[0]
        return axis, self.forward[1] * self.up[1] * (1 if even else -1)


@dataclass(frozen=True)
class Board:
    """What a board's file says, SI."""

    name: str
    file: Path
    title: str
    number: int  # enum.board of controller.toml
    chip: str
    crystal: float  # [Hz]
    internal: float  # [Hz], without the crystal
    baud: float  # [bit/s]
    can: float  # [bit/s], the fastest
    pwm: float  # [Hz]
    dead_time: float  # [s]
    off: tuple[str, ...]  # what the bridge can do when it is off: coast, brake
    motor_reversed: bool
    ground_reversed: bool
    reference: float  # of the converters [V]
    shunt: float  # [ohm]
    amplification: float
    upper: float  # of the supply's divider [ohm]
    lower: float
    pitch: bool  # sensors that it can read
    ground_speed: bool
    imu: Imu | None
    pins: Mapping[str, tuple[str, int, str]]  # signal -> port letter, number, function
    text: str = field(repr=False)  # the file

    @property
    def swing(self) -> bool:
        """Whether it can read the swing."""
        return self.imu is not None

    @property
    def ground_wheel(self) -> bool:
        """Whether it has an encoder for the ground wheel, without which the slip limiter is not armed."""
        return GROUND[0] in self.pins


def load_board(path: Path) -> Board:
    """The board of a file. RobotError: one line with file, line, field and what was expected."""
    table = RobotTable.load(path)
    imu = _imu(table)
    board = Board(
        name=path.stem,
        file=path,
        title=table.word("title"),
        number=table.whole("number", 1, 255),
        chip=table.choice("chip", ["stm32f405"]),
        crystal=table.number("clock.crystal", "Hz", 4e6, 26e6),
        internal=table.number("clock.internal", "Hz", 1e6, 168e6),
        baud=table.number("links.baud", "bit/s", 115200.0, 2e6),
        can=table.number("links.can", "bit/s", 125e3, 1e6),
        pwm=table.number("bridge.pwm", "Hz", 1e3, 1e5),
        dead_time=table.number("bridge.dead_time", "s", 0.0, 3e-6),
        off=table.words("bridge.off", ["coast", "brake"]),
        motor_reversed=table.flag("bridge.motor_reversed", False),
        ground_reversed=table.flag("bridge.ground_reversed", False),
        reference=table.number("analog.reference", "V", 1.0, 3.6),
        shunt=table.number("analog.shunt", "ohm", 1e-4, 1.0),
        amplification=table.number("analog.amplification", "1", 1.0, 1000.0),
        upper=table.number("analog.upper", "ohm", 0.0, 1e7),
        lower=table.number("analog.lower", "ohm", 1.0, 1e7),
        pitch=table.flag("sensors.pitch", False),
        ground_speed=table.flag("sensors.ground_speed", False),
        imu=imu,
        pins=_pins(table, [*(GROUND if _ground_wheel(table) else ()), *(IMU if imu else ())]),
        text=table.text,
    )
    for sensor in ("pitch", "ground_speed"):
        if getattr(board, sensor):
            raise table.error(f"sensors.{sensor}", f"found true, expected false: {board.chip} has no driver for one")
    swing = table.flag("sensors.swing", board.swing)
    table.done()
    if swing != board.swing:
        raise table.contradiction(
            "sensors.swing",
            str(swing).lower(),
            str(board.swing).lower(),
            table.place("imu.chip") if imu else "no [imu]",
        )
    if board.crystal % 1e6:
        raise table.error("clock.crystal", f"found {board.crystal:g} Hz, expected a whole number of MHz for the PLL")
    if board.off != ("coast",):
        raise table.error(
            "bridge.off",
            f"found {', '.join(board.off)}, expected coast: {board.chip} opens all transistors",
        )
    _check_pwm(table, board)
    if board.dead_time * board.pwm > 0.05:
        raise table.contradiction(
            "bridge.dead_time",
            f"{board.dead_time * 1e9:g} ns",
            f"at most {0.05 / board.pwm * 1e9:g} ns, a twentieth of a period",
            table.place("bridge.pwm"),
        )
    return board


def can_reaches(bit_rate: float) -> bool:
    """Whether CAN1's clock makes a bit rate exactly: a prescaler of 1 to 1024 and 8 to 18 quanta a bit."""
    clocks = [BUS / (bit_rate * quanta) for quanta in QUANTA]
    return any(1 <= round(n) <= 1024 and abs(n - round(n)) < 1e-9 for n in clocks)


def _check_pwm(table: RobotTable, board: Board) -> None:
    """TIM1 counts 16 bits; without the crystal the converter's bus runs at `internal`, and still ends in a period."""
    least, most = TIMER / (2 * LONGEST), board.internal / CONVERSION
    if board.pwm < least:
        raise table.error("bridge.pwm", f"found {board.pwm:g} Hz, expected at least {math.ceil(least)} Hz for TIM1")
    if board.pwm > most:
        raise table.contradiction(
            "bridge.pwm",
            f"{board.pwm:g} Hz",
            f"at most {math.floor(most)} Hz, for three samples a period",
            table.place("clock.internal"),
        )


def _imu(table: RobotTable) -> Imu | None:
    if not table.below("imu"):
        return None
    ends = [sign + axis for axis in "xyz" for sign in "+-"]
    chip = table.choice("imu.chip", ["icm42688p"])
    forward, up = (table.choice(f"imu.{key}", ends) for key in ("forward", "up"))
    if forward[1] == up[1]:
        raise table.contradiction("imu.up", up, "another axis", table.place("imu.forward"))
    first, second = (("xyz".index(end[1]), 1 if end[0] == "+" else -1) for end in (forward, up))
    return Imu(chip, first, second)


def _ground_wheel(table: RobotTable) -> bool:
    """Both of its pins, or none."""
    given = [f"pins.{role}" in table for role in GROUND]
    if any(given) and not all(given):
        there, missing = (f"pins.{GROUND[given.index(each)]}" for each in (True, False))
        raise table.contradiction(there, "one input of the ground wheel's encoder", "both or none", missing)
    return all(given)


def _pins(table: RobotTable, fitted: Sequence[str]) -> dict[str, tuple[str, int, str]]:
    """Pins of the roles that each board has, and of those that are `fitted` on this one."""
    pins: dict[str, tuple[str, int, str]] = {}
    owner: dict[str, str] = {}
    for role, functions in ROLES.items():
        if role in (*GROUND, *IMU) and role not in fitted:
            continue
        key = f"pins.{role}"
        text = table.word(key)
        match = _PIN.fullmatch(text)
        if match is None or int(match[2]) > 15:
            raise table.error(key, f"found {text!r}, expected a pin and its function, such as 'PE9 {functions[0]}'")
        pin, function = f"P{match[1]}{int(match[2])}", match[3]
        if function not in functions:
            raise table.error(key, f"found {function}, expected {' or '.join(functions)}")
        able = FUNCTIONS.get(function)
        if able is not None and pin not in able:
            raise table.error(key, f"found {pin}, expected one of {', '.join(able)}, which have {function}")
        if pin in DEBUG:
            raise table.error(key, f"found {pin}, which is the debug probe's, expected another pin")
        if pin in owner:
            raise table.contradiction(key, pin, "a pin that nothing else takes", table.place(owner[pin]))
        owner[pin] = key
        pins[role] = match[1], int(match[2]), function
    extra = set(table.below("pins")) - set(pins)
    if extra & set(IMU):
        raise table.error(f"pins.{min(extra & set(IMU))}", "found a pin, expected a table [imu] that says which chip")
    if extra:
        raise table.error(f"pins.{min(extra)}", f"no such signal; known: {', '.join(ROLES)}")
    return pins


def find_board(name: str, folder: Path, table: RobotTable) -> Board:
    """The board that a robot's file names: `folder`/boards/NAME.toml, or a file beside the robot's.

    RobotError names the robot's field when there is none.
    """
    known = sorted(path.stem for path in (folder / "boards").glob("*.toml"))
    if name in known:
        return load_board(folder / "boards" / f"{name}.toml")
    beside = Path(table.file).parent / name
    if name.endswith(".toml") and beside.is_file():
        return load_board(beside)
    raise table.error("board", f"found {name[:60]!r}, expected a file beside this one, or one of {', '.join(known)}")
