"""Driving from the terminal: what the keys of `terrapin monitor --drive` do. The heart beats with each redraw."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Literal

from terrapin_tools.errors import UserError
from terrapin_tools.monitor.controls import Controls, Order

__all__ = ["KEYS", "Driving"]

KEYS = "a arm, r run or halt, + and - setpoint, v voltage or speed, l limiter, c clear, space stops"
STEPS = {"speed": 0.05, "voltage": 0.5}  # m/s, V
UNITS = {"speed": "m/s", "voltage": "V"}
CONFIRM = 3.0  # s in which `a` is pressed once more
ME = "terminal"


class Driving:
    """The order that is given, while the terminal drives."""

    def __init__(self, controls: Controls) -> None:
        self.controls = controls
        self.order = Order()
        self.note = ""
        self._asked = -1e9

    @property
    def armed(self) -> bool:
        """Whether commands go out."""
        return self.controls.driver == ME

    def beat(self) -> None:
        """The terminal is there, and wants this."""
        if self.armed:
            self.controls.beat(ME, self.order)

    def stop(self) -> None:
        """Holds the stop in, or lets it go."""
        self.controls.hold_stop(not self.controls.stop_held)
        self.order = Order()

    def press(self, key: str) -> None:
        """A key of KEYS; what is refused is said in `note`."""
        self.note = ""
        try:
            self._press(key)
        except (UserError, OSError) as error:
            self.note = str(error)
        self.beat()

    def _press(self, key: str) -> None:
        order = self.order
        if key == "a":
            self._arm()
        elif key == "c":
            self.order = replace(order, request="idle")  # which the controller wants after a clear
            self.controls.secure()
            self.controls.clear()
        elif not self.armed:
            self.note = "not armed: a arms"
        elif key == "r":
            self.order = replace(order, request="idle" if order.request == "run" else "run")
        elif key in ("+", "-"):
            step = STEPS[order.control] * (1 if key == "+" else -1)
            self.order = replace(order, setpoint=round(order.setpoint + step, 3))
        elif key == "v":
            control: Literal["voltage", "speed"] = "voltage" if order.control == "speed" else "speed"
            self.order = replace(order, control=control, setpoint=0.0)
        elif key == "l":
            self.order = replace(order, limiter=not order.limiter)

    def _arm(self) -> None:
        if self.armed:
            self.controls.disarm(ME)
        elif time.monotonic() - self._asked > CONFIRM:
            self._asked = time.monotonic()
            self.note = "a once more within 3 s: the robot then moves at r; space stops it"
        else:
            self.order = Order()
            self.controls.secure()
            self.controls.arm(ME)

    @property
    def said(self) -> str:
        """One line for the display."""
        if self.note:
            return self.note
        if self.controls.stop_held:
            return "STOPPED: space lets go and clears"
        if not self.armed:
            return KEYS
        order = self.order
        limiter = "on" if order.limiter else "off"
        return f"ARMED {order.request} {order.setpoint:g} {UNITS[order.control]}, limiter {limiter}; {KEYS}"
