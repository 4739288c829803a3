"""A car on soft soil over time (physics/bodies/vehicle.py)."""

from terrapin_hil.physics.bodies.vehicle import BODY, WHEELS
from terrapin_tools.workbench.bases.kinds.contact import SOIL
from terrapin_tools.workbench.bases.kinds.integrated import integrated

BASE = integrated(
    BODY,
    placeholders={name: quantity.placeholder for name, quantity in SOIL.items()},
    provides=("pass", "side"),
    like=8,
    sign=frozenset(WHEELS),
    column_words={
        "omega_fl": ("fl lf front left", ""),
        "omega_fr": ("fr rf front right", ""),
        "omega_rl": ("rl lr rear left", ""),
        "omega_rr": ("rr rear right", ""),
    },
    first_fit={
        "k_s": "{ value = 5e5, min = 1e5, max = 2e6 }",
        "friction_angle": '{ value = "31 deg", min = "24 deg", max = "40 deg" }',
        "shear_modulus": '{ value = "36 mm", min = "10 mm", max = "80 mm" }',
    },
    of_soil=True,
    step=1e-5,  # its contact is solved to 1e-9
)
