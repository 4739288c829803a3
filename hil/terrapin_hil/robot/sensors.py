"""Sensors as a scenario describes them; terrapin_hil/robot/native/sensors.c does what they do.

Three kits: `ideal` has the resolution of the real parts and half a code of noise that dithers the converters' rounding
away, nothing else; `exact` leaves the dither out as well; `real` has the errors of ordinary parts. Any field of any
channel can be set on its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from terrapin_hil.messages import interface
from terrapin_hil.reading import Section, quantities
from terrapin_hil.robot.compiled_effects import ActiveEffect
from terrapin_hil.robots import selected

__all__ = [
    *("ADCS", "CHANNELS", "DIGITALS", "ENCODERS", "Adc", "Digital", "Encoder", "Sensors"),
    *("kit", "read_sensors", "with_effects"),
]

ADCS = ("current", "supply", "temperature")
ENCODERS = ("motor", "wheel")
DIGITALS = ("swing_angle", "swing_rate", "pitch", "ground_speed")
CHANNELS = (*ADCS, *ENCODERS, *DIGITALS)  # in the order of the enum in sensors.h
MAX_DELAY = 0.063  # s, HIL_MAX_DELAY ticks


def _q(default: float, unit: str = "1", low: float | None = None, high: float | None = None) -> Any:
    limits = {key: value for key, value in (("low", low), ("high", high)) if value is not None}
    return field(default=default, metadata={"unit": unit, **limits})


@dataclass(frozen=True)
class Adc:
    """12-bit converter. `lsb` is in the channel's unit a code; offset, inl and noise are in codes."""

    lsb: float = _q(1.0, "1", 1e-9)
    zero: float = _q(0.0)
    offset: float = _q(0.0)
    gain_error: float = _q(0.0, "1", -0.5, 0.5)
    inl: float = _q(0.0)
    inl_cycles: float = _q(1.0, "1", 0.0, 8.0)
    noise: float = _q(0.0, "1", 0.0)
    delay: float = _q(0.0, "s", 0.0, MAX_DELAY)


@dataclass(frozen=True)
class Encoder:
    """Incremental encoder; `misalignment` is the amplitude of an error once a turn, `loss` the share of lost counts.

    `play` is the width of a gap through which it follows its shaft.
    """

    counts_per_turn: float = field(
        default_factory=lambda: interface().constants["encoder_counts"],
        metadata={"unit": "1", "low": 1.0, "high": 65536.0},
    )
    misalignment: float = _q(0.0, "rad", -1.0, 1.0)
    phase: float = _q(0.0, "rad", -10.0, 10.0)
    loss: float = _q(0.0, "1", 0.0, 1.0)
    play: float = _q(0.0, "rad", 0.0, 10.0)
    delay: float = _q(0.0, "s", 0.0, MAX_DELAY)


@dataclass(frozen=True)
class Digital:
    """A chip that measures and sends numbers; `largest` is the greatest raw magnitude that its CAN signal carries."""

    resolution: float = _q(1.0, "1", 1e-9)
    largest: float = _q(4095.0, "1", 1.0, 32767.0)
    offset: float = _q(0.0)
    noise: float = _q(0.0, "1", 0.0)
    delay: float = _q(0.0, "s", 0.0, MAX_DELAY)
    present: bool = True


@dataclass(frozen=True)
class Sensors:
    """Those of the robot of this process (terrapin_hil.robots)."""

    current: Adc = field(default_factory=lambda: Adc(lsb=selected().current_code, zero=2048.0))  # A
    supply: Adc = field(default_factory=lambda: Adc(lsb=selected().supply_code))  # V
    temperature: Adc = field(default_factory=lambda: Adc(lsb=0.05, zero=1000.0))  # degC
    motor: Encoder = field(default_factory=Encoder)
    wheel: Encoder = field(default_factory=lambda: Encoder(counts_per_turn=float(selected().wheel_counts)))
    swing_angle: Digital = field(default_factory=lambda: Digital(resolution=1e-3, present=selected().swing))
    swing_rate: Digital = field(default_factory=lambda: Digital(resolution=1e-2, present=selected().swing))
    pitch: Digital = field(default_factory=lambda: Digital(resolution=1e-3, largest=2047.0, present=selected().pitch))
    ground_speed: Digital = field(default_factory=lambda: Digital(resolution=1e-3, present=selected().ground_speed))


def _ideal() -> Sensors:
    s = Sensors()
    return replace(
        s,
        current=replace(s.current, noise=0.5),
        supply=replace(s.supply, noise=0.5),
        temperature=replace(s.temperature, noise=0.5),
    )


def _real() -> Sensors:
    s = Sensors()
    return replace(
        s,
        current=replace(s.current, offset=2.0, inl=1.0, gain_error=0.005, noise=1.0),
        supply=replace(s.supply, offset=2.0, inl=1.0, gain_error=0.005, noise=1.0),
        temperature=replace(s.temperature, offset=2.0, inl=1.0, gain_error=0.005, noise=1.0),
        motor=replace(s.motor, misalignment=0.002),
        wheel=replace(s.wheel, misalignment=0.002),
        swing_angle=replace(s.swing_angle, noise=2e-3, delay=0.002),
        swing_rate=replace(s.swing_rate, noise=2e-2, delay=0.001),
        pitch=replace(s.pitch, noise=2e-3, delay=0.002),
        ground_speed=replace(s.ground_speed, noise=5e-3, delay=0.03),
    )


KITS: dict[str, Callable[[], Sensors]] = {"exact": Sensors, "ideal": _ideal, "real": _real}


def kit(name: str) -> Sensors:
    """The sensors of a kit: "exact", "ideal" or "real".

    >>> kit("real").current.offset
    2.0
    """
    return KITS[name]()


def with_effects(sensors: Sensors, effects: Sequence[ActiveEffect], gear: float) -> Sensors:
    """The sensors with what effects on them set, beside what they have already. ValueError for what they cannot do.

    An effect's gap is at the shell: the motor's encoder turns `gear` times as far. Phases replace, the rest adds up.
    """
    for active in effects:
        for place, name in active.effect.sensor.items():
            channel, setting = place.split(".")
            present = getattr(sensors, channel)
            value = active.values[name] * (gear if setting == "play" else 1.0)
            total = value if setting == "phase" else getattr(present, setting) + value
            if setting == "delay" and total > MAX_DELAY:
                raise ValueError(
                    f"{active.effect.name}: found {total:g} s for {channel}, expected at most {MAX_DELAY} s"
                )
            sensors = replace(sensors, **{channel: replace(present, **{setting: total})})
    return sensors


def read_sensors(section: Section) -> Sensors:
    """The table [sensors]: `kit`, and tables of channels whose fields replace the kit's."""
    sensors = kit(section.choice("kit", KITS, "ideal"))
    changed: dict[str, Any] = {}
    for name in CHANNELS:
        if name not in section:
            continue
        channel = section.section(name)
        default = getattr(sensors, name)
        present = {"present": channel.flag("present", default.present)} if isinstance(default, Digital) else {}
        changed[name] = replace(quantities(channel, type(default), default), **present)
    section.done(CHANNELS)
    return replace(sensors, **changed)
