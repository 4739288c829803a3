"""A car on soft soil over time (physics/bodies/vehicle.py)."""

from terrapin_hil.physics.bodies.vehicle import BODY
from terrapin_tools.workbench.bases.kinds.contact import SOIL
from terrapin_tools.workbench.bases.kinds.integrated import integrated

BASE = integrated(
    BODY,
    placeholders={name: quantity.placeholder for name, quantity in SOIL.items()},
    provides=("pass",),
    of_soil=True,
    even_steps=True,
    step=1e-5,  # its contact is solved to 1e-9
)
