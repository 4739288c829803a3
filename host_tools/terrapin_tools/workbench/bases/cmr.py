"""The cylindrical robot over time (physics/bodies/cmr.py)."""

from terrapin_hil.physics.bodies.cmr import BODY
from terrapin_tools.workbench.bases.kinds.integrated import integrated

BASE = integrated(BODY)
