"""The cylindrical robot over time (physics/bodies/cmr.py)."""

from terrapin_hil.physics.bodies.cmr import BODY
from terrapin_tools.workbench.bases.kinds.integrated import integrated

BASE = integrated(
    BODY,
    like=8,
    sign=frozenset(("swing_angle",)),
    column_words={"swing_angle": ("swing phi sway pendulum tilt", "rate speed")},
    first_fit={
        "f_o": "{ value = 0.05, min = 0.0, max = 0.5 }",
        "coulomb": '{ value = "10 mN m", min = "0 N m", max = "0.2 N m" }',
        "viscous": '{ value = "1 mN m s/rad", min = "0 N m s/rad", max = "0.05 N m s/rad" }',
    },
)
