"""Frames to arrays: the controller's telemetry in SI units, from the interface description."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array, Index
from terrapin_hil.messages import Interface, Signal, raw_value
from terrapin_hil.units import base_factor, units

__all__ = ["decode", "decode_signal", "si_factor", "signals", "words"]


def signals(interface: Interface) -> dict[str, tuple[str, str]]:
    """MESSAGE.signal -> (message, signal), of everything that the controller sends."""
    return {
        f"{message.name}.{signal.name}": (message.name, signal.name)
        for message in interface.messages.values()
        if message.sender == "controller"
        for signal in message.signals
    }


def words(interface: Interface) -> dict[str, Mapping[str, int]]:
    """MESSAGE.signal -> word -> value, of the signals that have words for their values."""
    return {
        f"{message.name}.{signal.name}": interface.enums[signal.enum]
        for message in interface.messages.values()
        for signal in message.signals
        if signal.enum
    }


@cache
def si_factor(unit: str) -> float:
    """What a value in `unit` is multiplied by to be SI; temperatures stay in degC.

    >>> si_factor("mA")
    0.001
    """
    if unit in ("", "1", "degC"):
        return 1.0
    known = base_factor(unit)
    if known is not None:
        return known
    return float(units().Quantity(1.0, unit).to_base_units().magnitude)


def decode_signal(signal: Signal, words: Index) -> Array:
    """Physical values (SI) of a signal from the data of frames as little-endian 64-bit words."""
    return np.asarray(raw_value(signal, words) * (signal.scale * si_factor(signal.unit)), dtype=np.float64)


def decode(
    interface: Interface, times: Array, identifiers: npt.NDArray[Any], data: npt.NDArray[np.uint8]
) -> Mapping[str, dict[str, Array]]:
    """Message -> signal (and "time") -> array, one entry a frame. `data` is (frames, 8), padded with zeros.

    Frames whose identifier the interface does not know are left out.
    """
    words = np.ascontiguousarray(data).view("<i8").reshape(-1)
    found: dict[str, dict[str, Array]] = {}
    for message in interface.messages.values():
        mine = identifiers == message.id
        if not np.any(mine):
            continue
        table = {"time": times[mine]}
        for signal in message.signals:
            table[signal.name] = decode_signal(signal, words[mine])
        found[message.name] = table
    return found
