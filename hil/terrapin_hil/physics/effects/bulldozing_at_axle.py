"""Sand that the shell pushes ahead of itself, whose pressure points at the axle: it takes pull and no torque."""

from dataclasses import replace

from terrapin_hil.physics.effects import bulldozing

EFFECT = replace(
    bulldozing.EFFECT,
    name="bulldozing_at_axle",
    title="Bulldozing at the axle",
    equation=r"P \to P - \kappa R_c,\; R_c=\int (0.67 c z K_l + \tfrac12 z^2 \gamma K_g) dx",
    source="Li et al. 2024, Eq. (8); a wall's pressure points at the axle of a round shell (Eq. 10 has both)",
    target="axle",
    plant=False,  # there bulldozing itself acts at the axle
)
