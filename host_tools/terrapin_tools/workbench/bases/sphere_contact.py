"""A sphere on sand, forced to a slip or driving itself: Li et al. 2024, Eqs. 1 to 10 (physics/sphere.py)."""

from terrapin_hil.physics import contact, sphere
from terrapin_tools.workbench.bases.kinds.base import Quantity
from terrapin_tools.workbench.bases.kinds.contact import SOIL, Contact

BASE = Contact(
    name="sphere_contact",
    parameters={
        "radius": Quantity("m", "80 mm"),
        "k_s": Quantity("Pa/m^n"),
        **SOIL,
        "c1": Quantity("1", "0.18"),
        "c2": Quantity("1", "0.32"),
    },
    first_fit={"k_s": "{ value = 1e6, min = 2e4, max = 2e7 }"},
    law=sphere,
    geometry=("radius",),
    inputs=contact.COLUMNS,
    soil=lambda flat, common: sphere.Soil(flat("k_s"), c1=flat("c1"), c2=flat("c2"), **common),
    neutral={"recovery": 0.0},
)
