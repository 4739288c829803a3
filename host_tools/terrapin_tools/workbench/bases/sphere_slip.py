"""A sphere driven by a pendulum, over time on sand that slips (physics/bodies/sphere_slip.py)."""

from terrapin_hil.physics.bodies.sphere_slip import BODY
from terrapin_tools.workbench.bases.kinds.contact import SOIL
from terrapin_tools.workbench.bases.kinds.integrated import integrated

BASE = integrated(
    BODY,
    placeholders={name: quantity.placeholder for name, quantity in SOIL.items() if name in BODY.parameters},
    imposed="joint_rate",
    like=9,
    sign=frozenset(("rolling_angle",)),
    measured=frozenset(("speed",)),
    first_fit={
        "k_s": "{ value = 2e6, min = 1e5, max = 2e7 }",
        "viscous": '{ value = "0.5 N m s/rad", min = "0 N m s/rad", max = "5 N m s/rad" }',
    },
    of_soil=True,
)
