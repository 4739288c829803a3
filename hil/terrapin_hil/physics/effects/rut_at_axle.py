"""A rut that slipping digs, whose sand presses on the axle: it takes pull and no torque."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="rut_at_axle",
    title="Slipping digs a rut, at the axle",
    equation=r"P \to P - R_d,\; R_d = R_c(z + d) - R_c(z),\; d = \delta \frac{s}{1 - s}",
    source="Li et al. 2024, Eq. (8), at the depth that steady slip digs [our assumption], as a loss of the axle",
    bases=("sphere_contact", "wheel_contact"),
    parameters=(Parameter("rut_depth", "m", 0.0, 0.0, 0.1, "dug at a slip of one half"),),
    needs=(("slip",),),
    target="axle",
    expression="rut_depth * rut_resistance",  # the second: (R_c(z + d) - R_c(z)) / delta of the model
    constants={"unit_weight": "N/m^3", "n_c": "1", "n_gamma": "1"},
    plant=False,  # there slip_depth of the ground digs it over time
)
