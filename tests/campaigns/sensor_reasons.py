"""Why a failure of a sensor is not named within half a second in every run: one sentence for each channel and way.

The sweep (tests/campaigns/sensors.py) fails where a cell is not named and has no sentence here.
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["REASONS"]

_SWING = "no second sensor tells the angle of the inner body"
_RATE = "no second sensor tells the rate of the inner body (the angle could, but the core has no room for it)"
_PITCH = "no second sensor tells the slope"
_GUARD = "the sphere, whose guard of the swing reads it, is named"

REASONS: Mapping[tuple[str, str], str] = {
    ("current", "stuck"): "in steady motion the current of a moment ago is right; at rest it is no zero, and named",
    ("current", "drift"): "the reading is right at first; later the zero at rest or the back-EMF contradicts it",
    ("current", "sign"): "twice R_e i, by which the back-EMF is then off, is below encoder_tolerance at these currents",
    ("current", "scale 2"): "R_e i, by which the back-EMF is then off, is below encoder_tolerance at these currents",
    ("current", "delay"): "in steady motion the current of 0.2 s ago is right; its zero comes late, and is named",
    ("current", "noise"): "ten times a code's noise is within the range, and R_e times it below encoder_tolerance",
    ("current", "intermittent"): "for 50 ms a loose contact keeps a reading, which is right in steady motion",
    ("supply", "stuck"): "the supply of a moment ago is right while the battery is",
    ("supply", "drift"): "the reading is right at first and named when it passes supply_high",
    ("supply", "delay"): "the supply of 0.2 s ago is right while the battery is",
    ("supply", "noise"): "ten times a code's noise passes neither limit for twenty ticks",
    ("supply", "intermittent"): "for 50 ms a loose contact keeps a reading, and the battery is as it was",
    ("temperature", "stuck"): "the winding warms over minutes: the temperature of a moment ago is right",
    ("temperature", "drift"): "every reading is a temperature that a winding may have, and none is a limit's",
    ("temperature", "sign"): "the mirrored code is a temperature that a winding may have",
    ("temperature", "scale 2"): "the doubled code is a temperature that a winding may have",
    ("temperature", "delay"): "the winding warms over minutes: the temperature of 0.2 s ago is right",
    ("temperature", "noise"): "ten times a code's noise passes no limit for twenty ticks",
    ("temperature", "intermittent"): "for 50 ms a loose contact keeps a reading, and the winding is as warm",
    ("motor", "stuck"): "where the motor is slow its back-EMF hardly passes encoder_tolerance",
    ("motor", "drift"): "2,000 counts a second are less back-EMF than encoder_tolerance",
    ("motor", "dropout"): "where the motor is slow its back-EMF hardly passes encoder_tolerance",
    ("motor", "sign"): "twice the back-EMF of the sphere, slow there, is below encoder_tolerance",
    ("motor", "scale 2"): "the back-EMF that the doubled speed lacks passes encoder_tolerance at full speed only",
    ("motor", "delay"): "while the roller backs out its speed of 0.2 s ago differs by less than encoder_tolerance",
    ("motor", "noise"): "ten times the rounding of a count is less back-EMF than encoder_tolerance",
    ("motor", "intermittent"): "half of the ticks disagree, the others take a quarter back: its 0.2 s take 0.53 s",
    ("wheel", "stuck"): "the sphere hardly moves as it begins to back out (0.01 m/s): a wheel at rest is right",
    ("wheel", "drift"): "0.18 m/s is slip as it may be; named where the robot then seems to be stuck",
    ("wheel", "dropout"): "the sphere hardly moves as it begins to back out (0.01 m/s): a wheel at rest is right",
    ("wheel", "sign"): "the sphere hardly moves as it begins to back out (0.01 m/s): twice that is no jump",
    ("wheel", "scale 2"): "the sphere is slow there (0.1 m/s and less): the jump to twice that is slower than 25 m/s^2",
    ("wheel", "delay"): "the sphere hardly moves as it begins to back out (0.01 m/s): 0.2 s ago it was as slow",
    ("wheel", "intermittent"): "the sphere is slow there (0.1 m/s and less): counts that come late make no jump",
    ("swing_angle", "stuck"): f"{_SWING}; an inner body that hangs still reads the same",
    ("swing_angle", "zero"): f"{_SWING}; zero is how it hangs at rest",
    ("swing_angle", "full scale"): f"{_SWING}, and cylinders have no guard that it passes; {_GUARD}",
    ("swing_angle", "drift"): f"{_SWING}; the sphere's guard sees it once it is beyond its limit",
    ("swing_angle", "dropout"): f"a chip that is silent is no sensor, and cylinders do without; {_GUARD}",
    ("swing_angle", "sign"): f"{_SWING}; the mirrored angle is one that it may have",
    ("swing_angle", "scale 2"): f"{_SWING}; the sphere's guard sees it where the doubled angle is beyond its limit",
    ("swing_angle", "delay"): f"{_SWING}; in steady motion that of 0.2 s ago is right",
    ("swing_angle", "noise"): f"{_SWING}; ten times its resolution stays within the guard",
    ("swing_angle", "intermittent"): f"{_SWING}; what a loose contact repeats is an angle that it had",
    ("swing_rate", "stuck"): f"{_RATE}; a body that hangs still reads the same",
    ("swing_rate", "zero"): f"{_RATE}; zero is right in steady motion",
    ("swing_rate", "full scale"): f"{_RATE}; what it makes of the slip saturates a signal at low speed only",
    ("swing_rate", "drift"): f"{_RATE}; each reading is a rate that it may have",
    ("swing_rate", "dropout"): f"a chip that is silent is no sensor, and cylinders do without; {_GUARD}",
    ("swing_rate", "sign"): f"{_RATE}; the mirrored rate is one that it may have",
    ("swing_rate", "scale 2"): f"{_RATE}; the doubled rate is one that it may have",
    ("swing_rate", "delay"): f"{_RATE}; in steady motion that of 0.2 s ago is right",
    ("swing_rate", "noise"): f"{_RATE}; ten times its resolution is small against a swing",
    ("swing_rate", "intermittent"): f"{_RATE}; what a loose contact repeats is a rate that it had",
    ("pitch", "stuck"): f"{_PITCH}; on even ground it reads the same",
    ("pitch", "zero"): f"{_PITCH}; zero is right on level ground",
    ("pitch", "full scale"): f"{_PITCH}; what follows of it saturates a signal late, if at all",
    ("pitch", "drift"): f"{_PITCH}; each reading is a slope that there may be",
    ("pitch", "dropout"): "a chip that is silent is no sensor, and every robot does without a slope",
    ("pitch", "sign"): f"{_PITCH}; the mirrored slope is one that there may be",
    ("pitch", "scale 2"): f"{_PITCH}; the doubled slope is one that there may be",
    ("pitch", "delay"): f"{_PITCH}; that of 0.2 s ago is nearly right",
    ("pitch", "noise"): f"{_PITCH}; ten times its resolution is small against a slope",
    ("pitch", "intermittent"): f"{_PITCH}; what a loose contact repeats is a slope that it had",
    ("ground_speed", "stuck"): "in steady motion the speed of a moment ago is right; named when it changes",
    ("ground_speed", "zero"): "the sphere hardly moves as it begins to back out: zero is within ground_tolerance",
    ("ground_speed", "full scale"): "disagreement has to last for half a second: named after 0.50 s, once 0.51 s",
    ("ground_speed", "drift"): "right at first; named half a second after it is beyond ground_tolerance",
    ("ground_speed", "dropout"): "a source that is silent is no sensor, and every robot does without it",
    ("ground_speed", "sign"): "the sphere hardly moves as it begins to back out: twice that is within ground_tolerance",
    ("ground_speed", "scale 2"): "the sphere is slow there: the doubled speed is within ground_tolerance",
    ("ground_speed", "delay"): "in steady motion the speed of 0.2 s ago is right; named when it changes",
    ("ground_speed", "noise"): "ten times its resolution is within ground_tolerance",
    ("ground_speed", "intermittent"): "what a loose contact repeats is the speed of a moment ago",
}  # fmt: skip
