"""A rut that slipping digs, beside what the shell bulldozes at its sinkage."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="rut",
    title="Slipping digs a rut",
    equation=r"P \to P - R_d,\; T \to T - R R_d,\; R_d = R_c(z + d) - R_c(z),\; d = \delta \frac{s}{1 - s}",
    source="Li et al. 2024, Eqs. (8) and (10), at the depth that steady slip digs [our assumption] (physics/ground)",
    bases=("sphere_contact", "wheel_contact", "rolling_sphere"),
    parameters=(Parameter("rut_depth", "m", 0.0, 0.0, 0.1, "dug at a slip of one half"),),
    needs=(("slip",),),
    target="drag",
    expression="rut_depth * rut_resistance",  # the second: (R_c(z + d) - R_c(z)) / delta of the model
    constants={"unit_weight": "N/m^3", "n_c": "1", "n_gamma": "1"},
    plant=False,  # there slip_depth of the ground digs it over time
)
