"""A pendulum-driven sphere that rolls steadily over sand: the motor's current and the pull at a slip.

The contact is that of Li et al. 2024, Eqs. 1 to 6. What resists the axle (bulldozing, slip sinkage) takes from the pull
and not from the torque, as in the simulator: a wall's pressure points at the axle.
"""

from collections.abc import Collection

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.physics import contact, sphere
from terrapin_tools.workbench.bases.kinds.algebraic import Terms, Values
from terrapin_tools.workbench.bases.kinds.base import PARAMETER_COST, Quantity, Target
from terrapin_tools.workbench.bases.kinds.contact import SOIL, Contact, Solved
from terrapin_tools.workbench.bases.rolling_steady import LOSSLESS, before_gear


class RollingSphere(Contact):
    """eta (R/r) K_t i = T(s) sgn(omega)/eta_j + A sgn(omega) + B omega + dC, and the pull F(s) - X, along the motion.
    Of the two efficiencies eta stands before the friction, eta_j behind it."""

    def targets(self) -> list[Target]:
        return [("resistance", 1.0), *super().targets(), ("torque_constant", PARAMETER_COST)]

    def resembles(self, names: Collection[str | None], words: Collection[str]) -> int:
        return 5 if {"omega", "slip", "current"} <= set(names) else 0

    def prepare(self, values: Values) -> None:
        super().prepare(values)
        if "speed" not in values:
            values["speed"] = np.asarray(values["radius"] * values["omega"] * (1.0 - values["slip"]))

    def outputs(self, values: Values, terms: Terms, solved: Solved) -> dict[str, Array]:
        v = {name: np.asarray(values[name]) for name in ("radius", "drive_radius", "torque_constant", "omega")}
        direction = np.sign(v["omega"])
        shell = before_gear(solved.torque * direction, direction, np.asarray(values["joint_efficiency"]))
        torque = shell + values["coulomb"] * direction + values["viscous"] * v["omega"]
        efficiency = np.asarray(values["gear_efficiency"])
        geared = v["radius"] / v["drive_radius"] * v["torque_constant"]
        return {
            "current": before_gear(torque + terms.sum("resistance"), direction, efficiency) / geared,
            "traction": solved.traction - terms.sum("drag"),
        }


BASE = RollingSphere(
    name="rolling_sphere",
    channels={"current": "A", "traction": "N"},
    parameters={
        "radius": Quantity("m", "0.22 m"),
        "drive_radius": Quantity("m", "3.3333 mm"),
        "torque_constant": Quantity("N m/A", "36.9 mN m/A"),
        "coulomb": Quantity("N m", "0.6 N m"),
        "viscous": Quantity("N m s/rad", "50 mN m s/rad"),
        "gear_efficiency": LOSSLESS,
        "joint_efficiency": LOSSLESS,
        "k_s": Quantity("Pa/m^n"),
        **SOIL,
        "c1": Quantity("1", "0.18"),
        "c2": Quantity("1", "0.32"),
    },
    needs={"omega": "", "slip": "", "load": "150 N"},
    first_fit={
        "k_s": "{ value = 1e6, min = 2e4, max = 2e7 }",
        "friction_angle": '{ value = "35 deg", min = "15 deg", max = "50 deg" }',
        "shear_modulus": '{ value = "15 mm", min = "1 mm", max = "100 mm" }',
    },
    column_words={
        "current": ("current cur i amps", "offset"),
        "traction": ("traction drawbar pull fx", "sd std"),
    },
    forces={"resistance": "N m", "drag": "N"},
    effects=(
        *("bulldozing", "slip_sinkage", "rate_effect", "multipass", "moisture_cohesion", "force_offset"),
        *("motor_heating", "current_offset", "coulomb_friction", "viscous_friction", "stribeck"),
    ),
    follows=("time", "angle", "temperature", "voltage", "speed", "slip"),
    left_out={  # no causes: what the motor's circuit gives, and what holds the torque up
        "voltage": "with the speed it gives the current by itself",
        "swing_angle": "it follows from the torque",
    },
    of_soil=False,
    law=sphere,
    geometry=("radius",),
    inputs=contact.COLUMNS,
    soil=lambda flat, common: sphere.Soil(flat("k_s"), c1=flat("c1"), c2=flat("c2"), **common),
    neutral={"recovery": 0.0},
)
