"""A shell that digs itself in as it slips, and must push the sand away: it takes pull and no torque."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="slip_sinkage_at_axle",
    title="Resistance of slip sinkage at the axle",
    equation=r"P \to P - R_f,\; R_f = \xi_1 W \max(s - \xi_2, 0)^{\xi_3}",
    source="Li et al. 2024, Eq. (9), as a loss of the axle; Eq. (10) takes it from the torque as well",
    bases=("sphere_contact", "wheel_contact"),
    parameters=(
        Parameter("xi1", "1", 0.0, 0.0, meaning="size at full slip"),
        Parameter("xi2", "1", 0.45, 0.0, 0.95, "slip at which it begins", grid=(0.1, 0.2, 0.3, 0.4, 0.5, 0.6)),
        Parameter("xi3", "1", 2.0, 0.5, 6.0, "how sharply it grows", grid=(1.0, 2.0, 3.0)),
    ),
    needs=(("slip",),),
    target="axle",
    expression="xi1 * load * max(slip - xi2, (1 - clip)*abs(slip - xi2))**xi3",
    options={"clip": 1.0},  # 1: nothing below xi2; 0: as printed, abs(s - xi2)
    plant=False,  # there slip_sinkage itself acts at the axle
)
