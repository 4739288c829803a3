"""Operating points of a driven wheel on soft ground, for `terrapin soil tactile`."""

from terrapin_tools.workbench.bases.kinds.base import Base

BASE = Base(name="driven_wheel", reader="terrapin soil tactile", of_soil=True)
