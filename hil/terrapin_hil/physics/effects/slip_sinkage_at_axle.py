"""A shell that digs itself in as it slips, and must push the sand away: it takes pull and no torque."""

from dataclasses import replace

from terrapin_hil.physics.effects import slip_sinkage

EFFECT = replace(
    slip_sinkage.EFFECT,
    name="slip_sinkage_at_axle",
    title="Resistance of slip sinkage at the axle",
    equation=r"P \to P - R_f,\; R_f = \xi_1 W \max(s - \xi_2, 0)^{\xi_3}",
    source="Li et al. 2024, Eq. (9), as a loss of the axle; Eq. (10) takes it from the torque as well",
    target="axle",
    plant=False,  # there slip_sinkage itself acts at the axle
)
