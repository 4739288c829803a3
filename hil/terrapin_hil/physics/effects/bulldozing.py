"""Sand that the shell pushes ahead of itself."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="bulldozing",
    title="Bulldozing",
    equation=r"P \to P - \kappa R_c,\; T \to T - \kappa R R_c,\, R_c=\int (0.67 c z K_l + \tfrac12 z^2 \gamma K_g) dx",
    source="Li et al. 2024, Eqs. (8) and (10)",
    bases=("sphere_contact", "wheel_contact"),
    parameters=(Parameter("scale", "1", 0.0, 0.0, meaning="1 as printed", grid=(1.0,)),),
    needs=(),
    target="drag",
    expression="scale * bulldozing_resistance",  # R_c: from the model's present sinkage, c and phi
    constants={"unit_weight": "N/m^3", "n_c": "1", "n_gamma": "1"},
)
