"""A rigid wheel, or a cylindrical shell, on soft ground: Reina et al. 2006, Eqs. 9 to 15 (physics/wheel.py)."""

from terrapin_hil.physics import wheel
from terrapin_tools.workbench.bases.kinds.base import Quantity
from terrapin_tools.workbench.bases.kinds.contact import SOIL, Contact

BASE = Contact(
    name="wheel_contact",
    parameters={
        "radius": Quantity("m", "80 mm"),
        "width": Quantity("m", "50 mm"),
        "k_c": Quantity("Pa", "0 Pa"),
        "k_phi": Quantity("Pa/m"),
        **SOIL,
    },
    first_fit={"k_phi": "{ value = 1e6, min = 2e4, max = 2e7 }"},
    further=("k_s",),
    law=wheel,
    geometry=("radius", "width"),
    inputs=wheel.COLUMNS,
    soil=lambda flat, common: wheel.Soil(flat("k_c") * flat("k_s"), flat("k_phi") * flat("k_s"), **common),
    neutral={"recovery": 0.0, "k_s": 1.0},  # k_s is a factor on k_c and k_phi alike
    words=frozenset(("wheel", "rim", "tyre", "tire")),
)
