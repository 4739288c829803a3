"""A sphere driven by a pendulum, over time (physics/bodies/pendulum_sphere.py)."""

from terrapin_hil.physics.bodies.pendulum_sphere import BODY
from terrapin_tools.workbench.bases.kinds.integrated import integrated

BASE = integrated(BODY, imposed="joint_rate")
