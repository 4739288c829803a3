"""A sphere driven by a pendulum, over time (physics/bodies/pendulum_sphere.py)."""

from terrapin_hil.physics.bodies.pendulum_sphere import BODY
from terrapin_tools.workbench.bases.kinds.integrated import integrated

BASE = integrated(
    BODY,
    imposed="joint_rate",
    like=8,
    sign=frozenset(("torque", "rolling_angle")),
    column_words={"rolling_angle": ("rolling roll shell sphere theta", "rate speed")},
    first_fit={
        "f_o": "{ value = 0.02, min = 0.0, max = 0.5 }",
        "viscous": '{ value = "0.5 N m s/rad", min = "0 N m s/rad", max = "5 N m s/rad" }',
    },
)
