"""The cylindrical robot over time on ground that slips (physics/bodies/cmr_slip.py)."""

from terrapin_hil.physics.bodies.cmr_slip import BODY
from terrapin_tools.workbench.bases.kinds.integrated import integrated

BASE = integrated(
    BODY,
    like=9,
    sign=frozenset(("speed",)),
    measured=frozenset(("speed", "omega")),  # of the axle and of the drive: slip is what they differ by
    first_fit={
        "f_o": "{ value = 0.05, min = 0.0, max = 0.5 }",
        "mu": "{ value = 0.5, min = 0.05, max = 1.5 }",
        "s_k": "{ value = 0.1, min = 0.005, max = 1.0 }",
    },
)
