"""Steady rolling: the motor's current at a speed (Reina et al. 2006, Eq. 12)."""

from collections.abc import Collection, Mapping

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_tools.workbench.bases.kinds.algebraic import Algebraic, Terms, Values
from terrapin_tools.workbench.bases.kinds.base import ALONE, PARAMETER_COST, PRODUCT_COST, Factor, Quantity, Target

LOSSLESS = Quantity("1", default=1.0)


def before_gear(torque: Array, direction: Array, efficiency: Array) -> Array:
    """The motor's torque behind a gear that loses a share of what it passes on, whichever side drives."""
    return torque / np.where(torque * direction < 0.0, 1.0 / efficiency, efficiency)


class RollingSteady(Algebraic):
    """eta (R/r) K_t i = C_r + A sgn(omega) + B omega + dC, eta the gear's efficiency; 1/eta when driven back."""

    def targets(self) -> list[Target]:
        return [("resistance", 1.0), *super().targets(), ("torque_constant", PARAMETER_COST)]

    def factors(self, target: str, main: str, values: Mapping[str, Array], roles: Collection[str]) -> list[Factor]:
        found = [ALONE]
        omega = values.get("omega")
        reverses = omega is not None and omega.min() < 0.0 < omega.max()
        resists = target == "resistance"
        if reverses and target != "torque_constant":
            found.append(("sign(omega)", 1.0 if resists else PRODUCT_COST, True))
        if resists and "load" in values:
            found.append(("load*sign(omega)" if reverses else "load", PRODUCT_COST, True))
        if resists and omega is not None:
            found.append(("omega", PRODUCT_COST, False))
            found.append(("omega*abs(omega)", PRODUCT_COST**2, False))
        return [f for f in found if f[0] != main]

    def resembles(self, names: Collection[str | None], words: Collection[str]) -> int:
        return 3 if "omega" in names and "current" in names else 0

    def prepare(self, values: Values) -> None:
        if "speed" not in values:
            values["speed"] = np.asarray(values["radius"] * values["omega"])

    def evaluate(self, values: Values, effects: Terms) -> dict[str, Array]:
        resistance = effects.sum("resistance")
        v = {name: np.asarray(value) for name, value in values.items()}
        direction = np.sign(v["omega"])
        rolling = v["f_o"] * v["radius"] * v["load"] * direction
        torque = rolling + v["coulomb"] * direction + v["viscous"] * v["omega"] + resistance
        torque = before_gear(torque, direction, v["gear_efficiency"])
        return {"current": np.asarray(torque * v["drive_radius"] / (v["radius"] * v["torque_constant"]))}


BASE = RollingSteady(
    name="rolling_steady",
    channels={"current": "A"},
    parameters={
        "radius": Quantity("m", "80 mm"),
        "drive_radius": Quantity("m", "18 mm"),
        "torque_constant": Quantity("N m/A", "0.1 N m/A"),
        "coulomb": Quantity("N m", "12 mN m"),
        "viscous": Quantity("N m s/rad", "1 mN m s/rad"),
        "f_o": Quantity("1"),
        "gear_efficiency": LOSSLESS,
    },
    needs={"omega": "", "load": "20 N"},
    first_fit={"f_o": "{ value = 0.05, min = 0.0, max = 0.5 }"},
    column_words={"current": ("current cur i amps", "offset")},
    forces={"resistance": "N m"},
    follows=("time", "angle", "temperature", "voltage", "speed"),  # the axle's speed follows omega
    left_out={  # no causes: what the motor's circuit gives, and what holds the torque up
        "voltage": "with the speed it gives the current by itself",
        "swing_angle": "it follows from the torque",
    },
    convex=True,  # linear in f_o
    on_robot=True,
)
