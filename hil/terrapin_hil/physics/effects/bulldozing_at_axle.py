"""Sand that the shell pushes ahead of itself, whose pressure points at the axle: it takes pull and no torque."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="bulldozing_at_axle",
    title="Bulldozing at the axle",
    equation=r"P \to P - \kappa R_c,\; R_c=\int (0.67 c z K_l + \tfrac12 z^2 \gamma K_g) dx",
    source="Li et al. 2024, Eq. (8); a wall's pressure points at the axle of a round shell (Eq. 10 has both)",
    bases=("sphere_contact", "wheel_contact"),
    parameters=(Parameter("scale", "1", 0.0, 0.0, meaning="1 as printed", grid=(1.0,)),),
    needs=(),
    target="axle",
    expression="scale * bulldozing_resistance",
    constants={"unit_weight": "N/m^3", "n_c": "1", "n_gamma": "1"},
    plant=False,  # there bulldozing itself acts at the axle
)
