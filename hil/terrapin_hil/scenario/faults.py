"""Faults that a scenario injects over time; terrapin_hil/robot/native/faults.h says what each does."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from terrapin_hil.reading import Section
from terrapin_hil.robot.sensors import ADCS, CHANNELS, DIGITALS, ENCODERS

__all__ = ["KINDS", "WIRE", "Fault", "Provocation", "read_fault", "read_provocation"]

MAX_FAULTS = 16
FOREVER = 1e9  # s

# kind: number in faults.h, channels that it may name, unit of its value ("" for none)
KINDS: dict[str, tuple[int, tuple[str, ...], str]] = {
    "stuck": (0, CHANNELS, ""),
    "forced": (1, CHANNELS, "1"),
    "absent": (2, DIGITALS, ""),
    "lost_counts": (3, ENCODERS, "1"),
    "estop_pressed": (4, (), ""),
    "estop_wire_broken": (4, (), ""),
    "supply": (5, (), "V"),
    "command_silence": (6, (), ""),
    "link_silence": (7, (), ""),
    "reversed": (8, ENCODERS, ""),
    "drift": (9, CHANNELS, "1/s"),
    "scaled": (10, CHANNELS, "1"),
    "delayed": (11, CHANNELS, "s"),
    "noisy": (12, CHANNELS, "1"),
    "intermittent": (13, CHANNELS, "s"),
    "mirrored": (14, (*ADCS, *DIGITALS), ""),
    # of the bus (wire_faults.py): numbers that the compiled simulator does not know
    "command_crc": (100, (), ""),
    "command_counter": (101, (), ""),
    "babble": (102, (), "1"),
    "tick_repeated": (103, (), ""),
    "extremes": (104, (), ""),
    "stop_all": (105, (), ""),
}
# kind: least and greatest value; of `forced` they are the channel's
_VALUES = {
    "lost_counts": (0.0, 1.0),
    "supply": (0.0, 100.0),
    "babble": (1.0, 40.0),
    "drift": (-1e6, 1e6),
    "scaled": (-100.0, 100.0),
    "delayed": (0.0, 0.255),
    "noisy": (0.0, 1e4),
    "intermittent": (0.002, 10.0),
}
WIRE = tuple(kind for kind, (number, _, _) in KINDS.items() if number >= 100)


@dataclass(frozen=True)
class Fault:
    """Active from `begin` to `end` [s]. `value`: raw number (forced), probability (lost_counts), volts (supply), frames
    a tick (babble), raw numbers a second (drift) or rms (noisy), factor (scaled), seconds (delayed, intermittent)."""

    kind: str
    channel: str = ""
    value: float = 0.0
    begin: float = 0.0
    end: float = FOREVER


def read_fault(section: Section) -> Fault:
    """One table [[fault]]: `kind`, `from`, `to`, and `channel` and `value` where the kind has them."""
    kind = section.choice("kind", KINDS)
    _, channels, unit = KINDS[kind]
    channel = section.choice("channel", channels) if channels else ""
    low, high = _VALUES.get(kind, (0.0, 0.0))
    if kind == "forced":
        low, high = (0.0, 4095.0) if channel in ADCS else (0.0, 65535.0) if channel in ENCODERS else (-32768.0, 32767.0)
    value = section.quantity("value", unit, None, low, high) if unit else 0.0
    begin = section.quantity("from", "s", 0.0, 0.0)
    end = section.quantity("to", "s", FOREVER, begin)
    section.done(("channel", "value"))
    return Fault(kind, channel, value, begin, end)


@dataclass(frozen=True)
class Provocation:
    """What a scenario is for: the controller's fault `fault`, whose cause first shows in the tick at `at` [s]."""

    fault: str
    at: float


def read_provocation(root: Section, names: Iterable[str]) -> Provocation | None:
    """The table [provokes]: `fault`, one of the controller's (`names`), and `at`. None when there is none."""
    if "provokes" not in root:
        return None
    section = root.section("provokes")
    found = Provocation(section.choice("fault", names), section.quantity("at", "s", None, 0.0))
    section.done()
    return found
